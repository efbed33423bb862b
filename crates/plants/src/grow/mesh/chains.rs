//! Splits the tree of clusters into chains: at a fork the heaviest child continues the chain (the leader), the others begin
//! chains of their own (laterals).

use glam::{DVec3, Vec3};

use super::graph::{SkeletonGraph, SkeletonNode};
use osier_base::math;

/// Nodes no higher than this share of the height may be the root; the thickest of them becomes it.
const ROOT_HEIGHT_SHARE: f64 = 0.05;
/// Factor on the radius of a node with wood on both sides when the root is chosen, since a trunk begins at an end.
const INNER_NODE_FACTOR: f32 = 0.8;

/// A chain of nodes from where it leaves its parent to its tip.
#[derive(Debug)]
pub(super) struct Chain {
    /// Index of the parent chain, which precedes it, and index in that chain of the node at which it leaves.
    pub parent: Option<(usize, usize)>,
    /// Indices of its nodes in the graph, from base to tip.
    pub nodes: Vec<u32>,
    /// True if the chain and the node at which it was joined are different pieces of wood.
    pub attached: bool,
}

/// All chains, parents first. `root`: where the trunk begins, m; `None`: found by height and thickness.
pub(super) fn find_chains(graph: &SkeletonGraph, root: Option<Vec3>) -> Vec<Chain> {
    let nodes = &graph.nodes;
    let mut order: Vec<(u32, u32)> = Vec::with_capacity(nodes.len());
    let mut seen: Vec<bool> = nodes.iter().map(|n| !n.live).collect();
    let mut out = Vec::new();
    let groups = connected_components(nodes);
    // A root given in the scene belongs to the component of the node nearest to it; all other components stand on their lowest
    // node.
    let root_node_given = root.and_then(|p| nearest(nodes, p.as_dvec3()));
    for group in groups {
        let own = root_node_given.filter(|n| group.contains(n));
        let Some(start) = own.or_else(|| root_node(nodes, &group)) else { continue };
        // Breadth-first order from the root, each node with its parent.
        order.clear();
        order.push((start, u32::MAX));
        seen[start as usize] = true;
        let mut at = 0;
        while let Some(&(i, _)) = order.get(at) {
            at += 1;
            for next in &nodes[i as usize].neighbours {
                if !std::mem::replace(&mut seen[*next as usize], true) {
                    order.push((*next, i));
                }
            }
        }
        split_into_chains(nodes, &order, start, &mut out);
    }
    out
}

/// Connected components of the live nodes, indices rising within each.
fn connected_components(nodes: &[SkeletonNode]) -> Vec<Vec<u32>> {
    let mut seen: Vec<bool> = nodes.iter().map(|n| !n.live).collect();
    let mut groups = Vec::new();
    for start in (0..).take(nodes.len()) {
        if std::mem::replace(&mut seen[start as usize], true) {
            continue;
        }
        let mut group = vec![start];
        let mut at = 0;
        while let Some(i) = group.get(at).copied() {
            at += 1;
            for next in &nodes[i as usize].neighbours {
                if !std::mem::replace(&mut seen[*next as usize], true) {
                    group.push(*next);
                }
            }
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

/// The live node nearest to `p`; the first of equals.
fn nearest(nodes: &[SkeletonNode], p: DVec3) -> Option<u32> {
    let far = |n: &SkeletonNode| n.p.distance_squared(p);
    let live = (0..).zip(nodes).filter(|(_, n)| n.live);
    live.min_by(|a, b| far(a.1).total_cmp(&far(b.1))).map(|(i, _)| i)
}

/// Root of a component: the thickest of its lowest nodes.
fn root_node(nodes: &[SkeletonNode], group: &[u32]) -> Option<u32> {
    let height = |i: &u32| nodes[*i as usize].p.y;
    let low = group.iter().map(height).fold(f64::INFINITY, f64::min);
    let high = group.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
    let thickness = |i: &u32| {
        let n = &nodes[*i as usize];
        if n.neighbours.len() > 1 { n.r * INNER_NODE_FACTOR } else { n.r }
    };
    let lowest = group.iter().filter(|i| height(i) <= low + ROOT_HEIGHT_SHARE * (high - low));
    lowest.max_by(|a, b| thickness(a).total_cmp(&thickness(b)).then(height(b).total_cmp(&height(a)))).copied()
}

/// Appends the chains of one tree to `out`. `order`: nodes with their parents, parents first.
fn split_into_chains(nodes: &[SkeletonNode], order: &[(u32, u32)], start: u32, out: &mut Vec<Chain>) {
    // Weight of a node: the sum of length times mean radius over all links above it, a measure of the lateral surface beyond it.
    let mut weight = std::collections::BTreeMap::new();
    let mut children: std::collections::BTreeMap<u32, Vec<u32>> = std::collections::BTreeMap::new();
    for &(i, parent) in order.iter().rev().filter(|(_, p)| *p != u32::MAX) {
        let (a, b) = (&nodes[i as usize], &nodes[parent as usize]);
        let own = a.p.distance(b.p) * f64::from(a.r + b.r) * 0.5 + weight.get(&i).copied().unwrap_or(0.0);
        *weight.entry(parent).or_insert(0.0) += own;
        children.entry(parent).or_default().push(i);
    }
    let weight_of = |parent: u32, i: u32| {
        let (a, b) = (&nodes[i as usize], &nodes[parent as usize]);
        a.p.distance(b.p) * f64::from(a.r + b.r) * 0.5 + weight.get(&i).copied().unwrap_or(0.0)
    };
    let mut starts = vec![(start, None, false)];
    while let Some((first, parent, attached)) = starts.pop() {
        let chain = out.len();
        let mut own = vec![first];
        let mut at = first;
        while let Some(list) = children.get(&at) {
            let piece = |i: &u32| nodes[*i as usize].piece == nodes[at as usize].piece;
            // The leader is the heaviest child; a child of the same piece of wood is preferred to one that was joined to it.
            let any_own = list.iter().any(piece);
            let leader = (list.iter().filter(|i| !any_own || piece(i)))
                .max_by(|a, b| weight_of(at, **a).total_cmp(&weight_of(at, **b)).then(b.cmp(a)));
            let Some(leader) = leader.copied() else { break };
            let side = list.iter().filter(|i| **i != leader);
            starts.extend(side.map(|i| (*i, Some((chain, own.len() - 1)), !piece(i))));
            own.push(leader);
            at = leader;
        }
        out.push(Chain { parent, nodes: own, attached });
    }
}

/// Centripetal Catmull-Rom spline through `points`, `steps` samples per segment and the last point.
/// Source: E. Catmull, R. Rom, 1974, with the square roots of the chords as knots.
pub(super) fn catmull_rom_curve(points: &[DVec3], steps: usize) -> Vec<DVec3> {
    let n = points.len();
    if n < 3 {
        let straight = |k: usize| points[0].lerp(points[n - 1], k as f64 / steps as f64);
        return if n < 2 { points.to_vec() } else { (0..=steps).map(straight).collect() };
    }
    let knot = |i: usize| math::sqrt(points[i].distance(points[i + 1])).max(1e-9);
    let slope = |i: usize| (points[i + 1] - points[i]) / knot(i);
    // Derivatives at the points by Barry and Goldman's three-term formula for non-uniform knots; one-sided at both
    // ends.
    let tangent = |i: usize| match i {
        0 => slope(0),
        i if i + 1 == n => slope(n - 2),
        i => slope(i - 1) + slope(i) - (points[i + 1] - points[i - 1]) / (knot(i - 1) + knot(i)),
    };
    // Cubic Hermite segments; the tangents are those of the centripetal spline.
    let mut out = Vec::with_capacity((n - 1) * steps + 1);
    for i in 0..n - 1 {
        let (a, b) = (tangent(i) * knot(i), tangent(i + 1) * knot(i));
        for k in 0..steps {
            let t = k as f64 / steps as f64;
            let (t2, t3) = (t * t, t * t * t);
            out.push(
                points[i] * (2.0 * t3 - 3.0 * t2 + 1.0)
                    + a * (t3 - 2.0 * t2 + t)
                    + points[i + 1] * (3.0 * t2 - 2.0 * t3)
                    + b * (t3 - t2),
            );
        }
    }
    out.push(points[n - 1]);
    out
}
