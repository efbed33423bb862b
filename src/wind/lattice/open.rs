//! Open faces: what the places outside send inside.

use pulp::{Arch, Simd, WithSimd};

use super::collide::equilibrium;
use super::grid::BLOCK;
use super::lane::{Lane, Wide};
use super::links::Vents;
use super::stencil::Q;
use crate::par;

/// Places outside that one thread takes at a time.
const PART: usize = 512;

/// A place outside an open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ghost {
    pub place: [isize; 3],
    /// Number of the nearest cell inside among those before open faces; that of the air at rest if it is solid.
    pub near: u32,
    /// That cell is solid.
    pub solid: bool,
    /// Directions it sends along, a bit each.
    pub sends: u16,
    pub inlet: bool,
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
    /// From density less 1 and velocity of the cell before it; a solid counts as air at rest.
    #[inline(always)]
    pub(super) fn new((drho, mut u): (L, [L; 3]), sends: Sends<L>) -> Self {
        match sends {
            Sends::Inlet(wind) => Self { air: (drho, wind), rest: None },
            Sends::Outlet(out, density, rest) => {
                let rest = if rest { Some((drho, u)) } else { None };
                for a in 0..3 {
                    if out[a] != 0 {
                        // Kept where it goes outwards.
                        let pace = u[a] * u[a].all(f64::from(out[a]));
                        u[a] = pace.above(0.0, u[a], u[a].all(0.0));
                    }
                }
                Self { air: (density, u), rest }
            }
        }
    }

    /// What it sends along a velocity. `near`: what left the cell before it along it.
    #[inline(always)]
    pub(super) fn sends(&self, i: usize, near: L) -> L {
        let sent = equilibrium(i, self.air.0, self.air.1);
        match self.rest {
            Some((drho, u)) => sent + (near - equilibrium(i, drho, u)),
            None => sent,
        }
    }
}

/// Places outside that are alike, one after the other.
#[derive(Debug)]
struct Group {
    first: usize,
    count: usize,
    sends: u16,
    /// Outward sides; none for an inlet.
    out: Option<[i8; 3]>,
    solid: bool,
    /// Number of the first among all inlets.
    inlet: usize,
}

/// All places outside open faces.
#[derive(Debug)]
pub(super) struct Mouths {
    pub ghosts: Vec<Ghost>,
    groups: Vec<Group>,
    /// By face, if it is an outlet: the cells before it.
    outlets: [Vec<u32>; 6],
    /// What they send: group by group, direction by direction.
    pub sent: Vec<f32>,
}

impl Mouths {
    /// `ghosts`: in an order that puts those that are alike side by side. Returns for each where it sends: the place of the
    /// first direction, and from one direction to the next.
    pub(super) fn new(ghosts: Vec<Ghost>) -> (Self, Vec<(usize, usize)>) {
        let mut groups: Vec<Group> = Vec::new();
        let mut outlets: [Vec<u32>; 6] = std::array::from_fn(|_| Vec::new());
        let mut inlets = 0;
        for (first, g) in ghosts.iter().enumerate() {
            let out = (!g.inlet).then_some(g.out);
            match groups.last_mut() {
                Some(l) if (l.sends, l.out, l.solid) == (g.sends, out, g.solid) && l.count < PART => l.count += 1,
                _ => groups.push(Group { first, count: 1, sends: g.sends, out, solid: g.solid, inlet: inlets }),
            }
            inlets += usize::from(g.inlet);
            if let Some(face) = g.face.filter(|_| !g.inlet && !g.solid) {
                outlets[face].push(g.near);
            }
        }
        let (mut places, mut at) = (Vec::new(), 0);
        for group in &groups {
            places.extend((0..group.count).map(|k| (at + k, group.count)));
            at += group.len();
        }
        (Self { ghosts, groups, outlets, sent: vec![0.0; at] }, places)
    }

    /// Where air comes in, in the order of the velocities that [`super::links::Links::meet`] takes.
    pub(super) fn inlets(&self) -> Vec<[isize; 3]> {
        self.ghosts.iter().filter(|g| g.inlet).map(|g| g.place).collect()
    }

    /// Places beyond just one open face, before air: their face.
    pub(super) fn before_air(&self) -> impl Iterator<Item = ([isize; 3], usize)> {
        self.ghosts.iter().filter(|g| !g.solid).filter_map(|g| Some((g.place, g.face?)))
    }

    /// Mean outward velocity before each face that is an outlet, cells a step.
    fn outflow(&self, vents: &Vents) -> [f32; 6] {
        std::array::from_fn(|f| {
            let cells = &self.outlets[f];
            let sum: f64 = cells.iter().map(|n| f64::from(vents.air[*n as usize][1 + f / 2])).sum();
            let out = if f.is_multiple_of(2) { -1.0 } else { 1.0 };
            if cells.is_empty() { 0.0 } else { crate::math::narrow(out * sum / cells.len() as f64) }
        })
    }

    /// Finds what is sent. `wind`: velocity at each inlet, by component; `wanted`: mean outward velocity at each outlet.
    pub(super) fn send(&mut self, arch: Arch, vents: &Vents, (wind, wanted): (&[Vec<f32>; 3], [f32; 6]), rest: bool) {
        let mean = self.outflow(vents);
        let density = std::array::from_fn(|f| let_go(wanted[f], mean[f]));
        let mut sent = self.sent.as_mut_slice();
        let mut parts = Vec::with_capacity(self.groups.len());
        for group in &self.groups {
            let (mine, others) = sent.split_at_mut(group.len());
            parts.push((group, mine));
            sent = others;
        }
        let ghosts = &self.ghosts;
        par::par_each(&mut parts, |(group, out)| {
            let ghosts = &ghosts[group.first..group.first + group.count];
            arch.dispatch(Send { group, ghosts, vents, wind, density, rest: rest && !group.solid, out });
        });
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.ghosts) + size_of_val(&*self.sent)
    }
}

impl Group {
    /// Numbers that it sends.
    fn len(&self) -> usize {
        self.count * self.sends.count_ones() as usize
    }
}

struct Send<'a, 'b> {
    group: &'a Group,
    ghosts: &'a [Ghost],
    vents: &'a Vents,
    wind: &'a [Vec<f32>; 3],
    density: [f32; 6],
    rest: bool,
    out: &'b mut [f32],
}

impl WithSimd for Send<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { group, ghosts, vents, wind, density, rest, out } = self;
        for (from, some) in (0..).step_by(BLOCK).zip(ghosts.chunks(BLOCK)) {
            let mut air = [[0.0_f32; BLOCK]; 4];
            let mut parts = [[0.0_f32; BLOCK]; Q];
            let mut blown = [[0.0_f32; BLOCK]; 3];
            for (k, ghost) in some.iter().enumerate() {
                let near = vents.air[ghost.near as usize];
                for a in 0..4 {
                    air[a][k] = near[a];
                }
                if rest {
                    for (to, from) in parts.iter_mut().zip(vents.parts[ghost.near as usize]) {
                        to[k] = from;
                    }
                }
            }
            if group.out.is_none() {
                let first = group.inlet + from;
                for a in 0..3 {
                    blown[a][..some.len()].copy_from_slice(&wind[a][first..first + some.len()]);
                }
            }
            for part in 0..some.len().div_ceil(S::F32_LANES) {
                let sends = match group.out {
                    None => Sends::Inlet([
                        lanes(simd, &blown[0], part),
                        lanes(simd, &blown[1], part),
                        lanes(simd, &blown[2], part),
                    ]),
                    Some(out) => Sends::Outlet(out, Wide::splat(simd, mean_of(out, density)), rest),
                };
                let u = [lanes(simd, &air[1], part), lanes(simd, &air[2], part), lanes(simd, &air[3], part)];
                let beyond = Beyond::new((lanes(simd, &air[0], part), u), sends);
                let mut to = from + part * S::F32_LANES;
                for (i, near) in parts.iter().enumerate().skip(1) {
                    if group.sends >> i & 1 == 0 {
                        continue;
                    }
                    let mut sent = [0.0_f32; BLOCK];
                    S::as_mut_simd_f32s(&mut sent).0[0] = beyond.sends(i, lanes(simd, near, part)).value;
                    let count = S::F32_LANES.min(some.len() - part * S::F32_LANES);
                    out[to..to + count].copy_from_slice(&sent[..count]);
                    to += group.count;
                }
            }
        }
    }
}

#[inline(always)]
pub(super) fn lanes<S: Simd>(simd: S, from: &[f32; BLOCK], part: usize) -> Wide<S> {
    Wide::new(simd, S::as_simd_f32s(from).0[part])
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
