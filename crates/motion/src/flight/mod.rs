//! Catkins in the air and on the ground: carried by a wind, sinking, tumbling, sticking to each other, coming to rest on
//! ground and walls, drawn to heaps, lifted again.
//!
//! [`FlightSimulation`] holds all of them and goes forward in steps; the wind is asked at every step, so that it need not be known
//! beforehand. Results do not depend on threads or on the order in memory: what concerns one catkin is computed for each
//! by itself, what concerns two is collected, sorted by number and done in that order.
//! Source: \[catkin\] sections 4.1 to 4.3, with an exact drag relaxation, masses and a swept test where it has none.

mod advance;
mod attraction;
mod bonds;
mod boundary;
mod clusters;
mod contacts;
mod deposit;
mod grid;
mod heaps;
mod lift_off;
mod params;
mod particles;
mod present_states;
mod release;
mod stats;
mod tumble;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::{Quat, Vec3};

use osier_scene::solid::Solids;
use osier_wind::Wind;

pub use params::{CatkinKind, CatkinStart, FlightParams, GroundHumidity, ReleaseCondition, SideBoundary};
pub use particles::{Catkin, CatkinState};
pub use release::{SkyRelease, sky_starts};
pub use stats::FlightStats;

use clusters::CatkinClusters;
use contacts::ContactGrid;
use present_states::PresentStates;

/// Records a task takes at once.
const CATKINS_PER_TASK: usize = 512;

/// Steps after which neighbours are brought together in memory.
const SORT_INTERVAL_STEPS: u64 = 64;

/// All catkins of a clip.
#[derive(Debug, Clone)]
pub struct FlightSimulation {
    options: FlightParams,
    solids: Arc<Solids>,
    /// In an order of their own.
    catkins: Vec<Catkin>,
    /// Where each number is in `catkins`.
    slot: Vec<u32>,
    clusters: CatkinClusters,
    step: u64,
    /// Mean wind, m/s: by which sides it enters.
    mean_wind: Vec3,
    /// What there is, as of the last flight of singles and clusters.
    present: PresentStates,
    /// Some single is drawn to a cluster.
    drawn: bool,
    /// Singles that this step took out of the box.
    escaped: Vec<u32>,
    /// Room for the search for contacts.
    contact_grid: ContactGrid,
    counters: stats::EventCounters,
}

/// What is seen at one time, by number.
#[derive(Debug, Clone, Default)]
pub struct FlightFrame {
    /// m; those not seen stay where they were last.
    pub positions: Vec<Vec3>,
    /// Tufts point along +Y.
    pub orientations: Vec<Quat>,
    /// m/s.
    pub velocities: Vec<Vec3>,
    /// Axis times rad/s.
    pub angular_velocities: Vec<Vec3>,
    /// What each is doing.
    pub states: Vec<CatkinState>,
    /// Smallest number of its cluster.
    pub clusters: Vec<u32>,
    /// How often it has come back.
    pub generations: Vec<u32>,
}

impl FlightSimulation {
    /// Catkins numbered in the order of `starts`. Those that start in a solid never fly; see [`FlightStats::buried`].
    pub fn new(options: FlightParams, solids: Arc<Solids>, starts: &[CatkinStart]) -> Self {
        let mut catkins: Vec<Catkin> = (0..).zip(starts).map(|(id, start)| Catkin::new(id, *start, &options)).collect();
        let mut counters = stats::EventCounters::default();
        for c in &mut catkins {
            if solids.contains(c.x.as_vec3()) {
                c.state = CatkinState::Exited;
                c.wait = ReleaseCondition::Until(f64::INFINITY);
                counters.buried += 1;
            }
        }
        let slot = (0..u32::try_from(catkins.len()).unwrap_or(u32::MAX)).collect();
        let (clusters, present) = (CatkinClusters::new(), PresentStates::UNKNOWN);
        let (escaped, contact_grid) = (Vec::new(), ContactGrid::default());
        let (step, mean_wind, drawn) = (0, Vec3::X, false);
        Self {
            options,
            solids,
            catkins,
            slot,
            clusters,
            step,
            mean_wind,
            present,
            drawn,
            escaped,
            contact_grid,
            counters,
        }
    }

    /// Number of catkins, flying or not.
    pub fn len(&self) -> usize {
        self.catkins.len()
    }

    /// True without any.
    pub fn is_empty(&self) -> bool {
        self.catkins.is_empty()
    }

    /// Time since the start, s.
    pub fn seconds(&self) -> f64 {
        self.step as f64 * self.options.time_step()
    }

    /// What rules them.
    pub fn options(&self) -> &FlightParams {
        &self.options
    }

    /// All of them by number.
    pub fn by_id(&self) -> impl Iterator<Item = &Catkin> {
        self.slot.iter().filter_map(|s| self.catkins.get(*s as usize))
    }

    /// Goes on by the steps of one frame.
    pub fn advance_frame(&mut self, wind: &dyn Wind) {
        for _ in 0..self.options.substeps.max(1) {
            self.advance(wind);
        }
    }

    /// Goes on by one step.
    pub fn advance(&mut self, wind: &dyn Wind) {
        let t = self.seconds();
        self.mean_wind = wind.mean();
        if self.options.sorted && self.step.is_multiple_of(SORT_INTERVAL_STEPS) {
            self.sort();
        }
        self.release_pending(wind, t);
        self.advance_singles(wind, t);
        self.advance_clusters(wind, t);
        self.gather();
        self.relax_heaps();
        self.slide_down_walls(wind, t);
        if (self.step + 1).is_multiple_of(u64::from(self.options.check_every.max(1))) {
            self.join_contacts(t);
        }
        self.attract_singles(t);
        self.lift_off(wind, t);
        self.apply_side_boundaries(t);
        self.turn();
        self.step += 1;
    }

    /// Brings neighbours together: wind and contacts then find in the cache what they need.
    fn sort(&mut self) {
        let key = |c: &Catkin| {
            let p = ((c.x.as_vec3() - self.options.inside.min) * 0.5).clamp(Vec3::ZERO, Vec3::splat(1023.0));
            let [x, y, z] = p.as_uvec3().to_array();
            (y, z, x, c.id)
        };
        self.catkins.sort_by_cached_key(key);
        for (i, c) in (0..).zip(&self.catkins) {
            self.slot[c.id as usize] = i;
        }
    }

    /// Numbers of singles, and of those that stand for their clusters, that answer to `want`, ascending.
    fn leader_ids(&self, want: impl Fn(&Catkin) -> bool) -> Vec<u32> {
        // In the order of memory, which is far faster than by number.
        let mut found: Vec<u32> = self.catkins.iter().filter(|c| c.leads() && want(c)).map(|c| c.id).collect();
        found.sort_unstable();
        found
    }

    fn catkin(&self, id: u32) -> &Catkin {
        &self.catkins[self.slot[id as usize] as usize]
    }

    fn catkin_mut(&mut self, id: u32) -> &mut Catkin {
        &mut self.catkins[self.slot[id as usize] as usize]
    }

    /// What is seen now.
    pub fn frame(&self) -> FlightFrame {
        let mut out = FlightFrame::default();
        for c in self.by_id() {
            out.positions.push(c.x.as_vec3());
            out.orientations.push(c.q);
            out.velocities.push(if c.state.is_seen() { c.v.as_vec3() } else { Vec3::ZERO });
            out.angular_velocities.push(if c.state.is_seen() { c.omega } else { Vec3::ZERO });
            out.states.push(c.state);
            out.clusters.push(c.root);
            out.generations.push(c.generation);
        }
        out
    }

    /// Counts of now and of all that happened so far.
    pub fn stats(&self) -> FlightStats {
        stats::count(self)
    }
}
