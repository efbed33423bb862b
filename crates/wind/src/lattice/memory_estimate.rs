//! Memory that a lattice wind needs, estimated before it is allocated.

use super::domain::FaceCondition;
use super::grid::LatticeGrid;
use super::setup::{LatticeOptions, faces_ever_open};
use super::tuning::{
    BYTES_PER_INLET_CELL, BYTES_PER_MODE_AND_INLET_CELL, BYTES_PER_OPEN_CELL, HELD_SNAPSHOTS, SOLID_FLAG_COPIES,
};
use osier_base::limits::{Limits, grouped};
use osier_base::{Error, Result};

/// Estimated memory of a lattice wind, bytes by use. The boundary exchange at solids, some hundred bytes per surface cell, is
/// omitted. Source: own, from the memory layout of each part; a test compares it with the memory of a solver.
/// ```
/// use osier_wind::{LatticeMemory, LatticeOptions};
///
/// let memory = LatticeMemory::estimate(&LatticeOptions::default());
/// assert!(memory.populations >= 70 * 70 * 70 * 15 * 4 && memory.total() < 100_000_000);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LatticeMemory {
    /// Populations: fifteen numbers of four bytes per cell, with a halo.
    pub populations: u64,
    /// Snapshots of a few frames, sixteen bytes per cell.
    pub snapshots: u64,
    /// Flags of solid cells, one byte each.
    pub solid_cells: u64,
    /// Ghost nodes of inlets and outlets, and the inflow at them.
    pub open_faces: u64,
}

impl LatticeMemory {
    /// Estimate for a solver with these options; saturates beyond 64 bits.
    pub fn estimate(options: &LatticeOptions) -> Self {
        // Saturating products, because the options may request more cells than 64 bits can count.
        let n = options.cells.map(u64::from);
        let count: u64 = n.iter().fold(1, |product, n| product.saturating_mul(*n));
        let with_halo: u64 = n.iter().fold(1, |product, n| product.saturating_mul(n + 2));
        let faces = faces_ever_open(options);
        // Cells at a face: the product of the other two extents.
        let area = |f: usize| (0..3).filter(|a| *a != f / 2).map(|a| n[a]).product::<u64>();
        let cells_at = |face: FaceCondition| (0..6).filter(|f| faces[*f] == face).map(area).sum::<u64>();
        let (inlet_cells, outlet_cells) = (cells_at(FaceCondition::Inlet), cells_at(FaceCondition::Outlet));
        let modes = if options.inlet.turbulence > 0.0 { u64::from(options.inlet.turbulence_modes) } else { 0 };
        Self {
            populations: LatticeGrid::population_bytes(options.cells.map(|n| n as usize)),
            snapshots: HELD_SNAPSHOTS * 16 * with_halo,
            solid_cells: SOLID_FLAG_COPIES * count,
            open_faces: BYTES_PER_OPEN_CELL * (inlet_cells + outlet_cells)
                + (BYTES_PER_MODE_AND_INLET_CELL * modes + BYTES_PER_INLET_CELL) * inlet_cells,
        }
    }

    /// Sum of all uses, bytes; saturates instead of overflowing.
    pub fn total(&self) -> u64 {
        [self.populations, self.snapshots, self.solid_cells, self.open_faces]
            .iter()
            .fold(0, |sum, b| sum.saturating_add(*b))
    }

    /// Fails for a lattice whose estimate exceeds the memory limit.
    /// # Errors
    /// `Limit`, which names cells and spacing.
    pub(super) fn check_limit(&self, options: &LatticeOptions, limits: &Limits) -> Result<()> {
        let (limit, [x, y, z]) = (limits.get("memory"), options.cells);
        if self.total() <= limit {
            return Ok(());
        }
        let name =
            format!("memory of the wind's lattice of {x} x {y} x {z} cells with dx = {} m, in bytes,", options.spacing);
        let flag = "--max-memory".into();
        let help = "use fewer wind.lattice.cells or a larger wind.lattice.dx".into();
        Err(Error::Limit { name, wanted: grouped(self.total()), limit: grouped(limit), flag, help })
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, clippy::print_stdout, reason = "tests")]
mod tests {
    use super::super::LatticeSolver;
    use super::*;

    #[test]
    fn the_estimate_is_close_to_the_memory_of_a_solver() {
        let base = LatticeOptions { cells: [64, 48, 48], ..LatticeOptions::default() };
        let mut slanted = base.clone();
        slanted.inlet.direction = glam::DVec3::new(0.6, 0.0, 0.8);
        let mut turning = base.clone();
        turning.inlet.direction_curve = vec![[0.0, 0.5]];
        for options in [base, slanted, turning] {
            let estimate = LatticeMemory::estimate(&options);
            let lattice = LatticeSolver::new(&options, &[], &Limits::default()).expect("lattice");
            // Snapshots are allocated only with the frames.
            let (estimate, held) = (estimate.total() - estimate.snapshots, lattice.memory_bytes());
            println!("lattice: estimate {estimate} bytes, holds {held}");
            assert!(held <= estimate && 10 * held > 8 * estimate, "estimate {estimate}, holds {held}");
        }
    }

    #[test]
    fn lattice_beyond_the_memory_limit_is_refused() {
        let options = LatticeOptions { cells: [4096; 3], spacing: 0.25, ..LatticeOptions::default() };
        let mut limits = Limits::default();
        limits.set("cells", "none").expect("limit");
        let said = LatticeSolver::new(&options, &[], &limits).expect_err("68 billion cells").to_string();
        assert!(
            said.contains("4096 x 4096 x 4096") && said.contains("dx = 0.25") && said.contains("--max-memory"),
            "{said}"
        );
    }
}
