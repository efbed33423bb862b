//! Gradient noise at many places at once: plain loops over blocks of numbers, which compilers turn into wide instructions.

#![allow(clippy::needless_range_loop, reason = "one index runs through many blocks")]

use super::gradient_noise::{fade, scramble};

/// Places in a block.
pub(super) const BLOCK: usize = 64;

/// A number for each place of a block.
pub(super) type Reals = [f32; BLOCK];

/// One coordinate of a block of places on a lattice.
#[derive(Debug)]
pub(super) struct Places {
    low: [u32; BLOCK],
    high: [u32; BLOCK],
    inside: Reals,
}

impl Places {
    pub(super) const ORIGIN: Self = Self { low: [0; BLOCK], high: [0; BLOCK], inside: [0.0; BLOCK] };

    /// `x`: in cells, within +-2^31; `period`: cells after which the lattice repeats, >= 1.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "the low bits are the number")]
    pub(super) fn set(&mut self, x: &[f64; BLOCK], period: i32) {
        // Added to a small whole number, it leaves that in the low bits.
        const WHOLE: f64 = (1_u64 << 52) as f64;
        let (cells, share) = (f64::from(period), f64::from(period).recip());
        for i in 0..BLOCK {
            let whole = x[i].floor();
            let round = whole - (whole * share).floor() * cells;
            // The product may have been rounded over a whole number.
            let up = if round < 0.0 { cells } else { 0.0 };
            let down = if round >= cells { cells } else { 0.0 };
            let cell = (round + up) - down;
            let next = if cell + 1.0 >= cells { 0.0 } else { cell + 1.0 };
            self.low[i] = (cell + WHOLE).to_bits() as u32;
            self.high[i] = (next + WHOLE).to_bits() as u32;
            self.inside[i] = (x[i] - whole) as f32;
        }
    }
}

/// Noise in a plane, in about [-1, 1].
#[inline(always)]
pub(super) fn noise2(seed: u32, p: [&Places; 2], out: &mut Reals) {
    for i in 0..BLOCK {
        let [x, y] = [p[0].inside[i], p[1].inside[i]];
        let ([x0, x1], [y0, y1]) = ([p[0].low[i], p[0].high[i]], [p[1].low[i], p[1].high[i]]);
        let (u, v) = (fade(x), fade(y));
        let (a, b) = (slope(seed, x0, y0, x, y), slope(seed, x1, y0, x - 1.0, y));
        let (c, d) = (slope(seed, x0, y1, x, y - 1.0), slope(seed, x1, y1, x - 1.0, y - 1.0));
        let (low, high) = (a + (b - a) * u, c + (d - c) * u);
        out[i] = std::f32::consts::SQRT_2 * (low + (high - low) * v);
    }
}

/// Along one of eight directions: the axes, and the diagonals at the same length.
#[inline(always)]
fn slope(seed: u32, cx: u32, cy: u32, x: f32, y: f32) -> f32 {
    const DIAGONAL: f32 = std::f32::consts::FRAC_1_SQRT_2;
    let h = scramble(seed, [cx, cy, 0]);
    let (level, diagonal) = (h >> 29 & 1, h >> 30 & 1);
    let along = if level == 0 { x } else { y };
    let across = if level == 0 { y } else { -y };
    let value = if diagonal == 0 { along } else { x * DIAGONAL + across * DIAGONAL };
    f32::from_bits(value.to_bits() ^ (h & 0x8000_0000))
}

/// Three noises in space that have nothing to do with each other, each in about [-1, 1]: one walk over the corners.
#[inline(always)]
pub(super) fn noise3(seed: u32, p: [&Places; 3], out: &mut [Reals; 3]) {
    let [first, second, third] = out;
    for i in 0..BLOCK {
        let [x, y, z] = [p[0].inside[i], p[1].inside[i], p[2].inside[i]];
        let ([x0, x1], [y0, y1], [z0, z1]) =
            ([p[0].low[i], p[0].high[i]], [p[1].low[i], p[1].high[i]], [p[2].low[i], p[2].high[i]]);
        let (u, v, w) = (fade(x), fade(y), fade(z));
        let (u0, v0, w0) = (1.0 - u, 1.0 - v, 1.0 - w);
        let sum = [0.0; 3];
        // One after the other instead of in a loop, which would keep the blocks from being taken side by side.
        let sum = corner(scramble(seed, [x0, y0, z0]), u0 * v0 * w0, [x, y, z], sum);
        let sum = corner(scramble(seed, [x1, y0, z0]), u * v0 * w0, [x - 1.0, y, z], sum);
        let sum = corner(scramble(seed, [x0, y1, z0]), u0 * v * w0, [x, y - 1.0, z], sum);
        let sum = corner(scramble(seed, [x1, y1, z0]), u * v * w0, [x - 1.0, y - 1.0, z], sum);
        let sum = corner(scramble(seed, [x0, y0, z1]), u0 * v0 * w, [x, y, z - 1.0], sum);
        let sum = corner(scramble(seed, [x1, y0, z1]), u * v0 * w, [x - 1.0, y, z - 1.0], sum);
        let sum = corner(scramble(seed, [x0, y1, z1]), u0 * v * w, [x, y - 1.0, z - 1.0], sum);
        let sum = corner(scramble(seed, [x1, y1, z1]), u * v * w, [x - 1.0, y - 1.0, z - 1.0], sum);
        first[i] = sum[0] * (2.0 / 3.0);
        second[i] = sum[1] * (2.0 / 3.0);
        third[i] = sum[2] * (2.0 / 3.0);
    }
}

/// What one corner adds to the three noises.
#[inline(always)]
fn corner(h: u32, weight: f32, d: [f32; 3], sum: [f32; 3]) -> [f32; 3] {
    [
        sum[0] + weight * towards_corner(h, d),
        sum[1] + weight * towards_corner(h >> 8, d),
        sum[2] + weight * towards_corner(h >> 16, d),
    ]
}

/// Along one of the eight diagonals of a cube: each coordinate with a sign of its own.
#[inline(always)]
fn towards_corner(h: u32, [x, y, z]: [f32; 3]) -> f32 {
    signed(x, h << 26) + signed(y, h << 25) + signed(z, h << 24)
}

/// Turned round if the highest bit is set.
#[inline(always)]
fn signed(v: f32, bits: u32) -> f32 {
    f32::from_bits(v.to_bits() ^ (bits & 0x8000_0000))
}

#[cfg(test)]
mod tests {
    use super::super::gradient_noise::ENDLESS;
    use super::*;

    /// Noises of the plane and of space at blocks of places, each block from place `k` on.
    fn blocks(seed: u32, place: impl Fn(f64) -> [f64; 3], period: [i32; 3], count: usize) -> Vec<[f32; 4]> {
        let mut list = Vec::new();
        for block in 0..count {
            let mut p = [const { Places::ORIGIN }; 3];
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
        assert!((rms - f64::from(super::super::gust_wind::EDDY_RMS)).abs() < 0.01, "{rms}");
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
        let mut p = Places::ORIGIN;
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
