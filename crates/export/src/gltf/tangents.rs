//! Tangents for materials with a normal map: without them each viewer computes different ones, and validators warn.

use glam::{Vec2, Vec3};

use osier_base::math::{normalize_or, perpendicular};

/// Tangent of every vertex, xyz and handedness w = +-1: unit, perpendicular to the normal, along growing u; normal cross
/// tangent times w points along growing v (upwards in the picture).
/// All lists run over the vertices. Triangles are weighted by area; without a usable UV any perpendicular serves.
/// Source: E. Lengyel, "Foundations of Game Engine Development 2: Rendering", 2019, section 7.5.
pub(super) fn tangents(points: &[Vec3], normals: &[Vec3], uvs: &[Vec2], triangles: &[[u32; 3]]) -> Vec<[f32; 4]> {
    let mut along_u = vec![Vec3::ZERO; points.len()];
    let mut along_v = vec![Vec3::ZERO; points.len()];
    for t in triangles {
        // The edges in space are e = du T + dv B; solving the two equations for T and B divides by the determinant d1 x d2, of
        // which only the sign matters, as both are normalised and then weighted by the area (twice it, for all alike).
        let [a, b, c] = t.map(|i| i as usize);
        let (e1, e2) = (points[b] - points[a], points[c] - points[a]);
        let (d1, d2) = (uvs[b] - uvs[a], uvs[c] - uvs[a]);
        let side = if d1.perp_dot(d2) < 0.0 { -1.0 } else { 1.0 };
        let area = e1.cross(e2).length();
        let u = normalize_or((e1 * d2.y - e2 * d1.y) * side, Vec3::ZERO) * area;
        let v = normalize_or((e2 * d1.x - e1 * d2.x) * side, Vec3::ZERO) * area;
        for i in [a, b, c] {
            along_u[i] += u;
            along_v[i] += v;
        }
    }
    // Gram-Schmidt against the normal; the handedness is -1 for mirrored texture coordinates.
    let tangent = |((n, u), v): ((&Vec3, &Vec3), &Vec3)| {
        let t = normalize_or(*u - *n * n.dot(*u), perpendicular(*n));
        let w = if n.cross(t).dot(*v) < 0.0 { -1.0 } else { 1.0 };
        [t.x, t.y, t.z, w]
    };
    normals.iter().zip(&along_u).zip(&along_v).map(tangent).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_follow_u_and_tell_mirrored_pictures_apart() {
        let points = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let normals = [Vec3::Z; 3];
        let plain = [Vec2::ZERO, Vec2::X, Vec2::Y];
        let first = |uvs: &[Vec2]| glam::Vec4::from(tangents(&points, &normals, uvs, &[[0, 1, 2]])[0]);
        let near = |a: glam::Vec4, x, y, w| (a - glam::Vec4::new(x, y, 0.0, w)).length() < 1e-6;
        assert!(near(first(&plain), 1.0, 0.0, 1.0));
        assert!(near(first(&plain.map(|v| Vec2::new(-v.x, v.y))), -1.0, 0.0, -1.0));
        assert!(near(first(&plain.map(|v| Vec2::new(v.y, -v.x))), 0.0, 1.0, 1.0));
    }

    #[test]
    fn a_collapsed_picture_still_gets_unit_tangents() {
        let list = tangents(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[Vec3::Z; 3], &[Vec2::ONE; 3], &[[0, 1, 2]]);
        for [x, y, z, w] in list {
            assert!((Vec3::new(x, y, z).length() - 1.0).abs() < 1e-6 && z.abs() < 1e-6 && w.abs() > 0.5);
        }
    }
}
