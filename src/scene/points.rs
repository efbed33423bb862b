//! Point clouds and curves.

use glam::Vec3;

use super::MaterialId;

/// A point cloud of fixed capacity; a width of 0 hides a point.
#[derive(Debug, Clone)]
pub struct Points {
    /// Prim and node name, `[a-z0-9_]+`, unique in the asset.
    pub name: String,
    /// Surface.
    pub material: MaterialId,
    /// Positions, m.
    pub positions: Vec<Vec3>,
    /// Diameters, m, one per point.
    pub widths: Vec<f32>,
    /// Linear RGB, one per point, or empty.
    pub colors: Vec<[f32; 3]>,
    /// True if frames carry positions and widths.
    pub moving: bool,
}

/// Polylines with thickness.
#[derive(Debug, Clone)]
pub struct Curves {
    /// Prim and node name, `[a-z0-9_]+`, unique in the asset.
    pub name: String,
    /// Surface.
    pub material: MaterialId,
    /// Points per curve, each at least 2.
    pub counts: Vec<u32>,
    /// All points, m, curve after curve.
    pub points: Vec<Vec3>,
    /// Diameters, m, one per point.
    pub widths: Vec<f32>,
    /// True if frames carry points.
    pub moving: bool,
}
