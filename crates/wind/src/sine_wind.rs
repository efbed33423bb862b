//! The wind of [zhao-zhang] 3.1: a sine plus noise.

use std::f64::consts::TAU;

use glam::Vec3;

use super::gradient_noise::{ENDLESS, NoiseCoordinate, noise1};
use super::tuning::{MIN_TRAVEL_SPEED, SINE_NOISE_FREQUENCY, SINE_NOISE_OCTAVES, SINE_NOISE_STRENGTH};
use super::{Wind, power_law};
use osier_base::math;
use osier_base::rng::Rng;

/// Period of the sine, s. Source: [zhao-zhang], omega = 3.14/120 per frame, at 60 frames per second 240 frames.
const SINE_PERIOD: f64 = 4.0;
/// Amplitude of the noise in the printed equation, m/s. Source: [zhao-zhang].
const PRINTED_NOISE_AMPLITUDE: f64 = 4.0;
/// Frames per second of the printed equation, whose time is counted in frames.
const PRINTED_FPS: f64 = 60.0;
/// Number of frames between two values of the printed noise.
const PRINTED_NOISE_INTERVAL: f64 = 30.0;

/// Sine, noise, height profile and period of a [`SineWind`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SineWindOptions {
    /// Horizontal unit vector towards which the wind blows.
    pub direction: Vec3,
    /// Mean speed V0 at 10 m, m/s.
    pub speed: f64,
    /// Amplitude of the sine divided by the mean speed; the printed equation ignores it.
    pub gust: f32,
    /// Exponent of the power-law height profile; the printed equation ignores it.
    pub power: f32,
    /// Evaluate the equation as printed: the same speed everywhere, a sine of amplitude V0, noise that is never negative.
    pub literal: bool,
    /// Time after which the wind repeats, s; `None` for a wind that does not repeat.
    pub period: Option<f64>,
    /// Seed of the value noise and the gradient noise.
    pub seed: u64,
}

/// V = V0 [1 + g sin(2 pi t'/T)] + eps n(t'), where t' = t - x/V0 is the time at which the air at x passed the origin.
/// Source: [zhao-zhang] eq. (1), in seconds, with gusts that travel and noise that keeps the mean.
/// ```
/// use glam::Vec3;
/// use osier_wind::{SineWind, SineWindOptions, Wind};
///
/// let wind = SineWind::new(SineWindOptions {
///     direction: Vec3::X,
///     speed: 5.0,
///     gust: 0.5,
///     power: 0.2,
///     literal: false,
///     period: Some(8.0),
///     seed: 1,
/// });
/// assert!((wind.speed(1.0) - wind.speed(9.0)).abs() < 1e-4);
/// assert_eq!(wind.mean(), Vec3::X * 5.0);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct SineWind {
    options: SineWindOptions,
    /// Period of the sine, s; the wind's period is a multiple of it.
    sine_period: f64,
    /// Noise cells of the first octave per second.
    noise_rate: f64,
    /// Noise cells of the first octave per period.
    noise_cells: i32,
    seed: u32,
}

impl SineWind {
    /// Fits sine and noise to the period, if there is one.
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash; periods are limited")]
    pub fn new(options: SineWindOptions) -> Self {
        // A whole number of sine periods and of noise cells fits the wind's period.
        let rate = if options.literal { PRINTED_FPS / PRINTED_NOISE_INTERVAL } else { SINE_NOISE_FREQUENCY };
        let (sine_period, noise_rate, noise_cells) = match options.period {
            Some(t) => {
                let cells = (t * rate).round().max(1.0);
                (t / (t / SINE_PERIOD).round().max(1.0), cells / t, cells as i32)
            }
            None => (SINE_PERIOD, rate, ENDLESS),
        };
        let seed = (Rng::at(options.seed, &["formula".into()]).next_u64() >> 32) as u32;
        Self { options, sine_period, noise_rate, noise_cells, seed }
    }

    /// Speed at the origin and 10 m at time `t`, s, in m/s.
    pub fn speed(&self, t: f64) -> f64 {
        let o = &self.options;
        if o.literal {
            return self.printed_speed(t);
        }
        // The noise has zero mean; the speed is clamped so that the wind never blows against the mean direction.
        let wave = f64::from(o.gust) * math::sin(TAU * t / self.sine_period);
        (o.speed * (1.0 + wave + f64::from(SINE_NOISE_STRENGTH * self.gradient_noise(t)))).max(0.0)
    }

    /// Reference implementation of [zhao-zhang] eq. (1) as printed: V = V0 + V0 sin(omega t) + eps n(t), n in [0, 1].
    fn printed_speed(&self, t: f64) -> f64 {
        let o = &self.options;
        o.speed + o.speed * math::sin(TAU * t / self.sine_period) + PRINTED_NOISE_AMPLITUDE * self.value_noise(t)
    }

    /// Fractal gradient noise in [-1, 1].
    fn gradient_noise(&self, t: f64) -> f32 {
        self.sum_octaves(|seed, x, cells| noise1(seed, NoiseCoordinate::new(x, cells), cells), t)
    }

    /// Fractal value noise in [0, 1]: random values at integers, interpolated by a smoothstep.
    fn value_noise(&self, t: f64) -> f64 {
        let noise = |seed: u32, x: f64, cells: i32| {
            let lattice_value = |k: f64| {
                let cell = k.rem_euclid(f64::from(cells));
                // Evaluated in the middle of cells, where gradient noise is the difference of two random gradients: one
                // value per cell.
                (0.5 + 0.5 * noise1(seed, NoiseCoordinate::new(cell + 0.5, ENDLESS), ENDLESS)).clamp(0.0, 1.0)
            };
            let k = x.floor();
            math::lerp(lattice_value(k), lattice_value(k + 1.0), math::smoothstep(0.0, 1.0, math::narrow(x - k)))
        };
        f64::from(self.sum_octaves(noise, t))
    }

    /// Weighted mean of octaves of a noise, each with twice the frequency and half the amplitude of the previous one. `noise`:
    /// function of seed, coordinate in cells, and cells per period.
    fn sum_octaves(&self, noise: impl Fn(u32, f64, i32) -> f32, t: f64) -> f32 {
        let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
        for k in 0..SINE_NOISE_OCTAVES {
            let frequency = f64::from(1_u32 << k);
            let cells = self.noise_cells.saturating_mul(1 << k);
            sum += weight * noise(self.seed.wrapping_add(k), t * self.noise_rate * frequency, cells);
            total += weight;
            weight *= 0.5;
        }
        sum / total
    }
}

impl Wind for SineWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        let o = &self.options;
        if o.literal {
            out.fill(o.direction * math::narrow(self.speed(t)));
            return;
        }
        for (u, p) in out.iter_mut().zip(positions) {
            // The wave travels downwind at the mean speed.
            let delay = f64::from(p.dot(o.direction)) / o.speed.max(MIN_TRAVEL_SPEED);
            *u = o.direction * (math::narrow(self.speed(t - delay)) * power_law(p.y, o.power));
        }
    }

    fn mean(&self) -> Vec3 {
        // The printed noise lies in [0, 1], so that half of its amplitude adds to the mean.
        let noise = if self.options.literal { 0.5 * PRINTED_NOISE_AMPLITUDE } else { 0.0 };
        self.options.direction * math::narrow(self.options.speed + noise)
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        if self.options.literal { self.mean() } else { self.mean() * power_law(position.y, self.options.power) }
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
        let mean = |w: &SineWind| (0..40_000_u32).map(|k| w.speed(f64::from(k) * 0.1)).sum::<f64>() / 40_000.0;
        let w = wind(false, None);
        assert!((mean(&w) / 10.0 - 1.0).abs() < 0.03, "{}", mean(&w));
        // The printed equation has another mean, which `mean` returns too.
        let printed = wind(true, None);
        let told = f64::from(printed.mean_at(Vec3::Y).x);
        assert!((mean(&printed) / told - 1.0).abs() < 0.02 && told > 11.9, "{} {told}", mean(&printed));
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
