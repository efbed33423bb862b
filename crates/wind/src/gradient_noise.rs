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
    pub fn with_seed_offset(self, number: u32) -> Self {
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
    let slope =
        |cell: i32, f: f32| (scramble(seed, [cell.cast_unsigned(), 0, 0]) >> 8) as f32 * (2.0 / 16_777_216.0) * f - f;
    let [a, b] = x.cells(period);
    let (low, high) = (slope(a, x.inside), slope(b, x.inside - 1.0));
    2.0 * (low + (high - low) * fade(x.inside))
}

/// Mixes a cell into a number whose bits have nothing to do with each other.
#[inline(always)]
pub(super) fn scramble(seed: u32, [x, y, z]: [u32; 3]) -> u32 {
    let mut h = seed ^ x.wrapping_mul(0x8DA6_B343) ^ y.wrapping_mul(0xD816_3841) ^ z.wrapping_mul(0xCB1A_B31F);
    h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
    h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    h ^ (h >> 16)
}

#[inline(always)]
pub(super) fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_no_mean_and_known_strength() {
        let (mut sum, mut square, n) = (0.0, 0.0, 60_000_u32);
        for i in 0..n {
            let v = f64::from(noise1(5, Place::new(f64::from(i) * 0.317, ENDLESS), ENDLESS));
            assert!(v.abs() <= 1.0, "{v}");
            (sum, square) = (sum + v, square + v * v);
        }
        let rms = osier_base::math::sqrt(square / f64::from(n));
        assert!((sum / f64::from(n)).abs() < 0.02 && (0.2..0.45).contains(&rms), "rms {rms}");
    }

    #[test]
    fn noise_repeats() {
        for i in 0..500_u32 {
            let x = f64::from(i) * 0.0371;
            let line = |x: f64| noise1(3, Place::new(x, 4), 4);
            assert!((line(x) - line(x - 4.0)).abs() < 1e-5);
        }
    }
}
