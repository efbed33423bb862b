//! Gradient noise for air, made to be drawn millions of times: gradients of whole numbers, no trigonometry.

/// Cells of a lattice that need not repeat.
pub(super) const ENDLESS: i32 = 1 << 20;

/// Smooth noise in time, in [-1, 1], without mean.
#[derive(Debug, Clone, Copy)]
pub struct TimeNoise {
    seed: u32,
    /// Cells a second.
    rate: f64,
    cells: i32,
}

impl TimeNoise {
    /// `hertz`: wanted cells a second; with a `period`, s, it repeats after whole cells, at least one.
    pub fn new(seed: u32, hertz: f64, period: Option<f64>) -> Self {
        match period.filter(|p| *p > 0.0) {
            Some(p) => {
                #[allow(clippy::cast_possible_truncation, reason = "a few cells a second")]
                let cells = (hertz * p).round().max(1.0) as i32;
                Self { seed, rate: f64::from(cells) / p, cells }
            }
            None => Self { seed, rate: hertz, cells: ENDLESS },
        }
    }

    /// Another one of the same pace.
    #[must_use]
    pub fn beside(self, number: u32) -> Self {
        Self { seed: self.seed.wrapping_add(number), ..self }
    }

    /// Its value at a time, s.
    pub fn at(self, seconds: f64) -> f32 {
        noise1(self.seed, Place::new(seconds * self.rate, self.cells), self.cells)
    }
}

/// A place on a lattice: cell and place in the cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    cell: i32,
    inside: f32,
}

impl Place {
    /// `x`: in cells, within +-2^31; `period`: cells after which the lattice repeats, >= 1.
    #[allow(clippy::cast_possible_truncation, reason = "saturates far from anything that is drawn")]
    pub(super) fn new(x: f64, period: i32) -> Self {
        // The cast rounds towards zero: one less below it.
        let near = x as i32;
        let whole = if f64::from(near) > x { near - 1 } else { near };
        Self { cell: whole.rem_euclid(period), inside: (x - f64::from(whole)) as f32 }
    }

    /// Both cells around it.
    fn cells(self, period: i32) -> [i32; 2] {
        let next = self.cell + 1;
        [self.cell, if next >= period { 0 } else { next }]
    }
}

/// Noise along a line, in [-1, 1].
pub(super) fn noise1(seed: u32, x: Place, period: i32) -> f32 {
    let slope = |cell: i32, f: f32| (scramble(seed, [cell, 0, 0]) >> 8) as f32 * (2.0 / 16_777_216.0) * f - f;
    let [a, b] = x.cells(period);
    let (low, high) = (slope(a, x.inside), slope(b, x.inside - 1.0));
    2.0 * (low + (high - low) * fade(x.inside))
}

/// Noise in a plane, in about [-1, 1].
pub(super) fn noise2(seed: u32, p: [Place; 2], period: [i32; 2]) -> f32 {
    let (xs, ys) = (p[0].cells(period[0]), p[1].cells(period[1]));
    let corner = |i: usize, j: usize| {
        let h = scramble(seed, [xs[i], ys[j], 0]);
        let (x, y) = (p[0].inside - i as f32, p[1].inside - j as f32);
        // Eight directions: along the axes, and along the diagonals at the same length.
        const DIAGONAL: f32 = std::f32::consts::FRAC_1_SQRT_2;
        let (a, b) = match h >> 29 & 3 {
            0 => (x, 0.0),
            1 => (0.0, y),
            2 => (x * DIAGONAL, y * DIAGONAL),
            _ => (x * DIAGONAL, -y * DIAGONAL),
        };
        if h >> 31 == 0 { a + b } else { -a - b }
    };
    let (u, v) = (fade(p[0].inside), fade(p[1].inside));
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    std::f32::consts::SQRT_2 * mix(mix(corner(0, 0), corner(1, 0), u), mix(corner(0, 1), corner(1, 1), u), v)
}

/// Three noises in space that have nothing to do with each other, each in about [-1, 1]: one walk over the corners.
pub(super) fn noise3(seed: u32, p: [Place; 3], period: [i32; 3]) -> [f32; 3] {
    let cells = [p[0].cells(period[0]), p[1].cells(period[1]), p[2].cells(period[2])];
    let weights = p.map(|q| {
        let t = fade(q.inside);
        [1.0 - t, t]
    });
    let mut sum = [0.0_f32; 3];
    for corner in 0..8_usize {
        let at = [corner & 1, corner >> 1 & 1, corner >> 2];
        let h = scramble(seed, [cells[0][at[0]], cells[1][at[1]], cells[2][at[2]]]);
        let d = [0, 1, 2].map(|k| p[k].inside - at[k] as f32);
        let weight = weights[0][at[0]] * weights[1][at[1]] * weights[2][at[2]];
        for (k, s) in sum.iter_mut().enumerate() {
            *s += weight * towards_corner(h >> (8 * k), d);
        }
    }
    sum.map(|s| s * (2.0 / 3.0))
}

/// Along one of the eight diagonals of a cube: each coordinate with a sign of its own.
#[inline]
fn towards_corner(h: u32, d: [f32; 3]) -> f32 {
    let signed = |v: f32, bit: u32| f32::from_bits(v.to_bits() ^ (h << (31 - bit) & 0x8000_0000));
    signed(d[0], 5) + signed(d[1], 6) + signed(d[2], 7)
}

/// Mixes a cell into a number whose bits have nothing to do with each other.
#[inline]
fn scramble(seed: u32, [x, y, z]: [i32; 3]) -> u32 {
    let mut h = seed
        ^ x.cast_unsigned().wrapping_mul(0x8DA6_B343)
        ^ y.cast_unsigned().wrapping_mul(0xD816_3841)
        ^ z.cast_unsigned().wrapping_mul(0xCB1A_B31F);
    h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
    h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    h ^ (h >> 16)
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and root of the mean square over many places.
    fn spread(f: impl Fn(f64, f64, f64) -> f32) -> (f64, f64) {
        let (mut sum, mut square) = (0.0, 0.0);
        let n = 60_000_u32;
        for i in 0..n {
            let t = f64::from(i);
            let v = f64::from(f(t * 0.317, t * 0.1931 + 7.3, t * 0.0713));
            assert!(v.abs() <= 1.2, "{v}");
            sum += v;
            square += v * v;
        }
        (sum / f64::from(n), crate::math::sqrt(square / f64::from(n)))
    }

    #[test]
    fn noises_have_no_mean_and_known_strength() {
        let one = spread(|x, _, _| noise1(5, Place::new(x, 1 << 20), 1 << 20));
        let two = spread(|x, y, _| noise2(5, [x, y].map(|v| Place::new(v, 1 << 20)), [1 << 20; 2]));
        let three =
            |k: usize| spread(move |x, y, z| noise3(5, [x, y, z].map(|v| Place::new(v, 1 << 20)), [1 << 20; 3])[k]);
        for (mean, rms) in [one, two, three(0), three(1), three(2)] {
            assert!(mean.abs() < 0.02, "mean {mean}");
            assert!((0.2..0.45).contains(&rms), "rms {rms}");
        }
        assert!((three(1).1 - f64::from(super::super::gust::EDDY_RMS)).abs() < 0.01, "{}", three(1).1);
    }

    #[test]
    fn components_have_nothing_to_do_with_each_other() {
        let (mut product, n) = (0.0_f64, 40_000_u32);
        for i in 0..n {
            let t = f64::from(i);
            let [a, b, _] = noise3(9, [t * 0.317, t * 0.211, t * 0.071].map(|v| Place::new(v, 1 << 20)), [1 << 20; 3]);
            product += f64::from(a * b);
        }
        assert!((product / f64::from(n)).abs() < 0.004);
    }

    #[test]
    fn noise_repeats_and_is_smooth() {
        for i in 0..500_u32 {
            let x = f64::from(i) * 0.0371;
            let at = |x: f64| noise3(3, [Place::new(x, 4), Place::new(0.3, 9), Place::new(5.7, 9)], [4, 9, 9])[0];
            assert!((at(x) - at(x + 4.0)).abs() < 1e-5);
            assert!((at(x) - at(x + 1e-3)).abs() < 0.01);
            let line = |x: f64| noise1(3, Place::new(x, 4), 4);
            assert!((line(x) - line(x - 4.0)).abs() < 1e-5);
        }
    }
}
