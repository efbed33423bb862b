//! Statistics of a flight.

use super::{CatkinState, FlightSimulation, RestingPlace};
use osier_base::convert::to_usize;
use osier_scene::solid::Solids;

/// Event counts since the start, as in [`FlightStats`].
#[derive(Debug, Clone, Default)]
pub(super) struct EventCounters {
    pub merges: u64,
    pub deposits: u64,
    /// Depositions at each solid, in the order of the solids.
    pub deposits_at: Vec<u64>,
    pub lift_offs: u64,
    pub falls: u64,
    pub recycled: u64,
    pub left: u64,
    pub buried: u64,
    pub long_steps: u64,
    /// Mean wind at 0.1 m over all deposits, m/s, of the last step that had any; `None` before.
    pub ground_wind: Option<f64>,
}

/// Number of catkins by state at one time, and event counts until then.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FlightStats {
    /// Catkins that wait for their release, hidden.
    pub pending: u64,
    /// Catkins in the air, singly or in clusters.
    pub airborne: u64,
    /// Deposited on ground, roofs and tops of walls.
    pub grounded: u64,
    /// Deposited at steep faces.
    pub on_wall: u64,
    /// Deposited in corners of ground and wall.
    pub corner: u64,
    /// Outside of the box, hidden before they reenter, or buried.
    pub exited: u64,
    /// Clusters of two and more catkins.
    pub clusters: u64,
    /// Visible catkins that belong to no cluster.
    pub singles: u64,
    /// Number of members of the largest cluster; 0 without clusters.
    pub largest: u64,
    /// Joins of two bodies so far, each a single or a cluster.
    pub merges: u64,
    /// Depositions so far, each member of a cluster counted.
    pub deposits: u64,
    /// Lift-offs by the wind so far, each member of a cluster counted.
    pub lift_offs: u64,
    /// Times that a deposit lost its support and fell, each member of a cluster counted. Deposits minus lift-offs and falls is
    /// the number of deposited catkins, unless some crept out of the box.
    pub falls: u64,
    /// Reentries of recycled catkins so far.
    pub recycled: u64,
    /// Exits from the box so far, those before recycling included, each member of a cluster counted.
    pub left: u64,
    /// Mean speed of airborne catkins over the ground, m/s; `None` without any.
    pub mean_speed: Option<f64>,
    /// Largest speed of airborne catkins over the ground, m/s; `None` without any.
    pub max_speed: Option<f64>,
    /// Mean wind at 0.1 m over deposits in the last step that had any, m/s; `None` before.
    pub ground_wind: Option<f64>,
    /// Mean time from the release to the last deposition of deposited catkins, s; `None` without any.
    pub flight_time: Option<f64>,
    /// Mean horizontal distance of deposited catkins from their release, m; `None` without any.
    pub flight_distance: Option<f64>,
    /// Horizontal distances from the release, m, that 10, 50 and 90 % of the deposited catkins do not exceed; `None` without deposits.
    pub distance_quantiles: Option<[f64; 3]>,
    /// Deposited catkins that penetrate a surface by more than 0.1 mm.
    pub penetrations: u64,
    /// Catkins that start inside a solid and never fly.
    pub buried: u64,
    /// Number of times so far that a catkin moved farther in a step than [`super::FlightParams::longest_step`].
    pub long_steps: u64,
}

impl FlightStats {
    /// Catkins that are deposited now: on the ground and on tops, at walls and in corners.
    pub fn deposited(&self) -> u64 {
        self.grounded + self.on_wall + self.corner
    }
}

impl FlightSimulation {
    /// The solids that catkins fly around and come to rest on.
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

    /// Where catkins were deposited in the last step, each member of a cluster once.
    pub fn landings(&self) -> &[RestingPlace] {
        &self.landings
    }

    /// Depositions so far at each solid, in the order of the solids; catkins that have left the solid since are included.
    pub fn landings_per_solid(&self) -> &[u64] {
        &self.counters.deposits_at
    }

    /// Counts depositions of this step and appends them to the list of landings.
    pub(super) fn record_landings(&mut self, places: impl IntoIterator<Item = RestingPlace>) {
        for place in places {
            self.counters.deposits += 1;
            if let Some(n) = place.face.and_then(|i| self.counters.deposits_at.get_mut(to_usize(i))) {
                *n += 1;
            }
            self.landings.push(place);
        }
    }
}

/// Value that the share `q` (0 to 1) of the ascending `sorted` does not exceed, linear between two values; 0 for none.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the number of values")]
fn quantile(sorted: &[f64], q: f64) -> f64 {
    // Rank q (n - 1), counted from 0: the median of two values is their mean.
    let rank = q * sorted.len().saturating_sub(1) as f64;
    let at = |i: usize| sorted.get(i).copied();
    let low = at(rank as usize).unwrap_or(0.0);
    low + (at(rank as usize + 1).unwrap_or(low) - low) * rank.fract()
}

pub(super) fn collect_stats(flights: &FlightSimulation) -> FlightStats {
    let mut t = FlightStats::default();
    let (mut speeds, mut time) = (0.0, 0.0);
    let mut distances = Vec::new();
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
            t.max_speed = Some(t.max_speed.map_or(speed, |most| most.max(speed)));
        }
        // Flight time and horizontal distance of each deposit, from its release.
        if c.state.is_deposited() {
            time += c.flight_time().unwrap_or(0.0);
            distances.push(c.flight_distance());
        }
        // A single is visible and in no cluster; clusters are counted below, from the map of clusters.
        t.singles += u64::from(c.state.is_seen() && !c.clustered);
    }
    let mean = |sum: f64, n: u64| (n > 0).then(|| sum / n as f64);
    t.clusters = flights.clusters.len() as u64;
    t.largest = flights.clusters.values().map(|c| c.members.len() as u64).max().unwrap_or(0);
    t.mean_speed = mean(speeds, t.airborne);
    let way = distances.iter().fold(0.0, |sum, d| sum + d);
    (t.flight_time, t.flight_distance) = (mean(time, t.deposited()), mean(way, t.deposited()));
    distances.sort_unstable_by(f64::total_cmp);
    t.distance_quantiles = (!distances.is_empty()).then(|| [0.1, 0.5, 0.9].map(|q| quantile(&distances, q)));
    t.penetrations = flights.count_penetrations();
    let e = &flights.counters;
    (t.merges, t.deposits, t.lift_offs, t.falls) = (e.merges, e.deposits, e.lift_offs, e.falls);
    (t.recycled, t.left, t.buried, t.ground_wind) = (e.recycled, e.left, e.buried, e.ground_wind);
    t.long_steps = e.long_steps;
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_linear_between_ranks() {
        // Eleven values 0, 10 .. 100: ranks 1, 5 and 9; of two values the shares themselves.
        let tens: Vec<f64> = (0..11).map(|i| f64::from(i) * 10.0).collect();
        let cases: [(&[f64], [f64; 3]); 4] =
            [(&[], [0.0; 3]), (&[7.0], [7.0; 3]), (&tens, [10.0, 50.0, 90.0]), (&[0.0, 4.0], [0.4, 2.0, 3.6])];
        for (values, expected) in cases {
            for (q, expected) in [0.1, 0.5, 0.9].into_iter().zip(expected) {
                assert!((quantile(values, q) - expected).abs() < 1e-12, "{q} of {values:?}");
            }
        }
    }
}
