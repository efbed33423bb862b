//! Heaps sag: what lies in a cluster sinks until the ground, a wall's top or others below bear it, and what would hang on
//! others tears off.
//!
//! Own: the paper joins those that meet and says no more of them. Kept as stiff as in the air, clusters stand up a wall as
//! chains, for whoever slides down it meets the topmost first; its Fig. 12c has heaps at the foot.

use glam::DVec3;

use super::FlightSimulation;
use super::clusters::CatkinCluster;
use super::deposit::{borne, hold, joint, out_of};
use super::grid::CellGrid;
use super::particles::{Catkin, CatkinState};
use osier_base::math::{cos, narrow, sin};
use osier_base::par::par_map;

/// How close those in a heap come, as a share of both radii: under their weight hairs slip into each other.
const PACKING_SHARE: f64 = 0.5;

/// Who is not much further from one that lies lower is borne by it.
const SUPPORT_FACTOR: f64 = 1.2;

/// An angle whose multiples fall all about, rad.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Rounds in which one that sinks is pushed out of those that it lies in.
const MAX_PUSH_OUT_ROUNDS: u32 = 4;

/// Who comes down by less than this share of its way is borne.
const MIN_SINK_SHARE: f64 = 0.05;

/// What places may be off by, m.
const POSITION_TOLERANCE: f64 = 1e-4;

/// One of a heap and what it is near to.
struct HeapMember {
    at: DVec3,
    radius: f64,
    /// Those that it holds on to, by their places among the members.
    bonds: Vec<usize>,
}

/// A step of a heap: its members, sinking one after the other.
struct HeapRelaxation<'a> {
    flights: &'a FlightSimulation,
    all: Vec<HeapMember>,
    near: CellGrid,
    widest: f64,
    /// Pairs of those that tore off each other.
    torn: Vec<[usize; 2]>,
}

/// What became of one that may sink.
#[derive(Debug, Clone, Copy, PartialEq)]
enum SinkOutcome {
    Borne,
    Down,
    /// Others hold it up.
    Hangs,
}

impl<'a> HeapRelaxation<'a> {
    fn new(flights: &'a FlightSimulation, cluster: &CatkinCluster) -> Self {
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
        let near = CellGrid::new(narrow(2.0 * widest), (0..).zip(all.iter().map(|m| m.at.as_vec3())));
        Self { flights, all, near, widest, torn: Vec::new() }
    }

    /// Lets one sink by `way`, m, as far as others and solids let it, and only as far as it keeps hold of those that it
    /// sticks to.
    fn slide_down_walls(&mut self, i: usize, way: f64) -> SinkOutcome {
        let (from, radius) = (self.all[i].at, self.all[i].radius);
        let solids = &self.flights.solids;
        if way <= 0.0 || borne(solids, from, narrow(radius)) {
            return SinkOutcome::Borne;
        }
        // Move down and sideways off the support, then out of neighbours and solids; refuse a move that gains no
        // depth, squeezes a neighbour or stretches a bond.
        let others = self.around(i, 2.0 * way);
        let at = self.out_of_overlaps(from + (self.roll_direction(i, &others) - DVec3::Y) * way, radius, &others);
        let gap = |k: &usize, at: DVec3| at.distance(self.all[*k].at);
        let reach = |k: &usize| radius + self.all[*k].radius;
        let free = |k: &usize| gap(k, at) >= (PACKING_SHARE * reach(k)).min(gap(k, from)) - POSITION_TOLERANCE;
        if from.y - at.y < MIN_SINK_SHARE * way || !others.iter().all(free) {
            return SinkOutcome::Borne;
        }
        if !self.all[i].bonds.iter().all(|k| gap(k, at) <= reach(k).max(gap(k, from)) + POSITION_TOLERANCE) {
            return SinkOutcome::Hangs;
        }
        self.all[i].at = at;
        SinkOutcome::Down
    }

    /// Level direction in which one rolls off the one that bears it, nil if none does.
    fn roll_direction(&self, i: usize, others: &[usize]) -> DVec3 {
        let HeapMember { at, radius, .. } = &self.all[i];
        let bears = |k: &&usize| {
            let other = &self.all[**k];
            other.at.y < at.y && at.distance(other.at) < SUPPORT_FACTOR * PACKING_SHARE * (radius + other.radius)
        };
        let near = |k: &usize| at.distance_squared(self.all[*k].at);
        let bearer = others.iter().filter(bears).min_by(|a, b| near(a).total_cmp(&near(b)).then(a.cmp(b)));
        let Some(bearer) = bearer.map(|k| &self.all[*k]) else { return DVec3::ZERO };
        let off = (*at - bearer.at) * DVec3::new(1.0, 0.0, 1.0);
        // One that stands upright on another falls to a side of its own.
        let turn = GOLDEN_ANGLE * i as f64;
        off.try_normalize().unwrap_or_else(|| DVec3::new(cos(turn), 0.0, sin(turn)))
    }

    /// Those within touch of one, and `more`, m.
    fn around(&self, i: usize, more: f64) -> Vec<usize> {
        let HeapMember { at, radius, .. } = &self.all[i];
        let arm = glam::Vec3::splat(narrow(radius + self.widest + more));
        let mut others = Vec::new();
        self.near.each(at.as_vec3() - arm, at.as_vec3() + arm, |k| others.push(k as usize));
        others.retain(|k| *k != i);
        others
    }

    /// A place out of solids and of others.
    fn out_of_overlaps(&self, mut at: DVec3, radius: f64, others: &[usize]) -> DVec3 {
        for _ in 0..MAX_PUSH_OUT_ROUNDS {
            for other in others.iter().map(|k| &self.all[*k]) {
                let (apart, least) = (at - other.at, PACKING_SHARE * (radius + other.radius));
                if apart.length_squared() < least * least {
                    at = other.at + apart.try_normalize().unwrap_or(DVec3::Y) * least;
                }
            }
            at = out_of(&self.flights.solids, at, narrow(radius));
        }
        at
    }

    /// Lets all sink, the lowest first, and once more those that others held up, who may have come down since. Hairs bear
    /// nobody: who still hangs tears off. True if anything changed.
    fn relax(&mut self, ways: &[f64]) -> bool {
        let mut order: Vec<usize> = (0..self.all.len()).collect();
        order.sort_by(|a, b| self.all[*a].at.y.total_cmp(&self.all[*b].at.y).then(a.cmp(b)));
        let mut sank = vec![false; self.all.len()];
        // Lowest first, so that a support has settled before what rests on it; once more for those whose bonds held
        // them up in the first pass.
        for _ in 0..2 {
            let tried: Vec<(usize, SinkOutcome)> =
                order.iter().map(|i| (*i, self.slide_down_walls(*i, ways[*i]))).collect();
            tried.iter().for_each(|(i, s)| sank[*i] |= *s == SinkOutcome::Down);
            order = tried.into_iter().filter(|(_, s)| *s == SinkOutcome::Hangs).map(|(i, _)| i).collect();
        }
        for i in order {
            let above = |k: &&usize| !sank[**k] && self.all[**k].at.y > self.all[i].at.y;
            self.torn.extend(self.all[i].bonds.iter().filter(above).map(|k| [i, *k]));
        }
        !self.torn.is_empty() || sank.contains(&true)
    }
}

/// A heap after a step.
struct RelaxedHeap {
    places: Vec<DVec3>,
    /// Numbers of those that tore off each other.
    torn: Vec<[u32; 2]>,
}

impl FlightSimulation {
    /// Members of clusters that lie on the ground or at the foot of a wall sink, at the wall the slower the wetter it is.
    pub(super) fn relax_heaps(&mut self) {
        let lies = |c: &CatkinCluster| c.loose && matches!(c.state, CatkinState::Grounded | CatkinState::Corner);
        let roots: Vec<u32> = self.clusters.iter().filter(|(_, c)| lies(c)).map(|(root, _)| *root).collect();
        let sagged = par_map(&roots, |root| self.relaxed_heap(self.clusters.get(root)?));
        for (root, sagged) in roots.into_iter().zip(sagged) {
            let Some(mut cluster) = self.clusters.remove(&root) else { continue };
            let Some(RelaxedHeap { places, torn }) = sagged else {
                cluster.loose = cluster.draws_in();
                self.clusters.insert(root, cluster);
                continue;
            };
            cluster.put(&places, |id| self.catkin(id).mass);
            let landing = self.resolve_penetration(&cluster, cluster.x);
            cluster.x = landing.at;
            self.clusters.insert(root, cluster);
            self.place(root, &landing);
            if !torn.is_empty() {
                self.split_cluster(root, &torn);
            }
        }
    }

    /// A cluster after a step, none if nobody sinks.
    fn relaxed_heap(&self, cluster: &CatkinCluster) -> Option<RelaxedHeap> {
        let dt = self.options.time_step();
        let way = |id: &u32| {
            let c = self.catkin(*id);
            let wet = if cluster.state == CatkinState::Corner { self.wall_humidity(c.face) } else { 0.0 };
            (1.0 - wet) * c.fall * dt
        };
        let ways: Vec<f64> = cluster.members.iter().map(way).collect();
        let mut heap = HeapRelaxation::new(self, cluster);
        if !heap.relax(&ways) {
            return None;
        }
        let torn = heap.torn.iter().map(|pair| pair.map(|i| cluster.members[i])).collect();
        Some(RelaxedHeap { places: heap.all.iter().map(|m| m.at).collect(), torn })
    }

    /// Cuts bonds of a cluster that lies: each part goes on by itself, in the air if it touches nothing.
    fn split_cluster(&mut self, root: u32, torn: &[[u32; 2]]) {
        let Some(cluster) = self.clusters.remove(&root) else { return };
        for (members, bonds) in cluster.split(torn) {
            let holds = members.iter().filter_map(|id| {
                let c = self.catkin(*id);
                hold(&self.solids, c.x, c.radius)
            });
            let held = joint(&holds.collect::<Vec<_>>());
            for id in &members {
                let c = self.catkin_mut(*id);
                (c.root, c.clustered) = (members[0], members.len() > 1);
                match held {
                    Some(hold) => c.rest_on(hold),
                    None => (c.state, c.rested) = (CatkinState::Airborne, -1.0),
                }
            }
            if members.len() > 1 {
                let all: Vec<&Catkin> = members.iter().map(|id| self.catkin(*id)).collect();
                let part = CatkinCluster::of(&all, bonds, &self.options);
                self.clusters.insert(members[0], part);
            }
        }
    }
}
