//! Clusters of all pieces joined into trees that stand on the ground.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use super::clusters::Clusters;
use super::parts::{DisjointSets, index};
use super::refine::RefinedSurface;
use super::wood_search::{WoodSample, WoodSearch};
use osier_base::math;

/// Pieces farther apart than so many radii of the joint, and than this share of the whole, stay apart.
const JOIN_REACH: (f32, f32) = (10.0, 0.02);
/// What a thin end costs against a thick one, as a share of its piece's length.
const THIN_END_COST: f32 = 0.05;
/// Places per radius along a centreline.
const SAMPLES_PER_RADIUS: f32 = 0.5;

/// The mean of a cluster.
#[derive(Debug, Clone)]
pub(super) struct SkeletonNode {
    pub p: DVec3,
    /// Mean radius of the wood, m.
    pub r: f32,
    /// Index of the piece of wood.
    pub piece: u32,
    /// Neighbours in the tree, of its own piece first.
    pub beside: Vec<u32>,
    /// False for a bump that became part of its neighbour.
    pub live: bool,
}

/// Nodes with the tree between them.
#[derive(Debug, Default)]
pub(super) struct SkeletonGraph {
    pub nodes: Vec<SkeletonNode>,
    /// Where each piece's nodes begin, and its clusters' nodes.
    pub of: Vec<Vec<u32>>,
}

impl SkeletonGraph {
    /// Adds the clusters of a piece: the minimum spanning tree of those that touch, without the bumps.
    pub fn add(&mut self, fine: &RefinedSurface, clusters: &Clusters) {
        let first = index(self.nodes.len());
        let piece = index(self.of.len());
        // Radius of a node: area-weighted mean over its cluster.
        let mut radii = vec![(0.0, 0.0); clusters.middles.len()];
        for (i, c) in clusters.of.iter().enumerate() {
            let Some(sum) = radii.get_mut(*c as usize) else { continue };
            *sum = (sum.0 + fine.areas[i] * f64::from(fine.radii[i]), sum.1 + fine.areas[i]);
        }
        let nodes = clusters.middles.iter().zip(&radii);
        let node = |(p, (sum, area)): (&DVec3, &(f64, f64))| {
            let r = if *area > 0.0 { math::narrow(sum / area) } else { fine.radii[0] };
            SkeletonNode { p: *p, r, piece, beside: Vec::new(), live: true }
        };
        self.nodes.extend(nodes.map(node));
        let length = |[a, b]: [u32; 2]| clusters.middles[a as usize].distance(clusters.middles[b as usize]);
        let mut edges: Vec<(f64, [u32; 2])> =
            clusters.pairs(fine).into_iter().map(|pair| (length(pair), pair)).collect();
        // Kruskal's algorithm: the shortest edges first, unless they close a loop.
        edges.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut sets = DisjointSets::new(clusters.middles.len());
        for (_, [a, b]) in edges {
            if sets.join(a, b) {
                self.link(first + a, first + b);
            }
        }
        let mut of: Vec<u32> = (first..).take(clusters.middles.len()).collect();
        self.drop_bumps(&mut of, first);
        self.of.push(of);
    }

    fn link(&mut self, a: u32, b: u32) {
        self.nodes[a as usize].beside.push(b);
        self.nodes[b as usize].beside.push(a);
    }

    fn unlink(&mut self, a: u32, b: u32) {
        self.nodes[a as usize].beside.retain(|n| *n != b);
        self.nodes[b as usize].beside.retain(|n| *n != a);
    }

    /// Ends that lie within the wood of a neighbour that goes on without them become part of it.
    fn drop_bumps(&mut self, of: &mut [u32], first: u32) {
        for slot in of.iter_mut() {
            let node = &self.nodes[*slot as usize];
            let [only] = node.beside.as_slice() else { continue };
            let (only, next) = (*only, &self.nodes[*only as usize]);
            if next.beside.len() > 2 && node.p.distance(next.p) < f64::from(next.r) {
                self.unlink(*slot, only);
                self.nodes[*slot as usize].live = false;
                *slot = only;
            }
        }
        // What was dropped onto a node that was dropped itself.
        for i in 0..of.len() {
            while of[(of[i] - first) as usize] != of[i] {
                of[i] = of[(of[i] - first) as usize];
            }
        }
    }

    /// Joins pieces where the end of one comes close to the bark of another, the closest first.
    /// Own: [yang-wu] has one mesh in one piece; artists' branches are tubes that stick in each other.
    pub fn join(&mut self, diagonal: f32) {
        let near = WoodSearch::new(self.places());
        let ends: Vec<Vec<u32>> = self.of.iter().map(|of| self.ends(of)).collect();
        let costs: Vec<(f32, f32)> = self.of.iter().map(|of| self.girth(of)).collect();
        let mut sets = DisjointSets::new(self.of.len());
        loop {
            let group: Vec<u32> = (0..).take(self.of.len()).map(|i| sets.find(i)).collect();
            // Boruvka's algorithm: the cheapest link of every group to another one. An end joins the nearest wood; thin ends
            // cost more, so that a branch is joined by its base and not by its tip.
            let mut best: BTreeMap<u32, (f32, u32, u32)> = BTreeMap::new();
            for (piece, ends) in ends.iter().enumerate() {
                let own = group[piece];
                for end in ends {
                    let node = &self.nodes[*end as usize];
                    let at = self.tip(*end);
                    let reach = (JOIN_REACH.0 * node.r).max(JOIN_REACH.1 * diagonal);
                    let foreign = |n: &u32| group[self.nodes[*n as usize].piece as usize] != own;
                    let Some((gap, to)) = near.within(at, reach, foreign) else { continue };
                    let (thickest, length) = costs[piece];
                    let cost = gap.max(0.0) + THIN_END_COST * length * (1.0 - node.r / thickest).max(0.0);
                    let known = best.get(&own);
                    if known.is_none_or(|k| cost < k.0) {
                        best.insert(own, (cost, *end, to));
                    }
                }
            }
            let mut any = false;
            let mut wanted: Vec<(f32, u32, u32)> = best.into_values().collect();
            wanted.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
            for (_, end, to) in wanted {
                if sets.join(self.nodes[end as usize].piece, self.nodes[to as usize].piece) {
                    self.link(end, to);
                    any = true;
                }
            }
            if !any {
                return;
            }
        }
    }

    /// Where the wood of an end node ends, about: as far beyond it as the next is before it.
    fn tip(&self, end: u32) -> Vec3 {
        let node = &self.nodes[end as usize];
        let own = node.beside.iter().map(|n| &self.nodes[*n as usize]).find(|n| n.piece == node.piece);
        let out = own.map_or(DVec3::ZERO, |next| (node.p - next.p) * 0.5);
        (node.p + out).as_vec3()
    }

    fn ends(&self, of: &[u32]) -> Vec<u32> {
        let mut ends: Vec<u32> = of.iter().copied().filter(|n| self.nodes[*n as usize].beside.len() < 2).collect();
        ends.sort_unstable();
        ends.dedup();
        ends
    }

    /// Largest radius of a piece and the length of its centrelines, m.
    fn girth(&self, of: &[u32]) -> (f32, f32) {
        let thickest = of.iter().fold(f32::MIN_POSITIVE, |m, n| m.max(self.nodes[*n as usize].r));
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for n in of {
            let p = self.nodes[*n as usize].p.as_vec3();
            (low, high) = (low.min(p), high.max(p));
        }
        (thickest, (high - low).length())
    }

    /// Places along all links, each of the nearer node.
    fn places(&self) -> Vec<WoodSample<u32>> {
        let mut places = Vec::new();
        for (i, node) in (0..).zip(&self.nodes).filter(|(_, n)| n.live) {
            places.push(WoodSample { p: node.p.as_vec3(), r: node.r, what: i });
            for other in node.beside.iter().map(|n| &self.nodes[*n as usize]) {
                let half = (other.p - node.p) * 0.5;
                let steps = steps(math::narrow(half.length()), SAMPLES_PER_RADIUS * node.r.max(other.r));
                places.extend((1..=steps).map(|k| {
                    let t = f64::from(k) / f64::from(steps);
                    let r = math::lerp(node.r, (node.r + other.r) * 0.5, math::narrow(t));
                    WoodSample { p: (node.p + half * t).as_vec3(), r, what: i }
                }));
            }
        }
        places
    }
}

/// Steps no longer than `step` along `length`, at most 64.
fn steps(length: f32, step: f32) -> u16 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 64")]
    let n = (length / step.max(f32::MIN_POSITIVE)).ceil().clamp(1.0, 64.0) as u16;
    n
}
