//! Drops in the air: terminal speed, drag and wind.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use crate::rain::tuning::MIN_TERMINAL_SPEED;
use osier_base::math;
use osier_base::physics::GRAVITY;
use osier_wind::Wind;

/// A drop at its emission, on the emission plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmittedDrop {
    /// Time of emission, s.
    pub t: f64,
    /// Position in the world, m.
    pub p: DVec3,
    /// Velocity: terminal speed, carried by the wind, m/s.
    pub v: DVec3,
    /// Volume of the drop, m^3.
    pub volume: f64,
}

/// Terminal speed of a raindrop of diameter `d`, m, in still air on Earth, m/s. Source: Atlas et al. 1973.
pub(crate) fn terminal_speed_on_earth(d: f64) -> f64 {
    (9.65 - 10.3 * math::exp(-600.0 * d)).max(MIN_TERMINAL_SPEED)
}

/// Terminal speed of a raindrop of diameter `d`, m, in still air under gravity `g`, m/s^2, in m/s: the coefficient g / vt^2 of its
/// quadratic drag is that of the air and does not depend on gravity.
pub(crate) fn terminal_speed(d: f64, g: f64) -> f64 {
    terminal_speed_on_earth(d) * math::sqrt(g / GRAVITY)
}

/// Volume of a sphere of diameter `d`, m: pi / 6 d^3, m^3.
pub fn sphere_volume(d: f64) -> f64 {
    PI / 6.0 * d * d * d
}

/// Diameter of a sphere of `volume`, m^3, in m; the inverse of [`sphere_volume`].
pub fn sphere_diameter(volume: f64) -> f64 {
    math::cbrt(volume * 6.0 / PI)
}

/// Velocity of a falling drop after a time step, m/s.
///
/// `v`: velocity before the step, m/s. `volume`: volume of the drop, m^3. `g`: gravity, m/s^2. `air`: velocity of the air, m/s.
/// `h`: time step, s.
/// Source: quadratic drag that balances gravity at terminal speed, a = -g |v| v / vt^2 with v relative to the air.
pub(crate) fn step_velocity(v: DVec3, volume: f64, g: f64, air: DVec3, h: f64) -> DVec3 {
    let relative = v - air;
    // Gravity is explicit; drag is implicit in the velocity with its coefficient k |v| at the old one, which is stable for any h:
    // v' = (v - g h) / (1 + h k |v|). The air's k = g / vt^2 is that of Earth, and drops without gravity are slowed down too.
    let vt = terminal_speed_on_earth(sphere_diameter(volume));
    let relative = (relative - DVec3::Y * (g * h)) / (1.0 + h * GRAVITY * relative.length() / (vt * vt));
    air + relative
}

/// Velocities of the air at positions, m/s; zero without wind.
pub(crate) fn sample_wind(wind: Option<&dyn Wind>, positions: &[Vec3], t: f64) -> Vec<Vec3> {
    let mut out = vec![Vec3::ZERO; positions.len()];
    if let Some(wind) = wind {
        wind.sample(positions, t, &mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_fall_at_their_own_speed() {
        for mm in [0.5, 1.0, 2.0, 5.0] {
            let d = mm * 1e-3;
            let mut v = DVec3::ZERO;
            (0..12_000).for_each(|_| v = step_velocity(v, sphere_volume(d), 9.81, DVec3::X * 2.0, 1e-3));
            assert!((v.y / -terminal_speed_on_earth(d) - 1.0).abs() < 0.01, "{mm}: {v}");
            assert!((v.x - 2.0).abs() < 0.01);
        }
    }

    #[test]
    fn drag_does_not_depend_on_gravity() {
        // Air at rest slows a fast drop down alike under any gravity; under a quarter of gravity it falls half as fast.
        let (volume, sideways) = (sphere_volume(2e-3), DVec3::X * 20.0);
        let [earth, moon] =
            [9.81, 1.62].map(|g| step_velocity(sideways, volume, g, DVec3::ZERO, 1e-4) + DVec3::Y * (g * 1e-4));
        assert!((earth - moon).length() < 1e-5 && earth.x < 19.995, "{earth} {moon}");
        let mut v = DVec3::ZERO;
        (0..12_000).for_each(|_| v = step_velocity(v, volume, 9.81 / 4.0, DVec3::ZERO, 1e-3));
        assert!((v.y / (-0.5 * terminal_speed_on_earth(2e-3)) - 1.0).abs() < 0.01, "{v}");
    }
}
