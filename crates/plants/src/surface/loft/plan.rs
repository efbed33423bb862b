//! First pass: how every axis begins, which rings it has, how it ends.

use std::ops::Range;

use glam::Vec3;

use super::SkinOptions;
use super::rings::{Knot, Ring, Scratch, choose};
use osier_base::math;
use osier_base::par::par_chunks;
use osier_scene::plant::{Axis, AxisEnd, NONE, Plant};

/// Axes planned as one piece of work: few enough that the rings fit into memory that the heap keeps.
const RUN: usize = 64;
/// Tips thinner than this end in one vertex, m.
const POINTED: f32 = 0.003;

/// Where a side branch leaves its parent: its centreline near the parent's surface, taken as a straight line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Foot {
    /// Where the centreline meets the parent's surface, m.
    pub o: Vec3,
    /// Unit direction there.
    pub t: Vec3,
    /// Arc length of `o` on the branch, m.
    pub s: f32,
    /// Radius of the branch there, m.
    pub r: f32,
    /// How far behind `o` the line passes nearest to the parent's axis, m.
    pub depth: f32,
}

/// How a tube begins.
#[derive(Debug, Clone, Copy)]
pub(super) enum Base {
    /// On the ground.
    Root,
    /// Inside its parent, without a foot.
    Sunk,
    /// With the last ring of its parent.
    Tip,
    /// On a foot.
    Side(Foot),
}

/// How a tube ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cap {
    /// In one vertex.
    Point,
    /// Rounded.
    Dome,
    /// Flat.
    Disc,
}

/// What one axis becomes.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub rings: Range<usize>,
    pub base: Base,
    pub cap: Cap,
    pub r_base: f32,
}

/// All plans, in runs of [`RUN`] axes.
#[derive(Debug)]
pub(super) struct Plans {
    runs: Vec<(Vec<Plan>, Vec<Ring>)>,
}

impl Plans {
    /// Plan of an axis.
    pub fn of(&self, axis: usize) -> &Plan {
        &self.runs[axis / RUN].0[axis % RUN]
    }

    /// Rings of an axis, at least two.
    pub fn rings(&self, axis: usize) -> &[Ring] {
        let (plans, rings) = &self.runs[axis / RUN];
        &rings[plans[axis % RUN].rings.clone()]
    }
}

/// Chooses base, rings and cap of every axis.
pub(super) fn plan(plant: &Plant, options: &SkinOptions) -> Plans {
    let heirs = heirs(plant);
    let runs = par_chunks(&plant.axes, RUN, |first, axes| {
        let mut scratch = Scratch::default();
        let nodes: usize = axes.iter().map(|a| a.count as usize).sum();
        let mut rings = Vec::with_capacity(nodes + 2 * axes.len());
        let plans = axes
            .iter()
            .enumerate()
            .map(|(i, axis)| {
                let job = Job { plant, options, heirs: &heirs, index: first + i, axis };
                job.plan(&mut scratch, &mut rings)
            })
            .collect();
        (plans, rings)
    });
    Plans { runs }
}

/// The thickest child at the tip of each axis, or [`NONE`].
fn heirs(plant: &Plant) -> Vec<u32> {
    let mut heirs = vec![NONE; plant.axes.len()];
    let radius = |axis: u32| plant.nodes.r[plant.axes[axis as usize].first as usize];
    for (i, axis) in (0_u32..).zip(&plant.axes) {
        let Some(parent) = plant.axes.get(axis.parent as usize) else { continue };
        let heir = &mut heirs[axis.parent as usize];
        if at_tip(plant, parent, axis) && (*heir == NONE || radius(*heir) < radius(i)) {
            *heir = i;
        }
    }
    heirs
}

fn at_tip(plant: &Plant, parent: &Axis, axis: &Axis) -> bool {
    let r = plant.nodes.r[plant.nodes_of(parent).end - 1];
    parent.length - axis.parent_s < 1e-4 * parent.length + 0.1 * r
}

/// Direction of the last segment of an axis.
fn end_direction(plant: &Plant, axis: &Axis) -> Vec3 {
    let last = plant.nodes_of(axis).end - 1;
    math::normalize_or(plant.nodes.p[last] - plant.nodes.p[last - 1], Vec3::Y)
}

struct Job<'a> {
    plant: &'a Plant,
    options: &'a SkinOptions,
    heirs: &'a [u32],
    index: usize,
    axis: &'a Axis,
}

impl Job<'_> {
    fn plan(&self, scratch: &mut Scratch, rings: &mut Vec<Ring>) -> Plan {
        let start = rings.len();
        let nodes = self.plant.nodes_of(self.axis);
        let e0 = self.plant.nodes.q[nodes.start] * Vec3::X;
        scratch.knots.clear();
        let (base, first) = self.begin(&mut scratch.knots);
        choose(scratch, first, e0, self.options.turn, rings);
        let r_base = self.plant.nodes.r[nodes.start];
        let cap = match self.axis.end {
            AxisEnd::Cut => Cap::Disc,
            _ if rings.last().is_some_and(|r| r.r < POINTED) => Cap::Point,
            _ => Cap::Dome,
        };
        Plan { rings: start..rings.len(), base, cap, r_base }
    }

    /// Decides how the tube begins and lays down its centreline from the first regular ring on; returns the tangent
    /// there if it is prescribed.
    fn begin(&self, knots: &mut Vec<Knot>) -> (Base, Option<Vec3>) {
        let Some(parent) = self.plant.axes.get(self.axis.parent as usize) else {
            self.root(knots);
            return (Base::Root, None);
        };
        if at_tip(self.plant, parent, self.axis) {
            if let Some(first) = self.continuation(parent, knots) {
                return (Base::Tip, Some(first));
            }
        } else if let Some((foot, from)) = self.foot(parent) {
            self.follow(from, knots);
            return (Base::Side(foot), None);
        }
        self.follow(0.0, knots);
        (Base::Sunk, None)
    }

    fn knot(&self, i: usize) -> Knot {
        let n = &self.plant.nodes;
        Knot { p: n.p[i], r: n.r[i], s: n.s[i] }
    }

    /// The centreline from arc length `from` on.
    fn follow(&self, from: f32, knots: &mut Vec<Knot>) {
        if from > 0.0 {
            let site = self.plant.frame(self.axis, from);
            knots.push(Knot { p: site.p, r: site.r, s: from });
        }
        let near = from + (self.axis.length * 1e-3).min(1e-3) * f32::from(u8::from(from > 0.0));
        for i in self.plant.nodes_of(self.axis) {
            let k = self.knot(i);
            if k.s > near || from <= 0.0 {
                knots.push(k);
            }
        }
    }

    /// A trunk: it widens towards the ground (with knots enough to show it) and goes on below it.
    /// Own: r (1 + flare exp(-s / (3 r0))).
    fn root(&self, knots: &mut Vec<Knot>) {
        self.follow(0.0, knots);
        let Some((&a, &b)) = knots.first().zip(knots.get(1)) else { return };
        if self.options.flare > 0.0 {
            for step in [0.6, 1.2, 1.8, 2.5, 3.5, 5.0, 7.0, 10.0_f32] {
                let s = step * a.r;
                let Some(at) = knots.iter().position(|k| k.s > s) else { break };
                if s - knots[at - 1].s > 0.3 * a.r && knots[at].s - s > 0.3 * a.r {
                    let site = self.plant.frame(self.axis, s);
                    knots.insert(at, Knot { p: site.p, r: site.r, s });
                }
            }
            for k in knots.iter_mut() {
                k.r *= 1.0 + self.options.flare * math::exp_f32(-k.s / (3.0 * a.r));
            }
        }
        if self.options.bury > 0.0 {
            let down = math::normalize_or(a.p - b.p, -Vec3::Y);
            let r = knots[0].r;
            knots.insert(0, Knot { p: a.p + down * self.options.bury, r, s: -self.options.bury });
        }
    }

    /// Centreline of a branch that goes on from its parent's tip: it begins with the parent's last ring and bends into
    /// its own course. Returns the tangent of that ring, or none if the branch is too thin or turns too sharply.
    fn continuation(&self, parent: &Axis, knots: &mut Vec<Knot>) -> Option<Vec3> {
        let last = self.plant.nodes_of(parent).end - 1;
        let (p0, r0) = (self.plant.nodes.p[last], self.plant.nodes.r[last]);
        let t0 = end_direction(self.plant, parent);
        let first = self.plant.nodes_of(self.axis).start;
        let ahead = self.plant.frame(self.axis, r0.min(self.axis.length)).p - self.plant.nodes.p[first];
        let cosine = t0.dot(math::normalize_or(ahead, t0));
        let heir = self.heirs[self.axis.parent as usize] as usize == self.index;
        if cosine < 0.17 || !(heir || self.plant.nodes.r[first] > 0.45 * r0) {
            return None;
        }
        let angle = math::acos_f32(cosine.min(1.0));
        let reach = (r0 * (1.2 + 1.3 * angle)).min(0.7 * self.axis.length);
        let end = self.plant.frame(self.axis, reach);
        let beyond = self.plant.frame(self.axis, reach + 0.01 * self.axis.length).p;
        let before = self.plant.frame(self.axis, reach * 0.95).p;
        let t1 = math::normalize_or(beyond - before, t0);
        if t1.dot(t0) < 0.0 || (end.p - p0).dot(t0) < 0.35 * reach || (end.p - p0).dot(t1) < 0.35 * reach {
            return None;
        }
        // The centreline has its corner at the parent's tip; setting out between both directions rounds it without a detour.
        let (m0, m1) = (math::normalize_or(t0 + t1, t0) * reach, t1 * reach);
        let pieces = if angle > self.options.turn { 3_u8 } else { 2 };
        for k in 0..pieces {
            let u = f32::from(k) / f32::from(pieces);
            let (u2, u3) = (u * u, u * u * u);
            let blend = 3.0 * u2 - 2.0 * u3;
            let p = p0 * (1.0 - blend) + m0 * (u3 - 2.0 * u2 + u) + end.p * blend + m1 * (u3 - u2);
            knots.push(Knot { p, r: math::lerp(r0, end.r, blend), s: u * reach });
        }
        self.follow(reach, knots);
        Some(t0)
    }

    /// Direction of the parent's segment that the branch leaves along: at a node of the parent the one that runs the same
    /// way as the branch, forth or back.
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

    /// Where the branch leaves the parent's bark and where its first regular ring stands; none if it stays inside, runs
    /// along the parent or is too short for a foot.
    fn foot(&self, parent: &Axis) -> Option<(Foot, f32)> {
        let site = self.plant.frame(parent, self.axis.parent_s);
        let along = self.parent_direction(parent);
        let outside = |p: Vec3| (p - site.p).reject_from_normalized(along).length_squared() - site.r * site.r;
        let nodes = self.plant.nodes_of(self.axis);
        let i = nodes.clone().skip(1).find(|&i| outside(self.plant.nodes.p[i]) > 0.0)?;
        let (a, b) = (self.knot(i - 1), self.knot(i));
        let t = math::normalize_or(b.p - a.p, along);
        let across = t.reject_from_normalized(along);
        let sin = across.length();
        if sin < 0.2 {
            return None;
        }
        // Where the straight line through a and b is one parent radius from the parent's axis.
        let w = (a.p - site.p).reject_from_normalized(along);
        let half = w.dot(across) / (sin * sin);
        let root = half * half - (w.length_squared() - site.r * site.r) / (sin * sin);
        let reach = (root.max(0.0).sqrt() - half).max(0.0);
        let s = a.s + reach;
        let r = math::lerp(a.r, b.r, (reach / (b.s - a.s).max(1e-9)).min(1.0));
        let wide = (r * (1.0 + self.options.collar)).min(site.r);
        let clear = s + wide * t.dot(along).abs() / sin;
        let ease = (1.2 * site.r).clamp(0.8 * r, 2.5 * r);
        let from = (clear + ease).min(0.9 * self.axis.length);
        if from < clear + 0.3 * ease {
            return None;
        }
        self.straight_foot((a.p + t * reach, site.p, along), (s, r, from)).map(|foot| (foot, from))
    }

    /// The foot on the line from where the branch leaves the bark to its first regular ring; none if the branch then
    /// runs along the parent or turns away from that line. `o`: on the bark; `axis`: on the parent's centreline.
    fn straight_foot(&self, (o, axis, along): (Vec3, Vec3, Vec3), (s, r, from): (f32, f32, f32)) -> Option<Foot> {
        let first = self.plant.frame(self.axis, from).p;
        let ahead = self.plant.frame(self.axis, from + 0.5 * (from - s)).p - first;
        let t = math::normalize_or(first - o, along);
        let across = t.reject_from_normalized(along);
        let sin2 = across.length_squared();
        let straight = math::normalize_or(ahead, t).dot(t);
        let out = (o - axis).reject_from_normalized(along).dot(across);
        (sin2 > 0.04 && straight > 0.6 && out > 0.0).then_some(Foot { o, t, s, r, depth: out / sin2 })
    }
}
