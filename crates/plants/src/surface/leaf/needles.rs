//! Needles of conifers: a piece of shoot with needles all round, which is scaled to the internodes that still bear them.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use osier_base::math::{GOLDEN_ANGLE_F32, cos_f32, normalize_or, perpendicular, sin_f32};
use osier_base::rng::Rng;
use osier_base::{Error, Result};
use osier_scene::Mesh;

/// Standard deviation of a needle's angle to the shoot, rad, and of its length as a share of the mean.
const ANGLE_DEVIATION: f32 = 0.17;
const LENGTH_DEVIATION: f32 = 0.12;
/// Width of the tip of a needle, as a share of its width in the middle.
const TIP_WIDTH: f32 = 0.25;

/// A piece of shoot with its needles. Lengths in m, angles in rad.
#[derive(Debug, Clone, PartialEq)]
pub struct NeedleSpec {
    /// Length of the piece, 0.005..2 m.
    pub length: f32,
    /// Number of needles, 2..1000.
    pub count: u32,
    /// Length of a needle, 0.001..1 m.
    pub needle: f32,
    /// Width of a needle, 0.0002..0.02 m.
    pub width: f32,
    /// Angle between shoot and needles, 0.1..1.6 rad.
    pub angle: f32,
    /// Seed of the irregularities.
    pub seed: u64,
}

/// The mesh of one variant: the shoot runs from the origin along +Y, +Z is its upper side. A needle is a strip of two quads that
/// tapers to its tip; needles spread towards the tip of the shoot. Own.
/// # Errors
/// `Range` for a value outside its range.
pub fn needle_shoot(spec: &NeedleSpec, variant: u64) -> Result<Mesh> {
    let ranges = [
        ("length", spec.length, 0.005, 2.0, "m"),
        ("count", spec.count as f32, 2.0, 1000.0, ""),
        ("needle", spec.needle, 0.001, 1.0, "m"),
        ("width", spec.width, 0.0002, 0.02, "m"),
        ("angle", spec.angle, 0.1, 1.6, "rad"),
    ];
    for (name, value, min, max, unit) in ranges {
        if !(min..=max).contains(&value) {
            let name = format!("needles: {name}");
            return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit });
        }
    }
    let mut draws = Rng::at(spec.seed, &["needles".into(), variant.into()]);
    let mut deviate = |deviation: f32| deviation * osier_base::math::narrow(draws.normal().clamp(-2.0, 2.0));
    let mut mesh = Mesh::default();
    for i in 0..spec.count {
        let along = (i as f32 + 0.5) / spec.count as f32;
        let azimuth = i as f32 * GOLDEN_ANGLE_F32;
        let side = Vec3::new(cos_f32(azimuth), 0.0, sin_f32(azimuth));
        // The last needles close over the tip.
        let angle = (spec.angle * (1.0 - 0.5 * along * along) + deviate(ANGLE_DEVIATION)).max(0.05);
        let direction = Vec3::Y * cos_f32(angle) + side * sin_f32(angle);
        let length = spec.needle * (1.0 + deviate(LENGTH_DEVIATION));
        let from = Vec3::Y * (along * spec.length);
        push_needle(&mut mesh, from, direction * length, spec.width, azimuth % TAU);
    }
    mesh.subsets.push(osier_scene::Subset { material: 0, first: 0, count: 4 * spec.count });
    Ok(mesh)
}

/// Appends a needle from `from` by `way`, m, as three rows of two points. `roll`: of its flat side about it, rad.
fn push_needle(mesh: &mut Mesh, from: Vec3, way: Vec3, width: f32, roll: f32) {
    let direction = normalize_or(way, Vec3::Y);
    let across = perpendicular(direction);
    let across = across * cos_f32(roll) + direction.cross(across) * sin_f32(roll);
    let normal = across.cross(direction);
    let Ok(first) = u32::try_from(mesh.points.len()) else { return };
    for (t, share) in [(0.0, 0.7), (0.5, 1.0), (1.0, TIP_WIDTH)] {
        for edge in [-0.5, 0.5_f32] {
            mesh.points.push(from + way * t + across * (edge * share * width));
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(edge + 0.5, t));
        }
    }
    for row in [first, first + 2] {
        mesh.triangles.extend([[row, row + 1, row + 3], [row, row + 3, row + 2]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needles_surround_the_shoot_and_face_their_normals() {
        let spec = NeedleSpec { length: 0.1, count: 40, needle: 0.02, width: 0.0015, angle: 0.9, seed: 3 };
        let mesh = needle_shoot(&spec, 1).expect("in range");
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (240, 160));
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            let normal = (b - a).cross(c - a);
            assert!(normal.length() > 1e-9 && normal.dot(mesh.normals[t[0] as usize]) > 0.0);
        }
        let middle: Vec3 = mesh.points.iter().copied().sum::<Vec3>() / 240.0;
        assert!(middle.x.abs() < 0.002 && middle.z.abs() < 0.002 && mesh.bounds().size().x > 0.02);
        assert_ne!(mesh.points, needle_shoot(&spec, 2).expect("in range").points);
        assert!(needle_shoot(&NeedleSpec { count: 1, ..spec }, 0).is_err());
    }
}
