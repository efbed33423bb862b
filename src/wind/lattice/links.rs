//! What boundaries do: they fill the places from which cells beside walls, ground and open faces read.
//!
//! A step goes through the domain band by band. Before a band is computed, what arrives from boundaries is put where its
//! cells will read; afterwards, what the next step will need is taken out, while both still lie in the nearest cache.

use std::ops::Range;

use super::cells::Cells;
use super::collide::{equilibrium, moments};
use super::grid::{Grid, Parity, Populations};
use super::lane::Lane;
use super::list::List;
use super::stencil::{C, Q, opposite};
use crate::par;

/// Rows of a band.
pub(super) const BAND: usize = 16;
/// Ghosts that one thread takes at a time.
const PART: usize = 512;

/// Populations side by side in memory and in a buffer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// Direction.
    pub along: u8,
    /// First node, as its number in its plane.
    pub node: u32,
    pub count: u32,
    /// Place of the first in the buffer.
    pub at: u32,
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
    /// Its part of the cells before open faces.
    pub near: Range<usize>,
}

/// A place outside an open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ghost {
    pub place: [isize; 3],
    /// Number of the nearest cell inside among those before open faces; none if it is solid.
    pub near: Option<u32>,
    /// Directions it sends along, a bit each.
    pub sends: u16,
    /// Place of the first in the buffer.
    pub at: u32,
    /// Its number among those where air comes in.
    pub inlet: Option<u32>,
    /// Outward side of each axis on which it lies beyond an outlet: -1, 0, 1.
    pub out: [i8; 3],
    /// The face it lies beyond, if that is just one.
    pub face: Option<usize>,
}

/// What an open face sends inside.
#[derive(Debug, Clone, Copy)]
pub(super) enum Sends<L> {
    /// Air with this velocity.
    Inlet([L; 3]),
    /// What comes out, at this density less 1; never inwards along these sides. `true`: with the part beside the
    /// equilibrium.
    Outlet([i8; 3], L, bool),
}

/// Density less 1 beyond an outlet that lets sound go: that of a wave which alone would change the mean outward velocity
/// from what is wanted to what is. Both in cells a step.
/// Differs: with density 1 for good a box between inlet and outlet is an organ pipe, whose note lasts for thousands of
/// steps and is as strong as the wind.
pub(super) fn let_go<L: Lane>(wanted: L, mean: L) -> L {
    (mean - wanted) * mean.all(SQRT_3)
}

const SQRT_3: f64 = 1.732_050_807_568_877_2;

/// Air beyond an open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beyond<L> {
    /// Density less 1, and velocity.
    air: (L, [L; 3]),
    /// Those of the cell before it, if what is beside its equilibrium goes along.
    rest: Option<(L, [L; 3])>,
}

impl<L: Lane> Beyond<L> {
    /// From the populations that left the cell before it; `near`: zeros beside a solid, which counts as air at rest.
    #[inline(always)]
    pub(super) fn new(near: &[L; Q], sends: Sends<L>) -> Self {
        let (drho, mut u) = moments(near);
        match sends {
            Sends::Inlet(wind) => Self { air: (drho, wind), rest: None },
            Sends::Outlet(out, density, rest) => {
                let rest = rest.then_some((drho, u));
                for a in 0..3 {
                    let outward = f64::from(out[a]);
                    if outward.abs() > 0.0 {
                        // Kept where it goes outwards.
                        let pace = u[a] * u[a].all(outward);
                        u[a] = pace.above(0.0, u[a], u[a].all(0.0));
                    }
                }
                Self { air: (density, u), rest }
            }
        }
    }

    /// What it sends along a velocity.
    #[inline(always)]
    pub(super) fn sends(&self, i: usize, near: &[L; Q]) -> L {
        let sent = equilibrium(i, self.air.0, self.air.1);
        match self.rest {
            Some((drho, u)) => sent + (near[i] - equilibrium(i, drho, u)),
            None => sent,
        }
    }
}

/// Everything that boundaries pass on.
#[derive(Debug)]
pub(super) struct Links {
    pub plan: Plan,
    pub ghosts: Vec<Ghost>,
    /// Places among the taken and what walls that move add there.
    pub struck: Vec<(u32, f32)>,
    /// Outlets send what is beside the equilibrium as well.
    pub rest: bool,
    /// What the last step has left, and room for what the next one leaves.
    pub last: Taken,
    pub next: Taken,
    /// What open faces send.
    pub sent: Vec<f32>,
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
    /// Cells before open faces, as numbers in their planes.
    pub near: Vec<u32>,
}

/// What was taken out of the populations.
#[derive(Debug, Clone, Default)]
pub(super) struct Taken {
    pub pieces: Vec<f32>,
    pub near: Vec<[f32; Q]>,
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
    pieces: &'a mut [f32],
    near: &'a mut [[f32; Q]],
}

/// Some planes of every array: array k from plane z, or from z + c_kz before and after an odd step.
pub(super) type Planes<'a> = [&'a mut [f32]];

impl Grid {
    /// Bands of a plane.
    pub(super) fn bands(&self) -> usize {
        self.n[1].div_ceil(BAND)
    }

    /// Elements by which a step reads and writes array k beside a node, within the plane.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn aside(&self, parity: Parity, k: usize) -> isize {
        match parity {
            Parity::Even => 0,
            Parity::Odd => C[k][0] as isize + C[k][1] as isize * self.row as isize,
        }
    }
}

impl Arriving<'_> {
    /// Puts what arrives at a band of the plane `plane` of a slab.
    pub(super) fn put(self, planes: &mut Planes<'_>, parity: Parity, band: usize, plane: usize) {
        let Self { plan, .. } = self;
        let joint = &plan.joints[band];
        let place = |along: u8, node: u32| {
            let i = usize::from(along);
            let k = if parity == Parity::Odd { opposite(i) } else { i };
            (k, (plane * plan.grid.plane + node as usize).wrapping_add_signed(plan.grid.aside(parity, k)))
        };
        for p in &plan.put[joint.put.clone()] {
            let (k, e) = place(p.along, p.node);
            let (at, count) = (p.at as usize, p.count as usize);
            if count == 1 {
                planes[k][e] = self.pieces[at];
            } else {
                planes[k][e..e + count].copy_from_slice(&self.pieces[at..at + count]);
            }
        }
        for p in &plan.open[joint.open.clone()] {
            let (k, e) = place(p.along, p.node);
            planes[k][e] = self.sent[p.at as usize];
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
        let place = |i: usize, node: u32| {
            let k = if parity == Parity::Odd { i } else { opposite(i) };
            (k, (plane * plan.grid.plane + node as usize).wrapping_add_signed(plan.grid.aside(parity, k)))
        };
        for p in &plan.take[joint.take.clone()] {
            let (k, e) = place(usize::from(p.along), p.node);
            let (at, count) = (p.at as usize - slab.taken.start, p.count as usize);
            if count == 1 {
                room.pieces[at] = planes[k][e];
            } else {
                room.pieces[at..at + count].copy_from_slice(&planes[k][e..e + count]);
            }
        }
        let near = &mut room.near[joint.near.start - slab.near.start..joint.near.end - slab.near.start];
        for (node, g) in plan.near[joint.near.clone()].iter().zip(near) {
            for (i, g) in g.iter_mut().enumerate() {
                let (k, e) = place(i, *node);
                *g = planes[k][e];
            }
        }
    }
}

impl Links {
    /// Lists what is passed on. `rest`: outlets send the part beside the equilibrium too.
    pub(super) fn new(cells: &Cells, rest: bool) -> Self {
        List::new(cells).links(rest)
    }

    /// Where air comes in, in the order of the velocities that [`Links::meet`] takes.
    pub(super) fn inlets(&self) -> Vec<[isize; 3]> {
        self.ghosts.iter().filter(|g| g.inlet.is_some()).map(|g| g.place).collect()
    }

    /// Places beyond just one open face, before air: their face.
    pub(super) fn mouths(&self) -> impl Iterator<Item = ([isize; 3], usize)> {
        self.ghosts.iter().filter(|g| g.near.is_some()).filter_map(|g| Some((g.place, g.face?)))
    }

    /// Mean outward velocity before each face that is an outlet, cells a step.
    fn outflow(&self) -> [f32; 6] {
        let parts = par::par_chunks(&self.ghosts, par::CHUNK, |_, ghosts| {
            let (mut sum, mut count) = ([0.0_f32; 6], [0_u32; 6]);
            for ghost in ghosts.iter().filter(|g| g.inlet.is_none()) {
                if let Some((face, near)) = ghost.face.zip(ghost.near) {
                    let out = f32::from(ghost.out[face / 2]);
                    sum[face] += out * moments(&self.last.near[near as usize]).1[face / 2];
                    count[face] += 1;
                }
            }
            (sum, count)
        });
        std::array::from_fn(|f| {
            let (sum, count) = parts.iter().fold((0.0, 0), |(s, c), p| (s + p.0[f], c + p.1[f]));
            if count > 0 { sum / count as f32 } else { 0.0 }
        })
    }

    /// What arrives in the next step, and room for what it leaves, cut at bands `slab` apart.
    /// `wind`: velocity at each inlet, cells a step; `wanted`: mean outward velocity at each outlet.
    pub(super) fn meet(
        &mut self,
        wind: &[[f32; 3]],
        wanted: [f32; 6],
        slab: usize,
    ) -> (Arriving<'_>, Vec<Leaving<'_>>) {
        for (at, more) in &self.struck {
            self.last.pieces[*at as usize] += more;
        }
        let mean = self.outflow();
        let density = std::array::from_fn(|f| let_go(wanted[f], mean[f]));
        let mut sent = self.sent.as_mut_slice();
        let mut parts = Vec::new();
        for ghosts in self.ghosts.chunks(PART) {
            let count = ghosts.iter().map(|g| g.sends.count_ones() as usize).sum();
            let (mine, others) = sent.split_at_mut(count);
            parts.push((ghosts, mine));
            sent = others;
        }
        let (near, outlets) = (&self.last.near, (density, self.rest));
        par::par_each(&mut parts, |(ghosts, out)| {
            let mut out = out.iter_mut();
            for ghost in ghosts.iter() {
                send(ghost, near, wind, outlets, &mut out);
            }
        });
        let arriving = Arriving { plan: &self.plan, pieces: &self.last.pieces, sent: &self.sent };
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
        for (band, joint) in plan.joints.iter().enumerate() {
            let plane = (band / bands + 1) * grid.plane;
            for p in &plan.take[joint.take.clone()] {
                let (k, e) = grid.left(parity, usize::from(p.along), plane + p.node as usize);
                let (at, count) = (p.at as usize, p.count as usize);
                self.last.pieces[at..at + count].copy_from_slice(&arrays[k][e..e + count]);
            }
            for n in joint.near.clone() {
                for i in 0..Q {
                    let (k, e) = grid.left(parity, i, plane + plan.near[n] as usize);
                    self.last.near[n][i] = arrays[k][e];
                }
            }
        }
    }

    /// Bytes it holds.
    pub(super) fn bytes(&self) -> usize {
        use std::mem::size_of_val;
        let plan = &self.plan;
        let pieces = size_of_val(&*plan.put) + size_of_val(&*plan.open) + size_of_val(&*plan.take);
        let taken = |t: &Taken| size_of_val(&*t.pieces) + size_of_val(&*t.near);
        pieces + size_of_val(&*plan.near) + size_of_val(&*self.ghosts) + taken(&self.last) + taken(&self.next)
    }
}

/// What one ghost sends, in the order of its directions.
fn send<'a>(
    ghost: &Ghost,
    near: &[[f32; Q]],
    wind: &[[f32; 3]],
    (density, rest): ([f32; 6], bool),
    out: &mut impl Iterator<Item = &'a mut f32>,
) {
    let g = ghost.near.map_or([0.0; Q], |n| near[n as usize]);
    let sends = match ghost.inlet {
        Some(k) => Sends::Inlet(wind[k as usize]),
        None => Sends::Outlet(ghost.out, mean_of(ghost.out, density), rest && ghost.near.is_some()),
    };
    let beyond = Beyond::new(&g, sends);
    for i in (1..Q).filter(|i| ghost.sends >> i & 1 == 1) {
        if let Some(out) = out.next() {
            *out = beyond.sends(i, &g);
        }
    }
}

/// Mean of what is said of the faces beyond which a place lies; `out`: their sides.
pub(super) fn mean_of<L: Lane>(out: [i8; 3], faces: [L; 6]) -> L {
    let (mut sum, mut count) = (faces[0].all(0.0), 0.0);
    for (a, side) in out.iter().enumerate().filter(|(_, side)| **side != 0) {
        sum = sum + faces[2 * a + usize::from(*side > 0)];
        count += 1.0;
    }
    if count > 0.0 { sum.over(sum.all(count)) } else { sum }
}

/// Cuts the room for what leaves at every `slab` bands.
fn rooms<'a>(plan: &Plan, room: &'a mut Taken, slab: usize) -> Vec<Leaving<'a>> {
    let (mut pieces, mut near) = (room.pieces.as_mut_slice(), room.near.as_mut_slice());
    let mut parts = Vec::new();
    for joints in plan.joints.chunks(slab) {
        let count = |range: &dyn Fn(&Joint) -> Range<usize>| joints.iter().map(|j| range(j).len()).sum::<usize>();
        let (mine, others) = pieces.split_at_mut(count(&|j| j.taken.clone()));
        let (mine_near, others_near) = near.split_at_mut(count(&|j| j.near.clone()));
        parts.push(Leaving { pieces: mine, near: mine_near });
        (pieces, near) = (others, others_near);
    }
    parts
}
