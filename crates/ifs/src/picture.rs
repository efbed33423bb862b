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
use osier_base::par::{par_map, par_map_mut};
use osier_base::progress::Cancel;
use osier_base::units::srgb_from_linear;

/// Quantile of the density over the non-empty pixels that is drawn fully opaque.
const WHITE_QUANTILE: f64 = 0.995;

/// Least number of rows of a picture whose hits one task spreads.
const MIN_BAND: usize = 32;

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
    /// Factor g on the density D in alpha = ln(1 + g D) / ln(1 + g D99.5).
    pub exposure: f64,
    /// Exponent of the opacity; below 1 brightens thin parts.
    pub gamma: f64,
    /// Linear RGB of the background; `None`: the picture is transparent.
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
    /// Density D = hits W H / N for N points on W x H pixels: 1 on average if no point lies outside.
    pub value: Vec<f32>,
    /// Mean linear RGB of a pixel's points, or empty.
    pub color: Vec<[f32; 3]>,
}

/// Hits and colour sums of one pixel in floating point: hits, red, green, blue.
type PixelSums = [f64; 4];

/// Density of a histogram that was counted at `oversample` times the size; the estimator spreads the hits of thin
/// places.
/// Source: S. Draves, E. Reckase, "The fractal flame algorithm", 2003: adaptive density estimation.
/// Differs: hits are spread evenly over a disc.
/// # Errors
/// `Cancelled` if cancelling is requested while hits are spread.
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

/// One row of a disc: its offset from the centre and its half width, pixels.
type DiscRow = (isize, usize);

/// Rows of a disc of the given radius in pixels, at most `reach`.
fn disc_rows(radius: f64, reach: usize) -> Vec<DiscRow> {
    let is_inside = |dx: usize, dy: usize| ((dx * dx + dy * dy) as f64) <= radius * radius;
    let half_width = |dy: isize| (0..=reach).rev().find(|dx| is_inside(*dx, dy.unsigned_abs()));
    let offsets = -reach.cast_signed()..=reach.cast_signed();
    offsets.filter_map(|dy| Some((dy, half_width(dy)?))).collect()
}

/// Spreads each pixel's sample evenly over a disc around it. Bands of rows run in parallel; each pixel sums the samples
/// around it in the order of rows, so that its sum does not depend on the bands.
/// # Errors
/// `Cancelled`.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a radius of a few pixels")]
fn spread_hits(
    samples: &[PixelSums],
    width: usize,
    height: usize,
    e: &DensityEstimator,
    cancel: &Cancel,
) -> Result<Vec<PixelSums>> {
    let radius = |hits: f64| (e.radius / math::pow(hits.max(1.0), e.curve)).max(e.minimum);
    let reach = e.radius.ceil() as usize;
    // Discs of all radii in steps of a quarter pixel.
    let discs: Vec<Vec<DiscRow>> = (0..=reach * 4).map(|quarter| disc_rows(quarter as f64 * 0.25, reach)).collect();
    let mut out = vec![[0.0; 4]; samples.len()];
    // A band also visits the rows up to `reach` above and below it. It is at least as high as these together, so that
    // they cost no more than its own rows.
    let band = MIN_BAND.max(2 * reach);
    let mut bands: Vec<(usize, &mut [PixelSums])> =
        (0..height).step_by(band).zip(out.chunks_mut(band * width.max(1))).collect();
    let spread_band = |first: usize, out: &mut [PixelSums]| -> Result<()> {
        let last = (first + band).min(height);
        for y in first.saturating_sub(reach)..(last + reach).min(height) {
            // A row of a large picture takes tenths of a second.
            cancel.check()?;
            let row = samples.get(y * width..(y + 1) * width).unwrap_or_default();
            for (x, s) in row.iter().enumerate().filter(|(_, s)| s[0] > 0.0) {
                // Dense pixels keep their hits; thin ones spread over max(minimum, radius / hits^curve) pixels.
                let quarter = (radius(s[0]) * 4.0 + 0.5) as usize;
                let Some(disc) = discs.get(quarter.min(discs.len() - 1)) else { continue };
                // Near the border, hits are spread over the part of the disc that lies inside the picture, so that none
                // is lost.
                let rows = disc.iter().filter_map(|(dy, half)| {
                    let v = y.checked_add_signed(*dy).filter(|v| *v < height)?;
                    Some((v, x.saturating_sub(*half), (x + half).min(width - 1)))
                });
                let inside: usize = rows.clone().map(|(_, low, high)| high - low + 1).sum();
                let share = 1.0 / inside.max(1) as f64;
                for (v, low, high) in rows.filter(|(v, ..)| (first..last).contains(v)) {
                    let start = (v - first) * width;
                    for sums in &mut out[start + low..=start + high] {
                        sums.iter_mut().zip(s).for_each(|(a, b)| *a += b * share);
                    }
                }
            }
        }
        Ok(())
    };
    par_map_mut(&mut bands, |(first, out)| spread_band(*first, out)).into_iter().collect::<Result<()>>()?;
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

/// The tone-mapped picture in sRGB, 0..1, rows from the top: RGB over the background, or RGBA without one. `flat`:
/// linear RGB where `d` has no colours.
pub fn tone_mapped(d: &Density, tone: &ToneMapping, flat: [f32; 3]) -> Vec<f32> {
    let alpha = opacity(d, tone);
    let mut out = Vec::with_capacity(alpha.len() * 4);
    for (i, a) in alpha.iter().enumerate() {
        let c = d.color.get(i).copied().unwrap_or(flat);
        match tone.background {
            // Composited in sRGB, as programs do that show the transparent picture on a page.
            Some(b) => out.extend((0..3).map(|k| math::lerp(srgb_from_linear(b[k]), srgb_from_linear(c[k]), *a))),
            None => out.extend(c.map(srgb_from_linear).into_iter().chain([*a])),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every sample added to all pixels of its disc, one sample after the other.
    fn spread_one_by_one(samples: &[PixelSums], width: usize, e: &DensityEstimator) -> Vec<PixelSums> {
        let mut out = vec![[0.0; 4]; samples.len()];
        for (i, s) in samples.iter().enumerate().filter(|(_, s)| s[0] > 0.0) {
            let radius = (e.radius / math::pow(s[0].max(1.0), e.curve)).max(e.minimum);
            let rounded = ((radius * 4.0 + 0.5).floor() * 0.25).min(e.radius.ceil());
            let is_near = |j: &usize| {
                let (dx, dy) = ((i % width).abs_diff(j % width), (i / width).abs_diff(j / width));
                (dx * dx + dy * dy) as f64 <= rounded * rounded
            };
            let disc: Vec<usize> = (0..samples.len()).filter(is_near).collect();
            let share = 1.0 / disc.len() as f64;
            for j in disc {
                out[j].iter_mut().zip(s).for_each(|(a, b)| *a += b * share);
            }
        }
        out
    }

    #[test]
    fn bands_spread_hits_to_the_bit_as_one_sample_after_the_other() {
        let (width, height) = (23, 150);
        let mut draw = osier_base::rng::Rng::at(5, &["hits".into()]);
        let samples: Vec<PixelSums> = (0..width * height)
            .map(|_| match draw.chance(0.2) {
                true => [draw.range(1.0, 31.0), 0.3, 0.1, draw.unit_f64()],
                false => [0.0; 4],
            })
            .collect();
        for (radius, minimum, curve) in [(0.4, 0.0, 0.4), (4.0, 0.0, 0.4), (7.3, 1.2, 0.8), (20.0, 30.0, 0.0)] {
            let e = DensityEstimator { radius, minimum, curve };
            let wanted = spread_one_by_one(&samples, width, &e);
            for threads in [1, 3] {
                let spread = || spread_hits(&samples, width, height, &e, &Cancel::default()).expect("not cancelled");
                assert!(osier_base::par::on_threads(threads, spread) == wanted, "radius {radius}, {threads} threads");
            }
        }
    }
}
