//! First pass: how the tube of every axis begins, where its rings stand, how it ends.

use std::ops::Range;

use glam::Vec3;

use super::SkinOptions;
use super::centerline::CurvePoint;
use super::rings::{FirstRing, Ring, RingScratch, RingShape, place_rings};
use super::tuning::{
    AXES_PER_TASK, FLARE_SAMPLE_HEIGHT, FLARE_SAMPLE_SPACING, FLARE_SAMPLES, MAX_JUNCTION_DISTANCE,
    MIN_CONTINUATION_ADVANCE, MIN_CONTINUATION_COSINE, MIN_CONTINUATION_RADIUS, MIN_JUNCTION_SINE,
    MIN_JUNCTION_SINE_SQUARED, MIN_JUNCTION_STRAIGHTNESS, POINTED_TIP_RADIUS,
};
use osier_base::math;
use osier_base::par::par_chunks;
use osier_scene::plant::{Axis, AxisEnd, NONE, PAINTED, Plant};

/// Where a side branch leaves its parent's surface; its centreline near that surface is taken as a straight line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Junction {
    /// Where the centreline meets the parent's surface, m.
    pub o: Vec3,
    /// Unit direction of the line, out of the parent.
    pub t: Vec3,
    /// Arc length of `o` on the branch, m.
    pub s: f32,
    /// Radius of the branch there, m.
    pub r: f32,
    /// How far behind `o` the line passes nearest to the parent's axis, m.
    pub depth: f32,
}

/// How a tube begins; decides its cap and the course of its first rings.
#[derive(Debug, Clone, Copy)]
pub(super) enum TubeStart {
    /// At the ground: the axis has no parent.
    Root,
    /// Inside its parent, without a junction.
    Embedded,
    /// With the last ring of its parent, whose tip it continues.
    Continuation,
    /// On its parent's surface.
    Side(Junction),
}

/// The cap at the end of a tube.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TubeCap {
    /// A cone into one vertex.
    Point,
    /// A hemisphere of two rings and an apex.
    Dome,
    /// A flat disc, for cut ends and under continuations.
    Disc,
}

/// The tube of one axis before its points are numbered.
#[derive(Debug, Clone)]
pub(super) struct TubePlan {
    /// Range of its rings among those of its task.
    pub rings: Range<usize>,
    pub start: TubeStart,
    pub cap: TubeCap,
    /// Radius of the axis' first node, m, without flare or collar.
    pub r_base: f32,
}

/// The plans and rings of [`AXES_PER_TASK`] consecutive axes.
#[derive(Debug)]
struct PlanTask {
    plans: Vec<TubePlan>,
    rings: Vec<Ring>,
}

/// The plans of all axes, in tasks of [`AXES_PER_TASK`] that were planned in parallel.
#[derive(Debug)]
pub(super) struct TubePlans {
    tasks: Vec<PlanTask>,
}

impl TubePlans {
    pub fn plan(&self, axis: usize) -> &TubePlan {
        &self.tasks[axis / AXES_PER_TASK].plans[axis % AXES_PER_TASK]
    }

    /// Rings of an axis, at least two.
    pub fn rings(&self, axis: usize) -> &[Ring] {
        let task = &self.tasks[axis / AXES_PER_TASK];
        &task.rings[task.plans[axis % AXES_PER_TASK].rings.clone()]
    }
}

/// Chooses start, rings and cap of the tube of every axis.
pub(super) fn plan_tubes(plant: &Plant, options: &SkinOptions) -> TubePlans {
    let leaders = leaders(plant);
    // Each axis is planned independently, in fixed chunks, so that the result does not depend on the number of
    // threads.
    let tasks = par_chunks(&plant.axes, AXES_PER_TASK, |first, axes| {
        let mut scratch = RingScratch::default();
        let nodes: usize = axes.iter().map(|a| a.count as usize).sum();
        let mut rings = Vec::with_capacity(nodes + 2 * axes.len());
        let plans = axes
            .iter()
            .enumerate()
            .map(|(i, axis)| {
                let planner = TubePlanner { plant, options, leaders: &leaders, index: first + i, axis };
                planner.plan(&mut scratch, &mut rings)
            })
            .collect();
        PlanTask { plans, rings }
    });
    TubePlans { tasks }
}

/// The thickest child at the tip of each axis, or [`NONE`].
fn leaders(plant: &Plant) -> Vec<u32> {
    let mut leaders = vec![NONE; plant.axes.len()];
    let radius = |axis: u32| plant.nodes.r[plant.axes[axis as usize].first as usize];
    for (i, axis) in (0_u32..).zip(&plant.axes) {
        let Some(parent) = plant.axes.get(axis.parent as usize) else { continue };
        let leader = &mut leaders[axis.parent as usize];
        if at_tip(plant, parent, axis) && (*leader == NONE || radius(*leader) < radius(i)) {
            *leader = i;
        }
    }
    leaders
}

/// Whether a child leaves from its parent's last node, within 1e-4 of the length and a tenth of the radius there.
fn at_tip(plant: &Plant, parent: &Axis, axis: &Axis) -> bool {
    let r = plant.nodes.r[plant.nodes_of(parent).end - 1];
    parent.length - axis.parent_s < 1e-4 * parent.length + 0.1 * r
}

/// Unit direction of the last segment of an axis; +Y if that has no length.
fn end_direction(plant: &Plant, axis: &Axis) -> Vec3 {
    let last = plant.nodes_of(axis).end - 1;
    math::normalize_or(plant.nodes.p[last] - plant.nodes.p[last - 1], Vec3::Y)
}

/// Inputs of the plan of one tube; no plan depends on another.
struct TubePlanner<'a> {
    plant: &'a Plant,
    options: &'a SkinOptions,
    /// The thickest child at the tip of each axis, or [`NONE`].
    leaders: &'a [u32],
    /// Index of `axis` in the plant.
    index: usize,
    axis: &'a Axis,
}

impl TubePlanner<'_> {
    fn plan(&self, scratch: &mut RingScratch, rings: &mut Vec<Ring>) -> TubePlan {
        let start = rings.len();
        let nodes = self.plant.nodes_of(self.axis);
        let e0 = self.plant.nodes.q[nodes.start] * Vec3::X;
        scratch.curve.clear();
        self.color_edges(&mut scratch.edges);
        let (start_kind, first) = self.plan_start(&mut scratch.curve);
        let shape = RingShape { turn: self.options.turn, straight: self.plant.lines };
        place_rings(scratch, FirstRing { tangent: first, reference: e0 }, shape, rings);
        let r_base = self.plant.nodes.r[nodes.start];
        let cap = match self.axis.end {
            AxisEnd::Cut => TubeCap::Disc,
            _ if rings.last().is_some_and(|r| r.r < POINTED_TIP_RADIUS) => TubeCap::Point,
            _ => TubeCap::Dome,
        };
        TubePlan { rings: start..rings.len(), start: start_kind, cap, r_base }
    }

    /// Decides how the tube begins and appends its centreline from the first regular ring on to `curve`. Also returns the
    /// tangent of the first ring where that is prescribed.
    fn plan_start(&self, curve: &mut Vec<CurvePoint>) -> (TubeStart, Option<Vec3>) {
        let Some(parent) = self.plant.axes.get(self.axis.parent as usize) else {
            // An axis of order above 0 without a parent does not stand on the ground: neither flare nor extension below it.
            if self.axis.order > 0 {
                self.follow_axis(0.0, curve);
                return (TubeStart::Embedded, None);
            }
            self.root_curve(curve);
            return (TubeStart::Root, None);
        };
        if at_tip(self.plant, parent, self.axis) {
            if let Some(first) = self.continuation_curve(parent, curve) {
                return (TubeStart::Continuation, Some(first));
            }
        } else if let Some(side) = self.side_start(parent) {
            self.follow_axis(side.first_ring, curve);
            return (TubeStart::Side(side.junction), None);
        }
        self.follow_axis(0.0, curve);
        (TubeStart::Embedded, None)
    }

    /// Arc lengths at which the colour of the axis changes.
    fn color_edges(&self, edges: &mut Vec<f32>) {
        edges.clear();
        let (colors, range) = (&self.plant.nodes.color, self.plant.nodes_of(self.axis));
        let inner = range.start + 1..range.end.max(range.start + 1);
        let pairs = colors[inner.clone()].windows(2).zip(&self.plant.nodes.s[inner]);
        let changes = |pair: &[u16]| pair[0] != pair[1] && (pair[0] | pair[1]) & PAINTED != 0;
        edges.extend(pairs.filter(|(pair, _)| changes(pair)).map(|(_, s)| *s));
    }

    fn node(&self, i: usize) -> CurvePoint {
        let n = &self.plant.nodes;
        CurvePoint { p: n.p[i], r: n.r[i], s: n.s[i] }
    }

    /// Appends the axis from arc length `from` (m) on, interpolated there.
    fn follow_axis(&self, from: f32, curve: &mut Vec<CurvePoint>) {
        if from > 0.0 {
            // A start between two nodes: interpolate position and radius there, and skip nodes that are closer to it
            // than a thousandth.
            let site = self.plant.frame(self.axis, from);
            curve.push(CurvePoint { p: site.p, r: site.r, s: from });
        }
        let near = from + (self.axis.length * 1e-3).min(1e-3) * f32::from(u8::from(from > 0.0));
        for i in self.plant.nodes_of(self.axis) {
            let k = self.node(i);
            if k.s > near || from <= 0.0 {
                curve.push(k);
            }
        }
    }

    /// Centreline of a trunk, which flares towards the ground and continues below it; the lines of a drawing do neither.
    /// Own: r (1 + flare exp(-s / (flare_height r0))).
    fn root_curve(&self, curve: &mut Vec<CurvePoint>) {
        self.follow_axis(0.0, curve);
        let Some((&a, &b)) = curve.first().zip(curve.get(1)) else { return };
        if self.plant.lines {
            return;
        }
        if self.options.flare > 0.0 {
            // The exponential needs points where the axis has none: until it has decayed, unless one is near already.
            let scale = a.r * (self.options.flare_height / FLARE_SAMPLE_HEIGHT);
            for step in FLARE_SAMPLES {
                let s = step * scale;
                let Some(at) = curve.iter().position(|k| k.s > s) else { break };
                let apart = FLARE_SAMPLE_SPACING * scale;
                if s - curve[at - 1].s > apart && curve[at].s - s > apart {
                    let site = self.plant.frame(self.axis, s);
                    curve.insert(at, CurvePoint { p: site.p, r: site.r, s });
                }
            }
            for k in curve.iter_mut() {
                k.r *= 1.0 + widening(self.options, k.s, a.r);
            }
        }
        // Extend the trunk straight downwards, so that uneven ground hides its lower end.
        if self.options.bury > 0.0 {
            let down = math::normalize_or(a.p - b.p, -Vec3::Y);
            let r = curve[0].r;
            curve.insert(0, CurvePoint { p: a.p + down * self.options.bury, r, s: -self.options.bury });
        }
    }

    /// Centreline of a branch that continues from its parent's tip: it begins with the parent's last ring and bends into
    /// its own course. Returns the tangent of that ring, or none if the branch is too thin or turns too sharply.
    fn continuation_curve(&self, parent: &Axis, curve: &mut Vec<CurvePoint>) -> Option<Vec3> {
        let last = self.plant.nodes_of(parent).end - 1;
        let (p0, r0) = (self.plant.nodes.p[last], self.plant.nodes.r[last]);
        let t0 = end_direction(self.plant, parent);
        let first = self.plant.nodes_of(self.axis).start;
        // Continue only for the thickest child or one of similar radius that does not turn too sharply.
        let ahead = self.plant.frame(self.axis, r0.min(self.axis.length)).p - self.plant.nodes.p[first];
        let cosine = t0.dot(math::normalize_or(ahead, t0));
        let leader = self.leaders[self.axis.parent as usize] as usize == self.index;
        if cosine < MIN_CONTINUATION_COSINE || !(leader || self.plant.nodes.r[first] > MIN_CONTINUATION_RADIUS * r0) {
            return None;
        }
        // The transition ends `reach` along the branch, later for a larger angle, with the branch's own tangent `t1` there.
        let angle = math::acos_f32(cosine.min(1.0));
        let reach = (r0 * (1.2 + 1.3 * angle)).min(0.7 * self.axis.length);
        let end = self.plant.frame(self.axis, reach);
        let beyond = self.plant.frame(self.axis, reach + 0.01 * self.axis.length).p;
        let before = self.plant.frame(self.axis, reach * 0.95).p;
        let t1 = math::normalize_or(beyond - before, t0);
        // A transition that would fold back on itself is refused.
        let advance = MIN_CONTINUATION_ADVANCE * reach;
        if t1.dot(t0) < 0.0 || (end.p - p0).dot(t0) < advance || (end.p - p0).dot(t1) < advance {
            return None;
        }
        // Cubic Hermite curve from p0 to the end. The centreline has its corner at the parent's tip: a start tangent between both
        // directions rounds that corner without a detour.
        let (m0, m1) = (math::normalize_or(t0 + t1, t0) * reach, t1 * reach);
        let pieces = if angle > self.options.turn { 3_u8 } else { 2 };
        for k in 0..pieces {
            let u = f32::from(k) / f32::from(pieces);
            let (u2, u3) = (u * u, u * u * u);
            let blend = 3.0 * u2 - 2.0 * u3;
            let p = p0 * (1.0 - blend) + m0 * (u3 - 2.0 * u2 + u) + end.p * blend + m1 * (u3 - u2);
            curve.push(CurvePoint { p, r: math::lerp(r0, end.r, blend), s: u * reach });
        }
        self.follow_axis(reach, curve);
        Some(t0)
    }

    /// Unit direction of the parent's segment at the attachment. Where the branch leaves from a node of the parent, it
    /// is the segment ahead if the branch runs forwards, otherwise the one behind.
    fn parent_direction(&self, parent: &Axis) -> Vec3 {
        let nodes = self.plant.nodes_of(parent);
        let (p, s) = (&self.plant.nodes.p, &self.plant.nodes.s[nodes.clone()]);
        let near = 1e-3 * self.plant.nodes.r[nodes.start];
        let segment = |k: usize| {
            let j = nodes.start + k.clamp(1, nodes.len() - 1);
            math::normalize_or(p[j] - p[j - 1], Vec3::Y)
        };
        let ahead = segment(s.partition_point(|&s| s <= self.axis.parent_s + near));
        let first = self.plant.nodes_of(self.axis).start;
        if (p[first + 1] - p[first]).dot(ahead) >= 0.0 {
            return ahead;
        }
        segment(s.partition_point(|&s| s < self.axis.parent_s - near))
    }

    /// The junction with the parent's surface and the first regular ring beyond it; `None` if the branch stays inside its
    /// parent, runs along it or is too short for a junction.
    fn side_start(&self, parent: &Axis) -> Option<SideStart> {
        // The parent is taken as an infinite cylinder through the attachment site. Find the first node outside it.
        let site = self.plant.frame(parent, self.axis.parent_s);
        let along = self.parent_direction(parent);
        let outside = |p: Vec3| (p - site.p).reject_from_normalized(along).length_squared() - site.r * site.r;
        let nodes = self.plant.nodes_of(self.axis);
        let i = nodes.clone().skip(1).find(|&i| outside(self.plant.nodes.p[i]) > 0.0)?;
        let (a, b) = (self.node(i - 1), self.node(i));
        let t = math::normalize_or(b.p - a.p, along);
        let across = t.reject_from_normalized(along);
        let sin = across.length();
        if sin < MIN_JUNCTION_SINE {
            return None;
        }
        // Intersect the line through a and b with that cylinder: the larger root of |w + t across|^2 = R^2, with
        // |across| = sin of the angle between the branch and its parent.
        let w = (a.p - site.p).reject_from_normalized(along);
        let half = w.dot(across) / (sin * sin);
        let discriminant = half * half - (w.length_squared() - site.r * site.r) / (sin * sin);
        let reach = (discriminant.max(0.0).sqrt() - half).max(0.0);
        let s = a.s + reach;
        let r = math::lerp(a.r, b.r, (reach / (b.s - a.s).max(1e-9)).min(1.0));
        // The first regular ring must clear the parent even on the acute side, with a transition of about a parent radius.
        let wide = (r * (1.0 + self.options.collar)).min(site.r);
        let clear = s + wide * t.dot(along).abs() / sin;
        let ease = (1.2 * site.r).clamp(0.8 * r, 2.5 * r);
        let from = (clear + ease).min(0.9 * self.axis.length);
        if from < clear + 0.3 * ease {
            return None;
        }
        // Replace the branch between its exit point and the first regular ring by a straight line. Refuse the junction if
        // that line runs along the parent, or if the branch turns away from it beyond the ring.
        let o = a.p + t * reach;
        // The cylinder is infinite and straight, but the parent ends, and it may bend away before the branch has left
        // the cylinder.
        let beside = self.plant.frame(parent, self.axis.parent_s + (o - site.p).dot(along));
        if o.distance(beside.p) - r > MAX_JUNCTION_DISTANCE * beside.r {
            return None;
        }
        let first = self.plant.frame(self.axis, from).p;
        let ahead = self.plant.frame(self.axis, from + 0.5 * (from - s)).p - first;
        let t = math::normalize_or(first - o, along);
        let across = t.reject_from_normalized(along);
        let sin2 = across.length_squared();
        let straight = math::normalize_or(ahead, t).dot(t);
        let out = (o - site.p).reject_from_normalized(along).dot(across);
        (sin2 > MIN_JUNCTION_SINE_SQUARED && straight > MIN_JUNCTION_STRAIGHTNESS && out > 0.0)
            .then_some(SideStart { junction: Junction { o, t, s, r, depth: out / sin2 }, first_ring: from })
    }
}

/// Junction of a side branch, and where its regular rings begin.
struct SideStart {
    junction: Junction,
    /// Arc length of the first regular ring on the branch, m.
    first_ring: f32,
}

/// Widening of a trunk of radius `r0` (m) at its base at the arc length `s` (m), as a share of its radius; below the
/// ground it is that at the ground. Own: flare exp(-s / (flare_height r0)).
pub(super) fn widening(options: &SkinOptions, s: f32, r0: f32) -> f32 {
    options.flare * math::exp_f32(-s.max(0.0) / (options.flare_height * r0))
}
