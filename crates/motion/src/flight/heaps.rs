//! Relaxation of heaps: members of a deposited cluster sink until ground, a wall's top or other members support them;
//! a member that only its bonds hold tears off.
//!
//! Own: the paper joins catkins on contact and leaves it at that. Rigid clusters would stand up a wall as columns,
//! since a catkin that slides down meets the topmost member first; its Fig. 12c shows heaps at the foot.

use glam::DVec3;

use super::FlightSimulation;
use super::clusters::CatkinCluster;
use super::collision::{combined_contact, is_supported, push_out_of_solids, surface_contact};
use super::particles::{Catkin, CatkinState};
use crate::flight::tuning::{
    MAX_HEAP_PUSH_OUT_ROUNDS, MIN_SINK_SHARE, PACKING_SHARE, POSITION_TOLERANCE, SUPPORT_FACTOR,
};
use osier_base::math::{GOLDEN_ANGLE, cos, narrow, sin};
use osier_base::neighbours::NeighbourGrid;
use osier_base::par::par_map;

struct HeapMember {
    at: DVec3,
    radius: f64,
    /// Positions in [`HeapRelaxation::all`] of the members that are bonded to it.
    bonds: Vec<usize>,
}

struct HeapRelaxation<'a> {
    flights: &'a FlightSimulation,
    all: Vec<HeapMember>,
    near: NeighbourGrid,
    widest: f64,
    /// Broken bonds, as pairs of positions in `all`.
    torn: Vec<[usize; 2]>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum SinkOutcome {
    Supported,
    Sank,
    /// It could move down, but a bond would stretch.
    HeldByBonds,
}

impl<'a> HeapRelaxation<'a> {
    fn new(flights: &'a FlightSimulation, cluster: &CatkinCluster) -> Self {
        // Work on copies of positions and bonds: the simulation stays readable by all tasks.
        let each = cluster.members.iter().zip(&cluster.offsets);
        let mut all: Vec<HeapMember> = each
            .map(|(id, offset)| {
                let radius = f64::from(flights.catkin(*id).radius);
                HeapMember { at: cluster.x + *offset, radius, bonds: Vec::new() }
            })
            .collect();
        for [a, b] in cluster.bonded_members() {
            all[a].bonds.push(b);
            all[b].bonds.push(a);
        }
        let widest = all.iter().map(|m| m.radius).fold(1e-3, f64::max);
        let near = NeighbourGrid::new(narrow(2.0 * widest), (0..).zip(all.iter().map(|m| m.at.as_vec3())));
        Self { flights, all, near, widest, torn: Vec::new() }
    }

    /// Moves member `i` down by at most `way`, m, as far as others and solids allow and no bond stretches.
    fn sink_member(&mut self, i: usize, way: f64) -> SinkOutcome {
        let (from, radius) = (self.all[i].at, self.all[i].radius);
        let solids = &self.flights.solids;
        if way <= 0.0 || is_supported(solids, from, narrow(radius)) {
            return SinkOutcome::Supported;
        }
        // Move down and sideways off the support, then out of neighbours and solids; refuse a move that gains no
        // depth, squeezes a neighbour or stretches a bond.
        let others = self.neighbours_of(i, 2.0 * way);
        let at = self.resolve_overlaps(from + (self.roll_direction(i, &others) - DVec3::Y) * way, radius, &others);
        let gap = |k: &usize, at: DVec3| at.distance(self.all[*k].at);
        let reach = |k: &usize| radius + self.all[*k].radius;
        let free = |k: &usize| gap(k, at) >= (PACKING_SHARE * reach(k)).min(gap(k, from)) - POSITION_TOLERANCE;
        if from.y - at.y < MIN_SINK_SHARE * way || !others.iter().all(free) {
            return SinkOutcome::Supported;
        }
        if !self.all[i].bonds.iter().all(|k| gap(k, at) <= reach(k).max(gap(k, from)) + POSITION_TOLERANCE) {
            return SinkOutcome::HeldByBonds;
        }
        self.all[i].at = at;
        SinkOutcome::Sank
    }

    /// Horizontal direction in which a member rolls off its support; zero without one.
    fn roll_direction(&self, i: usize, others: &[usize]) -> DVec3 {
        let HeapMember { at, radius, .. } = &self.all[i];
        let bears = |k: &&usize| {
            let other = &self.all[**k];
            other.at.y < at.y && at.distance(other.at) < SUPPORT_FACTOR * PACKING_SHARE * (radius + other.radius)
        };
        // The nearest lower member within contact distance is the support.
        let near = |k: &usize| at.distance_squared(self.all[*k].at);
        let bearer = others.iter().filter(bears).min_by(|a, b| near(a).total_cmp(&near(b)).then(a.cmp(b)));
        let Some(bearer) = bearer.map(|k| &self.all[*k]) else { return DVec3::ZERO };
        let off = (*at - bearer.at) * DVec3::new(1.0, 0.0, 1.0);
        // Exactly above its support any direction will do: the golden angle spreads members over all of them.
        let turn = GOLDEN_ANGLE * i as f64;
        off.try_normalize().unwrap_or_else(|| DVec3::new(cos(turn), 0.0, sin(turn)))
    }

    /// Members within contact distance plus `more`, m, of member `i`.
    fn neighbours_of(&self, i: usize, more: f64) -> Vec<usize> {
        let HeapMember { at, radius, .. } = &self.all[i];
        let arm = glam::Vec3::splat(narrow(radius + self.widest + more));
        let mut others = Vec::new();
        self.near.for_each_in_box(at.as_vec3() - arm, at.as_vec3() + arm, |k| others.push(k as usize));
        others.retain(|k| *k != i);
        others
    }

    /// Position that is pushed out of `others` and of solids in at most [`MAX_HEAP_PUSH_OUT_ROUNDS`] rounds. `radius`, m.
    fn resolve_overlaps(&self, mut at: DVec3, radius: f64, others: &[usize]) -> DVec3 {
        for _ in 0..MAX_HEAP_PUSH_OUT_ROUNDS {
            for other in others.iter().map(|k| &self.all[*k]) {
                // Project out of each overlap in turn, then out of the solids.
                let (apart, least) = (at - other.at, PACKING_SHARE * (radius + other.radius));
                if apart.length_squared() < least * least {
                    at = other.at + apart.try_normalize().unwrap_or(DVec3::Y) * least;
                }
            }
            at = push_out_of_solids(&self.flights.solids, at, narrow(radius));
        }
        at
    }

    /// Lets all members sink by at most `ways`, m, the lowest first, and breaks bonds that hold a member up. Returns whether
    /// any member moved or any bond broke.
    fn relax_members(&mut self, ways: &[f64]) -> bool {
        let mut order: Vec<usize> = (0..self.all.len()).collect();
        order.sort_by(|a, b| self.all[*a].at.y.total_cmp(&self.all[*b].at.y).then(a.cmp(b)));
        let mut sank = vec![false; self.all.len()];
        // Lowest first, so that a support has settled before the members on it; once more for members whose bonds held
        // them up in the first pass.
        for _ in 0..2 {
            let tried: Vec<(usize, SinkOutcome)> = order.iter().map(|i| (*i, self.sink_member(*i, ways[*i]))).collect();
            tried.iter().for_each(|(i, s)| sank[*i] |= *s == SinkOutcome::Sank);
            order = tried.into_iter().filter(|(_, s)| *s == SinkOutcome::HeldByBonds).map(|(i, _)| i).collect();
        }
        for i in order {
            let above = |k: &&usize| !sank[**k] && self.all[**k].at.y > self.all[i].at.y;
            self.torn.extend(self.all[i].bonds.iter().filter(above).map(|k| [i, *k]));
        }
        !self.torn.is_empty() || sank.contains(&true)
    }
}

/// Positions, m, and broken bonds of a heap after a step; in the order of the cluster's members.
struct RelaxedHeap {
    places: Vec<DVec3>,
    /// Broken bonds, as pairs of catkin indices.
    torn: Vec<[u32; 2]>,
}

impl FlightSimulation {
    /// Relaxes all heaps on the ground and at the foot of walls; a wetter wall slows those at its foot.
    pub(super) fn relax_heaps(&mut self) {
        // Clusters at rest are skipped until something touches them.
        let lies = |c: &CatkinCluster| c.loose && matches!(c.state, CatkinState::Grounded | CatkinState::Corner);
        let roots: Vec<u32> = self.clusters.iter().filter(|(_, c)| lies(c)).map(|(root, _)| *root).collect();
        let sagged = par_map(&roots, |root| self.relaxed_heap(self.clusters.get(root)?));
        for (root, sagged) in roots.into_iter().zip(sagged) {
            let Some(mut cluster) = self.clusters.remove(&root) else { continue };
            let Some(RelaxedHeap { places, torn }) = sagged else {
                cluster.loose = cluster.is_contracting();
                self.clusters.insert(root, cluster);
                continue;
            };
            cluster.set_member_positions(&places, |id| self.catkin(id).mass);
            let landing = self.resolve_penetration(&cluster, cluster.x);
            cluster.x = landing.at;
            self.clusters.insert(root, cluster);
            self.move_cluster_members(root, &landing);
            if !torn.is_empty() {
                self.split_cluster(root, &torn);
            }
        }
    }

    /// Relaxes one cluster; `None` if no member sinks and no bond breaks.
    fn relaxed_heap(&self, cluster: &CatkinCluster) -> Option<RelaxedHeap> {
        let dt = self.time_step();
        // A member sinks at the settling speed that it has as a single, reduced by the wall's humidity in a corner.
        let way = |id: &u32| {
            let c = self.catkin(*id);
            let wet = if cluster.state == CatkinState::Corner { self.face_humidity(c) } else { 0.0 };
            (1.0 - wet) * c.fall * dt
        };
        let ways: Vec<f64> = cluster.members.iter().map(way).collect();
        let mut heap = HeapRelaxation::new(self, cluster);
        if !heap.relax_members(&ways) {
            return None;
        }
        let torn = heap.torn.iter().map(|pair| pair.map(|i| cluster.members[i])).collect();
        Some(RelaxedHeap { places: heap.all.iter().map(|m| m.at).collect(), torn })
    }

    /// Breaks bonds of a deposited cluster: each component becomes a body, airborne if it touches no surface.
    fn split_cluster(&mut self, root: u32, torn: &[[u32; 2]]) {
        let Some(cluster) = self.clusters.remove(&root) else { return };
        for (members, bonds) in cluster.split_at_bonds(torn) {
            let holds = members.iter().filter_map(|id| {
                let c = self.catkin(*id);
                surface_contact(&self.solids, c.x, c.radius)
            });
            let held = combined_contact(&holds.collect::<Vec<_>>());
            self.counters.falls += if held.is_none() { members.len() as u64 } else { 0 };
            for id in &members {
                let c = self.catkin_mut(*id);
                (c.root, c.clustered) = (members[0], members.len() > 1);
                match held {
                    Some(hold) => {
                        c.rest_on(hold);
                        // The part has not moved: without a contact check it cannot join the rest of the cluster again.
                        c.moved_since_check = false;
                    }
                    // Its path begins here, so that its displacement in the heap does not count as an approach to the rest of the cluster.
                    None => (c.state, c.rested, c.travel) = (CatkinState::Airborne, -1.0, DVec3::ZERO),
                }
            }
            if members.len() > 1 {
                let all: Vec<&Catkin> = members.iter().map(|id| self.catkin(*id)).collect();
                let part = CatkinCluster::from_members(&all, bonds, &self.options, self.time_step());
                self.clusters.insert(members[0], part);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;

    use super::super::collision::SurfaceContact;
    use super::super::{CatkinStart, FlightParams, ReleaseCondition};
    use super::*;
    use osier_scene::solid::Solids;

    /// A member that hung in the air by its bond falls, though the contraction of the heap had moved it towards the rest.
    #[test]
    fn a_torn_member_does_not_join_its_heap_again() {
        let start = CatkinStart { at: DVec3::Y, wait: ReleaseCondition::Until(0.0) };
        let solids = Arc::new(Solids::new(Vec::new(), true));
        let mut flights = FlightSimulation::new(FlightParams::default(), solids, &[start; 2]);
        let [lower, upper] = [0, 1].map(|id| f64::from(flights.catkin(id).radius));
        // They touch; the upper one is a diameter above the ground.
        let beside = 0.6 * (lower + upper);
        let ground = SurfaceContact { state: CatkinState::Grounded, normal: Vec3::Y, face: None };
        for (id, x) in [(0, DVec3::Y * lower), (1, DVec3::new(beside, lower + beside, 0.0))] {
            let c = flights.catkin_mut(id);
            (c.x, c.travel, c.free) = (x, DVec3::ZERO, false);
            c.rest_on(ground);
        }
        flights.join_catkins(0, 1, 0.0);
        let way = (flights.catkin(0).x - flights.catkin(1).x) * 0.1;
        flights.catkin_mut(1).travel = way;
        flights.split_cluster(0, &[[0, 1]]);
        flights.join_contacts(0.0);
        let stats = flights.stats();
        assert_eq!((stats.merges, stats.falls, stats.deposits), (1, 1, 0));
        assert_eq!((stats.grounded, stats.airborne, stats.clusters), (1, 1, 0));
    }
}
