//! Air that flows: cells, what joins them, and their populations.

use super::collide::moments;
use super::domain::{Cells, Face};
use super::exchange::Links;
use super::grid::{Parity, Populations};
use super::ground::leant;
use super::snapshot::{Pages, Reading};
use super::stencil::{C, Q, opposite, weight};
use super::stepper::{Asked, Sweep, Viscosity};
use osier_base::Result;
use osier_base::math::narrow;
use osier_base::par;

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

    /// Gives the faces other roles, between two steps. `sponge`: what they make of it ([`Viscosity::sponge`]).
    pub(super) fn open(&mut self, faces: [Face; 6], sponge: [Vec<f32>; 2]) {
        self.cells.faces = faces;
        let (rest, mean) = (self.links.plan.rest, self.links.mean);
        self.links = Links::new(&self.cells, rest);
        self.links.mean = mean;
        self.links.renew(&self.populations, Parity::of(self.step));
        self.sweep = Sweep::new(&self.cells, Viscosity { sponge, ..self.sweep.viscosity.clone() });
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

    /// Adds a level velocity to all air of a height, between two steps. `by`: by y the velocity, cells a step, and how it
    /// leans with the height ([`super::ground::lean`]), both along x and z.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn push(&mut self, by: &[[[f32; 2]; 2]]) {
        let (grid, parity) = (self.cells.grid, Parity::of(self.step));
        let mut arrays: Vec<_> = self.populations.arrays_mut().into_iter().enumerate().collect();
        // What solid cells are given is put aside by boundaries.
        par::par_each(&mut arrays, |(k, array)| {
            let i = if parity == Parity::Odd { opposite(*k) } else { *k };
            let [x, _, z] = C[i].map(|c| narrow(3.0 * weight(i) * f64::from(c)));
            let more: Vec<f32> = by.iter().map(|[u, lean]| x * u[0] + z * u[1] + leant(i, *lean)).collect();
            for z in 0..grid.n[2] {
                for (y, more) in more.iter().enumerate() {
                    let (_, first) = grid.left(parity, i, grid.element([0, y as isize, z as isize]));
                    array[first..first + grid.n[0]].iter_mut().for_each(|g| *g += more);
                }
            }
        });
        self.links.renew(&self.populations, parity);
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
