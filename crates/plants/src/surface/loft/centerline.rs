//! The centreline of an axis as a polyline with radii.

use glam::Vec3;

/// A point of a centreline.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePoint {
    /// Position, m.
    pub p: Vec3,
    /// Radius, m.
    pub r: f32,
    /// Arc length on the axis, m.
    pub s: f32,
}
