//! Events of single drops: emission, impact, merger, detachment and the like, in the order in which they occur.

use glam::DVec3;

/// What happened to the drop `id` of a [`RainEvent`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropEventKind {
    /// It began to exist: emitted from the sky, splashed off `other`, or placed on a leaf.
    Born,
    /// It struck a leaf; `impulse` is the impulse on it.
    Struck,
    /// It absorbed `other`.
    Merged,
    /// The tail of `other` left it behind on the leaf.
    Bead,
    /// It became pendant at a margin.
    Hung,
    /// It detached from its leaf; `other` is the pendant drop of which it was a part, if that stays.
    Fell,
    /// It ended on the ground, or below the scene.
    Ground,
    /// It struck wood, which absorbed it.
    Wood,
    /// It reached the margin of its leaf and moves on along it.
    Edge,
    /// It ended on a solid: a wall, a roof or a mesh.
    Solid,
}

impl DropEventKind {
    /// All kinds in the order of their numbers, each with its word in record tables.
    pub const ALL: [(Self, &'static str); 10] = [
        (Self::Born, "born"),
        (Self::Struck, "struck"),
        (Self::Merged, "merged"),
        (Self::Bead, "bead"),
        (Self::Hung, "hung"),
        (Self::Fell, "fell"),
        (Self::Ground, "ground"),
        (Self::Wood, "wood"),
        (Self::Edge, "edge"),
        (Self::Solid, "solid"),
    ];
}

/// An event of a single drop, in the identifiers and the precision of the simulation. Record tables of frames renumber the
/// drops over the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RainEvent {
    /// Kind of the event, such as emission, impact or merger.
    pub kind: DropEventKind,
    /// Time since the simulation began, s.
    pub t: f64,
    /// Identifier of the drop; stable over frames, threads and time steps.
    pub id: u64,
    /// Identifier of the second drop of a merger, splash, bead or partial detachment.
    pub other: Option<u64>,
    /// Index of the leaf that the drop is on; `None` in the air, on wood, ground and solids.
    pub leaf: Option<usize>,
    /// Position in the world, m.
    pub p: DVec3,
    /// Volume of the drop after the event, m^3.
    pub volume: f64,
    /// Magnitude of the impulse on the leaf, N s; 0 except for impacts.
    pub impulse: f64,
}

impl RainEvent {
    /// An event at time `t`, s, and world position `p`, m, with neither second drop, leaf nor impulse.
    pub fn new(kind: DropEventKind, id: u64, t: f64, p: DVec3, volume: f64) -> Self {
        Self { kind, t, id, other: None, leaf: None, p, volume, impulse: 0.0 }
    }
}
