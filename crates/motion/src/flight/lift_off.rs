//! Lift-off: the wind resuspends deposits, the more easily the drier the ground.
//!
//! Own: the paper names the humidity and the "viscosity of the ground" without an equation. A deposit of n catkins
//! lifts off when the wind at 0.1 m exceeds u_t0 (1 + k h / (1 - h)) min(3, n^(1/3)).

use glam::{DVec3, Vec3};

use super::FlightSimulation;
use super::particles::CatkinState;
use crate::flight::tuning::{CREEP_SHARE, LIFT_HEIGHT, UPDRAFT_SHARE};
use osier_base::math::{cbrt, ln};
use osier_wind::Wind;

/// A deposited single or cluster, with what its threshold depends on.
struct RestingDeposit {
    root: u32,
    count: usize,
    at: DVec3,
    radius: f64,
    normal: Vec3,
    humidity: f64,
    wall: bool,
}

impl FlightSimulation {
    /// Lifts deposits above their threshold, and lets singles near it creep.
    pub(super) fn lift_off(&mut self, wind: &dyn Wind, t: f64) {
        let deposits = if self.present.deposited { self.resting_deposits() } else { Vec::new() };
        if deposits.is_empty() {
            return;
        }
        // Sample the wind at the height where it is resolved, along the surface normal for wall deposits.
        let height = self.options.known_height.max(LIFT_HEIGHT);
        let above = |d: &RestingDeposit| {
            let out = if d.wall { d.normal } else { Vec3::Y }.as_dvec3();
            (d.at + out * (height - d.radius)).as_vec3()
        };
        let places: Vec<Vec3> = deposits.iter().map(above).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t, &mut air);
        let z0 = self.options.roughness;
        // Logarithmic law: u(0.1 m) / u(height).
        let down = ln((LIFT_HEIGHT + z0) / z0) / ln((height + z0) / z0);
        // On walls only the wind away from the wall counts, elsewhere the horizontal wind.
        let mut sum = 0.0;
        for (d, air) in deposits.iter().zip(&air) {
            let speed = if d.wall { air.dot(d.normal).max(0.0) } else { Vec3::new(air.x, 0.0, air.z).length() };
            let speed = f64::from(speed) * down;
            sum += speed;
            self.lift_or_creep(d, *air, speed, t);
        }
        self.counters.ground_wind = sum / deposits.len() as f64;
    }

    fn resting_deposits(&self) -> Vec<RestingDeposit> {
        let rests = self.leader_ids(|c| c.state.is_deposited());
        rests
            .into_iter()
            .map(|id| {
                let c = self.catkin(id);
                let wall = c.state == CatkinState::OnWall;
                let ground = || self.options.humidity.at(c.x.as_vec3(), self.options.inside);
                // In a corner the wetter surface holds.
                let humidity = match c.state {
                    CatkinState::OnWall => self.wall_humidity(c.face),
                    CatkinState::Corner => ground().max(self.wall_humidity(c.face)),
                    _ => ground(),
                };
                let count = self.clusters.get(&c.id).map_or(1, |k| k.members.len());
                RestingDeposit {
                    root: c.id,
                    count,
                    at: c.x,
                    radius: f64::from(c.radius),
                    normal: c.normal,
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
        // Above the threshold a deposit lifts off; a single creeps from half of it on.
        let least = self.lift_off_threshold(d);
        if speed > least {
            let fall = self.clusters.get(&d.root).map_or_else(|| self.catkin(d.root).fall, |c| c.fall);
            self.take_off(d.root, fall + UPDRAFT_SHARE * (speed - least), t);
        } else if d.count == 1 && !d.wall && speed > least / 2.0 {
            let level = Vec3::new(air.x, 0.0, air.z).normalize_or_zero().as_dvec3();
            self.slide_deposit(d.root, level * (CREEP_SHARE * (1.0 - d.humidity) * speed * self.options.time_step()));
        } else if !d.wall {
            self.stop_creeping(d.root);
        }
    }

    fn stop_creeping(&mut self, root: u32) {
        if self.catkin(root).v != DVec3::ZERO && self.catkin(root).target == super::particles::NO_TARGET {
            let members = self.clusters.get(&root).map_or_else(|| vec![root], |c| c.members.clone());
            members.iter().for_each(|id| self.catkin_mut(*id).v = DVec3::ZERO);
        }
    }

    /// Makes a deposit airborne with an updraft of initially `rise`, m/s.
    fn take_off(&mut self, root: u32, rise: f64, t: f64) {
        self.counters.lift_offs += 1;
        let members = self.clusters.get(&root).map_or_else(|| vec![root], |c| c.members.clone());
        if let Some(c) = self.clusters.get_mut(&root) {
            (c.state, c.v, c.lift, c.lifted) = (CatkinState::Airborne, DVec3::ZERO, rise, t);
            c.loose = true;
        }
        for id in members {
            let c = self.catkin_mut(id);
            (c.state, c.v, c.target) = (CatkinState::Airborne, DVec3::ZERO, super::particles::NO_TARGET);
            (c.lift, c.lifted, c.from, c.since) = (rise, t, c.x, t);
            c.rested = -1.0;
        }
    }
}
