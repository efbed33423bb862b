//! Events of single drops: emission, impact, merger, detachment and the like, in the order in which they occur.

use glam::DVec3;

/// What can happen to a drop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropEventKind {
    /// It came to be: from the sky, by a splash of `other`, or put there.
    Born,
    /// A drop struck a leaf.
    Struck,
    /// It swallowed `other`.
    Merged,
    /// The tail of `other` left it behind.
    Bead,
    /// A drop began to hang at a margin.
    Hung,
    /// It left its leaf; with `other`, from that, which hangs on.
    Fell,
    /// It ended on the ground, or below everything.
    Ground,
    /// A drop was absorbed by wood.
    Wood,
    /// It came to the margin of its leaf, along which it goes on.
    Edge,
    /// It ended on a solid: a wall, a roof or a mesh.
    Solid,
}

impl DropEventKind {
    /// All, in the order of their numbers, with the words for them.
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

/// Something that happened to a drop, in the simulation's own identifiers and precision. Record tables of frames renumber the
/// drops over the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RainEvent {
    /// What happened: emission, impact, merger, detachment and so on.
    pub kind: DropEventKind,
    /// Time since the simulation began, s.
    pub t: f64,
    /// Identifier of the drop; stable over frames, threads and time steps.
    pub id: u64,
    /// Identifier of the second drop of a merger, splash, bead or partial detachment.
    pub other: Option<u64>,
    /// Index of the leaf that the drop is on.
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
