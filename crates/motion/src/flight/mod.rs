//! Flight of catkins: they are carried by the wind, settle, tumble, stick to each other, deposit on ground and walls,
//! are attracted to deposited clusters, and lift off again.
//!
//! [`FlightSimulation`] holds all catkins and advances in steps; it samples the wind at every step, so that the wind
//! can be simulated along with it. Results depend neither on threads nor on the order in memory: single
//! catkins are computed independently; pairs are collected, sorted by index and processed in that order.
//! Source: \[catkin\] sections 4.1 to 4.3; own: exact drag relaxation, masses, and a swept contact test.
//! ```
//! use std::sync::Arc;
//!
//! use glam::{DVec3, Vec3};
//! use osier_motion::flight::{CatkinStart, FlightParams, FlightSimulation, ReleaseCondition};
//! use osier_scene::solid::Solids;
//! use osier_wind::UniformWind;
//!
//! // One catkin in a breeze: after a second it has drifted downwind and settled a little.
//! let start = CatkinStart { at: DVec3::new(0.0, 10.0, 0.0), wait: ReleaseCondition::Until(0.0) };
//! let mut flight = FlightSimulation::new(FlightParams::default(), Arc::new(Solids::default()), &[start]);
//! (0..24).for_each(|_| flight.advance_frame(&UniformWind(Vec3::X)));
//! let position = flight.frame().positions[0];
//! assert!(position.x > 0.5 && position.y < 10.0);
//! ```

mod advance;
mod attraction;
mod bonds;
mod boundary;
mod clusters;
mod collision;
mod contacts;
mod deposit;
mod heaps;
mod lift_off;
mod near_surface;
mod params;
mod particles;
mod present_states;
mod release;
mod stats;
mod tumble;
mod tuning;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::{DVec3, Quat, Vec3};

use osier_scene::solid::Solids;
use osier_wind::Wind;

pub use params::{CatkinKind, CatkinStart, FlightParams, GroundHumidity, ReleaseCondition, SideBoundary};
pub use particles::{Catkin, CatkinState, RestingPlace};
pub use release::{SkyRelease, sky_starts};
pub use stats::FlightStats;

use clusters::CatkinClusters;
use contacts::ContactGrid;
use near_surface::NearSurfaceWind;
use particles::VelocityDecay;
use present_states::PresentStates;

/// Catkins per task: large enough that scheduling costs nothing, small enough for the L2 cache.
const CATKINS_PER_TASK: usize = 512;

/// Steps between two spatial sorts. More often: the sort costs more than it saves; more rarely: neighbours drift apart
/// in memory.
const SORT_INTERVAL_STEPS: u64 = 64;

/// All catkins and clusters of a scene, in the air and at rest, which the wind moves step by step.
#[derive(Debug, Clone)]
pub struct FlightSimulation {
    options: FlightParams,
    solids: Arc<Solids>,
    /// Spatially sorted; `slot` finds a catkin by its index.
    catkins: Vec<Catkin>,
    /// Position in `catkins` of each catkin, by its index.
    slot: Vec<u32>,
    clusters: CatkinClusters,
    step: u64,
    /// Mean wind at the time of the step, m/s: decides through which sides recycled catkins enter, and how fast.
    mean_wind: Vec3,
    /// States that occur, as of the last advance of singles and clusters.
    present: PresentStates,
    /// Whether any single is attracted to a cluster, as of the last tick.
    any_attracted: bool,
    /// Indices of singles that left the box in this step.
    escaped: Vec<u32>,
    /// Buffers of the contact search, reused.
    contact_grid: ContactGrid,
    counters: stats::EventCounters,
    /// Depositions of the last step, each member of a cluster once.
    landings: Vec<RestingPlace>,
}

/// Position and velocity of the point of a moving plant from which a pending catkin hangs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarriedPoint {
    /// Position in the world, m.
    pub position: DVec3,
    /// Velocity in the world, m/s.
    pub velocity: DVec3,
}

/// Visible state of all catkins at one time, by index.
#[derive(Debug, Clone, Default)]
pub struct FlightFrame {
    /// Positions of the origins of the hairs, m; hidden catkins keep their last position.
    pub positions: Vec<Vec3>,
    /// Rotations from the rest pose, whose tuft points along +Y.
    pub orientations: Vec<Quat>,
    /// Velocities, m/s; 0 for catkins that have left the box.
    pub velocities: Vec<Vec3>,
    /// Angular velocity vectors, rad/s; 0 for hidden catkins.
    pub angular_velocities: Vec<Vec3>,
    /// Whether each catkin is pending, airborne, deposited (and where) or has left the box.
    pub states: Vec<CatkinState>,
    /// Smallest index in the catkin's cluster; for a single the index of the catkin.
    pub clusters: Vec<u32>,
    /// Number of times that each catkin was recycled.
    pub generations: Vec<u32>,
}

impl FlightSimulation {
    /// Catkins indexed in the order of `starts`. Those that start inside a solid never fly; see
    /// [`FlightStats::buried`].
    pub fn new(options: FlightParams, solids: Arc<Solids>, starts: &[CatkinStart]) -> Self {
        let mut catkins: Vec<Catkin> = (0..).zip(starts).map(|(id, start)| Catkin::new(id, *start, &options)).collect();
        let mut counters =
            stats::EventCounters { deposits_at: vec![0; solids.list().len()], ..stats::EventCounters::default() };
        // A catkin inside a solid could never leave it.
        for c in &mut catkins {
            if solids.contains(c.x.as_vec3()) {
                c.state = CatkinState::Exited;
                c.wait = ReleaseCondition::Until(f64::INFINITY);
                counters.buried += 1;
            }
        }
        // Sorting by location later changes the order of `catkins`; `slot` finds a catkin by its index.
        let slot = catkins.iter().map(|c| c.id).collect();
        let (clusters, present) = (CatkinClusters::new(), PresentStates::UNKNOWN);
        let (escaped, contact_grid) = (Vec::new(), ContactGrid::default());
        let (step, mean_wind) = (0, Vec3::X);
        Self {
            options,
            solids,
            catkins,
            slot,
            clusters,
            step,
            mean_wind,
            present,
            any_attracted: false,
            escaped,
            contact_grid,
            counters,
            landings: Vec::new(),
        }
    }

    /// Number of catkins in all states, pending and exited ones included.
    pub fn len(&self) -> usize {
        self.catkins.len()
    }

    /// Whether the simulation was created without starts.
    pub fn is_empty(&self) -> bool {
        self.catkins.is_empty()
    }

    /// Time since the start, s.
    pub fn seconds(&self) -> f64 {
        self.options.start_of_step(self.step)
    }

    /// Length of the present step, s.
    fn time_step(&self) -> f64 {
        self.options.length_of_step(self.step)
    }

    /// The parameters that the simulation was created with.
    pub fn options(&self) -> &FlightParams {
        &self.options
    }

    /// All catkins in the order of their indices.
    pub fn by_id(&self) -> impl Iterator<Item = &Catkin> {
        self.slot.iter().filter_map(|s| self.catkins.get(*s as usize))
    }

    /// Advances by one frame: [`FlightParams::substeps`] steps, each with a new sample of `wind`.
    pub fn advance_frame(&mut self, wind: &dyn Wind) {
        for _ in 0..self.options.substeps.max(1) {
            self.advance(wind);
        }
    }

    /// Advances by one step of [`FlightParams::time_step`] seconds, in a shorter first interval by less. Samples `wind` at the beginning
    /// and the middle of the step.
    pub fn advance(&mut self, wind: &dyn Wind) {
        let t = self.seconds();
        let solids = Arc::clone(&self.solids);
        let wind: &dyn Wind = &NearSurfaceWind::new(wind, &solids, &self.options);
        self.mean_wind = wind.prescribed_mean_at_time(t);
        self.landings.clear();
        if self.options.sorted && self.step.is_multiple_of(SORT_INTERVAL_STEPS) {
            self.sort_by_location();
        }
        // Flight first, so that contacts and deposition see where everything went in this step.
        self.release_pending(wind, t);
        self.advance_singles(wind, t);
        self.advance_clusters(wind, t);
        // Deposits: clusters contract, heaps collapse, wall deposits slide.
        self.contract_resting_clusters();
        self.relax_heaps();
        self.slide_down_walls(wind, t);
        self.join_contacts(t);
        // Attraction to deposited clusters, lift-off by the wind, sides of the box, and last rotation.
        self.attract_singles(t);
        self.lift_off(wind, t);
        self.apply_side_boundaries(t);
        self.tumble_all();
        self.step += 1;
        if self.options.is_shorter(self.step - 1) && !self.options.is_shorter(self.step) {
            self.renew_velocity_decays();
        }
    }

    /// Recomputes the decay of velocities over a step after the length of the steps has changed.
    fn renew_velocity_decays(&mut self) {
        let dt = self.time_step();
        for c in &mut self.catkins {
            c.lag = VelocityDecay::for_settling_speed(c.fall, &self.options, dt);
        }
        for cluster in self.clusters.values_mut() {
            cluster.lag = VelocityDecay::for_settling_speed(cluster.fall, &self.options, dt);
        }
    }

    /// Sorts catkins by location (cells of 2 m, rows along x): samples of the wind and contact tests then hit the
    /// cache.
    fn sort_by_location(&mut self) {
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

    /// Indices of singles and of cluster leaders that satisfy `want`, ascending.
    fn leader_ids(&self, want: impl Fn(&Catkin) -> bool) -> Vec<u32> {
        // In the order of memory, which is far faster than by index.
        let mut found: Vec<u32> =
            self.catkins.iter().filter(|c| c.is_cluster_leader() && want(c)).map(|c| c.id).collect();
        found.sort_unstable();
        found
    }

    fn catkin(&self, id: u32) -> &Catkin {
        &self.catkins[self.slot[id as usize] as usize]
    }

    fn catkin_mut(&mut self, id: u32) -> &mut Catkin {
        &mut self.catkins[self.slot[id as usize] as usize]
    }

    /// Whether any catkin waits for its release, as of the last step; true before the first step.
    pub fn has_pending(&self) -> bool {
        self.present.pending
    }

    /// Moves pending catkins with the plant from which they hang. `carried`: position and velocity of the catkin of an index, or
    /// `None` to leave it unchanged.
    pub fn move_pending(&mut self, carried: impl Fn(u32) -> Option<CarriedPoint>) {
        for c in self.catkins.iter_mut().filter(|c| c.state == CatkinState::Pending) {
            if let Some(CarriedPoint { position, velocity }) = carried(c.id) {
                (c.x, c.from, c.v) = (position, position, velocity);
            }
        }
    }

    /// Visible state at the present time, in the order of the starts.
    pub fn frame(&self) -> FlightFrame {
        let mut out = FlightFrame::default();
        for c in self.by_id() {
            out.positions.push(c.x.as_vec3());
            out.orientations.push(c.q);
            // A pending catkin has the velocity of the plant from which it hangs.
            let moves = c.state.is_seen() || c.state == CatkinState::Pending;
            out.velocities.push(if moves { c.v.as_vec3() } else { Vec3::ZERO });
            out.angular_velocities.push(if c.state.is_seen() { c.omega } else { Vec3::ZERO });
            out.states.push(c.state);
            out.clusters.push(c.root);
            out.generations.push(c.generation);
        }
        out
    }

    /// Number of catkins by state now, and counts of events since the start.
    pub fn stats(&self) -> FlightStats {
        stats::collect_stats(self)
    }
}
