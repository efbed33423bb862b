//! Catkins that stick together move as one body (\[catkin\] eq. 12, 13).

use std::collections::BTreeMap;

use glam::{DQuat, DVec3, Vec3};

use super::FlightSimulation;
use super::bonds::{ClusterBond, bonded_groups, contract_bonds};
use super::deposit::SweepResult;
use super::params::FlightParams;
use super::particles::{Catkin, CatkinState, VelocityDecay, rising};
use osier_base::math::pow;

/// Clusters by the smallest number of their members.
pub(super) type CatkinClusters = BTreeMap<u32, CatkinCluster>;

/// Two or more catkins.
#[derive(Debug, Clone)]
pub(super) struct CatkinCluster {
    /// Numbers, ascending.
    pub members: Vec<u32>,
    /// From the centre of mass to each, m.
    pub offsets: Vec<DVec3>,
    /// Centre of mass, m, and how it moves.
    pub x: DVec3,
    pub v: DVec3,
    pub mass: f64,
    /// Settling speed, m/s, and the sum of those of its members.
    pub fall: f64,
    falls: f64,
    pub lag: VelocityDecay,
    pub state: CatkinState,
    pub omega: Vec3,
    /// Upward air that took it off, m/s, and when.
    pub lift: f64,
    pub lifted: f64,
    /// One less than members.
    bonds: Vec<ClusterBond>,
    /// Some member may still sink once it lies.
    pub loose: bool,
}

impl CatkinCluster {
    /// One that is a cluster of its own.
    fn alone(c: &Catkin) -> Self {
        Self {
            members: vec![c.id],
            offsets: vec![DVec3::ZERO],
            x: c.x,
            v: c.v,
            mass: c.mass,
            fall: c.fall,
            falls: c.fall,
            lag: c.lag,
            state: c.state,
            omega: c.omega,
            lift: c.lift,
            lifted: c.lifted,
            bonds: Vec::new(),
            loose: true,
        }
    }

    /// Of `all`, ascending by number, that stick together by `bonds` and rest or fly alike.
    pub fn of(all: &[&Catkin], bonds: Vec<ClusterBond>, options: &FlightParams) -> Self {
        let mass: f64 = all.iter().fold(0.0, |sum, c| sum + c.mass);
        let x = all.iter().fold(DVec3::ZERO, |sum, c| sum + c.x * c.mass) / mass;
        let falls: f64 = all.iter().fold(0.0, |sum, c| sum + c.fall);
        let fall = falls / all.len() as f64 * pow(all.len() as f64, options.beta);
        Self {
            members: all.iter().map(|c| c.id).collect(),
            offsets: all.iter().map(|c| c.x - x).collect(),
            x,
            mass,
            fall,
            falls,
            lag: VelocityDecay::of(fall, options),
            bonds,
            ..Self::alone(all[0])
        }
    }

    /// What is left together once some bonds are cut: members and their bonds.
    pub fn split(&self, cut: &[[u32; 2]]) -> Vec<(Vec<u32>, Vec<ClusterBond>)> {
        let whole = |b: &&ClusterBond| !cut.iter().any(|[i, k]| b.ends == [*i, *k] || b.ends == [*k, *i]);
        let bonds: Vec<ClusterBond> = self.bonds.iter().filter(whole).copied().collect();
        let own = |members: Vec<u32>| {
            let mine = bonds.iter().filter(|b| members.binary_search(&b.ends[0]).is_ok()).copied().collect();
            (members, mine)
        };
        bonded_groups(&bonds, &self.members).into_iter().map(own).collect()
    }

    /// Moves members towards each other where they still draw in; the centre of mass stays. `mass`: of a member, kg.
    pub fn contract(&mut self, dt: f64, mass: impl Fn(u32) -> f64) {
        if let Some(moved) = contract_bonds(&mut self.bonds, &self.members, dt) {
            self.offsets.iter_mut().zip(moved).for_each(|(o, by)| *o += by);
            self.centre(mass);
        }
    }

    /// The same at rest, where the member that lies deepest stays and all others come to it. `out`: away from what it
    /// lies on.
    fn gather(&mut self, dt: f64, out: DVec3, mass: impl Fn(u32) -> f64) {
        let depth = |i: &usize| self.offsets[*i].dot(out);
        let Some(deepest) = (0..self.offsets.len()).min_by(|a, b| depth(a).total_cmp(&depth(b))) else { return };
        if let Some(moved) = contract_bonds(&mut self.bonds, &self.members, dt) {
            let stays = moved[deepest];
            self.offsets.iter_mut().zip(moved).for_each(|(o, by)| *o += by - stays);
            let off = self.centre(mass);
            self.x += off;
        }
    }

    /// Takes offsets from the centre of mass, and tells how far it was off.
    fn centre(&mut self, mass: impl Fn(u32) -> f64) -> DVec3 {
        let all = self.members.iter().zip(&self.offsets);
        let off = all.fold(DVec3::ZERO, |sum, (id, offset)| sum + *offset * mass(*id)) / self.mass;
        self.offsets.iter_mut().for_each(|o| *o -= off);
        off
    }

    /// Some members are still on their way to each other.
    pub fn draws_in(&self) -> bool {
        self.bonds.iter().any(|b| b.left != DVec3::ZERO)
    }

    /// Puts each member to a place of its own. `mass`: of a member, kg.
    pub fn put(&mut self, places: &[DVec3], mass: impl Fn(u32) -> f64) {
        self.offsets.iter_mut().zip(places).for_each(|(o, p)| *o = *p - self.x);
        let off = self.centre(mass);
        self.x += off;
    }

    /// Those that stick to each other, by their places among the members.
    pub fn bonded_members(&self) -> impl Iterator<Item = [usize; 2]> {
        self.bonds.iter().filter_map(|bond| {
            let [a, b] = bond.ends.map(|id| self.members.binary_search(&id));
            Some([a.ok()?, b.ok()?])
        })
    }

    /// Turns by `omega`, rad/s, for a step.
    pub fn turn_by(&mut self, omega: Vec3, dt: f64) {
        self.omega = omega;
        let turn = DQuat::from_scaled_axis(omega.as_dvec3() * dt);
        self.offsets.iter_mut().for_each(|o| *o = turn * *o);
        self.bonds.iter_mut().for_each(|b| b.left = turn * b.left);
    }

    /// At most `count` members, evenly spaced: their places in `members`.
    pub fn evenly_spaced_members(&self, count: usize) -> impl Iterator<Item = usize> {
        let n = self.members.len();
        (0..n.min(count)).map(move |i| if n <= count { i } else { i * n / count })
    }

    /// How fast a member moves that is `offset` from its centre, m/s.
    fn speed_at(&self, offset: DVec3) -> DVec3 {
        if self.state == CatkinState::Airborne { self.v + self.omega.as_dvec3().cross(offset) } else { self.v }
    }

    /// Upward air that still carries it after taking off, m/s.
    pub fn lift_at(&self, t: f64) -> f64 {
        rising(self.lift, t - self.lifted)
    }

    /// Both as one, at the place of the first; momentum is kept in the air, and whoever rests makes the other rest.
    fn with(self, other: Self, t: f64) -> Self {
        let mass = self.mass + other.mass;
        let (a, b) = (self.mass / mass, other.mass / mass);
        let flies = self.state == CatkinState::Airborne && other.state == CatkinState::Airborne;
        let x = self.x * a + other.x * b;
        let moved = [self.x - x, other.x - x];
        let (members, offsets) = merged([&self, &other], moved);
        let mut bonds = self.bonds;
        bonds.extend(other.bonds);
        Self {
            members,
            offsets,
            x,
            v: if flies { self.v * a + other.v * b } else { DVec3::ZERO },
            mass,
            lift: if flies { self.lift * a + other.lift * b } else { 0.0 },
            lifted: t,
            state: together(self.state, other.state),
            omega: if flies {
                self.omega * osier_base::math::narrow(a) + other.omega * osier_base::math::narrow(b)
            } else {
                Vec3::ZERO
            },
            bonds,
            loose: true,
            fall: self.fall,
            falls: self.falls + other.falls,
            lag: self.lag,
        }
    }
}

/// Members of two by number, with their offsets from a new centre.
fn merged([a, b]: [&CatkinCluster; 2], moved: [DVec3; 2]) -> (Vec<u32>, Vec<DVec3>) {
    let count = a.members.len() + b.members.len();
    let (mut members, mut offsets) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let (mut i, mut k) = (0, 0);
    while members.len() < count {
        let first = k >= b.members.len() || (i < a.members.len() && a.members[i] < b.members[k]);
        let (part, at, by) = if first { (a, &mut i, moved[0]) } else { (b, &mut k, moved[1]) };
        members.push(part.members[*at]);
        offsets.push(part.offsets[*at] + by);
        *at += 1;
    }
    (members, offsets)
}

/// What two are doing once they stick together.
fn together(a: CatkinState, b: CatkinState) -> CatkinState {
    match (a, b) {
        (CatkinState::Airborne, other) | (other, CatkinState::Airborne) => other,
        (a, b) if a == b => a,
        _ => CatkinState::Corner,
    }
}

impl FlightSimulation {
    /// A cluster, taken out of the map, or a single as one.
    fn take_cluster(&mut self, root: u32, t: f64) -> CatkinCluster {
        let mut body = self.clusters.remove(&root).unwrap_or_else(|| CatkinCluster::alone(self.catkin(root)));
        body.lift = body.lift_at(t);
        body.lifted = t;
        body
    }

    /// Makes one of what `i` and `j` belong to; nothing if they already are one.
    pub(super) fn join(&mut self, i: u32, j: u32, t: f64) {
        let (a, b) = (self.catkin(i).root, self.catkin(j).root);
        if a == b {
            return;
        }
        let (one, mut other) = (self.take_cluster(a, t), self.take_cluster(b, t));
        other.x += self.unwrap(one.x - other.x);
        let (ci, cj) = (self.catkin(i), self.catkin(j));
        let between = self.nearest_image(cj.x - ci.x);
        let flies = one.state == CatkinState::Airborne && other.state == CatkinState::Airborne;
        let close = self.options.stick_close * f64::from(ci.radius + cj.radius);
        let far = flies && between.length() > close;
        let left = if far { between * (1.0 - close / between.length()) } else { DVec3::ZERO };
        let resting = if one.state == CatkinState::Airborne { b } else { a };
        let (normal, face) = (self.catkin(resting).normal, self.catkin(resting).face);
        let mut whole = one.with(other, t);
        whole.bonds.push(ClusterBond { ends: [i, j], left });
        let n = whole.members.len() as f64;
        whole.fall = whole.falls / n * pow(n, self.options.beta);
        whole.lag = VelocityDecay::of(whole.fall, &self.options);
        let root = a.min(b);
        let mut landed = 0;
        for id in &whole.members {
            let state = whole.state;
            let c = self.catkin_mut(*id);
            // Who sticks to what lies has come to rest by it.
            landed += u64::from(c.state == CatkinState::Airborne && state.is_deposited());
            c.root = root;
            c.clustered = true;
            c.state = state;
            c.target = super::particles::NO_TARGET;
            if state != CatkinState::Airborne {
                (c.normal, c.face, c.free, c.moved_since_check, c.v, c.lift) =
                    (normal, face, false, true, DVec3::ZERO, 0.0);
            }
        }
        self.clusters.insert(root, whole);
        self.counters.deposits += landed;
        self.counters.merges += 1;
        self.place_members(root);
    }

    /// Brings members to where their cluster has them.
    fn place_members(&mut self, root: u32) {
        let Some(cluster) = self.clusters.remove(&root) else { return };
        for (id, offset) in cluster.members.iter().zip(&cluster.offsets) {
            let c = self.catkin_mut(*id);
            (c.x, c.v) = (cluster.x + *offset, cluster.speed_at(*offset));
        }
        self.clusters.insert(root, cluster);
    }

    /// After a step of a cluster: members follow, and rest if it does.
    pub(super) fn place(&mut self, root: u32, landing: &SweepResult) {
        let Some(mut cluster) = self.clusters.remove(&root) else { return };
        self.follow_cluster(&mut cluster, landing);
        self.clusters.insert(root, cluster);
    }

    /// The same for one that is not among the clusters now.
    pub(super) fn follow_cluster(&mut self, cluster: &mut CatkinCluster, landing: &SweepResult) {
        if let Some(hold) = landing.hold {
            if cluster.state == CatkinState::Airborne {
                cluster.v = DVec3::ZERO;
                cluster.omega = Vec3::ZERO;
                cluster.lift = 0.0;
            }
            cluster.state = hold.state;
        }
        for (id, offset) in cluster.members.iter().zip(&cluster.offsets) {
            let at = cluster.x + *offset;
            let c = self.catkin_mut(*id);
            c.travel += at - c.x;
            (c.x, c.v, c.state) = (at, cluster.speed_at(*offset), cluster.state);
            if let Some(hold) = landing.hold {
                c.rest_on(hold);
            }
        }
    }

    /// Parts of clusters that came to rest before they had drawn close: nothing stays hanging above what it clings to.
    pub(super) fn gather(&mut self) {
        let dt = self.options.time_step();
        let drawing = |c: &CatkinCluster| c.state.is_deposited() && c.draws_in();
        let roots: Vec<u32> = self.clusters.iter().filter(|(_, c)| drawing(c)).map(|(root, _)| *root).collect();
        for root in roots {
            let Some(mut cluster) = self.clusters.remove(&root) else { continue };
            cluster.gather(dt, self.catkin(root).normal.as_dvec3(), |id| self.catkin(id).mass);
            let landing = self.resolve_penetration(&cluster, cluster.x);
            cluster.x = landing.at;
            self.clusters.insert(root, cluster);
            self.place(root, &landing);
        }
    }

    /// A difference of places by the shortest way around periodic sides.
    pub(super) fn nearest_image(&self, between: DVec3) -> DVec3 {
        between + self.unwrap(between * -1.0)
    }

    /// Whole box lengths to add to a place that is `ahead` short of another, so that both are on the same side of a seam.
    fn unwrap(&self, ahead: DVec3) -> DVec3 {
        let size = self.options.inside.size().as_dvec3();
        let wrapped = |edge: super::SideBoundary, ahead: f64, size: f64| {
            if edge == super::SideBoundary::Periodic { (ahead / size).round() * size } else { 0.0 }
        };
        let [x, z] = self.options.edges;
        DVec3::new(wrapped(x, ahead.x, size.x), 0.0, wrapped(z, ahead.z, size.z))
    }
}
