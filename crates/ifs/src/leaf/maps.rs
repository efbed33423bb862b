//! Fields of a leaf for every pixel: height, normals, colour.

use super::LeafRaster;
use osier_base::math::{exp_f32, lerp};
use osier_base::par::{par_chunks, par_map};

/// Colours of the parts of a leaf, between which [`fields`] blends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafColors {
    /// Linear RGB far from the margin.
    pub centre: [f32; 3],
    /// Linear RGB at the margin.
    pub edge: [f32; 3],
    /// Linear RGB that the blade tends to at the tip.
    pub tip: [f32; 3],
    /// Linear RGB of veins.
    pub vein: [f32; 3],
}

impl Default for LeafColors {
    fn default() -> Self {
        Self {
            centre: [0.050, 0.195, 0.023],
            edge: [0.156, 0.352, 0.052],
            tip: [0.366, 0.434, 0.069],
            vein: [0.485, 0.571, 0.202],
        }
    }
}

/// A leaf's fields, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafFields {
    /// Relief, 0 (outside, low) to 1.
    pub height: Vec<f32>,
    /// Linear RGB and coverage 0..1; pixels outside have the colour of the nearest one of the leaf.
    pub color: Vec<[f32; 4]>,
    /// 0 smooth .. 1 matt.
    pub rough: Vec<f32>,
}

/// Relief and colours of a raster.
/// Source: [wang-hao] 3.2.2: the leaf drawn by an iterated function system at the terminals of a plant.
/// Differs: the paper paints points; here they are one asset of maps. `Own:` veins are the cheapest ways from the lobes
/// to the anchor. `vein_share`: weight of the ridges of the density, which are drawn as veins and as relief, 0 to 1.
pub fn fields(raster: &LeafRaster, colors: &LeafColors, vein_share: f32) -> LeafFields {
    let n = raster.mask.side;
    let side = size(n);
    // Veins show as ridges of the density: the difference of a narrow and a wide blur.
    let fine = blurred(&log_density(&raster.hits), n, 2.0 * side / 1024.0);
    let wide = blurred(&fine, n, 12.0 * side / 1024.0);
    // Blur by at least a pixel; otherwise small maps would show stair steps.
    let rib = blurred(&raster.vein, n, (1.2 * side / 1024.0).max(1.0));
    let margin = blurred(&raster.sd, n, (side / 1024.0).max(0.8));
    let rows: Vec<usize> = (0..n).collect();
    let painted = par_map(&rows, |&y| {
        let one = |i: usize| {
            let f = PixelFields { side, margin: margin[i], fine: fine[i], wide: wide[i], rib: rib[i], vein_share };
            paint(raster, colors, i, &f)
        };
        (y * n..(y + 1) * n).map(one).collect()
    });
    let all: Vec<PaintedPixel> = painted.into_iter().flat_map(|r: Vec<_>| r).collect();
    // Round the relief off where hits leave single dots.
    let height = blurred(&all.iter().map(|p| p.height).collect::<Vec<f32>>(), n, 1.5 * side / 1024.0);
    LeafFields { height, color: all.iter().map(|p| p.color).collect(), rough: all.iter().map(|p| p.rough).collect() }
}

#[allow(clippy::cast_precision_loss, reason = "pixels")]
fn size(n: usize) -> f32 {
    n as f32
}

/// ln(1 + hits) divided by its value at the 99 % quantile of the pixels that were hit, at most 1.
fn log_density(hits: &[u32]) -> Vec<f32> {
    let mut full: Vec<u32> = hits.iter().copied().filter(|h| *h > 0).collect();
    let at = full.len().saturating_sub(1) * 99 / 100;
    let white = if full.is_empty() { 1 } else { *full.select_nth_unstable(at).1 };
    let top = osier_base::math::ln(1.0 + f64::from(white)).max(1e-9);
    let one = |h: &u32| osier_base::math::narrow(osier_base::math::ln(1.0 + f64::from(*h)) / top).clamp(0.0, 1.0);
    par_chunks(hits, osier_base::par::CHUNK, |_, c| c.iter().map(one).collect::<Vec<f32>>()).concat()
}

/// Blurred fields at one pixel.
struct PixelFields {
    /// Side of the map, pixels.
    side: f32,
    /// Signed distance to the margin, pixels, blurred by about a pixel.
    margin: f32,
    /// Logarithmic density of hits, 0..1, blurred narrowly and widely: their difference shows veins.
    fine: f32,
    wide: f32,
    /// Cover of traced veins, 0..1.
    rib: f32,
    /// Strength of the veins that show in the density of hits, 0..1.
    vein_share: f32,
}

/// Colour and coverage, relief and roughness of one pixel.
struct PaintedPixel {
    color: [f32; 4],
    height: f32,
    rough: f32,
}

/// Paints the pixel `i`: the edge's colour turns into the centre's away from the margin, veins are lighter and sunk.
fn paint(r: &LeafRaster, c: &LeafColors, i: usize, f: &PixelFields) -> PaintedPixel {
    let PixelFields { side, margin, fine, wide, rib, vein_share: share } = *f;
    // Outside, the colour is that of the leaf's nearest pixel, so that texture filtering shows no fringe.
    let inner = if r.mask.set[i] { i } else { r.nearest.get(i).copied().unwrap_or(0) as usize };
    let sd = r.sd[i];
    let depth = r.sd.get(inner).copied().unwrap_or(0.0).max(0.0);
    let u = r.along.get(inner).copied().unwrap_or(0.0);
    // Colour from the margin to the centre with a decay length of 6 % of the side.
    let rise = 1.0 - exp_f32(-depth / (0.06 * side));
    let mix = |a: [f32; 3], b: [f32; 3], t: f32| -> [f32; 3] { std::array::from_fn(|k| lerp(a[k], b[k], t)) };
    let mut rgb = mix(c.edge, c.centre, rise);
    rgb = mix(rgb, c.tip, 0.35 * u * u);
    rgb = mix(rgb, c.vein, 0.5 * ((fine - wide) / 0.2).clamp(0.0, 1.0) * share.min(1.0));
    rgb = mix(rgb, c.vein, 0.62 * rib);
    // Parts made by different maps differ slightly in brightness.
    let shade = match r.letter.get(inner).copied().unwrap_or(0) % 4 {
        0 => 1.0,
        1 => 1.06,
        2 => 0.94,
        _ => 1.03,
    };
    // Distances between whole pixels would give stair steps; coverage from the blurred distance is one half on the
    // margin.
    let alpha = (0.5 + margin).clamp(0.0, 1.0);
    // The blade bulges from the margin inwards with a decay length of 4 % of the side.
    let dome = if sd > 0.0 { 1.0 - exp_f32(-sd / (0.04 * side)) } else { 0.0 };
    // Veins are sunk on the upper side; thin hits ripple the blade between them.
    let height = if sd > 0.0 { (0.75 * dome + 0.25 * share * wide - 0.22 * rib).clamp(0.0, 1.0) } else { 0.0 };
    let rough = (0.42 + 0.12 * rib + 0.1 * (1.0 - rise)).clamp(0.0, 1.0);
    PaintedPixel { color: [rgb[0] * shade, rgb[1] * shade, rgb[2] * shade, alpha], height, rough }
}

/// Tangent-space normals of a relief as bytes, (n + 1) / 2: normalise(-k dh/dx, -k dh/dy, 1) with y up and
/// k = 0.03 side; (0, 0, 1) outside.
pub fn normals(height: &[f32], set: &[bool], n: usize) -> Vec<u8> {
    let k = 0.03 * size(n);
    let at = |x: usize, y: usize| height[y.min(n - 1) * n + x.min(n - 1)];
    let rows: Vec<usize> = (0..n).collect();
    let row = |y: &usize| {
        let mut out = Vec::with_capacity(n * 3);
        for x in 0..n {
            // Central differences; one-sided at the border, where the neighbour repeats.
            let dx = (at(x + 1, *y) - at(x.saturating_sub(1), *y)) * 0.5;
            let dy = (at(x, y.saturating_sub(1)) - at(x, y + 1)) * 0.5;
            let v = if set[y * n + x] { glam::Vec3::new(-k * dx, -k * dy, 1.0).normalize() } else { glam::Vec3::Z };
            out.extend(((v + glam::Vec3::ONE) * 0.5).to_array().map(osier_base::units::byte));
        }
        out
    };
    par_map(&rows, row).concat()
}

/// Three box blurs, together nearly a Gaussian of standard deviation `sigma` pixels; edges repeat.
pub fn blurred(field: &[f32], n: usize, sigma: f32) -> Vec<f32> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few pixels")]
    let radius = (sigma.max(0.0) + 0.35) as usize;
    if radius == 0 {
        return field.to_vec();
    }
    let mut out = field.to_vec();
    for _ in 0..3 {
        out = transposed(&box_rows(&out, n, radius), n);
        out = transposed(&box_rows(&out, n, radius), n);
    }
    out
}

fn box_rows(field: &[f32], n: usize, radius: usize) -> Vec<f32> {
    let share = 1.0 / size(2 * radius + 1);
    par_chunks(field, n, |_, row| {
        let at = |i: usize| row[i.saturating_sub(radius).min(n - 1)];
        // Running sum in double precision: one addition and one subtraction a pixel whatever the radius.
        let mut sum = (0..=2 * radius).fold(0.0_f64, |s, i| s + f64::from(at(i)));
        let mut out = Vec::with_capacity(n);
        for x in 0..n {
            out.push(osier_base::math::narrow(sum) * share);
            sum += f64::from(at(x + 2 * radius + 1)) - f64::from(at(x));
        }
        out
    })
    .concat()
}

fn transposed(field: &[f32], n: usize) -> Vec<f32> {
    let mut out = vec![0.0; field.len()];
    for y in (0..n).step_by(32) {
        for x in 0..n {
            // Blocks of 32 rows keep both sides of the transposition in the cache.
            for v in y..(y + 32).min(n) {
                out[x * n + v] = field[v * n + x];
            }
        }
    }
    out
}
