//! Where everything on a plant is while it bends: centrelines, bark and organs in full.

use glam::{Quat, Vec3};

use super::elements::{BeamElements, ElementLocation};
use osier_base::math;
use osier_base::par::par_chunks;
use osier_scene::plant::{NONE, Organ, Plant};

/// Rings within this many radii of the place where an axis leaves its parent follow the parent.
pub(crate) const COLLAR_RADII: f32 = 1.5;
/// Points that one thread moves at a time.
const POINTS_PER_TASK: usize = 4096;

/// Moved centrelines: per node its place, m, and its turn from rest.
#[derive(Debug, Clone, Default)]
pub struct PosedSkeleton {
    p: Vec<Vec3>,
    q: Vec<Quat>,
}

/// A place between two nodes.
#[derive(Debug, Clone, Copy)]
struct SegmentAttachment {
    node: u32,
    t: f32,
    /// From the centreline to the point, at rest.
    arm: Vec3,
}

/// A point that hangs on one or two centrelines.
#[derive(Debug, Clone, Copy)]
struct BoundPoint {
    own: SegmentAttachment,
    parent: SegmentAttachment,
    /// Share of its own axis.
    share: f32,
}

/// The plant with what moves each of its nodes.
#[derive(Debug, Clone)]
pub struct PointBinding {
    /// Per node: what moves it, and what moves the middle of the segment that begins there.
    nodes: Vec<[ElementLocation; 2]>,
    /// Per axis: nodes, and the place on the parent where it stands.
    axes: Vec<(std::ops::Range<usize>, Option<SegmentAttachment>)>,
    rest: Vec<Vec3>,
    bark: Vec<BoundPoint>,
}

impl PointBinding {
    /// `bark`: axis and arc length, m, of each of `points`, the bark at rest.
    pub fn new(plant: &Plant, elements: &BeamElements, points: &[Vec3], bark: &[(u32, f32)]) -> Self {
        let mut nodes = vec![[ElementLocation { element: NONE, at: 0.0 }; 2]; plant.nodes.len()];
        let mut axes = Vec::with_capacity(plant.axes.len());
        for (i, axis) in plant.axes.iter().enumerate() {
            let range = plant.nodes_of(axis);
            let index = u32::try_from(i).unwrap_or(NONE);
            for k in range.clone() {
                let s = plant.nodes.s[k];
                let next = if k + 1 < range.end { plant.nodes.s[k + 1] } else { s };
                nodes[k] = [s, (s + next) * 0.5].map(|s| elements.locate(index, s));
            }
            let stem =
                (axis.parent != NONE).then(|| attach(plant, axis.parent, axis.parent_s, plant.nodes.p[range.start]));
            axes.push((range, stem));
        }
        let bind = |((axis, s), p): (&(u32, f32), &Vec3)| bind(plant, *axis, *s, *p);
        Self { nodes, axes, rest: plant.nodes.p.clone(), bark: bark.iter().zip(points).map(bind).collect() }
    }

    /// Where the centrelines are for bends of the elements.
    pub fn pose(&self, elements: &BeamElements, bends: &[[f32; 2]]) -> PosedSkeleton {
        let bases = elements.base_rotations(bends);
        let turned = |s: ElementLocation| elements.rotation_at(&bases, bends, s);
        let mut posture = PosedSkeleton { p: self.rest.clone(), q: vec![Quat::IDENTITY; self.rest.len()] };
        for (range, stem) in &self.axes {
            if let Some(stem) = stem {
                posture.p[range.start] = posture.position(stem);
            }
            for k in range.clone() {
                let [at, middle] = self.nodes[k];
                posture.q[k] = turned(at);
                if k + 1 < range.end {
                    // Along a rider both are the same turn.
                    let q = if at == middle { posture.q[k] } else { turned(middle) };
                    posture.p[k + 1] = posture.p[k] + q * (self.rest[k + 1] - self.rest[k]);
                }
            }
        }
        posture
    }

    /// The bark's points, m.
    pub fn bark(&self, posture: &PosedSkeleton) -> Vec<Vec3> {
        par_chunks(&self.bark, POINTS_PER_TASK, |_, part| {
            part.iter().map(|b| posture.bound_position(b)).collect::<Vec<_>>()
        })
        .concat()
    }

    /// The bark's normals. `normals`: at rest, one per point.
    pub fn normals(&self, posture: &PosedSkeleton, normals: &[Vec3]) -> Vec<Vec3> {
        let one = |(b, n): (&BoundPoint, &Vec3)| {
            let own = posture.rotation(&b.own);
            let q = if b.share >= 1.0 { own } else { math::nlerp(posture.rotation(&b.parent), own, b.share) };
            q * *n
        };
        self.bark.iter().zip(normals).map(one).collect()
    }
}

/// Organs of a plant and where they hang.
#[derive(Debug, Clone)]
pub struct OrganBindings(Vec<(SegmentAttachment, Quat)>);

impl OrganBindings {
    /// Of some organs.
    pub fn new(plant: &Plant, organs: &[&Organ]) -> Self {
        let hang = |o: &&Organ| {
            let (p, q) = plant.organ_site(o);
            (attach(plant, o.axis, o.s, p), q)
        };
        Self(organs.iter().map(hang).collect())
    }

    /// Places, m, and rotations in a posture.
    pub fn at(&self, posture: &PosedSkeleton) -> (Vec<Vec3>, Vec<Quat>) {
        self.0.iter().map(|(h, q)| (posture.position(h), (posture.rotation(h) * *q).normalize())).unzip()
    }
}

impl PosedSkeleton {
    /// Places of the nodes, m.
    #[cfg(test)]
    pub(crate) fn places(&self) -> &[Vec3] {
        &self.p
    }

    fn rotation(&self, h: &SegmentAttachment) -> Quat {
        let k = h.node as usize;
        math::nlerp(self.q[k], self.q[k + 1], h.t)
    }

    fn position(&self, h: &SegmentAttachment) -> Vec3 {
        let k = h.node as usize;
        self.p[k].lerp(self.p[k + 1], h.t) + self.rotation(h) * h.arm
    }

    fn bound_position(&self, b: &BoundPoint) -> Vec3 {
        let own = self.position(&b.own);
        if b.share >= 1.0 { own } else { self.position(&b.parent).lerp(own, b.share) }
    }
}

fn attach(plant: &Plant, axis: u32, s: f32, point: Vec3) -> SegmentAttachment {
    let (k, t) = plant.segment(&plant.axes[axis as usize], s);
    let center = plant.nodes.p[k].lerp(plant.nodes.p[k + 1], t);
    SegmentAttachment { node: u32::try_from(k).unwrap_or(NONE), t, arm: point - center }
}

/// How much a point at arc length `s` follows its own axis; the rest of it follows the parent.
pub(crate) fn own_share(plant: &Plant, axis: u32, s: f32) -> f32 {
    let a = &plant.axes[axis as usize];
    if a.parent == NONE {
        return 1.0;
    }
    let collar = a.s_exposed + COLLAR_RADII * plant.nodes.r[a.first as usize];
    math::smoothstep(a.s_exposed * 0.5, collar, s)
}

fn bind(plant: &Plant, axis: u32, s: f32, point: Vec3) -> BoundPoint {
    let own = attach(plant, axis, s, point);
    let a = &plant.axes[axis as usize];
    let share = own_share(plant, axis, s);
    let parent = if share < 1.0 { attach(plant, a.parent, a.parent_s, point) } else { own };
    BoundPoint { own, parent, share }
}
