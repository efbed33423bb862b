//! What a lattice wind takes of the machine, known before it is made.

use super::domain::FaceCondition;
use super::grid::LatticeGrid;
use super::setup::{LatticeOptions, most_open_faces};
use osier_base::limits::{Limits, grouped};
use osier_base::{Error, Result};

/// Snapshots that are held at a time: two that a wind is between, the next, and one that is still looked at.
const SNAPSHOTS: u64 = 4;
/// Marks of each cell: solid or not, in three places.
const MARKS: u64 = 3;
/// Of each cell before an open face: what it sends and takes, and where.
const OPEN: u64 = 260;
/// Of each wave of turbulence at a place where air comes in: cosine and sine.
const WAVE: u64 = 8;
/// Velocity, mean and place where air comes in.
const MOUTH: u64 = 40;

/// Bytes of a lattice wind, by what they are for. Boundaries of solids are left out: some hundred bytes for each cell of their surface.
/// Source: \[catkin\] has none; own, after the layout of each part, held to what a lattice holds by a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LatticeMemory {
    /// Air: fifteen numbers of four bytes at every cell and around the box.
    pub populations: u64,
    /// Velocities of a few frames, sixteen bytes a cell.
    pub snapshots: u64,
    /// What is solid.
    pub solid_cells: u64,
    /// Open faces.
    pub open_faces: u64,
}

impl LatticeMemory {
    /// What these options would take.
    pub fn estimate(options: &LatticeOptions) -> Self {
        let n = options.cells.map(u64::from);
        let count: u64 = n.iter().fold(1, |all, n| all.saturating_mul(*n));
        let around: u64 = n.iter().fold(1, |all, n| all.saturating_mul(n + 2));
        let faces = most_open_faces(options);
        let area = |f: usize| (0..3).filter(|a| *a != f / 2).map(|a| n[a]).product::<u64>();
        let all = |face: FaceCondition| (0..6).filter(|f| faces[*f] == face).map(area).sum::<u64>();
        let (coming, going) = (all(FaceCondition::Inlet), all(FaceCondition::Outlet));
        let modes = if options.inlet.turbulence > 0.0 { u64::from(options.inlet.turbulence_modes) } else { 0 };
        Self {
            populations: LatticeGrid::population_bytes(options.cells.map(|n| n as usize)),
            snapshots: SNAPSHOTS * 16 * around,
            solid_cells: MARKS * count,
            open_faces: OPEN * (coming + going) + (WAVE * modes + MOUTH) * coming,
        }
    }

    /// All of it.
    pub fn total(&self) -> u64 {
        [self.populations, self.snapshots, self.solid_cells, self.open_faces]
            .iter()
            .fold(0, |sum, b| sum.saturating_add(*b))
    }

    /// Refuses what passes the limit.
    /// # Errors
    /// `Limit` that names cells and spacing.
    pub(super) fn check(&self, options: &LatticeOptions, limits: &Limits) -> Result<()> {
        let (limit, [x, y, z]) = (limits.get("memory"), options.cells);
        if self.total() <= limit {
            return Ok(());
        }
        let name =
            format!("memory of the wind's lattice of {x} x {y} x {z} cells with dx = {} m, in bytes,", options.spacing);
        let flag = "--max-memory, fewer wind.lattice.cells or a larger wind.lattice.dx".into();
        Err(Error::Limit { name, wanted: grouped(self.total()), limit: grouped(limit), flag })
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, clippy::print_stdout, reason = "tests")]
mod tests {
    use super::super::LatticeSolver;
    use super::*;

    #[test]
    fn what_is_foretold_is_what_is_taken() {
        let base = LatticeOptions { cells: [64, 48, 48], ..LatticeOptions::default() };
        let mut slanted = base.clone();
        slanted.inlet.direction = glam::DVec3::new(0.6, 0.0, 0.8);
        let mut turning = base.clone();
        turning.inlet.direction_curve = vec![[0.0, 0.5]];
        for options in [base, slanted, turning] {
            let told = LatticeMemory::estimate(&options);
            let lattice = LatticeSolver::new(&options, &[], &Limits::default()).expect("lattice");
            // Snapshots come with the frames.
            let (told, held) = (told.total() - told.snapshots, lattice.bytes());
            println!("lattice: told {told} bytes, holds {held}");
            assert!(held <= told && 10 * held > 8 * told, "told {told}, holds {held}");
        }
    }

    #[test]
    fn too_much_is_refused_by_name() {
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
