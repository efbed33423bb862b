//! Boundary conditions at the sides of the box.

use glam::{DVec3, Vec3};

use super::particles::{Catkin, CatkinState, NO_TARGET, VelocityDecay};
use super::release::inflow_point;
use super::{FlightSimulation, ReleaseCondition, SideBoundary};
use crate::flight::tuning::{HIDDEN_FRAMES, MAX_START_DRAWS};
use osier_base::rng::Rng;

impl FlightSimulation {
    /// Applies the boundary conditions to singles and clusters past a side, and keeps airborne ones below the top of the box.
    pub(super) fn apply_side_boundaries(&mut self, t: f64) {
        // Wrap at periodic sides first; a single or cluster that is still past a side leaves the box.
        self.count_long_steps();
        let top = f64::from(self.options.inside.max.y);
        for root in self.leaders_outside() {
            self.wrap_periodic(root);
            let x = self.clusters.get(&root).map_or_else(|| self.catkin(root).x, |k| k.x);
            if self.options.is_past_a_side(x) {
                self.exit_box(root, t);
            } else if x.y > top {
                self.translate(root, DVec3::Y * (top - x.y));
            }
        }
        if self.present.exited {
            self.reenter_recycled(t);
        }
    }

    /// Indices of singles and clusters outside of the box, ascending.
    fn leaders_outside(&mut self) -> Vec<u32> {
        let escaped = std::mem::take(&mut self.escaped);
        let single = |c: &Catkin| !c.clustered && c.state.is_seen() && self.options.is_outside(c.x);
        let clusters = self.clusters.iter().filter(|(_, c)| self.options.is_outside(c.x)).map(|(root, _)| *root);
        let mut all: Vec<u32> = if self.present.deposited {
            self.leader_ids(single)
        } else {
            // Without deposits, only the singles that this step moved out of the box can be outside.
            escaped.into_iter().filter(|id| single(self.catkin(*id))).collect()
        };
        all.extend(clusters);
        all.sort_unstable();
        all
    }

    /// Counts airborne catkins whose step is longer than [`super::FlightParams::longest_step`].
    fn count_long_steps(&mut self) {
        let (dt, longest) = (self.time_step(), self.options.longest_step);
        if longest.is_finite() {
            let long = |c: &&Catkin| c.state == CatkinState::Airborne && c.v.length() * dt > longest;
            self.counters.long_steps += self.catkins.iter().filter(long).count() as u64;
        }
    }

    /// Translates a single or a cluster without adding to its path or to its distance from its release.
    fn translate(&mut self, root: u32, by: DVec3) {
        if let Some(c) = self.clusters.get_mut(&root) {
            c.x += by;
            let members = c.members.clone();
            members.iter().for_each(|id| self.catkin_mut(*id).jump(by));
        } else {
            self.catkin_mut(root).jump(by);
        }
    }

    /// Translates a single or a cluster by whole box sizes back into the box, along periodic axes only.
    fn wrap_periodic(&mut self, root: u32) {
        let inside = self.options.inside;
        let (low, size) = (inside.min.as_dvec3(), inside.size().as_dvec3());
        let x = self.clusters.get(&root).map_or_else(|| self.catkin(root).x, |k| k.x);
        // floor((x - low)/size) whole sizes along periodic axes, 0 along others.
        let by = |edge: SideBoundary, x: f64, low: f64, size: f64| {
            if edge == SideBoundary::Periodic { -((x - low) / size).floor() * size } else { 0.0 }
        };
        let [ex, ez] = self.options.edges;
        let by = DVec3::new(by(ex, x.x, low.x, size.x), 0.0, by(ez, x.z, low.z, size.z));
        if by != DVec3::ZERO {
            self.translate(root, by);
        }
    }

    /// Takes a single, or all members of a cluster, out of the scene at a side that is not periodic; the cluster dissolves.
    fn exit_box(&mut self, root: u32, t: f64) {
        let cluster = self.clusters.remove(&root);
        let x = cluster.as_ref().map_or_else(|| self.catkin(root).x, |c| c.x);
        let members = cluster.map_or_else(|| vec![root], |c| c.members);
        let dt = self.time_step();
        // Recycling starts at the first whole frame after the exit. At frame rates such as 29.97 times have rounding errors; the tolerance
        // keeps the end of a frame from counting as part of the next one. A shorter first interval shifts the times of all frames.
        let first = self.options.first_interval;
        let frames = ((t + dt - first) * self.options.fps - 1e-6).ceil();
        let back = first + (frames + HIDDEN_FRAMES - 1.0) / self.options.fps;
        // The boundary condition of the side that it crossed decides whether it is recycled. A cluster crosses with its centre,
        // while some of its members are still inside.
        let inside = self.options.inside;
        let x_side = x.x < f64::from(inside.min.x) || x.x > f64::from(inside.max.x);
        let side = self.options.edges[usize::from(!x_side)];
        for id in members {
            // Deposited catkins that leave the box are not recycled.
            let recycles = side == SideBoundary::Recycle && !self.catkin(id).state.is_deposited();
            let c = self.catkin_mut(id);
            (c.state, c.root, c.free, c.target, c.face) = (CatkinState::Exited, id, false, NO_TARGET, None);
            c.clustered = false;
            c.wait = ReleaseCondition::Until(if recycles { back } else { f64::INFINITY });
            self.counters.left += 1;
        }
    }

    /// Recycles exited catkins: at the first hidden frame they move to the inflow, one frame later they become airborne.
    fn reenter_recycled(&mut self, t: f64) {
        let now = t + self.time_step();
        let frame = 1.0 / self.options.fps;
        let wind = self.mean_wind;
        let (inside, edges) = (self.options.inside, self.options.edges);
        let (band, seed) = (self.options.band, self.options.seed);
        let solids = std::sync::Arc::clone(&self.solids);
        let options = self.options.clone();
        let mut back = 0;
        for c in self.catkins.iter_mut().filter(|c| c.state == CatkinState::Exited) {
            let ReleaseCondition::Until(when) = c.wait else { continue };
            if when.is_finite() && !c.moved && now + frame * 1e-6 >= when {
                let mut draw =
                    Rng::at(seed, &["flight".into(), c.id.into(), (c.generation + 1).into(), "entry".into()]);
                // Draw until the position is outside of solids; the last draw is used even if it is inside.
                let mut at = inflow_point(wind, inside, edges, band, &mut draw);
                for _ in 1..MAX_START_DRAWS {
                    if !solids.contains(at.as_vec3()) {
                        break;
                    }
                    at = inflow_point(wind, inside, edges, band, &mut draw);
                }
                c.jump(at - c.x);
                c.moved = true;
            } else if c.moved && now + frame * 1e-6 >= when + frame {
                c.restart_flight(wind, &options);
                back += 1;
            }
        }
        self.counters.recycled += back;
    }
}

impl Catkin {
    /// Translates the catkin and its release point alike, so that the distance between them is unchanged.
    fn jump(&mut self, by: DVec3) {
        self.x += by;
        self.from += by;
    }

    /// Starts a new flight at the present position, with the velocity of the mean wind minus the settling speed.
    fn restart_flight(&mut self, wind: Vec3, options: &super::FlightParams) {
        self.generation += 1;
        self.state = CatkinState::Airborne;
        self.v = wind.as_dvec3() - DVec3::Y * self.fall;
        self.travel = DVec3::ZERO;
        (self.moved, self.free, self.begins_flight) = (false, true, true);
        self.rested = -1.0;
        self.lag = VelocityDecay::for_settling_speed(self.fall, options, options.time_step());
        self.lift = 0.0;
    }
}
