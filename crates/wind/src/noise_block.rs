//! Perlin gradient noise in two and three dimensions at a block of positions: plain loops over arrays, which the compiler
//! vectorizes.

#![allow(clippy::needless_range_loop, reason = "one index runs through many blocks")]

use super::gradient_noise::{fade, hash_cell};

/// Positions per block.
pub(super) const BLOCK: usize = 64;

/// Root mean square of each component of [`noise3`], measured; a test checks it.
pub(super) const NOISE3_RMS: f32 = 0.219;

/// One number per position of a block.
pub(super) type BlockValues = [f32; BLOCK];

/// One coordinate on the noise lattice of every position of a block.
#[derive(Debug)]
pub(super) struct CoordinateBlock {
    /// Lattice point below, wrapped to the period.
    low: [u32; BLOCK],
    /// Lattice point above, wrapped to the period.
    high: [u32; BLOCK],
    /// Position between the two, 0 to 1.
    fraction: BlockValues,
}

impl CoordinateBlock {
    /// All coordinates 0, before they are set.
    pub(super) const ZERO: Self = Self { low: [0; BLOCK], high: [0; BLOCK], fraction: [0.0; BLOCK] };

    /// Sets every coordinate. `x`: in cells, within +-2^31; `period`: cells after which the lattice repeats, >= 1.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "the low bits are the number")]
    pub(super) fn set(&mut self, x: &[f64; BLOCK], period: i32) {
        // 2^52 + n has n in the low bits of its mantissa: a conversion to integer that vectorizes on every target.
        const INTEGER_BIAS: f64 = (1_u64 << 52) as f64;
        let (cells, inverse) = (f64::from(period), f64::from(period).recip());
        for i in 0..BLOCK {
            // floor(x) modulo the period, by a product with 1/period in place of a division.
            let floor = x[i].floor();
            let remainder = floor - (floor * inverse).floor() * cells;
            // The rounded product may be on the other side of an integer; the remainder then differs by one period.
            let up = if remainder < 0.0 { cells } else { 0.0 };
            let down = if remainder >= cells { cells } else { 0.0 };
            let cell = (remainder + up) - down;
            let next = if cell + 1.0 >= cells { 0.0 } else { cell + 1.0 };
            self.low[i] = (cell + INTEGER_BIAS).to_bits() as u32;
            self.high[i] = (next + INTEGER_BIAS).to_bits() as u32;
            self.fraction[i] = (x[i] - floor) as f32;
        }
    }
}

/// Gradient noise in two dimensions, in about [-1, 1].
#[inline(always)]
pub(super) fn noise2(seed: u32, p: [&CoordinateBlock; 2], out: &mut BlockValues) {
    for i in 0..BLOCK {
        let [x, y] = [p[0].fraction[i], p[1].fraction[i]];
        let ([x0, x1], [y0, y1]) = ([p[0].low[i], p[0].high[i]], [p[1].low[i], p[1].high[i]]);
        // Bilinear interpolation of the four corners' ramps, with faded weights.
        let (u, v) = (fade(x), fade(y));
        let (a, b) = (corner_ramp2(seed, x0, y0, x, y), corner_ramp2(seed, x1, y0, x - 1.0, y));
        let (c, d) = (corner_ramp2(seed, x0, y1, x, y - 1.0), corner_ramp2(seed, x1, y1, x - 1.0, y - 1.0));
        let (low, high) = (a + (b - a) * u, c + (d - c) * u);
        // Noise of unit gradients reaches 1/sqrt(2) in the middle of a cell.
        out[i] = std::f32::consts::SQRT_2 * (low + (high - low) * v);
    }
}

/// Dot product of the offset (x, y) from a corner with the corner's gradient: one of eight unit vectors, along the axes and the
/// diagonals.
#[inline(always)]
fn corner_ramp2(seed: u32, cx: u32, cy: u32, x: f32, y: f32) -> f32 {
    const DIAGONAL: f32 = std::f32::consts::FRAC_1_SQRT_2;
    let h = hash_cell(seed, [cx, cy, 0]);
    // Bits 29 and 30 select axis and diagonal, bit 31 the sign; selects instead of a table keep the loop vectorized.
    let (level, diagonal) = (h >> 29 & 1, h >> 30 & 1);
    let along = if level == 0 { x } else { y };
    let across = if level == 0 { y } else { -y };
    let value = if diagonal == 0 { along } else { x * DIAGONAL + across * DIAGONAL };
    f32::from_bits(value.to_bits() ^ (h & 0x8000_0000))
}

/// Three independent gradient noises in three dimensions, each in about [-1, 1]. They share one hash per corner, of which they
/// read different bits.
#[inline(always)]
pub(super) fn noise3(seed: u32, p: [&CoordinateBlock; 3], out: &mut [BlockValues; 3]) {
    let [first, second, third] = out;
    for i in 0..BLOCK {
        let [x, y, z] = [p[0].fraction[i], p[1].fraction[i], p[2].fraction[i]];
        let ([x0, x1], [y0, y1], [z0, z1]) =
            ([p[0].low[i], p[0].high[i]], [p[1].low[i], p[1].high[i]], [p[2].low[i], p[2].high[i]]);
        let (u, v, w) = (fade(x), fade(y), fade(z));
        let (u0, v0, w0) = (1.0 - u, 1.0 - v, 1.0 - w);
        // Trilinear interpolation as the sum over eight corners of weight times ramp. Unrolled by hand: with an inner loop
        // the compiler does not vectorize the loop over the block.
        let sum = [0.0; 3];
        let sum = corner(hash_cell(seed, [x0, y0, z0]), u0 * v0 * w0, [x, y, z], sum);
        let sum = corner(hash_cell(seed, [x1, y0, z0]), u * v0 * w0, [x - 1.0, y, z], sum);
        let sum = corner(hash_cell(seed, [x0, y1, z0]), u0 * v * w0, [x, y - 1.0, z], sum);
        let sum = corner(hash_cell(seed, [x1, y1, z0]), u * v * w0, [x - 1.0, y - 1.0, z], sum);
        let sum = corner(hash_cell(seed, [x0, y0, z1]), u0 * v0 * w, [x, y, z - 1.0], sum);
        let sum = corner(hash_cell(seed, [x1, y0, z1]), u * v0 * w, [x - 1.0, y, z - 1.0], sum);
        let sum = corner(hash_cell(seed, [x0, y1, z1]), u0 * v * w, [x, y - 1.0, z - 1.0], sum);
        let sum = corner(hash_cell(seed, [x1, y1, z1]), u * v * w, [x - 1.0, y - 1.0, z - 1.0], sum);
        // Gradients (+-1, +-1, +-1) reach 3/2 in the middle of a cell.
        first[i] = sum[0] * (2.0 / 3.0);
        second[i] = sum[1] * (2.0 / 3.0);
        third[i] = sum[2] * (2.0 / 3.0);
    }
}

/// Adds the weighted ramps of one corner to the three noises. `h`: hash of the corner; `d`: offset from it.
#[inline(always)]
fn corner(h: u32, weight: f32, d: [f32; 3], sum: [f32; 3]) -> [f32; 3] {
    [
        sum[0] + weight * corner_ramp3(h, d),
        sum[1] + weight * corner_ramp3(h >> 8, d),
        sum[2] + weight * corner_ramp3(h >> 16, d),
    ]
}

/// Dot product of an offset with a gradient (+-1, +-1, +-1), whose signs are bits 5 to 7 of the hash.
#[inline(always)]
fn corner_ramp3(h: u32, [x, y, z]: [f32; 3]) -> f32 {
    flip_sign(x, h << 26) + flip_sign(y, h << 25) + flip_sign(z, h << 24)
}

/// `v`, negated if the highest of `bits` is set: an exclusive or with the sign bit.
#[inline(always)]
fn flip_sign(v: f32, bits: u32) -> f32 {
    f32::from_bits(v.to_bits() ^ (bits & 0x8000_0000))
}

#[cfg(test)]
mod tests {
    use super::super::gradient_noise::ENDLESS;
    use super::*;

    /// Plane noise and the three space noises at `count` blocks of positions `place(k)`.
    fn blocks(seed: u32, place: impl Fn(f64) -> [f64; 3], period: [i32; 3], count: usize) -> Vec<[f32; 4]> {
        let mut list = Vec::new();
        for block in 0..count {
            let mut p = [const { CoordinateBlock::ZERO }; 3];
            for (axis, cells) in p.iter_mut().enumerate() {
                cells.set(&std::array::from_fn(|i| place((block * BLOCK + i) as f64)[axis]), period[axis]);
            }
            let (mut plane, mut space) = ([0.0; BLOCK], [[0.0; BLOCK]; 3]);
            noise2(seed, [&p[0], &p[1]], &mut plane);
            noise3(seed, [&p[0], &p[1], &p[2]], &mut space);
            list.extend((0..BLOCK).map(|i| [plane[i], space[0][i], space[1][i], space[2][i]]));
        }
        list
    }

    #[test]
    fn noises_have_no_mean_and_known_strength_and_nothing_to_do_with_each_other() {
        let all = blocks(5, |t| [t * 0.317, t * 0.1931 + 7.3, t * 0.0713], [ENDLESS; 3], 1000);
        let mean = |f: &dyn Fn(&[f32; 4]) -> f32| all.iter().map(|v| f64::from(f(v))).sum::<f64>() / all.len() as f64;
        for k in 0..4 {
            let rms = osier_base::math::sqrt(mean(&|v| v[k] * v[k]));
            assert!(mean(&|v| v[k]).abs() < 0.02 && (0.2..0.45).contains(&rms), "{k}: rms {rms}");
            assert!(all.iter().all(|v| v[k].abs() < 1.2));
        }
        let rms = osier_base::math::sqrt(mean(&|v| v[2] * v[2]));
        assert!((rms - f64::from(NOISE3_RMS)).abs() < 0.01, "{rms}");
        assert!(mean(&|v| v[1] * v[2]).abs() < 0.004);
    }

    #[test]
    fn noise_repeats_and_is_smooth() {
        let at = |late: f64| blocks(3, |t| [t * 0.0371 + late, 0.3, 5.7], [4, 9, 9], 8);
        let (now, later, before, next) = (at(0.0), at(4.0), at(-8.0), at(1e-3));
        for i in 0..now.len() {
            for k in 0..4 {
                assert!((now[i][k] - later[i][k]).abs() < 1e-5 && (now[i][k] - before[i][k]).abs() < 1e-5);
                assert!((now[i][k] - next[i][k]).abs() < 0.01);
            }
        }
    }

    #[test]
    #[allow(clippy::cast_possible_truncation, reason = "small whole numbers")]
    fn cells_are_those_of_whole_arithmetic() {
        let mut p = CoordinateBlock::ZERO;
        for period in [1, 3, 7, 49, 1000, ENDLESS] {
            for start in [-3e6, -50.0, 0.0, 2e6] {
                let x: [f64; BLOCK] = std::array::from_fn(|i| start + i as f64 * f64::from(period) / 7.0);
                p.set(&x, period);
                for (i, x) in x.iter().enumerate() {
                    let cell = (x.floor() as i64).rem_euclid(i64::from(period));
                    assert_eq!(i64::from(p.low[i]), cell, "{x} of {period}");
                    assert_eq!(i64::from(p.high[i]), (cell + 1) % i64::from(period), "{x} of {period}");
                }
            }
        }
    }
}
