//! Lift-off: the wind resuspends deposits, the more easily the drier the ground.
//!
//! Own: the paper names the humidity and the "viscosity of the ground" without an equation. The threshold of a deposit
//! of n catkins is a wind at 0.1 m of u_t = u_t0 (1 + k h / (1 - h)) min(3, n^(1/3)). Above it lift-off is a random
//! process with the rate r (u / u_t - 1), as for the resuspension of particles by bursts of turbulence. Each lift-off
//! carries the deposit off the surface by at least [`MIN_HOP`] radii. A rate and a least height make their number
//! independent of the time step; with the threshold alone, deposits near it would lift off and land in every step.

use glam::{DVec3, Vec3};

use super::FlightSimulation;
use super::particles::CatkinState;
use crate::flight::tuning::{CREEP_SHARE, LIFT_HEIGHT, MIN_HOP, UPDRAFT_SHARE, UPDRAFT_TIME};
use osier_base::math::{cbrt, ln, narrow, sqrt};
use osier_base::rng::Rng;
use osier_wind::Wind;

/// A deposited single or cluster, with the quantities that its lift-off threshold depends on.
struct RestingDeposit {
    root: u32,
    count: usize,
    at: DVec3,
    radius: f64,
    /// Normal of the supporting surface; in a corner that of the ground.
    normal: Vec3,
    humidity: f64,
    wall: bool,
}

impl FlightSimulation {
    /// Lifts deposits off where the wind exceeds their threshold, and lets singles near it creep.
    pub(super) fn lift_off(&mut self, wind: &dyn Wind, t: f64) {
        let deposits = if self.present.deposited { self.resting_deposits() } else { Vec::new() };
        if deposits.is_empty() {
            return;
        }
        // Sample the wind 0.1 m above ground; at walls at the height to which the field is resolved, as nearer to the wall it
        // is blocked.
        let known = self.options.min_resolved_height.max(LIFT_HEIGHT);
        let above = |d: &RestingDeposit| {
            let (out, height) = if d.wall { (d.normal, known) } else { (Vec3::Y, LIFT_HEIGHT) };
            (d.at + out.as_dvec3() * (height - d.radius)).as_vec3()
        };
        let places: Vec<Vec3> = deposits.iter().map(above).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t, &mut air);
        let z0 = self.options.roughness;
        // Logarithmic law: u(0.1 m) / u(known).
        let down = ln((LIFT_HEIGHT + z0) / z0) / ln((known + z0) / z0);
        // On walls only the wind away from the wall counts, elsewhere the horizontal wind.
        let mut sum = 0.0;
        for (d, air) in deposits.iter().zip(&air) {
            let speed = if d.wall {
                f64::from(air.dot(d.normal).max(0.0)) * down
            } else {
                f64::from(Vec3::new(air.x, 0.0, air.z).length())
            };
            sum += speed;
            self.lift_or_creep(d, *air, speed, t);
        }
        self.counters.ground_wind = Some(sum / deposits.len() as f64);
    }

    fn resting_deposits(&self) -> Vec<RestingDeposit> {
        let rests = self.leader_ids(|c| c.state.is_deposited());
        rests
            .into_iter()
            .map(|id| {
                let c = self.catkin(id);
                let wall = c.state == CatkinState::OnWall;
                let ground = || self.options.humidity.at(c.x.as_vec3(), self.options.inside);
                // In a corner the wetter of both surfaces holds the deposit.
                let humidity = match c.state {
                    CatkinState::OnWall => self.face_humidity(c),
                    CatkinState::Corner => ground().max(self.face_humidity(c)),
                    _ => ground(),
                };
                let count = self.clusters.get(&c.id).map_or(1, |k| k.members.len());
                RestingDeposit {
                    root: c.id,
                    count,
                    at: c.x,
                    radius: f64::from(c.radius),
                    normal: if c.state == CatkinState::Corner { Vec3::Y } else { c.normal },
                    humidity,
                    wall,
                }
            })
            .collect()
    }

    /// Threshold wind at 0.1 m for a deposit, m/s.
    fn lift_off_threshold(&self, d: &RestingDeposit) -> f64 {
        if d.humidity >= 1.0 {
            return f64::INFINITY;
        }
        // Threshold u_t = u_t0 (1 + k h / (1 - h)) min(3, n^(1/3)): moisture h binds, larger deposits shelter themselves.
        let wet = 1.0 + self.options.lift_wet * d.humidity / (1.0 - d.humidity);
        self.options.lift_speed * wet * cbrt(d.count as f64).min(3.0)
    }

    /// Lifts a deposit off, or lets a single catkin creep, at time `t`, s. `air`: wind above it, m/s; `speed`: that wind at
    /// 0.1 m from the surface, m/s.
    fn lift_or_creep(&mut self, d: &RestingDeposit, air: Vec3, speed: f64, t: f64) {
        // Above the threshold a deposit lifts off at some time; a single creeps from half of it on until then.
        let least = self.lift_off_threshold(d);
        if speed > least && self.lifts_in_this_step(d.root, self.options.lift_rate * (speed / least - 1.0)) {
            let fall = self.clusters.get(&d.root).map_or_else(|| self.catkin(d.root).fall, |c| c.fall);
            let rise = updraft_to_height(MIN_HOP * d.radius, fall) + UPDRAFT_SHARE * (speed - least);
            self.take_off(d.root, fall + rise, t + self.time_step());
        } else if d.count == 1 && !d.wall && speed > least / 2.0 {
            // Along the surface, in the direction of the wind over it.
            let along = (air - d.normal * air.dot(d.normal)).normalize_or_zero().as_dvec3();
            self.slide_deposit(d.root, along * (CREEP_SHARE * (1.0 - d.humidity) * speed * self.time_step()));
        } else if !d.wall {
            self.stop_creeping(d.root);
        }
    }

    /// Advances a deposit's random lift-off by a step at the given rate, 1/s, and returns whether it takes place.
    fn lifts_in_this_step(&mut self, root: u32, rate: f64) -> bool {
        // The integral of the rate until the lift-off is exponentially distributed, whatever the time step.
        let (seed, dt) = (self.options.seed, self.time_step());
        let c = self.catkin_mut(root);
        if c.lift_exposure <= 0.0 {
            let address = ["flight".into(), c.id.into(), c.generation.into(), c.hops.into(), "lift".into()];
            c.lift_exposure = narrow(-ln(1.0 - Rng::at(seed, &address).unit_f64())).max(f32::MIN_POSITIVE);
        }
        // A catkin deposited within this step has rested for half of it on average. Its `rested` is still negative, since it is
        // set at the end of the step.
        let lain = if c.rested < 0.0 { 0.5 * dt } else { dt };
        c.lift_exposure -= narrow(rate * lain);
        c.lift_exposure <= 0.0
    }

    fn stop_creeping(&mut self, root: u32) {
        if self.catkin(root).v != DVec3::ZERO && self.catkin(root).target == super::particles::NO_TARGET {
            let members = self.clusters.get(&root).map_or_else(|| vec![root], |c| c.members.clone());
            members.iter().for_each(|id| self.catkin_mut(*id).v = DVec3::ZERO);
        }
    }

    /// Makes a deposit airborne at time `t`, s, with an updraft of initially `rise`, m/s.
    fn take_off(&mut self, root: u32, rise: f64, t: f64) {
        let members = self.clusters.get(&root).map_or_else(|| vec![root], |c| c.members.clone());
        self.counters.lift_offs += members.len() as u64;
        if let Some(c) = self.clusters.get_mut(&root) {
            (c.state, c.v, c.lift, c.lifted) = (CatkinState::Airborne, DVec3::ZERO, rise, t);
            c.loose = true;
        }
        for id in members {
            let c = self.catkin_mut(id);
            (c.state, c.v, c.target) = (CatkinState::Airborne, DVec3::ZERO, super::particles::NO_TARGET);
            (c.lift, c.lifted, c.lift_exposure, c.rested) = (rise, t, 0.0, -1.0);
            c.hops += 1;
            c.begins_flight = true;
            // The contacts of this step have been searched already: the path for the next search begins here.
            (c.free, c.travel) = (true, DVec3::ZERO);
        }
    }
}

/// Initial updraft in excess of the settling speed `fall`, m/s, that carries a catkin at least `height` m up in calm
/// air.
fn updraft_to_height(height: f64, fall: f64) -> f64 {
    // With the updraft (fall + e) exp(-t / T) the greatest height is T (e - fall ln(1 + e / fall)). Its inverse as a
    // series in y = sqrt(2 height / (T fall)), cut off where the next term is negative.
    let y = sqrt(2.0 * height / (UPDRAFT_TIME * fall));
    fall * y * (1.0 + y / 3.0 + y * y / 36.0)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::flight::{CatkinStart, FlightParams, ReleaseCondition};
    use osier_scene::solid::Solids;
    use osier_wind::UniformWind;

    /// A catkin that is released or lifts off tumbles in the wind at its position, not in calm air or in the wind of its last flight.
    #[test]
    fn flights_begin_in_the_wind_at_their_place() {
        let start = CatkinStart { at: DVec3::new(0.0, 5.0, 0.0), wait: ReleaseCondition::Until(0.0) };
        let mut all = FlightSimulation::new(FlightParams::default(), Arc::new(Solids::default()), &[start]);
        let wind = Vec3::new(3.0, 0.0, 1.0);
        let follows = |all: &FlightSimulation| all.catkin(0).flow.distance(wind) < 1e-6;
        all.advance_singles(&UniformWind(wind), 0.0);
        assert!(follows(&all), "{:?}", all.catkin(0).flow);
        let c = all.catkin_mut(0);
        (c.state, c.flow, c.q) = (CatkinState::Grounded, Vec3::splat(-9.0), glam::Quat::from_rotation_x(1.5));
        all.take_off(0, 0.5, 0.04);
        all.tumble_all();
        assert!(all.catkin(0).q.dot(glam::Quat::from_rotation_x(1.5)) > 1.0 - 1e-6, "it lifts off after the step");
        all.advance_singles(&UniformWind(wind), 0.04);
        assert!(follows(&all), "{:?}", all.catkin(0).flow);
    }

    /// Over dry ground in a wind of u at 0.1 m deposits lie for 1 / (r (u / u_t - 1)) on average, whatever the time step.
    #[test]
    fn the_time_at_rest_is_independent_of_the_step() {
        use crate::flight::{SideBoundary, SkyRelease, sky_starts};
        let mean_rest = |fps: f64| {
            // Alone: nothing sticks, and heaps attract nothing.
            let options = FlightParams {
                fps,
                edges: [SideBoundary::Periodic; 2],
                humidity: crate::flight::GroundHumidity::Even(0.0),
                stick_probability: 0.0,
                gamma: 1e4,
                ..FlightParams::default()
            };
            let band = [0.003, 0.02];
            let sky_box = SkyRelease { seed: 1, count: 1000, inside: options.inside, band, duration: 0.0 };
            let solids = Arc::new(Solids::new(Vec::new(), true));
            let starts = sky_starts(&sky_box, &solids);
            let mut all = FlightSimulation::new(options, solids, &starts);
            let mut lain = 0.0;
            while all.seconds() < 12.0 {
                all.advance_frame(&UniformWind(Vec3::X * 3.0));
                lain += all.stats().deposited() as f64 / fps;
            }
            assert!(all.stats().lift_offs > 1500, "{}", all.stats().lift_offs);
            lain / all.stats().lift_offs as f64
        };
        // The logarithmic law from 0.25 m down to 0.1 m over a roughness of 0.05 m; r = 1/s, u_t = 0.25 m/s.
        let speed = 3.0 * ln(0.15 / 0.05) / ln(0.3 / 0.05);
        let expected = 1.0 / (speed / 0.25 - 1.0);
        for fps in [12.0, 24.0, 96.0] {
            let rest = mean_rest(fps);
            assert!((rest / expected - 1.0).abs() < 0.08, "{rest} s at {fps} frames a second, not {expected} s");
        }
    }

    #[test]
    fn updraft_carries_to_its_height() {
        for fall in [0.1, 0.24, 1.0] {
            for height in [0.01, 0.04, 0.2] {
                let e = updraft_to_height(height, fall);
                let top = UPDRAFT_TIME * (e - fall * ln(1.0 + e / fall));
                assert!(top > height && top < 1.1 * height, "{top} for {height} at {fall}");
            }
        }
    }
}
