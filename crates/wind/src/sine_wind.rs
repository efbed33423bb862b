//! The wind of [zhao-zhang] 3.1: a sine with noise on it.

use glam::Vec3;

use super::gradient_noise::{ENDLESS, Place, noise1};
use super::{Wind, with_height};
use osier_base::math;
use osier_base::rng::Rng;

/// Period of the sine, s: 240 frames of 60 a second, as w = 3.14/120 a frame says.
const PERIOD: f64 = 4.0;
/// First frequency of the noise, Hz.
const NOISE: f64 = 2.0;
/// Strength of the noise over the mean.
const EPSILON: f32 = 0.4;
/// Strength of the printed noise, m/s.
const PRINTED_EPSILON: f64 = 4.0;
/// Frames of the printed formula a second, and between two values of its noise.
const PRINTED_RATE: f64 = 60.0;
const PRINTED_LATTICE: f64 = 30.0;
/// Octaves of the noise, each half as strong as the one before.
const OCTAVES: u32 = 3;

/// What the wind is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SineWindOptions {
    /// Unit vector that it blows towards, level.
    pub direction: Vec3,
    /// V0, m/s at 10 m.
    pub speed: f64,
    /// Strength of the sine over the mean.
    pub gust: f32,
    /// Power of the height.
    pub power: f32,
    /// As printed: the same everywhere, down to nothing in every period, noise never negative.
    pub literal: bool,
    /// Time after which it repeats, s.
    pub period: Option<f64>,
    /// Seed of its noise.
    pub seed: u64,
}

/// V = V0 [1 + g sin(2 pi t'/T)] + eps n(t'), t' the time at which the air now here passed the origin.
/// Source: [zhao-zhang] eq. (1), in seconds, with gusts that travel and noise that keeps the mean.
#[derive(Debug, Clone, Copy)]
pub struct SineWind {
    options: SineWindOptions,
    /// Period of the sine that fits the wind's, s.
    sine: f64,
    /// Cells of the first octave a second, and in a period.
    noise: (f64, i32),
    seed: u32,
}

impl SineWind {
    /// Prepares it.
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash; periods are limited")]
    pub fn new(options: SineWindOptions) -> Self {
        let rate = if options.literal { PRINTED_RATE / PRINTED_LATTICE } else { NOISE };
        let (sine, noise) = match options.period {
            Some(t) => {
                let cells = (t * rate).round().max(1.0);
                (t / (t / PERIOD).round().max(1.0), (cells / t, cells as i32))
            }
            None => (PERIOD, (rate, ENDLESS)),
        };
        let seed = (Rng::at(options.seed, &["formula".into()]).next_u64() >> 32) as u32;
        Self { options, sine, noise, seed }
    }

    /// Speed at the origin and 10 m, m/s.
    pub fn speed(&self, t: f64) -> f64 {
        let o = &self.options;
        if o.literal {
            return o.speed
                + o.speed * math::sin(std::f64::consts::TAU * t / self.sine)
                + PRINTED_EPSILON * self.printed(t);
        }
        let wave = f64::from(o.gust) * math::sin(std::f64::consts::TAU * t / self.sine);
        (o.speed * (1.0 + wave + f64::from(EPSILON * self.signed(t)))).max(0.0)
    }

    /// Gradient noise in [-1, 1].
    fn signed(&self, t: f64) -> f32 {
        self.octaves(|seed, x, cells| noise1(seed, Place::new(x, cells), cells), t)
    }

    /// Value noise in [0, 1].
    fn printed(&self, t: f64) -> f64 {
        let value = |seed: u32, x: f64, cells: i32| {
            let at = |k: f64| {
                let place = k.rem_euclid(f64::from(cells));
                // Half a cell from whole numbers gradient noise is at its strongest: a value for each cell.
                (0.5 + 0.5 * noise1(seed, Place::new(place + 0.5, ENDLESS), ENDLESS)).clamp(0.0, 1.0)
            };
            let k = x.floor();
            math::lerp(at(k), at(k + 1.0), math::smoothstep(0.0, 1.0, math::narrow(x - k)))
        };
        f64::from(self.octaves(value, t))
    }

    fn octaves(&self, noise: impl Fn(u32, f64, i32) -> f32, t: f64) -> f32 {
        let (rate, cells) = self.noise;
        let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
        for k in 0..OCTAVES {
            let fine = f64::from(1_u32 << k);
            sum += weight * noise(self.seed.wrapping_add(k), t * rate * fine, cells.saturating_mul(1 << k));
            total += weight;
            weight *= 0.5;
        }
        sum / total
    }
}

impl Wind for SineWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        let o = &self.options;
        if o.literal {
            out.fill(o.direction * math::narrow(self.speed(t)));
            return;
        }
        for (u, p) in out.iter_mut().zip(places) {
            let late = f64::from(p.dot(o.direction)) / o.speed.max(0.5);
            *u = o.direction * (math::narrow(self.speed(t - late)) * with_height(p.y, o.power));
        }
    }

    fn mean(&self) -> Vec3 {
        self.options.direction * math::narrow(self.options.speed)
    }

    fn mean_at(&self, height: f32) -> Vec3 {
        if self.options.literal { self.mean() } else { self.mean() * with_height(height, self.options.power) }
    }

    fn period(&self) -> Option<f64> {
        self.options.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wind(literal: bool, period: Option<f64>) -> SineWind {
        let direction = Vec3::X;
        SineWind::new(SineWindOptions { direction, speed: 10.0, gust: 0.5, power: 0.2, literal, period, seed: 4 })
    }

    #[test]
    fn the_printed_line_is_as_printed() {
        let w = wind(true, None);
        // A quarter of 240 frames: the sine is 1.
        let noise = (w.speed(1.0) - 20.0) / 4.0;
        assert!((0.0..=1.0).contains(&noise), "{noise}");
        let lowest = (0..2400_u32).map(|k| w.speed(f64::from(k) / 60.0)).fold(f64::MAX, f64::min);
        assert!((0.0..4.0).contains(&lowest), "it drops to the noise alone: {lowest}");
    }

    #[test]
    fn the_mean_is_kept_and_gusts_travel() {
        let w = wind(false, None);
        let mean = (0..40_000_u32).map(|k| w.speed(f64::from(k) * 0.1)).sum::<f64>() / 40_000.0;
        assert!((mean / 10.0 - 1.0).abs() < 0.03, "{mean}");
        let mut out = [Vec3::ZERO; 2];
        w.sample(&[Vec3::Y * 10.0, Vec3::new(20.0, 10.0, 3.0)], 7.0, &mut out);
        assert!((f64::from(out[0].x) - w.speed(7.0)).abs() < 1e-4);
        assert!((f64::from(out[1].x) - w.speed(5.0)).abs() < 1e-4);
    }

    #[test]
    fn a_period_is_kept() {
        for literal in [false, true] {
            let w = wind(literal, Some(10.0));
            for k in 0..300_u32 {
                let t = f64::from(k) * 0.07;
                assert!((w.speed(t) - w.speed(t + 10.0)).abs() < 1e-4, "{literal} {t}");
            }
        }
    }
}
