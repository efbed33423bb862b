//! Grids on which a scene samples its wind.

use glam::{DVec3, Vec3};

/// A grid of cubic cells; frames hold the velocity of the air at the cell centres. One layer of cells for a plane, many for a
/// box.
#[derive(Debug, Clone, PartialEq)]
pub struct AirGrid {
    /// File name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// Number of cells along x, y and z; 1 along the normal of a plane.
    pub cells: [usize; 3],
    /// Corner of least coordinates in the world, m; along the normal of a plane, the plane's coordinate.
    pub corner: DVec3,
    /// Edge length of a cubic cell, m.
    pub side: f64,
    /// Axis normal to a plane: 0, 1, 2 for x, y, z; `None` for a box.
    pub across: Option<usize>,
    /// Number of frames from one sample to the next; the first frame of the clip is sampled. 0 counts as 1.
    pub every: u32,
}

impl AirGrid {
    /// Number of cells: the length of a list of velocities in [`crate::Frame::air`].
    pub fn count(&self) -> u64 {
        self.cells.iter().map(|n| *n as u64).fold(1, u64::saturating_mul)
    }

    /// True if the frame `since` frames after the first of the clip has velocities for this grid.
    pub fn is_due(&self, since: u32) -> bool {
        since.is_multiple_of(self.every.max(1))
    }

    /// Cell centres in the world, m, x fastest, then y, then z: the order of a frame's velocities.
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
