//! Patches of the string and meshes of surfaces from companion files: Bezier patches and triangles.

use std::collections::BTreeMap;

use glam::{DVec3, Vec2, Vec3};

use super::paint::{Paint, TURTLE_COLOR};
use osier_base::convert::saturating_index;
use osier_base::math::narrow;
use osier_grammar::companion::{SurfaceFile, SurfaceTriangle};
use osier_scene::{MaterialId, Mesh};

/// Points nearer than this share of a surface's largest coordinate share one normal: patches meet up to the rounding of a text
/// file.
const WELD: f64 = 1e-5;

/// A Bezier, B-spline or cardinal patch whose control points the string sets.
#[derive(Debug, Clone)]
pub(super) struct TurtlePatch {
    pub basis: PatchBasis,
    pub points: [[DVec3; 4]; 4],
}

#[derive(Debug, Clone, Copy)]
pub(super) enum PatchBasis {
    Bezier,
    BSpline,
    Cardinal,
}

impl PatchBasis {
    /// Control points in Bezier form of the curve that four points of this basis define.
    pub fn bezier(self, p: [DVec3; 4]) -> [DVec3; 4] {
        match self {
            Self::Bezier => p,
            // The change of basis from uniform cubic B-splines, and below from Catmull-Rom splines, to Bezier form.
            Self::BSpline => [
                (p[0] + p[1] * 4.0 + p[2]) / 6.0,
                (p[1] * 2.0 + p[2]) / 3.0,
                (p[1] + p[2] * 2.0) / 3.0,
                (p[1] + p[2] * 4.0 + p[3]) / 6.0,
            ],
            Self::Cardinal => [p[1], p[1] + (p[2] - p[0]) / 6.0, p[2] - (p[3] - p[1]) / 6.0, p[2]],
        }
    }
}

/// Patches by the number that `@PS` gives.
pub(super) type TurtlePatches = BTreeMap<u32, TurtlePatch>;

/// The mesh of a surface in organ space, in turtle units at scale 1: `quads` quads along and across each patch, with smooth
/// normals over patches that meet. Subsets have the colour of their patch, or that of the turtle; `texture` replaces both.
/// Source: the tensor product of cubic Bernstein polynomials.
pub fn patch_mesh(surface: &SurfaceFile, quads: [u32; 2], texture: Option<MaterialId>) -> Mesh {
    let mut mesh = Mesh::default();
    let mut positions: Vec<DVec3> = Vec::new();
    for patch in &surface.patches {
        let points = patch.points.map(|row| row.map(|q| DVec3::from(surface.organ_point(q))));
        let [across, along] = quads.map(|n| n.max(1));
        let first = mesh.next_point();
        for j in 0..=along {
            let v = f64::from(j) / f64::from(along);
            for i in 0..=across {
                let u = f64::from(i) / f64::from(across);
                let p = bezier(points.map(|row| bezier(row, u)), v);
                positions.push(p);
                mesh.points.push(single(p));
                mesh.uvs.push(Vec2::new(narrow(u), narrow(v)));
            }
        }
        let row = across + 1;
        let mut triangles = Vec::new();
        for j in 0..along {
            for i in 0..across {
                let a = first + j * row + i;
                triangles.push([a, a + 1, a + row + 1]);
                triangles.push([a, a + row + 1, a + row]);
            }
        }
        let own = patch.color.map_or(TURTLE_COLOR, |index| Paint { index, thin: true }.material());
        append(&mut mesh, texture.unwrap_or(own), triangles);
    }
    orient(&mut mesh);
    smooth(&mut mesh, &positions);
    mesh
}

/// The mesh of triangles with their points and normals, in the turtle's colour or with a texture. It has texture coordinates only
/// if all triangles have them.
pub fn triangle_mesh(triangles: &[SurfaceTriangle], texture: Option<MaterialId>) -> Mesh {
    let mut mesh = Mesh::default();
    let mut faces = Vec::new();
    let textured = triangles.iter().all(|t| t.uvs.is_some());
    for t in triangles {
        let first = mesh.next_point();
        for i in 0..3 {
            mesh.points.push(single(DVec3::from(t.points[i])));
            mesh.normals.push(single(DVec3::from(t.normals[i]).normalize_or(DVec3::Z)));
            if textured {
                mesh.uvs.extend(t.uvs.map(|uv| Vec2::new(narrow(uv[i][0]), narrow(uv[i][1]))));
            }
        }
        // Counter-clockwise from the side of the normals.
        let [a, b, c] = [0, 1, 2].map(|i| mesh.points[mesh.points.len() - 3 + i]);
        let outside = mesh.normals[mesh.normals.len() - 3];
        let turned = (b - a).cross(c - a).dot(outside) < 0.0;
        faces.push(if turned { [first, first + 2, first + 1] } else { [first, first + 1, first + 2] });
    }
    append(&mut mesh, texture.unwrap_or(TURTLE_COLOR), faces);
    mesh
}

fn append(mesh: &mut Mesh, material: MaterialId, triangles: Vec<[u32; 3]>) {
    match mesh.subsets.last_mut().filter(|s| s.material == material) {
        Some(last) => {
            last.count += saturating_index(triangles.len());
            mesh.triangles.extend(triangles);
        }
        None => mesh.append_subset(material, triangles),
    }
}

fn bezier(p: [DVec3; 4], t: f64) -> DVec3 {
    let s = 1.0 - t;
    p[0] * (s * s * s) + p[1] * (3.0 * s * s * t) + p[2] * (3.0 * s * t * t) + p[3] * (t * t * t)
}

fn single(p: DVec3) -> Vec3 {
    Vec3::new(narrow(p.x), narrow(p.y), narrow(p.z))
}

/// Turns the mesh so that most of it faces +Z, the upper side of organs.
fn orient(mesh: &mut Mesh) {
    let up: f32 = mesh.triangles.iter().map(|t| face(mesh, *t).z).sum();
    if up < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// Normal of a triangle, as long as twice its area.
fn face(mesh: &Mesh, t: [u32; 3]) -> Vec3 {
    let [a, b, c] = t.map(|i| mesh.points[i as usize]);
    (b - a).cross(c - a)
}

/// Normals from the sum of the faces around each position; positions that differ by rounding count as one.
#[allow(clippy::cast_possible_truncation, reason = "saturates; only compared for equality")]
fn smooth(mesh: &mut Mesh, positions: &[DVec3]) {
    let largest = positions.iter().fold(1e-9_f64, |m, p| m.max(p.abs().max_element()));
    let key = |p: DVec3| (p / (largest * WELD)).round().to_array().map(|v| v as i64);
    let mut sums: BTreeMap<[i64; 3], Vec3> = BTreeMap::new();
    for t in &mesh.triangles {
        let normal = face(mesh, *t);
        for i in t {
            *sums.entry(key(positions[*i as usize])).or_default() += normal;
        }
    }
    let normal = |p: &DVec3| osier_base::math::normalize_or(sums.get(&key(*p)).copied().unwrap_or_default(), Vec3::Z);
    mesh.normals = positions.iter().map(normal).collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_grammar::companion::SurfacePatch;

    fn patch(f: impl Fn(f64, f64) -> [f64; 3], color: Option<u8>) -> SurfacePatch {
        let at = |i: usize| i as f64 / 3.0;
        SurfacePatch { color, points: [0, 1, 2, 3].map(|j| [0, 1, 2, 3].map(|i| f(at(i), at(j)))) }
    }

    fn surface(patches: Vec<SurfacePatch>) -> SurfaceFile {
        SurfaceFile {
            contact: [0.0; 3],
            end: [0.0; 3],
            heading: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, -1.0],
            size: 1.0,
            patches,
        }
    }

    #[test]
    fn a_patch_of_equal_steps_is_the_plane_through_its_corners() {
        let plane = surface(vec![patch(|u, v| [u - 0.5, 2.0 * v, 0.0], None)]);
        let mesh = patch_mesh(&plane, [4, 2], None);
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (15, 16));
        assert_eq!((mesh.points[0], mesh.points[14]), (Vec3::new(-0.5, 0.0, 0.0), Vec3::new(0.5, 2.0, 0.0)));
        assert!((mesh.points[6] - Vec3::new(-0.25, 1.0, 0.0)).length() < 1e-6, "{}", mesh.points[6]);
        assert!(mesh.normals.iter().all(|n| n.z > 0.999));
        assert_eq!(mesh.subsets[0].material, TURTLE_COLOR);
    }

    #[test]
    fn corners_pull_as_the_bernstein_polynomials_say() {
        // z = 1 at one inner point: its weight in the middle is (3/8)^2.
        let mut bump = patch(|u, v| [u, v, 0.0], Some(7));
        bump.points[1][1][2] = 1.0;
        let mesh = patch_mesh(&surface(vec![bump]), [2, 2], None);
        assert!((mesh.points[4].z - 9.0 / 64.0).abs() < 1e-6, "{}", mesh.points[4]);
        assert_eq!(Paint::of(mesh.subsets[0].material), Some(Paint { index: 7, thin: true }));
    }

    #[test]
    fn patches_that_meet_share_normals_and_face_up() {
        // A roof, drawn so that its faces look down.
        let side = |s: f64| patch(move |u, v| [s * u, v, -u], Some(3));
        let mesh = patch_mesh(&surface(vec![side(1.0), side(-1.0)]), [1, 1], None);
        let ridge: Vec<Vec3> =
            mesh.points.iter().zip(&mesh.normals).filter(|(p, _)| p.x.abs() < 1e-6).map(|(_, n)| *n).collect();
        assert_eq!(ridge.len(), 4);
        assert_eq!(mesh.subsets.len(), 1);
        assert!(ridge.iter().all(|n| (n.x.abs() - ridge[0].x.abs()).abs() < 1e-6), "{ridge:?}");
    }

    #[test]
    fn triangles_keep_their_normals() {
        let triangle = SurfaceTriangle {
            points: [[0.0; 3], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
            normals: [[0.0, 0.0, 2.0]; 3],
            uvs: None,
        };
        let mesh = triangle_mesh(&[triangle], Some(4));
        assert_eq!((mesh.triangles[0], mesh.subsets[0].material), ([0, 2, 1], 4));
        assert_eq!(mesh.normals, [Vec3::Z; 3]);
    }
}
