//! Poses from bends without a joint budget: centrelines, bark points and organs.

use glam::{Quat, Vec3};

use super::elements::{BeamElements, BoundLocation, ElementLocation};
use crate::sway::tuning::{COLLAR_RADII, MAX_LEAF_OFFSET, POINTS_PER_TASK};
use osier_base::convert::saturating_index;
use osier_base::math;
use osier_base::par::par_chunks;
use osier_scene::plant::{NONE, Organ, Plant};

/// Posed centrelines: position, m, and rotation from rest of each node.
#[derive(Debug, Clone, Default)]
pub struct PosedSkeleton {
    p: Vec<Vec3>,
    q: Vec<Quat>,
}

/// A point attached to a segment between two nodes.
#[derive(Debug, Clone, Copy)]
struct SegmentAttachment {
    /// First node of the segment.
    node: u32,
    /// Place on the segment, 0 at its first node to 1.
    t: f32,
    /// Vector from the centreline to the point at rest, m.
    arm: Vec3,
}

/// A bark point attached to its axis and, near a fork, to the parent axis.
#[derive(Debug, Clone, Copy)]
struct BoundPoint {
    own: SegmentAttachment,
    parent: SegmentAttachment,
    /// Weight of the attachment to its axis, 0 to 1; the rest is the weight of the parent axis.
    share: f32,
}

/// Binding of a plant's nodes and bark points to bending elements.
#[derive(Debug, Clone)]
pub struct PointBinding {
    /// Per node: its location, and that of the middle of the segment that begins there.
    nodes: Vec<[BoundLocation; 2]>,
    /// Per axis: range of nodes, and the attachment of its base to the parent axis.
    axes: Vec<(std::ops::Range<usize>, Option<SegmentAttachment>)>,
    rest: Vec<Vec3>,
    bark: Vec<BoundPoint>,
}

impl PointBinding {
    /// `bark`: axis and arc length, m, of each of `points`, the bark at rest.
    pub fn new(plant: &Plant, elements: &BeamElements, points: &[Vec3], bark: &[(u32, f32)]) -> Self {
        let still = elements.bind(ElementLocation { element: NONE, at: 0.0 });
        let mut nodes = vec![[still; 2]; plant.nodes.len()];
        let mut axes = Vec::with_capacity(plant.axes.len());
        for (index, axis) in (0_u32..).zip(&plant.axes) {
            let range = plant.nodes_of(axis);
            for k in range.clone() {
                let s = plant.nodes.s[k];
                let next = if k + 1 < range.end { plant.nodes.s[k + 1] } else { s };
                nodes[k] = [s, (s + next) * 0.5].map(|s| elements.bind(elements.locate(index, s)));
            }
            let attachment = (axis.parent != NONE)
                .then(|| attach_to_segment(plant, axis.parent, axis.parent_s, plant.nodes.p[range.start]));
            axes.push((range, attachment));
        }
        let bind = |((axis, s), p): (&(u32, f32), &Vec3)| bind_point(plant, *axis, *s, *p);
        Self { nodes, axes, rest: plant.nodes.p.clone(), bark: bark.iter().zip(points).map(bind).collect() }
    }

    /// Poses the centrelines. `bends`: both angles of each element, rad, then those of second modes.
    pub fn pose(&self, elements: &BeamElements, bends: &[[f32; 2]]) -> PosedSkeleton {
        let bases = elements.base_rotations(bends);
        let turned = |s: BoundLocation| elements.rotation_at(&bases, bends, s);
        let mut skeleton = PosedSkeleton { p: self.rest.clone(), q: vec![Quat::IDENTITY; self.rest.len()] };
        for (range, stem) in &self.axes {
            // The base of the axis moves with its parent.
            if let Some(stem) = stem {
                skeleton.p[range.start] = skeleton.position(stem);
            }
            for k in range.clone() {
                // Each segment rotates as its middle does, so that it keeps its length; nodes get the rotation at their
                // position.
                let [at, middle] = self.nodes[k];
                skeleton.q[k] = turned(at);
                if k + 1 < range.end {
                    // On rigid axes both locations coincide: one rotation serves both.
                    let q = if at == middle { skeleton.q[k] } else { turned(middle) };
                    skeleton.p[k + 1] = skeleton.p[k] + q * (self.rest[k + 1] - self.rest[k]);
                }
            }
        }
        skeleton
    }

    /// Positions of the bark points in the plant's space, m, in the order in which they were bound.
    pub fn bark(&self, skeleton: &PosedSkeleton) -> Vec<Vec3> {
        par_chunks(&self.bark, POINTS_PER_TASK, |_, part| {
            part.iter().map(|b| skeleton.bound_position(b)).collect::<Vec<_>>()
        })
        .concat()
    }

    /// Normals of the bark on a posed skeleton. `normals`: normals at rest, one per point.
    pub fn normals(&self, skeleton: &PosedSkeleton, normals: &[Vec3]) -> Vec<Vec3> {
        let one = |(b, n): (&BoundPoint, &Vec3)| {
            let own = skeleton.rotation(&b.own);
            let q = if b.share >= 1.0 { own } else { math::nlerp(skeleton.rotation(&b.parent), own, b.share) };
            q * *n
        };
        self.bark.iter().zip(normals).map(one).collect()
    }
}

/// Attachment and rest orientation of organs, in the order in which they were given.
#[derive(Debug, Clone)]
pub struct OrganBindings(Vec<(SegmentAttachment, Quat)>);

impl OrganBindings {
    /// Binds organs to the centrelines, each at its arc length on its axis.
    pub fn new(plant: &Plant, organs: &[&Organ]) -> Self {
        let hang = |o: &&Organ| {
            let (p, q) = plant.organ_site(o);
            (attach_to_segment(plant, o.axis, o.s, p), q)
        };
        Self(organs.iter().map(hang).collect())
    }

    /// Positions, m, and orientations of the organs on a posed skeleton.
    pub fn at(&self, skeleton: &PosedSkeleton) -> (Vec<Vec3>, Vec<Quat>) {
        self.0.iter().map(|(h, q)| (skeleton.position(h), (skeleton.rotation(h) * *q).normalize())).unzip()
    }

    /// Moves organs from `positions`, m, to which joints carry them, towards their places on the posed skeleton, by less than
    /// `MAX_LEAF_OFFSET`, so that a leaf of a twig without joints sways and stays at its twig. Returns their orientations on the
    /// posed skeleton.
    pub fn approach(&self, skeleton: &PosedSkeleton, positions: &mut [Vec3]) -> Vec<Quat> {
        let (places, orientations) = self.at(skeleton);
        for (carried, place) in positions.iter_mut().zip(places) {
            let offset = place - *carried;
            let distance = offset.length();
            if distance > 1e-9 {
                *carried += offset * (MAX_LEAF_OFFSET / distance * math::tanh_f32(distance / MAX_LEAF_OFFSET));
            }
        }
        orientations
    }
}

impl PosedSkeleton {
    /// Positions of the nodes in the plant's space, m, in the order of [`Plant::nodes`].
    pub fn positions(&self) -> &[Vec3] {
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

fn attach_to_segment(plant: &Plant, axis: u32, s: f32, point: Vec3) -> SegmentAttachment {
    let (k, t) = plant.segment(&plant.axes[axis as usize], s);
    // Store the offset from the centreline, which rotates with the segment.
    let center = plant.nodes.p[k].lerp(plant.nodes.p[k + 1], t);
    // Axes store the indices of their nodes as u32 (`Axis::first`), so that every node has one.
    SegmentAttachment { node: saturating_index(k), t, arm: point - center }
}

/// Weight, 0 to 1, with which a point at arc length `s`, m, follows its axis; with the rest it follows the parent axis.
pub(crate) fn own_share(plant: &Plant, axis: u32, s: f32) -> f32 {
    let a = &plant.axes[axis as usize];
    if a.parent == NONE {
        return 1.0;
    }
    // Smooth transition over the collar, so that the bark does not tear at forks.
    let collar = a.s_exposed + COLLAR_RADII * plant.nodes.r[a.first as usize];
    math::smoothstep(a.s_exposed * 0.5, collar, s)
}

fn bind_point(plant: &Plant, axis: u32, s: f32, point: Vec3) -> BoundPoint {
    let own = attach_to_segment(plant, axis, s, point);
    let a = &plant.axes[axis as usize];
    let share = own_share(plant, axis, s);
    let parent = if share < 1.0 { attach_to_segment(plant, a.parent, a.parent_s, point) } else { own };
    BoundPoint { own, parent, share }
}
