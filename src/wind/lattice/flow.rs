//! Air that flows: cells, what joins them, and their populations.

use super::cells::Cells;
use super::collide::moments;
use super::grid::{Parity, Populations};
use super::links::Links;
use super::stencil::Q;
use super::sweep::{Sweep, Viscosity};
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

    /// One step; returns how many fluid cells were too fast and clamped. `wind`: velocity at each inlet, by component, cells a step;
    /// `wanted`: mean outward velocity at each face that is an outlet.
    pub(super) fn advance(&mut self, wind: &[Vec<f32>; 3], wanted: [f32; 6]) -> u64 {
        let parity = Parity::of(self.step);
        self.step += 1;
        self.sweep.step(&mut self.populations, &mut self.links, (parity, &self.cells), (wind, wanted))
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
