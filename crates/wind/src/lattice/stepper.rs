//! Steps of the whole domain: two time steps per pass over memory, several threads.
//!
//! An even step and the odd one after it go through the domain together, the odd one a plane behind, where it finds its
//! populations in the cache: memory is read and written once for two steps. The odd step of a plane needs the even step of the
//! adjacent planes, the next of which has just been done. Each thread has a chunk of planes; the odd steps of the two planes at
//! each seam between chunks need planes of both, and follow when all threads have finished.
//!
//! ```text
//!  plane     0   1   2   3   4   5 │ 6   7   8   9  10  11        chunks of two threads, one seam
//!
//!  even      a   b   c   d   e   f │ a   b   c   d   e   f        a: first, b: second, ... in each thread
//!  odd       ·   c'  d'  e'  f'  · │ ·   c'  d'  e'  f'  ·        c': right after c, from even steps a, b, c
//!  seams     s                   s   s                   s        s: odd steps, after all threads have met
//!
//!  of one plane z, either step:
//!    buffer of the step before ──scatter──►┐
//!    ghosts from open cells    ──scatter──►├─► halo slots of z ──collide──► slots of z ──gather──► buffer for the next step
//!                                          └─► row halo
//!                                                          open cells: moments ──► ghosts of the odd step of z
//! ```
//!
//! The even step of a plane fills the buffers (`intermediate`) that its odd step and its neighbours' read: this halo
//! exchange is what lets walls, solids, inlets and outlets take part in the shared pass.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::diagnostics::{FlowDiagnostics, PlaneDiagnostics, SnapshotPlane, SnapshotTarget};
use super::domain::Domain;
use super::exchange::{
    BoundaryExchange, BufferSlice, ExchangeBuffers, ExchangeLists, ExchangeOutput, IncomingPopulations,
    PopulationPlanes, split_at_ranges,
};
use super::grid::{Populations, StepParity};
use super::open_boundary::{GhostInputs, OpenBoundary, outlet_density};
use super::plane_step::{PlaneStep, ThreadScratch};
use super::stencil::Q;
use super::step_tables::StepTables;
use osier_base::par;

/// Least number of planes of a chunk: two at each seam.
const MIN_CHUNK: usize = 4;

/// Conditions at the open faces in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoundaryInputs<'a> {
    /// Velocity by component at each inlet node, cells per step, in the order of [`OpenBoundary::inlet_positions`].
    pub inlet_velocity: &'a [Vec<f32>; 3],
    /// As in [`GhostInputs`].
    pub shear: &'a [f32],
    pub shear_scale: [f32; 2],
    /// Target of the mean outward velocity at each face that is an outlet, cells per step.
    pub outlet_velocity: [f32; 6],
}

/// Inputs of one pass over the lattice, which does one step, or an even and an odd one.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepContext<'a> {
    pub tables: &'a StepTables,
    pub domain: &'a Domain,
    /// Parity of the first step.
    pub parity: StepParity,
    pub first: BoundaryInputs<'a>,
    /// Inputs of the odd step that is done in the same pass, with an even `parity`.
    pub second: Option<BoundaryInputs<'a>>,
}

/// Clamped cells of a pass of one or two steps, and diagnostics if it wrote a snapshot.
#[derive(Debug)]
pub(super) struct PassReport {
    /// Clamped cells of the first step and of the second.
    pub clamped: [u64; 2],
    /// Diagnostics of the planes if the pass wrote a snapshot; else empty.
    pub diagnostics: FlowDiagnostics,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PassKind {
    Even,
    Odd,
    EvenAndOdd,
}

/// Planes of the snapshot that are not assigned to a thread yet, by number.
type SnapshotPlanes<'a> = Vec<(usize, SnapshotPlane<'a>)>;

impl StepContext<'_> {
    fn pass_kind(&self) -> PassKind {
        match (self.parity, self.second) {
            (StepParity::Odd, _) => PassKind::Odd,
            (StepParity::Even, None) => PassKind::Even,
            (StepParity::Even, Some(_)) => PassKind::EvenAndOdd,
        }
    }

    /// Does the step or steps. `snapshot`: destination of the moments of the last step.
    pub(super) fn run_pass(
        &self,
        populations: &mut Populations,
        exchange: &mut BoundaryExchange,
        snapshot: Option<SnapshotTarget<'_>>,
    ) -> PassReport {
        let kind = self.pass_kind();
        // Outlet densities follow from the mean outflow, measured again before every even step.
        if self.parity == StepParity::Even {
            exchange.mean_outward_velocities =
                exchange.open_boundary.mean_outward_velocities(&exchange.previous.open_cells.moments);
        }
        // Compute the ghosts first, because they read the moments of the previous step; then the chunks, and last the seams,
        // which need the even steps of all chunks.
        self.compute_ghosts(exchange);
        let bounds = self.chunk_bounds();
        let mut snapshot: SnapshotPlanes<'_> =
            snapshot.map_or_else(Vec::new, SnapshotTarget::split_planes).into_iter().enumerate().collect();
        let mut results = self.run_chunks(populations, exchange, &bounds, &mut snapshot);
        if kind != PassKind::Even {
            results.extend(self.run_seams(populations, exchange, &bounds, &mut snapshot));
        }
        std::mem::swap(&mut exchange.previous, &mut exchange.next);
        // Sum the counts of all chunks, for even and odd steps; a single odd step is the first.
        let clamped = [0, 1].map(|k| results.iter().map(|r| r.clamped[k]).sum());
        let clamped = if kind == PassKind::Odd { [clamped[1], 0] } else { clamped };
        let mut planes: Vec<_> = results.into_iter().flat_map(|r| r.diagnostics).collect();
        planes.sort_by_key(|(z, _)| *z);
        let diagnostics = FlowDiagnostics { planes: planes.into_iter().map(|(_, plane)| plane).collect() };
        PassReport { clamped, diagnostics }
    }

    /// Computes the ghost populations of the first step.
    fn compute_ghosts(&self, exchange: &mut BoundaryExchange) {
        let (open_boundary, open_cells) = (&exchange.open_boundary, &exchange.previous.open_cells);
        // The first step's ghosts read the open cells of the previous pass.
        let state = GhostInputs {
            moments: open_cells.moments.each_ref().map(|a| &a[..]),
            first_cell: 0,
            populations: exchange.lists.nonequilibrium.then_some(&open_cells.populations[..]),
            inlet_velocity: self.first.inlet_velocity,
            shear: self.first.shear,
            shear_scale: self.first.shear_scale,
            outlet_drho: self.first.outlet_densities(exchange.mean_outward_velocities),
        };
        let ranges: Vec<_> = (0..self.tables.grid.n[2]).map(|z| open_boundary.buffer_range(z)).collect();
        let mut planes: Vec<_> =
            split_at_ranges(&mut exchange.ghost_populations[0], &ranges).into_iter().enumerate().collect();
        planes.retain(|(_, out)| !out.is_empty());
        // Each plane's ghosts fill a separate range, so that planes are independent.
        par::par_each(&mut planes, |(z, out)| {
            self.tables.arch.dispatch(GhostKernel { open_boundary, z: *z, state, out });
        });
    }

    /// First planes of the chunks, and the number of planes.
    fn chunk_bounds(&self) -> Vec<usize> {
        let n = self.tables.grid.n[2];
        // One chunk per thread, unless chunks would be shorter than two seams.
        let count = par::threads().min(n / MIN_CHUNK).max(1);
        (0..=count).map(|k| k * n / count).collect()
    }

    /// Slices of all arrays for ranges of planes, each extended by `margin` planes on both sides.
    fn plane_slices<'a>(
        &self,
        populations: &'a mut Populations,
        ranges: &[Range<usize>],
        margin: usize,
    ) -> Vec<PopulationPlanes<'a>> {
        let stride = self.tables.grid.plane_stride;
        // The halo plane -1 is the first of an array.
        let ranges: Vec<_> = ranges.iter().map(|r| r.start + 1 - margin..r.end + 1 + margin).collect();
        let elements: Vec<_> = ranges.iter().map(|r| r.start * stride..r.end * stride).collect();
        let slices = |r: &Range<usize>| PopulationPlanes { arrays: Vec::with_capacity(Q), first_plane: r.start };
        let mut planes: Vec<_> = ranges.iter().map(slices).collect();
        // Borrow disjoint planes of all fifteen arrays, so that threads need no locks.
        for array in populations.arrays_mut() {
            let parts = split_at_ranges(array, &elements);
            planes.iter_mut().zip(parts).for_each(|(planes, part)| planes.arrays.push(part));
        }
        planes
    }

    /// In every chunk: does the even step of all planes, and the odd step of the planes that no other chunk touches.
    fn run_chunks(
        &self,
        populations: &mut Populations,
        exchange: &mut BoundaryExchange,
        bounds: &[usize],
        snapshot: &mut SnapshotPlanes<'_>,
    ) -> Vec<ChunkResult> {
        let kind = self.pass_kind();
        let BoundaryExchange {
            lists,
            open_boundary,
            previous,
            next,
            intermediate,
            ghost_populations,
            mean_outward_velocities,
            max_speed_squared,
        } = exchange;
        let chunks: Vec<_> = bounds.windows(2).map(|w| w[0]..w[1]).collect();
        // Planes that do not touch a seam; empty in a domain of a single short chunk.
        let inner = |r: &Range<usize>| if r.len() < MIN_CHUNK { r.start..r.start } else { r.start + 1..r.end - 1 };
        let inner: Vec<_> = chunks.iter().map(inner).collect();
        let [ghosts, second_ghosts] = ghost_populations;
        // The ghosts of a chunk's planes are contiguous in the buffer, so that each chunk borrows its part.
        let ghost_range =
            |r: &Range<usize>| open_boundary.buffer_range(r.start).start..open_boundary.buffer_range(r.end - 1).end;
        let ghost_ranges: Vec<_> = chunks.iter().map(ghost_range).collect();
        let ghost_parts = split_at_ranges(second_ghosts, &ghost_ranges).into_iter().zip(&ghost_ranges);
        // Select the buffers for the boundary populations that the even and the odd step write.
        let (even_buffers, odd_buffers) = match kind {
            PassKind::Even => (Some(next), None),
            PassKind::Odd => (None, Some(next)),
            PassKind::EvenAndOdd => (Some(intermediate), Some(next)),
        };
        let outputs =
            split_buffers(lists, even_buffers, &chunks).into_iter().zip(split_buffers(lists, odd_buffers, &inner));
        let input = IncomingPopulations {
            lists,
            populations: BufferSlice::full(&previous.populations),
            ghosts: BufferSlice::full(ghosts),
        };
        // One job per chunk, with exclusive slices of populations, buffers and ghosts.
        let planes = self.plane_slices(populations, &chunks, 0);
        let speeds = split_at_ranges(max_speed_squared, &chunks);
        let parts = planes.into_iter().zip(speeds).zip(outputs).zip(ghost_parts).zip(chunks.iter().zip(&inner));
        let mut jobs: Vec<_> = parts
            .map(|((((planes, max_speed_squared), (even_output, odd_output)), ghosts), (chunk, inner))| Chunk {
                planes,
                max_speed_squared,
                even_output,
                odd_output,
                ghosts: ghosts.0,
                first_ghost: ghosts.1.start,
                scratch: self.thread_scratch(snapshot, if kind == PassKind::Even { chunk } else { inner }),
                even_planes: chunk.clone(),
                odd_planes: inner.clone(),
            })
            .collect();
        // Outlet densities of the odd step use the mean outflow of the even one, measured once per pass.
        let second = self.second.map(|inputs| OddStepInputs {
            open_boundary,
            inputs,
            outlet_drho: inputs.outlet_densities(*mean_outward_velocities),
        });
        par::par_map_mut(&mut jobs, |chunk| self.dispatch_kernel(ChunkTask { context: self, chunk, input, second }))
    }

    /// Does the odd step of the two planes at each border of chunks, after all chunks have done their even step.
    fn run_seams(
        &self,
        populations: &mut Populations,
        exchange: &mut BoundaryExchange,
        bounds: &[usize],
        snapshot: &mut SnapshotPlanes<'_>,
    ) -> Vec<ChunkResult> {
        let BoundaryExchange { lists, previous, next, intermediate, ghost_populations, max_speed_squared, .. } =
            exchange;
        let n = self.tables.grid.n[2];
        let seams = bounds.iter().map(|c| c.saturating_sub(1)..(c + 1).min(n));
        // If the domain has too few planes for two seams, they are merged.
        let seams: Vec<_> = if n < MIN_CHUNK { std::iter::once(0..n).collect() } else { seams.collect() };
        // The odd step of the seams reads the populations of the even step of the same pass if there is one, otherwise those of the
        // previous pass.
        let (before, ghosts) = if self.pass_kind() == PassKind::EvenAndOdd {
            (intermediate, &ghost_populations[1])
        } else {
            (previous, &ghost_populations[0])
        };
        let input = IncomingPopulations {
            lists,
            populations: BufferSlice::full(&before.populations),
            ghosts: BufferSlice::full(ghosts),
        };
        let speeds = split_at_ranges(max_speed_squared, &seams);
        // A margin of one plane, because an odd step writes one node downstream, to the adjacent planes.
        let planes = self.plane_slices(populations, &seams, 1).into_iter().zip(speeds);
        let parts = planes.zip(next.split_by_planes(lists, &seams)).zip(&seams);
        let mut jobs: Vec<_> = parts
            .map(|(((planes, max_speed_squared), output), seam)| Chunk {
                planes,
                max_speed_squared,
                even_output: None,
                odd_output: Some(output),
                ghosts: &mut [][..],
                first_ghost: 0,
                scratch: self.thread_scratch(snapshot, seam),
                even_planes: seam.clone(),
                odd_planes: seam.clone(),
            })
            .collect();
        par::par_map_mut(&mut jobs, |chunk| {
            self.dispatch_kernel(ChunkTask { context: self, chunk, input, second: None })
        })
    }

    /// Scratch memory of a thread, with the snapshot planes that lie in a range of planes.
    fn thread_scratch<'a>(&self, snapshot: &mut SnapshotPlanes<'a>, planes: &Range<usize>) -> ThreadScratch<'a> {
        // In descending order, so that planes are taken from the end in ascending order.
        let mut own: Vec<_> = snapshot.extract_if(.., |(z, _)| planes.contains(z)).collect();
        own.reverse();
        ThreadScratch::new(&self.tables.grid, own)
    }

    /// Runs a chunk with the instruction set of the machine and the kernel that its flow needs.
    fn dispatch_kernel(&self, task: ChunkTask<'_, '_>) -> ChunkResult {
        let (arch, params) = (&self.tables.arch, &self.tables.params);
        // Compile-time variants: the kernel of every wind has no force term, and without eddies no square root.
        let forced = params.force.iter().any(|f| f.abs() > 0.0);
        match (params.smagorinsky_factor > 0.0, forced) {
            (true, false) => arch.dispatch(ChunkKernel::<true, false>(task)),
            (false, false) => arch.dispatch(ChunkKernel::<false, false>(task)),
            (_, true) => arch.dispatch(ChunkKernel::<false, true>(task)),
        }
    }
}

impl BoundaryInputs<'_> {
    /// Density less 1 beyond each outlet.
    fn outlet_densities(&self, mean_outward_velocities: [f32; 6]) -> [f32; 6] {
        std::array::from_fn(|f| outlet_density(self.outlet_velocity[f], mean_outward_velocities[f]))
    }
}

/// The parts of some buffers for ranges of planes; `None` for all ranges without buffers.
fn split_buffers<'a>(
    lists: &ExchangeLists,
    buffers: Option<&'a mut ExchangeBuffers>,
    ranges: &[Range<usize>],
) -> Vec<Option<ExchangeOutput<'a>>> {
    match buffers {
        Some(buffers) => buffers.split_by_planes(lists, ranges).into_iter().map(Some).collect(),
        None => ranges.iter().map(|_| None).collect(),
    }
}

/// Ghost populations of one plane in SIMD lanes.
struct GhostKernel<'a> {
    open_boundary: &'a OpenBoundary,
    z: usize,
    state: GhostInputs<'a>,
    out: &'a mut [f32],
}

impl WithSimd for GhostKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.open_boundary.compute_plane_ghosts(simd, self.z, self.state, self.out);
    }
}

/// Planes of a thread with the buffers they fill.
struct Chunk<'a> {
    planes: PopulationPlanes<'a>,
    /// Square of the highest speed in the previous step, for each plane of `even_planes`.
    max_speed_squared: &'a mut [f32],
    /// Output of the even step; `None` if the pass has no even step.
    even_output: Option<ExchangeOutput<'a>>,
    /// Output of the odd step; `None` if the pass has no odd step.
    odd_output: Option<ExchangeOutput<'a>>,
    /// Ghost populations of the odd step after an even one.
    ghosts: &'a mut [f32],
    /// Index of the first of `ghosts` in the whole buffer.
    first_ghost: usize,
    scratch: ThreadScratch<'a>,
    even_planes: Range<usize>,
    odd_planes: Range<usize>,
}

/// Result of a chunk: clamped cells of even and odd steps, and diagnostics of the snapshot's planes.
struct ChunkResult {
    clamped: [u64; 2],
    diagnostics: Vec<(usize, PlaneDiagnostics)>,
}

/// Inputs of the ghosts of the odd step after an even one, besides open cells.
#[derive(Clone, Copy)]
struct OddStepInputs<'a> {
    open_boundary: &'a OpenBoundary,
    inputs: BoundaryInputs<'a>,
    outlet_drho: [f32; 6],
}

struct ChunkTask<'a, 'b> {
    context: &'a StepContext<'a>,
    chunk: &'a mut Chunk<'b>,
    /// The populations that the first step of the pass reads from boundaries.
    input: IncomingPopulations<'a>,
    second: Option<OddStepInputs<'a>>,
}

struct ChunkKernel<'a, 'b, const EDDIES: bool, const FORCE: bool>(ChunkTask<'a, 'b>);

impl<const EDDIES: bool, const FORCE: bool> WithSimd for ChunkKernel<'_, '_, EDDIES, FORCE> {
    type Output = ChunkResult;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> ChunkResult {
        self.0.run_planes::<S, EDDIES, FORCE>(simd)
    }
}

impl ChunkTask<'_, '_> {
    #[inline(always)]
    fn run_planes<S: Simd, const EDDIES: bool, const FORCE: bool>(self, simd: S) -> ChunkResult {
        let Self { context, chunk, input, second } = self;
        let StepContext { tables, domain, .. } = *context;
        let Chunk {
            planes,
            max_speed_squared,
            even_output,
            odd_output,
            ghosts,
            first_ghost,
            scratch,
            even_planes,
            odd_planes,
        } = chunk;
        let mut clamped = [0; 2];
        // A wavefront over the planes: the even step of plane z is followed by the odd step of plane z - 1, whose
        // neighbours z - 2, z - 1 and z have then all done their even step.
        for z in even_planes.start..even_planes.end + 1 {
            // Even step of plane z, then the ghosts that the odd step of the same plane will read.
            if let Some(output) = even_output.as_mut().filter(|_| z < even_planes.end) {
                let step = PlaneStep { tables, domain, input, z, last: odd_output.is_none() };
                let speed = &mut max_speed_squared[z - even_planes.start];
                clamped[0] +=
                    step.scatter_collide_gather::<S, false, EDDIES, FORCE>(simd, planes, scratch, output, speed);
                if let Some(OddStepInputs { open_boundary, inputs, outlet_drho }) = second {
                    let state = GhostInputs {
                        moments: output.moments.each_ref().map(|a| &a[..]),
                        first_cell: output.first_cell,
                        populations: input.lists.nonequilibrium.then_some(&output.cell_populations[..]),
                        inlet_velocity: inputs.inlet_velocity,
                        shear: inputs.shear,
                        shear_scale: inputs.shear_scale,
                        outlet_drho,
                    };
                    let range = open_boundary.buffer_range(z);
                    let out = &mut ghosts[range.start - *first_ghost..range.end - *first_ghost];
                    open_boundary.compute_plane_ghosts(simd, z, state, out);
                }
            }
            // Odd step of the previous plane, which reads the results of the even step while they are in the cache. At z = 0
            // there is no previous plane; the wrapped index lies in no range.
            let behind = z.wrapping_sub(1);
            if let Some(output) = odd_output.as_mut().filter(|_| odd_planes.contains(&behind)) {
                let input = match even_output {
                    Some(left) => IncomingPopulations {
                        lists: input.lists,
                        populations: BufferSlice { values: &left.populations[..], start: left.first_population },
                        ghosts: BufferSlice { values: &ghosts[..], start: *first_ghost },
                    },
                    None => input,
                };
                let step = PlaneStep { tables, domain, input, z: behind, last: true };
                let speed = &mut max_speed_squared[behind - even_planes.start];
                clamped[1] +=
                    step.scatter_collide_gather::<S, true, EDDIES, FORCE>(simd, planes, scratch, output, speed);
            }
        }
        ChunkResult { clamped, diagnostics: std::mem::take(&mut scratch.diagnostics) }
    }
}
