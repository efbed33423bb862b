//! Tumbling: the tuft is dragged downstream, oscillates about that direction and is driven by random torque.

use glam::{Quat, Vec3};

use super::particles::{Catkin, CatkinState, flutter_key, flutter_seed};
use super::{CATKINS_PER_TASK, FlightSimulation};
use crate::flight::tuning::{
    AXIAL_SPIN, AXIAL_SPIN_TIME, DAMPING_RATIO, MAX_SPIN, MAX_TUMBLE_STEP, RANDOM_TORQUE, RANDOM_TORQUE_TIME,
    REST_DAMPING_TIME, SWING_HZ,
};
use osier_base::math::narrow;
use osier_base::rng;

/// Constants of one step of tumbling; pairs are the factor that is kept and the strength of the noise that is added.
struct TumbleStep {
    /// Length of the step of the flight, s, and the number and length, s, of the parts in which tufts rotate.
    dt: f32,
    parts: u16,
    part: f32,
    random_torque: [f32; 2],
    spin: [f32; 2],
    rest: f32,
    flutter: f32,
    glide: f32,
    /// Relaxation time over settling speed, s^2/m.
    time_per_speed: f32,
    /// Random key of this flight's tumbling.
    key: u64,
    step: u64,
    /// Time at the end of the step, s.
    now: f64,
}

/// How the relative wind at a body relaxes within a part of a step.
#[derive(Debug, Clone, Copy)]
struct FlowDecay {
    /// exp(-h/tau) over a part of h seconds.
    end: f32,
    /// Mean of exp(-t/tau) over the part.
    mean: f32,
}

impl FlowDecay {
    fn new(h: f32, tau: f32) -> Self {
        // Without inertia the relative wind is the lasting one at once.
        if tau <= 0.0 {
            return Self { end: 0.0, mean: 0.0 };
        }
        let end = osier_base::math::exp_f32(-h / tau);
        Self { end, mean: (1.0 - end) * tau / h }
    }
}

impl TumbleStep {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    fn new(flights: &FlightSimulation) -> Self {
        let options = &flights.options;
        let step = flights.time_step();
        let (dt, flutter) = (narrow(step), narrow(options.flutter));
        let keeps = |time: f32| osier_base::math::exp_f32(-dt / time);
        // Ornstein-Uhlenbeck step: keep exp(-dt/T), add sqrt(1 - keep^2) times the strength.
        let pair = |time: f32, strength: f32| {
            let keep = keeps(time);
            [keep, strength * flutter * osier_base::math::sqrt_f32(1.0 - keep * keep)]
        };
        // The tolerance of 1e-6 keeps a step of exactly the greatest length from being divided because of rounding.
        let parts = (step / MAX_TUMBLE_STEP - 1e-6).ceil().clamp(1.0, 1000.0) as u16;
        Self {
            dt,
            parts,
            part: dt / f32::from(parts),
            random_torque: pair(RANDOM_TORQUE_TIME, RANDOM_TORQUE),
            spin: pair(AXIAL_SPIN_TIME, AXIAL_SPIN),
            rest: keeps(REST_DAMPING_TIME),
            flutter,
            glide: narrow(options.glide),
            time_per_speed: narrow(options.relaxation_time(1.0)),
            key: flutter_seed(options.seed),
            step: flights.step,
            now: flights.seconds() + step,
        }
    }

    /// Rotates an airborne single by one step of the flight, in parts.
    fn tumble(&self, c: &mut Catkin) {
        let fall = narrow(c.fall);
        let decay = FlowDecay::new(self.part, self.time_per_speed * fall);
        let (a, b) = unit_noise(rng::child(flutter_key(self.key, c.id, c.generation), self.step));
        // Ornstein-Uhlenbeck noise: an exact step with correlation time and variance that do not depend on the step. Within the
        // step the torque changes linearly.
        let torque_before = c.random_torque;
        c.random_torque = torque_before * self.random_torque[0] + a * self.random_torque[1];
        let spin = c.omega.dot(c.tuft()) * self.spin[0] + b * self.spin[1];
        for part in 0..self.parts {
            let tuft = c.tuft();
            // The relative wind relaxes towards its steady value minus the glide along the tuft's present axis; the torque is
            // that of its mean over the part.
            let lasting = c.lasting_flow - Vec3::new(tuft.x, 0.0, tuft.z) * (self.glide * fall);
            let lag = c.flow - lasting;
            let flow = lasting + lag * decay.mean;
            c.flow = lasting + lag * decay.end;
            let speed = flow.length();
            let along = if speed < 0.05 { Vec3::Y } else { flow / speed };
            // Torsional pendulum about the direction of the relative wind; its frequency grows with the wind speed.
            let pace = (speed / fall.max(1e-6)).clamp(0.3, 3.0);
            let omega_n = std::f32::consts::TAU * SWING_HZ * pace * self.flutter;
            let random = torque_before.lerp(c.random_torque, (f32::from(part) + 0.5) / f32::from(self.parts));
            // Oscillation across the tuft's axis; free, slow spin about it.
            let across = c.omega - tuft * c.omega.dot(tuft);
            let torque = tuft.cross(along) * (omega_n * omega_n) + random;
            let damped = (across + (torque - tuft * torque.dot(tuft)) * self.part)
                * osier_base::math::exp_f32(-2.0 * DAMPING_RATIO * omega_n * self.part);
            c.omega = (damped + tuft * spin).clamp_length_max(MAX_SPIN);
            c.q = rotate_by(c.q, c.omega * self.part);
        }
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
                    // The angular velocity is set above, from its cluster.
                    CatkinState::Airborne if c.clustered => c.q = rotate_by(c.q, c.omega * tumble.dt),
                    // Catkins lift off and re-enter at the end of a step: they tumble from the next step on.
                    CatkinState::Airborne if !c.begins_flight => tumble.tumble(c),
                    _ => {
                        c.omega *= tumble.rest;
                        if c.state.is_deposited() {
                            c.q = rotate_by(c.q, c.omega * tumble.dt);
                            if c.rested < 0.0 {
                                c.rested = tumble.now;
                            }
                        }
                    }
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
