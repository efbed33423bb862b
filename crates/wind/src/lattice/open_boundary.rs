//! Inlets and outlets: the populations that ghost nodes outside open faces send into the domain.
//!
//! A ghost node outside an inlet sends the equilibrium at the prescribed velocity and the density of the cell before it,
//! plus the non-equilibrium part of the wind's shear. One outside an outlet sends the equilibrium at the velocity of the
//! cell before it and a density that lets sound leave ([`outlet_density`]).

use std::ops::Range;

use pulp::Simd;

use super::collide::equilibrium;
use super::ground::shear_nonequilibrium_population;
use super::stencil::Q;
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::simd::{F32Lanes, Lane};

/// Maximum number of ghost nodes per run, so that the populations that a run sends fit into the L1 cache.
const MAX_RUN_NODES: usize = 512;

const SQRT_3: f64 = 1.732_050_807_568_877_2;

/// A node outside an open face, whose populations are recomputed in every step.
#[derive(Debug, Clone, Copy)]
pub(super) struct GhostNode {
    pub position: [isize; 3],
    /// Number of the nearest cell of the domain among the open cells (cells adjacent to open faces); unused if that cell is
    /// solid.
    pub open_cell: u32,
    /// Whether the nearest cell of the domain is solid.
    pub before_solid: bool,
    /// Directions in which it sends, one bit each.
    pub directions: u16,
    pub inlet: bool,
    /// Outward normal of the outlets beyond which it lies, -1, 0 or 1 by axis.
    pub outward: [i8; 3],
    /// The face beyond which it lies, if there is exactly one.
    pub face: Option<usize>,
}

/// Source of the state of the air at a ghost node: the inflow, or the cell before an outlet.
#[derive(Debug, Clone, Copy)]
pub(super) enum GhostCondition<L> {
    /// Prescribed velocity, cells per step; shear along x and z as in [`shear_nonequilibrium_population`].
    Inlet { velocity: [L; 3], shear: [L; 2] },
    /// Velocity of the cell before it, without inward components along `outward`; density less 1. With `nonequilibrium` the
    /// non-equilibrium part of the cell's populations is also passed on, which damps less.
    Outlet { outward: [i8; 3], drho: L, nonequilibrium: bool },
}

/// Density less 1 beyond an outlet that lets sound leave: that of an outgoing plane wave that changes the mean outward velocity
/// from `target` to `mean`, both in cells per step: drho = (mean - target)/c_s, c_s = 1/sqrt(3).
/// Differs: at constant density the box between inlet and outlet is a resonator, whose standing wave lasts for thousands of steps
/// and is as strong as the wind.
pub(super) fn outlet_density<L: Lane>(target: L, mean: L) -> L {
    (mean - target) * mean.splat(SQRT_3)
}

/// Density and velocity of the air at a ghost node, from which its populations are computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct GhostState<L> {
    drho: L,
    velocity: [L; 3],
    /// Density less 1 and velocity of the cell before it, if its non-equilibrium part is passed on.
    nonequilibrium: Option<(L, [L; 3])>,
    /// Shear of the inflow along x and z, as in [`shear_nonequilibrium_population`]; none at an outlet.
    shear: Option<[L; 2]>,
}

impl<L: Lane> GhostState<L> {
    /// `drho`, `u`: density less 1 and velocity of the cell before it; 0 if that is solid.
    #[inline(always)]
    pub(super) fn new(drho: L, mut u: [L; 3], condition: GhostCondition<L>) -> Self {
        // An inlet prescribes the velocity and takes the density from inside; an outlet prescribes the density and takes the
        // velocity from inside.
        match condition {
            GhostCondition::Inlet { velocity, shear } => {
                Self { drho, velocity, nonequilibrium: None, shear: Some(shear) }
            }
            GhostCondition::Outlet { outward, drho: outlet_drho, nonequilibrium } => {
                let nonequilibrium = if nonequilibrium { Some((drho, u)) } else { None };
                for a in 0..3 {
                    if outward[a] != 0 {
                        // No backflow: a vortex that crosses the outlet must not draw in air of unknown state.
                        let outflow = u[a] * u[a].splat(f64::from(outward[a]));
                        u[a] = outflow.select_gt(0.0, u[a], u[a].splat(0.0));
                    }
                }
                Self { drho: outlet_drho, velocity: u, nonequilibrium, shear: None }
            }
        }
    }

    /// The population that the ghost node sends in direction `i`. `cell_population`: the one that left the cell before
    /// it in that direction.
    #[inline(always)]
    pub(super) fn population_sent(&self, i: usize, cell_population: L) -> L {
        let sent = equilibrium(i, self.drho, self.velocity);
        // Equilibrium, plus the non-equilibrium part: copied from the cell (outlet), or of the profile's shear
        // (inlet).
        match (self.nonequilibrium, self.shear) {
            (Some((drho, u)), _) => sent + (cell_population - equilibrium(i, drho, u)),
            (None, Some(shear)) => sent + shear_nonequilibrium_population(i, shear),
            (None, None) => sent,
        }
    }
}

/// Consecutive ghost nodes before the same plane with the same condition.
#[derive(Debug)]
struct GhostRun {
    first: usize,
    count: usize,
    /// Directions in which at least one of the nodes sends.
    directions: u16,
    /// Outward normal; `None` for an inlet.
    outward: Option<[i8; 3]>,
    before_solid: bool,
    /// Index of the run's first node among all inlet nodes.
    first_inlet: usize,
    /// Open cell of the run's first node, if the open cells of the other nodes are consecutive.
    first_open_cell: Option<u32>,
}

/// Positions of the populations of a ghost node in the buffer of ghost populations.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GhostSlots {
    /// Index of the node's population in its first direction.
    first: usize,
    /// Distance from the population of one direction to that of the next.
    stride: usize,
    directions: u16,
}

impl GhostSlots {
    /// Index of the population in a direction.
    pub(super) fn buffer_index_of(self, direction: usize) -> usize {
        self.first + self.stride * (self.directions & ((1 << direction) - 1)).count_ones() as usize
    }
}

/// Parts of a plane: its runs, and its range of the buffer of ghost populations.
#[derive(Debug, Clone)]
struct PlaneGhostRanges {
    runs: Range<usize>,
    buffer: Range<usize>,
}

/// Ghost nodes of all open faces, in runs of one condition, and the cells before outlets.
#[derive(Debug)]
pub(super) struct OpenBoundary {
    ghosts: Vec<GhostNode>,
    runs: Vec<GhostRun>,
    planes: Vec<PlaneGhostRanges>,
    /// Per face that is an outlet: the open cells before it.
    outlet_cells: [Vec<u32>; 6],
}

/// Inputs of the ghost nodes in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct GhostInputs<'a> {
    /// Density less 1 and velocity by component of the open cells, beginning with `first_cell`.
    pub moments: [&'a [f32]; 4],
    pub first_cell: usize,
    /// Populations of these cells, where outlets pass on the non-equilibrium part.
    pub populations: Option<&'a [[f32; Q]]>,
    /// Velocity by component at each inlet node, cells per step, in the order of [`OpenBoundary::inlet_positions`].
    pub inlet_velocity: &'a [Vec<f32>; 3],
    /// [`super::ground::shear_coefficient`] at each inlet node, and the wind's components along x and z that scale it.
    pub shear: &'a [f32],
    pub shear_scale: [f32; 2],
    /// Density less 1 beyond each face that is an outlet.
    pub outlet_drho: [f32; 6],
}

impl GhostNode {
    /// The plane of cells before which it lies.
    #[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "sizes fit; clamped to the domain")]
    pub(super) fn adjacent_plane(&self, planes: usize) -> usize {
        self.position[2].clamp(0, planes as isize - 1) as usize
    }
}

impl OpenBoundary {
    /// `ghosts`: nodes by plane, with nodes of the same condition adjacent. Also returns the slots of each node's
    /// populations.
    /// # Errors
    /// `Limit` for more nodes than an index of 32 bits counts.
    pub(super) fn new(ghosts: Vec<GhostNode>, planes: usize) -> Result<(Self, Vec<GhostSlots>)> {
        // Join adjacent nodes of the same condition to runs, which are evaluated in SIMD lanes if their open cells are
        // contiguous.
        let mut runs: Vec<GhostRun> = Vec::new();
        let mut outlet_cells: [Vec<u32>; 6] = std::array::from_fn(|_| Vec::new());
        let (mut inlets, mut last) = (0, None);
        for (first, g) in ghosts.iter().enumerate() {
            let outward = (!g.inlet).then_some(g.outward);
            let key = Some((g.adjacent_plane(planes), outward, g.before_solid));
            if let Some(run) = runs.last_mut().filter(|l| key == last && l.count < MAX_RUN_NODES) {
                let count = index(run.count, "ghost nodes of the lattice wind")?;
                run.first_open_cell = run.first_open_cell.filter(|cell| cell + count == g.open_cell);
                (run.count, run.directions) = (run.count + 1, run.directions | g.directions);
            } else {
                runs.push(GhostRun {
                    first,
                    count: 1,
                    directions: g.directions,
                    outward,
                    before_solid: g.before_solid,
                    first_inlet: inlets,
                    first_open_cell: Some(g.open_cell),
                });
            }
            last = key;
            inlets += usize::from(g.inlet);
            if let Some(face) = g.face.filter(|_| !g.inlet && !g.before_solid) {
                outlet_cells[face].push(g.open_cell);
            }
        }
        // Lay out the buffer plane by plane, run by run, direction by direction.
        let mut parts = Vec::with_capacity(planes);
        let (mut slots, mut at, mut number) = (Vec::new(), 0, 0);
        for z in 0..planes {
            let (first_run, first_index) = (number, at);
            while let Some(g) = runs.get(number).filter(|g| ghosts[g.first].adjacent_plane(planes) == z) {
                slots.extend((0..g.count).map(|k| GhostSlots {
                    first: at + k,
                    stride: g.count,
                    directions: g.directions,
                }));
                (at, number) = (at + g.buffer_len(), number + 1);
            }
            parts.push(PlaneGhostRanges { runs: first_run..number, buffer: first_index..at });
        }
        Ok((Self { ghosts, runs, planes: parts, outlet_cells }, slots))
    }

    /// Positions of the inlet nodes, in the order of [`GhostInputs::inlet_velocity`].
    pub(super) fn inlet_positions(&self) -> Vec<[isize; 3]> {
        self.ghosts.iter().filter(|g| g.inlet).map(|g| g.position).collect()
    }

    /// Position and face of the nodes beyond exactly one open face whose nearest cell is air.
    pub(super) fn single_face_nodes(&self) -> impl Iterator<Item = ([isize; 3], usize)> {
        self.ghosts.iter().filter(|g| !g.before_solid).filter_map(|g| Some((g.position, g.face?)))
    }

    /// Mean outward velocity of the cells before each outlet, cells per step; 0 for other faces.
    pub(super) fn mean_outward_velocities(&self, moments: &[Vec<f32>; 4]) -> [f32; 6] {
        // Moments are density, then velocity by component: 1 + f/2 is the component normal to face f.
        std::array::from_fn(|f| {
            let cells = &self.outlet_cells[f];
            let sum: f64 = cells.iter().map(|n| f64::from(moments[1 + f / 2][to_usize(*n)])).sum();
            let out = if f.is_multiple_of(2) { -1.0 } else { 1.0 };
            if cells.is_empty() { 0.0 } else { osier_base::math::narrow(out * sum / cells.len() as f64) }
        })
    }

    /// The range of the buffer that the ghost nodes before plane `z` fill.
    pub(super) fn buffer_range(&self, z: usize) -> Range<usize> {
        self.planes[z].buffer.clone()
    }

    /// Length of the buffer of ghost populations.
    pub(super) fn buffer_len(&self) -> usize {
        self.planes.last().map_or(0, |plane| plane.buffer.end)
    }

    /// Computes the populations that ghost nodes before plane `z` send, into the plane's range of the buffer.
    #[inline(always)]
    pub(super) fn compute_plane_ghosts<S: Simd>(&self, simd: S, z: usize, state: GhostInputs<'_>, mut out: &mut [f32]) {
        for run in &self.runs[self.planes[z].runs.clone()] {
            // Groups fill the plane's range one after the other.
            let (own, others) = std::mem::take(&mut out).split_at_mut(run.buffer_len());
            let ghosts = &self.ghosts[run.first..run.first + run.count];
            run.compute_populations(simd, ghosts, state, own);
            out = others;
        }
    }

    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.ghosts)
    }
}

impl GhostRun {
    fn buffer_len(&self) -> usize {
        self.count * self.directions.count_ones() as usize
    }

    #[inline(always)]
    fn compute_populations<S: Simd>(&self, simd: S, ghosts: &[GhostNode], state: GhostInputs<'_>, out: &mut [f32]) {
        // SIMD needs contiguous open cells, at least one full register of them, and no per-cell populations.
        match self.first_open_cell.filter(|_| self.count >= S::F32_LANES && state.populations.is_none()) {
            Some(first) => self.compute_populations_simd(simd, to_usize(first), state, out),
            None => self.compute_populations_scalar(ghosts, state, out),
        }
    }

    /// Computes the populations in SIMD lanes, for contiguous open cells.
    #[inline(always)]
    fn compute_populations_simd<S: Simd>(&self, simd: S, open_cell: usize, state: GhostInputs<'_>, out: &mut [f32]) {
        let load = |from: &[f32]| F32Lanes::new(simd, S::as_simd_f32s(&from[..S::F32_LANES]).0[0]);
        // The same conditions as `compute_populations_scalar`, one register of ghosts at a time.
        let mut from = 0;
        while from < self.count {
            // The last register overlaps the previous one, so that it is full.
            let at = from.min(self.count - S::F32_LANES);
            from += S::F32_LANES;
            let condition = match self.outward {
                None => {
                    let [x, y, z] = state.inlet_velocity;
                    let inlet = self.first_inlet + at;
                    let shear = load(&state.shear[inlet..]);
                    let shear = state.shear_scale.map(|scale| shear * F32Lanes::from_scalar(simd, scale));
                    GhostCondition::Inlet { velocity: [load(&x[inlet..]), load(&y[inlet..]), load(&z[inlet..])], shear }
                }
                Some(outward) => {
                    let drho = F32Lanes::from_scalar(simd, mean_over_adjoining_outlets(outward, state.outlet_drho));
                    GhostCondition::Outlet { outward, drho, nonequilibrium: false }
                }
            };
            let ([drho, x, y, z], first) = (state.moments, open_cell - state.first_cell + at);
            let cell = if self.before_solid {
                [F32Lanes::from_scalar(simd, 0.0); 4]
            } else {
                [load(&drho[first..]), load(&x[first..]), load(&y[first..]), load(&z[first..])]
            };
            let ghost = GhostState::new(cell[0], [cell[1], cell[2], cell[3]], condition);
            let mut to = at;
            // Only directions into the domain are stored, side by side: index in the run first, direction second.
            for i in 1..Q {
                if self.directions >> i & 1 == 1 {
                    let sent = ghost.population_sent(i, F32Lanes::from_scalar(simd, 0.0));
                    S::as_mut_simd_f32s(&mut out[to..to + S::F32_LANES]).0[0] = sent.value;
                    to += self.count;
                }
            }
        }
    }

    /// Computes the populations node by node, for short runs, scattered open cells, and outlets with a non-equilibrium
    /// part.
    fn compute_populations_scalar(&self, ghosts: &[GhostNode], state: GhostInputs<'_>, out: &mut [f32]) {
        let populations = state.populations.filter(|_| !self.before_solid);
        for (k, ghost) in ghosts.iter().enumerate() {
            let cell = to_usize(ghost.open_cell).wrapping_sub(state.first_cell);
            let moments = if self.before_solid { [0.0; 4] } else { state.moments.map(|a| a[cell]) };
            let condition = match self.outward {
                None => {
                    let inlet = self.first_inlet + k;
                    let shear = state.shear_scale.map(|scale| scale * state.shear[inlet]);
                    GhostCondition::Inlet { velocity: [0, 1, 2].map(|a| state.inlet_velocity[a][inlet]), shear }
                }
                Some(outward) => GhostCondition::Outlet {
                    outward,
                    drho: mean_over_adjoining_outlets(outward, state.outlet_drho),
                    nonequilibrium: populations.is_some(),
                },
            };
            let ghost = GhostState::new(moments[0], [moments[1], moments[2], moments[3]], condition);
            let directions = (1..Q).filter(|i| self.directions >> i & 1 == 1);
            for (nth, i) in directions.enumerate() {
                out[nth * self.count + k] = ghost.population_sent(i, populations.map_or(0.0, |all| all[cell][i]));
            }
        }
    }
}

/// Mean of a value by face over the outlets beyond which a node lies; 0 without outlets.
pub(super) fn mean_over_adjoining_outlets<L: Lane>(outward: [i8; 3], values: [L; 6]) -> L {
    // Beyond an edge of two outlets, use the mean of both.
    let (mut sum, mut count) = (values[0].splat(0.0), 0.0);
    for (a, side) in outward.iter().enumerate().filter(|(_, side)| **side != 0) {
        sum = sum + values[2 * a + usize::from(*side > 0)];
        count += 1.0;
    }
    if count > 0.0 { sum.div(sum.splat(count)) } else { sum }
}
