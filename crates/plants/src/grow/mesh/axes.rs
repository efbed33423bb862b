//! Turns chains of clusters into the axes of a plant: centrelines, radii, attachments, ends.

use glam::{DVec3, Vec3};

use super::chains::{Chain, catmull_rom_curve};
use super::graph::SkeletonGraph;
use super::parts::index;
use crate::grow::polyline::{self, NewAxis};
use osier_base::math::{self, narrow};
use osier_scene::plant::{NONE, Plant};

/// Nodes of an axis per cluster: the spline adds one between each two centroids.
pub(super) const NODES_PER_CLUSTER: usize = 2;
/// Thinnest radius, m; below it tubes vanish at any viewing distance.
const MIN_RADIUS: f64 = 2e-4;
/// Cosine between normal and axis above which a surface point belongs to an end cap and does not measure the radius.
const END_FACE_COSINE: f32 = 0.7;
/// The radius of an end is measured on the part of its cluster beyond this share of the way to the tip.
const END_RADIUS_SHARE: f64 = 0.6;
/// Largest radius of a child, as a share of its parent's at the attachment.
const MAX_CHILD: f32 = 0.95;
/// Least sine of the angle between child and parent: at sharper angles the point where the child leaves the bark would
/// move far along the parent.
const MIN_LEAVING_SINE: f32 = 0.3;
/// Samples per segment of the parent when the attachment is sought.
const SAMPLES_PER_SEGMENT: u8 = 4;

/// Points on the surface of a cluster, and the area that each stands for.
#[derive(Debug, Default, Clone)]
pub(super) struct ClusterSurface {
    /// Positions, m, and unit normals.
    pub points: Vec<(Vec3, Vec3)>,
    /// Area around each point, m^2.
    pub areas: Vec<f64>,
}

impl ClusterSurface {
    /// Largest extent of the points beyond `p` along `t`, m; at least 0.
    fn reach(&self, p: DVec3, t: DVec3) -> f64 {
        self.points.iter().fold(0.0, |m, (q, _)| (q.as_dvec3() - p).dot(t).max(m))
    }

    /// Distances from the line through `p` along `t`, with areas, of the points at `along` or farther, m; points of end caps are
    /// left out.
    fn distances(&self, p: DVec3, t: DVec3, along: f64) -> Vec<(f64, f64)> {
        let side = self
            .points
            .iter()
            .zip(&self.areas)
            .filter(|((q, n), _)| n.dot(t.as_vec3()).abs() < END_FACE_COSINE && (q.as_dvec3() - p).dot(t) >= along);
        side.map(|((q, _), area)| {
            let d = q.as_dvec3() - p;
            ((d - t * d.dot(t)).length(), *area)
        })
        .collect()
    }

    /// Area-weighted mean distance of the points from the axis, m; at a `fork` at most the median, because the bases of the
    /// children lie far from the axis. `None` if no point counts.
    fn radius(&self, p: DVec3, t: DVec3, along: f64, fork: bool) -> Option<f64> {
        let mut list = self.distances(p, t, along);
        let all = list.iter().fold(0.0, |sum, (_, a)| sum + a);
        if all <= 0.0 {
            return None;
        }
        let mean = list.iter().fold(0.0, |sum, (d, a)| sum + d * a) / all;
        if !fork {
            return Some(mean);
        }
        // Weighted median: the distance at which half of the area is reached.
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        let half = list.iter().find(|(_, a)| {
            sum += a;
            sum >= 0.5 * all
        });
        Some(half.map_or(mean, |(d, _)| d.min(mean)))
    }
}

/// Axis and node at which a cluster lies on the plant.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ClusterSite {
    pub axis: u32,
    /// Node of the axis nearest to it, counted from the axis' first.
    pub node: u32,
}

/// The centreline of an axis: a smooth curve through the clusters of a chain.
#[derive(Debug, Default)]
struct Centerline {
    p: Vec<DVec3>,
    r: Vec<f32>,
    /// For each cluster of the chain, the index of its node on this line.
    of: Vec<usize>,
    /// Attachment on the parent's line: index of the segment, and place along it, 0..1.
    attachment: (usize, f32),
}

/// Appends the chains to a plant as axes; returns the site of each node of the graph.
pub(super) fn add_axes(
    plant: &mut Plant,
    graph: &SkeletonGraph,
    chains: &[Chain],
    cluster_surfaces: &[ClusterSurface],
) -> Vec<ClusterSite> {
    let mut lines: Vec<Centerline> = Vec::with_capacity(chains.len());
    for chain in chains {
        let line = chain_centerline(graph, chain, cluster_surfaces, &lines);
        lines.push(line);
    }
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); chains.len()];
    let mut stack = Vec::new();
    for (i, chain) in chains.iter().enumerate() {
        match chain.parent {
            Some((parent, _)) => children[parent].push(i),
            None => stack.push((i, NONE)),
        }
    }
    // The stack is reversed because its last entry is taken first: roots then come in the order of the chains.
    stack.reverse();
    let by_stem = |a: &usize, b: &usize| {
        let (a, b) = (lines[*a].attachment, lines[*b].attachment);
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    };
    children.iter_mut().for_each(|list| list.sort_by(by_stem));
    // Depth first, siblings by their place on the parent: the canonical order of a plant.
    let mut sites = vec![ClusterSite::default(); graph.nodes.len()];
    while let Some((i, parent)) = stack.pop() {
        let axis = index(plant.axes.len());
        push_axis(plant, &lines[i], parent);
        for (node, at) in chains[i].nodes.iter().zip(&lines[i].of) {
            sites[*node as usize] = ClusterSite { axis, node: index(*at) };
        }
        stack.extend(children[i].iter().rev().map(|c| (*c, axis)));
    }
    sites
}

/// The centreline of a chain with radii, from the surface of its parent to the end of its wood.
fn chain_centerline(
    graph: &SkeletonGraph,
    chain: &Chain,
    cluster_surfaces: &[ClusterSurface],
    lines: &[Centerline],
) -> Centerline {
    let mut points: Vec<DVec3> = chain.nodes.iter().map(|n| graph.nodes[*n as usize].p).collect();
    let attachment = chain.parent.map(|(parent, at)| ParentAttachment::find(&lines[parent], at, &points));
    // Points inside the parent's wood are no part of the centreline.
    let inside = |p: &DVec3| attachment.is_some_and(|s| s.p.distance(*p) < f64::from(s.r));
    let hidden = points.iter().take_while(|p| inside(p)).count().min(points.len() - 1);
    points.drain(..hidden);
    let radii = node_radii(graph, chain, cluster_surfaces, hidden, &points);
    let (base, tip) = end_points(chain, cluster_surfaces, hidden, &points, attachment.as_ref(), &radii);
    let mut r = radii;
    r.insert(0, base.1);
    r.push(tip.1);
    points.insert(0, base.0);
    points.push(tip.0);
    // Smooth along the axis, keep the child thinner than its parent, and interpolate linearly between clusters.
    let smooth = smooth_radii(&r);
    let max_radius = attachment.map_or(f64::INFINITY, |s| f64::from(s.r * MAX_CHILD));
    let p = catmull_rom_curve(&points, NODES_PER_CLUSTER);
    let radius = |k: usize| {
        let (i, t) = (k / NODES_PER_CLUSTER, (k % NODES_PER_CLUSTER) as f64 / NODES_PER_CLUSTER as f64);
        let next = smooth[(i + 1).min(smooth.len() - 1)];
        narrow((smooth[i] + (next - smooth[i]) * t).min(max_radius).max(MIN_RADIUS))
    };
    let of = (0..chain.nodes.len()).map(|k| (k + 1).saturating_sub(hidden) * NODES_PER_CLUSTER).collect();
    Centerline { r: (0..p.len()).map(radius).collect(), p, of, attachment: attachment.map_or((0, 0.0), |s| s.at) }
}

/// Unit tangent of a polyline at point `k`: central difference, one-sided at the ends; `None` where points coincide.
fn direction(points: &[DVec3], k: usize) -> Option<DVec3> {
    let (before, after) = (points[k.saturating_sub(1)], points[(k + 1).min(points.len() - 1)]);
    (after - before).try_normalize()
}

/// Radius at each node of a chain: the mean distance of its cluster's points from the centreline.
fn node_radii(
    graph: &SkeletonGraph,
    chain: &Chain,
    cluster_surfaces: &[ClusterSurface],
    hidden: usize,
    points: &[DVec3],
) -> Vec<f64> {
    let one = |(k, node): (usize, &u32)| {
        let own = &graph.nodes[*node as usize];
        // Measured against the centreline; where that has no direction, the mean radius of the cluster is used.
        let rough = f64::from(own.r);
        let Some(t) = direction(points, k) else { return rough };
        cluster_surfaces[*node as usize]
            .radius(points[k], t, f64::NEG_INFINITY, own.neighbours.len() > 2)
            .unwrap_or(rough)
    };
    chain.nodes[hidden..].iter().enumerate().map(one).collect()
}

/// Positions and radii of base and tip. The wood reaches beyond the centroids of the end clusters; a branch begins on its
/// parent's surface.
fn end_points(
    chain: &Chain,
    cluster_surfaces: &[ClusterSurface],
    hidden: usize,
    points: &[DVec3],
    attachment: Option<&ParentAttachment>,
    radii: &[f64],
) -> ((DVec3, f64), (DVec3, f64)) {
    let (first, last) = (points[0], points[points.len() - 1]);
    let surface = |k: usize| &cluster_surfaces[chain.nodes[hidden + k] as usize];
    let single_cluster_direction = || {
        // A chain of one cluster has no direction: take that of its farthest surface point, upwards.
        let far = |q: &&(Vec3, Vec3)| q.0.as_dvec3().distance_squared(first);
        let farthest = surface(0).points.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
        let out = farthest.and_then(|q| (q.0.as_dvec3() - first).try_normalize()).unwrap_or(DVec3::Y);
        if out.y < 0.0 { -out } else { out }
    };
    let from_stem = attachment.and_then(|s| (first - s.p).try_normalize());
    let up = direction(points, 0).or(from_stem).unwrap_or_else(single_cluster_direction);
    let out = direction(points, points.len() - 1).or(from_stem).unwrap_or_else(single_cluster_direction);
    // An end of the wood: the farthest extent of its cluster along the axis, at least half a radius, with the radius
    // there.
    let end = |k: usize, p: DVec3, t: DVec3, own: f64| {
        let reach = surface(k).reach(p, t);
        let r = surface(k).radius(p, t, END_RADIUS_SHARE * reach, false).unwrap_or(own);
        (p + t * reach.max(own * 0.5), r)
    };
    let tip = end(points.len() - 1, last, out, radii[radii.len() - 1]);
    let tip = (tip.0, tip.1.min(radii[radii.len() - 1]));
    let own = end(0, first, -up, radii[0]);
    let base = match attachment {
        None => own,
        Some(s) => {
            let surface_point = s.surface_point(first);
            // A piece of wood that was joined begins at its own end, if that lies outside of the parent's wood.
            let nearer = chain.attached && own.0.distance(first) < surface_point.distance(first);
            (if nearer { own.0 } else { surface_point }, radii[0])
        }
    };
    (base, tip)
}

/// Radii after one binomial pass (1 2 1) along the axis; the ends stay.
fn smooth_radii(r: &[f64]) -> Vec<f64> {
    let at = |k: usize| {
        let (a, b) = (r[k.saturating_sub(1)], r[(k + 1).min(r.len() - 1)]);
        if k == 0 || k + 1 == r.len() { r[k] } else { 0.25 * (a + 2.0 * r[k] + b) }
    };
    (0..r.len()).map(at).collect()
}

/// Point at which a chain leaves its parent.
#[derive(Debug, Clone, Copy)]
struct ParentAttachment {
    /// Position on the parent's centreline, m.
    p: DVec3,
    /// Unit tangent of the parent there.
    t: DVec3,
    r: f32,
    /// Index of the segment of the parent's line, and place along it, 0..1.
    at: (usize, f32),
}

impl ParentAttachment {
    /// Finds the point of the parent that is closest to the backward extension of the chain's first segment.
    fn find(parent: &Centerline, at: usize, points: &[DVec3]) -> Self {
        let around = parent.of[at.min(parent.of.len() - 1)];
        let back = match points {
            [a, b, ..] => (*a - *b).normalize_or_zero(),
            _ => DVec3::ZERO,
        };
        let first = points[0];
        // Distance from a point to the ray from the chain's first node backwards.
        let far = |q: DVec3| {
            let d = q - first;
            (d - back * d.dot(back).max(0.0)).length()
        };
        let last = parent.p.len() - 1;
        let (from, to) = (around.saturating_sub(2 * NODES_PER_CLUSTER), (around + 2 * NODES_PER_CLUSTER).min(last));
        // Sample the parent within two clusters of the node and keep the point nearest to the backward extension.
        let mut best = (f64::INFINITY, (from.min(last - 1), 0.0));
        for k in from..to {
            for j in 0..=SAMPLES_PER_SEGMENT {
                let t = f64::from(j) / f64::from(SAMPLES_PER_SEGMENT);
                let d = far(parent.p[k].lerp(parent.p[k + 1], t));
                if d < best.0 {
                    best = (d, (k, narrow(t)));
                }
            }
        }
        let (k, t) = best.1;
        let (a, b) = (parent.p[k], parent.p[k + 1]);
        Self {
            p: a.lerp(b, f64::from(t)),
            t: (b - a).normalize_or_zero(),
            r: math::lerp(parent.r[k], parent.r[k + 1], t),
            at: best.1,
        }
    }

    /// The point at which the segment from here to `p` leaves the parent's wood.
    fn surface_point(&self, p: DVec3) -> DVec3 {
        let way = p - self.p;
        let length = way.length();
        let Some(out) = way.try_normalize() else { return p };
        // The surface of a cylinder of radius r is reached after r / sin(angle); at most 80 % of the segment is used.
        let sine = out.cross(self.t).length().max(f64::from(MIN_LEAVING_SINE));
        self.p + out * (f64::from(self.r) / sine).min(0.8 * length)
    }
}

/// Appends a centreline to the plant. Its first node lies on the parent's surface, so the exposed length of the axis is 0.
fn push_axis(plant: &mut Plant, line: &Centerline, parent: u32) {
    let points: Vec<Vec3> = line.p.iter().map(|p| p.as_vec3()).collect();
    let (parent_s, order) = plant.axes.get(parent as usize).map_or((0.0, 0), |a| {
        let k = a.first as usize + line.attachment.0;
        let s = &plant.nodes.s;
        (math::lerp(s[k], s[k + 1], line.attachment.1), a.order.saturating_add(1))
    });
    let axis = NewAxis { id: 0, parent, parent_s, order, fork: NONE };
    polyline::push_axis(plant, axis, &points, |i| line.r[i], 0);
}
