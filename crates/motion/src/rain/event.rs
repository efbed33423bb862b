//! Events: what happened to single drops, in the order in which it happened.

use glam::DVec3;

use osier_scene::DropEventKind;

/// Something that happened to a drop, in the simulation's own identifiers and precision; `osier_scene::DropEvent` is its form in
/// a frame, with drops renumbered over the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RainEvent {
    /// What happened.
    pub what: DropEventKind,
    /// Time since the simulation began, s.
    pub t: f64,
    /// Identifier of the drop; stable over frames, threads and time steps.
    pub id: u64,
    /// Identifier of the second drop of a merge, splash, bead or partial detachment.
    pub other: Option<u64>,
    /// Index of the leaf that the drop is on.
    pub leaf: Option<usize>,
    /// World position, m.
    pub p: DVec3,
    /// Volume of the drop after the event, m^3.
    pub volume: f64,
    /// Magnitude of the impulse on the leaf, N s; 0 except for impacts.
    pub blow: f64,
}

impl RainEvent {
    /// An event at time `t`, s, and world position `p`, m, with neither second drop, leaf nor impulse.
    pub fn new(what: DropEventKind, id: u64, t: f64, p: DVec3, volume: f64) -> Self {
        Self { what, t, id, other: None, leaf: None, p, volume, blow: 0.0 }
    }
}
