//! Segmentation of axes where thick wood tapers to thin, with the mass and drag area of each segment.

use std::ops::Add;

use super::beam::CantileverBeam;
use super::wood::WoodParams;
use crate::sway::tuning::{
    LIMB_STATIONS, MAX_SEGMENTS_PER_AXIS, MIN_SEGMENT_SHARE, SEGMENT_RADIUS_RATIO, TWIG_STATIONS,
};
use osier_base::math;
use osier_scene::plant::{Axis, AxisKind, NONE, Plant};

/// Drag areas and mass of a part of a plant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BranchLoad {
    /// Projected area of wood, m^2.
    pub wood: f64,
    /// One-sided area of leaves, m^2.
    pub leaf: f64,
    /// Mass of wood and leaves, kg.
    pub mass: f64,
}

impl BranchLoad {
    pub(crate) fn scaled(self, k: f64) -> Self {
        Self { wood: self.wood * k, leaf: self.leaf * k, mass: self.mass * k }
    }
}

impl Add for BranchLoad {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { wood: self.wood + o.wood, leaf: self.leaf + o.leaf, mass: self.mass + o.mass }
    }
}

/// A stretch of an axis that may become an element.
#[derive(Debug, Clone)]
pub(crate) struct AxisSegment {
    pub(crate) axis: u32,
    /// Index along the axis, 0 at its base.
    pub(crate) number: u32,
    pub(crate) span: [f32; 2],
    /// Index of the carrying segment, lower than its index, and arc length on the axis of that segment, m.
    pub(crate) parent: Option<usize>,
    pub(crate) parent_s: f32,
    pub(crate) children: Vec<usize>,
    /// Leaves by arc length on the axis, m.
    pub(crate) leaves: Vec<(f32, BranchLoad)>,
    /// Load of the segment and of everything that it carries.
    pub(crate) total: BranchLoad,
}

/// All segments of a plant, parents first.
pub(crate) struct AxisSegments {
    pub(crate) list: Vec<AxisSegment>,
    /// Sort key of each segment: order and id of its axis; roots come last.
    keys: Vec<(u8, u64)>,
}

impl AxisSegments {
    pub(crate) fn from_plant(plant: &Plant, wood: &WoodParams) -> Self {
        let mut all = Self { list: Vec::new(), keys: Vec::new() };
        let mut first: Vec<usize> = Vec::with_capacity(plant.axes.len());
        for (i, axis) in (0_u32..).zip(&plant.axes) {
            first.push(all.list.len());
            let attachment =
                (axis.parent != NONE).then(|| all.segment_at(first[axis.parent as usize], axis.parent, axis.parent_s));
            all.split_axis(plant, i, attachment);
        }
        for organ in &plant.organs {
            let segment = all.segment_at(first[organ.axis as usize], organ.axis, organ.s);
            let area = plant.protos.get(usize::from(organ.proto)).map_or(0.0, |p| mesh_area(&p.mesh));
            let leaf = area * f64::from(organ.scale) * f64::from(organ.scale);
            all.list[segment].leaves.push((organ.s, BranchLoad { wood: 0.0, leaf, mass: leaf * wood.leaf_mass }));
        }
        all.accumulate_totals(plant, wood);
        all
    }

    /// Splits axis `i` into segments. `stem`: segment that carries it.
    fn split_axis(&mut self, plant: &Plant, i: u32, stem: Option<usize>) {
        let axis = &plant.axes[i as usize];
        // Cut where the wood has tapered enough; the last segment extends to the end of the axis.
        let (mut parent, mut parent_s, mut from) = (stem, axis.parent_s, 0.0);
        for number in 0..MAX_SEGMENTS_PER_AXIS {
            let last = number + 1 == MAX_SEGMENTS_PER_AXIS;
            let end = if last { axis.length } else { taper_point(plant, axis, from) };
            let index = self.list.len();
            self.list.push(AxisSegment {
                axis: i,
                number,
                span: [from, end],
                parent,
                parent_s,
                children: Vec::new(),
                leaves: Vec::new(),
                total: BranchLoad::default(),
            });
            self.keys.push((if axis.kind == AxisKind::Root { u8::MAX } else { axis.order }, axis.id));
            if let Some(p) = parent {
                self.list[p].children.push(index);
            }
            (parent, parent_s, from) = (Some(index), end, end);
            if end >= axis.length {
                break;
            }
        }
    }

    /// Index of the segment that contains arc length `s`, m; `first`: the axis' first segment.
    fn segment_at(&self, first: usize, axis: u32, s: f32) -> usize {
        // Segments of an axis are contiguous.
        let own = self.list[first..].iter().take_while(|p| p.axis == axis);
        let before = own.take_while(|p| p.span[1] <= s).count();
        let holds = |i: usize| self.list.get(i).is_some_and(|p| p.axis == axis);
        first + if holds(first + before) { before } else { before.saturating_sub(1) }
    }

    fn accumulate_totals(&mut self, plant: &Plant, wood: &WoodParams) {
        // Children come after their parents: totals accumulate from the tips inwards.
        for i in (0..self.list.len()).rev() {
            let own = self.wood_along(plant, wood, i, 3).into_iter().fold(BranchLoad::default(), BranchLoad::add);
            let own = self.list[i].leaves.iter().fold(own, |sum, (_, l)| sum + *l);
            let segment = &mut self.list[i];
            segment.total = segment.total + own;
            let (total, parent) = (segment.total, segment.parent);
            if let Some(p) = parent {
                self.list[p].total = self.list[p].total + total;
            }
        }
    }

    /// Segments by branching order, then by falling length of their axis, then by id: those of one axis follow each other. Size
    /// decides, not flexibility, so that branches of one size all bend or none does.
    pub(crate) fn ranked_by_size(&self, plant: &Plant) -> Vec<usize> {
        let mut ranked: Vec<usize> = (0..self.list.len()).collect();
        let length = |i: usize| plant.axes[self.list[i].axis as usize].length;
        ranked.sort_by(|&a, &b| {
            let by_order = self.keys[a].0.cmp(&self.keys[b].0);
            let by_length = length(b).total_cmp(&length(a));
            by_order.then(by_length).then(self.keys[a].1.cmp(&self.keys[b].1)).then(a.cmp(&b))
        });
        ranked
    }

    /// Selects at most `budget` segments, each only if its carrier is selected.
    pub(crate) fn select(&self, ranked: &[usize], budget: usize) -> Vec<bool> {
        let mut kept = vec![false; self.list.len()];
        let mut left = budget;
        for &i in ranked {
            if left > 0 && self.keys[i].0 != u8::MAX && self.list[i].parent.is_none_or(|p| kept[p]) {
                kept[i] = true;
                left -= 1;
            }
        }
        kept
    }

    /// Stations and stiffness of the beam of segment `i`; its masses are empty.
    pub(crate) fn beam(&self, plant: &Plant, wood: &WoodParams, i: usize) -> CantileverBeam {
        let segment = &self.list[i];
        let axis = &plant.axes[segment.axis as usize];
        let n = if axis.order <= 1 { LIMB_STATIONS } else { TWIG_STATIONS };
        let length = f64::from(segment.span[1] - segment.span[0]);
        let stiff = |k: f64| wood.rigidity(segment_radius(plant, axis, segment, k / n as f64));
        CantileverBeam {
            x: (0..=n).map(|k| length * k as f64 / n as f64).collect(),
            rigidity: (0..=n).map(|k| stiff(k as f64)).collect(),
            between: (0..=n).map(|k| stiff(k as f64 + 0.5)).collect(),
            mass: Vec::new(),
        }
    }

    /// Projected area, m^2, and mass, kg, of a segment's wood, lumped at `n` stations; zero for roots.
    pub(crate) fn wood_along(&self, plant: &Plant, wood: &WoodParams, i: usize, n: usize) -> Vec<BranchLoad> {
        let segment = &self.list[i];
        let axis = &plant.axes[segment.axis as usize];
        if axis.kind == AxisKind::Root {
            return vec![BranchLoad::default(); n];
        }
        let (length, last) = (f64::from(segment.span[1] - segment.span[0]), (n - 1) as f64);
        let one = |k: usize| {
            let (a, b) = ((k as f64 - 0.5).max(0.0) / last, (k as f64 + 0.5).min(last) / last);
            // Simpson's rule over the stretch that belongs to the station.
            let [ra, rm, rb] = [a, (a + b) * 0.5, b].map(|x| segment_radius(plant, axis, segment, x));
            // A station at either end represents half a stretch, others a whole one.
            let ds = (b - a) * length;
            let mean = |f: fn(f64) -> f64| (f(ra) + 4.0 * f(rm) + f(rb)) / 6.0 * ds;
            BranchLoad {
                wood: mean(|r| 2.0 * r),
                leaf: 0.0,
                mass: wood.density * std::f64::consts::PI * mean(|r| r * r),
            }
        };
        (0..n).map(one).collect()
    }
}

fn segment_radius(plant: &Plant, axis: &Axis, segment: &AxisSegment, x: f64) -> f64 {
    let s = segment.span[0] + (segment.span[1] - segment.span[0]) * math::narrow(x.min(1.0));
    f64::from(plant.frame(axis, s).r)
}

/// Arc length, m, at which the radius has fallen to [`SEGMENT_RADIUS_RATIO`] of that at `from`, or the end of the axis.
fn taper_point(plant: &Plant, axis: &Axis, from: f32) -> f32 {
    let least = plant.frame(axis, from).r * SEGMENT_RADIUS_RATIO;
    let nodes = plant.nodes_of(axis);
    let thin = nodes.clone().find(|&k| plant.nodes.s[k] > from && plant.nodes.r[k] < least);
    let Some(k) = thin else { return axis.length };
    // Interpolate between the two nodes around that radius.
    let (i, j) = (k.saturating_sub(1).max(nodes.start), k);
    let (a, b) = (plant.nodes.r[i], plant.nodes.r[j]);
    let t = if a > b { ((a - least) / (a - b)).clamp(0.0, 1.0) } else { 0.0 };
    let s = math::lerp(plant.nodes.s[i], plant.nodes.s[j], t);
    let short = axis.length * MIN_SEGMENT_SHARE;
    if s - from < short || axis.length - s < short { axis.length } else { s }
}

/// One-sided area of a mesh, m^2.
fn mesh_area(mesh: &osier_scene::Mesh) -> f64 {
    let corner = |i: u32| mesh.points.get(i as usize).copied().unwrap_or_default().as_dvec3();
    mesh.triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(corner);
            (b - a).cross(c - a).length() * 0.5
        })
        .sum()
}
