//! Wind fields: the trait [`Wind`] gives the air velocity at any position and time.
//!
//! - Analytic winds: [`UniformWind`]; [`GustWind`], gusts and eddies that travel downwind and may repeat; [`SineWind`], the
//!   wind of [zhao-zhang] 3.1. [`ScaledWind`] and [`WindSum`] combine winds, [`WindOverLand`] lays one over hills,
//!   [`ShiftedWind`] is one on the clock of a simulation that started earlier, and [`LoopedWind`] makes one repeat.
//! - Simulated wind: [`LatticeSolver`], a lattice Boltzmann solver with solids in the flow (\[catkin\] 3), read frame by frame
//!   ([`InterpolatedWind`]) or recorded for a whole clip ([`RecordedWind`]).
//!
//! Space: world, metres, +Y up; time in seconds. Speeds are those at 10 m above the ground.
//! ```
//! use glam::Vec3;
//! use osier_wind::{GustWind, GustWindOptions, Wind, beaufort_speed};
//!
//! // A moderate breeze towards +X: sample the velocity at two heights.
//! let wind = GustWind::new(GustWindOptions { speed: beaufort_speed(4.0), ..GustWindOptions::default() });
//! let mut velocities = [Vec3::ZERO; 2];
//! wind.sample(&[Vec3::Y, Vec3::Y * 10.0], 0.0, &mut velocities);
//! assert!(wind.mean_at(Vec3::Y).x < wind.mean_at(Vec3::Y * 10.0).x);
//! ```

mod combine;
mod gradient_noise;
mod gust_wind;
mod land;
mod lattice;
mod noise_block;
mod sine_wind;
mod tuning;

use std::fmt::Debug;

use glam::Vec3;

pub use combine::{LoopedWind, ScaledWind, ShiftedWind, WindSum};
pub use gradient_noise::TimeNoise;
pub use gust_wind::{GustWind, GustWindOptions, fit_gust_length};
pub use land::WindOverLand;
pub use lattice::{
    GroundCondition, InletOptions, InletWind, InterpolatedWind, LatticeFault, LatticeMemory, LatticeOptions,
    LatticeSolver, LatticeStats, LatticeWarning, RecordedWind, RecordingOptions, SideCondition, WindProfile,
    WindSnapshot, lattice_fault,
};
pub use sine_wind::{SineWind, SineWindOptions};

/// Speed, m/s, below which a wind counts as calm.
pub const CALM_SPEED: f64 = 0.01;

/// A wind field: air velocity as a pure function of position and time.
pub trait Wind: Debug + Send + Sync {
    /// Air velocities, m/s, at `positions`, m, and time `t`, s. `out` has the length of `positions`.
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]);

    /// Mean velocity at 10 m above the ground, m/s.
    fn mean(&self) -> Vec3;

    /// Mean velocity at a position, m, in m/s. If the scene prescribes speed or direction over time: the largest speed, in the
    /// direction at t = 0.
    fn mean_at(&self, position: Vec3) -> Vec3;

    /// Mean velocity, m/s, at a position, m, that the scene prescribes for the time `t`, s. It equals [`Wind::mean_at`]
    /// unless speed or direction are prescribed over time. It is not an average over a time around `t`.
    fn mean_at_time(&self, position: Vec3, _t: f64) -> Vec3 {
        self.mean_at(position)
    }

    /// Whether [`Wind::mean_at_time`] depends on the time.
    fn has_varying_mean(&self) -> bool {
        false
    }

    /// Mean velocity at 10 m, m/s, that the scene prescribes for the time `t`, s. It equals [`Wind::mean`] unless speed
    /// or direction are prescribed over time. It is never 0 in a wind that blows at other times, so that it always has
    /// a direction. It is not an average over a time around `t`.
    fn prescribed_mean_at_time(&self, _t: f64) -> Vec3 {
        self.mean()
    }

    /// Time after which the field repeats everywhere, s; 0 if it never changes, `None` if it never repeats.
    fn period(&self) -> Option<f64>;
}

/// One constant velocity at all positions and times.
/// ```
/// use osier_wind::{UniformWind, Wind};
/// assert_eq!(UniformWind(glam::Vec3::X).period(), Some(0.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UniformWind(
    /// Velocity of the air at all positions and times, m/s.
    pub Vec3,
);

impl Wind for UniformWind {
    fn sample(&self, _: &[Vec3], _: f64, out: &mut [Vec3]) {
        out.fill(self.0);
    }

    fn mean(&self) -> Vec3 {
        self.0
    }

    fn mean_at(&self, _: Vec3) -> Vec3 {
        self.0
    }

    fn period(&self) -> Option<f64> {
        Some(0.0)
    }
}

/// Mean speed, m/s, of a Beaufort number, which may be a fraction: v = 0.836 B^(3/2), the scale's definition.
/// ```
/// assert!((osier_wind::beaufort_speed(4.0) - 6.7).abs() < 0.05);
/// ```
pub fn beaufort_speed(number: f64) -> f64 {
    0.836 * osier_base::math::pow(number.max(0.0), 1.5)
}

/// Power-law wind profile: speed at a height above the ground, m, divided by the speed at 10 m.
fn power_law(height: f32, power: f32) -> f32 {
    osier_base::math::pow_f32(height.max(tuning::MIN_PROFILE_HEIGHT) / 10.0, power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beaufort_numbers_are_the_table_of_the_scale() {
        let table = [(1.0, 0.8), (2.0, 2.4), (3.0, 4.3), (4.0, 6.7), (5.0, 9.3), (8.0, 18.9), (10.0, 26.4)];
        for (number, speed) in table {
            assert!((beaufort_speed(number) - speed).abs() < 0.06, "{number}: {}", beaufort_speed(number));
        }
        assert!(beaufort_speed(0.0) <= 0.0);
    }

    #[test]
    fn uniform_wind_is_uniform() {
        let mut out = [Vec3::ZERO; 2];
        UniformWind(Vec3::X).sample(&[Vec3::ZERO, Vec3::splat(9.0)], 3.0, &mut out);
        assert_eq!(out, [Vec3::X; 2]);
    }
}
