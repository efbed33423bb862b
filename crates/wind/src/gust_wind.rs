//! Gusts that travel downwind, with eddies in them.

use glam::Vec3;
use pulp::{Arch, Simd, WithSimd};

use super::gradient_noise::{ENDLESS, Place, noise1};
use super::noise_block::{BLOCK, Places, noise2, noise3};
use super::{CALM_SPEED, Wind, with_height};
use osier_base::math;
use osier_base::rng::Rng;

/// Root mean square of one component of the eddies' noise.
pub(super) const EDDY_RMS: f32 = 0.219;
/// Strongest eddy, in root mean squares.
const EDDY_MOST: f32 = 2.5;
/// Time in which the direction wanders, s.
const WANDER_TIME: f64 = 12.0;
/// Fewest cells in a period.
const FEWEST: f64 = 4.0;
/// Heights at which the profile is kept, four a metre.
const PROFILE: usize = 400;

/// What the wind is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GustWindOptions {
    /// Unit vector that it blows towards, level.
    pub direction: Vec3,
    /// Mean speed at 10 m, m/s, 0..60.
    pub speed: f64,
    /// Share of the mean that gusts add and take, 0..1; 0.3 to 0.5 is natural.
    pub gust: f32,
    /// Root mean square of the eddies over the mean, 0..1; 0.15 to 0.25 is natural.
    pub turbulence: f32,
    /// Length of gusts, m, 2..200.
    pub gust_length: f64,
    /// Size of eddies, m, 0.5..20.
    pub eddy_size: f64,
    /// How far the direction wanders, rad, 0..pi/2.
    pub wander: f32,
    /// Power of the height; 0 for the same wind at all heights.
    pub power: f32,
    /// Time after which everything repeats, s; none for a wind without end.
    pub period: Option<f64>,
    /// Seed of its noise.
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

/// Noise that a steady wind carries along: a length that fits the period, and the cells that make one.
#[derive(Debug, Clone, Copy)]
struct Carried {
    length: f64,
    cells: i32,
    seed: u32,
}

impl Carried {
    /// `length`: wanted size of a cell, m; a period makes it such that whole cells pass.
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

/// Length of gusts of which whole ones, at least four, pass in a period, m: the nearest to `length`, m.
/// `speed`: m/s; `period`: s.
pub fn fit_gust_length(length: f64, speed: f64, period: f64) -> f64 {
    let way = speed.max(CALM_SPEED) * period;
    way / (way / length).round().max(FEWEST)
}

/// Gusts and eddies in a mean wind that grows with height.
#[derive(Debug, Clone)]
pub struct GustWind {
    options: GustWindOptions,
    across: Vec3,
    gusts: Carried,
    eddies: Carried,
    /// Cells of the wandering in a period, and its seed.
    wander: (i32, u32),
    /// Share of the mean speed at quarters of a metre.
    profile: Vec<f32>,
}

impl GustWind {
    /// Prepares it.
    #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
    pub fn new(options: GustWindOptions) -> Self {
        let mut draw = Rng::at(options.seed, &["gustwind".into()]);
        let mut seed = || (draw.next_u64() >> 32) as u32;
        let speed = options.speed.max(CALM_SPEED);
        let cells = options.period.map_or(f64::from(ENDLESS), |t| (t / WANDER_TIME).round().max(FEWEST));
        Self {
            gusts: Carried::new(options.gust_length, speed, options.period, seed()),
            eddies: Carried::new(options.eddy_size, speed, options.period, seed()),
            wander: (cells as i32, seed()),
            across: options.direction.cross(Vec3::Y),
            profile: (0..=PROFILE).map(|i| with_height(i as f32 * 0.25, options.power)).collect(),
            options,
        }
    }

    fn height(&self, y: f32) -> f32 {
        let x = y.max(0.5) * 4.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 2 and PROFILE")]
        let k = x.min(PROFILE as f32) as usize;
        match (self.profile.get(k), self.profile.get(k + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (x - k as f32),
            _ => with_height(y, self.options.power),
        }
    }

    /// Direction of the moment.
    fn direction(&self, t: f64) -> Vec3 {
        let (cells, seed) = self.wander;
        let rate = self.options.period.map_or(WANDER_TIME.recip(), |p| f64::from(cells) / p);
        let turn = self.options.wander * noise1(seed, Place::new(t * rate, cells), cells);
        let o = &self.options;
        o.direction * math::cos_f32(turn) - self.across * math::sin_f32(turn)
    }
}

/// Air at many places of one moment.
struct Sample<'a> {
    wind: &'a GustWind,
    places: &'a [Vec3],
    t: f64,
    out: &'a mut [Vec3],
}

impl WithSimd for Sample<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let along = self.wind.direction(self.t);
        let frame = (along, along.cross(Vec3::Y));
        for (places, out) in self.places.chunks(BLOCK).zip(self.out.chunks_mut(BLOCK)) {
            self.wind.block(places, self.t, frame, out);
        }
    }
}

impl GustWind {
    /// u = U0 h(y) [max(0, 1 + g n1) w + I (n2x w + n2y Y / 2 + 0.7 n2z c)]: gusts of long, eddies of short waves, both
    /// carried along at the mean speed. At most [`BLOCK`] places.
    #[inline(always)]
    fn block(&self, places: &[Vec3], t: f64, (along, across): (Vec3, Vec3), out: &mut [Vec3]) {
        let (o, g, e) = (&self.options, &self.gusts, &self.eddies);
        let [mut x, mut y, mut z] = [[0.0; BLOCK]; 3];
        for (i, p) in places.iter().enumerate() {
            x[i] = f64::from(p.dot(o.direction)) - o.speed * t;
            y[i] = f64::from(p.y);
            z[i] = f64::from(p.dot(self.across));
        }
        let mut cells = [const { Places::ORIGIN }; 3];
        let (mut gusts, mut eddies) = ([0.0; BLOCK], [[0.0; BLOCK]; 3]);
        cells[0].set(&over(&x, g.length), g.cells);
        cells[1].set(&over(&z, 2.0 * g.length), ENDLESS);
        noise2(g.seed, [&cells[0], &cells[1]], &mut gusts);
        cells[0].set(&over(&x, e.length), e.cells);
        cells[1].set(&over(&y, e.length), ENDLESS);
        cells[2].set(&over(&z, e.length), ENDLESS);
        noise3(e.seed, [&cells[0], &cells[1], &cells[2]], &mut eddies);
        for (i, (u, p)) in out.iter_mut().zip(places).enumerate() {
            let eddy = [eddies[0][i], eddies[1][i], eddies[2][i]]
                .map(|n| o.turbulence * (n / EDDY_RMS).clamp(-EDDY_MOST, EDDY_MOST));
            let flow = (1.0 + o.gust * gusts[i]).max(0.0) + eddy[0];
            *u = (along * flow + Vec3::Y * (0.5 * eddy[1]) + across * (0.7 * eddy[2]))
                * (math::narrow(o.speed) * self.height(p.y));
        }
    }
}

#[inline(always)]
fn over(x: &[f64; BLOCK], length: f64) -> [f64; BLOCK] {
    let mut cells = [0.0; BLOCK];
    for (c, x) in cells.iter_mut().zip(x) {
        *c = x / length;
    }
    cells
}

impl Wind for GustWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        Arch::new().dispatch(Sample { wind: self, places, t, out });
    }

    fn mean(&self) -> Vec3 {
        self.options.direction * math::narrow(self.options.speed)
    }

    fn mean_at(&self, height: f32) -> Vec3 {
        self.mean() * self.height(height)
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
            // Many places instead of one for a long time: the same average, sooner.
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
            arch.dispatch(Sample { wind: &wind, places: &places, t: 1.3, out: &mut out });
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
