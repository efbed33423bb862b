//! Events of single drops: emission, impact, merger, detachment and the like, in the order in which they occur.

use glam::DVec3;

use osier_scene::DropEventKind;

/// An event of a drop, in the simulation's own identifiers and precision; `osier_scene::DropEvent` is its form in a frame, with
/// drops renumbered over the clip.
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
