//! Tables of a step that are valid while the faces keep their conditions: blocks with air, relaxation times, ground drag.

use pulp::{Arch, Simd, WithSimd};

use super::domain::Domain;
use super::grid::{BLOCK, LatticeGrid};
use super::ground::GroundModel;
use super::row_ends::RowEndLanes;
use osier_base::Result;
use osier_base::convert::index;

/// Viscosity of the flow, and its variation in space.
#[derive(Debug, Clone)]
pub(super) struct FlowParams {
    /// Relaxation time of the molecular viscosity, steps.
    pub tau: f32,
    /// As [`super::collide::smagorinsky_factor`]; 0 without an eddy viscosity.
    pub smagorinsky_factor: f32,
    /// Strength of the outlet sponges by x and by z, rising from 0 to 1 towards an outlet.
    pub sponge: [Vec<f32>; 2],
    pub ground: GroundModel,
    /// Body force, cells per step squared; 0 in every wind.
    pub force: [f32; 3],
}

/// Consecutive blocks of a plane that contain air, end exclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct AirBlockRange {
    pub from: u32,
    pub to: u32,
    /// Whether relaxation times differ from [`FlowParams::tau`] and are read from the tables.
    pub variable_tau: bool,
}

/// Tables that the kernels of a step read, in the layout of a plane: element k is the k-th node from the plane's first cell.
#[derive(Debug)]
pub(super) struct StepTables {
    pub(super) grid: LatticeGrid,
    pub(super) params: FlowParams,
    /// Runs of blocks with air, by plane.
    block_ranges: Vec<Vec<AirBlockRange>>,
    /// Relaxation time per node of a plane outside the sponges along z.
    pub(super) base_tau: Vec<f32>,
    /// Increase of the relaxation time in the full sponge.
    pub(super) sponge_tau: Vec<f32>,
    /// Drag coefficient of the ground on the lowest row and the rest of its last block; empty without drag.
    pub(super) drag: Vec<f32>,
    /// Strength of the sponge along x at the nodes of `drag`.
    pub(super) drag_sponge: Vec<f32>,
    /// Blocks with ends of rows, the same in every plane.
    pub(super) row_ends: Vec<RowEndLanes>,
    /// Instruction set of the kernels, the widest that the processor supports.
    pub(super) arch: Arch,
}

impl StepTables {
    /// # Errors
    /// `Limit` for more nodes than an index of 32 bits counts.
    pub(super) fn new(domain: &Domain, params: FlowParams) -> Result<Self> {
        let grid = domain.grid;
        // One block more than the plane has, because the kernel reads whole registers.
        let nodes = 0..grid.plane_span() + BLOCK;
        let row = grid.row_stride;
        let base_tau = nodes.clone().map(|k| tau_without_z_sponge(&params, [k % row, k / row])).collect();
        let sponge_tau = nodes.map(|k| params.ground.sponge_tau(k / row, params.tau)).collect();
        // Drag acts on the first row only; halo nodes and the rest of the last block get none.
        let drag_nodes = if params.ground.drag > 0.0 { grid.n[0] + BLOCK } else { 0 };
        let drag = (0..drag_nodes).map(|k| if k < grid.n[0] { params.ground.drag } else { 0.0 }).collect();
        let drag_sponge = (0..drag_nodes).map(|k| params.sponge[0].get(k).copied().unwrap_or(0.0)).collect();
        let arch = Arch::new();
        let block_ranges = (0..grid.n[2]).map(|z| blocks_with_air(domain, &params, z)).collect::<Result<_>>()?;
        let row_ends = RowEndLanes::list_of_plane(&grid, arch.dispatch(LaneCount))?;
        Ok(Self { grid, params, block_ranges, base_tau, sponge_tau, drag, drag_sponge, row_ends, arch })
    }

    /// Selects another instruction set than the best one of the machine.
    #[cfg(test)]
    pub(super) fn set_arch(&mut self, arch: Arch) {
        (self.row_ends, self.arch) =
            (RowEndLanes::list_of_plane(&self.grid, arch.dispatch(LaneCount)).expect("rows"), arch);
    }

    /// Blocks of the plane `z` that contain air.
    pub(super) fn air_block_ranges(&self, z: usize) -> &[AirBlockRange] {
        &self.block_ranges[z]
    }
}

/// Relaxation time at a cell of a plane outside the sponges along z: that of the sponge along x, at least that of the ground.
fn tau_without_z_sponge(params: &FlowParams, [x, y]: [usize; 2]) -> f32 {
    // A longer relaxation time is a larger viscosity, so that the sponge damps waves that the boundary would reflect.
    let (tau, ground) = (params.tau, &params.ground);
    let sponge = params.sponge[0].get(x).copied().unwrap_or(0.0);
    (tau + sponge * ground.sponge_tau(y, tau)).max(ground.min_tau_at(y, tau))
}

/// Blocks of the plane `z` that contain air, as ranges of consecutive blocks with equal `variable_tau`.
fn blocks_with_air(domain: &Domain, params: &FlowParams, z: usize) -> Result<Vec<AirBlockRange>> {
    let grid = domain.grid;
    let in_sponge = params.sponge[1].get(z).is_some_and(|strength| *strength > 0.0);
    let mut ranges: Vec<AirBlockRange> = Vec::new();
    // Omit blocks without a fluid cell; split runs of blocks where tau begins or ceases to vary.
    for block in 0..grid.plane_span().div_ceil(BLOCK) {
        let nodes = block * BLOCK..(block + 1) * BLOCK;
        let air = |k: usize| {
            let (x, y) = (k % grid.row_stride, k / grid.row_stride);
            (x < grid.n[0] && y < grid.n[1] && !domain.is_solid([x, y, z])).then_some([x, y])
        };
        if !nodes.clone().any(|k| air(k).is_some()) {
            continue;
        }
        let at = index(block, "blocks of a plane of the lattice")?;
        let variable_tau = in_sponge || nodes.filter_map(air).any(|at| tau_without_z_sponge(params, at) > params.tau);
        match ranges.last_mut() {
            Some(last) if last.to == at && last.variable_tau == variable_tau => last.to += 1,
            _ => ranges.push(AirBlockRange { from: at, to: at + 1, variable_tau }),
        }
    }
    Ok(ranges)
}

/// Number of `f32` lanes of an instruction set.
struct LaneCount;

impl WithSimd for LaneCount {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}
