//! The body of a drop that runs: along the way that it came it narrows from its head to the end of its tail, without creases.

use std::f64::consts::PI;

use glam::DVec3;

use crate::rain::drops::shape::SphericalCap;
use crate::rain::frame::SessileDrop;
use crate::rain::mesh::DropPlacement;
use osier_base::math;

/// Rows per base radius, and most rows.
const ROWS: f64 = 7.0;
const LONG: u32 = 160;
/// Slices along, and steps from the middle to the rim, in which its volume is measured.
const SLICES: u32 = 96;
const STEPS: u32 = 24;
/// Bounds of the factor on heights that keeps its volume.
const FACTOR: [f64; 2] = [0.4, 1.6];

/// The way that a drop with a tail came, from its head back, and its shape along it.
pub(super) struct TailBody {
    /// Places, of leaf space from the head, and the way to each, m.
    points: Vec<(DVec3, f64)>,
    /// Way to the middle of each cap, m, half of its width there and its height, with their slopes.
    nodes: Vec<TailNode>,
    /// The caps at its ends and their stretch.
    head: (SphericalCap, f64),
    end: (SphericalCap, f64),
    normal: DVec3,
    skew: f64,
    /// Where it begins and ends.
    from: f64,
    to: f64,
    /// On all heights.
    factor: f64,
}

/// Half width and height at a way, m, and how they change with it.
#[derive(Debug, Clone, Copy)]
struct TailNode {
    way: f64,
    size: [f64; 2],
    slope: [f64; 2],
}

impl TailBody {
    pub(super) fn new(base: &DropPlacement<'_>, drop: &SessileDrop) -> Option<Self> {
        let places: Vec<DVec3> = drop.beads.iter().filter_map(|b| base.leaf.at(b.uv)).map(|s| s.p).collect();
        if places.len() != drop.beads.len() {
            return None;
        }
        let mut points = Vec::new();
        let mut way = 0.0;
        for (i, p) in places.iter().enumerate() {
            way += if i > 0 { p.distance(places[i - 1]) } else { 0.0 };
            points.push((*p - base.spot.p, way));
        }
        let q = |i: usize| if i == 0 { drop.print.q } else { 1.0 };
        let caps: Vec<(f64, f64, SphericalCap)> =
            drop.beads.iter().enumerate().map(|(i, b)| (points[i].1, q(i), b.cap)).collect();
        let (head, last) = (caps.first()?, caps.last()?);
        let (from, to) = (-head.2.reach() * head.1, last.0 + last.2.reach() * last.1);
        let (head, end) = ((head.2, head.1), (last.2, last.1));
        // Caps that stand on one place have no way between them: the drop's own axis leads.
        if way < 1e-6 {
            let back = -drop.axis;
            points = vec![(DVec3::ZERO, 0.0), (back * 1e-3, 1e-3)];
        }
        let skew = drop.print.skew;
        let nodes = nodes(&caps, skew);
        let mut line = Self { points, nodes, head, end, normal: base.spot.n, skew, from, to, factor: 1.0 };
        let found = line.volume();
        if found > 0.0 {
            line.factor = (drop.volume / found).clamp(FACTOR[0], FACTOR[1]);
        }
        Some(line)
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub(super) fn rows(&self) -> u32 {
        let least = self.nodes.iter().fold(f64::MAX, |m, n| m.min(n.size[0])).max(1e-5);
        ((self.to - self.from) / least * ROWS).ceil().clamp(16.0, f64::from(LONG)) as u32
    }

    /// Way of a row; rows stand closer at the ends.
    pub(super) fn at(&self, k: u32, rows: u32) -> f64 {
        let share = 0.5 - 0.5 * math::cos(PI * f64::from(k) / f64::from(rows));
        self.from + (self.to - self.from) * share
    }

    /// Half of its width and its height at a way, m. In front of the head's middle and behind the last cap's they are those of
    /// the caps, between them a curve without bumps runs through those of all caps. Source: own.
    fn section(&self, s: f64) -> [f64; 2] {
        let (first, last) = (self.nodes[0], self.nodes[self.nodes.len() - 1]);
        let rounded = |(cap, q): (SphericalCap, f64), x: f64| {
            let x = x / q;
            let wide = cap.reach() / q * math::sqrt((1.0 - (x / cap.reach()).min(1.0) * (x / cap.reach())).max(0.0));
            [wide, cap.height((x / cap.a).abs())]
        };
        if s <= first.way {
            let [wide, high] = rounded(self.head, first.way - s);
            let lean = 1.0 + self.skew * ((first.way - s) / (self.head.0.a * self.head.1)).clamp(0.0, 1.0);
            return [wide, high * lean];
        }
        if s >= last.way {
            let [wide, high] = rounded(self.end, s - last.way);
            let share = last.size[1] / self.end.0.top().max(1e-12);
            return [wide, high * share];
        }
        let k = self.nodes.partition_point(|n| n.way <= s).clamp(1, self.nodes.len() - 1);
        let (a, b) = (self.nodes[k - 1], self.nodes[k]);
        [0, 1].map(|i| hermite([a.way, b.way], [a.size[i], b.size[i]], [a.slope[i], b.slope[i]], s).max(0.0))
    }

    /// Half of its width.
    pub(super) fn width(&self, s: f64) -> f64 {
        self.section(s)[0].max(1e-6)
    }

    /// Its height at a way back and aside: across it is as round as a cap.
    pub(super) fn height(&self, s: f64, x: f64) -> f64 {
        let [wide, high] = self.section(s);
        let rho = (x.abs() / wide.max(1e-9)).min(1.0);
        high * self.factor * across(&self.head.0, rho)
    }

    /// Volume over the leaf without the factor, m^3.
    fn volume(&self) -> f64 {
        let n = f64::from(STEPS);
        let round: f64 = (0..STEPS).map(|i| across(&self.head.0, (f64::from(i) + 0.5) / n) / n).sum();
        let long = (self.to - self.from) / f64::from(SLICES);
        let slice = |k: u32| {
            let [wide, high] = self.section(self.from + (f64::from(k) + 0.5) * long);
            2.0 * wide * high * round * long
        };
        (0..SLICES).map(slice).sum()
    }

    /// A point of the drop: a way back, aside, and up.
    pub(super) fn point(&self, base: &DropPlacement<'_>, s: f64, x: f64, h: f64) -> DVec3 {
        let last = self.points.len() - 1;
        let k = self.points.partition_point(|(_, way)| *way <= s).clamp(1, last);
        let ((a, s0), (b, s1)) = (self.points[k - 1], self.points[k]);
        let t = (s - s0) / (s1 - s0).max(1e-9);
        // Directions turn evenly, so that rows do not cross in a bend.
        let way = |k: usize| (self.points[k.min(last)].0 - self.points[k.min(last) - 1].0).normalize_or(DVec3::Y);
        let (before, after) = (way(k.max(2) - 1), way(k));
        let tangent = before.lerp(after, (0.5 + t).clamp(0.0, 1.0)).normalize_or(after);
        let aside = self.normal.cross(tangent).normalize_or(DVec3::X);
        base.point(a + (b - a) * t + aside * x, h)
    }
}

/// Height of a cap at a share of its width, as a share of its top.
fn across(cap: &SphericalCap, rho: f64) -> f64 {
    let top = cap.top();
    if top > 0.0 { cap.height(rho * cap.reach() / cap.a) / top } else { 0.0 }
}

/// Sizes at the middles of the caps. Slopes are those of a curve that rises and falls only where its points do.
/// Source: Fritsch and Butland's harmonic mean.
fn nodes(caps: &[(f64, f64, SphericalCap)], skew: f64) -> Vec<TailNode> {
    let mut nodes: Vec<TailNode> = Vec::new();
    for (way, q, cap) in caps {
        // Caps on one place are one.
        if nodes.last().is_none_or(|n| way - n.way > 1e-7) {
            nodes.push(TailNode { way: *way, size: [cap.reach() / q, cap.top()], slope: [0.0; 2] });
        }
    }
    for k in 1..nodes.len().saturating_sub(1) {
        let [a, b, c] = [nodes[k - 1], nodes[k], nodes[k + 1]];
        nodes[k].slope = [0, 1].map(|i| {
            let (l, r) = ((b.size[i] - a.size[i]) / (b.way - a.way), (c.size[i] - b.size[i]) / (c.way - b.way));
            if l * r > 0.0 { 2.0 * l * r / (l + r) } else { 0.0 }
        });
    }
    // The head leans on into its tail, as far as that stays even.
    if let [first, second, ..] = nodes.as_mut_slice()
        && let Some((_, q, cap)) = caps.first()
    {
        let fall = (second.size[1] - first.size[1]) / (second.way - first.way);
        first.slope[1] = (-skew * cap.top() / (cap.a * q)).clamp((3.0 * fall).min(0.0), 0.0);
    }
    nodes
}

/// A cubic between two ways with given values and slopes.
fn hermite([s0, s1]: [f64; 2], [a, b]: [f64; 2], [u, v]: [f64; 2], s: f64) -> f64 {
    let d = s1 - s0;
    let t = (s - s0) / d;
    let (t2, t3) = (t * t, t * t * t);
    a * (2.0 * t3 - 3.0 * t2 + 1.0) + b * (3.0 * t2 - 2.0 * t3) + d * (u * (t3 - 2.0 * t2 + t) + v * (t3 - t2))
}
