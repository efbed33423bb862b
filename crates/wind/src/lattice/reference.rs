//! The same flow as plainly as can be: two copies of everything, one cell after the other, in f64. What the production code
//! is held to.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::needless_range_loop,
    reason = "small known numbers"
)]

use super::collide::{FASTEST, Relax, collide, moments};
use super::domain::{Cells, Face, Source};
use super::ground::{Surface, hold};
use super::open_boundary::{Beyond, Kind, let_go, mean_of};
use super::stencil::{C, Q, weight};

/// Air in steps of the lattice.
pub(super) struct Plain {
    pub cells: Cells,
    pub tau: f64,
    pub eddies: f64,
    pub sponge: [Vec<f64>; 2],
    pub ground: Surface,
    pub force: [f64; 3],
    pub rest: bool,
    /// Mean outward velocity before each outlet, ahead of the last even step.
    pub mean: [f64; 6],
    /// Steps done.
    pub step: u64,
    /// What left each cell in the last step.
    pub left: Vec<[f64; Q]>,
}

impl Plain {
    pub(super) fn new(cells: Cells, tau: f64, eddies: f64) -> Self {
        let left = vec![[0.0; Q]; cells.grid.cells()];
        Self {
            cells,
            tau,
            eddies,
            sponge: [Vec::new(), Vec::new()],
            ground: Surface::default(),
            force: [0.0; 3],
            rest: false,
            mean: [0.0; 6],
            step: 0,
            left,
        }
    }

    /// Mean outward velocity before each face.
    fn outflow(&self, before: &[[f64; Q]]) -> [f64; 6] {
        let n = self.cells.grid.n;
        std::array::from_fn(|f| {
            let (axis, high) = (f / 2, f % 2 == 1);
            let (mut sum, mut count) = (0.0, 0.0);
            for c in 0..self.cells.grid.cells() {
                let cell = [c % n[0], c / n[0] % n[1], c / n[0] / n[1]];
                if cell[axis] == if high { n[axis] - 1 } else { 0 } && !self.cells.is_solid(cell) {
                    sum += moments(&before[c]).1[axis] * if high { 1.0 } else { -1.0 };
                    count += 1.0;
                }
            }
            sum / count
        })
    }

    /// `wind`: velocity outside, and how it leans.
    pub(super) fn advance(&mut self, wind: impl Fn([isize; 3]) -> ([f64; 3], [f64; 2]), wanted: [f64; 6]) {
        let before = self.left.clone();
        if self.step.is_multiple_of(2) {
            self.mean = self.outflow(&before);
        }
        self.step += 1;
        let density = std::array::from_fn(|f| let_go(wanted[f], self.mean[f]));
        let [nx, ny, nz] = self.cells.grid.n;
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    if !self.cells.is_solid([x, y, z]) {
                        let g = std::array::from_fn(|i| self.arriving((&before, density), [x, y, z], i, &wind));
                        let after = self.collided(g, [x, y, z]);
                        self.left[self.cells.grid.cell([x, y, z])] = after;
                    }
                }
            }
        }
    }

    fn arriving(
        &self,
        (before, density): (&[[f64; Q]], [f64; 6]),
        x: [usize; 3],
        i: usize,
        wind: impl Fn([isize; 3]) -> ([f64; 3], [f64; 2]),
    ) -> f64 {
        let left = |cell: [usize; 3]| before[self.cells.grid.cell(cell)];
        match self.cells.source(x, i) {
            Source::Neighbour => left(std::array::from_fn(|a| x[a].wrapping_add_signed(-(C[i][a] as isize))))[i],
            Source::Left(j, q) => left(q)[j],
            Source::Struck(j, q, velocity) => {
                let along: f64 = (0..3).map(|a| f64::from(C[i][a]) * velocity[a]).sum();
                left(q)[j] + 6.0 * weight(i) * along
            }
            Source::Ghost(j, place) => {
                let near: [usize; 3] =
                    std::array::from_fn(|a| place[a].clamp(0, self.cells.grid.n[a] as isize - 1) as usize);
                let solid = self.cells.is_solid(near);
                let near = if solid { [0.0; Q] } else { left(near) };
                let faces = self.cells.beyond(place).map(|f| f.map(|f| (f, self.cells.faces[f])));
                let sends = if faces.iter().flatten().any(|f| f.1 == Face::Inlet) {
                    let (u, lean) = wind(place);
                    Kind::Inlet(u, lean)
                } else {
                    let out = faces.map(|f| f.map_or(0, |(f, _)| 2 * (f % 2) as i8 - 1));
                    Kind::Outlet(out, mean_of(out, density), self.rest && !solid)
                };
                Beyond::new(moments(&near), sends).sends(j, near[j])
            }
        }
    }

    fn collided(&self, mut g: [f64; Q], [x, y, z]: [usize; 3]) -> [f64; Q] {
        let sponge = |k: usize, at: usize| self.sponge[k].get(at).copied().unwrap_or(0.0);
        let share = sponge(0, x).max(sponge(1, z));
        if y == 0 && self.ground.drag > 0.0 {
            hold(&mut g, f64::from(self.ground.drag), f64::from(self.ground.more) * share);
        }
        let ground = self.ground.thick.get(y).map_or(self.tau, |t| f64::from(*t));
        let rise = (1.0 - self.tau) * self.ground.shape.get(y).map_or(1.0, |s| f64::from(*s));
        let tau = (self.tau + share * rise).max(ground);
        let relax = Relax::new(tau, self.eddies, self.force);
        match (self.eddies > 0.0, self.force.iter().any(|f| f.abs() > 0.0)) {
            (true, _) => collide::<_, true, false>(&g, relax, FASTEST * FASTEST).g,
            (false, false) => collide::<_, false, false>(&g, relax, FASTEST * FASTEST).g,
            (false, true) => collide::<_, false, true>(&g, relax, FASTEST * FASTEST).g,
        }
    }

    pub(super) fn at(&self, cell: [usize; 3]) -> (f64, [f64; 3]) {
        moments(&self.left[self.cells.grid.cell(cell)])
    }
}
