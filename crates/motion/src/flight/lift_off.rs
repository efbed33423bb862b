//! Wind takes up again what lies, the more easily the drier the ground.
//!
//! Own: the paper names the humidity and the "viscosity of the ground" without an equation. A deposit of n leaves when the
//! wind at 0.1 m passes u_t0 (1 + k h / (1 - h)) min(3, n^(1/3)).

use glam::{DVec3, Vec3};

use super::Flights;
use super::particles::State;
use osier_base::math::{cbrt, ln};
use osier_wind::Wind;

/// Height at which lift-off asks for the wind, m.
const ASKED: f64 = 0.1;

/// Share of the wind's speed that a dry single creeps with.
const CREEP: f64 = 0.3;

/// Rising air at lift-off: this much of what the wind has too much.
const RISE: f64 = 0.5;

/// A single or a cluster at rest.
struct Deposit {
    root: u32,
    count: usize,
    at: DVec3,
    radius: f64,
    normal: Vec3,
    humidity: f64,
    wall: bool,
}

impl Flights {
    /// Takes off what the wind can lift, and moves what it nearly can.
    pub(super) fn lift_off(&mut self, wind: &dyn Wind, t: f64) {
        let deposits = if self.about.deposited { self.deposits() } else { Vec::new() };
        if deposits.is_empty() {
            return;
        }
        let height = self.options.known_height.max(ASKED);
        let above = |d: &Deposit| {
            let out = if d.wall { d.normal } else { Vec3::Y }.as_dvec3();
            (d.at + out * (height - d.radius)).as_vec3()
        };
        let places: Vec<Vec3> = deposits.iter().map(above).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        wind.sample(&places, t, &mut air);
        let z0 = self.options.roughness;
        // By the logarithmic law, from where the wind is known.
        let down = ln((ASKED + z0) / z0) / ln((height + z0) / z0);
        let mut sum = 0.0;
        for (d, air) in deposits.iter().zip(&air) {
            let speed = if d.wall { air.dot(d.normal).max(0.0) } else { Vec3::new(air.x, 0.0, air.z).length() };
            let speed = f64::from(speed) * down;
            sum += speed;
            self.answer(d, (*air, speed), t);
        }
        self.events.ground_wind = sum / deposits.len() as f64;
    }

    fn deposits(&self) -> Vec<Deposit> {
        let rests = self.leaders(|c| c.state.is_deposited());
        rests
            .into_iter()
            .map(|id| {
                let c = self.at(id);
                let wall = c.state == State::OnWall;
                let ground = || self.options.humidity.at(c.x.as_vec3(), self.options.inside);
                let humidity = match c.state {
                    State::OnWall => self.wall_humidity(c.face),
                    State::Corner => ground().max(self.wall_humidity(c.face)),
                    _ => ground(),
                };
                let count = self.clusters.get(&c.id).map_or(1, |k| k.members.len());
                Deposit { root: c.id, count, at: c.x, radius: f64::from(c.radius), normal: c.normal, humidity, wall }
            })
            .collect()
    }

    /// Wind at 0.1 m that lifts a deposit, m/s.
    fn threshold(&self, d: &Deposit) -> f64 {
        if d.humidity >= 1.0 {
            return f64::INFINITY;
        }
        let wet = 1.0 + self.options.lift_wet * d.humidity / (1.0 - d.humidity);
        self.options.lift_speed * wet * cbrt(d.count as f64).min(3.0)
    }

    fn answer(&mut self, d: &Deposit, (air, speed): (Vec3, f64), t: f64) {
        let least = self.threshold(d);
        if speed > least {
            let fall = self.clusters.get(&d.root).map_or_else(|| self.at(d.root).fall, |c| c.fall);
            self.take_off(d.root, fall + RISE * (speed - least), t);
        } else if d.count == 1 && !d.wall && speed > least / 2.0 {
            let level = Vec3::new(air.x, 0.0, air.z).normalize_or_zero().as_dvec3();
            self.shift(d.root, level * (CREEP * (1.0 - d.humidity) * speed * self.options.step()));
        } else if !d.wall {
            self.still(d.root);
        }
    }

    fn still(&mut self, root: u32) {
        if self.at(root).v != DVec3::ZERO && self.at(root).target == super::particles::NOBODY {
            let members = self.clusters.get(&root).map_or_else(|| vec![root], |c| c.members.clone());
            members.iter().for_each(|id| self.at_mut(*id).v = DVec3::ZERO);
        }
    }

    /// Into the air again, with air that rises at `rise`, m/s, and dies away.
    fn take_off(&mut self, root: u32, rise: f64, t: f64) {
        self.events.lift_offs += 1;
        let members = self.clusters.get(&root).map_or_else(|| vec![root], |c| c.members.clone());
        if let Some(c) = self.clusters.get_mut(&root) {
            (c.state, c.v, c.lift, c.lifted) = (State::Airborne, DVec3::ZERO, rise, t);
            c.loose = true;
        }
        for id in members {
            let c = self.at_mut(id);
            (c.state, c.v, c.target) = (State::Airborne, DVec3::ZERO, super::particles::NOBODY);
            (c.lift, c.lifted, c.from, c.since) = (rise, t, c.x, t);
            c.rested = -1.0;
        }
    }
}
