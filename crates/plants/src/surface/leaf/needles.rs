//! Needles of conifers: a piece of shoot with its side twigs and needles all round, of which a tree bears as many as
//! its leaf area requires.

use std::f32::consts::TAU;

use glam::{Quat, Vec2, Vec3};

use osier_base::math::{GOLDEN_ANGLE_F32, cos_f32, normalize_or, perpendicular, rotation_about, sin_f32};
use osier_base::rng::Rng;
use osier_base::{Error, Result};
use osier_scene::{Mesh, Subset};

/// Standard deviation of a needle's angle to the shoot, rad, and of its length as a share of the mean.
const ANGLE_DEVIATION: f32 = 0.17;
const LENGTH_DEVIATION: f32 = 0.12;
/// Width of the tip of a needle, as a share of its width in the middle.
const TIP_WIDTH: f32 = 0.25;
/// Radius of the wood of a piece at its base, as a share of the length of a needle: needles hide all but its base.
const WOOD_RADIUS: f32 = 0.055;
/// Standard deviation of the direction of a side twig, rad.
const TWIG_DEVIATION: f32 = 0.2;
/// Where the first and the last side twig leave the shoot, as shares of its length.
const TWIGS_AT: [f32; 2] = [0.1, 0.85];
/// Length of the side twig nearest to the tip, as a share of that of the first.
const LAST_TWIG: f32 = 0.5;

/// A piece of shoot with its needles. Lengths in m, angles in rad.
#[derive(Debug, Clone, PartialEq)]
pub struct NeedleSpec {
    /// Length of the piece, 0.001..2 m.
    pub length: f32,
    /// Number of needles on the shoot and its twigs together, 2..4000.
    pub count: u32,
    /// Length of a needle, 1e-5..10 m.
    pub needle: f32,
    /// Width of a needle, 0.0002..0.02 m.
    pub width: f32,
    /// Angle between shoot and needles, 0.1..1.6 rad.
    pub angle: f32,
    /// Side twigs, alternately left and right, 0..24.
    pub twigs: u32,
    /// Length of the longest side twig, 1e-5..4 m.
    pub twig: f32,
    /// Angle between shoot and side twigs, 0.05..2.2 rad.
    pub twig_angle: f32,
    /// Whether a needle is a single triangle instead of four, for crowns.
    pub coarse: bool,
    /// Seed of the random angles and lengths of twigs and needles.
    pub seed: u64,
}

impl NeedleSpec {
    fn check(&self) -> Result<()> {
        let ranges = [
            ("length", self.length, 0.001, 2.0, "m"),
            ("count", self.count as f32, 2.0, 4000.0, ""),
            ("needle", self.needle, 1e-5, 10.0, "m"),
            ("width", self.width, 0.0002, 0.02, "m"),
            ("angle", self.angle, 0.1, 1.6, "rad"),
            ("twigs", self.twigs as f32, 0.0, 24.0, ""),
            ("twig", self.twig, 1e-5, 4.0, "m"),
            ("twig angle", self.twig_angle, 0.05, 2.2, "rad"),
        ];
        for (name, value, min, max, unit) in ranges {
            if !(min..=max).contains(&value) {
                let name = format!("needles: {name}");
                return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit });
            }
        }
        Ok(())
    }
}

/// The shoot or one of its side twigs, a straight line along which needles are spread.
struct Shoot {
    base: Vec3,
    /// Rotation of +Y to the direction of the shoot.
    turn: Quat,
    length: f32,
}

/// The mesh of one variant: the shoot runs from the origin along +Y, +Z is its upper side, its side twigs lie about the plane
/// of X and Y. Material 0: needles, strips that taper to their tips and spread towards the tip of the shoot. Material 1: the
/// wood of shoot and twigs. Own.
/// # Errors
/// `Range` for a value outside its range.
pub fn needle_shoot(spec: &NeedleSpec, variant: u64) -> Result<Mesh> {
    spec.check()?;
    let mut draws = Rng::at(spec.seed, &["needles".into(), variant.into()]);
    let mut deviate = |deviation: f32| deviation * osier_base::math::narrow(draws.normal().clamp(-2.0, 2.0));
    // The shoot itself, then its side twigs from the base on, the later ones shorter.
    let mut shoots = vec![Shoot { base: Vec3::ZERO, turn: Quat::IDENTITY, length: spec.length }];
    for k in 0..spec.twigs {
        let part = (k as f32 + 0.5) / spec.twigs as f32;
        let side = if k % 2 == 0 { -1.0 } else { 1.0 };
        let in_plane = side * spec.twig_angle + deviate(TWIG_DEVIATION);
        let turn = rotation_about(Vec3::X, deviate(TWIG_DEVIATION)) * rotation_about(Vec3::Z, in_plane);
        let at = TWIGS_AT[0] + (TWIGS_AT[1] - TWIGS_AT[0]) * part;
        let length = spec.twig * (1.0 + (LAST_TWIG - 1.0) * part) * (1.0 + deviate(LENGTH_DEVIATION));
        shoots.push(Shoot { base: Vec3::Y * (at * spec.length), turn: turn.normalize(), length });
    }
    // Needles are spread evenly over the length of all shoots.
    let total: f32 = shoots.iter().map(|s| s.length).sum();
    let mut mesh = Mesh::default();
    let mut planted = 0;
    let mut so_far = 0.0;
    for shoot in &shoots {
        so_far += shoot.length;
        let until = if so_far >= total * 0.999_99 { spec.count } else { share_of(spec.count, so_far / total) };
        let count = until.saturating_sub(planted);
        for i in 0..count {
            let along = (i as f32 + 0.5) / count as f32;
            let azimuth = (planted + i) as f32 * GOLDEN_ANGLE_F32;
            let side = Vec3::new(cos_f32(azimuth), 0.0, sin_f32(azimuth));
            // Needles lean towards the shoot near its end, so that the last ones cover the tip.
            let angle = (spec.angle * (1.0 - 0.5 * along * along) + deviate(ANGLE_DEVIATION)).max(0.05);
            let direction = shoot.turn * (Vec3::Y * cos_f32(angle) + side * sin_f32(angle));
            let length = spec.needle * (1.0 + deviate(LENGTH_DEVIATION));
            let from = shoot.base + shoot.turn * (Vec3::Y * (along * shoot.length));
            push_needle(&mut mesh, from, direction * length, spec, azimuth % TAU);
        }
        planted = until;
    }
    let needles = index_of(mesh.triangles.len());
    mesh.subsets.push(Subset { material: 0, first: 0, count: needles });
    for shoot in &shoots {
        push_wood(&mut mesh, shoot, WOOD_RADIUS * spec.needle);
    }
    mesh.subsets.push(Subset { material: 1, first: needles, count: index_of(mesh.triangles.len()) - needles });
    Ok(mesh)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the count, which is at most 4000")]
fn share_of(count: u32, share: f32) -> u32 {
    (count as f32 * share).round() as u32
}

#[allow(clippy::cast_possible_truncation, reason = "at most 4000 needles of four triangles")]
fn index_of(length: usize) -> u32 {
    length as u32
}

/// Appends a needle from `from` to `from + way`, m: three rows of two points, or a triangle. `roll`: rotation of its flat side
/// about its length, rad.
fn push_needle(mesh: &mut Mesh, from: Vec3, way: Vec3, spec: &NeedleSpec, roll: f32) {
    let direction = normalize_or(way, Vec3::Y);
    let across = perpendicular(direction);
    let across = across * cos_f32(roll) + direction.cross(across) * sin_f32(roll);
    let normal = across.cross(direction);
    let first = index_of(mesh.points.len());
    let mut push = |t: f32, edge: f32| {
        mesh.points.push(from + way * t + across * (edge * spec.width));
        mesh.normals.push(normal);
        mesh.uvs.push(Vec2::new(edge + 0.5, t));
    };
    if spec.coarse {
        for (t, edge) in [(0.0, -0.5), (0.0, 0.5), (1.0, 0.0)] {
            push(t, edge);
        }
        mesh.triangles.push([first, first + 1, first + 2]);
    } else {
        for (t, share) in [(0.0, 0.7), (0.5, 1.0), (1.0, TIP_WIDTH)] {
            push(t, -0.5 * share);
            push(t, 0.5 * share);
        }
        for row in [first, first + 2] {
            mesh.triangles.extend([[row, row + 1, row + 3], [row, row + 3, row + 2]]);
        }
    }
}

/// Appends the wood of a shoot: three sides that taper to a point.
fn push_wood(mesh: &mut Mesh, shoot: &Shoot, radius: f32) {
    let first = index_of(mesh.points.len());
    for (side, u) in [(0.0, 0.0), (1.0, 1.0 / 3.0), (2.0, 2.0 / 3.0_f32)] {
        let azimuth = side * (TAU / 3.0);
        let out = shoot.turn * Vec3::new(cos_f32(azimuth), 0.0, sin_f32(azimuth));
        mesh.points.push(shoot.base + out * radius);
        mesh.normals.push(out);
        mesh.uvs.push(Vec2::new(u, 0.0));
    }
    mesh.points.push(shoot.base + shoot.turn * (Vec3::Y * shoot.length));
    mesh.normals.push(shoot.turn * Vec3::Y);
    mesh.uvs.push(Vec2::new(0.5, 1.0));
    for side in 0..3 {
        mesh.triangles.push([first + side, first + 3, first + (side + 1) % 3]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEC: NeedleSpec = NeedleSpec {
        length: 0.1,
        count: 40,
        needle: 0.02,
        width: 0.0015,
        angle: 0.9,
        twigs: 0,
        twig: 0.06,
        twig_angle: 0.9,
        coarse: false,
        seed: 3,
    };

    #[test]
    fn needles_surround_the_shoot_and_face_their_normals() {
        for (spec, points, triangles) in [
            (SPEC, 240, 160),
            (NeedleSpec { coarse: true, ..SPEC }, 120, 40),
            (NeedleSpec { twigs: 4, coarse: true, ..SPEC }, 120, 40),
        ] {
            let mesh = needle_shoot(&spec, 1).expect("in range");
            let shoots = spec.twigs as usize + 1;
            assert_eq!((mesh.points.len(), mesh.triangles.len()), (points + 4 * shoots, triangles + 3 * shoots));
            assert_eq!(mesh.subsets.iter().map(|s| s.count as usize).sum::<usize>(), mesh.triangles.len());
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|i| mesh.points[i as usize]);
                let normal = (b - a).cross(c - a);
                assert!(normal.length() > 1e-9 && normal.dot(mesh.normals[t[0] as usize]) > 0.0);
            }
            let middle: Vec3 = mesh.points.iter().copied().sum::<Vec3>() / mesh.points.len() as f32;
            assert!(middle.x.abs() < 0.004 && middle.z.abs() < 0.004 && mesh.bounds().size().x > 0.02);
            assert_ne!(mesh.points, needle_shoot(&spec, 2).expect("in range").points);
        }
        assert!(needle_shoot(&NeedleSpec { count: 1, ..SPEC }, 0).is_err());
    }

    #[test]
    fn twigs_widen_the_piece_and_share_its_needles() {
        let plain = needle_shoot(&SPEC, 0).expect("in range").bounds().size();
        let bushy = needle_shoot(&NeedleSpec { twigs: 6, ..SPEC }, 0).expect("in range").bounds().size();
        assert!(bushy.x > 2.0 * plain.x, "{plain} {bushy}");
        assert!(bushy.z < 2.0 * plain.z, "about one plane: {plain} {bushy}");
    }
}
