//! Singles are drawn to clusters and pile up (\[catkin\] 4.3, eq. 14).
//!
//! The paper moves a single by its distance d times F = e^(-gamma d^2) every 0.3 s. Here F is fixed at such ticks and the
//! way between them is walked evenly in the logarithm: x += (1 - (1 - F)^(dt / T)) (target - x). At ticks both agree for
//! any step; taking F anew in every step would make the result hang on the step.

use glam::{DVec3, Vec3};

use super::deposit::{Path, hold, out_of};
use super::grid::Grid;
use super::particles::{Catkin, NOBODY, State};
use super::{CHUNK, Flights};
use osier_base::math::{exp, ln, narrow};
use osier_base::par::par_map;

/// Rounds in which a joiner is pushed out of those that it lies in.
const ROUNDS: u32 = 8;

/// Times closer than this are the same, s.
const SAME: f64 = 1e-9;

/// Whether a cluster's member draws a single: on the ground, at one wall, or out of the air into a corner.
fn draws(single: &Catkin, member: &Catkin) -> bool {
    use State::{Airborne, Corner, Grounded, OnWall};
    match (single.state, member.state) {
        (Grounded | Corner, Grounded | Corner) | (Airborne, Corner) => true,
        (OnWall | Corner, OnWall | Corner) => single.face == member.face && single.normal.dot(member.normal) > 0.99,
        _ => false,
    }
}

/// Part of a way that keeps to what a single lies on.
fn along(single: &Catkin, way: DVec3) -> DVec3 {
    let normal = match single.state {
        State::Grounded | State::Corner => Vec3::Y,
        State::OnWall => single.normal,
        _ => return way,
    }
    .as_dvec3();
    way - normal * way.dot(normal)
}

impl Flights {
    /// Moves singles towards what draws them, over this step, in parts between the ticks in it.
    pub(super) fn attract(&mut self, t: f64) {
        let (tick, end) = (self.options.tick, t + self.options.step());
        let mut now = t;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ticks of a clip")]
        let mut next = ((t - SAME) / tick).ceil().max(0.0) as u64;
        while next as f64 * tick < end - SAME {
            let at = next as f64 * tick;
            if at > now + SAME {
                self.draw(at - now, at);
                now = at;
            }
            self.choose();
            next += 1;
        }
        self.draw(end - now, end);
    }

    /// Fixes for every single whom it is drawn to, and how strongly.
    fn choose(&mut self) {
        let reach = self.options.reach();
        let members = self.clusters.values().filter(|c| c.state.is_deposited()).flat_map(|c| &c.members);
        let grid = Grid::new(narrow(reach), members.map(|id| (*id, self.at(*id).x.as_vec3())));
        let corners = self.clusters.values().any(|c| c.state == State::Corner);
        let gamma = self.options.gamma;
        if grid.is_empty() && !self.drawn {
            return;
        }
        let chunks: Vec<&[Catkin]> = self.catkins.chunks(CHUNK).collect();
        let chosen: Vec<Vec<(u32, f64)>> = par_map(&chunks, |chunk| {
            let one = |c: &Catkin| {
                let may = c.state.is_deposited() || (corners && c.state == State::Airborne);
                if grid.is_empty() || !may || c.clustered {
                    return (NOBODY, 0.0);
                }
                self.nearest_of(c, &grid, reach).map_or((NOBODY, 0.0), |(square, id)| {
                    // ln(1 - F)
                    (id, ln(-osier_base::math::exp_m1(-gamma * square)))
                })
            };
            chunk.iter().map(one).collect()
        });
        self.drawn = false;
        for (c, (target, pull)) in self.catkins.iter_mut().zip(chosen.into_iter().flatten()) {
            (c.target, c.pull) = (target, pull);
            self.drawn |= target != NOBODY;
        }
    }

    /// The nearest member that draws it, by square of the distance, ties by number.
    fn nearest_of(&self, c: &Catkin, grid: &Grid, reach: f64) -> Option<(f64, u32)> {
        let (at, arm) = (c.x.as_vec3(), Vec3::splat(narrow(reach)));
        let mut best: Option<(f64, u32)> = None;
        grid.each(at - arm, at + arm, |id| {
            let member = self.at(id);
            let square = member.x.distance_squared(c.x);
            let nearer = best.is_none_or(|(d, i)| (square, id) < (d, i));
            if square <= reach * reach && nearer && draws(c, member) {
                best = Some((square, id));
            }
        });
        best
    }

    /// Moves what is drawn for a time `dt` and joins what arrives.
    fn draw(&mut self, dt: f64, t: f64) {
        let drawn = if self.drawn { self.leaders(|c| c.target != NOBODY) } else { Vec::new() };
        if dt <= SAME || drawn.is_empty() {
            return;
        }
        let moved: Vec<Option<DVec3>> = par_map(&drawn, |id| {
            let c = self.at(*id);
            let target = self.at(c.target);
            if !draws(c, target) {
                return None;
            }
            let share = 1.0 - exp(c.pull * dt / self.options.tick);
            let way = along(c, (target.x - c.x) * share);
            let (gone, _) = Path { from: c.x, way, radius: c.radius }.trace(&self.solids);
            Some(out_of(&self.solids, c.x + way * gone, c.radius))
        });
        for (id, at) in drawn.into_iter().zip(moved) {
            let step = self.options.step();
            let solids = std::sync::Arc::clone(&self.solids);
            let c = self.at_mut(id);
            let Some(at) = at else {
                c.target = NOBODY;
                continue;
            };
            c.travel += at - c.x;
            if c.state.is_deposited() {
                c.v = (at - c.x) / step;
                if let Some(hold) = hold(&solids, at, c.radius) {
                    c.rest_on(hold);
                }
            }
            c.x = at;
            let (target, radius) = (c.target, f64::from(c.radius));
            let other = self.at(target);
            if other.x.distance(at) <= self.options.stick_close * (radius + f64::from(other.radius)) {
                self.pile(id, target, t);
            }
        }
    }

    /// A single joins a cluster and finds a place on it.
    fn pile(&mut self, id: u32, target: u32, t: f64) {
        let root = self.at(target).root;
        let (mut at, radius) = (self.at(id).x, self.at(id).radius);
        let near = |m: &&u32| self.at(**m).x.distance(at) < 8.0 * f64::from(radius);
        let members: Vec<u32> =
            self.clusters.get(&root).iter().flat_map(|c| &c.members).filter(near).copied().collect();
        for _ in 0..ROUNDS {
            for other in members.iter().map(|m| self.at(*m)) {
                let way = at - other.x;
                let least = self.options.stick_close * f64::from(radius + other.radius);
                let far = way.length();
                if far < least {
                    at += way.try_normalize().unwrap_or(DVec3::Y) * (least - far);
                }
            }
            at = out_of(&self.solids, at, radius);
        }
        self.at_mut(id).x = at;
        self.join(id, target, t);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{Options, Start, Wait};
    use super::*;
    use osier_scene::solid::Solids;
    use osier_wind::UniformWind;

    /// A pair on the ground and a single 0.8 m away; after five ticks it is where the paper's steps have it.
    fn after_five_ticks(fps: f64) -> f64 {
        let options = Options {
            fps,
            humidity: super::super::Humidity::Even(1.0),
            scales: [1.0, 1.0],
            fall_spread: 0.0,
            check_every: 1,
            ..Options::default()
        };
        let radius = options.kinds[0].radius;
        let places = [0.0, 0.03, 0.83].map(|x| DVec3::new(x, f64::from(radius), 0.0));
        let starts = places.map(|at| Start { at, wait: Wait::Until(0.0) });
        let mut flights = Flights::new(options, Arc::new(Solids::new(Vec::new(), true)), &starts);
        for c in &mut flights.catkins {
            c.state = State::Grounded;
            c.stirred = true;
        }
        flights.join(0, 1, 0.0);
        let still = UniformWind(Vec3::ZERO);
        while flights.seconds() < 1.5 - SAME {
            flights.advance(&still);
        }
        flights.at(2).x.x - flights.at(1).x.x
    }

    #[test]
    fn the_way_does_not_hang_on_the_step() {
        // d <- d (1 - e^(-gamma d^2)), five times.
        let paper = (0..5).fold(0.8, |d: f64, _| d * (1.0 - exp(-4.605 * d * d)));
        assert!((paper - 0.3879).abs() < 1e-4, "{paper}");
        for fps in [1.0 / 0.3, 10.0, 24.0, 60.0] {
            let left = after_five_ticks(fps);
            assert!((left - paper).abs() < 1e-4, "{left} at {fps} frames a second");
        }
    }
}
