//! Air that flows: cells, what joins them, and their populations.

use super::cells::Cells;
use super::collide::moments;
use super::grid::{Parity, Populations};
use super::links::Links;
use super::snapshot::{Pages, Reading};
use super::stencil::Q;
use super::sweep::{Asked, Sweep, Viscosity};
use crate::Result;

/// Air in steps of the lattice.
#[derive(Debug)]
pub(super) struct Flow {
    pub cells: Cells,
    pub sweep: Sweep,
    pub links: Links,
    pub populations: Populations,
    /// Steps done.
    pub step: u64,
}

impl Flow {
    /// Air at rest.
    /// # Errors
    /// `Io` if the system has no memory for it.
    pub(super) fn new(cells: Cells, viscosity: Viscosity, rest: bool) -> Result<Self> {
        let populations = Populations::new(cells.grid)?;
        let links = Links::new(&cells, rest);
        let sweep = Sweep::new(&cells, viscosity);
        Ok(Self { cells, sweep, links, populations, step: 0 })
    }

    /// One step; returns how many fluid cells were too fast and clamped.
    #[cfg(test)]
    pub(super) fn advance(&mut self, asked: Asked<'_>) -> u64 {
        self.go((asked, None), None).0[0]
    }

    /// One step, or an even one and the next with one passage through memory, which gives the same populations; and a
    /// snapshot of the last. Returns how many fluid cells were too fast and clamped in each, and what was seen of the
    /// snapshot.
    pub(super) fn go(
        &mut self,
        asked: (Asked<'_>, Option<Asked<'_>>),
        pages: Option<Pages<'_>>,
    ) -> ([u64; 2], Reading) {
        let parity = Parity::of(self.step);
        self.step += 1 + u64::from(asked.1.is_some());
        self.sweep.step(&mut self.populations, &mut self.links, (parity, &self.cells), (asked, pages))
    }

    /// Populations that left a cell in the last step.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn left(&self, cell: [usize; 3]) -> [f32; Q] {
        let e = self.cells.grid.element(cell.map(|c| c as isize));
        let arrays = self.populations.arrays();
        std::array::from_fn(|i| {
            let (k, e) = self.cells.grid.left(Parity::of(self.step), i, e);
            arrays[k][e]
        })
    }

    /// Density less 1 and velocity of a cell, cells a step.
    pub(super) fn at(&self, cell: [usize; 3]) -> (f32, [f32; 3]) {
        moments(&self.left(cell))
    }
}
