//! Positions of the cells of the lattice in the world.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::grid::LatticeGrid;
use osier_scene::solid::{Form, Solid};

/// Position of the cells in the world and their size; the [`LatticeGrid`] contains their number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CellGeometry {
    /// Lowest corner of the box, m.
    pub origin: DVec3,
    /// Length of a cell's edge, m.
    pub spacing: f64,
}

/// Centre of a cell in the world, m; [0, 0, 0] is the cell at the lowest corner.
pub(super) fn cell_center(cells: CellGeometry, cell: [usize; 3]) -> Vec3 {
    let offset = DVec3::new(cell[0] as f64 + 0.5, cell[1] as f64 + 0.5, cell[2] as f64 + 0.5);
    (cells.origin + offset * cells.spacing).as_vec3()
}

impl CellGeometry {
    /// Height in cells of the top of a solid above the bottom of the box, or above the solid's lowest point if that is
    /// higher.
    pub(super) fn height_in_cells(self, solid: &Solid) -> f64 {
        let bounds = solid.bounds();
        (f64::from(bounds.max.y) - f64::from(bounds.min.y).max(self.origin.y)) / self.spacing
    }

    /// Columns and rows of the plane `z` whose centres lie within a solid's bounds, extended by `margin`, m; `None` if the plane
    /// itself lies outside. Land extends without bound horizontally and downwards.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn cells_within_bounds(
        self,
        grid: &LatticeGrid,
        solid: &Solid,
        margin: f32,
        z: usize,
    ) -> Option<[Range<usize>; 2]> {
        let bounds = solid.bounds().expanded(margin);
        let is_land = matches!(solid.form, Form::Land(_));
        let range = |a: usize| {
            // Cell k has its centre at k + 1/2.
            let in_cells = |v: f32| (f64::from(v) - self.origin[a]) / self.spacing - 0.5;
            let n = grid.n[a] as f64;
            let low = if is_land { 0.0 } else { in_cells(bounds.min[a]).ceil().clamp(0.0, n) };
            let high = if is_land && a != 1 { n } else { (in_cells(bounds.max[a]).floor() + 1.0).clamp(0.0, n) };
            low as usize..high as usize
        };
        range(2).contains(&z).then(|| [range(0), range(1)])
    }
}
