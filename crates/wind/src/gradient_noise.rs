//! Perlin gradient noise in one dimension for winds, which evaluate it millions of times: gradients from an integer hash, without
//! trigonometry. [`super::noise_block`] has two and three dimensions.

/// Period, in cells, of noise that does not have to repeat.
pub(super) const ENDLESS: i32 = 1 << 20;

/// Smooth noise of time, in [-1, 1], with a mean of 0.
/// ```
/// let noise = osier_wind::TimeNoise::new(7, 0.5, Some(4.0));
/// assert!((noise.at(1.3) - noise.at(5.3)).abs() < 1e-5);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct TimeNoise {
    seed: u32,
    /// Noise cells per second.
    rate: f64,
    /// Number of cells after which the noise repeats.
    cells: i32,
}

impl TimeNoise {
    /// `hertz`: noise cells per second. With a `period`, s, the rate is rounded so that a whole number of cells, at least one,
    /// passes in it.
    pub fn new(seed: u32, hertz: f64, period: Option<f64>) -> Self {
        match period.filter(|p| *p > 0.0) {
            Some(p) => {
                #[allow(clippy::cast_possible_truncation, reason = "a few cells per second")]
                let cells = (hertz * p).round().max(1.0) as i32;
                Self { seed, rate: f64::from(cells) / p, cells }
            }
            None => Self { seed, rate: hertz, cells: ENDLESS },
        }
    }

    /// An independent noise with the same rate and period.
    #[must_use]
    pub fn with_seed_offset(self, number: u32) -> Self {
        Self { seed: self.seed.wrapping_add(number), ..self }
    }

    /// Value in [-1, 1] at a time, s.
    pub fn at(self, seconds: f64) -> f32 {
        noise1(self.seed, NoiseCoordinate::new(seconds * self.rate, self.cells), self.cells)
    }
}

/// One coordinate of the noise lattice: cell, and position in the cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseCoordinate {
    /// Lattice point below, 0 to the period less 1.
    cell: i32,
    /// Position above the lattice point, 0 to 1.
    fraction: f32,
}

impl NoiseCoordinate {
    /// `x`: coordinate in cells, within +-2^31; `period`: cells after which the lattice repeats, >= 1.
    #[allow(clippy::cast_possible_truncation, reason = "saturates far from anything that is drawn")]
    pub(super) fn new(x: f64, period: i32) -> Self {
        // floor(x): the cast rounds towards zero, which is one too many for a negative fraction.
        let truncated = x as i32;
        let floor = if f64::from(truncated) > x { truncated - 1 } else { truncated };
        Self { cell: floor.rem_euclid(period), fraction: (x - f64::from(floor)) as f32 }
    }

    /// The two lattice points around it, wrapped.
    fn lattice_points(self, period: i32) -> [i32; 2] {
        let next = self.cell + 1;
        [self.cell, if next >= period { 0 } else { next }]
    }
}

/// Gradient noise in one dimension, in [-1, 1].
pub(super) fn noise1(seed: u32, x: NoiseCoordinate, period: i32) -> f32 {
    // A gradient in [-1, 1) from the upper 24 bits h of the hash, times the distance: (2 h / 2^24 - 1) d, multiplied out.
    let ramp = |cell: i32, distance: f32| {
        (hash_cell(seed, [cell.cast_unsigned(), 0, 0]) >> 8) as f32 * (2.0 / 16_777_216.0) * distance - distance
    };
    let [a, b] = x.lattice_points(period);
    let (low, high) = (ramp(a, x.fraction), ramp(b, x.fraction - 1.0));
    // Two opposite gradients of 1 meet at 1/2 in the middle of a cell: the factor 2 fills [-1, 1].
    2.0 * (low + (high - low) * fade(x.fraction))
}

/// Hash of a lattice point. Source: C. Ericson, "Real-time collision detection", 2005 (one large odd factor per axis), then the
/// `lowbias32` finalizer of C. Wellons. Differs: the products are combined by exclusive or, with the seed.
#[inline(always)]
pub(super) fn hash_cell(seed: u32, [x, y, z]: [u32; 3]) -> u32 {
    let mut h = seed ^ x.wrapping_mul(0x8DA6_B343) ^ y.wrapping_mul(0xD816_3841) ^ z.wrapping_mul(0xCB1A_B31F);
    h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
    h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    h ^ (h >> 16)
}

/// 6 t^5 - 15 t^4 + 10 t^3 on [0, 1]: first and second derivative vanish at both ends. Source: Perlin 2002.
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
            let v = f64::from(noise1(5, NoiseCoordinate::new(f64::from(i) * 0.317, ENDLESS), ENDLESS));
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
            let line = |x: f64| noise1(3, NoiseCoordinate::new(x, 4), 4);
            assert!((line(x) - line(x - 4.0)).abs() < 1e-5);
        }
    }
}
