//! Sparse voxel grids that frames fill: densities and velocities in space.

use glam::{DVec3, Vec3};

/// A grid of cubic cells aligned with the axes, without bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeGrid {
    /// File stem, `[a-z0-9_]+`: the grids of one file are written together.
    pub file: &'static str,
    /// Name in the file, `[a-z0-9_]+`, unique in it.
    pub name: &'static str,
    /// Unit of the values as files spell it, such as `1/m^3`.
    pub unit: &'static str,
    /// Whether frames give [`VolumeValues::Vector`] instead of numbers.
    pub is_vector: bool,
    /// Centre of the cell (0, 0, 0) in the world, m.
    pub origin: DVec3,
    /// Edge length of a cell, m.
    pub cell: f64,
    /// Frames from one that fills the grid to the next, counted from the first of the clip; 0 counts as 1.
    pub every: u32,
    /// Upper bound on the cells that a frame fills, from which memory and output are predicted.
    pub max_cells: u64,
}

impl VolumeGrid {
    /// True if the frame `since` frames after the first of the clip fills the grid.
    pub fn is_due(&self, since: u32) -> bool {
        since.is_multiple_of(self.every.max(1))
    }

    /// Indices of the cell that contains a point of the world, m; saturated at 2^31 cells from the origin.
    #[allow(clippy::cast_possible_truncation, reason = "saturates 2^31 cells from the origin")]
    pub fn cell_of(&self, point: DVec3) -> [i32; 3] {
        ((point - self.origin) / self.cell + 0.5).floor().to_array().map(|v| v as i32)
    }
}

/// Which cells a frame gives values for.
#[derive(Debug, Clone, PartialEq)]
pub enum VolumeCells {
    /// A box of cells from (0, 0, 0) on: number along x, y and z. Values are in the order x fastest, then y, then z.
    Box([usize; 3]),
    /// These cells, each once, in any order.
    List(Vec<[i32; 3]>),
}

/// Values of the cells of a frame; all others are 0.
#[derive(Debug, Clone, PartialEq)]
pub enum VolumeValues {
    /// Numbers, in the unit of the grid.
    Scalar(Vec<f32>),
    /// Vectors in the scene's axes, in the unit of the grid.
    Vector(Vec<Vec3>),
}

/// Values of one [`VolumeGrid`] at one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeFrame {
    /// Cells that have a value at this frame.
    pub cells: VolumeCells,
    /// One value for each cell, in the order of the cells.
    pub values: VolumeValues,
}

impl VolumeFrame {
    /// A list of cells with one number each; no cell may occur twice.
    pub fn scalars(cells: impl IntoIterator<Item = ([i32; 3], f32)>) -> Self {
        let (cells, values) = cells.into_iter().unzip();
        Self { cells: VolumeCells::List(cells), values: VolumeValues::Scalar(values) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_reaches_half_its_edge_from_its_middle() {
        let grid = VolumeGrid {
            file: "flock",
            name: "density",
            unit: "1/m^3",
            is_vector: false,
            origin: DVec3::new(0.25, 0.25, 0.25),
            cell: 0.5,
            every: 2,
            max_cells: 1,
        };
        assert_eq!(grid.cell_of(DVec3::new(0.1, 0.6, -0.1)), [0, 1, -1]);
        assert!(grid.is_due(4) && !grid.is_due(5));
    }
}
