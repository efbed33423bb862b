//! Where a scene tells its wind.

use glam::{DVec3, Vec3};

/// Cells in whose middles frames tell the velocity of the air: one layer for a plane, many for a whole box.
#[derive(Debug, Clone, PartialEq)]
pub struct AirGrid {
    /// File name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// Cells along x, y and z; 1 across a plane.
    pub cells: [usize; 3],
    /// Lowest corner, m; across a plane it is where the plane lies.
    pub corner: DVec3,
    /// Edge length of a cubic cell, m.
    pub side: f64,
    /// Axis that a plane is across; none for a box.
    pub across: Option<usize>,
    /// Frames between two that are told, from the first of the clip.
    pub every: u32,
}

impl AirGrid {
    /// Number of cells, which is the length of a frame's list of velocities.
    pub fn count(&self) -> u64 {
        self.cells.iter().map(|n| *n as u64).fold(1, u64::saturating_mul)
    }

    /// Whether it is told `since` frames after the first.
    pub fn is_due(&self, since: u32) -> bool {
        since.is_multiple_of(self.every.max(1))
    }

    /// Middles of the cells, m, x fastest, then y, then z.
    pub fn places(&self) -> Vec<Vec3> {
        let middle = |axis: usize, k: usize| {
            let away = if self.across == Some(axis) { 0.0 } else { (k as f64 + 0.5) * self.side };
            self.corner[axis] + away
        };
        let [nx, ny, nz] = self.cells;
        let row =
            |y: usize, z: usize| (0..nx).map(move |x| DVec3::new(middle(0, x), middle(1, y), middle(2, z)).as_vec3());
        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| row(y, z))).collect()
    }
}
