//! Connected k-means clusters of a surface: clusters grow over the surface, so twigs that nearly touch stay separate.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use glam::{DMat3, DVec3};

use super::parts::{index, least_axis};
use super::refine::RefinedSurface;
use osier_base::math;
use osier_base::rng::Rng;

/// Fewest and most clusters of a piece. Two make an axis; the upper bound keeps pairs and heaps of a mesh in memory.
const CLUSTER_COUNT: (usize, usize) = (2, 16_384);
/// Most Lloyd iterations, and the largest shift of a mean, in sizes of a cluster, at which they end.
const LLOYD_ROUNDS: usize = 40;
const CONVERGED_SHIFT: f64 = 5e-3;
/// Neighbouring patches are parts of one ring if they lie no farther apart along the wood than this, in sizes of a cluster.
const RING_DISTANCE_ALONG: f64 = 0.6;
/// They must also lie no farther apart across the wood than this, in radii: the middles of patches on a tube do.
const RING_DISTANCE_ACROSS: f64 = 1.9;
/// Most passes in which patches of a ring are joined.
const JOIN_PASSES: usize = 8;

/// Clusters of the surface of one piece of wood.
#[derive(Debug)]
pub(super) struct Clusters {
    /// Index of the cluster of each point of the refined surface.
    pub cluster_of: Vec<u32>,
    /// Centroid of each cluster, m.
    pub middles: Vec<DVec3>,
    /// Target size of each cluster, m.
    sizes: Vec<f64>,
}

/// Finds the clusters of a surface.
/// Source: [yang-wu] 3.1, k-means over the vertices.
/// Differs: seeds drawn by squared distance (D. Arthur, S. Vassilvitskii, "k-means++", SODA 2007); sizes follow the radius;
/// a cluster grows over the surface from its middle, so it is connected; patches of one ring are joined.
pub(super) fn find_clusters(fine: &RefinedSurface, rng: &mut Rng) -> Clusters {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped next")]
    let wanted =
        (fine.estimated_clusters().ceil() as usize).clamp(CLUSTER_COUNT.0, CLUSTER_COUNT.1.min(fine.points.len()));
    let seeds = draw_seeds(fine, wanted, rng);
    let middles = seeds.iter().map(|i| fine.points[*i as usize].as_dvec3()).collect();
    let sizes = seeds.iter().map(|i| f64::from(fine.sizes[*i as usize])).collect();
    let mut clusters = Clusters { cluster_of: Vec::new(), middles, sizes };
    clusters.assign_points(fine, &seeds);
    clusters.iterate_lloyd(fine);
    for _ in 0..JOIN_PASSES {
        if !clusters.join_patches(fine) {
            break;
        }
        clusters.iterate_lloyd(fine);
    }
    clusters
}

/// Draws seed points, each with probability proportional to the squared distance from the nearest seed so far (k-means++).
fn draw_seeds(fine: &RefinedSurface, wanted: usize, rng: &mut Rng) -> Vec<u32> {
    let n = fine.points.len();
    // Initial weights: the area as a share of a cluster's area r * size, so that thin twigs get as many seeds per
    // length as the trunk.
    let weight = |i: usize| fine.areas[i] / f64::from(fine.radii[i] * fine.sizes[i]).max(1e-30);
    let mut nearest = vec![f64::INFINITY; n];
    let mut chances = FenwickTree::new((0..n).map(weight).collect());
    let mut out = Vec::with_capacity(wanted);
    let mut stack: Vec<u32> = Vec::new();
    while out.len() < wanted {
        let Some(drawn) = chances.draw(rng) else { break };
        let seed = index(drawn);
        out.push(seed);
        let middle = fine.points[drawn];
        let distance = |i: usize| f64::from(fine.points[i].distance(middle) / fine.sizes[i]);
        // Update distances outwards over the surface, as far as the new seed is nearer than all earlier ones.
        nearest[drawn] = 0.0;
        chances.set(drawn, 0.0);
        stack.push(seed);
        while let Some(i) = stack.pop() {
            for next in fine.neighbours(i) {
                let k = *next as usize;
                let d = distance(k);
                if d < nearest[k] {
                    nearest[k] = d;
                    chances.set(k, weight(k) * d * d);
                    stack.push(*next);
                }
            }
        }
    }
    out
}

impl Clusters {
    /// Assigns every point to a cluster: clusters grow from their seeds, the nearest point first.
    fn assign_points(&mut self, fine: &RefinedSurface, seeds: &[u32]) {
        // Region growing: Dijkstra's order on the edges of the surface with one heap for all clusters. The key is the
        // straight distance from the cluster's middle divided by its size; a point joins the first cluster that reaches
        // it.
        self.cluster_of = vec![u32::MAX; fine.points.len()];
        let mut heap = BinaryHeap::with_capacity(fine.points.len());
        // Least distance at which each point was queued; farther clusters need not queue it again.
        let mut queued = vec![f64::INFINITY; fine.points.len()];
        for (cluster, i) in (0..).zip(seeds) {
            // The key 0 gives a seed to its own cluster, however far the middle has moved.
            heap.push(Reverse((0, cluster, *i)));
        }
        while let Some(Reverse((_, cluster, i))) = heap.pop() {
            if self.cluster_of[i as usize] != u32::MAX {
                continue;
            }
            self.cluster_of[i as usize] = cluster;
            let (middle, size) = (self.middles[cluster as usize], self.sizes[cluster as usize]);
            for next in fine.neighbours(i) {
                let k = *next as usize;
                let far = fine.points[k].as_dvec3().distance(middle) / size;
                if self.cluster_of[k] == u32::MAX && far < queued[k] {
                    queued[k] = far;
                    // The bits of positive floats have the order of the floats.
                    heap.push(Reverse((far.to_bits(), cluster, *next)));
                }
            }
        }
    }

    /// Moves the middles to the area-weighted centroids; returns the largest shift, in sizes of a cluster.
    fn update_means(&mut self, fine: &RefinedSurface) -> f64 {
        let mut sums = vec![(DVec3::ZERO, 0.0, 0.0); self.middles.len()];
        for (i, c) in self.cluster_of.iter().enumerate() {
            let Some(sum) = sums.get_mut(*c as usize) else { continue };
            let w = fine.areas[i].max(1e-30);
            *sum = (sum.0 + fine.points[i].as_dvec3() * w, sum.1 + f64::from(fine.sizes[i]) * w, sum.2 + w);
        }
        let mut most = 0.0_f64;
        for (c, (place, size, w)) in sums.into_iter().enumerate() {
            if w > 0.0 {
                most = most.max((place / w).distance(self.middles[c]) / self.sizes[c]);
                (self.middles[c], self.sizes[c]) = (place / w, size / w);
            }
        }
        most
    }

    /// Lloyd iterations: means, then reassignment, until the means hardly move.
    fn iterate_lloyd(&mut self, fine: &RefinedSurface) {
        for _ in 0..LLOYD_ROUNDS {
            if self.update_means(fine) < CONVERGED_SHIFT {
                break;
            }
            let seeds = self.nearest_points(fine);
            self.assign_points(fine, &seeds);
        }
        self.update_means(fine);
    }

    /// For each cluster the point nearest to its middle, its next seed; clusters without points are removed.
    fn nearest_points(&mut self, fine: &RefinedSurface) -> Vec<u32> {
        let mut best = vec![(f64::INFINITY, u32::MAX); self.middles.len()];
        for (i, c) in (0..).zip(&self.cluster_of) {
            let Some(best) = best.get_mut(*c as usize) else { continue };
            let d = fine.points[i as usize].as_dvec3().distance_squared(self.middles[*c as usize]);
            if d < best.0 {
                *best = (d, i);
            }
        }
        // Both lists are indexed by cluster: the same entries are removed from each.
        let used: Vec<bool> = best.iter().map(|b| b.1 != u32::MAX).collect();
        let mut k = 0;
        self.middles.retain(|_| {
            k += 1;
            used[k - 1]
        });
        k = 0;
        self.sizes.retain(|_| {
            k += 1;
            used[k - 1]
        });
        best.into_iter().map(|b| b.1).filter(|i| *i != u32::MAX).collect()
    }

    /// Pairs of clusters that share an edge, lower index first.
    pub fn pairs(&self, fine: &RefinedSurface) -> Vec<[u32; 2]> {
        let mut pairs = BTreeSet::new();
        for (i, a) in (0..).zip(&self.cluster_of) {
            let adjacent = fine.neighbours(i).iter().map(|k| self.cluster_of[*k as usize]);
            pairs.extend(adjacent.filter(|b| b > a && *b != u32::MAX).map(|b| [*a, b]));
        }
        pairs.into_iter().collect()
    }

    /// Per cluster the scatter matrix of its normals, sum of w n n^T with w the area, and its mean radius, m.
    fn rings(&self, fine: &RefinedSurface) -> Vec<(DMat3, f64)> {
        let mut sums = vec![(DMat3::ZERO, 0.0, 1e-30); self.middles.len()];
        for (i, c) in self.cluster_of.iter().enumerate() {
            let Some(sum) = sums.get_mut(*c as usize) else { continue };
            let (n, w) = (fine.normals[i].as_dvec3(), fine.areas[i]);
            let square = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
            *sum = (sum.0 + square * w, sum.1 + w * f64::from(fine.radii[i]), sum.2 + w);
        }
        sums.into_iter().map(|(m, r, w)| (m, r / w)).collect()
    }

    /// Joins neighbours that lie side by side around the wood, each with at most one other. Returns false if none were
    /// joined.
    fn join_patches(&mut self, fine: &RefinedSurface) -> bool {
        // The axis of the wood is the direction least present among the normals of both clusters. Patches of one ring are near
        // along it and within the girth across it.
        let rings = self.rings(fine);
        let apart = |[a, b]: [u32; 2]| {
            let (a, b) = (a as usize, b as usize);
            let d = self.middles[b] - self.middles[a];
            let along = d.dot(least_axis(&(rings[a].0 + rings[b].0))).abs();
            let across = math::sqrt((d.length_squared() - along * along).max(0.0));
            let near_along = along < RING_DISTANCE_ALONG * 0.5 * (self.sizes[a] + self.sizes[b]);
            (near_along && across < RING_DISTANCE_ACROSS * 0.5 * (rings[a].1 + rings[b].1)).then_some(d.length())
        };
        let pairs = self.pairs(fine).into_iter();
        let mut close: Vec<(f64, [u32; 2])> = pairs.filter_map(|p| Some((apart(p)?, p))).collect();
        close.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // Join the nearest pairs first, each cluster once per pass.
        let mut into: Vec<u32> = (0..).take(self.middles.len()).collect();
        let mut left = self.middles.len();
        let mut done = vec![false; self.middles.len()];
        for (_, [a, b]) in close {
            if !done[a as usize] && !done[b as usize] && left > 1 {
                (done[a as usize], done[b as usize]) = (true, true);
                into[b as usize] = a;
                left -= 1;
            }
        }
        if left == self.middles.len() {
            return false;
        }
        self.cluster_of.iter_mut().for_each(|c| *c = into.get(*c as usize).copied().unwrap_or(*c));
        self.update_means(fine);
        let seeds = self.nearest_points(fine);
        self.assign_points(fine, &seeds);
        true
    }
}

/// Weights with their prefix sums in a binary indexed tree: update and weighted draw in O(log n).
/// Source: P. Fenwick, "A new data structure for cumulative frequency tables", 1994.
struct FenwickTree {
    weights: Vec<f64>,
    tree: Vec<f64>,
}

impl FenwickTree {
    fn new(weights: Vec<f64>) -> Self {
        let mut tree = vec![0.0; weights.len() + 1];
        tree[1..].copy_from_slice(&weights);
        for i in 1..tree.len() {
            let up = i + (i & i.wrapping_neg());
            if up < tree.len() {
                tree[up] += tree[i];
            }
        }
        Self { weights, tree }
    }

    fn set(&mut self, i: usize, weight: f64) {
        let change = weight - self.weights[i];
        self.weights[i] = weight;
        let mut k = i + 1;
        while k < self.tree.len() {
            self.tree[k] += change;
            k += k & k.wrapping_neg();
        }
    }

    /// Draws an index with probability proportional to its weight; `None` if all weights are 0.
    fn draw(&self, rng: &mut Rng) -> Option<usize> {
        let n = self.weights.len();
        // Total weight: the prefix sum up to n, one term per set bit.
        let (mut k, mut total) = (n, 0.0);
        while k > 0 {
            total += self.tree[k];
            k &= k - 1;
        }
        let mut left = rng.unit_f64() * total;
        // Binary search for the largest prefix sum not above the draw, by halved steps down the implicit tree.
        let (mut at, mut step) = (0, n.next_power_of_two());
        while step > 0 {
            if at + step <= n && self.tree[at + step] <= left {
                at += step;
                left -= self.tree[at];
            }
            step /= 2;
        }
        // Rounding of the sums may lead to an index without weight; the next one with weight replaces it.
        (at.min(n.saturating_sub(1))..n).chain(0..n).find(|i| self.weights[*i] > 0.0)
    }
}
