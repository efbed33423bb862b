//! Statistics of a flight.

use super::{CatkinState, FlightSimulation};
use osier_base::math::sqrt;
use osier_scene::solid::Solids;

/// Event counts since the start.
#[derive(Debug, Clone, Default)]
pub(super) struct EventCounters {
    pub merges: u64,
    pub deposits: u64,
    pub lift_offs: u64,
    pub recycled: u64,
    pub left: u64,
    pub buried: u64,
    pub long_steps: u64,
    /// Mean wind at 0.1 m over all deposits, m/s, of the last step.
    pub ground_wind: f64,
}

/// Number of catkins by state at one time, and event counts until then.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FlightStats {
    /// Catkins not yet released.
    pub pending: u64,
    /// Catkins in the air, singly or in clusters.
    pub airborne: u64,
    /// Deposited on ground, roofs and tops of walls.
    pub grounded: u64,
    /// Deposited at steep faces.
    pub on_wall: u64,
    /// Deposited in corners of ground and wall.
    pub corner: u64,
    /// Outside of the box.
    pub exited: u64,
    /// Clusters of two and more catkins.
    pub clusters: u64,
    /// Visible catkins that belong to no cluster.
    pub singles: u64,
    /// Size of the largest cluster.
    pub largest: u64,
    /// Joins of two bodies so far.
    pub merges: u64,
    /// Depositions so far.
    pub deposits: u64,
    /// Lift-offs since the first step.
    pub lift_offs: u64,
    /// Recycled catkins so far.
    pub recycled: u64,
    /// Exits from the box so far.
    pub left: u64,
    /// Mean speed of airborne catkins, m/s.
    pub mean_speed: f64,
    /// Largest speed of airborne catkins, m/s.
    pub max_speed: f64,
    /// Mean wind at 0.1 m over deposits, m/s.
    pub ground_wind: f64,
    /// Mean flight time of deposited catkins, s.
    pub flight_time: f64,
    /// Mean horizontal flight distance of deposited catkins, m.
    pub flight_distance: f64,
    /// Deposited catkins that penetrate a surface by more than 0.1 mm.
    pub penetrations: u64,
    /// Catkins that start inside a solid and never fly.
    pub buried: u64,
    /// Steps of a catkin longer than [`super::FlightParams::longest_step`] so far.
    pub long_steps: u64,
}

impl FlightStats {
    /// Deposited catkins of all kinds.
    pub fn deposited(&self) -> u64 {
        self.grounded + self.on_wall + self.corner
    }
}

impl FlightSimulation {
    /// The solids of the scene.
    pub fn solids(&self) -> &Solids {
        &self.solids
    }

    /// Number of deposited catkins at each solid, in the order of the solids.
    pub fn deposits_per_solid(&self) -> Vec<u64> {
        let mut out = vec![0; self.solids.list().len()];
        for c in self.by_id().filter(|c| c.state.is_deposited()) {
            if let Some(n) = c.face.and_then(|i| out.get_mut(i as usize)) {
                *n += 1;
            }
        }
        out
    }
}

pub(super) fn collect_stats(flights: &FlightSimulation) -> FlightStats {
    let mut t = FlightStats::default();
    let (mut speeds, mut time, mut way) = (0.0, 0.0, 0.0);
    for c in flights.by_id() {
        *match c.state {
            CatkinState::Pending => &mut t.pending,
            CatkinState::Airborne => &mut t.airborne,
            CatkinState::Grounded => &mut t.grounded,
            CatkinState::OnWall => &mut t.on_wall,
            CatkinState::Corner => &mut t.corner,
            CatkinState::Exited => &mut t.exited,
        } += 1;
        // Speeds relative to the ground, not to the air.
        if c.state == CatkinState::Airborne {
            let speed = c.v.length();
            speeds += speed;
            t.max_speed = t.max_speed.max(speed);
        }
        // Flight time and horizontal distance of each deposit.
        if c.state.is_deposited() {
            let d = c.x - c.from;
            time += c.rested - c.since;
            way += sqrt(d.x * d.x + d.z * d.z);
        }
        // A single is visible and in no cluster; clusters are counted from their own list below.
        t.singles += u64::from(c.state.is_seen() && !c.clustered);
    }
    let mean = |sum: f64, n: u64| if n > 0 { sum / n as f64 } else { 0.0 };
    t.clusters = flights.clusters.len() as u64;
    t.largest = flights.clusters.values().map(|c| c.members.len() as u64).max().unwrap_or(0);
    t.mean_speed = mean(speeds, t.airborne);
    (t.flight_time, t.flight_distance) = (mean(time, t.deposited()), mean(way, t.deposited()));
    t.penetrations = flights.count_penetrations();
    let e = &flights.counters;
    (t.merges, t.deposits, t.lift_offs) = (e.merges, e.deposits, e.lift_offs);
    (t.recycled, t.left, t.buried, t.ground_wind) = (e.recycled, e.left, e.buried, e.ground_wind);
    t.long_steps = e.long_steps;
    t
}
