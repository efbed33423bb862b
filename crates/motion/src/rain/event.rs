//! What happens to drops, one by one.

use glam::DVec3;

use osier_scene::DropEventKind;

/// Something that happened to a drop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RainEvent {
    /// What; `blow` tells how hard it struck.
    pub what: DropEventKind,
    /// When, s.
    pub t: f64,
    /// The drop, by birth.
    pub id: u64,
    /// The other one, if there is one.
    pub other: Option<u64>,
    /// The leaf, if it is on one.
    pub leaf: Option<usize>,
    /// Where, in the world, m.
    pub p: DVec3,
    /// Its volume from then on, m^3.
    pub volume: f64,
    /// The blow on the leaf, N s.
    pub blow: f64,
}

impl RainEvent {
    /// One with neither other drop, leaf nor blow.
    pub fn of(what: DropEventKind, id: u64, (t, p): (f64, DVec3), volume: f64) -> Self {
        Self { what, t, id, other: None, leaf: None, p, volume, blow: 0.0 }
    }
}
