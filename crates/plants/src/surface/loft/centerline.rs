//! The centreline of an axis as a polyline with radii.

use glam::Vec3;

/// A point of the polyline from which the rings of an axis are made.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePoint {
    /// Position in plant space, m.
    pub p: Vec3,
    /// Radius of the tube there, m, > 0.
    pub r: f32,
    /// Arc length on the axis, m.
    pub s: f32,
}
