//! Pictures of things that are seen along an axis, for the quads that stand for them far away.

use glam::Vec3;

use osier_base::math::{self, narrow};
use osier_base::units::{byte, srgb_byte};
use osier_scene::{Image, ImageKind, Maps, Pixels};

/// A view along the normal of a quad: right, up, towards the viewer.
pub(super) type View = [Vec3; 3];

/// From the front, from the side, from above.
pub(super) const VIEWS: [View; 3] =
    [[Vec3::X, Vec3::Y, Vec3::Z], [Vec3::NEG_Z, Vec3::Y, Vec3::X], [Vec3::X, Vec3::NEG_Z, Vec3::Y]];

/// What a sample shows: how near to the viewer, m; colour; which way it faces in the view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) depth: f32,
    pub(super) color: Vec3,
    pub(super) normal: Vec3,
}

/// What a pixel shows: the share that is covered, colour and normal of that.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Texel {
    pub(super) alpha: f32,
    pub(super) color: Vec3,
    pub(super) normal: Vec3,
}

/// Pixels of a square of samples, rows from the top. `side`: samples along a side, `part` of them to a pixel; `color`: of a
/// pixel, from the sum of its samples' and their number.
pub(super) fn texels(
    samples: &[Option<Sample>],
    (side, part): (usize, usize),
    color: impl Fn(Vec3, f32) -> Vec3,
) -> Vec<Texel> {
    let pixels = side / part;
    let one = |i: usize| {
        let (x, y) = (i % pixels * part, i / pixels * part);
        let (mut t, mut count) = (Texel::default(), 0.0_f32);
        for s in (y..y + part).flat_map(|row| &samples[row * side + x..][..part]).flatten() {
            (t.color, t.normal, count) = (t.color + s.color, t.normal + s.normal, count + 1.0);
        }
        if count > 0.0 {
            t.color = color(t.color, count);
            t.normal = math::normalize_or(t.normal, Vec3::Z);
        }
        t.alpha = count / narrow((part * part) as f64);
        t
    };
    (0..pixels * pixels).map(one).collect()
}

/// The alpha above which as many pixels are kept as all of them cover. `part`: samples along a side of a pixel.
pub(super) fn cutoff(texels: &[Texel], part: usize) -> f32 {
    let mut alphas: Vec<f32> = texels.iter().map(|t| t.alpha).filter(|a| *a > 0.0).collect();
    alphas.sort_unstable_by(|a, b| b.total_cmp(a));
    let covered: f64 = alphas.iter().fold(0.0, |s, a| s + f64::from(*a));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of pixels")]
    let kept = covered.round() as usize;
    alphas.get(kept.saturating_sub(1)).map_or(0.5, |a| a - 0.5 / narrow((part * part) as f64))
}

/// Pixels as pictures of colour, straight in alpha, and of normals, and where a material finds them.
pub(super) fn pictures(texels: &[Texel], (name, side): (&str, u32)) -> (Vec<Image>, Maps) {
    let color = texels.iter().flat_map(|t| {
        let [r, g, b] = t.color.to_array().map(srgb_byte);
        [r, g, b, byte(t.alpha)]
    });
    let normal = texels.iter().flat_map(|t| ((t.normal + Vec3::ONE) * 0.5).to_array().map(byte));
    let image = |what: &str, kind, channels, pixels: Vec<u8>| Image {
        name: format!("{name}_{what}"),
        kind,
        width: side,
        height: side,
        channels,
        pixels: Pixels::U8(pixels),
    };
    let images = vec![
        image("color", ImageKind::Color, 4, color.collect()),
        image("normal", ImageKind::Data, 3, normal.collect()),
    ];
    (images, Maps { color: Some(0), normal: Some(1), ..Maps::default() })
}
