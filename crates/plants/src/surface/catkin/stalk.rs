//! The stalk of a tuft: an ellipsoid that hangs below the hairs.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use osier_base::math::{cos_f32, sin_f32};
use osier_scene::Mesh;

/// An ellipsoid of semi-axes (r, 2 r, r) whose upper pole is the origin. `cut`: segments around and rows from pole to pole,
/// at least 3 and 2. An empty mesh for r = 0.
/// Source: \[catkin\] 3: a sphere stretched along y; the stretching does not touch the hairs.
/// Differs: it hangs below the tuft, as a seed does; the paper puts it where the hairs go.
pub fn stalk(r: f32, cut: (u32, u32)) -> Mesh {
    let mut mesh = Mesh::default();
    if r <= 0.0 {
        return mesh.with_material(0);
    }
    let (around, rows) = (cut.0.max(3), cut.1.max(2));
    let shape = Vec3::new(r, 2.0 * r, r);
    let mut push = |n: Vec3, uv: Vec2| {
        mesh.points.push(n * shape - Vec3::Y * (2.0 * r));
        mesh.normals.push((n / shape).normalize());
        mesh.uvs.push(uv);
    };
    push(Vec3::Y, Vec2::new(0.5, 1.0));
    for row in 1..rows {
        let v = row as f32 / rows as f32;
        for k in 0..around {
            let u = k as f32 / around as f32;
            let flat = sin_f32(PI * v);
            push(Vec3::new(flat * cos_f32(TAU * u), cos_f32(PI * v), -flat * sin_f32(TAU * u)), Vec2::new(u, 1.0 - v));
        }
    }
    push(Vec3::NEG_Y, Vec2::new(0.5, 0.0));
    // Rows are numbered from pole to pole; fans at the poles, quads between.
    let at = |row: u32, k: u32| 1 + (row - 1) * around + k % around;
    let last = 1 + (rows - 1) * around;
    for k in 0..around {
        mesh.triangles.push([0, at(1, k), at(1, k + 1)]);
        for row in 1..rows - 1 {
            let [a, b, c, d] = [at(row, k), at(row, k + 1), at(row + 1, k), at(row + 1, k + 1)];
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
        mesh.triangles.push([at(rows - 1, k), last, at(rows - 1, k + 1)]);
    }
    mesh.with_material(0)
}
