//! The common skeleton of everything that grows: axes of nodes, organs at sites, stable ids.
//!
//! The turtle, IFS trees and imported meshes all end in a [`Plant`]; skinning, motion and export start from one. Space:
//! metres, +Y up; angles in radians.
//!
//! ```
//! use glam::{Quat, Vec3};
//! use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Nodes, Plant, validate};
//!
//! let trunk = Axis {
//!     id: 1, parent: NONE, parent_s: 0.0, order: 0, kind: AxisKind::Stem, first: 0, count: 2, length: 2.0,
//!     s_exposed: 0.0, material: 0, fork: NONE, end: AxisEnd::Tip, birth: 0.0,
//! };
//! let nodes = Nodes {
//!     p: vec![Vec3::ZERO, Vec3::Y * 2.0], q: vec![Quat::IDENTITY; 2], r: vec![0.1, 0.05], s: vec![0.0, 2.0],
//!     birth: vec![0.0, 1.0], color: vec![0; 2],
//! };
//! let mut plant = Plant { axes: vec![trunk], nodes, materials: vec!["bark".into()], ..Plant::default() };
//! assert!(validate(&mut plant)?.is_empty());
//! assert_eq!(plant.frame(&plant.axes[0], 1.0).p, Vec3::Y);
//! # Ok::<(), osier_base::Error>(())
//! ```

mod validate;

use std::sync::Arc;

use glam::{Quat, Vec3};

use crate::{Attribute, Mesh};

pub use validate::{MAX_ITEMS, Warning, validate};

/// Stands for no axis in [`Axis::parent`] and for no fork in [`Axis::fork`].
pub const NONE: u32 = u32::MAX;

/// Bit of [`Nodes::color`]. If it is set, the segment that ends at the node has the colour index in the low byte; otherwise
/// it has the material of its axis.
pub const PAINTED: u16 = 0x100;

/// Part of the plant that an axis is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisKind {
    /// Trunk, branch, twig.
    Stem,
    /// An axis below the ground.
    Root,
    /// Stalk of a leaf, between its axis and the blade.
    Petiole,
    /// Blade of grass, drawn as a strip along the axis; the radii of its nodes are half of its width.
    Blade,
}

/// Why an axis ends where it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisEnd {
    /// It ends at a grown tip, without a cut face.
    Tip,
    /// Cut off: ends with a flat disc of wood.
    Cut,
    /// It ran into an obstacle of its growth.
    Obstacle,
    /// It died for lack of light.
    Shade,
    /// Its growth stopped, as no step was possible.
    Stalled,
}

/// A chain of nodes from attachment to tip.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Identifier that stays the same when other axes of the plant change.
    pub id: u64,
    /// Index of the parent axis, or [`NONE`].
    pub parent: u32,
    /// Arc length on the parent's centreline where node 0 lies, m.
    pub parent_s: f32,
    /// 0 for the trunk, the parent's + 1 for a child (equal for halves of an apical fork).
    pub order: u8,
    /// Part of the plant that it is; decides for instance whether it is a tube or a strip.
    pub kind: AxisKind,
    /// Index of node 0 in [`Nodes`].
    pub first: u32,
    /// Number of nodes, at least 2.
    pub count: u32,
    /// Arc length of the last node, m.
    pub length: f32,
    /// Arc length where the axis leaves its parent's bark, m.
    pub s_exposed: f32,
    /// Index into [`Plant::materials`].
    pub material: u16,
    /// Number shared by the halves of an apical fork, or [`NONE`].
    pub fork: u32,
    /// Why it ends, which decides how its tip is shaped.
    pub end: AxisEnd,
    /// Growth time at its first node, 0..1.
    pub birth: f32,
}

/// Nodes of all axes, structure of arrays.
#[derive(Debug, Clone, Default)]
pub struct Nodes {
    /// Positions of the nodes in plant space, m.
    pub p: Vec<Vec3>,
    /// Frame: +Y along the growth tangent, +X the roll reference, +Z = X x Y; includes twist.
    pub q: Vec<Quat>,
    /// Radii of the wood at the nodes, m, above 0.
    pub r: Vec<f32>,
    /// Arc length from the axis' first node, m.
    pub s: Vec<f32>,
    /// Growth time of each node, from 0 for the oldest to 1 for the youngest.
    pub birth: Vec<f32>,
    /// Turtle colour (see [`PAINTED`]) or map index.
    pub color: Vec<u16>,
}

impl Nodes {
    /// Number of nodes of all axes.
    #[inline]
    pub fn len(&self) -> usize {
        self.p.len()
    }

    /// True without nodes; a valid plant then has no axes either.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.p.is_empty()
    }
}

/// A leaf, flower, fruit, catkin or bud.
#[derive(Debug, Clone)]
pub struct Organ {
    /// Identifier that stays the same when other organs of the plant change.
    pub id: u64,
    /// Index into [`Plant::axes`] of the axis that it grows on.
    pub axis: u32,
    /// Arc length on the axis at which it grows, m.
    pub s: f32,
    /// Vector from the centreline to the attachment point, in the axis frame at `s`, m.
    pub offset: Vec3,
    /// Rotation relative to the axis frame at `s`. Organ space: +Y along the midrib, +Z upper side.
    pub q: Quat,
    /// Uniform size factor on the prototype.
    pub scale: f32,
    /// Index into [`Plant::protos`].
    pub proto: u16,
    /// Distance from the offset point to the organ's pivot, m.
    pub petiole: f32,
    /// Random number in [0, 1] by which colours vary.
    pub tint: f32,
    /// Growth time, from 0 for the oldest part to 1 for the youngest.
    pub birth: f32,
}

/// The mesh of an organ, in organ space, metres; its subsets name [`Plant::materials`].
#[derive(Debug, Clone)]
pub struct Proto {
    /// Name, `[a-z0-9_]+`, unique in the plant.
    pub name: String,
    /// Pivot (petiole base) at the origin, +Y midrib, +Z upper side.
    pub mesh: Arc<Mesh>,
}

/// Position, orientation and thickness of an axis at one arc length, from [`Plant::frame`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Point of the centreline in plant space, m.
    pub p: Vec3,
    /// Axis frame: +Y along the tangent, +X the roll reference.
    pub q: Quat,
    /// Radius of the axis there, m.
    pub r: f32,
}

/// A fully resolved plant. Array order is canonical: axes depth first, siblings by (parent_s, ordinal), nodes contiguous
/// by s, organs by (axis, s, ordinal).
#[derive(Debug, Clone, Default)]
pub struct Plant {
    /// Number of the plant in the ids of its axes and organs; independent of the seed.
    pub id: u32,
    /// Seed of the random draws of growth.
    pub seed: u64,
    /// All axes, parents before their children.
    pub axes: Vec<Axis>,
    /// Nodes of all axes; an axis holds a contiguous range.
    pub nodes: Nodes,
    /// All organs, sorted by axis and arc length.
    pub organs: Vec<Organ>,
    /// Further values of the organs, one for each, which instancers pass on to files.
    pub organ_attributes: Vec<Attribute>,
    /// Meshes that organs show, named by index.
    pub protos: Vec<Proto>,
    /// Names of materials that axes and organs refer to by index.
    pub materials: Vec<String>,
    /// Name of the file or tool that made the plant, for people: "oak.l", ...
    pub source: String,
    /// True if the axes are the lines of a drawing: their mesh then neither widens at the foot nor extends into the ground.
    pub lines: bool,
}

impl Plant {
    /// Indices of the nodes of an axis in the lists of [`Plant::nodes`], from base to tip.
    #[inline]
    pub fn nodes_of(&self, axis: &Axis) -> std::ops::Range<usize> {
        let first = axis.first as usize;
        first..first + axis.count as usize
    }

    /// The segment of an axis that contains arc length `s` (clamped): index of its first node in [`Plant::nodes`], and the
    /// fraction of the segment up to `s`, 0 to 1.
    #[inline]
    pub fn segment(&self, axis: &Axis, s: f32) -> (usize, f32) {
        let range = self.nodes_of(axis);
        let arcs = &self.nodes.s[range.clone()];
        // The last node at or before `s`, but never the last of the axis, which begins no segment.
        let i = range.start + arcs.partition_point(|&v| v <= s).clamp(1, arcs.len() - 1) - 1;
        let span = self.nodes.s[i + 1] - self.nodes.s[i];
        (i, if span > 0.0 { ((s - self.nodes.s[i]) / span).clamp(0.0, 1.0) } else { 0.0 })
    }

    /// The centreline of an axis at arc length `s` (clamped): p and r linear, q by normalised lerp on the shorter arc.
    #[inline]
    pub fn frame(&self, axis: &Axis, s: f32) -> Site {
        let (i, t) = self.segment(axis, s);
        let j = i + 1;
        Site {
            p: self.nodes.p[i].lerp(self.nodes.p[j], t),
            q: osier_base::math::nlerp(self.nodes.q[i], self.nodes.q[j], t),
            r: osier_base::math::lerp(self.nodes.r[i], self.nodes.r[j], t),
        }
    }

    /// The radius of an axis at arc length `s` (clamped), as [`Self::frame`] has it.
    #[inline]
    pub fn radius(&self, axis: &Axis, s: f32) -> f32 {
        let (i, t) = self.segment(axis, s);
        osier_base::math::lerp(self.nodes.r[i], self.nodes.r[i + 1], t)
    }

    /// The values of [`Self::organ_attributes`] for some of its organs, found by id, in the order of `organs`.
    pub fn organ_values(&self, organs: &[&Organ]) -> Vec<Attribute> {
        if self.organ_attributes.is_empty() {
            return Vec::new();
        }
        let numbers: std::collections::BTreeMap<u64, u32> = self.organs.iter().map(|o| o.id).zip(0..).collect();
        let indices: Vec<u32> = organs.iter().filter_map(|o| numbers.get(&o.id).copied()).collect();
        self.organ_attributes.iter().map(|a| Attribute { data: a.data.gather(&indices), ..*a }).collect()
    }

    /// Pivot and rotation of an organ in plant space.
    #[inline]
    pub fn organ_site(&self, organ: &Organ) -> (Vec3, Quat) {
        let site = self.frame(&self.axes[organ.axis as usize], organ.s);
        let q = (site.q * organ.q).normalize();
        // The offset is in the frame of the axis; the petiole points along the organ's own +Y.
        (site.p + site.q * organ.offset + q * (Vec3::Y * organ.petiole), q)
    }
}
