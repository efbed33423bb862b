//! What happens to drops, one by one.

use glam::DVec3;

/// Kinds of [`Event`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Happened {
    /// A drop came to be: from the sky, by a splash, or put there.
    Born,
    /// It struck a leaf and lies there; `blow` tells how hard.
    Struck,
    /// It swallowed `other`.
    Merged,
    /// The tail of `other` left it behind.
    Bead,
    /// It came to hang at a margin.
    Hung,
    /// It left its leaf; with `other`, which hangs on, it is what fell from that.
    Fell,
    /// It ended on the ground, or below everything.
    Ground,
    /// It ended on wood.
    Wood,
}

/// Something that happened to a drop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// What.
    pub what: Happened,
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

impl Event {
    /// One with neither other drop, leaf nor blow.
    pub fn of(what: Happened, id: u64, (t, p): (f64, DVec3), volume: f64) -> Self {
        Self { what, t, id, other: None, leaf: None, p, volume, blow: 0.0 }
    }
}
