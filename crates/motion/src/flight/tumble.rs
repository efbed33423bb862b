//! Tumbling: the tuft is dragged downstream, oscillates about that direction and is driven by random torque.

use glam::{Quat, Vec3};

use super::particles::{Catkin, CatkinState, flutter_key, flutter_seed};
use super::{CATKINS_PER_TASK, FlightSimulation};
use crate::flight::tuning::{
    AXIAL_SPIN, AXIAL_SPIN_TIME, DAMPING_RATIO, MAX_SPIN, RANDOM_TORQUE, RANDOM_TORQUE_TIME, REST_DAMPING_TIME,
    SWING_HZ,
};
use osier_base::math::narrow;
use osier_base::rng;

/// Constants of one step of tumbling; pairs are the factor that is kept and the strength of the noise that is added.
struct TumbleStep {
    dt: f32,
    random_torque: [f32; 2],
    spin: [f32; 2],
    rest: f32,
    flutter: f32,
    /// Random key of this flight's tumbling.
    key: u64,
    step: u64,
    /// Time at the end of the step, s.
    now: f64,
}

impl TumbleStep {
    fn new(flights: &FlightSimulation) -> Self {
        let dt = narrow(flights.options.time_step());
        let keeps = |time: f32| osier_base::math::exp_f32(-dt / time);
        // Ornstein-Uhlenbeck step: keep exp(-dt/T), add sqrt(1 - keep^2) times the strength.
        let pair = |time: f32, strength: f32| {
            let keep = keeps(time);
            [keep, strength * narrow(flights.options.flutter) * osier_base::math::sqrt_f32(1.0 - keep * keep)]
        };
        Self {
            dt,
            random_torque: pair(RANDOM_TORQUE_TIME, RANDOM_TORQUE),
            spin: pair(AXIAL_SPIN_TIME, AXIAL_SPIN),
            rest: keeps(REST_DAMPING_TIME),
            flutter: narrow(flights.options.flutter),
            key: flutter_seed(flights.options.seed),
            step: flights.step,
            now: flights.seconds() + flights.options.time_step(),
        }
    }

    fn tumble(&self, c: &mut Catkin) {
        let tuft = c.tuft();
        let speed = c.flow.length();
        let along = if speed < 0.05 { Vec3::Y } else { c.flow / speed };
        // Torsional pendulum about the direction of the relative wind; its frequency grows with the wind speed.
        let pace = (speed / narrow(c.fall).max(1e-6)).clamp(0.3, 3.0);
        let omega_n = std::f32::consts::TAU * SWING_HZ * pace * self.flutter;
        let (a, b) = unit_noise(rng::child(flutter_key(self.key, c.id, c.generation), self.step));
        // Ornstein-Uhlenbeck noise: an exact step with correlation time and variance that do not depend on the step.
        c.random_torque = c.random_torque * self.random_torque[0] + a * self.random_torque[1];
        // Free, slow spin about the tuft's axis; oscillation across it.
        let spin = c.omega.dot(tuft) * self.spin[0] + b * self.spin[1];
        let across = c.omega - tuft * c.omega.dot(tuft);
        let torque = tuft.cross(along) * (omega_n * omega_n) + c.random_torque;
        let damped = (across + (torque - tuft * torque.dot(tuft)) * self.dt)
            * osier_base::math::exp_f32(-2.0 * DAMPING_RATIO * omega_n * self.dt);
        c.omega = (damped + tuft * spin).clamp_length_max(MAX_SPIN);
    }
}

impl FlightSimulation {
    pub(super) fn tumble_all(&mut self) {
        let tumble = TumbleStep::new(self);
        // Members do not tumble: they have the angular velocity of their cluster.
        let clusters = std::mem::take(&mut self.clusters);
        for cluster in clusters.values().filter(|c| c.state == CatkinState::Airborne) {
            cluster.members.iter().for_each(|id| self.catkin_mut(*id).omega = cluster.omega);
        }
        self.clusters = clusters;
        let mut chunks: Vec<&mut [Catkin]> = self.catkins.chunks_mut(CATKINS_PER_TASK).collect();
        osier_base::par::par_each(&mut chunks, |chunk| {
            for c in chunk.iter_mut() {
                match c.state {
                    // Set above, from its cluster.
                    CatkinState::Airborne if c.clustered => {}
                    CatkinState::Airborne => tumble.tumble(c),
                    _ => {
                        c.omega *= tumble.rest;
                        if c.state.is_deposited() && c.rested < 0.0 {
                            c.rested = tumble.now;
                        }
                    }
                }
                if c.state.is_seen() {
                    c.q = rotate_by(c.q, c.omega * tumble.dt);
                }
            }
        });
    }
}

/// `q` turned by a small rotation vector, rad: exp(r/2) q by its series.
pub(super) fn rotate_by(q: Quat, r: Vec3) -> Quat {
    let half = r * 0.5;
    let s = half.length_squared();
    // Terms up to the seventh power of |half|: the truncation error is below 1e-7 for rotations up to 1 rad.
    let sinc = 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0));
    let cos = 1.0 - s / 2.0 * (1.0 - s / 12.0 * (1.0 - s / 30.0));
    let v = half * sinc;
    (Quat::from_xyzw(v.x, v.y, v.z, cos) * q).normalize()
}

/// A vector of three random numbers and one more, nearly normal with unit variance: sums of four uniform draws of 16 bits.
#[allow(clippy::cast_possible_truncation, reason = "16 bits of 64")]
fn unit_noise(key: u64) -> (Vec3, f32) {
    let sum = |bits: u64| {
        let parts = [bits, bits >> 16, bits >> 32, bits >> 48].map(|b| f32::from(b as u16));
        ((parts[0] + parts[1]) + (parts[2] + parts[3]) - 2.0 * 65_535.0) * (1.732_050_8 / 65_536.0)
    };
    let at = |i: u64| sum(rng::child(key, i));
    (Vec3::new(at(0), at(1), at(2)), at(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_zero_mean_and_unit_variance() {
        let n = 50_000_u32;
        let (mut sum, mut square) = (Vec3::ZERO, Vec3::ZERO);
        for i in 0..n {
            let (v, _) = unit_noise(rng::child(7, u64::from(i)));
            (sum, square) = (sum + v, square + v * v);
        }
        let (mean, variance) = (sum / n as f32, square / n as f32);
        assert!(mean.abs().max_element() < 0.02 && (variance - 1.0).abs().max_element() < 0.03, "{mean} {variance}");
    }

    #[test]
    fn rotation_series_matches_the_exact_rotation() {
        let q = Quat::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        let r = Vec3::new(0.2, -0.3, 0.35);
        let wanted = Quat::from_scaled_axis(r) * q;
        assert!(rotate_by(q, r).dot(wanted) > 1.0 - 1e-6);
    }
}
