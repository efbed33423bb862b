//! Boundary exchange: moves populations to the halo slots from which cells at walls, ground and open faces read.
//!
//! A step goes through the domain plane by plane. Before a plane is computed, populations that arrive at it from
//! boundaries are scattered into the slots its cells read, or into [`RowEndPopulations`] for the ends of rows; afterwards, those
//! that the next step's boundaries need are gathered into a buffer:
//!
//! ```text
//!   previous step's buffer ──scatter──► slots of plane z ──collide──► slots of plane z ──gather──► this step's buffer
//!   ghost populations      ──scatter──►   (and row halo)                               └─moments─► open cells, from which
//!                                                                                                  ghosts are computed
//! ```
//!
//! The data of a plane come from the adjacent planes, except across periodic faces in z: therefore two steps can proceed through
//! the domain one plane apart ([`super::stepper`]). The lists of source and destination of each population are built once, by
//! [`super::exchange_builder`].

use std::ops::Range;

use super::collide::moments;
use super::grid::{LatticeGrid, Populations, Slot, StepParity};
use super::open_boundary::OpenBoundary;
use super::row_ends::RowEndPopulations;
use super::stencil::Q;
use osier_base::convert::to_usize;

/// Nodes of a plane at equal distances: along a row, or across rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StridedNodes {
    /// Element of the first node within its plane.
    pub first: u32,
    pub count: u32,
    pub stride: u32,
}

/// Populations of a span of nodes, which are contiguous in a buffer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SpanCopy {
    pub direction: u32,
    pub span: StridedNodes,
    /// Index of the first in the buffer.
    pub buffer_index: u32,
    /// Momentum of a moving wall, 6 w_i c_i.u, that is added to each population when it is gathered.
    pub wall_momentum: f32,
}

/// Populations that arrive at the ends of consecutive rows: from a buffer into [`RowEndPopulations`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RowHaloCopy {
    pub halo_index: u32,
    pub buffer_index: u32,
    pub count: u32,
}

/// The part of one plane in each list of [`ExchangeLists`].
#[derive(Debug, Clone, Default)]
pub(super) struct PlaneBoundaryRanges {
    pub scatter: Range<usize>,
    pub halo: Range<usize>,
    pub ghost_scatter: Range<usize>,
    pub ghost_halo: Range<usize>,
    pub gather: Range<usize>,
    /// The plane's part of the buffer that `gather` fills.
    pub buffer: Range<usize>,
    pub open_spans: Range<usize>,
    /// The plane's part of the open cells: first the columns at the ends of rows, then `open_spans`.
    pub open_cells: Range<usize>,
    /// Number of the first open cell of the column at either end of the rows, if the face there is open.
    pub columns: [Option<usize>; 2],
}

/// The populations that the boundaries exchange; the lists are built once.
#[derive(Debug)]
pub(super) struct ExchangeLists {
    pub grid: LatticeGrid,
    pub planes: Vec<PlaneBoundaryRanges>,
    /// Copies from the buffer of the previous step to slots.
    pub scatter: Vec<SpanCopy>,
    /// Copies from the buffer of the previous step to the row halo.
    pub halo: Vec<RowHaloCopy>,
    /// Copies from the buffer of ghost populations to slots.
    pub ghost_scatter: Vec<SpanCopy>,
    /// Copies from the buffer of ghost populations to the row halo.
    pub ghost_halo: Vec<RowHaloCopy>,
    /// From slots to the buffer: populations that the step has sent towards boundaries.
    pub gather: Vec<SpanCopy>,
    /// Open cells that are not in columns at the ends of rows.
    pub open_spans: Vec<StridedNodes>,
    /// Whether outlets pass on the non-equilibrium part; if so, the populations of open cells are kept.
    pub nonequilibrium: bool,
}

/// Values that a step stores for the boundaries of the next one.
#[derive(Debug, Clone)]
pub(super) struct ExchangeBuffers {
    pub populations: Vec<f32>,
    pub open_cells: OpenCellMoments,
}

/// Moments of the open cells, which are adjacent to open faces.
#[derive(Debug, Clone)]
pub(super) struct OpenCellMoments {
    /// Density less 1, and velocity by component, cells per step.
    pub moments: [Vec<f32>; 4],
    /// Populations of the open cells, if the outlets pass on the non-equilibrium part; else empty.
    pub populations: Vec<[f32; Q]>,
}

/// The exchange of all boundaries: lists, open boundary and buffers.
#[derive(Debug)]
pub(super) struct BoundaryExchange {
    pub lists: ExchangeLists,
    pub open_boundary: OpenBoundary,
    /// Buffers filled by the previous step.
    pub previous: ExchangeBuffers,
    /// Buffers filled by the step in progress (by the second, of two in one pass).
    pub next: ExchangeBuffers,
    /// Buffers filled by the first of two steps in one pass.
    pub intermediate: ExchangeBuffers,
    /// Ghost populations of a step, and of the second of two.
    pub ghost_populations: [Vec<f32>; 2],
    /// Mean outward velocity before each outlet, cells per step, measured before the last even step. It is used for two steps, so
    /// that these can share a pass.
    pub mean_outward_velocities: [f32; 6],
    /// Per plane: square of the highest speed in the previous step, cells per step, including the values of solid cells; infinite
    /// if unknown. It selects the kernel with or without speed limit, which does not change results.
    pub max_speed_squared: Vec<f32>,
}

/// A part of a buffer, and the index of its first element in the whole.
#[derive(Debug, Clone, Copy)]
pub(super) struct BufferSlice<'a> {
    pub values: &'a [f32],
    pub start: usize,
}

impl<'a> BufferSlice<'a> {
    pub(super) fn full(values: &'a [f32]) -> Self {
        Self { values, start: 0 }
    }

    #[inline(always)]
    fn tail_from(self, index: u32) -> &'a [f32] {
        &self.values[to_usize(index) - self.start..]
    }
}

/// Populations that a step takes from boundaries: those exchanged by the step before, and those of ghost nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct IncomingPopulations<'a> {
    pub lists: &'a ExchangeLists,
    pub populations: BufferSlice<'a>,
    pub ghosts: BufferSlice<'a>,
}

/// The part of [`ExchangeBuffers`] that a range of planes fills.
#[derive(Debug)]
pub(super) struct ExchangeOutput<'a> {
    pub populations: &'a mut [f32],
    /// Index of the first of `populations` in the whole buffer.
    pub first_population: usize,
    pub moments: [&'a mut [f32]; 4],
    pub cell_populations: &'a mut [[f32; Q]],
    /// Number of the first of their open cells.
    pub first_cell: usize,
}

/// A range of planes of every population array.
#[derive(Debug)]
pub(super) struct PopulationPlanes<'a> {
    pub arrays: Vec<&'a mut [f32]>,
    /// Number of the first plane; the halo plane -1 has number 0.
    pub first_plane: usize,
}

impl PopulationPlanes<'_> {
    /// Element at which the plane z begins.
    pub(super) fn plane_start(&self, grid: &LatticeGrid, z: usize) -> usize {
        (z + 1 - self.first_plane) * grid.plane_stride
    }
}

impl StridedNodes {
    /// Element of an array that holds the span's first node in `slot`, for a plane that begins at `plane_start`.
    fn first_element(self, slot: Slot, plane_start: usize) -> usize {
        (plane_start + to_usize(self.first)).wrapping_add_signed(slot.offset)
    }
}

/// Copies contiguous numbers to the nodes of a span.
fn scatter_strided(to: &mut [f32], span: StridedNodes, from: &[f32]) {
    // Single nodes and contiguous rows are the common cases, and avoid the strided loop.
    let from = &from[..to_usize(span.count)];
    if span.count == 1 {
        to[0] = from[0];
    } else if span.stride == 1 {
        to[..from.len()].copy_from_slice(from);
    } else {
        to.iter_mut().step_by(to_usize(span.stride)).zip(from).for_each(|(to, from)| *to = *from);
    }
}

/// Copies the numbers of a span's nodes to contiguous elements, and adds `wall_momentum`.
fn gather_from_span(to: &mut [f32], from: &[f32], span: StridedNodes, wall_momentum: f32) {
    let to = &mut to[..to_usize(span.count)];
    if span.count == 1 {
        to[0] = from[0];
    } else if span.stride == 1 {
        to.copy_from_slice(&from[..to.len()]);
    } else {
        to.iter_mut().zip(from.iter().step_by(to_usize(span.stride))).for_each(|(to, from)| *to = *from);
    }
    if wall_momentum.abs() > 0.0 {
        to.iter_mut().for_each(|to| *to += wall_momentum);
    }
}

impl IncomingPopulations<'_> {
    /// Scatters the populations that arrive at the plane `z` from boundaries and ghost nodes; at the ends of its rows, into
    /// `halo`.
    pub(super) fn scatter_incoming(
        self,
        planes: &mut PopulationPlanes<'_>,
        halo: &mut RowEndPopulations,
        parity: StepParity,
        z: usize,
    ) {
        let Self { lists, .. } = self;
        let (links, slots) = (&lists.planes[z], lists.grid.incoming_slots(parity));
        let plane = planes.plane_start(&lists.grid, z);
        // Scatter the populations of the previous step, then those of ghost nodes; both lists are copied in the same way.
        let inner = (&lists.scatter[links.scatter.clone()], self.populations);
        for (copies, buffer) in [inner, (&lists.ghost_scatter[links.ghost_scatter.clone()], self.ghosts)] {
            for copy in copies {
                let slot = slots[to_usize(copy.direction)];
                let first = copy.span.first_element(slot, plane);
                scatter_strided(
                    &mut planes.arrays[slot.array][first..],
                    copy.span,
                    buffer.tail_from(copy.buffer_index),
                );
            }
        }
        let inner = (&lists.halo[links.halo.clone()], self.populations);
        for (copies, buffer) in [inner, (&lists.ghost_halo[links.ghost_halo.clone()], self.ghosts)] {
            for copy in copies {
                let from = &buffer.tail_from(copy.buffer_index)[..to_usize(copy.count)];
                halo.store_rows(to_usize(copy.halo_index), from);
            }
        }
    }

    /// Gathers the populations of the plane `z` that the next step's boundaries need, after the plane's step.
    pub(super) fn gather_outgoing(
        self,
        planes: &PopulationPlanes<'_>,
        parity: StepParity,
        z: usize,
        out: &mut ExchangeOutput<'_>,
    ) {
        let Self { lists, .. } = self;
        let slots = lists.grid.outgoing_slots(parity);
        let plane = planes.plane_start(&lists.grid, z);
        // After an even step populations lie in the opposite array, after an odd one downstream: `outgoing_slots` covers both
        // cases.
        for copy in &lists.gather[lists.planes[z].gather.clone()] {
            let slot = slots[to_usize(copy.direction)];
            let first = copy.span.first_element(slot, plane);
            let to = &mut out.populations[to_usize(copy.buffer_index) - out.first_population..];
            gather_from_span(to, &planes.arrays[slot.array][first..], copy.span, copy.wall_momentum);
        }
    }

    /// Gathers the populations that left the cells `skip..skip + N` of a span of open cells in the plane `z`.
    pub(super) fn gather_open_boundary_populations<const N: usize>(
        &self,
        planes: &PopulationPlanes<'_>,
        parity: StepParity,
        z: usize,
        span: StridedNodes,
        skip: usize,
        out: &mut [[f32; N]; Q],
    ) {
        let count = (to_usize(span.count) - skip).min(N);
        let (plane, stride) = (planes.plane_start(&self.lists.grid, z), to_usize(span.stride));
        // One direction after another: N nodes at a constant stride.
        for (slot, out) in self.lists.grid.outgoing_slots(parity).into_iter().zip(out) {
            let first = span.first_element(slot, plane);
            let from = planes.arrays[slot.array][first + skip * stride..].iter().step_by(stride);
            out[..count].iter_mut().zip(from).for_each(|(out, g)| *out = *g);
        }
    }
}

impl BoundaryExchange {
    /// Fills the buffers of the previous step from populations that were set from outside. `next`: parity of the next step.
    pub(super) fn rebuild_from_populations(&mut self, populations: &Populations, next: StepParity) {
        let arrays = populations.arrays();
        self.max_speed_squared.fill(f32::INFINITY);
        let (lists, previous) = (&self.lists, &mut self.previous);
        let grid = &lists.grid;
        for (z, links) in lists.planes.iter().enumerate() {
            // As after a step of the other parity: gather the outgoing populations, and take the moments of the open
            // cells.
            let plane = (z + 1) * grid.plane_stride;
            for copy in &lists.gather[links.gather.clone()] {
                let first = plane + to_usize(copy.span.first);
                let (k, e) = grid.outgoing_slot_of(next, to_usize(copy.direction), first);
                let to = &mut previous.populations[to_usize(copy.buffer_index)..];
                gather_from_span(to, &arrays[k][e..], copy.span, copy.wall_momentum);
            }
            // Open cells: columns at the ends of rows, then spans.
            let columns = links.columns.into_iter().zip([0, grid.n[0] - 1]);
            let columns = columns.filter_map(|(first, x)| Some((first?, grid.first_cell + x)));
            let columns =
                columns.flat_map(|(first, node)| (0..grid.n[1]).map(move |y| (first + y, node + y * grid.row_stride)));
            let spans = lists.open_spans[links.open_spans.clone()].iter();
            let nodes = spans.flat_map(|span| (0..span.count).map(|n| to_usize(span.first + n * span.stride)));
            let numbered = (links.first_open_span_cell(grid.n[1])..).zip(nodes);
            for (number, node) in columns.chain(numbered) {
                let g: [f32; Q] = std::array::from_fn(|i| {
                    let (k, e) = grid.outgoing_slot_of(next, i, plane + node);
                    arrays[k][e]
                });
                let (drho, [x, y, z]) = moments(&g);
                let open_cells = &mut previous.open_cells;
                open_cells.moments.iter_mut().zip([drho, x, y, z]).for_each(|(all, value)| all[number] = value);
                if lists.nonequilibrium {
                    open_cells.populations[number] = g;
                }
            }
        }
    }

    /// State that cannot be computed from the populations: outflow means, highest speeds, and moments of the open cells.
    pub(super) fn checkpoint_values(&self) -> impl Iterator<Item = &f32> {
        let open_cells = &self.previous.open_cells;
        let cells = open_cells.moments.iter().flatten().chain(open_cells.populations.iter().flatten());
        self.mean_outward_velocities.iter().chain(&self.max_speed_squared).chain(cells)
    }

    /// The values of [`Self::checkpoint_values`], mutable, to restore them.
    pub(super) fn checkpoint_values_mut(&mut self) -> impl Iterator<Item = &mut f32> {
        let open_cells = &mut self.previous.open_cells;
        let cells = open_cells.moments.iter_mut().flatten().chain(open_cells.populations.iter_mut().flatten());
        self.mean_outward_velocities.iter_mut().chain(&mut self.max_speed_squared).chain(cells)
    }

    /// Bytes of lists and buffers.
    pub(super) fn memory_bytes(&self) -> usize {
        use std::mem::size_of_val;
        let lists = &self.lists;
        let spans = size_of_val(&*lists.scatter) + size_of_val(&*lists.ghost_scatter) + size_of_val(&*lists.gather);
        let halo = size_of_val(&*lists.halo) + size_of_val(&*lists.ghost_halo);
        let buffers = |b: &ExchangeBuffers| {
            size_of_val(&*b.populations)
                + 4 * size_of_val(&*b.open_cells.moments[0])
                + size_of_val(&*b.open_cells.populations)
        };
        spans
            + halo
            + size_of_val(&*lists.open_spans)
            + self.open_boundary.memory_bytes()
            + 8 * self.ghost_populations[0].len()
            + 3 * buffers(&self.previous)
    }
}

impl PlaneBoundaryRanges {
    /// Number of the first open cell of `open_spans`, which follow those in columns. `rows`: number of rows of the
    /// plane.
    pub(super) fn first_open_span_cell(&self, rows: usize) -> usize {
        self.open_cells.start + rows * self.columns.iter().flatten().count()
    }
}

impl ExchangeBuffers {
    /// Splits the buffers between ranges of planes; the ranges ascend, and planes between them may be left out.
    pub(super) fn split_by_planes(
        &mut self,
        lists: &ExchangeLists,
        ranges: &[Range<usize>],
    ) -> Vec<ExchangeOutput<'_>> {
        // Every list is ordered by plane, so that each range of planes has one contiguous part of each buffer.
        let buffers: Vec<_> =
            ranges.iter().map(|r| range_over_planes(&lists.planes[r.clone()], |p| &p.buffer)).collect();
        let cells: Vec<_> =
            ranges.iter().map(|r| range_over_planes(&lists.planes[r.clone()], |p| &p.open_cells)).collect();
        // One output per range: its parts of the populations and of the four moment arrays.
        let populations = split_at_ranges(&mut self.populations, &buffers).into_iter().zip(buffers);
        let [drho, x, y, z] = &mut self.open_cells.moments;
        let [x, y, z] = [x, y, z].map(|u| split_at_ranges(u, &cells));
        let moments = split_at_ranges(drho, &cells).into_iter().zip(x).zip(y.into_iter().zip(z));
        let moments = moments.map(|((drho, x), (y, z))| [drho, x, y, z]).zip(&cells);
        let none = vec![0..0; ranges.len()];
        let with_populations = if lists.nonequilibrium { &cells } else { &none };
        let cell_populations = split_at_ranges(&mut self.open_cells.populations, with_populations);
        populations
            .zip(moments)
            .zip(cell_populations)
            .map(|(((populations, buffer), (moments, cells)), cell_populations)| ExchangeOutput {
                populations,
                first_population: buffer.start,
                moments,
                cell_populations,
                first_cell: cells.start,
            })
            .collect()
    }
}

/// Range of a buffer from the start of the first plane's part to the end of the last plane's part.
fn range_over_planes(
    planes: &[PlaneBoundaryRanges],
    part: impl Fn(&PlaneBoundaryRanges) -> &Range<usize>,
) -> Range<usize> {
    match (planes.first(), planes.last()) {
        (Some(first), Some(last)) => part(first).start..part(last).end,
        _ => 0..0,
    }
}

/// Disjoint parts of a slice, in ascending order; empty ranges may lie anywhere.
pub(super) fn split_at_ranges<'a, T>(mut whole: &'a mut [T], ranges: &[Range<usize>]) -> Vec<&'a mut [T]> {
    let (mut split, mut at) = (Vec::with_capacity(ranges.len()), 0);
    // Cut off the part before the range, then the range itself; an empty range cuts off nothing.
    for range in ranges {
        if range.is_empty() {
            split.push(&mut [][..]);
            continue;
        }
        let (_, rest) = whole.split_at_mut(range.start - at);
        let (part, rest) = rest.split_at_mut(range.len());
        split.push(part);
        (whole, at) = (rest, range.end);
    }
    split
}
