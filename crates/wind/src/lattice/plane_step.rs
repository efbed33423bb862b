//! One step of one plane of cells: scatter the populations that arrive from boundaries, collide, gather those that leave for
//! them.

use pulp::Simd;

use super::collide::{CollisionResult, MAX_SPEED, Relaxation, UNCHECKED_SPEED, collide, moments};
use super::diagnostics::{PlaneDiagnostics, SnapshotPlane};
use super::domain::Domain;
use super::exchange::{ExchangeOutput, IncomingPopulations, PopulationPlanes};
use super::grid::{BLOCK, LatticeGrid, StepParity};
use super::ground::apply_wall_stress;
use super::row_ends::{NO_LANE, RowEndLanes, RowEndPopulations};
use super::stencil::{Q, opposite};
use super::step_tables::StepTables;
use osier_base::convert::to_usize;
use osier_base::simd::{F32Lanes, Lane as _};

/// Buffers that a thread reuses from plane to plane, and the planes of a snapshot that it writes.
pub(super) struct ThreadScratch<'a> {
    row_ends: RowEndPopulations,
    /// Velocity by component and density less 1 of a plane, while its snapshot is written.
    moments: [Vec<f32>; 4],
    /// Planes of the snapshot by number, in descending order; empty if none is written.
    snapshot: Vec<(usize, SnapshotPlane<'a>)>,
    /// Diagnostics of the written planes.
    pub diagnostics: Vec<(usize, PlaneDiagnostics)>,
}

impl<'a> ThreadScratch<'a> {
    /// `snapshot`: planes by number, in descending order.
    pub(super) fn new(grid: &LatticeGrid, snapshot: Vec<(usize, SnapshotPlane<'a>)>) -> Self {
        // The moment buffers are needed only by threads that write part of a snapshot.
        let length = if snapshot.is_empty() { 0 } else { grid.plane_span().next_multiple_of(BLOCK) };
        Self {
            row_ends: RowEndPopulations::new(grid),
            moments: std::array::from_fn(|_| vec![0.0; length]),
            snapshot,
            diagnostics: Vec::new(),
        }
    }

    /// Whether the plane `z` is the next of the snapshot.
    #[inline(always)]
    fn is_next_snapshot_plane(&self, z: usize) -> bool {
        self.snapshot.last().is_some_and(|(plane, _)| *plane == z)
    }

    /// Writes the moments of the plane `z` into the snapshot, if the snapshot has this plane.
    #[inline(always)]
    fn write_snapshot_plane(&mut self, domain: &Domain, z: usize) {
        let Some((_, mut target)) = self.snapshot.pop_if(|(plane, _)| *plane == z) else { return };
        let (row, [nx, ny, _]) = (domain.grid.row_stride, domain.grid.n);
        let mut diagnostics = PlaneDiagnostics::default();
        // Copy rows out of the padded buffer without their halo nodes.
        for y in 0..ny {
            let moments = self.moments.each_mut().map(|all| &mut all[y * row..y * row + nx]);
            diagnostics.add_and_store_row(domain, y, z, moments, Some(&mut target));
        }
        target.fill_halo_rows();
        self.diagnostics.push((z, diagnostics));
    }
}

/// One step of the plane `z`, with the tables and boundary populations that it reads.
#[derive(Clone, Copy)]
pub(super) struct PlaneStep<'a> {
    pub tables: &'a StepTables,
    pub domain: &'a Domain,
    pub input: IncomingPopulations<'a>,
    pub z: usize,
    /// Whether this is the last step of the pass, whose moments are written to a snapshot if one is due.
    pub last: bool,
}

struct PlaneSpeedStats {
    /// Square of the highest speed, cells per step.
    max_squared: f32,
    /// Fluid cells whose speed was clamped.
    clamped: u64,
}

/// Binds the fifteen arrays of a plane to names, as slices of SIMD registers of a length that the compiler can prove, so that it
/// removes bounds checks from the loop.
macro_rules! bind_arrays {
    ($simd:ty, $arrays:expr, $start:expr, $length:expr; $($name:ident $k:literal)*) => {
        let [$($name),*] = $arrays else { return PlaneSpeedStats { max_squared: 0.0, clamped: 0 } };
        let count = $length / <$simd>::F32_LANES;
        $(let $name = &mut <$simd>::as_mut_simd_f32s(&mut $name[$start($k)..][..$length]).0[..count];)*
    };
}

impl PlaneStep<'_> {
    /// Computes the step. `max_speed_squared`: square of the highest speed of the plane in the previous step; replaced by that of
    /// this step. Returns the number of clamped cells.
    #[inline(always)]
    pub(super) fn scatter_collide_gather<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool>(
        self,
        simd: S,
        planes: &mut PopulationPlanes<'_>,
        scratch: &mut ThreadScratch<'_>,
        output: &mut ExchangeOutput<'_>,
        max_speed_squared: &mut f32,
    ) -> u64 {
        let parity = if ODD { StepParity::Odd } else { StepParity::Even };
        // Boundary populations of this plane enter their halo slots before any cell of it is read.
        self.input.scatter_incoming(planes, &mut scratch.row_ends, parity, self.z);
        // Limiting speeds or writing moments within the kernel costs a tenth of its time: a second kernel does both, if a
        // snapshot is taken or a speed near the limit occurred in the previous step.
        let writes = self.last && scratch.is_next_snapshot_plane(self.z);
        let speed = if writes || f64::from(*max_speed_squared) > UNCHECKED_SPEED * UNCHECKED_SPEED {
            self.collide_plane::<S, ODD, EDDIES, FORCE, true>(simd, planes, scratch, output)
        } else {
            self.collide_plane::<S, ODD, EDDIES, FORCE, false>(simd, planes, scratch, output)
        };
        *max_speed_squared = speed.max_squared;
        // The moments are those after the last step of the pass. Then gather the populations that the boundaries of the plane
        // need next.
        if self.last {
            scratch.write_snapshot_plane(self.domain, self.z);
        }
        self.input.gather_outgoing(planes, parity, self.z, output);
        self.store_open_span_moments(simd, planes, parity, output);
        speed.clamped
    }

    /// Collides all blocks of the plane that contain air. `CHECKED`: with the speed limit, and moments for a snapshot.
    #[inline(always)]
    fn collide_plane<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool, const CHECKED: bool>(
        self,
        simd: S,
        planes: &mut PopulationPlanes<'_>,
        scratch: &mut ThreadScratch<'_>,
        output: &mut ExchangeOutput<'_>,
    ) -> PlaneSpeedStats {
        let Self { tables, domain, z, .. } = self;
        let writes = CHECKED && self.last && scratch.is_next_snapshot_plane(z);
        let ThreadScratch { row_ends, moments, .. } = scratch;
        let grid = &tables.grid;
        let length = grid.plane_span().next_multiple_of(BLOCK);
        let first = planes.plane_start(grid, z) + grid.first_cell;
        let parity = if ODD { StepParity::Odd } else { StepParity::Even };
        // Shifting each array's slice by its slot offset allows one index for all arrays, for reading and writing.
        let start = |k: usize| first.wrapping_add_signed(grid.slot_offset(parity, k));
        let (mut max_squared, mut clamped) = (F32Lanes::from_scalar(simd, 0.0), 0);
        let registers_per_block = BLOCK / S::F32_LANES;
        let params = &tables.params;
        let z_sponge = F32Lanes::from_scalar(simd, params.sponge[1].get(z).copied().unwrap_or(0.0));
        // Relaxation of blocks outside sponges and ground layer, where tau is the same everywhere.
        let uniform = Relaxation::new(
            F32Lanes::from_scalar(simd, params.tau),
            F32Lanes::from_scalar(simd, params.smagorinsky_factor),
            [
                F32Lanes::from_scalar(simd, params.force[0]),
                F32Lanes::from_scalar(simd, params.force[1]),
                F32Lanes::from_scalar(simd, params.force[2]),
            ],
        );
        // The arrays of this plane as registers: block b of every array belongs to the same nodes.
        bind_arrays!(S, planes.arrays.as_mut_slice(), start, length;
            a0 0 a1 1 a2 2 a3 3 a4 4 a5 5 a6 6 a7 7 a8 8 a9 9 a10 10 a11 11 a12 12 a13 13 a14 14);
        let registers = length / S::F32_LANES;
        // Nodes below this index belong to the lowest row, on which rough ground exerts drag.
        let drag_end = tables.drag.len().saturating_sub(BLOCK);
        let mut snapshot = if writes {
            let [x, y, z, drho] =
                moments.each_mut().map(|all| &mut S::as_mut_simd_f32s(&mut all[..length]).0[..registers]);
            Some((x, y, z, drho))
        } else {
            None
        };
        // The list of row ends is sorted by block; `next` advances in it with the blocks.
        let mut next = 0;
        for range in tables.air_block_ranges(z) {
            let mut relaxation = uniform;
            let from = to_usize(range.from) * registers_per_block;
            let to = (to_usize(range.to) * registers_per_block).min(registers);
            // Skip row ends before this range; the sentinel at the end of the list matches no block.
            next += tables.row_ends[next..].iter().take_while(|end| end.block < from).count();
            let mut next_end = tables.row_ends[next].block;
            for b in from..to {
                let node = b * S::F32_LANES;
                // tau = max(base tau, tau + sponge in z times its tau).
                if range.variable_tau {
                    let base = load_lanes(simd, &tables.base_tau, node);
                    let sponge = load_lanes(simd, &tables.sponge_tau, node);
                    relaxation = uniform.with_tau(base.max(z_sponge.mul_add(sponge, uniform.tau)));
                }
                // AA pattern (see `StepParity`): before an odd step, populations lie in the slot of the opposite direction.
                let read = [
                    a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b],
                    a13[b], a14[b],
                ];
                let mut g = [relaxation.tau; Q];
                for i in 0..Q {
                    g[i] = F32Lanes::new(simd, read[if ODD { opposite(i) } else { i }]);
                }
                // Insert the populations that arrive through faces -x and +x, which are in the row halo, not in the arrays.
                if b == next_end {
                    for end in tables.row_ends[next..].iter().take_while(|end| end.block == b) {
                        row_ends.insert_into_lanes(simd, *end, &mut g);
                    }
                }
                // In the lowest row over rough ground, subtract the wall stress from the populations before they collide.
                if node < drag_end {
                    let (drag, sponge) =
                        (load_lanes(simd, &tables.drag, node), load_lanes(simd, &tables.drag_sponge, node));
                    let sponge_drag = sponge.max(z_sponge) * F32Lanes::from_scalar(simd, params.ground.sponge_drag);
                    apply_wall_stress(&mut g, drag, sponge_drag);
                }
                let limit = if CHECKED { MAX_SPEED * MAX_SPEED } else { f64::INFINITY };
                let result = collide::<_, EDDIES, FORCE>(&g, relaxation, limit);
                max_squared = max_squared.max(result.speed_squared);
                if CHECKED && result.speed_squared.any_gt(MAX_SPEED * MAX_SPEED) {
                    clamped +=
                        count_clamped_cells(domain, &lanes_to_array(result.speed_squared)[..S::F32_LANES], node, z);
                }
                // Write to the slots that were read: in an even step to the opposite array, in an odd one to the same array.
                let mut written = [result.g[0].value; Q];
                for i in 0..Q {
                    written[if ODD { i } else { opposite(i) }] = result.g[i].value;
                }
                [
                    a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b],
                    a13[b], a14[b],
                ] = written;
                if CHECKED && let Some((x, y, z, drho)) = &mut snapshot {
                    (x[b], y[b], z[b], drho[b]) =
                        (result.u[0].value, result.u[1].value, result.u[2].value, result.drho.value);
                }
                // Store the moments of open cells in columns at the ends of rows.
                if b == next_end {
                    while next_end == b {
                        self.store_row_end_moments(tables.row_ends[next], &result, output);
                        next += 1;
                        next_end = tables.row_ends[next].block;
                    }
                }
            }
        }
        PlaneSpeedStats { max_squared: lanes_to_array(max_squared).into_iter().fold(0.0, f32::max), clamped }
    }

    /// Stores the moments of the open cells at the ends of a row, from the registers of their block.
    #[inline(always)]
    fn store_row_end_moments<S: Simd>(
        self,
        end: RowEndLanes,
        result: &CollisionResult<F32Lanes<S>>,
        output: &mut ExchangeOutput<'_>,
    ) {
        let lists = self.input.lists;
        // Column 0 contains the first cells of the rows, column 1 the last; an end in another block has no lane here.
        for (column, lane) in lists.planes[self.z].columns.into_iter().zip(end.lanes) {
            let Some(column) = column.filter(|_| lane != NO_LANE) else { continue };
            let (lane, number) = (to_usize(lane), column + to_usize(end.y) - output.first_cell);
            let moments = [result.drho, result.u[0], result.u[1], result.u[2]];
            for (to, from) in output.moments.iter_mut().zip(moments) {
                to[number] = lanes_to_array(from)[lane];
            }
            if lists.nonequilibrium {
                for (to, from) in output.cell_populations[number].iter_mut().zip(&result.g) {
                    *to = lanes_to_array(*from)[lane];
                }
            }
        }
    }

    /// Stores the moments of the other open cells, from the populations that left them.
    #[inline(always)]
    fn store_open_span_moments<S: Simd>(
        self,
        simd: S,
        planes: &PopulationPlanes<'_>,
        parity: StepParity,
        output: &mut ExchangeOutput<'_>,
    ) {
        let lists = self.input.lists;
        let links = &lists.planes[self.z];
        // Open cells at the other faces lie in spans, not in the columns: gather their populations, then take the
        // moments in SIMD lanes.
        let mut number = links.first_open_span_cell(lists.grid.n[1]) - output.first_cell;
        for span in &lists.open_spans[links.open_spans.clone()] {
            for skip in (0..to_usize(span.count)).step_by(BLOCK) {
                let count = BLOCK.min(to_usize(span.count) - skip);
                let mut g = [[0.0_f32; BLOCK]; Q];
                self.input.gather_open_boundary_populations(planes, parity, self.z, *span, skip, &mut g);
                for register in 0..count.div_ceil(S::F32_LANES) {
                    let from = register * S::F32_LANES;
                    let mut lanes = [F32Lanes::from_scalar(simd, 0.0); Q];
                    for i in 0..Q {
                        lanes[i] = load_lanes(simd, &g[i], from);
                    }
                    // The last register of a span may be partly filled: only its used lanes are stored.
                    let (drho, u) = moments(&lanes);
                    let used = S::F32_LANES.min(count - from);
                    for (to, value) in output.moments.iter_mut().zip([drho, u[0], u[1], u[2]]) {
                        to[number + from..][..used].copy_from_slice(&lanes_to_array(value)[..used]);
                    }
                }
                if lists.nonequilibrium {
                    for (k, to) in output.cell_populations[number..number + count].iter_mut().enumerate() {
                        to.iter_mut().zip(&g).for_each(|(to, from)| *to = from[k]);
                    }
                }
                number += count;
            }
        }
    }
}

#[inline(always)]
fn load_lanes<S: Simd>(simd: S, from: &[f32], at: usize) -> F32Lanes<S> {
    F32Lanes::new(simd, S::as_simd_f32s(&from[at..at + S::F32_LANES]).0[0])
}

/// Copies the lanes of a register to the first elements of an array.
#[inline(always)]
fn lanes_to_array<S: Simd>(value: F32Lanes<S>) -> [f32; BLOCK] {
    let mut numbers = [0.0; BLOCK];
    S::as_mut_simd_f32s(&mut numbers).0[0] = value.value;
    numbers
}

/// Fluid cells among consecutive nodes whose squared speed is above the limit. `first`: the first node's number in its
/// plane, counted from the first cell.
#[cold]
#[inline(never)]
fn count_clamped_cells(domain: &Domain, speeds_squared: &[f32], first: usize, z: usize) -> u64 {
    let limit = osier_base::math::narrow(MAX_SPEED * MAX_SPEED);
    let (row, [nx, ny, _]) = (domain.grid.row_stride, domain.grid.n);
    let is_clamped = |(k, squared): (usize, &f32)| {
        let (x, y) = ((first + k) % row, (first + k) / row);
        *squared > limit && x < nx && y < ny && !domain.is_solid([x, y, z])
    };
    speeds_squared.iter().enumerate().filter(|s| is_clamped(*s)).count() as u64
}
