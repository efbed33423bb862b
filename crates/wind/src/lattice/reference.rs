//! Reference solver: the scheme as in a textbook, with two copies of the populations, one cell after the other, in
//! f64. Tests compare the production solver with it.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::needless_range_loop,
    reason = "small known numbers"
)]

use super::collide::{MAX_SPEED, Relaxation, collide, moments};
use super::domain::{Domain, FaceCondition, PopulationSource};
use super::ground::{GroundModel, apply_wall_stress};
use super::open_boundary::{GhostCondition, GhostState, mean_over_adjoining_outlets, outlet_density};
use super::stencil::{Q, VELOCITIES, weight};

/// The state of a flow, and its parameters as in [`super::step_tables::FlowParams`].
pub(super) struct ReferenceSolver {
    pub domain: Domain,
    pub tau: f64,
    pub smagorinsky_factor: f64,
    pub sponge: [Vec<f64>; 2],
    pub ground: GroundModel,
    pub force: [f64; 3],
    pub nonequilibrium: bool,
    /// Mean outward velocity before each outlet, measured before the last even step.
    pub mean_outflow_before_even_step: [f64; 6],
    /// Number of completed steps.
    pub step: u64,
    /// Populations that left each cell in the last step.
    pub outgoing: Vec<[f64; Q]>,
}

impl ReferenceSolver {
    pub(super) fn new(domain: Domain, tau: f64, smagorinsky_factor: f64) -> Self {
        let outgoing = vec![[0.0; Q]; domain.grid.cell_count()];
        Self {
            domain,
            tau,
            smagorinsky_factor,
            sponge: [Vec::new(), Vec::new()],
            ground: GroundModel::default(),
            force: [0.0; 3],
            nonequilibrium: false,
            mean_outflow_before_even_step: [0.0; 6],
            step: 0,
            outgoing,
        }
    }

    /// Mean outward velocity before each face.
    fn mean_outward_velocities(&self, before: &[[f64; Q]]) -> [f64; 6] {
        let n = self.domain.grid.n;
        std::array::from_fn(|f| {
            let (axis, high) = (f / 2, f % 2 == 1);
            let (mut sum, mut count) = (0.0, 0.0);
            for c in 0..self.domain.grid.cell_count() {
                let cell = [c % n[0], c / n[0] % n[1], c / n[0] / n[1]];
                if cell[axis] == if high { n[axis] - 1 } else { 0 } && !self.domain.is_solid(cell) {
                    sum += moments(&before[c]).1[axis] * if high { 1.0 } else { -1.0 };
                    count += 1.0;
                }
            }
            sum / count
        })
    }

    /// One step. `wind`: velocity and shear at a ghost node; `wanted`: target outflow of each outlet.
    pub(super) fn advance(&mut self, wind: impl Fn([isize; 3]) -> ([f64; 3], [f64; 2]), wanted: [f64; 6]) {
        let before = self.outgoing.clone();
        // As in the production solver, the mean outflow is measured once for two steps.
        if self.step.is_multiple_of(2) {
            self.mean_outflow_before_even_step = self.mean_outward_velocities(&before);
        }
        self.step += 1;
        let density = std::array::from_fn(|f| outlet_density(wanted[f], self.mean_outflow_before_even_step[f]));
        let [nx, ny, nz] = self.domain.grid.n;
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    if !self.domain.is_solid([x, y, z]) {
                        let g =
                            std::array::from_fn(|i| self.incoming_population(&before, density, [x, y, z], i, &wind));
                        let after = self.collide_cell(g, [x, y, z]);
                        self.outgoing[self.domain.grid.cell_index([x, y, z])] = after;
                    }
                }
            }
        }
    }

    fn incoming_population(
        &self,
        before: &[[f64; Q]],
        density: [f64; 6],
        x: [usize; 3],
        i: usize,
        wind: impl Fn([isize; 3]) -> ([f64; 3], [f64; 2]),
    ) -> f64 {
        // Streaming written as a gather: find the source of each arriving population.
        let left = |cell: [usize; 3]| before[self.domain.grid.cell_index(cell)];
        match self.domain.population_source(x, i) {
            PopulationSource::Neighbour => {
                left(std::array::from_fn(|a| x[a].wrapping_add_signed(-(VELOCITIES[i][a] as isize))))[i]
            }
            PopulationSource::Cell { direction, cell } => left(cell)[direction],
            PopulationSource::MovingWall { direction, cell, velocity } => {
                let along: f64 = (0..3).map(|a| f64::from(VELOCITIES[i][a]) * velocity[a]).sum();
                left(cell)[direction] + 6.0 * weight(i) * along
            }
            PopulationSource::Ghost { direction, position } => {
                // For a ghost node, use the moments of the nearest cell, and the condition of the faces beyond which the node
                // lies.
                let near: [usize; 3] =
                    std::array::from_fn(|a| position[a].clamp(0, self.domain.grid.n[a] as isize - 1) as usize);
                let solid = self.domain.is_solid(near);
                let near = if solid { [0.0; Q] } else { left(near) };
                let faces = self.domain.faces_outside_of(position).map(|f| f.map(|f| (f, self.domain.faces[f])));
                let sends = if faces.iter().flatten().any(|f| f.1 == FaceCondition::Inlet) {
                    let (velocity, shear) = wind(position);
                    GhostCondition::Inlet { velocity, shear }
                } else {
                    let out = faces.map(|f| f.map_or(0, |(f, _)| 2 * (f % 2) as i8 - 1));
                    GhostCondition::Outlet {
                        outward: out,
                        drho: mean_over_adjoining_outlets(out, density),
                        nonequilibrium: self.nonequilibrium && !solid,
                    }
                };
                {
                    let (drho, u) = moments(&near);
                    GhostState::new(drho, u, sends).population_sent(direction, near[direction])
                }
            }
        }
    }

    fn collide_cell(&self, mut g: [f64; Q], [x, y, z]: [usize; 3]) -> [f64; Q] {
        let sponge = |k: usize, at: usize| self.sponge[k].get(at).copied().unwrap_or(0.0);
        // The relaxation time and drag of the production kernel, evaluated per cell instead of from tables.
        let share = sponge(0, x).max(sponge(1, z));
        if y == 0 && self.ground.drag > 0.0 {
            apply_wall_stress(&mut g, f64::from(self.ground.drag), f64::from(self.ground.sponge_drag) * share);
        }
        let ground = self.ground.min_tau.get(y).map_or(self.tau, |t| f64::from(*t));
        let rise = (1.0 - self.tau) * self.ground.sponge_profile.get(y).map_or(1.0, |s| f64::from(*s));
        // Relaxation time: sponge on top of the molecular one, at least that of the mixing length.
        let tau = (self.tau + share * rise).max(ground);
        let relax = Relaxation::new(tau, self.smagorinsky_factor, self.force);
        match (self.smagorinsky_factor > 0.0, self.force.iter().any(|f| f.abs() > 0.0)) {
            (true, _) => collide::<_, true, false>(&g, relax, MAX_SPEED * MAX_SPEED).g,
            (false, false) => collide::<_, false, false>(&g, relax, MAX_SPEED * MAX_SPEED).g,
            (false, true) => collide::<_, false, true>(&g, relax, MAX_SPEED * MAX_SPEED).g,
        }
    }

    pub(super) fn moments_at(&self, cell: [usize; 3]) -> (f64, [f64; 3]) {
        moments(&self.outgoing[self.domain.grid.cell_index(cell)])
    }
}
