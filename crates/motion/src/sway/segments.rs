//! A plant cut where thick wood turns into thin: what each piece weighs and how much wind it catches.

use std::ops::Add;

use super::beam::CantileverBeam;
use super::wood::WoodParams;
use osier_base::math;
use osier_scene::plant::{Axis, AxisKind, NONE, Plant};

/// A piece ends where its radius falls below this share of what it began with.
const SEGMENT_RADIUS_RATIO: f32 = 0.25;
/// Most pieces of an axis.
const MAX_SEGMENTS_PER_AXIS: u32 = 3;
/// Shortest piece, as a share of its axis.
const MIN_SEGMENT_SHARE: f32 = 0.05;
/// Points of a beam: more where more is seen.
const LIMB_STATIONS: usize = 32;
const TWIG_STATIONS: usize = 16;

/// How many elements a plant may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ElementBudget {
    /// So many joints: 4, 2, 1 for an element of order 0, 1, 2 and more.
    Joints(usize),
    /// So many joints: 2, 1, 1.
    Coarse(usize),
    /// So many elements.
    Elements(usize),
}

/// What hangs on a place.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BranchLoad {
    /// Area of wood across the wind, m^2.
    pub wood: f64,
    /// One-sided area of leaves, m^2.
    pub leaf: f64,
    /// kg.
    pub mass: f64,
}

impl BranchLoad {
    pub(crate) fn times(self, k: f64) -> Self {
        Self { wood: self.wood * k, leaf: self.leaf * k, mass: self.mass * k }
    }
}

impl Add for BranchLoad {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { wood: self.wood + o.wood, leaf: self.leaf + o.leaf, mass: self.mass + o.mass }
    }
}

/// Part of an axis.
#[derive(Debug, Clone)]
pub(crate) struct AxisSegment {
    pub(crate) axis: u32,
    /// 0 at the axis' base.
    pub(crate) number: u32,
    pub(crate) span: [f32; 2],
    /// Piece that carries it, below its own index, and where on that one's axis.
    pub(crate) parent: Option<usize>,
    pub(crate) parent_s: f32,
    pub(crate) children: Vec<usize>,
    /// Leaves by their place on the axis.
    pub(crate) leaves: Vec<(f32, BranchLoad)>,
    /// Everything on it and on what it carries.
    pub(crate) total: BranchLoad,
    /// Length of it and of what it carries, m.
    reach: f32,
}

/// All pieces of a plant, parents first.
pub(crate) struct AxisSegments {
    pub(crate) list: Vec<AxisSegment>,
    /// Order and id of each piece's axis; roots below the ground count as the last.
    keys: Vec<(u8, u64)>,
    /// How far a wind turns the tip, of each.
    bends: Vec<f64>,
}

impl AxisSegments {
    pub(crate) fn of(plant: &Plant, wood: &WoodParams) -> Self {
        let mut all = Self { list: Vec::new(), keys: Vec::new(), bends: Vec::new() };
        let mut first: Vec<usize> = Vec::with_capacity(plant.axes.len());
        for (i, axis) in plant.axes.iter().enumerate() {
            first.push(all.list.len());
            let stem =
                (axis.parent != NONE).then(|| all.segment_at(first[axis.parent as usize], axis.parent, axis.parent_s));
            all.split_axis(plant, i, stem);
        }
        for organ in &plant.organs {
            let piece = all.segment_at(first[organ.axis as usize], organ.axis, organ.s);
            let area = plant.protos.get(usize::from(organ.proto)).map_or(0.0, |p| area(&p.mesh));
            let leaf = area * f64::from(organ.scale) * f64::from(organ.scale);
            all.list[piece].leaves.push((organ.s, BranchLoad { wood: 0.0, leaf, mass: leaf * wood.leaf_mass }));
        }
        all.accumulate_totals(plant, wood);
        all
    }

    /// Cuts one axis.
    fn split_axis(&mut self, plant: &Plant, i: usize, stem: Option<usize>) {
        let axis = &plant.axes[i];
        let (mut parent, mut parent_s, mut from) = (stem, axis.parent_s, 0.0);
        for number in 0..MAX_SEGMENTS_PER_AXIS {
            let last = number + 1 == MAX_SEGMENTS_PER_AXIS;
            let end = if last { axis.length } else { taper_point(plant, axis, from) };
            let index = self.list.len();
            self.list.push(AxisSegment {
                axis: u32::try_from(i).unwrap_or(NONE),
                number,
                span: [from, end],
                parent,
                parent_s,
                children: Vec::new(),
                leaves: Vec::new(),
                total: BranchLoad::default(),
                reach: end - from,
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

    /// The piece of an axis that holds arc length `s`; `first`: the axis' first piece.
    fn segment_at(&self, first: usize, axis: u32, s: f32) -> usize {
        let own = self.list[first..].iter().take_while(|p| p.axis == axis);
        let before = own.take_while(|p| p.span[1] <= s).count();
        let holds = |i: usize| self.list.get(i).is_some_and(|p| p.axis == axis);
        first + if holds(first + before) { before } else { before.saturating_sub(1) }
    }

    fn accumulate_totals(&mut self, plant: &Plant, wood: &WoodParams) {
        self.bends = vec![0.0; self.list.len()];
        for i in (0..self.list.len()).rev() {
            let own = self.wood_along(plant, wood, i, 3).into_iter().fold(BranchLoad::default(), BranchLoad::add);
            let own = self.list[i].leaves.iter().fold(own, |sum, (_, l)| sum + *l);
            let piece = &mut self.list[i];
            piece.total = piece.total + own;
            let (total, reach, parent) = (piece.total, piece.reach, piece.parent);
            let axis = &plant.axes[piece.axis as usize];
            let middle = plant.frame(axis, (piece.span[0] + piece.span[1]) * 0.5).r;
            let length = f64::from(piece.span[1] - piece.span[0]);
            // F L^2 / (6 E I) for a wind of unit pressure.
            let force = wood.drag * total.wood + wood.leaf_drag * total.leaf;
            self.bends[i] = force * length * length / (6.0 * wood.rigidity(f64::from(middle)).max(1e-9));
            if let Some(p) = parent {
                self.list[p].total = self.list[p].total + total;
                self.list[p].reach += reach;
            }
        }
    }

    /// By order, then by how much of the plant moves how far, then by id.
    pub(crate) fn ranked_by_motion(&self) -> Vec<usize> {
        let mut ranked: Vec<usize> = (0..self.list.len()).collect();
        let weight = |i: usize| f64::from(self.list[i].reach) * self.bends[i];
        ranked.sort_by(|&a, &b| {
            let by_order = self.keys[a].0.cmp(&self.keys[b].0);
            let by_weight = weight(b).total_cmp(&weight(a));
            by_order.then(by_weight).then(self.keys[a].1.cmp(&self.keys[b].1)).then(a.cmp(&b))
        });
        ranked
    }

    /// Which pieces fit: each only if what carries it does.
    pub(crate) fn select(&self, ranked: &[usize], budget: ElementBudget) -> Vec<bool> {
        let mut kept = vec![false; self.list.len()];
        let mut left = match budget {
            ElementBudget::Joints(n) | ElementBudget::Coarse(n) => n.saturating_sub(1),
            ElementBudget::Elements(n) => n,
        };
        for &i in ranked {
            let order = self.keys[i].0;
            let cost = match budget {
                ElementBudget::Joints(_) => joints_per_order(order, false),
                ElementBudget::Coarse(_) => joints_per_order(order, true),
                ElementBudget::Elements(_) => 1,
            };
            if order != u8::MAX && cost <= left && self.list[i].parent.is_none_or(|p| kept[p]) {
                kept[i] = true;
                left -= cost;
            }
        }
        kept
    }

    /// The piece as a beam without load.
    pub(crate) fn beam(&self, plant: &Plant, wood: &WoodParams, i: usize) -> CantileverBeam {
        let piece = &self.list[i];
        let axis = &plant.axes[piece.axis as usize];
        let n = if axis.order <= 1 { LIMB_STATIONS } else { TWIG_STATIONS };
        let length = f64::from(piece.span[1] - piece.span[0]);
        let stiff = |k: f64| wood.rigidity(radius(plant, axis, piece, k / n as f64));
        CantileverBeam {
            x: (0..=n).map(|k| length * k as f64 / n as f64).collect(),
            rigidity: (0..=n).map(|k| stiff(k as f64)).collect(),
            between: (0..=n).map(|k| stiff(k as f64 + 0.5)).collect(),
            mass: Vec::new(),
        }
    }

    /// Area and mass of its wood, shared out to `n` places from base to tip.
    pub(crate) fn wood_along(&self, plant: &Plant, wood: &WoodParams, i: usize, n: usize) -> Vec<BranchLoad> {
        let piece = &self.list[i];
        let axis = &plant.axes[piece.axis as usize];
        if axis.kind == AxisKind::Root {
            return vec![BranchLoad::default(); n];
        }
        let (length, last) = (f64::from(piece.span[1] - piece.span[0]), (n - 1) as f64);
        let one = |k: usize| {
            let (a, b) = ((k as f64 - 0.5).max(0.0) / last, (k as f64 + 0.5).min(last) / last);
            let [ra, rm, rb] = [a, (a + b) * 0.5, b].map(|x| radius(plant, axis, piece, x));
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

/// Joints of an element: more where more is seen.
pub(crate) fn joints_per_order(order: u8, coarse: bool) -> usize {
    match order {
        0 if coarse => 2,
        0 => 4,
        1 if !coarse => 2,
        _ => 1,
    }
}

fn radius(plant: &Plant, axis: &Axis, piece: &AxisSegment, x: f64) -> f64 {
    let s = piece.span[0] + (piece.span[1] - piece.span[0]) * math::narrow(x.min(1.0));
    f64::from(plant.frame(axis, s).r)
}

/// Where an axis is a quarter as thick as at `from`, or its end.
fn taper_point(plant: &Plant, axis: &Axis, from: f32) -> f32 {
    let least = plant.frame(axis, from).r * SEGMENT_RADIUS_RATIO;
    let nodes = plant.nodes_of(axis);
    let thin = nodes.clone().find(|&k| plant.nodes.s[k] > from && plant.nodes.r[k] < least);
    let Some(k) = thin else { return axis.length };
    // Between the node before and this one.
    let (i, j) = (k.saturating_sub(1).max(nodes.start), k);
    let (a, b) = (plant.nodes.r[i], plant.nodes.r[j]);
    let t = if a > b { ((a - least) / (a - b)).clamp(0.0, 1.0) } else { 0.0 };
    let s = math::lerp(plant.nodes.s[i], plant.nodes.s[j], t);
    let short = axis.length * MIN_SEGMENT_SHARE;
    if s - from < short || axis.length - s < short { axis.length } else { s }
}

/// One-sided area of a mesh, m^2.
fn area(mesh: &osier_scene::Mesh) -> f64 {
    let corner = |i: u32| mesh.points.get(i as usize).copied().unwrap_or_default().as_dvec3();
    mesh.triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(corner);
            (b - a).cross(c - a).length() * 0.5
        })
        .sum()
}
