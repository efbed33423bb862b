//! Turns counts into pictures: density estimation, logarithmic tone mapping, colours.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_base::progress::Cancel;
//! use osier_ifs::cloud::DrawRequest;
//! use osier_ifs::game::{InstructionSet, extent};
//! use osier_ifs::histogram::{PictureWindow, histogram};
//! use osier_ifs::picture::{ToneMapping, density, tone_mapped};
//! use osier_ifs::{dynamics::study, read::read, weights::WeightRule};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let system = &systems[0];
//! let study = study(system, WeightRule::File);
//! let (low, high) = extent(system, &study).expect("an attractor").bounds;
//! let window = PictureWindow::fitted(low, high, 64, 64);
//! let request = DrawRequest { system, study: &study, seed: 1, points: 100_000, tier: InstructionSet::Best };
//! let counts = histogram(&request, None, &window);
//! let density = density(&counts, 2, None, &Cancel::default())?;
//! // RGBA of 32 x 32 pixels, each of 2 x 2 cells.
//! assert_eq!(tone_mapped(&density, &ToneMapping::default(), [0.1, 0.4, 0.1]).len(), 32 * 32 * 4);
//! # Ok::<(), osier_base::Error>(())
//! ```

use super::histogram::Histogram;
use osier_base::Result;
use osier_base::math::{self, narrow};
use osier_base::par::par_map;
use osier_base::progress::Cancel;
use osier_base::units::srgb_from_linear;

/// Quantile of the density over the non-empty pixels that is drawn fully opaque.
const WHITE_QUANTILE: f64 = 0.995;

/// Spreads thin hits over discs of max(minimum, radius / hits^curve) pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DensityEstimator {
    /// Radius of the disc of a single hit, pixels; 0 is off.
    pub radius: f64,
    /// Radius below which no disc shrinks, however many hits its pixel has, pixels.
    pub minimum: f64,
    /// Exponent by which discs shrink with hits; 0: all have `radius`.
    pub curve: f64,
}

/// How the density of points becomes opacity, and what lies behind the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToneMapping {
    /// g of alpha = ln(1 + g D) / ln(1 + g D99.5).
    pub exposure: f64,
    /// Exponent of the opacity; below 1 brightens thin parts.
    pub gamma: f64,
    /// Linear RGB, or none: the picture is transparent.
    pub background: Option<[f32; 3]>,
}

impl Default for ToneMapping {
    fn default() -> Self {
        Self { exposure: 16.0, gamma: 0.6, background: None }
    }
}

/// Density and mean colour per pixel, linear, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Density {
    /// Pixels per row of `value` and `color`.
    pub width: usize,
    /// Number of rows of `value` and `color`.
    pub height: usize,
    /// hits W H / N: 1 on average when nothing lies outside.
    pub value: Vec<f32>,
    /// Mean linear RGB of a pixel's points, or empty.
    pub color: Vec<[f32; 3]>,
}

/// Hits and colour sums of one pixel in floating point: hits, red, green, blue.
type PixelSums = [f64; 4];

/// Density of counts made at `oversample` times the size, thin places spread by the estimator.
/// Source: S. Draves, E. Reckase, "The fractal flame algorithm", 2003: adaptive density estimation.
/// Differs: hits are spread evenly over a disc.
/// # Errors
/// `Cancelled` at a request during the spreading.
#[allow(clippy::cast_precision_loss, reason = "counts below 2^53")]
pub fn density(
    h: &Histogram,
    oversample: usize,
    estimator: Option<DensityEstimator>,
    cancel: &Cancel,
) -> Result<Density> {
    let k = oversample.max(1);
    let (width, height) = (h.width / k, h.height / k);
    let rows: Vec<usize> = (0..height).collect();
    // Down-sample by exact sums of k x k cells before the estimator spreads them.
    let boxed = par_map(&rows, |y| (0..width).map(|x| box_sums(h, k, x, *y)).collect::<Vec<PixelSums>>());
    let mut samples: Vec<PixelSums> = boxed.into_iter().flatten().collect();
    if let Some(e) = estimator.filter(|e| e.radius > 0.0) {
        samples = spread_hits(&samples, width, height, &e, cancel)?;
    }
    let all = h.points as f64 * h.unit as f64;
    // Density relative to an even spread over the picture: D = hits W H / N.
    let scale = (width * height) as f64 / all.max(1.0);
    let colored = !h.sums.is_empty();
    let color = |s: &PixelSums| std::array::from_fn(|c| narrow(s[c + 1] / (s[0].max(1e-300) * 4095.0)));
    Ok(Density {
        width,
        height,
        value: samples.iter().map(|s| narrow(s[0] * scale)).collect(),
        color: if colored { samples.iter().map(color).collect() } else { Vec::new() },
    })
}

#[allow(clippy::cast_precision_loss, reason = "counts below 2^53")]
/// Sums of the k x k cells of one pixel.
fn box_sums(h: &Histogram, k: usize, x: usize, y: usize) -> PixelSums {
    let mut sums = [0_u64; 4];
    for row in y * k..(y + 1) * k {
        for i in row * h.width + x * k..row * h.width + (x + 1) * k {
            sums[0] += h.hits.get(i).copied().unwrap_or(0);
            if let Some(s) = h.sums.get(i) {
                for (a, b) in sums.iter_mut().skip(1).zip(s) {
                    *a += b;
                }
            }
        }
    }
    sums.map(|v| v as f64)
}

/// Each pixel's sample spread evenly over a disc around it.
/// # Errors
/// `Cancelled`.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "offsets of a few pixels inside the picture"
)]
fn spread_hits(
    samples: &[PixelSums],
    width: usize,
    height: usize,
    e: &DensityEstimator,
    cancel: &Cancel,
) -> Result<Vec<PixelSums>> {
    let radius = |hits: f64| (e.radius / math::pow(hits.max(1.0), e.curve)).max(e.minimum);
    let reach = e.radius.ceil() as isize;
    // Discs of all radii in steps of a quarter pixel, as lists of offsets.
    let discs: Vec<Vec<(isize, isize)>> = (0..=reach * 4)
        .map(|quarter| {
            let r = quarter as f64 * 0.25;
            let inside = |(dx, dy): &(isize, isize)| ((dx * dx + dy * dy) as f64) <= r * r;
            (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))).filter(inside).collect()
        })
        .collect();
    let mut out = vec![[0.0; 4]; samples.len()];
    // A row of a large picture takes tenths of a second.
    for (y, row) in samples.chunks(width.max(1)).enumerate() {
        cancel.check()?;
        for (x, s) in row.iter().enumerate().filter(|(_, s)| s[0] > 0.0) {
            // Dense pixels keep their hits; thin ones spread over max(minimum, radius / hits^curve) pixels.
            let quarter = (radius(s[0]) * 4.0 + 0.5) as usize;
            let Some(disc) = discs.get(quarter.min(discs.len() - 1)) else { continue };
            let (x, y) = (x as isize, y as isize);
            let near = |(dx, dy): &(isize, isize)| {
                let (u, v) = (x + dx, y + dy);
                (u >= 0 && v >= 0 && u < width as isize && v < height as isize)
                    .then_some(v as usize * width + u as usize)
            };
            // Hits near the border stay inside: their share is taken by the part of the disc that is there.
            let inside: Vec<usize> = disc.iter().filter_map(near).collect();
            let share = 1.0 / inside.len().max(1) as f64;
            for j in inside {
                for (a, b) in out[j].iter_mut().zip(s) {
                    *a += b * share;
                }
            }
        }
    }
    Ok(out)
}

/// Opacity per pixel: clamp(ln(1 + g D) / ln(1 + g D99.5), 0, 1)^gamma with the 99.5 % quantile over non-empty pixels.
/// Source: S. Draves, E. Reckase, "The fractal flame algorithm", 2003: logarithmic density.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a place in a list"
)]
pub fn opacity(d: &Density, tone: &ToneMapping) -> Vec<f32> {
    let mut full: Vec<f32> = d.value.iter().copied().filter(|v| *v > 0.0).collect();
    if full.is_empty() {
        return vec![0.0; d.value.len()];
    }
    let at = ((full.len() - 1) as f64 * WHITE_QUANTILE) as usize;
    // A selection suffices: of all values only this quantile is needed.
    let white = f64::from(*full.select_nth_unstable_by(at, f32::total_cmp).1);
    let top = math::ln(1.0 + tone.exposure * white).max(1e-12);
    let one = |v: &f32| {
        let share = (math::ln(1.0 + tone.exposure * f64::from(*v)) / top).clamp(0.0, 1.0);
        if share > 0.0 { narrow(math::pow(share, tone.gamma)) } else { 0.0 }
    };
    osier_base::par::par_chunks(&d.value, osier_base::par::CHUNK, |_, c| c.iter().map(one).collect::<Vec<f32>>())
        .concat()
}

/// RGB over the background, or RGBA without one, sRGB in 0..1, rows from the top. `flat`: linear RGB where `d` has no colours.
pub fn tone_mapped(d: &Density, tone: &ToneMapping, flat: [f32; 3]) -> Vec<f32> {
    let alpha = opacity(d, tone);
    let mut out = Vec::with_capacity(alpha.len() * 4);
    for (i, a) in alpha.iter().enumerate() {
        let c = d.color.get(i).copied().unwrap_or(flat);
        match tone.background {
            // Laid over in sRGB, as programs lay the transparent picture over a page.
            Some(b) => out.extend((0..3).map(|k| math::lerp(srgb_from_linear(b[k]), srgb_from_linear(c[k]), *a))),
            None => out.extend(c.map(srgb_from_linear).into_iter().chain([*a])),
        }
    }
    out
}
