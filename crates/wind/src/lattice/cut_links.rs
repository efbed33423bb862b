//! Links between cells that a surface cuts: walls thinner than a cell, walls oblique to the grid, open meshes.
//!
//! A wall thinner than a cell may lie between two cell centres and contain none, so that no cell becomes solid. A
//! population whose path from centre to centre meets a surface therefore bounces back halfway, though both cells are
//! air. Each cell knows which of its fourteen half links, from its centre to halfway to the neighbour, meet a surface;
//! a link is cut if either half is. Half links also serve links that a face of the box reflects or joins to the
//! opposite face, whose two halves lie apart.

use glam::Vec3;

use super::cells::{CellGeometry, cell_center};
use super::grid::LatticeGrid;
use super::stencil::{Q, VELOCITIES};
use super::tuning::SURFACE_SLACK;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par;
use osier_scene::solid::Solid;

/// Half links between cells that are cut by surfaces.
#[derive(Debug, Clone, Default)]
pub(super) struct CutHalfLinks {
    /// By cell, x fastest: bit i is set if a surface cuts the half link in direction i. Empty if none is cut.
    halves: Vec<u16>,
}

impl CutHalfLinks {
    /// Tests the half links of all air cells. `solid`: whether each cell is solid.
    pub(super) fn find(grid: &LatticeGrid, cells: CellGeometry, solids: &[Solid], solid: &[bool]) -> Self {
        let half = narrow(cells.spacing / 2.0);
        let slack = narrow(SURFACE_SLACK * cells.spacing);
        let planes: Vec<usize> = (0..grid.n[2]).collect();
        // One task per plane; within the plane each solid tests the cells that its surface may pass through.
        let planes = par::par_map(&planes, |z| {
            let mut plane = vec![0_u16; grid.n[0] * grid.n[1]];
            for body in solids {
                let Some([columns, rows]) = cells.cells_within_bounds(grid, body, half + slack, *z) else { continue };
                for y in rows {
                    for x in columns.clone() {
                        if solid[grid.cell_index([x, y, *z])] {
                            continue;
                        }
                        let center = cell_center(cells, [x, y, *z]);
                        let around = Bounds { min: center, max: center }.expanded(half + slack);
                        if body.may_touch(around) {
                            plane[x + grid.n[0] * y] |= cut_halves(body, center, half, slack);
                        }
                    }
                }
            }
            plane
        });
        let halves = planes.concat();
        if halves.iter().all(|bits| *bits == 0) { Self::default() } else { Self { halves } }
    }

    /// Cut links from masks of half links by cell.
    #[cfg(test)]
    pub(super) fn from_halves(halves: Vec<u16>) -> Self {
        Self { halves }
    }

    /// Whether a surface cuts the half link in direction `i` of the cell with index `cell`.
    #[inline]
    pub(super) fn is_half_cut(&self, cell: usize, i: usize) -> bool {
        self.halves.get(cell).is_some_and(|bits| bits >> i & 1 == 1)
    }

    /// Whether all half links of the cell with index `cell` are cut: its centre lies on a surface.
    pub(super) fn is_isolated(&self, cell: usize) -> bool {
        self.halves.get(cell).is_some_and(|bits| (1..Q).all(|i| bits >> i & 1 == 1))
    }

    /// The masks of half links by cell; empty if none is cut.
    pub(super) fn halves(&self) -> &[u16] {
        &self.halves
    }

    /// Memory that the links occupy, bytes.
    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.halves)
    }
}

/// The half links around a cell's centre that meet a solid, as a bit mask.
fn cut_halves(solid: &Solid, center: Vec3, half: f32, slack: f32) -> u16 {
    (1..Q)
        .filter(|i| {
            let [x, y, z] = VELOCITIES[*i].map(|c| half * c as f32);
            solid.meets([center, center + Vec3::new(x, y, z)], slack)
        })
        .fold(0, |bits, i| bits | 1 << i)
}
