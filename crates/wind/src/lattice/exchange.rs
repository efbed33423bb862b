//! What boundaries do: they fill the places from which cells beside walls, ground and open faces read.
//!
//! A step goes through the domain plane by plane. Before a plane is computed, what arrives from boundaries is put where its
//! cells will read, or handed over in [`super::row_halo`] for the ends of rows; afterwards, what the next step will need is
//! taken out. Nothing comes from further than the planes beside, but for joined faces: so two steps can follow each other
//! through the domain a plane apart ([`super::stepper`]).

use std::ops::Range;

use super::collide::moments;
use super::domain::Cells;
use super::exchange_builder::List;
use super::grid::{Grid, Parity, Populations};
use super::open_boundary::Mouths;
use super::row_halo::Ends;
use super::stencil::{Q, opposite};

/// Populations in memory, at equal distances, and side by side in a buffer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Piece {
    /// Direction.
    pub along: u8,
    pub run: Run,
    /// Place of the first in the buffer.
    pub at: u32,
    /// What a wall that moves adds to them.
    pub more: f32,
}

/// Nodes of a plane at equal distances: along a row, or across rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// First node, as its number in its plane.
    pub node: u32,
    pub count: u32,
    pub stride: u32,
}

/// Populations that arrive at the ends of some rows, one after the other: places in [`Ends`], and in a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Handed {
    pub to: u32,
    pub at: u32,
    pub count: u32,
}

/// What a plane needs.
#[derive(Debug, Clone, Default)]
pub(super) struct Joint {
    /// Its part of the pieces that arrive at it, and of those at the ends of its rows.
    pub put: Range<usize>,
    pub handed: Range<usize>,
    /// Its part of what open faces send to it, and to the ends of its rows.
    pub open: Range<usize>,
    pub opened: Range<usize>,
    /// Its part of the pieces that leave it for boundaries, and of their buffer.
    pub take: Range<usize>,
    pub taken: Range<usize>,
    /// Its part of the runs of cells before open faces, and of these cells.
    pub near: Range<usize>,
    pub beside: Range<usize>,
    /// Among these, the first of the column at each end of its rows, if the face there is open.
    pub columns: [Option<usize>; 2],
}

/// Where everything lies.
#[derive(Debug)]
pub(super) struct Plan {
    pub grid: Grid,
    /// One for every plane.
    pub joints: Vec<Joint>,
    /// What arrives: where it is put, and where it was.
    pub put: Vec<Piece>,
    pub handed: Vec<Handed>,
    /// What open faces send, and where it lies among what they send.
    pub open: Vec<Piece>,
    pub opened: Vec<Handed>,
    /// What leaves.
    pub take: Vec<Piece>,
    /// Cells before open faces that are not at the ends of rows.
    pub near: Vec<Run>,
    /// Outlets send what is beside the equilibrium as well.
    pub rest: bool,
}

/// What a step took out of the populations.
#[derive(Debug, Clone)]
pub(super) struct Taken {
    pub pieces: Vec<f32>,
    pub vents: Vents,
}

/// Air in the cells before open faces.
#[derive(Debug, Clone)]
pub(super) struct Vents {
    /// Density less 1, and velocity by component.
    pub air: [Vec<f32>; 4],
    /// Their populations, if they are asked for.
    pub parts: Vec<[f32; Q]>,
}

/// Everything that boundaries pass on.
#[derive(Debug)]
pub(super) struct Links {
    pub plan: Plan,
    pub mouths: Mouths,
    /// What the step before has left; room for what the step in hand leaves, and for the first of two at once.
    pub last: Taken,
    pub next: Taken,
    pub middle: Taken,
    /// What open faces send in a step, and in the second of two.
    pub sent: [Vec<f32>; 2],
    /// Mean outward velocity before each outlet ahead of the last even step, cells a step: it serves two steps, so that
    /// these can follow each other through the domain.
    pub mean: [f32; 6],
    /// Square of the largest speed in each plane in the step before, cells a step, with what solid cells hold; infinite if
    /// nobody knows. It decides how carefully a step is done, never what comes out.
    pub fastest: Vec<f32>,
}

/// What a step reads of boundaries: buffers, and what comes before them in the whole.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arriving<'a> {
    pub plan: &'a Plan,
    pub pieces: (&'a [f32], usize),
    pub sent: (&'a [f32], usize),
}

/// Room for what some planes leave for boundaries, and what comes before it in the whole.
#[derive(Debug)]
pub(super) struct Leaving<'a> {
    pub pieces: (&'a mut [f32], usize),
    pub air: ([&'a mut [f32]; 4], usize),
    pub parts: &'a mut [[f32; Q]],
}

/// Some planes of every array, from the plane `low` of the array.
#[derive(Debug)]
pub(super) struct Planes<'a> {
    pub arrays: Vec<&'a mut [f32]>,
    pub low: usize,
}

/// By direction: the array, and elements from a node to its place there.
pub(super) type Places = [(usize, isize); Q];

impl Grid {
    /// Elements of a plane from its first cell to its last.
    pub(super) fn span(&self) -> usize {
        self.row * (self.n[1] - 1) + self.n[0]
    }

    /// Elements by which a step reads and writes array k beside a node.
    pub(super) fn aside(&self, parity: Parity, k: usize) -> isize {
        if parity == Parity::Odd { self.shift(k) } else { 0 }
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

impl Planes<'_> {
    /// Elements before the plane z.
    pub(super) fn before(&self, grid: &Grid, z: usize) -> usize {
        (z + 1 - self.low) * grid.plane
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
    if run.count == 1 {
        to[0] = from[0];
    } else if run.stride == 1 {
        to[..from.len()].copy_from_slice(from);
    } else {
        to.iter_mut().step_by(run.stride as usize).zip(from).for_each(|(to, from)| *to = *from);
    }
}

/// The other way.
fn gather(to: &mut [f32], from: &[f32], (run, more): (Run, f32)) {
    let to = &mut to[..run.count as usize];
    if run.count == 1 {
        to[0] = from[0];
    } else if run.stride == 1 {
        to.copy_from_slice(&from[..to.len()]);
    } else {
        to.iter_mut().zip(from.iter().step_by(run.stride as usize)).for_each(|(to, from)| *to = *from);
    }
    if more.abs() > 0.0 {
        to.iter_mut().for_each(|to| *to += more);
    }
}

impl Arriving<'_> {
    /// Puts what arrives at the plane `z`; at the ends of its rows, into `ends`.
    pub(super) fn put(self, planes: &mut Planes<'_>, ends: &mut Ends, (parity, z): (Parity, usize)) {
        let Self { plan, .. } = self;
        let (joint, places) = (&plan.joints[z], plan.grid.arrive(parity));
        let plane = planes.before(&plan.grid, z);
        let put = (&plan.put[joint.put.clone()], self.pieces);
        for (pieces, (from, before)) in [put, (&plan.open[joint.open.clone()], self.sent)] {
            for p in pieces {
                let (k, e) = p.run.place(places[usize::from(p.along)], plane);
                spread(&mut planes.arrays[k][e..], p.run, &from[p.at as usize - before..]);
            }
        }
        let handed = (&plan.handed[joint.handed.clone()], self.pieces);
        for (pieces, (from, before)) in [handed, (&plan.opened[joint.opened.clone()], self.sent)] {
            for p in pieces {
                ends.take(p.to as usize, &from[p.at as usize - before..][..p.count as usize]);
            }
        }
    }

    /// Takes what a plane leaves for boundaries, after its step.
    pub(super) fn take(self, planes: &Planes<'_>, (parity, z): (Parity, usize), room: &mut Leaving<'_>) {
        let Self { plan, .. } = self;
        let places = plan.grid.leave(parity);
        let plane = planes.before(&plan.grid, z);
        for p in &plan.take[plan.joints[z].take.clone()] {
            let (k, e) = p.run.place(places[usize::from(p.along)], plane);
            gather(&mut room.pieces.0[p.at as usize - room.pieces.1..], &planes.arrays[k][e..], (p.run, p.more));
        }
    }

    /// Takes the populations that left some cells of a run, before open faces. `skip`: the first of these cells.
    pub(super) fn vent<const N: usize>(
        &self,
        planes: &Planes<'_>,
        (parity, z): (Parity, usize),
        (run, skip): (Run, usize),
        out: &mut [[f32; N]; Q],
    ) {
        let count = (run.count as usize - skip).min(N);
        let (plane, stride) = (planes.before(&self.plan.grid, z), run.stride as usize);
        for (place, out) in self.plan.grid.leave(parity).into_iter().zip(out) {
            let (k, e) = run.place(place, plane);
            let from = planes.arrays[k][e + skip * stride..].iter().step_by(stride);
            out[..count].iter_mut().zip(from).for_each(|(out, g)| *out = *g);
        }
    }
}

impl Links {
    /// Lists what is passed on. `rest`: outlets send the part beside the equilibrium too.
    pub(super) fn new(cells: &Cells, rest: bool) -> Self {
        List::new(cells).links(rest)
    }

    /// Takes everything anew from populations that were set by hand. `parity`: of the next step.
    pub(super) fn renew(&mut self, populations: &Populations, parity: Parity) {
        let arrays = populations.arrays();
        self.fastest.fill(f32::INFINITY);
        let (plan, last) = (&self.plan, &mut self.last);
        let grid = &plan.grid;
        for (z, joint) in plan.joints.iter().enumerate() {
            let plane = (z + 1) * grid.plane;
            for p in &plan.take[joint.take.clone()] {
                let (k, e) = grid.left(parity, usize::from(p.along), plane + p.run.node as usize);
                gather(&mut last.pieces[p.at as usize..], &arrays[k][e..], (p.run, p.more));
            }
            let columns = joint.columns.into_iter().zip([0, grid.n[0] - 1]);
            let columns = columns.filter_map(|(first, x)| Some((first?, grid.first + x)));
            let columns =
                columns.flat_map(|(first, node)| (0..grid.n[1]).map(move |y| (first + y, node + y * grid.row)));
            let runs = plan.near[joint.near.clone()].iter();
            let nodes = runs.flat_map(|run| (0..run.count).map(|n| (run.node + n * run.stride) as usize));
            let numbered = (joint.first_run(grid.n[1])..).zip(nodes);
            for (number, node) in columns.chain(numbered) {
                let parts: [f32; Q] = std::array::from_fn(|i| {
                    let (k, e) = grid.left(parity, i, plane + node);
                    arrays[k][e]
                });
                let (drho, [x, y, z]) = moments(&parts);
                last.vents.air.iter_mut().zip([drho, x, y, z]).for_each(|(air, value)| air[number] = value);
                if plan.rest {
                    last.vents.parts[number] = parts;
                }
            }
        }
    }

    /// What populations do not tell of the step before: velocities before outlets, largest speeds, and the air before open
    /// faces.
    pub(super) fn kept(&self) -> impl Iterator<Item = &f32> {
        let vents = &self.last.vents;
        let air = vents.air.iter().flatten().chain(vents.parts.iter().flatten());
        self.mean.iter().chain(&self.fastest).chain(air)
    }

    /// The same, to be set.
    pub(super) fn kept_mut(&mut self) -> impl Iterator<Item = &mut f32> {
        let vents = &mut self.last.vents;
        let air = vents.air.iter_mut().flatten().chain(vents.parts.iter_mut().flatten());
        self.mean.iter_mut().chain(&mut self.fastest).chain(air)
    }

    /// Bytes it holds.
    pub(super) fn bytes(&self) -> usize {
        use std::mem::size_of_val;
        let plan = &self.plan;
        let pieces = size_of_val(&*plan.put) + size_of_val(&*plan.open) + size_of_val(&*plan.take);
        let handed = size_of_val(&*plan.handed) + size_of_val(&*plan.opened);
        let taken =
            |t: &Taken| size_of_val(&*t.pieces) + 4 * size_of_val(&*t.vents.air[0]) + size_of_val(&*t.vents.parts);
        pieces
            + handed
            + size_of_val(&*plan.near)
            + self.mouths.bytes()
            + 8 * self.sent[0].len()
            + 3 * taken(&self.last)
    }
}

impl Joint {
    /// Number of the first cell of its runs among those before open faces; the columns come before.
    pub(super) fn first_run(&self, rows: usize) -> usize {
        self.beside.start + rows * self.columns.iter().flatten().count()
    }
}

impl Taken {
    /// Cuts it at planes: a part for each of some ranges of them, which follow each other and may leave some out.
    pub(super) fn cut(&mut self, plan: &Plan, ranges: &[Range<usize>]) -> Vec<Leaving<'_>> {
        let taken: Vec<_> = ranges.iter().map(|r| across(&plan.joints[r.clone()], |j| &j.taken)).collect();
        let beside: Vec<_> = ranges.iter().map(|r| across(&plan.joints[r.clone()], |j| &j.beside)).collect();
        let pieces = parts(&mut self.pieces, &taken).into_iter().zip(taken);
        let [drho, x, y, z] = &mut self.vents.air;
        let [x, y, z] = [x, y, z].map(|u| parts(u, &beside));
        let air = parts(drho, &beside).into_iter().zip(x).zip(y.into_iter().zip(z));
        let air = air.map(|((drho, x), (y, z))| [drho, x, y, z]).zip(&beside);
        let none = vec![0..0; ranges.len()];
        let whole = parts(&mut self.vents.parts, if plan.rest { &beside } else { &none });
        let all = pieces.zip(air).zip(whole);
        all.map(|(((pieces, at), (air, from)), parts)| Leaving {
            pieces: (pieces, at.start),
            air: (air, from.start),
            parts,
        })
        .collect()
    }
}

/// From where the part of the first begins to where that of the last ends.
fn across(joints: &[Joint], part: impl Fn(&Joint) -> &Range<usize>) -> Range<usize> {
    match (joints.first(), joints.last()) {
        (Some(first), Some(last)) => part(first).start..part(last).end,
        _ => 0..0,
    }
}

/// Some parts of a whole that follow each other; empty ones lie anywhere.
pub(super) fn parts<'a, T>(mut whole: &'a mut [T], ranges: &[Range<usize>]) -> Vec<&'a mut [T]> {
    let (mut cut, mut at) = (Vec::with_capacity(ranges.len()), 0);
    for range in ranges {
        if range.is_empty() {
            cut.push(&mut [][..]);
            continue;
        }
        let (_, rest) = whole.split_at_mut(range.start - at);
        let (part, rest) = rest.split_at_mut(range.len());
        cut.push(part);
        (whole, at) = (rest, range.end);
    }
    cut
}
