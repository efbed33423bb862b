//! Meshes as `mesh2`.

use std::collections::BTreeMap;

use glam::Vec3;

use super::space::{Space, direction, uv};
use crate::text::Text;
use osier_scene::{Material, MaterialClass, Mesh, Subset};

/// Triangles of a mesh that have an area, with their texture's place in the `texture_list`.
pub(super) struct Faces {
    corners: Vec<([u32; 3], u32)>,
    materials: Vec<u32>,
    water: Option<u32>,
}

impl Faces {
    /// Collects the faces of `mesh`; `materials`: the scene's.
    pub fn of(mesh: &Mesh, materials: &[Material]) -> Self {
        let mut slots: BTreeMap<u32, u32> = BTreeMap::new();
        let mut faces = Self { corners: Vec::with_capacity(mesh.triangles.len()), materials: Vec::new(), water: None };
        for subset in &mesh.subsets {
            let next = u32::try_from(slots.len()).unwrap_or(u32::MAX);
            let slot = *slots.entry(subset.material).or_insert(next);
            if slot == next {
                faces.materials.push(subset.material);
            }
            let class = materials.get(subset.material as usize).map(|m| m.class);
            if class == Some(MaterialClass::Water) {
                faces.water = faces.water.or(Some(subset.material));
            }
            let whole = mesh.subset_triangles(subset).iter().filter(|t| has_area(&mesh.points, t));
            faces.corners.extend(whole.map(|t| (*t, slot)));
        }
        faces
    }

    /// The material whose interior the mesh takes, if it holds water.
    pub fn water(&self) -> Option<u32> {
        self.water
    }
}

/// What of a mesh is hair, and what is not; `None` without hair.
pub(super) fn unhaired(mesh: &Mesh, materials: &[Material]) -> Option<(Mesh, Mesh)> {
    let is_hair = |s: &Subset| materials.get(s.material as usize).is_some_and(|m| m.class == MaterialClass::Catkin);
    mesh.subsets.iter().any(is_hair).then(|| (part(mesh, is_hair), part(mesh, |s| !is_hair(s))))
}

/// The subsets of a mesh that are wanted, with their own points.
fn part(mesh: &Mesh, wanted: impl Fn(&Subset) -> bool) -> Mesh {
    let mut chosen = vec![false; mesh.triangles.len()];
    for s in mesh.subsets.iter().filter(|s| wanted(s)) {
        chosen.iter_mut().skip(s.first as usize).take(s.count as usize).for_each(|c| *c = true);
    }
    pick(mesh, |i| chosen[i])
}

/// The triangles of a mesh that are wanted, by their numbers, with their own points.
pub(super) fn pick(mesh: &Mesh, wanted: impl Fn(usize) -> bool) -> Mesh {
    let mut out = Mesh::default();
    let mut places = vec![u32::MAX; mesh.points.len()];
    for subset in &mesh.subsets {
        let first = u32::try_from(out.triangles.len()).unwrap_or(u32::MAX);
        for (_, t) in (subset.first as usize..).zip(mesh.subset_triangles(subset)).filter(|(i, _)| wanted(*i)) {
            let corners = t.map(|i| {
                let old = i as usize;
                if places[old] == u32::MAX {
                    places[old] = u32::try_from(out.points.len()).unwrap_or(u32::MAX);
                    out.points.push(mesh.points[old]);
                    out.normals.push(mesh.normals[old]);
                    out.uvs.extend(mesh.uvs.get(old));
                    out.colors.extend(mesh.colors.get(old));
                }
                places[old]
            });
            out.triangles.push(corners);
        }
        let count = u32::try_from(out.triangles.len()).unwrap_or(u32::MAX) - first;
        if count > 0 {
            out.subsets.push(Subset { first, count, ..*subset });
        }
    }
    out
}

/// True if any triangle of a mesh has an area.
pub(super) fn shows(mesh: &Mesh) -> bool {
    mesh.triangles.iter().any(|t| has_area(&mesh.points, t))
}

/// False for a triangle without area, which POV-Ray would complain about.
fn has_area(points: &[Vec3], t: &[u32; 3]) -> bool {
    let corner = |i: u32| points.get(i as usize).map(|p| p.to_array().map(f64::from));
    let [Some(a), Some(b), Some(c)] = t.map(corner) else { return false };
    let side = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let (u, v) = (side(b), side(c));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    cross.iter().any(|x| x.abs() > 0.0)
}

/// `vertex_vectors` and `normal_vectors`: what moves when a mesh deforms.
/// Source: POV-Ray 3.7 documentation, 2.5.2.2.4 "Mesh2".
pub(super) fn vectors(text: &mut Text, space: Space, points: &[Vec3], normals: &[Vec3]) {
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    text.put("vertex_vectors{").int(count(points.len())).put("\n");
    text.lines(points, |t, _, p| {
        t.put(",");
        space.point(t, *p);
        t.put("\n");
    });
    text.put("}normal_vectors{").int(count(normals.len())).put("\n");
    text.lines(normals, |t, _, n| {
        t.put(",");
        direction(t, *n);
        t.put("\n");
    });
    text.put("}\n");
}

/// `uv_vectors`, `texture_list` and `face_indices`: what stays. Corners (a, b, c) become (a, c, b), since mirroring
/// turned the sides over. A mesh without texture coordinates gets the materials' flat colours.
pub(super) fn topology(text: &mut Text, mesh: &Mesh, faces: &Faces) {
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let kind = if mesh.uvs.is_empty() { "C_" } else { "M_" };
    if !mesh.uvs.is_empty() {
        text.put("uv_vectors{").int(count(mesh.uvs.len())).put("\n");
        text.lines(&mesh.uvs, |t, _, v| {
            t.put(",");
            uv(t, *v);
            t.put("\n");
        });
        text.put("}");
    }
    text.put("texture_list{").int(count(faces.materials.len()));
    for m in &faces.materials {
        text.put(",texture{").put(kind).int(*m).put("}");
    }
    text.put("}\nface_indices{").int(count(faces.corners.len())).put("\n");
    text.lines(&faces.corners, |t, _, (f, slot)| {
        t.put(",<").int(f[0]).put(",").int(f[2]).put(",").int(f[1]).put(">,").int(*slot).put("\n");
    });
    text.put("}");
    if let Some(m) = faces.water {
        text.put("interior{I_").int(m).put("}");
    }
    text.put("\n");
}

/// A whole `mesh2` at rest or of varying topology. `faces`: not empty, of the same mesh.
pub(super) fn mesh2(text: &mut Text, space: Space, mesh: &Mesh, faces: &Faces) {
    text.put("mesh2{\n");
    vectors(text, space, &mesh.points, &mesh.normals);
    topology(text, mesh, faces);
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
        let faces = Faces::of(&mesh, &[]);
        let mut text = Text::default();
        mesh2(&mut text, Space { scale: 100.0 }, &mesh, &faces);
        let wanted = "mesh2{\nvertex_vectors{3\n,<0,0,0>\n,<50,0,-25>\n,<0,100,12.5>\n}normal_vectors{3\n,<0,0,-1>\n\
                      ,<0,0,-1>\n,<0,0,-1>\n}\nuv_vectors{3\n,<0,0>\n,<1,0>\n,<0.5,1>\n}texture_list{1,texture{M_4}}\n\
                      face_indices{1\n,<0,2,1>,0\n}\n}\n";
        assert_eq!(std::str::from_utf8(text.bytes()).expect("ascii"), wanted);
    }
}
