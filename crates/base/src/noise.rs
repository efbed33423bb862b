//! Gradient and cellular noise with pinned values; periodic in every coordinate so that maps tile and clips loop.

use crate::math;
use crate::rng::mix64;

/// Gradient noise on a lattice of whole numbers, periodic with `period` (cells, >= 1), in about [-1, 1].
/// `p`: position in cells. Smooth to the second derivative.
/// Source: K. Perlin, "Improving noise", SIGGRAPH 2002; gradients from a hash instead of a table.
#[inline]
pub fn gradient2(seed: u64, p: [f32; 2], period: [i32; 2]) -> f32 {
    let (x0, fx) = floor_and_fraction(p[0]);
    let (y0, fy) = floor_and_fraction(p[1]);
    // Contribution of a lattice corner: its unit gradient, from a hash, dotted with the offset from it.
    let corner = |dx: i32, dy: i32| {
        let h = mix64(&[seed, cell(x0 + dx, period[0]), cell(y0 + dy, period[1])]);
        let a = (h >> 40) as f32 * (std::f32::consts::TAU / 16_777_216.0);
        math::cos_f32(a) * (fx - dx as f32) + math::sin_f32(a) * (fy - dy as f32)
    };
    let (u, v) = (fade(fx), fade(fy));
    let low = math::lerp(corner(0, 0), corner(1, 0), u);
    let high = math::lerp(corner(0, 1), corner(1, 1), u);
    // Unit gradients in two dimensions give values up to 1/sqrt(2), reached in the middle of a cell.
    math::lerp(low, high, v) * std::f32::consts::SQRT_2
}

/// Gradient noise along a line, periodic with `period` cells (>= 1), in [-1, 1]. `x`: position in cells.
#[inline]
pub fn gradient1(seed: u64, x: f32, period: i32) -> f32 {
    let (x0, f) = floor_and_fraction(x);
    let slope = |d: i32| {
        let h = mix64(&[seed, cell(x0 + d, period)]);
        ((h >> 40) as f32 * (2.0 / 16_777_216.0) - 1.0) * (f - d as f32)
    };
    // Slopes in [-1, 1] give values up to 1/2, reached in the middle of a cell.
    math::lerp(slope(0), slope(1), fade(f)) * 2.0
}

/// Sum of `octaves` of [`gradient2`], each of doubled frequency and half the weight, scaled back to about [-1, 1].
#[inline]
pub fn fractal2(seed: u64, p: [f32; 2], period: [i32; 2], octaves: u32) -> f32 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for o in 0..octaves {
        // Frequency and period double together, so that every octave tiles with the first. Each has its own seed.
        let k = 1_i32 << o;
        let q = [p[0] * k as f32, p[1] * k as f32];
        sum += weight * gradient2(seed.wrapping_add(u64::from(o)), q, [period[0] * k, period[1] * k]);
        total += weight;
        weight *= 0.5;
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

/// Result of [`cellular2`]: f2 - f1 is 0 on the borders between Voronoi cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cellular {
    /// Distance to the nearest feature point, cells.
    pub f1: f32,
    /// Distance to the second nearest, cells.
    pub f2: f32,
    /// Hash of the seed and the cell of the nearest feature point, equal in all periods.
    pub id: u64,
}

/// Distances to the two nearest feature points, one per cell, moved from the cell's middle by up to `jitter`/2 cells.
/// `p`: position in cells; `period`: cells, >= 1.
/// Source: S. Worley, "A cellular texture basis function", SIGGRAPH 1996.
pub fn cellular2(seed: u64, p: [f32; 2], period: [i32; 2], jitter: f32) -> Cellular {
    let (x0, fx) = floor_and_fraction(p[0]);
    let (y0, fy) = floor_and_fraction(p[1]);
    let mut found = Cellular { f1: f32::MAX, f2: f32::MAX, id: 0 };
    // The nearest two feature points lie in the 3 x 3 cells around if (1/2 + jitter/2) sqrt 2 <= 3/2 - jitter/2: up to jitter
    // 0.65. At larger jitter a nearer point two cells away may be missed.
    for dy in -1..=1 {
        for dx in -1..=1 {
            let h = mix64(&[seed, cell(x0 + dx, period[0]), cell(y0 + dy, period[1])]);
            // Two independent offsets of 24 bits from different bits of one hash.
            let ox = dx as f32 + 0.5 + jitter * ((h >> 40) as f32 / 16_777_216.0 - 0.5) - fx;
            let oy = dy as f32 + 0.5 + jitter * (((h >> 16) & 0xFF_FFFF) as f32 / 16_777_216.0 - 0.5) - fy;
            let d = math::sqrt_f32(ox * ox + oy * oy);
            if d < found.f1 {
                found = Cellular { f1: d, f2: found.f1, id: h };
            } else if d < found.f2 {
                found.f2 = d;
            }
        }
    }
    found
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "positions are a few thousand cells at most; beyond, the cast saturates"
)]
fn floor_and_fraction(x: f32) -> (i32, f32) {
    let floor = x.floor();
    (floor as i32, x - floor)
}

fn cell(i: i32, period: i32) -> u64 {
    u64::from(i.rem_euclid(period.max(1)).cast_unsigned())
}

/// Quintic fade 6 t^5 - 15 t^4 + 10 t^3: first and second derivatives vanish at 0 and 1, where cells meet.
fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_zero_on_the_lattice_and_tiles() {
        assert!(gradient2(1, [3.0, 5.0], [8, 8]).abs() < 1e-6);
        for i in 0..100 {
            let p = [i as f32 * 0.137, i as f32 * 0.071];
            let q = [p[0] + 8.0, p[1] + 16.0];
            assert!((gradient2(9, p, [8, 16]) - gradient2(9, q, [8, 16])).abs() < 1e-4);
            assert!((gradient1(9, p[0], 8) - gradient1(9, q[0], 8)).abs() < 1e-4);
            assert!((cellular2(9, p, [8, 16], 0.9).f1 - cellular2(9, q, [8, 16], 0.9).f1).abs() < 1e-4);
            assert!(gradient2(9, p, [8, 16]).abs() <= 1.0);
        }
    }
}
