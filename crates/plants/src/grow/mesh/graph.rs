//! Joins the clusters of all pieces of wood into trees.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use super::clusters::Clusters;
use super::parts::index;
use super::refine::RefinedSurface;
use super::wood_search::{WoodSample, WoodSearch};
use osier_base::disjoint_sets::DisjointSets;
use osier_base::math;

/// Widest gap that is joined: the larger of a number of radii of the end node and a share of the diagonal of the mesh. Larger
/// values join pieces that only pass each other, smaller ones leave branches floating.
const MAX_JOIN_GAP: (f32, f32) = (10.0, 0.02);
/// Cost of joining by an end of no thickness instead of the thickest one, as a share of the piece's extent.
const THIN_END_COST: f32 = 0.05;
/// Spacing of samples along a centreline, in radii.
const SAMPLE_SPACING_RADII: f32 = 0.5;

/// A cluster as a node of the tree.
#[derive(Debug, Clone)]
pub(super) struct SkeletonNode {
    /// Centroid of the cluster, m.
    pub p: DVec3,
    /// Mean radius of the wood, m.
    pub r: f32,
    /// Index of its piece among the solid pieces of wood.
    pub piece: u32,
    /// Neighbours in the tree, of its own piece first.
    pub neighbours: Vec<u32>,
    /// False for a bump that was merged into its neighbour.
    pub live: bool,
}

/// Clusters of all pieces of wood as nodes, with the edges of their trees.
#[derive(Debug, Default)]
pub(super) struct SkeletonGraph {
    pub nodes: Vec<SkeletonNode>,
    /// For each piece and each of its clusters, the index of the cluster's node.
    pub nodes_of_clusters: Vec<Vec<u32>>,
}

impl SkeletonGraph {
    /// Adds the clusters of a piece: the minimum spanning tree of those that touch, without the bumps.
    pub fn add(&mut self, fine: &RefinedSurface, clusters: &Clusters) {
        let first = index(self.nodes.len());
        let piece = index(self.nodes_of_clusters.len());
        // Radius of a node: area-weighted mean over its cluster.
        let mut radii = vec![(0.0, 0.0); clusters.middles.len()];
        for (i, c) in clusters.cluster_of.iter().enumerate() {
            let Some(sum) = radii.get_mut(*c as usize) else { continue };
            *sum = (sum.0 + fine.areas[i] * f64::from(fine.radii[i]), sum.1 + fine.areas[i]);
        }
        let nodes = clusters.middles.iter().zip(&radii);
        let node = |(p, (sum, area)): (&DVec3, &(f64, f64))| {
            let r = if *area > 0.0 { math::narrow(sum / area) } else { fine.radii[0] };
            SkeletonNode { p: *p, r, piece, neighbours: Vec::new(), live: true }
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
        self.prune_bumps(&mut of, first);
        self.nodes_of_clusters.push(of);
    }

    fn link(&mut self, a: u32, b: u32) {
        self.nodes[a as usize].neighbours.push(b);
        self.nodes[b as usize].neighbours.push(a);
    }

    fn unlink(&mut self, a: u32, b: u32) {
        self.nodes[a as usize].neighbours.retain(|n| *n != b);
        self.nodes[b as usize].neighbours.retain(|n| *n != a);
    }

    /// Merges end nodes that lie within the radius of a fork into it: bumps and stumps of the surface rather than branches.
    fn prune_bumps(&mut self, of: &mut [u32], first: u32) {
        for slot in of.iter_mut() {
            let node = &self.nodes[*slot as usize];
            let [only] = node.neighbours.as_slice() else { continue };
            let (only, next) = (*only, &self.nodes[*only as usize]);
            if next.neighbours.len() > 2 && node.p.distance(next.p) < f64::from(next.r) {
                self.unlink(*slot, only);
                self.nodes[*slot as usize].live = false;
                *slot = only;
            }
        }
        // A node may be merged into one that was itself merged: follow the chain to its end.
        for i in 0..of.len() {
            while of[(of[i] - first) as usize] != of[i] {
                of[i] = of[(of[i] - first) as usize];
            }
        }
    }

    /// Joins pieces where the end of one comes close to the bark of another, the closest first.
    /// Own: [yang-wu] has one mesh in one piece; artists' branches are tubes that stick in each other.
    pub fn join(&mut self, diagonal: f32) {
        // Candidates for joints: the ends of every piece, tested against samples of all wood.
        let near = WoodSearch::new(self.samples());
        let end_nodes: Vec<Vec<u32>> = self.nodes_of_clusters.iter().map(|of| self.end_nodes(of)).collect();
        let costs: Vec<(f32, f32)> = self.nodes_of_clusters.iter().map(|of| self.thickness_and_extent(of)).collect();
        let mut sets = DisjointSets::new(self.nodes_of_clusters.len());
        // Repeat until no group reaches another: each round joins at least one pair.
        loop {
            let group: Vec<u32> = (0..).take(self.nodes_of_clusters.len()).map(|i| sets.find(i)).collect();
            // Boruvka's algorithm: the cheapest link of every group to another one. An end joins the nearest wood; thin ends
            // cost more, so that a branch is joined by its base and not by its tip.
            let mut best: BTreeMap<u32, (f32, u32, u32)> = BTreeMap::new();
            for (piece, end_nodes) in end_nodes.iter().enumerate() {
                let own = group[piece];
                for end in end_nodes {
                    let node = &self.nodes[*end as usize];
                    let at = self.extrapolated_end(*end);
                    let reach = (MAX_JOIN_GAP.0 * node.r).max(MAX_JOIN_GAP.1 * diagonal);
                    let of_other_group = |n: &u32| group[self.nodes[*n as usize].piece as usize] != own;
                    let Some((gap, to)) = near.within(at, reach, of_other_group) else { continue };
                    // Cost: the gap, plus a penalty for thin ends proportional to 1 - r / r_max.
                    let (thickest, length) = costs[piece];
                    let cost = gap.max(0.0) + THIN_END_COST * length * (1.0 - node.r / thickest).max(0.0);
                    let known = best.get(&own);
                    if known.is_none_or(|k| cost < k.0) {
                        best.insert(own, (cost, *end, to));
                    }
                }
            }
            // Join in order of cost; two groups may have chosen each other, so the sets are checked again.
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

    /// Estimated end of the wood beyond an end node: half the distance to its neighbour, continued outwards.
    fn extrapolated_end(&self, end: u32) -> Vec3 {
        let node = &self.nodes[end as usize];
        let own = node.neighbours.iter().map(|n| &self.nodes[*n as usize]).find(|n| n.piece == node.piece);
        let out = own.map_or(DVec3::ZERO, |next| (node.p - next.p) * 0.5);
        (node.p + out).as_vec3()
    }

    /// Nodes of a piece with at most one neighbour, sorted and without duplicates.
    fn end_nodes(&self, of: &[u32]) -> Vec<u32> {
        let mut end_nodes: Vec<u32> =
            of.iter().copied().filter(|n| self.nodes[*n as usize].neighbours.len() < 2).collect();
        end_nodes.sort_unstable();
        end_nodes.dedup();
        end_nodes
    }

    /// Largest radius of a piece and the diagonal of the box around its nodes, m.
    fn thickness_and_extent(&self, of: &[u32]) -> (f32, f32) {
        let thickest = of.iter().fold(f32::MIN_POSITIVE, |m, n| m.max(self.nodes[*n as usize].r));
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for n in of {
            let p = self.nodes[*n as usize].p.as_vec3();
            (low, high) = (low.min(p), high.max(p));
        }
        (thickest, (high - low).length())
    }

    /// Samples along all edges, each with the index of the nearer node.
    fn samples(&self) -> Vec<WoodSample<u32>> {
        let mut samples = Vec::new();
        for (i, node) in (0..).zip(&self.nodes).filter(|(_, n)| n.live) {
            samples.push(WoodSample { p: node.p.as_vec3(), r: node.r, owner: i });
            for other in node.neighbours.iter().map(|n| &self.nodes[*n as usize]) {
                let half = (other.p - node.p) * 0.5;
                // Each node owns the half of every link that is nearer to it, so that a joint goes to the nearer node.
                let steps = steps(math::narrow(half.length()), SAMPLE_SPACING_RADII * node.r.max(other.r));
                samples.extend((1..=steps).map(|k| {
                    let t = f64::from(k) / f64::from(steps);
                    let r = math::lerp(node.r, (node.r + other.r) * 0.5, math::narrow(t));
                    WoodSample { p: (node.p + half * t).as_vec3(), r, owner: i }
                }));
            }
        }
        samples
    }
}

/// Number of steps no longer than `step` that make up `length`; at most 64, beyond which they are longer.
fn steps(length: f32, step: f32) -> u16 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 64")]
    let n = (length / step.max(f32::MIN_POSITIVE)).ceil().clamp(1.0, 64.0) as u16;
    n
}
