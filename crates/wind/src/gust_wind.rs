//! Gusts that travel downwind and contain turbulent eddies.

use glam::Vec3;
use pulp::{Arch, Simd, WithSimd};

use super::gradient_noise::{ENDLESS, NoiseCoordinate, noise1};
use super::noise_block::{BLOCK, CoordinateBlock, NOISE3_RMS, noise2, noise3};
use super::tuning::{GUST_WIDTH, LATERAL_EDDY, MAX_EDDY, MIN_CELLS_PER_PERIOD, VERTICAL_EDDY, WANDER_TIME};
use super::{CALM_SPEED, Wind, power_law};
use osier_base::math;
use osier_base::rng::Rng;

/// Number of samples of the tabulated height profile, 0.25 m apart; above its 100 m the power law is evaluated.
const PROFILE_SAMPLES: usize = 400;

/// Mean wind, gusts, eddies and seed of a [`GustWind`]; the default is 4.5 m/s along +X and does not repeat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GustWindOptions {
    /// Horizontal unit vector towards which the mean wind blows.
    pub direction: Vec3,
    /// Mean speed at 10 m, m/s, 0..60.
    pub speed: f64,
    /// Amplitude of gusts as a fraction of the mean speed, 0..1; 0.3 to 0.5 is natural.
    pub gust: f32,
    /// Turbulence intensity: root mean square of the eddy velocity divided by the mean speed, 0..1; 0.15 to 0.25 is
    /// natural.
    pub turbulence: f32,
    /// Length of gusts along the wind, m, 2..200.
    pub gust_length: f64,
    /// Size of eddies, m, 0.5..20.
    pub eddy_size: f64,
    /// Largest angle between the wind and its mean direction, rad, 0..pi/2.
    pub wander: f32,
    /// Exponent of the power-law height profile; 0 for the same wind at all heights.
    pub power: f32,
    /// Time after which the whole field repeats, s; `None` for a wind that does not repeat.
    pub period: Option<f64>,
    /// Seed of the noise of gusts, eddies and direction.
    pub seed: u64,
}

impl Default for GustWindOptions {
    fn default() -> Self {
        Self {
            direction: Vec3::X,
            speed: 4.5,
            gust: 0.4,
            turbulence: 0.2,
            gust_length: 40.0,
            eddy_size: 4.0,
            wander: 0.26,
            power: 0.2,
            period: None,
            seed: 0,
        }
    }
}

/// Noise that the mean wind advects downwind unchanged.
#[derive(Debug, Clone, Copy)]
struct AdvectedNoise {
    /// Edge of a noise cell, m.
    length: f64,
    /// Number of cells along the wind after which the noise repeats.
    cells: i32,
    seed: u32,
}

impl AdvectedNoise {
    /// `length`: requested edge of a cell, m. With a period, s, it is changed so that a whole number of cells passes a point
    /// in one period at `speed`, m/s.
    #[allow(clippy::cast_possible_truncation, reason = "speed, period and length are limited")]
    fn new(length: f64, speed: f64, period: Option<f64>, seed: u32) -> Self {
        match period {
            Some(t) => {
                let length = fit_gust_length(length, speed, t);
                Self { length, cells: (speed * t / length).round() as i32, seed }
            }
            None => Self { length, cells: ENDLESS, seed },
        }
    }
}

/// A gust length, m, of which a whole number, at least four, passes a point in one period: that number is `period * speed / length`,
/// rounded. `speed`: m/s, at least that of calm air; `period`: s.
/// ```
/// // In 10 s at 4.5 m/s 45 m of air pass. Gusts of 40 m would not repeat; four of 11.25 m do.
/// assert_eq!(osier_wind::fit_gust_length(40.0, 4.5, 10.0), 11.25);
/// ```
pub fn fit_gust_length(length: f64, speed: f64, period: f64) -> f64 {
    let travelled = speed.max(CALM_SPEED) * period;
    travelled / (travelled / length).round().max(MIN_CELLS_PER_PERIOD)
}

/// Gusts and eddies in a mean wind that grows with height by a power law.
/// ```
/// use glam::Vec3;
/// use osier_wind::{GustWind, GustWindOptions, Wind};
///
/// let wind = GustWind::new(GustWindOptions { speed: 6.0, period: Some(8.0), ..GustWindOptions::default() });
/// let mut velocity = [Vec3::ZERO];
/// wind.sample(&[Vec3::new(1.0, 2.0, 3.0)], 0.5, &mut velocity);
/// assert!(velocity[0].x > 0.0);
/// assert_eq!(wind.period(), Some(8.0));
/// ```
#[derive(Debug, Clone)]
pub struct GustWind {
    options: GustWindOptions,
    /// Horizontal unit vector across the mean direction.
    across: Vec3,
    gusts: AdvectedNoise,
    eddies: AdvectedNoise,
    /// Number of cells of the direction's noise per period.
    wander_cells: i32,
    wander_seed: u32,
    /// Mean speed at heights 0.25 m apart, from 0 m up, divided by that at 10 m.
    profile: Vec<f32>,
}

impl GustWind {
    /// Fits gusts, eddies and direction to the period and tabulates the height profile.
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
    pub fn new(options: GustWindOptions) -> Self {
        let mut rng = Rng::at(options.seed, &["gustwind".into()]);
        let mut seed = || (rng.next_u64() >> 32) as u32;
        let speed = options.speed.max(CALM_SPEED);
        let cells = options.period.map_or(f64::from(ENDLESS), |t| (t / WANDER_TIME).round().max(MIN_CELLS_PER_PERIOD));
        // Struct fields are evaluated in the order written, which determines the draw of the seed that each noise gets.
        Self {
            gusts: AdvectedNoise::new(options.gust_length, speed, options.period, seed()),
            eddies: AdvectedNoise::new(options.eddy_size, speed, options.period, seed()),
            wander_cells: cells as i32,
            wander_seed: seed(),
            across: options.direction.cross(Vec3::Y),
            profile: (0..=PROFILE_SAMPLES).map(|i| power_law(i as f32 * 0.25, options.power)).collect(),
            options,
        }
    }

    /// Mean speed at height `y`, m, divided by that at 10 m: the tabulated power law, linearly interpolated.
    fn height_factor(&self, y: f32) -> f32 {
        // Four samples per metre.
        let x = y.max(0.5) * 4.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 2 and PROFILE_SAMPLES")]
        let k = x.min(PROFILE_SAMPLES as f32) as usize;
        match (self.profile.get(k), self.profile.get(k + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (x - k as f32),
            _ => power_law(y, self.options.power),
        }
    }

    /// Horizontal unit vector towards which the wind blows at time `t`, s: the mean direction, turned about +Y by noise.
    fn direction(&self, t: f64) -> Vec3 {
        // With a period, a whole number of noise cells passes in it.
        let rate = self.options.period.map_or(WANDER_TIME.recip(), |p| f64::from(self.wander_cells) / p);
        let coordinate = NoiseCoordinate::new(t * rate, self.wander_cells);
        let angle = self.options.wander * noise1(self.wander_seed, coordinate, self.wander_cells);
        let o = &self.options;
        o.direction * math::cos_f32(angle) - self.across * math::sin_f32(angle)
    }
}

/// Horizontal axes of the wind at one time: along it and across it.
#[derive(Debug, Clone, Copy)]
struct WindAxes {
    along: Vec3,
    across: Vec3,
}

/// Samples a [`GustWind`] at many positions of one time, with the widest instructions of the machine.
struct GustKernel<'a> {
    wind: &'a GustWind,
    positions: &'a [Vec3],
    t: f64,
    out: &'a mut [Vec3],
}

impl WithSimd for GustKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let along = self.wind.direction(self.t);
        let axes = WindAxes { along, across: along.cross(Vec3::Y) };
        for (positions, out) in self.positions.chunks(BLOCK).zip(self.out.chunks_mut(BLOCK)) {
            self.wind.sample_block(positions, self.t, axes, out);
        }
    }
}

impl GustWind {
    /// u = U0 h(y) [max(0, 1 + g n1) w + I (n2x w + n2y Y / 2 + 0.7 n2z c)] at no more than [`BLOCK`] positions. w, c: unit
    /// vectors along and across the wind; g, I: strengths of gusts and eddies; n1: noise of long waves, n2: of short ones. Both
    /// are advected at the mean speed (Taylor's frozen turbulence).
    #[inline(always)]
    fn sample_block(&self, positions: &[Vec3], t: f64, axes: WindAxes, out: &mut [Vec3]) {
        let (o, g, e) = (&self.options, &self.gusts, &self.eddies);
        // Coordinates in the frame that moves with the mean wind, in which the noise does not change in time. It uses the mean
        // direction, not the momentary one, which would move distant gusts sideways.
        let [mut x, mut y, mut z] = [[0.0; BLOCK]; 3];
        for (i, p) in positions.iter().enumerate() {
            x[i] = f64::from(p.dot(o.direction)) - o.speed * t;
            y[i] = f64::from(p.y);
            z[i] = f64::from(p.dot(self.across));
        }
        let mut coordinates = [const { CoordinateBlock::ZERO }; 3];
        let (mut gusts, mut eddies) = ([0.0; BLOCK], [[0.0; BLOCK]; 3]);
        // Gusts: plane noise, periodic along the wind only, the same at all heights.
        coordinates[0].set(&in_cells(&x, g.length), g.cells);
        coordinates[1].set(&in_cells(&z, GUST_WIDTH * g.length), ENDLESS);
        noise2(g.seed, [&coordinates[0], &coordinates[1]], &mut gusts);
        // Eddies: one independent noise in space per component of the velocity.
        coordinates[0].set(&in_cells(&x, e.length), e.cells);
        coordinates[1].set(&in_cells(&y, e.length), ENDLESS);
        coordinates[2].set(&in_cells(&z, e.length), ENDLESS);
        noise3(e.seed, [&coordinates[0], &coordinates[1], &coordinates[2]], &mut eddies);
        for (i, (u, p)) in out.iter_mut().zip(positions).enumerate() {
            // Divided by its root mean square the noise has unit variance, so that `turbulence` is the turbulence
            // intensity.
            let eddy = [eddies[0][i], eddies[1][i], eddies[2][i]]
                .map(|n| o.turbulence * (n / NOISE3_RMS).clamp(-MAX_EDDY, MAX_EDDY));
            let streamwise = (1.0 + o.gust * gusts[i]).max(0.0) + eddy[0];
            *u = (axes.along * streamwise
                + Vec3::Y * (VERTICAL_EDDY * eddy[1])
                + axes.across * (LATERAL_EDDY * eddy[2]))
                * (math::narrow(o.speed) * self.height_factor(p.y));
        }
    }
}

/// Coordinates, m, in noise cells of an edge `length`, m.
#[inline(always)]
fn in_cells(x: &[f64; BLOCK], length: f64) -> [f64; BLOCK] {
    let mut cells = [0.0; BLOCK];
    for (c, x) in cells.iter_mut().zip(x) {
        *c = x / length;
    }
    cells
}

impl Wind for GustWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        Arch::new().dispatch(GustKernel { wind: self, positions, t, out });
    }

    fn mean(&self) -> Vec3 {
        self.options.direction * math::narrow(self.options.speed)
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.mean() * self.height_factor(position.y)
    }

    fn period(&self) -> Option<f64> {
        self.options.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(wind: &GustWind, p: Vec3, t: f64) -> Vec3 {
        let mut out = [Vec3::ZERO];
        wind.sample(&[p], t, &mut out);
        out[0]
    }

    #[test]
    fn the_mean_is_as_asked_at_every_height() {
        for (seed, y) in [(1, 1.0), (2, 10.0), (3, 30.0)] {
            let wind = GustWind::new(GustWindOptions { seed, wander: 0.0, ..GustWindOptions::default() });
            // Average over many positions instead of over a long time at one position: the mean is the same, and takes less time
            // to compute.
            let places: Vec<Vec3> = (0..64).map(|i| Vec3::new(0.0, y, i as f32 * 317.0)).collect();
            let mut out = vec![Vec3::ZERO; places.len()];
            let (mut sum, mut n) = (0.0_f64, 0.0);
            for k in 0..2400_u32 {
                wind.sample(&places, f64::from(k) * 0.5, &mut out);
                sum += out.iter().map(|u| f64::from(u.x)).sum::<f64>();
                n += places.len() as f64;
            }
            let expected = 4.5 * math::pow(f64::from(y) / 10.0, 0.2);
            assert!((sum / n / expected - 1.0).abs() < 0.03, "{y} m: {} for {expected}", sum / n);
        }
    }

    #[test]
    fn wide_instructions_give_the_same_bits() {
        let wind = GustWind::new(GustWindOptions { period: Some(7.0), ..GustWindOptions::default() });
        let places: Vec<Vec3> = (0..200_u16).map(|i| Vec3::new(f32::from(i), 0.1, 2.0) * f32::from(i)).collect();
        let sample = |arch: Arch| {
            let mut out = vec![Vec3::ZERO; places.len()];
            arch.dispatch(GustKernel { wind: &wind, positions: &places, t: 1.3, out: &mut out });
            out.iter().flat_map(|u| u.to_array().map(f32::to_bits)).collect::<Vec<u32>>()
        };
        assert_eq!(sample(Arch::Scalar), sample(Arch::new()));
    }

    #[test]
    fn a_gust_arrives_later_downwind() {
        let options = GustWindOptions { turbulence: 0.0, wander: 0.0, speed: 6.0, ..GustWindOptions::default() };
        let wind = GustWind::new(options);
        let series = |x: f32| -> Vec<f32> {
            (0..6000_u32).map(|k| one(&wind, Vec3::new(x, 10.0, 0.0), f64::from(k) * 0.05).x - 6.0).collect()
        };
        let (near, far) = (series(0.0), series(30.0));
        let match_at = |lag: usize| near.iter().zip(&far[lag..]).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        let best = (0..300).max_by(|a, b| match_at(*a).total_cmp(&match_at(*b))).expect("lags");
        let (lag, expected) = (best as f64 * 0.05, 30.0 / 6.0);
        assert!((lag / expected - 1.0).abs() < 0.05, "{lag} s for {expected} s");
    }

    #[test]
    fn a_period_is_kept_everywhere() {
        for speed in [0.5, 4.5, 17.0] {
            let wind = GustWind::new(GustWindOptions { speed, period: Some(10.0), ..GustWindOptions::default() });
            for i in 0..200_u16 {
                let p = Vec3::new(f32::from(i) * 1.7, f32::from(i % 13), f32::from(i) * -0.9);
                let t = f64::from(i) * 0.137;
                assert!(
                    (one(&wind, p, t) - one(&wind, p, t + 10.0)).length() < 1e-5 * math::narrow(speed) + 2e-6,
                    "{p} {t}"
                );
            }
        }
    }

    #[test]
    fn the_direction_wanders_and_turns_with_the_option() {
        let options =
            GustWindOptions { turbulence: 0.0, wander: 0.5, direction: Vec3::NEG_Z, ..GustWindOptions::default() };
        let wind = GustWind::new(options);
        let turns: Vec<f32> = (0..400_u16)
            .map(|k| {
                let u = one(&wind, Vec3::Y * 10.0, f64::from(k));
                math::narrow(math::atan2(f64::from(u.x), f64::from(-u.z)))
            })
            .collect();
        let (lo, hi) = turns.iter().fold((0.0_f32, 0.0_f32), |(a, b), v| (a.min(*v), b.max(*v)));
        assert!(lo < -0.1 && hi > 0.1 && lo > -0.51 && hi < 0.51, "{lo} {hi}");
    }
}
