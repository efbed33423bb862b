//! Clusters: catkins that stick together and move as one rigid body (\[catkin\] eq. 12, 13).

use std::collections::BTreeMap;

use glam::{DQuat, DVec3, Vec3};

use super::FlightSimulation;
use super::bonds::{ClusterBond, bonded_groups, contract_bonds};
use super::collision::SweepResult;
use super::params::FlightParams;
use super::particles::{Catkin, CatkinState, VelocityDecay, decayed_updraft};
use osier_base::math::pow;

/// Clusters by the smallest index of their members.
pub(super) type CatkinClusters = BTreeMap<u32, CatkinCluster>;

/// Bonded catkins that move as one rigid body, in the air or at rest.
#[derive(Debug, Clone)]
pub(super) struct CatkinCluster {
    /// Indices of the members, ascending.
    pub members: Vec<u32>,
    /// Offset of each member from the centre of mass, m.
    pub offsets: Vec<DVec3>,
    /// Centre of mass, m, and its velocity, m/s.
    pub x: DVec3,
    pub v: DVec3,
    pub mass: f64,
    /// Settling speed, m/s, and the sum of the settling speeds of its members as singles.
    pub fall: f64,
    sum_of_fall_speeds: f64,
    pub lag: VelocityDecay,
    pub state: CatkinState,
    pub omega: Vec3,
    /// Updraft at its lift-off, m/s, and time of the lift-off, s.
    pub lift: f64,
    pub lifted: f64,
    /// A spanning tree: one bond less than members.
    bonds: Vec<ClusterBond>,
    /// Whether some member may still sink in the heap.
    pub loose: bool,
}

impl CatkinCluster {
    /// A cluster of one catkin, with no bond, as an operand of [`CatkinCluster::merged_with`].
    fn from_single(c: &Catkin) -> Self {
        Self {
            members: vec![c.id],
            offsets: vec![DVec3::ZERO],
            x: c.x,
            v: c.v,
            mass: c.mass,
            fall: c.fall,
            sum_of_fall_speeds: c.fall,
            lag: c.lag,
            state: c.state,
            omega: c.omega,
            lift: c.lift,
            lifted: c.lifted,
            bonds: Vec::new(),
            loose: true,
        }
    }

    /// Cluster of the catkins `all`, ascending by index, in one state, held together by `bonds`. `dt`: length of the step, s.
    pub fn from_members(all: &[&Catkin], bonds: Vec<ClusterBond>, options: &FlightParams, dt: f64) -> Self {
        // Mass-weighted centre, and n^beta times the mean settling speed of the members.
        let mass: f64 = all.iter().fold(0.0, |sum, c| sum + c.mass);
        let x = all.iter().fold(DVec3::ZERO, |sum, c| sum + c.x * c.mass) / mass;
        let sum_of_fall_speeds: f64 = all.iter().fold(0.0, |sum, c| sum + c.fall);
        let fall = sum_of_fall_speeds / all.len() as f64 * pow(all.len() as f64, options.beta);
        Self {
            members: all.iter().map(|c| c.id).collect(),
            offsets: all.iter().map(|c| c.x - x).collect(),
            x,
            mass,
            fall,
            sum_of_fall_speeds,
            lag: VelocityDecay::for_settling_speed(fall, options, dt),
            bonds,
            ..Self::from_single(all[0])
        }
    }

    /// Connected components that remain when the bonds between the pairs `cut` break: members and bonds of each component.
    pub fn split_at_bonds(&self, cut: &[[u32; 2]]) -> Vec<(Vec<u32>, Vec<ClusterBond>)> {
        // Bonds that survive, then the components that they connect.
        let whole = |b: &&ClusterBond| !cut.iter().any(|[i, k]| b.ends == [*i, *k] || b.ends == [*k, *i]);
        let bonds: Vec<ClusterBond> = self.bonds.iter().filter(whole).copied().collect();
        let own = |members: Vec<u32>| {
            let mine = bonds.iter().filter(|b| members.binary_search(&b.ends[0]).is_ok()).copied().collect();
            (members, mine)
        };
        bonded_groups(&bonds, &self.members).into_iter().map(own).collect()
    }

    /// Contracts bonds of an airborne cluster; the centre of mass stays. `mass`: mass of the member of an index, kg.
    pub fn contract_in_flight(&mut self, dt: f64, mass: impl Fn(u32) -> f64) {
        if let Some(moved) = contract_bonds(&mut self.bonds, &self.members, dt) {
            self.offsets.iter_mut().zip(moved).for_each(|(o, by)| *o += by);
            self.recenter(mass);
        }
    }

    /// Contracts bonds of a deposited cluster about its deepest member, which stays. `out`: normal of the supporting
    /// surface.
    fn contract_at_rest(&mut self, dt: f64, out: DVec3, mass: impl Fn(u32) -> f64) {
        // The deepest member touches the surface and must not be pulled off it.
        let depth = |i: &usize| self.offsets[*i].dot(out);
        let Some(deepest) = (0..self.offsets.len()).min_by(|a, b| depth(a).total_cmp(&depth(b))) else { return };
        if let Some(moved) = contract_bonds(&mut self.bonds, &self.members, dt) {
            let stays = moved[deepest];
            self.offsets.iter_mut().zip(moved).for_each(|(o, by)| *o += by - stays);
            let off = self.recenter(mass);
            self.x += off;
        }
    }

    /// Makes offsets relative to the centre of mass again, and returns the vector that was subtracted from them, m. `mass`: mass
    /// of the member of an index, kg.
    fn recenter(&mut self, mass: impl Fn(u32) -> f64) -> DVec3 {
        let all = self.members.iter().zip(&self.offsets);
        let off = all.fold(DVec3::ZERO, |sum, (id, offset)| sum + *offset * mass(*id)) / self.mass;
        self.offsets.iter_mut().for_each(|o| *o -= off);
        off
    }

    /// Whether some bond is longer than its final length, so that members still move.
    pub fn is_contracting(&self) -> bool {
        self.bonds.iter().any(|b| b.left != DVec3::ZERO)
    }

    /// Sets the positions of all members, in the order of `members`, m, and the centre of mass. `mass`: mass of the member of an
    /// index, kg.
    pub fn set_member_positions(&mut self, places: &[DVec3], mass: impl Fn(u32) -> f64) {
        self.offsets.iter_mut().zip(places).for_each(|(o, p)| *o = *p - self.x);
        let off = self.recenter(mass);
        self.x += off;
    }

    /// Bonded pairs as positions in `members`, each bond once.
    pub fn bonded_members(&self) -> impl Iterator<Item = [usize; 2]> {
        self.bonds.iter().filter_map(|bond| {
            let [a, b] = bond.ends.map(|id| self.members.binary_search(&id));
            Some([a.ok()?, b.ok()?])
        })
    }

    /// Rotates offsets and bonds about the centre of mass for `dt` seconds, and stores `omega`, rad/s.
    pub fn rotate_by_step(&mut self, omega: Vec3, dt: f64) {
        self.omega = omega;
        // Remaining contractions rotate with the offsets: the cluster is rigid.
        let turn = DQuat::from_scaled_axis(omega.as_dvec3() * dt);
        self.offsets.iter_mut().for_each(|o| *o = turn * *o);
        self.bonds.iter_mut().for_each(|b| b.left = turn * b.left);
    }

    /// At most `count` evenly spaced positions in `members`; all positions if there are no more than `count` members.
    pub fn evenly_spaced_members(&self, count: usize) -> impl Iterator<Item = usize> {
        let n = self.members.len();
        (0..n.min(count)).map(move |i| if n <= count { i } else { i * n / count })
    }

    /// Velocity of the member at `offset` from the centre, m/s; without rotation once the cluster is deposited.
    fn member_velocity(&self, offset: DVec3) -> DVec3 {
        if self.state == CatkinState::Airborne { self.v + self.omega.as_dvec3().cross(offset) } else { self.v }
    }

    /// Updraft, m/s, that is left at time `t`, s, from the last lift-off.
    pub fn lift_at(&self, t: f64) -> f64 {
        decayed_updraft(self.lift, t - self.lifted)
    }

    /// Joins both clusters to one body. If both are airborne, linear momentum is conserved (\[catkin\] eq. 13); a deposited cluster
    /// stops the other.
    fn merged_with(self, other: Self, t: f64) -> Self {
        // Conserve momentum: velocities, updrafts and spins average by mass.
        let mass = self.mass + other.mass;
        let (a, b) = (self.mass / mass, other.mass / mass);
        let flies = self.state == CatkinState::Airborne && other.state == CatkinState::Airborne;
        let x = self.x * a + other.x * b;
        let moved = [self.x - x, other.x - x];
        let (members, offsets) = merge_members([&self, &other], moved);
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
            state: merged_state(self.state, other.state),
            omega: if flies {
                self.omega * osier_base::math::narrow(a) + other.omega * osier_base::math::narrow(b)
            } else {
                Vec3::ZERO
            },
            bonds,
            loose: true,
            fall: self.fall,
            sum_of_fall_speeds: self.sum_of_fall_speeds + other.sum_of_fall_speeds,
            lag: self.lag,
        }
    }
}

/// Merges the member lists of two clusters by ascending index; `moved`: old minus new centre of each, m.
fn merge_members([a, b]: [&CatkinCluster; 2], moved: [DVec3; 2]) -> (Vec<u32>, Vec<DVec3>) {
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

/// State of the merged body: deposited if either is; ground and wall make a corner.
fn merged_state(a: CatkinState, b: CatkinState) -> CatkinState {
    match (a, b) {
        (CatkinState::Airborne, other) | (other, CatkinState::Airborne) => other,
        (a, b) if a == b => a,
        _ => CatkinState::Corner,
    }
}

impl FlightSimulation {
    /// Takes a cluster out of the map, or makes one of a single; its updraft is evaluated at time `t`, s.
    fn take_cluster(&mut self, root: u32, t: f64) -> CatkinCluster {
        let mut body = self.clusters.remove(&root).unwrap_or_else(|| CatkinCluster::from_single(self.catkin(root)));
        body.lift = body.lift_at(t);
        body.lifted = t;
        body
    }

    /// Joins the clusters of catkins `i` and `j` by a new bond; does nothing if both are members of the same cluster.
    pub(super) fn join_catkins(&mut self, i: u32, j: u32, t: f64) {
        let (a, b) = (self.catkin(i).root, self.catkin(j).root);
        if a == b {
            return;
        }
        // Across a periodic side one of the clusters is shifted to its image next to the other: an airborne cluster rather than a
        // deposited one, of two deposited ones the smaller, of two airborne ones the second.
        let (mut one, mut other) = (self.take_cluster(a, t), self.take_cluster(b, t));
        let shift = self.periodic_shift(one.x - other.x);
        if shift != DVec3::ZERO {
            let other_stays = other.state.is_deposited()
                && (one.state == CatkinState::Airborne || one.members.len() < other.members.len());
            let (moved, by) = if other_stays { (&mut one, shift * -1.0) } else { (&mut other, shift) };
            moved.x += by;
            // The points of release are shifted too, so that the distances flown do not change.
            moved.members.iter().for_each(|id| self.catkin_mut(*id).from += by);
        }
        let (ci, cj) = (self.catkin(i), self.catkin(j));
        let between = self.nearest_image(cj.x - ci.x);
        let flies = one.state == CatkinState::Airborne && other.state == CatkinState::Airborne;
        let touching = f64::from(ci.radius + cj.radius);
        let close = self.options.stick_close * touching;
        // A pair that met in the air contracts along the new bond until it is `stick_close` of both radii apart, even if one
        // of the two has landed since.
        let far = between.length() > if flies { close } else { touching };
        let left = if far { between * (1.0 - close / between.length()) } else { DVec3::ZERO };
        // The deposited one of the two determines the surface that both rest on.
        let resting = if one.state == CatkinState::Airborne { b } else { a };
        let (normal, face) = (self.catkin(resting).normal, self.catkin(resting).face);
        // The merged body settles at n^beta times the mean speed of its members, which determines its decay.
        let mut whole = one.merged_with(other, t);
        whole.bonds.push(ClusterBond { ends: [i, j], left });
        let n = whole.members.len() as f64;
        whole.fall = whole.sum_of_fall_speeds / n * pow(n, self.options.beta);
        whole.lag = VelocityDecay::for_settling_speed(whole.fall, &self.options, self.time_step());
        let root = a.min(b);
        let mut landed = Vec::new();
        // All members take over the state of the merged body.
        for id in &whole.members {
            let state = whole.state;
            let c = self.catkin_mut(*id);
            // An airborne catkin that joins a deposited one has landed.
            if c.state == CatkinState::Airborne && state.is_deposited() {
                landed.push(*id);
            }
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
        self.counters.merges += 1;
        self.place_members(root);
        let places: Vec<_> = landed.into_iter().filter_map(|id| self.catkin(id).resting_place()).collect();
        self.record_landings(places);
    }

    /// Sets positions and velocities of members from centre, offsets and rotation of their cluster.
    fn place_members(&mut self, root: u32) {
        let Some(cluster) = self.clusters.remove(&root) else { return };
        for (id, offset) in cluster.members.iter().zip(&cluster.offsets) {
            let c = self.catkin_mut(*id);
            (c.x, c.v) = (cluster.x + *offset, cluster.member_velocity(*offset));
        }
        self.clusters.insert(root, cluster);
    }

    /// Moves members with their cluster after a sweep, and deposits them if it touched.
    pub(super) fn move_cluster_members(&mut self, root: u32, landing: &SweepResult) {
        let Some(mut cluster) = self.clusters.remove(&root) else { return };
        self.follow_cluster(&mut cluster, landing);
        self.clusters.insert(root, cluster);
    }

    /// As [`FlightSimulation::move_cluster_members`], for a cluster that is out of the map.
    pub(super) fn follow_cluster(&mut self, cluster: &mut CatkinCluster, landing: &SweepResult) {
        // A first contact stops the cluster; a sliding deposit keeps its velocity.
        if let Some(hold) = landing.contact {
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
            (c.x, c.v, c.state) = (at, cluster.member_velocity(*offset), cluster.state);
            if let Some(hold) = landing.contact {
                c.rest_on(hold);
            }
        }
    }

    /// Contracts deposited clusters whose bonds are still longer than their final length; all members stay on the surface.
    pub(super) fn contract_resting_clusters(&mut self) {
        let dt = self.time_step();
        let drawing = |c: &CatkinCluster| c.state.is_deposited() && c.is_contracting();
        let roots: Vec<u32> = self.clusters.iter().filter(|(_, c)| drawing(c)).map(|(root, _)| *root).collect();
        for root in roots {
            // The cluster leaves the map while its members are read and written.
            let Some(mut cluster) = self.clusters.remove(&root) else { continue };
            cluster.contract_at_rest(dt, self.catkin(root).normal.as_dvec3(), |id| self.catkin(id).mass);
            let landing = self.resolve_penetration(&cluster, cluster.x);
            cluster.x = landing.at;
            self.clusters.insert(root, cluster);
            self.move_cluster_members(root, &landing);
        }
    }

    /// Shortest image of a difference of positions under periodic sides.
    pub(super) fn nearest_image(&self, between: DVec3) -> DVec3 {
        between + self.periodic_shift(between * -1.0)
    }

    /// Translations by whole box sizes from a place to its images: for each periodic side within `reach`, m, of the place there
    /// is an image beyond the opposite side. The first translation is 0.
    pub(super) fn image_shifts(&self, at: Vec3, reach: f32) -> impl Iterator<Item = Vec3> {
        let (inside, [ex, ez]) = (self.options.inside, self.options.edges);
        let size = inside.size();
        let along = |edge: super::SideBoundary, from_low: f32, from_high: f32, size: f32| {
            let periodic = edge == super::SideBoundary::Periodic;
            [
                Some(0.0),
                (periodic && from_low < reach).then_some(size),
                (periodic && from_high < reach).then_some(-size),
            ]
        };
        let xs = along(ex, at.x - inside.min.x, inside.max.x - at.x, size.x);
        let zs = along(ez, at.z - inside.min.z, inside.max.z - at.z, size.z);
        xs.into_iter().flatten().flat_map(move |x| zs.into_iter().flatten().map(move |z| Vec3::new(x, 0.0, z)))
    }

    /// Translation by whole box sizes, along periodic axes, that brings a position next to another; `ahead`: vector to it, m.
    fn periodic_shift(&self, ahead: DVec3) -> DVec3 {
        let size = self.options.inside.size().as_dvec3();
        let wrapped = |edge: super::SideBoundary, ahead: f64, size: f64| {
            if edge == super::SideBoundary::Periodic { (ahead / size).round() * size } else { 0.0 }
        };
        let [x, z] = self.options.edges;
        DVec3::new(wrapped(x, ahead.x, size.x), 0.0, wrapped(z, ahead.z, size.z))
    }
}
