//! Images of objects seen along an axis, for the textured quads (billboards) that replace them at a distance.

use glam::Vec3;

use osier_base::math::{self, narrow};
use osier_base::units::{byte, srgb_byte};
use osier_scene::{Image, ImageKind, Maps, Pixels};

/// A view along the normal of a quad: right, up, towards the viewer.
pub(super) type BillboardView = [Vec3; 3];

/// Views from the front (+Z), from the side (+X) and from above (+Y).
pub(super) const VIEWS: [BillboardView; 3] =
    [[Vec3::X, Vec3::Y, Vec3::Z], [Vec3::NEG_Z, Vec3::Y, Vec3::X], [Vec3::X, Vec3::NEG_Z, Vec3::Y]];

/// The surface that a sample of a view hits.
#[derive(Debug, Clone, Copy)]
pub(super) struct BillboardSample {
    /// Position along the direction to the viewer, m; larger is nearer.
    pub(super) depth: f32,
    /// Linear base colour, 0..1 per channel.
    pub(super) color: Vec3,
    /// Unit normal in the view: right, up, towards the viewer.
    pub(super) normal: Vec3,
}

/// A pixel: the share of its samples that are covered, and their mean colour and normal.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BillboardTexel {
    pub(super) alpha: f32,
    pub(super) color: Vec3,
    pub(super) normal: Vec3,
}

/// Filters a square of samples to pixels, rows from the top. `side`: samples along a side, `supersampling` of them per
/// pixel; `color`: computes the colour of a pixel from the sum of its samples' colours and their number.
pub(super) fn texels(
    samples: &[Option<BillboardSample>],
    side: usize,
    supersampling: usize,
    color: impl Fn(Vec3, f32) -> Vec3,
) -> Vec<BillboardTexel> {
    let pixels = side / supersampling;
    // Box filter: colour and normal are averaged over the covered samples, alpha is their share.
    let one = |i: usize| {
        let (x, y) = (i % pixels * supersampling, i / pixels * supersampling);
        let (mut t, mut count) = (BillboardTexel::default(), 0.0_f32);
        for s in (y..y + supersampling).flat_map(|row| &samples[row * side + x..][..supersampling]).flatten() {
            (t.color, t.normal, count) = (t.color + s.color, t.normal + s.normal, count + 1.0);
        }
        if count > 0.0 {
            t.color = color(t.color, count);
            t.normal = math::normalize_or(t.normal, Vec3::Z);
        }
        t.alpha = count / narrow((supersampling * supersampling) as f64);
        t
    };
    (0..pixels * pixels).map(one).collect()
}

/// The alpha cutoff for which the number of pixels above it equals the sum of all alphas, so that the silhouette keeps its area
/// (coverage-preserving alpha test); 0.5 for an empty picture. `supersampling`: samples along a side of a pixel.
pub(super) fn coverage_cutoff(texels: &[BillboardTexel], supersampling: usize) -> f32 {
    // The k-th largest alpha minus half a sample, where k is the sum of all alphas.
    let mut alphas: Vec<f32> = texels.iter().map(|t| t.alpha).filter(|a| *a > 0.0).collect();
    alphas.sort_unstable_by(|a, b| b.total_cmp(a));
    let covered: f64 = alphas.iter().fold(0.0, |s, a| s + f64::from(*a));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of pixels")]
    let kept = covered.round() as usize;
    alphas.get(kept.saturating_sub(1)).map_or(0.5, |a| a - 0.5 / narrow((supersampling * supersampling) as f64))
}

/// The colour image (straight alpha) and the normal image of a square of pixels, with the maps of a material that has these
/// two images.
pub(super) fn billboard_images(texels: &[BillboardTexel], name: &str, side: u32) -> (Vec<Image>, Maps) {
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
