//! Builds the lists of the boundary exchange: source and destination of each population, joined to spans.

use std::collections::BTreeMap;
use std::ops::Range;

use super::domain::{Domain, FaceCondition, PopulationSource};
use super::exchange::{
    BoundaryExchange, ExchangeBuffers, ExchangeLists, OpenCellMoments, PlaneBoundaryRanges, RowHaloCopy, SpanCopy,
    StridedNodes,
};
use super::open_boundary::{GhostNode, GhostSlots, OpenBoundary};
use super::row_ends::RowEndPopulations;
use super::stencil::{Q, VELOCITIES, weight};
use osier_base::Result;
use osier_base::convert::{index, to_usize};

/// A cell by its plane, and by its element in the plane counted from the first cell.
#[derive(Debug, Clone, Copy)]
struct PlaneElement {
    plane: usize,
    element: usize,
}

/// Nodes of one plane at equal distances.
#[derive(Debug, Clone, Copy)]
struct NodeRun {
    first: PlaneElement,
    count: usize,
    stride: usize,
}

/// Populations that arrive at a run of nodes from another run.
struct RunLink {
    /// Direction in which they arrive, and in which they left.
    incoming: usize,
    outgoing: usize,
    to: NodeRun,
    from: PlaneElement,
    /// Momentum that a moving wall adds.
    wall_momentum: Option<f32>,
    /// Index of the first in [`RowEndPopulations`], if they arrive at ends of rows.
    halo_index: Option<usize>,
}

/// A population that arrives from a ghost node.
struct GhostLink {
    incoming: usize,
    to: PlaneElement,
    ghost: usize,
    /// Direction in which the ghost sends it; differs from `incoming` after a reflection.
    sent: usize,
}

/// The exchange while its links and ghosts are collected.
struct ExchangeBuilder<'a> {
    domain: &'a Domain,
    /// Sorted by the plane of the receiving cell.
    links: Vec<RunLink>,
    ghosts: Vec<GhostNode>,
    ghost_at: BTreeMap<[isize; 3], usize>,
    /// Sorted by the plane of the receiving cell.
    ghost_links: Vec<GhostLink>,
    /// The cell nearest to each ghost.
    nearest: Vec<[usize; 3]>,
}

/// The exchange of a domain's boundaries. `nonequilibrium`: outlets also pass on the non-equilibrium part.
/// # Errors
/// `Limit` for more nodes than an index of 32 bits counts.
pub(super) fn build_exchange(domain: &Domain, nonequilibrium: bool) -> Result<BoundaryExchange> {
    let mut builder = ExchangeBuilder {
        domain,
        links: Vec::new(),
        ghosts: Vec::new(),
        ghost_at: BTreeMap::new(),
        ghost_links: Vec::new(),
        nearest: Vec::new(),
    };
    // Visit links in the order plane, direction, row, cell, so that links of consecutive cells join to long spans.
    let n = domain.grid.n;
    for z in 0..n[2] {
        for i in 1..Q {
            for y in 0..n[1] {
                let edge = y == 0 || y + 1 == n[1] || z == 0 || z + 1 == n[2];
                for x in 0..n[0] {
                    let cell = [x, y, z];
                    // All other populations stream from their neighbour without an exchange.
                    let at_boundary = edge || x == 0 || x + 1 == n[0];
                    if !domain.is_solid(cell) && (at_boundary || domain.upstream_is_blocked(cell, i)) {
                        builder.link_population(cell, i);
                    }
                }
            }
        }
    }
    builder.build(nonequilibrium)
}

impl ExchangeBuilder<'_> {
    fn plane_node(&self, [x, y, z]: [usize; 3]) -> PlaneElement {
        PlaneElement { plane: z, element: x + y * self.domain.grid.row_stride }
    }

    /// Lists the population that arrives at a cell in direction `i`, unless it simply streams from its neighbour.
    fn link_population(&mut self, x: [usize; 3], i: usize) {
        let to = self.plane_node(x);
        let halo_index = RowEndPopulations::halo_index_of(&self.domain.grid, i, [x[0], x[1]]);
        let one = NodeRun { first: to, count: 1, stride: 1 };
        let link =
            |outgoing, from, wall_momentum| RunLink { incoming: i, outgoing, to: one, from, wall_momentum, halo_index };
        match self.domain.population_source(x, i) {
            PopulationSource::Neighbour => {}
            PopulationSource::Cell { direction, cell } => {
                self.append_or_extend_link(link(direction, self.plane_node(cell), None))
            }
            PopulationSource::MovingWall { direction, cell, velocity } => {
                // Halfway bounce-back at a moving wall adds 6 w_i c_i.u to the reflected population.
                let cu: f64 = (0..3).map(|a| f64::from(VELOCITIES[i][a]) * velocity[a]).sum();
                let momentum = osier_base::math::narrow(6.0 * weight(i) * cu);
                self.append_or_extend_link(link(direction, self.plane_node(cell), Some(momentum)));
            }
            PopulationSource::Ghost { direction, position } => {
                let ghost = self.ghost_index(position);
                self.ghosts[ghost].directions |= 1 << direction;
                self.ghost_links.push(GhostLink { incoming: i, to, ghost, sent: direction });
            }
        }
    }

    /// Adds a link, or extends the last run by it if both of its nodes continue the run at the same stride.
    fn append_or_extend_link(&mut self, one: RunLink) {
        let row = self.domain.grid.row_stride;
        // All links of a run have the same pair of directions and the same stride, and none has the momentum of a moving wall.
        if let Some(last) = self.links.last_mut() {
            let alike = (last.incoming, last.outgoing, last.halo_index.is_some())
                == (one.incoming, one.outgoing, one.halo_index.is_some())
                && last.wall_momentum.is_none()
                && one.wall_momentum.is_none();
            let stride = last.to.stride_to_next(one.to.first, row);
            let from = NodeRun { first: last.from, ..last.to };
            if let Some(stride) = stride.filter(|_| alike && stride == from.stride_to_next(one.from, row)) {
                (last.to.count, last.to.stride) = (last.to.count + 1, stride);
                return;
            }
        }
        self.links.push(one);
    }

    /// Number of the ghost node at a position, new or known.
    fn ghost_index(&mut self, position: [isize; 3]) -> usize {
        if let Some(known) = self.ghost_at.get(&position) {
            return *known;
        }
        // Classify a new ghost: an inlet takes precedence over outlets; `outward` collects the outlets beyond which it
        // lies.
        let faces = self.domain.faces_outside_of(position).map(|f| f.map(|f| (f, self.domain.faces[f])));
        let inlet = faces.iter().flatten().any(|(_, f)| *f == FaceCondition::Inlet);
        let side = |f: &Option<(usize, FaceCondition)>| match f {
            Some((f, FaceCondition::Outlet)) if f % 2 == 1 => 1,
            Some((_, FaceCondition::Outlet)) => -1,
            _ => 0,
        };
        let nearest = self.domain.nearest_cell(position);
        let number = self.ghosts.len();
        // Nodes beyond an edge or corner belong to no single face and are excluded from flux balances.
        let mut beyond = faces.iter().flatten().map(|f| f.0);
        let face = beyond.next().filter(|_| beyond.next().is_none());
        let outward = std::array::from_fn(|a| side(&faces[a]));
        let before_solid = self.domain.is_solid(nearest);
        self.ghosts.push(GhostNode { position, open_cell: 0, before_solid, directions: 0, inlet, outward, face });
        self.nearest.push(nearest);
        self.ghost_at.insert(position, number);
        number
    }

    fn build(mut self, nonequilibrium: bool) -> Result<BoundaryExchange> {
        let grid = self.domain.grid;
        // Every population that crosses a boundary has one position in a buffer, between the step that writes it and the step
        // that reads it.
        let mut planes = vec![PlaneBoundaryRanges::default(); grid.n[2]];
        // Gather in the order of the planes that populations leave ...
        let mut order: Vec<usize> = (0..self.links.len()).collect();
        order.sort_by_key(|k| self.links[*k].from.plane);
        let mut buffer_index = vec![0; self.links.len()];
        let (mut gather, mut at) = (Vec::new(), 0);
        for k in order {
            let link = &self.links[k];
            buffer_index[k] = at;
            let plane = &mut planes[link.from.plane];
            extend_range(&mut plane.gather, gather.len(), 1);
            extend_range(&mut plane.buffer, at, link.to.count);
            let from = NodeRun { first: link.from, ..link.to };
            let copy = self.to_span_copy(link.outgoing, from, at)?;
            gather.push(SpanCopy { wall_momentum: link.wall_momentum.unwrap_or(0.0), ..copy });
            at += link.to.count;
        }
        // ... and scatter in the order of the planes they reach.
        let (mut scatter, mut halo) = (Vec::new(), Vec::new());
        for (link, at) in self.links.iter().zip(&buffer_index) {
            let plane = &mut planes[link.to.first.plane];
            if let Some(halo_index) = link.halo_index {
                extend_range(&mut plane.halo, halo.len(), 1);
                halo.push(RowHaloCopy {
                    halo_index: checked_u32(halo_index)?,
                    buffer_index: checked_u32(*at)?,
                    count: checked_u32(link.to.count)?,
                });
            } else {
                extend_range(&mut plane.scatter, scatter.len(), 1);
                scatter.push(self.to_span_copy(link.incoming, link.to, *at)?);
            }
        }
        // Open cells are numbered before the ghosts, which refer to them.
        let open_spans = self.number_open_cells(&mut planes)?;
        let (open_boundary, slots) = self.build_open_boundary()?;
        let (ghost_scatter, ghost_halo) = self.build_ghost_scatter(&slots, &mut planes)?;
        position_empty_ranges(&mut planes);
        // All buffers in their final sizes; no step allocates.
        let open_cells = planes.last().map_or(0, |p| p.open_cells.end);
        let moments = std::array::from_fn(|_| vec![0.0; open_cells]);
        let populations = vec![[0.0; Q]; if nonequilibrium { open_cells } else { 0 }];
        let open_cells = OpenCellMoments { moments, populations };
        let previous = ExchangeBuffers { populations: vec![0.0; at], open_cells };
        let ghost_populations = [vec![0.0; open_boundary.buffer_len()], vec![0.0; open_boundary.buffer_len()]];
        let lists = ExchangeLists {
            grid,
            planes,
            scatter,
            halo,
            ghost_scatter,
            ghost_halo,
            gather,
            open_spans,
            nonequilibrium,
        };
        Ok(BoundaryExchange {
            lists,
            open_boundary,
            next: previous.clone(),
            intermediate: previous.clone(),
            previous,
            ghost_populations,
            mean_outward_velocities: [0.0; 6],
            max_speed_squared: vec![0.0; grid.n[2]],
        })
    }

    /// Sorts ghost nodes by plane and condition, so that nodes of the same plane and condition are adjacent and form
    /// groups. Returns the slots in the order of `ghosts`.
    fn build_open_boundary(&self) -> Result<(OpenBoundary, Vec<GhostSlots>)> {
        let planes = self.domain.grid.n[2];
        let mut order: Vec<usize> = (0..self.ghosts.len()).collect();
        order.sort_by_key(|k| {
            let g = &self.ghosts[*k];
            let [x, y, z] = g.position;
            (g.adjacent_plane(planes), g.inlet, g.outward, g.before_solid, z, y, x)
        });
        let (boundary, sorted) = OpenBoundary::new(order.iter().map(|k| self.ghosts[*k]).collect(), planes)?;
        let mut slots = vec![GhostSlots::default(); order.len()];
        order.iter().zip(sorted).for_each(|(k, slot)| slots[*k] = slot);
        Ok((boundary, slots))
    }

    /// Copies of ghost populations to slots and to the row halo, joined where nodes and buffer indices are consecutive.
    fn build_ghost_scatter(
        &self,
        slots: &[GhostSlots],
        planes: &mut [PlaneBoundaryRanges],
    ) -> Result<(Vec<SpanCopy>, Vec<RowHaloCopy>)> {
        let grid = &self.domain.grid;
        let (mut scatter, mut halo): (Vec<SpanCopy>, Vec<RowHaloCopy>) = (Vec::new(), Vec::new());
        let mut last: Option<PlaneElement> = None;
        for GhostLink { incoming, to, ghost, sent } in &self.ghost_links {
            // A population that arrives at the end of a row goes to the row halo; consecutive ones share a copy.
            let at = slots[*ghost].buffer_index_of(*sent);
            let cell = [to.element % grid.row_stride, to.element / grid.row_stride];
            if let Some(halo_index) = RowEndPopulations::halo_index_of(grid, *incoming, cell) {
                let range = &mut planes[to.plane].ghost_halo;
                let (halo_index, buffer_index) = (checked_u32(halo_index)?, checked_u32(at)?);
                let follows = |c: &&mut RowHaloCopy| {
                    range.start < range.end
                        && (c.halo_index + c.count, c.buffer_index + c.count) == (halo_index, buffer_index)
                };
                if let Some(copy) = halo.last_mut().filter(follows) {
                    copy.count += 1;
                } else {
                    extend_range(range, halo.len(), 1);
                    halo.push(RowHaloCopy { halo_index, buffer_index, count: 1 });
                }
                continue;
            }
            // Any other goes to its slot; nodes at one stride with consecutive buffer indices share a copy.
            if let (Some(copy), Some(first)) = (scatter.last_mut(), last) {
                let (count, stride) = (to_usize(copy.span.count), to_usize(copy.span.stride));
                let stride = NodeRun { first, count, stride }.stride_to_next(*to, grid.row_stride);
                let follows = to_usize(copy.direction) == *incoming && to_usize(copy.buffer_index) + count == at;
                if let Some(stride) = stride.filter(|_| follows) {
                    (copy.span.count, copy.span.stride) = (copy.span.count + 1, checked_u32(stride)?);
                    continue;
                }
            }
            extend_range(&mut planes[to.plane].ghost_scatter, scatter.len(), 1);
            scatter.push(self.to_span_copy(*incoming, NodeRun { first: *to, count: 1, stride: 1 }, at)?);
            last = Some(*to);
        }
        Ok((scatter, halo))
    }

    fn to_span_copy(&self, direction: usize, run: NodeRun, buffer_index: usize) -> Result<SpanCopy> {
        let (direction, span) = (checked_u32(direction)?, self.to_node_span(run)?);
        Ok(SpanCopy { direction, span, buffer_index: checked_u32(buffer_index)?, wall_momentum: 0.0 })
    }

    fn to_node_span(&self, run: NodeRun) -> Result<StridedNodes> {
        let first = checked_u32(self.domain.grid.first_cell + run.first.element)?;
        Ok(StridedNodes { first, count: checked_u32(run.count)?, stride: checked_u32(run.stride)? })
    }

    /// The end of its row at which a cell lies, if the face there is open: then the whole column consists of open cells.
    fn open_row_end_of(&self, x: usize) -> Option<usize> {
        let ends = [0, self.domain.grid.n[0] - 1];
        (0..2).find(|end| x == ends[*end] && self.domain.faces[*end].is_open())
    }

    /// Numbers the open cells plane by plane and records that of each ghost. Returns the spans of those that are not in columns
    /// at the ends of rows.
    fn number_open_cells(&mut self, planes: &mut [PlaneBoundaryRanges]) -> Result<Vec<StridedNodes>> {
        let [_, rows, _] = self.domain.grid.n;
        // Open cells that are not in columns, once each, in the order of planes and rows.
        let air = self.nearest.iter().zip(&self.ghosts).filter(|(_, g)| !g.before_solid).map(|(cell, _)| *cell);
        let mut cells: Vec<[usize; 3]> = air.filter(|c| self.open_row_end_of(c[0]).is_none()).collect();
        cells.sort_by_key(|c| (c[2], c[1], c[0]));
        cells.dedup();
        let mut number: BTreeMap<[usize; 3], u32> = BTreeMap::new();
        let (mut runs, mut at): (Vec<NodeRun>, usize) = (Vec::new(), 0);
        let mut cells = cells.iter().peekable();
        // Per plane: first whole columns at open ends of rows, then the other open cells, joined to runs of one stride.
        for (z, plane) in planes.iter_mut().enumerate() {
            for end in 0..2 {
                if self.domain.faces[end].is_open() {
                    plane.columns[end] = Some(at);
                    extend_range(&mut plane.open_cells, at, rows);
                    at += rows;
                }
            }
            while let Some(cell) = cells.next_if(|c| c[2] == z) {
                number.insert(*cell, checked_u32(at)?);
                extend_range(&mut plane.open_cells, at, 1);
                at += 1;
                let node = self.plane_node(*cell);
                if let Some(last) = runs.last_mut().filter(|_| plane.open_spans.start < plane.open_spans.end)
                    && let Some(stride) = last.stride_to_next(node, self.domain.grid.row_stride)
                {
                    (last.count, last.stride) = (last.count + 1, stride);
                    continue;
                }
                extend_range(&mut plane.open_spans, runs.len(), 1);
                runs.push(NodeRun { first: node, count: 1, stride: 1 });
            }
        }
        // Each ghost node reads the moments of its nearest cell by this number.
        for k in 0..self.ghosts.len() {
            let cell = self.nearest[k];
            self.ghosts[k].open_cell = match self.open_row_end_of(cell[0]).and_then(|end| planes[cell[2]].columns[end])
            {
                Some(first) => checked_u32(first + cell[1])?,
                None => number.get(&cell).copied().unwrap_or(0),
            };
        }
        runs.into_iter().map(|run| self.to_node_span(run)).collect()
    }
}

impl NodeRun {
    /// The stride at which a node continues the run, along the row or across rows of its plane; `None` if it does not.
    fn stride_to_next(self, next: PlaneElement, row_stride: usize) -> Option<usize> {
        let step = next.element.checked_sub(self.first.element + (self.count - 1) * self.stride)?;
        let good = next.plane == self.first.plane && (step == 1 || step == row_stride);
        (good && (self.count == 1 || step == self.stride)).then_some(step)
    }
}

/// Extends a plane's range by `count` elements that are appended at index `at`.
fn extend_range(range: &mut Range<usize>, at: usize, count: usize) {
    if range.start == range.end {
        *range = at..at;
    }
    range.end += count;
}

/// Sets the start of each empty range to the end of the ranges of earlier planes, so that ranges of planes can be split in order.
fn position_empty_ranges(planes: &mut [PlaneBoundaryRanges]) {
    let mut ends = [0; 8];
    for p in planes {
        let ranges = [
            &mut p.scatter,
            &mut p.halo,
            &mut p.ghost_scatter,
            &mut p.ghost_halo,
            &mut p.gather,
            &mut p.buffer,
            &mut p.open_spans,
            &mut p.open_cells,
        ];
        for (range, end) in ranges.into_iter().zip(&mut ends) {
            if range.start == range.end {
                *range = *end..*end;
            }
            *end = range.end;
        }
    }
}

fn checked_u32(n: usize) -> Result<u32> {
    index(n, "boundary nodes of the lattice wind")
}
