//! Buds in the axils of leaves.

use glam::{Vec2, Vec3};

use osier_base::math::{cos_f32, normalize_or, sin_f32};
use osier_scene::Mesh;

/// Corners of a bud's cross-section, and its radius at some heights, as shares of its length.
const SIDES: u32 = 5;
const OUTLINE: [[f32; 2]; 3] = [[-0.05, 0.11], [0.3, 0.19], [0.7, 0.11]];

/// A bud of length 1 along +Y, seated at the origin, without a face at its base, which is inside the bark.
pub fn bud_mesh() -> Mesh {
    let mut mesh = Mesh::default();
    for [y, radius] in OUTLINE {
        for i in 0..SIDES {
            let angle = std::f32::consts::TAU * i as f32 / SIDES as f32;
            let out = Vec3::new(cos_f32(angle), 0.0, -sin_f32(angle));
            mesh.points.push(out * radius + Vec3::Y * y);
            mesh.normals.push(normalize_or(out + Vec3::Y * (y - 0.3), out));
            mesh.uvs.push(Vec2::new(i as f32 / SIDES as f32, y.max(0.0)));
        }
    }
    // Two bands of quads between the three rings, then a fan to the tip.
    let tip = mesh.next_point();
    mesh.points.push(Vec3::Y);
    mesh.normals.push(Vec3::Y);
    mesh.uvs.push(Vec2::new(0.5, 1.0));
    for i in 0..SIDES {
        let j = (i + 1) % SIDES;
        for ring in 0..2 {
            let [a, b, c, d] = [ring * SIDES + i, ring * SIDES + j, (ring + 1) * SIDES + i, (ring + 1) * SIDES + j];
            mesh.triangles.push([a, b, d]);
            mesh.triangles.push([a, d, c]);
        }
        mesh.triangles.push([2 * SIDES + i, 2 * SIDES + j, tip]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bud_faces_outwards() {
        let mesh = bud_mesh();
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            let middle = (a + b + c) / 3.0;
            assert!((b - a).cross(c - a).dot(Vec3::new(middle.x, 0.05, middle.z)) > 0.0, "{t:?}");
        }
    }
}
