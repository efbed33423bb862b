//! A leaf as a surface that drops touch: points by texture coordinates, its margin, holes, veins and wetness.

use glam::DVec2;

pub(crate) mod alpha_mask;
pub(crate) mod chart;
mod flatten;
mod overlap;
pub(crate) mod relief;
pub(crate) mod surface;
pub(crate) mod veins;
pub(crate) mod wetness;

/// Number of cells along each side of the grids over texture coordinates: of triangles (point location) and of wetness. On a leaf
/// of 80 mm a cell is 1.7 mm long, as wide as a small drop; more cells make wetness sharper and each lookup of a triangle shorter.
pub(crate) const GRID_CELLS: usize = 48;

/// Column and row of the grid cell at texture coordinates, clamped to the grid.
fn grid_cell(uv: DVec2) -> [usize; 2] {
    let n = GRID_CELLS as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    [uv.x, uv.y].map(|x| (x * n).clamp(0.0, n - 1.0) as usize)
}
