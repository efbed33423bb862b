//! Moving air: one interface for everything that it moves.
//!
//! [`UniformWind`] is the same everywhere, [`GustWind`] travels and can repeat, [`SineWind`] is the periodic wind of
//! [zhao-zhang] 3.1, [`LatticeSolver`] flows round what stands in it (\[catkin\] 3): streamed frame by frame ([`InterpolatedWind`]) or kept
//! for a whole clip ([`RecordedWind`]). Space: world, metres, +Y up; time in seconds. Speeds are those at 10 m above the ground.

mod combine;
mod gradient_noise;
mod gust_wind;
mod lattice;
mod noise_block;
mod sine_wind;

use std::fmt::Debug;

use glam::Vec3;

pub use combine::{ScaledWind, WindSum};
pub use gradient_noise::TimeNoise;
pub use gust_wind::{GustWind, GustWindOptions, fit_gust_length};
pub use lattice::{
    GroundCondition, InletOptions, InletWind, InterpolatedWind, LatticeMemory, LatticeOptions, LatticeSolver,
    LatticeStats, LatticeWarning, RecordedWind, RecordingOptions, SideCondition, WindProfile, WindSnapshot,
};
pub use sine_wind::{SineWind, SineWindOptions};

/// Slower wind is none at all, m/s.
pub const CALM_SPEED: f64 = 0.01;

/// Air velocity as a pure function of place and time.
pub trait Wind: Debug + Send + Sync {
    /// Air velocity in m/s at `places` (m) and time `t` (s). `out` is as long as `places`.
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]);

    /// Mean velocity at 10 m, m/s.
    fn mean(&self) -> Vec3;

    /// Mean velocity at a height above the ground, m/s.
    fn mean_at(&self, height: f32) -> Vec3;

    /// Time after which it repeats everywhere, s.
    fn period(&self) -> Option<f64>;
}

/// The same everywhere and always.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UniformWind(
    /// Velocity, m/s.
    pub Vec3,
);

impl Wind for UniformWind {
    fn sample(&self, _: &[Vec3], _: f64, out: &mut [Vec3]) {
        out.fill(self.0);
    }

    fn mean(&self) -> Vec3 {
        self.0
    }

    fn mean_at(&self, _: f32) -> Vec3 {
        self.0
    }

    fn period(&self) -> Option<f64> {
        Some(0.0)
    }
}

/// Mean speed of a number of Beaufort's scale, fractions allowed, m/s: v = 0.836 B^(3/2), the scale's definition.
pub fn beaufort_speed(number: f64) -> f64 {
    0.836 * osier_base::math::pow(number.max(0.0), 1.5)
}

/// The part of a mean speed that is left at a height above the ground: (y / 10 m)^power, y at least 0.5 m.
fn with_height(height: f32, power: f32) -> f32 {
    osier_base::math::pow_f32(height.max(0.5) / 10.0, power)
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
