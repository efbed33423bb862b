//! The state of the flow: domain, populations and boundary exchange, advanced step by step.

use pulp::{Simd, WithSimd};

use super::collide::moments;
use super::diagnostics::{FlowDiagnostics, PlaneDiagnostics, SnapshotPlane, SnapshotTarget};
use super::domain::{Domain, FaceCondition};
use super::exchange::BoundaryExchange;
use super::exchange_builder::build_exchange;
use super::grid::{BLOCK, Populations, StepParity};
use super::ground::shear_nonequilibrium_population;
use super::stencil::{Q, VELOCITIES, opposite, weight};
use super::step_tables::{FlowParams, StepTables};
use super::stepper::{BoundaryInputs, PassReport, StepContext};
use osier_base::Result;
use osier_base::math::narrow;
use osier_base::par;
use osier_base::simd::F32Lanes;

/// Populations of a flow after a number of steps, with all data that the next step reads.
#[derive(Debug)]
pub(super) struct FlowState {
    pub domain: Domain,
    pub tables: StepTables,
    pub exchange: BoundaryExchange,
    pub populations: Populations,
    /// Number of time steps since rest.
    pub step: u64,
}

/// A velocity to add to all cells of a height: along x and z, cells per step, with its shear
/// ([`super::ground::shear_coefficient`] times the direction).
#[derive(Debug, Clone, Copy)]
pub(super) struct LayerVelocityIncrement {
    pub velocity: [f32; 2],
    pub shear: [f32; 2],
}

impl FlowState {
    /// Air at rest. `nonequilibrium`: outlets pass on the non-equilibrium part.
    /// # Errors
    /// `Io` if the system cannot provide the memory; `Limit` for more nodes than an index of 32 bits counts.
    pub(super) fn new(domain: Domain, params: FlowParams, nonequilibrium: bool) -> Result<Self> {
        let populations = Populations::new(domain.grid)?;
        let exchange = build_exchange(&domain, nonequilibrium)?;
        let tables = StepTables::new(&domain, params)?;
        Ok(Self { domain, tables, exchange, populations, step: 0 })
    }

    /// Changes the conditions of the faces between two steps. `sponge`: as [`FlowParams::sponge`], for these faces.
    /// # Errors
    /// As [`FlowState::new`].
    pub(super) fn set_faces(&mut self, faces: [FaceCondition; 6], sponge: [Vec<f32>; 2]) -> Result<()> {
        self.domain.faces = faces;
        let (nonequilibrium, mean_outward_velocities) =
            (self.exchange.lists.nonequilibrium, self.exchange.mean_outward_velocities);
        // The faces determine which populations cross boundaries: rebuild the lists, and fill their buffers from the populations,
        // which do not change.
        self.exchange = build_exchange(&self.domain, nonequilibrium)?;
        self.exchange.mean_outward_velocities = mean_outward_velocities;
        self.exchange.rebuild_from_populations(&self.populations, self.next_parity());
        self.tables = StepTables::new(&self.domain, FlowParams { sponge, ..self.tables.params.clone() })?;
        Ok(())
    }

    pub(super) fn next_parity(&self) -> StepParity {
        StepParity::from_step(self.step)
    }

    /// One step without a snapshot; returns the number of clamped cells.
    #[cfg(test)]
    pub(super) fn advance_one_step(&mut self, inputs: BoundaryInputs<'_>) -> u64 {
        self.advance_one_or_two_steps(inputs, None, None).clamped[0]
    }

    /// Advances by one step, or by an even step and the odd one after it in one pass over memory, which gives the same
    /// populations. `second`: inputs of the odd step; `snapshot`: destination of the moments of the last step.
    pub(super) fn advance_one_or_two_steps(
        &mut self,
        first: BoundaryInputs<'_>,
        second: Option<BoundaryInputs<'_>>,
        snapshot: Option<SnapshotTarget<'_>>,
    ) -> PassReport {
        let parity = self.next_parity();
        self.step += 1 + u64::from(second.is_some());
        let context = StepContext { tables: &self.tables, domain: &self.domain, parity, first, second };
        context.run_pass(&mut self.populations, &mut self.exchange, snapshot)
    }

    /// Adds a velocity to each layer of cells, `layers` by y, between two steps. It is also added to solid cells, which boundary
    /// exchange never reads.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn add_layer_velocities(&mut self, layers: &[LayerVelocityIncrement]) {
        // Every population of a layer gets the same increment, which depends only on direction and height.
        let (grid, parity) = (self.domain.grid, self.next_parity());
        let mut arrays: Vec<_> = self.populations.arrays_mut().into_iter().enumerate().collect();
        par::par_each(&mut arrays, |(k, array)| {
            // The linear part of the equilibrium, 3 w_i c_i.u, and the non-equilibrium part of the shear.
            // After an even step array k holds direction opp(k).
            let i = if parity == StepParity::Odd { opposite(*k) } else { *k };
            let [x, _, z] = VELOCITIES[i].map(|c| narrow(3.0 * weight(i) * f64::from(c)));
            let added = |l: &LayerVelocityIncrement| {
                x * l.velocity[0] + z * l.velocity[1] + shear_nonequilibrium_population(i, l.shear)
            };
            let added: Vec<f32> = layers.iter().map(added).collect();
            for z in 0..grid.n[2] {
                for (y, added) in added.iter().enumerate() {
                    let (_, first) = grid.outgoing_slot_of(parity, i, grid.node_element([0, y as isize, z as isize]));
                    array[first..first + grid.n[0]].iter_mut().for_each(|g| *g += added);
                }
            }
        });
        self.exchange.rebuild_from_populations(&self.populations, parity);
    }

    /// Populations that left a cell in the last step.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn outgoing_populations(&self, cell: [usize; 3]) -> [f32; Q] {
        let e = self.domain.grid.node_element(cell.map(|c| c as isize));
        let arrays = self.populations.arrays();
        std::array::from_fn(|i| {
            let (k, e) = self.domain.grid.outgoing_slot_of(self.next_parity(), i, e);
            arrays[k][e]
        })
    }

    /// Density less 1, and velocity, cells per step, of a cell.
    pub(super) fn moments_at(&self, cell: [usize; 3]) -> (f32, [f32; 3]) {
        moments(&self.outgoing_populations(cell))
    }

    /// The air cell with the highest speed; of several the first.
    pub(super) fn fastest_cell(&self) -> [usize; 3] {
        let n = self.domain.grid.n;
        let mut fastest = ([0; 3], -1.0);
        for c in (0..self.domain.grid.cell_count()).filter(|c| !self.domain.solid[*c]) {
            let cell = [c % n[0], c / n[0] % n[1], c / n[0] / n[1]];
            let square: f32 = self.moments_at(cell).1.iter().map(|u| u * u).sum();
            if square > fastest.1 {
                fastest = (cell, square);
            }
        }
        fastest.0
    }

    /// Computes density and checkerboard of every cell without a step.
    pub(super) fn diagnose(&self) -> FlowDiagnostics {
        let mut planes: Vec<_> = (0..self.domain.grid.n[2]).map(|z| (z, None)).collect();
        self.compute_plane_moments(&mut planes)
    }

    /// As [`Self::diagnose`], and also writes a snapshot.
    pub(super) fn write_snapshot(&self, target: SnapshotTarget<'_>) -> FlowDiagnostics {
        let mut planes: Vec<_> = target.split_planes().into_iter().map(Some).enumerate().collect();
        self.compute_plane_moments(&mut planes)
    }

    fn compute_plane_moments(&self, planes: &mut [(usize, Option<SnapshotPlane<'_>>)]) -> FlowDiagnostics {
        let read = |(z, target): &mut (usize, Option<SnapshotPlane<'_>>)| {
            self.tables.arch.dispatch(PlaneMomentsKernel { flow: self, z: *z, target: target.as_mut() })
        };
        FlowDiagnostics { planes: par::par_map_mut(planes, read) }
    }
}

/// Computes the moments of a plane between two steps.
struct PlaneMomentsKernel<'a, 'b> {
    flow: &'a FlowState,
    z: usize,
    target: Option<&'a mut SnapshotPlane<'b>>,
}

impl WithSimd for PlaneMomentsKernel<'_, '_> {
    type Output = PlaneDiagnostics;

    #[inline(always)]
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    fn with_simd<S: Simd>(self, simd: S) -> PlaneDiagnostics {
        let Self { flow, z, mut target } = self;
        let (grid, domain) = (&flow.domain.grid, &flow.domain);
        let arrays = flow.populations.arrays();
        let parity = flow.next_parity();
        let [nx, ny, _] = grid.n;
        let length = nx.next_multiple_of(BLOCK);
        let mut diagnostics = PlaneDiagnostics::default();
        let mut row = [vec![0.0_f32; length], vec![0.0; length], vec![0.0; length], vec![0.0; length]];
        for y in 0..ny {
            let first = grid.node_element([0, y as isize, z as isize]);
            // Between two steps the populations lie where the next step of this parity will read them.
            let mut slots: [(usize, usize); Q] = [(0, 0); Q];
            for (i, slot) in slots.iter_mut().enumerate() {
                *slot = grid.outgoing_slot_of(parity, i, first);
            }
            for register in 0..length / S::F32_LANES {
                let at = register * S::F32_LANES;
                let mut g = [F32Lanes::from_scalar(simd, 0.0); Q];
                for (g, (k, e)) in g.iter_mut().zip(slots) {
                    *g = F32Lanes::new(simd, S::as_simd_f32s(&arrays[k][e + at..][..S::F32_LANES]).0[0]);
                }
                let (drho, u) = moments(&g);
                // Order of a snapshot's values: velocity by component, then density.
                let all = [u[0], u[1], u[2], drho];
                for a in 0..4 {
                    S::as_mut_simd_f32s(&mut row[a]).0[register] = all[a].value;
                }
            }
            let row = row.each_mut().map(|part| &mut part[..nx]);
            diagnostics.add_and_store_row(domain, y, z, row, target.as_deref_mut());
        }
        if let Some(target) = target {
            target.fill_halo_rows();
        }
        diagnostics
    }
}
