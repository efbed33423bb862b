//! What boundaries do: they fill the places from which cells beside walls, ground and open faces read.
//!
//! A step goes through the domain band by band. Before a band is computed, what arrives from boundaries is put where its
//! cells will read; afterwards, what the next step will need is taken out, while both still lie in the nearest cache.

use std::ops::Range;

use super::cells::Cells;
use super::collide::moments;
use super::grid::{Grid, Parity, Populations};
use super::list::List;
use super::open::Mouths;
use super::stencil::{C, Q, opposite};

/// Nodes of a band, which lie one after the other in a plane: so few that what is put there waits for memory while the
/// band before is computed.
pub(super) const BAND: usize = 256;
/// Nodes after which the cells before open faces are looked at, many at once, while they lie in the second cache.
pub(super) const VENT: usize = 8 * BAND;

/// Populations in memory, at equal distances, and side by side in a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Piece {
    /// Direction.
    pub along: u8,
    pub run: Run,
    /// Place of the first in the buffer.
    pub at: u32,
}

/// Nodes of a plane at equal distances: along a row, or across rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// First node, as its number in its plane.
    pub node: u32,
    pub count: u32,
    pub stride: u32,
}

/// What a band needs.
#[derive(Debug, Clone, Default)]
pub(super) struct Joint {
    /// Its part of the pieces that arrive at it.
    pub put: Range<usize>,
    /// Its part of what open faces send to it.
    pub open: Range<usize>,
    /// Its part of the pieces that leave it for boundaries, and of their buffer.
    pub take: Range<usize>,
    pub taken: Range<usize>,
    /// Its part of the runs of cells before open faces, and of these cells.
    pub near: Range<usize>,
    pub beside: Range<usize>,
}

/// Everything that boundaries pass on.
#[derive(Debug)]
pub(super) struct Links {
    pub plan: Plan,
    pub mouths: Mouths,
    /// Places among the taken and what walls that move add there.
    pub struck: Vec<(u32, f32)>,
    /// What the last step has left, and room for what the next one leaves.
    pub last: Taken,
    pub next: Taken,
}

/// Where everything lies.
#[derive(Debug)]
pub(super) struct Plan {
    pub grid: Grid,
    /// One for every band: those of the first plane, then those of the next.
    pub joints: Vec<Joint>,
    pub put: Vec<Piece>,
    pub open: Vec<Piece>,
    pub take: Vec<Piece>,
    /// Cells before open faces.
    pub near: Vec<Run>,
    /// Outlets send what is beside the equilibrium as well.
    pub rest: bool,
}

/// What was taken out of the populations.
#[derive(Debug, Clone)]
pub(super) struct Taken {
    pub pieces: Vec<f32>,
    pub vents: Vents,
}

/// Air in the cells before open faces.
#[derive(Debug, Clone)]
pub(super) struct Vents {
    /// Density less 1, and velocity; in the end air at rest, for faces before solids.
    pub air: Vec<[f32; 4]>,
    /// Their populations, if they are asked for.
    pub parts: Vec<[f32; Q]>,
}

/// What a step reads of boundaries.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arriving<'a> {
    plan: &'a Plan,
    pieces: &'a [f32],
    sent: &'a [f32],
}

/// Room for what some bands leave for boundaries.
#[derive(Debug)]
pub(super) struct Leaving<'a> {
    pub pieces: &'a mut [f32],
    pub air: &'a mut [[f32; 4]],
    pub parts: &'a mut [[f32; Q]],
}

/// Some planes of every array: array k from plane z, or from z + c_kz before and after an odd step.
pub(super) type Planes<'a> = [&'a mut [f32]];

/// By direction: the array, and elements from a node to its place there.
pub(super) type Places = [(usize, isize); Q];

impl Grid {
    /// Elements of a plane from its first cell to its last.
    pub(super) fn span(&self) -> usize {
        self.row * (self.n[1] - 1) + self.n[0]
    }

    /// Bands of a plane.
    pub(super) fn bands(&self) -> usize {
        self.span().div_ceil(BAND)
    }

    /// Number of the first cell's node in its plane.
    pub(super) fn first(&self) -> usize {
        self.row + 1
    }

    /// Elements by which a step reads and writes array k beside a node, within the plane.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn aside(&self, parity: Parity, k: usize) -> isize {
        match parity {
            Parity::Even => 0,
            Parity::Odd => C[k][0] as isize + C[k][1] as isize * self.row as isize,
        }
    }

    /// Where a step reads what arrives along each direction.
    fn arrive(&self, parity: Parity) -> Places {
        std::array::from_fn(|i| {
            let k = if parity == Parity::Odd { opposite(i) } else { i };
            (k, self.aside(parity, k))
        })
    }

    /// Where a step writes what leaves along each direction.
    fn leave(&self, parity: Parity) -> Places {
        std::array::from_fn(|i| {
            let k = if parity == Parity::Odd { i } else { opposite(i) };
            (k, self.aside(parity, k))
        })
    }
}

impl Run {
    /// The part of an array from its first node on.
    fn place(self, (k, aside): (usize, isize), plane: usize) -> (usize, usize) {
        (k, (plane + self.node as usize).wrapping_add_signed(aside))
    }
}

/// Copies numbers side by side to places at equal distances.
fn spread(to: &mut [f32], run: Run, from: &[f32]) {
    let from = &from[..run.count as usize];
    if run.stride == 1 {
        to[..from.len()].copy_from_slice(from);
    } else {
        to.iter_mut().step_by(run.stride as usize).zip(from).for_each(|(to, from)| *to = *from);
    }
}

/// The other way.
fn gather(to: &mut [f32], from: &[f32], run: Run) {
    let to = &mut to[..run.count as usize];
    if run.stride == 1 {
        to.copy_from_slice(&from[..to.len()]);
    } else {
        to.iter_mut().zip(from.iter().step_by(run.stride as usize)).for_each(|(to, from)| *to = *from);
    }
}

impl Arriving<'_> {
    /// Puts what arrives at a band of the plane `plane` of a slab.
    pub(super) fn put(self, planes: &mut Planes<'_>, parity: Parity, band: usize, plane: usize) {
        let Self { plan, .. } = self;
        let (joint, places) = (&plan.joints[band], plan.grid.arrive(parity));
        let plane = plane * plan.grid.plane;
        for (pieces, from) in [(&plan.put[joint.put.clone()], self.pieces), (&plan.open[joint.open.clone()], self.sent)]
        {
            for p in pieces {
                let (k, e) = p.run.place(places[usize::from(p.along)], plane);
                spread(&mut planes[k][e..], p.run, &from[p.at as usize..]);
            }
        }
    }

    /// Takes what a band leaves for boundaries, after its step. `first`: the first band of the slab.
    pub(super) fn take(
        self,
        planes: &Planes<'_>,
        parity: Parity,
        (first, band, plane): (usize, usize, usize),
        room: &mut Leaving<'_>,
    ) {
        let Self { plan, .. } = self;
        let (joint, slab) = (&plan.joints[band], &plan.joints[first]);
        let places = plan.grid.leave(parity);
        let plane = plane * plan.grid.plane;
        for p in &plan.take[joint.take.clone()] {
            let (k, e) = p.run.place(places[usize::from(p.along)], plane);
            gather(&mut room.pieces[p.at as usize - slab.taken.start..], &planes[k][e..], p.run);
        }
    }

    /// The runs of cells before open faces in a band.
    pub(super) fn near(&self, band: usize) -> &[Run] {
        &self.plan.near[self.plan.joints[band].near.clone()]
    }

    /// Takes the populations that left some cells of a run, before open faces. `skip`: the first of these cells.
    pub(super) fn vent<const N: usize>(
        &self,
        planes: &Planes<'_>,
        parity: Parity,
        (run, skip, plane): (Run, usize, usize),
        out: &mut [[f32; N]; Q],
    ) {
        let count = (run.count as usize - skip).min(N);
        let (plane, stride) = (plane * self.plan.grid.plane, run.stride as usize);
        for (place, out) in self.plan.grid.leave(parity).into_iter().zip(out) {
            let (k, e) = run.place(place, plane);
            let from = planes[k][e + skip * stride..].iter().step_by(stride);
            out[..count].iter_mut().zip(from).for_each(|(out, g)| *out = *g);
        }
    }

    /// The places of a band among those of its slab before open faces.
    pub(super) fn beside(&self, first: usize, band: usize) -> Range<usize> {
        let (from, to) = (self.plan.joints[first].beside.start, &self.plan.joints[band].beside);
        to.start - from..to.end - from
    }

    pub(super) fn rest(&self) -> bool {
        self.plan.rest
    }
}

impl Links {
    /// Lists what is passed on. `rest`: outlets send the part beside the equilibrium too.
    pub(super) fn new(cells: &Cells, rest: bool) -> Self {
        List::new(cells).links(rest)
    }

    /// What arrives in the next step, and room for what it leaves, cut at bands `slab` apart.
    /// `wind`: velocity at each inlet, by component, cells a step, in the order of [`Mouths::inlets`]; `wanted`: mean outward
    /// velocity at each outlet.
    pub(super) fn meet(
        &mut self,
        wind: &[Vec<f32>; 3],
        wanted: [f32; 6],
        slab: usize,
        arch: pulp::Arch,
    ) -> (Arriving<'_>, Vec<Leaving<'_>>) {
        for (at, more) in &self.struck {
            self.last.pieces[*at as usize] += more;
        }
        self.mouths.send(arch, &self.last.vents, (wind, wanted), self.plan.rest);
        let arriving = Arriving { plan: &self.plan, pieces: &self.last.pieces, sent: &self.mouths.sent };
        (arriving, rooms(&self.plan, &mut self.next, slab))
    }

    /// What was taken in the step that is done becomes what arrives in the next.
    pub(super) fn turn(&mut self) {
        std::mem::swap(&mut self.last, &mut self.next);
    }

    /// Takes everything anew from populations that were set by hand. `parity`: of the next step.
    pub(super) fn renew(&mut self, populations: &Populations, parity: Parity) {
        let arrays = populations.arrays();
        let plan = &self.plan;
        let (bands, grid) = (plan.grid.bands(), &plan.grid);
        let vents = &mut self.last.vents;
        let mut number = 0;
        for (band, joint) in plan.joints.iter().enumerate() {
            let plane = (band / bands + 1) * grid.plane;
            for p in &plan.take[joint.take.clone()] {
                let (k, e) = grid.left(parity, usize::from(p.along), plane + p.run.node as usize);
                gather(&mut self.last.pieces[p.at as usize..], &arrays[k][e..], p.run);
            }
            for run in &plan.near[joint.near.clone()] {
                for n in 0..run.count {
                    let node = plane + (run.node + n * run.stride) as usize;
                    let parts: [f32; Q] = std::array::from_fn(|i| {
                        let (k, e) = grid.left(parity, i, node);
                        arrays[k][e]
                    });
                    let (drho, [x, y, z]) = moments(&parts);
                    vents.air[number] = [drho, x, y, z];
                    if plan.rest {
                        vents.parts[number] = parts;
                    }
                    number += 1;
                }
            }
        }
    }

    /// Bytes it holds.
    pub(super) fn bytes(&self) -> usize {
        use std::mem::size_of_val;
        let plan = &self.plan;
        let pieces = size_of_val(&*plan.put) + size_of_val(&*plan.open) + size_of_val(&*plan.take);
        let taken = |t: &Taken| size_of_val(&*t.pieces) + size_of_val(&*t.vents.air) + size_of_val(&*t.vents.parts);
        pieces + size_of_val(&*plan.near) + self.mouths.bytes() + taken(&self.last) + taken(&self.next)
    }
}

/// Cuts the room for what leaves at every `slab` bands.
fn rooms<'a>(plan: &Plan, room: &'a mut Taken, slab: usize) -> Vec<Leaving<'a>> {
    let (mut pieces, mut air, mut parts) =
        (room.pieces.as_mut_slice(), room.vents.air.as_mut_slice(), room.vents.parts.as_mut_slice());
    let mut rooms = Vec::new();
    for joints in plan.joints.chunks(slab) {
        let count = |range: &dyn Fn(&Joint) -> Range<usize>| joints.iter().map(|j| range(j).len()).sum::<usize>();
        let beside = count(&|j| j.beside.clone());
        let (mine, others) = pieces.split_at_mut(count(&|j| j.taken.clone()));
        let (mine_air, others_air) = air.split_at_mut(beside);
        let (mine_parts, others_parts) = parts.split_at_mut(if plan.rest { beside } else { 0 });
        rooms.push(Leaving { pieces: mine, air: mine_air, parts: mine_parts });
        (pieces, air, parts) = (others, others_air, others_parts);
    }
    rooms
}
