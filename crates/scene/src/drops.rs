//! Raindrops as numbers, for programs that make something of their own from them.

use glam::{Quat, Vec3};

/// What a drop does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropState {
    /// It falls.
    Falls,
    /// It lies on a leaf.
    Rests,
    /// It moves over a leaf, faster than 1 mm/s.
    Runs,
    /// It hangs at a leaf's margin.
    Hangs,
    /// It is a cap of the tail of the drop before it in the list, with a share of that one's water.
    Tail,
}

impl DropState {
    /// All, in the order of their numbers, with the words for them.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Falls, "falls"),
        (Self::Rests, "rests"),
        (Self::Runs, "runs"),
        (Self::Hangs, "hangs"),
        (Self::Tail, "tail"),
    ];
}

/// A drop at a frame. Places and directions in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropNow {
    /// Its number, the same at all frames: counted from 0 as drops are first seen in the clip.
    pub id: u32,
    /// What it does.
    pub state: DropState,
    /// The leaf that it is on, counted from 0 over all plants in the order of their places.
    pub leaf: Option<u32>,
    /// Caps of its tail that follow it in the list.
    pub tail: u32,
    /// Where on the leaf, texture coordinates; 0 in the air.
    pub uv: [f32; 2],
    /// Side of the leaf: 1 the upper one, -1 the lower one; 0 in the air and at the margin.
    pub side: f32,
    /// Middle, m: of the base on the leaf, of the circle that it hangs from, of the drop in the air.
    pub place: Vec3,
    /// m^3: of a head without its tail.
    pub volume: f64,
    /// m/s, the leaf's own motion in it.
    pub velocity: Vec3,
    /// Radius, m: of the base, of the circle that it hangs from, of the drop in the air.
    pub a: f32,
    /// Height over the leaf in its middle, m; 0 where it does not lie.
    pub height: f32,
    /// How much longer than round its footprint is, 1 or more.
    pub q: f32,
    /// How far it leans along its axis, 0 and more.
    pub s: f32,
    /// Long axis of its footprint, or where it hangs to; unit, 0 in the air.
    pub axis: Vec3,
    /// How far what hangs has thinned, 0 to 1, when it falls.
    pub thin: f32,
}

/// What can happen to a drop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropEventKind {
    /// It came to be: from the sky, by a splash of `other`, or put there.
    Born,
    /// It struck a leaf.
    Struck,
    /// It swallowed `other`.
    Merged,
    /// The tail of `other` left it behind.
    Bead,
    /// It came to hang.
    Hung,
    /// It left its leaf; with `other`, from that, which hangs on.
    Fell,
    /// It ended on the ground, or below everything.
    Ground,
    /// It ended on wood.
    Wood,
    /// It came to the margin of its leaf, along which it goes on.
    Edge,
}

impl DropEventKind {
    /// All, in the order of their numbers, with the words for them.
    pub const ALL: [(Self, &'static str); 9] = [
        (Self::Born, "born"),
        (Self::Struck, "struck"),
        (Self::Merged, "merged"),
        (Self::Bead, "bead"),
        (Self::Hung, "hung"),
        (Self::Fell, "fell"),
        (Self::Ground, "ground"),
        (Self::Wood, "wood"),
        (Self::Edge, "edge"),
    ];
}

/// Something that happened to a drop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DropEvent {
    /// What.
    pub what: DropEventKind,
    /// When, s from the first frame.
    pub t: f64,
    /// The drop's number, as [`DropNow::id`].
    pub id: u32,
    /// That of the other one, if there is one.
    pub other: Option<u32>,
    /// The leaf, as [`DropNow::leaf`].
    pub leaf: Option<u32>,
    /// Where, m.
    pub place: Vec3,
    /// Its volume from then on, m^3.
    pub volume: f64,
    /// Blow on the leaf, N s.
    pub blow: f32,
}

/// A leaf in the rain at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafNow {
    /// Drops that lie, run or hang on it.
    pub drops: u32,
    /// Their water, m^3.
    pub volume: f64,
    /// Share of it that is wet, by how much.
    pub wetness: f32,
    /// Its pivot in the world, m.
    pub place: Vec3,
    /// World from leaf space.
    pub turn: Quat,
}

/// All drops at a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Drops {
    /// On leaves, at margins, in the air; a head's tail right behind it.
    pub now: Vec<DropNow>,
    /// What happened since the frame before, in order of time steps.
    pub events: Vec<DropEvent>,
    /// All leaves, as [`DropNow::leaf`] counts them.
    pub leaves: Vec<LeafNow>,
}
