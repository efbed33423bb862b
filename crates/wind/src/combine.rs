//! Wind fields computed from other wind fields: scaled, summed, shifted in time, or made periodic.

use std::sync::Arc;

use glam::Vec3;

use super::Wind;
use super::tuning::LOOP_FADE;
use osier_base::math::narrow;

/// A wind with its velocities multiplied by a factor. Gusts still travel at the speed of the original wind.
#[derive(Debug, Clone)]
pub struct ScaledWind {
    /// The original wind; its period does not change.
    pub wind: Arc<dyn Wind>,
    /// Factor on all velocities, including the means.
    pub factor: f32,
}

impl Wind for ScaledWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        self.wind.sample(positions, t, out);
        out.iter_mut().for_each(|u| *u *= self.factor);
    }

    fn mean(&self) -> Vec3 {
        self.wind.mean() * self.factor
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.wind.mean_at(position) * self.factor
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.wind.mean_at_time(position, t) * self.factor
    }

    fn has_varying_mean(&self) -> bool {
        self.wind.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.wind.prescribed_mean_at_time(t) * self.factor
    }

    fn period(&self) -> Option<f64> {
        self.wind.period()
    }
}

/// The sum of the velocities of several winds.
/// ```
/// use std::sync::Arc;
///
/// use glam::Vec3;
/// use osier_wind::{ScaledWind, UniformWind, Wind, WindSum};
///
/// let breeze = Arc::new(UniformWind(Vec3::X));
/// let half = ScaledWind { wind: breeze.clone(), factor: 0.5 };
/// assert_eq!(WindSum(vec![breeze, Arc::new(half)]).mean(), Vec3::X * 1.5);
/// ```
#[derive(Debug, Clone)]
pub struct WindSum(
    /// The winds, added in this order.
    pub Vec<Arc<dyn Wind>>,
);

impl Wind for WindSum {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        // Add in the order of the list, so that sums have the same bits in every run.
        out.fill(Vec3::ZERO);
        let mut own = vec![Vec3::ZERO; positions.len()];
        for wind in &self.0 {
            wind.sample(positions, t, &mut own);
            out.iter_mut().zip(&own).for_each(|(u, v)| *u += *v);
        }
    }

    fn mean(&self) -> Vec3 {
        self.0.iter().map(|w| w.mean()).sum()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.0.iter().map(|w| w.mean_at(position)).sum()
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.0.iter().map(|w| w.mean_at_time(position, t)).sum()
    }

    fn has_varying_mean(&self) -> bool {
        self.0.iter().any(|w| w.has_varying_mean())
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.0.iter().map(|w| w.prescribed_mean_at_time(t)).sum()
    }

    /// The common period of all winds, if they have one; a steady wind (period 0) is compatible with any period.
    fn period(&self) -> Option<f64> {
        self.0.iter().map(|w| w.period()).try_fold(0.0, |common, own| {
            let own = own?;
            let agree = own <= 0.0 || common <= 0.0 || (own - common).abs() < 1e-9;
            agree.then_some(own.max(common))
        })
    }
}

/// A wind whose time 0 is the time `lead` of a simulation that started earlier.
/// ```
/// use std::sync::Arc;
///
/// use glam::Vec3;
/// use osier_wind::{GustWind, GustWindOptions, ShiftedWind, Wind};
///
/// let gusts = Arc::new(GustWind::new(GustWindOptions::default()));
/// let shifted = ShiftedWind { wind: gusts.clone(), lead: 5.0 };
/// let (mut a, mut b) = ([Vec3::ZERO], [Vec3::ZERO]);
/// gusts.sample(&[Vec3::Y], 0.0, &mut a);
/// shifted.sample(&[Vec3::Y], 5.0, &mut b);
/// assert_eq!(a, b);
/// ```
#[derive(Debug, Clone)]
pub struct ShiftedWind {
    /// The wind, sampled at the simulation's time minus `lead`.
    pub wind: Arc<dyn Wind>,
    /// Simulation time at which the wind is at its time 0, s.
    pub lead: f64,
}

impl Wind for ShiftedWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        self.wind.sample(positions, t - self.lead, out);
    }

    fn mean(&self) -> Vec3 {
        self.wind.mean()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.wind.mean_at(position)
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.wind.mean_at_time(position, t - self.lead)
    }

    fn has_varying_mean(&self) -> bool {
        self.wind.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.wind.prescribed_mean_at_time(t - self.lead)
    }

    fn period(&self) -> Option<f64> {
        self.wind.period()
    }
}

/// A wind that is made periodic: near the end of each period it cross-fades into the original wind before time 0, as a
/// [`RecordedWind`](super::RecordedWind) does in a loop.
#[derive(Debug, Clone)]
pub struct LoopedWind {
    /// The original wind. It is sampled from time 0 to `period`, and for the cross-fade in the last seconds before time
    /// 0.
    pub wind: Arc<dyn Wind>,
    /// Time after which it repeats, s, > 0.
    pub period: f64,
}

impl Wind for LoopedWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        let (time, fade_time) = (t.rem_euclid(self.period), LOOP_FADE.min(self.period));
        self.wind.sample(positions, time, out);
        let fade = narrow((1.0 + (time - self.period) / fade_time).clamp(0.0, 1.0));
        if fade > 0.0 {
            let mut before = vec![Vec3::ZERO; positions.len()];
            self.wind.sample(positions, time - self.period, &mut before);
            out.iter_mut().zip(&before).for_each(|(u, before)| *u = *u * (1.0 - fade) + *before * fade);
        }
    }

    fn mean(&self) -> Vec3 {
        self.wind.mean()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.wind.mean_at(position)
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.wind.mean_at_time(position, t.rem_euclid(self.period))
    }

    fn has_varying_mean(&self) -> bool {
        self.wind.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.wind.prescribed_mean_at_time(t.rem_euclid(self.period))
    }

    fn period(&self) -> Option<f64> {
        Some(self.period)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{GustWind, GustWindOptions, UniformWind};
    use super::*;

    #[test]
    fn velocities_are_scaled_and_added() {
        let gust =
            |period: Option<f64>| Arc::new(GustWind::new(GustWindOptions { period, ..GustWindOptions::default() }));
        let places: Vec<Vec3> = (0..100_u8).map(|i| Vec3::new(f32::from(i), 3.0, 0.0)).collect();
        let sample = |w: &dyn Wind| {
            let mut out = vec![Vec3::ONE; places.len()];
            w.sample(&places, 1.7, &mut out);
            out
        };
        let alone = sample(&*gust(None));
        let twice = ScaledWind { wind: gust(None), factor: 2.0 };
        assert!(sample(&twice).iter().zip(&alone).all(|(a, b)| *a == *b * 2.0));
        assert_eq!(twice.mean(), Vec3::X * 9.0);
        let both = WindSum(vec![gust(None), Arc::new(UniformWind(Vec3::Z * 3.0))]);
        assert!(sample(&both).iter().zip(&alone).all(|(a, b)| *a == *b + Vec3::Z * 3.0));
        assert_eq!((both.mean(), both.mean_at(Vec3::Y * 10.0)), (Vec3::new(4.5, 0.0, 3.0), Vec3::new(4.5, 0.0, 3.0)));
        assert_eq!(both.period(), None);
        let repeating = WindSum(vec![gust(Some(5.0)), Arc::new(UniformWind(Vec3::Z)), gust(Some(5.0))]);
        assert_eq!(repeating.period(), Some(5.0));
        assert_eq!(WindSum(vec![gust(Some(5.0)), gust(Some(4.0))]).period(), None);
    }

    #[test]
    fn a_looped_wind_repeats_without_a_jump() {
        let wind: Arc<dyn Wind> = Arc::new(GustWind::new(GustWindOptions::default()));
        let looped = LoopedWind { wind: Arc::clone(&wind), period: 5.0 };
        let at = |w: &dyn Wind, t: f64| {
            let mut out = [Vec3::ZERO];
            w.sample(&[Vec3::new(3.0, 5.0, 2.0)], t, &mut out);
            out[0]
        };
        assert_eq!(looped.period(), Some(5.0));
        // The first three seconds are those of the original wind; the last two cross-fade from it to its two seconds before time
        // 0.
        assert_eq!(at(&looped, 2.5), at(&*wind, 2.5));
        assert_eq!(at(&looped, 0.0), at(&*wind, 0.0));
        let halfway = (at(&*wind, 4.0) + at(&*wind, -1.0)) * 0.5;
        assert!(at(&looped, 4.0).distance(halfway) < 1e-5);
        for t in [0.5, 2.0, 4.5] {
            assert!(at(&looped, t).distance(at(&looped, t - 5.0)) < 1e-5 && at(&looped, t) == at(&looped, t + 5.0));
        }
        assert!(at(&looped, 5.0 - 1e-7).distance(at(&looped, 0.0)) < 1e-4);
    }
}
