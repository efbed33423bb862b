//! Meshes as `mesh2` objects. Source: POV-Ray 3.7 documentation, 2.5.2.2.4 "Mesh2".

use std::collections::BTreeMap;

use glam::Vec3;

use super::space::{PovSpace, write_direction, write_uv};
use crate::text::TextBuffer;
use osier_scene::{Material, MaterialClass, Mesh, Subset};

/// The faces of a mesh that have an area, and the materials of its `texture_list`.
pub(super) struct Mesh2Faces {
    /// Corners, and the index of the texture in the list.
    corners: Vec<([u32; 3], u32)>,
    /// Materials in the order of the list.
    materials: Vec<u32>,
    water: Option<u32>,
}

impl Mesh2Faces {
    /// Collects the faces of `mesh` that have an area, and its materials. `materials`: those of the scene.
    pub fn of(mesh: &Mesh, materials: &[Material]) -> Self {
        let (mut slots, mut next): (BTreeMap<u32, u32>, u32) = (BTreeMap::new(), 0);
        let mut faces = Self { corners: Vec::with_capacity(mesh.triangles.len()), materials: Vec::new(), water: None };
        for subset in &mesh.subsets {
            // Subsets of one material share an entry of the texture list.
            let slot = *slots.entry(subset.material).or_insert(next);
            if slot == next {
                faces.materials.push(subset.material);
                next += 1;
            }
            let class = materials.get(subset.material as usize).map(|m| m.class);
            if class == Some(MaterialClass::Water) {
                faces.water = faces.water.or(Some(subset.material));
            }
            let triangles = mesh.subset_triangles(subset).iter().filter(|t| has_area(&mesh.points, t));
            faces.corners.extend(triangles.map(|t| (*t, slot)));
        }
        faces
    }

    /// The water material of the mesh, if it has one: its interior becomes that of the mesh.
    pub fn water(&self) -> Option<u32> {
        self.water
    }
}

/// Splits a mesh into its hair (material class catkin) and the rest; `None` if it has no hair.
pub(super) fn split_hair(mesh: &Mesh, materials: &[Material]) -> Option<(Mesh, Mesh)> {
    let is_hair = |s: &Subset| materials.get(s.material as usize).is_some_and(|m| m.class == MaterialClass::Catkin);
    mesh.subsets.iter().any(is_hair).then(|| (extract_subsets(mesh, is_hair), extract_subsets(mesh, |s| !is_hair(s))))
}

/// The subsets of a mesh that `wanted` selects, with the points they use.
fn extract_subsets(mesh: &Mesh, wanted: impl Fn(&Subset) -> bool) -> Mesh {
    // Subsets are runs of triangles, but the selection is by triangle.
    let mut chosen = vec![false; mesh.triangles.len()];
    for s in mesh.subsets.iter().filter(|s| wanted(s)) {
        chosen.iter_mut().skip(s.first as usize).take(s.count as usize).for_each(|c| *c = true);
    }
    extract_triangles(mesh, |i| chosen[i])
}

/// The triangles of a mesh that `wanted` selects by index, with the points they use.
pub(super) fn extract_triangles(mesh: &Mesh, wanted: impl Fn(usize) -> bool) -> Mesh {
    let mut out = Mesh::default();
    // Index of each point in the new mesh, u32::MAX for those not used so far. Counters in u32 suffice: the new mesh has no more
    // points and triangles than the old one, whose indices are u32.
    let mut places = vec![u32::MAX; mesh.points.len()];
    let (mut points, mut triangles) = (0_u32, 0_u32);
    for subset in &mesh.subsets {
        let first = triangles;
        for (_, t) in (subset.first as usize..).zip(mesh.subset_triangles(subset)).filter(|(i, _)| wanted(*i)) {
            let corners = t.map(|i| {
                let old = i as usize;
                if places[old] == u32::MAX {
                    places[old] = points;
                    points += 1;
                    out.points.push(mesh.points[old]);
                    out.normals.push(mesh.normals[old]);
                    // `get` yields nothing for a mesh without coordinates or colours, whose lists stay empty.
                    out.uvs.extend(mesh.uvs.get(old));
                    out.colors.extend(mesh.colors.get(old));
                }
                places[old]
            });
            out.triangles.push(corners);
            triangles += 1;
        }
        let count = triangles - first;
        if count > 0 {
            out.subsets.push(Subset { first, count, ..*subset });
        }
    }
    out
}

/// Whether any triangle of a mesh has an area; a `mesh2` needs at least one face.
pub(super) fn has_area_anywhere(mesh: &Mesh) -> bool {
    mesh.triangles.iter().any(|t| has_area(&mesh.points, t))
}

/// Whether a triangle has an area, in double precision: POV-Ray warns of each triangle that has none.
fn has_area(points: &[Vec3], t: &[u32; 3]) -> bool {
    let corner = |i: u32| points.get(i as usize).map(|p| p.to_array().map(f64::from));
    let [Some(a), Some(b), Some(c)] = t.map(corner) else { return false };
    let side = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let (u, v) = (side(b), side(c));
    // The cross product of two sides has the length of twice the area; differences of f32 are exact enough in f64 that only
    // triangles whose corners lie on a line give zero.
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    cross.iter().any(|x| x.abs() > 0.0)
}

/// Writes `vertex_vectors` and `normal_vectors`: the part of a mesh that changes when it deforms.
pub(super) fn write_vectors(text: &mut TextBuffer, space: PovSpace, points: &[Vec3], normals: &[Vec3]) {
    text.put("vertex_vectors{").int(points.len() as u64).put("\n");
    text.lines(points, |t, _, p| {
        t.put(",");
        space.write_point(t, *p);
        t.put("\n");
    });
    text.put("}normal_vectors{").int(normals.len() as u64).put("\n");
    text.lines(normals, |t, _, n| {
        t.put(",");
        write_direction(t, *n);
        t.put("\n");
    });
    text.put("}\n");
}

/// Writes `uv_vectors`, `texture_list` and `face_indices`: the part that stays. Corners (a, b, c) become (a, c, b), since the
/// mirrored space reverses the winding. A mesh without texture coordinates gets the materials' flat colours.
pub(super) fn write_topology(text: &mut TextBuffer, mesh: &Mesh, faces: &Mesh2Faces) {
    let kind = if mesh.uvs.is_empty() { "C_" } else { "M_" };
    if !mesh.uvs.is_empty() {
        text.put("uv_vectors{").int(mesh.uvs.len() as u64).put("\n");
        text.lines(&mesh.uvs, |t, _, v| {
            t.put(",");
            write_uv(t, *v);
            t.put("\n");
        });
        text.put("}");
    }
    text.put("texture_list{").int(faces.materials.len() as u64);
    for m in &faces.materials {
        text.put(",texture{").put(kind).int(*m).put("}");
    }
    text.put("}\nface_indices{").int(faces.corners.len() as u64).put("\n");
    text.lines(&faces.corners, |t, _, (f, slot)| {
        t.put(",<").int(f[0]).put(",").int(f[2]).put(",").int(f[1]).put(">,").int(*slot).put("\n");
    });
    text.put("}");
    if let Some(m) = faces.water {
        text.put("interior{I_").int(m).put("}");
    }
    text.put("\n");
}

/// Writes a complete `mesh2`. `faces`: the faces of `mesh`, not empty.
pub(super) fn write_mesh2(text: &mut TextBuffer, space: PovSpace, mesh: &Mesh, faces: &Mesh2Faces) {
    text.put("mesh2{\n");
    write_vectors(text, space, &mesh.points, &mesh.normals);
    write_topology(text, mesh, faces);
    text.put("}\n");
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    #[test]
    fn one_triangle_byte_for_byte() {
        let mesh = Mesh {
            points: vec![Vec3::ZERO, Vec3::new(0.5, 0.0, 0.25), Vec3::new(0.0, 1.0, -0.125)],
            normals: vec![Vec3::Z; 3],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::new(0.5, 1.0)],
            triangles: vec![[0, 1, 2], [0, 1, 1]],
            ..Mesh::default()
        }
        .with_material(4);
        let faces = Mesh2Faces::of(&mesh, &[]);
        let mut text = TextBuffer::default();
        write_mesh2(&mut text, PovSpace { scale: 100.0 }, &mesh, &faces);
        let wanted = "mesh2{\nvertex_vectors{3\n,<0,0,0>\n,<50,0,-25>\n,<0,100,12.5>\n}normal_vectors{3\n,<0,0,-1>\n\
                      ,<0,0,-1>\n,<0,0,-1>\n}\nuv_vectors{3\n,<0,0>\n,<1,0>\n,<0.5,1>\n}texture_list{1,texture{M_4}}\n\
                      face_indices{1\n,<0,2,1>,0\n}\n}\n";
        assert_eq!(std::str::from_utf8(text.bytes()).expect("ascii"), wanted);
    }
}
