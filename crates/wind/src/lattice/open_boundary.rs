//! Open faces: what the places outside send inside.

use std::ops::Range;

use pulp::Simd;

use super::collide::equilibrium;
use super::ground::leant;
use super::stencil::Q;
use osier_base::simd::{F32Lanes, Lane};

/// Most places of a group.
const PART: usize = 512;

/// A place outside an open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ghost {
    pub place: [isize; 3],
    /// Number of the nearest cell inside among those before open faces, unless that is solid.
    pub near: u32,
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
pub(super) enum Kind<L> {
    /// Air with this velocity, which leans by x and z with the height as [`super::ground::lean`] has it.
    Inlet([L; 3], [L; 2]),
    /// What comes out, at this density less 1; never inwards along these sides. `true`: with the part beside the
    /// equilibrium.
    Outlet([i8; 3], L, bool),
}

/// Density less 1 beyond an outlet that lets sound go: that of a wave which alone would change the mean outward velocity
/// from what is wanted to what is. Both in cells a step.
/// Differs: with density 1 for good a box between inlet and outlet is an organ pipe, whose note lasts for thousands of
/// steps and is as strong as the wind.
pub(super) fn let_go<L: Lane>(wanted: L, mean: L) -> L {
    (mean - wanted) * mean.splat(SQRT_3)
}

const SQRT_3: f64 = 1.732_050_807_568_877_2;

/// Air beyond an open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beyond<L> {
    /// Density less 1, and velocity.
    air: (L, [L; 3]),
    /// Those of the cell before it, if what is beside its equilibrium goes along.
    rest: Option<(L, [L; 3])>,
    /// How it leans, if it comes in.
    lean: Option<[L; 2]>,
}

impl<L: Lane> Beyond<L> {
    /// From density less 1 and velocity of the cell before it; a solid counts as air at rest.
    #[inline(always)]
    pub(super) fn new((drho, mut u): (L, [L; 3]), kind: Kind<L>) -> Self {
        match kind {
            Kind::Inlet(wind, lean) => Self { air: (drho, wind), rest: None, lean: Some(lean) },
            Kind::Outlet(out, density, rest) => {
                let rest = if rest { Some((drho, u)) } else { None };
                for a in 0..3 {
                    if out[a] != 0 {
                        // Kept where it goes outwards.
                        let pace = u[a] * u[a].splat(f64::from(out[a]));
                        u[a] = pace.select_gt(0.0, u[a], u[a].splat(0.0));
                    }
                }
                Self { air: (density, u), rest, lean: None }
            }
        }
    }

    /// What it sends along a velocity. `near`: what left the cell before it along it.
    #[inline(always)]
    pub(super) fn sends(&self, i: usize, near: L) -> L {
        let sent = equilibrium(i, self.air.0, self.air.1);
        match (self.rest, self.lean) {
            (Some((drho, u)), _) => sent + (near - equilibrium(i, drho, u)),
            (None, Some(lean)) => sent + leant(i, lean),
            (None, None) => sent,
        }
    }
}

/// Places outside that are alike and before the same plane, one after the other.
#[derive(Debug)]
struct Group {
    first: usize,
    count: usize,
    /// Directions that any of them sends along.
    sends: u16,
    /// Outward sides; none for an inlet.
    out: Option<[i8; 3]>,
    solid: bool,
    /// Number of the first among all inlets.
    inlet: usize,
    /// The cells before them are numbered one after the other, from this one.
    near: Option<u32>,
}

/// Where a place outside sends, among all that is sent.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sends {
    /// Place of the first direction, and from one direction to the next.
    at: usize,
    apart: usize,
    /// Directions that are sent along.
    along: u16,
}

impl Sends {
    /// Where what is sent along a direction stands.
    pub(super) fn place(self, along: usize) -> usize {
        self.at + self.apart * (self.along & ((1 << along) - 1)).count_ones() as usize
    }
}

/// All places outside open faces.
#[derive(Debug)]
pub(super) struct Mouths {
    pub ghosts: Vec<Ghost>,
    groups: Vec<Group>,
    /// By plane: its part of the groups, and of what they send, group by group and direction by direction.
    planes: Vec<(Range<usize>, Range<usize>)>,
    /// By face, if it is an outlet: the cells before it.
    outlets: [Vec<u32>; 6],
}

/// What is known of the air when open faces send: the cells before them with the number of the first, the velocity at each
/// inlet by component, and the density less 1 beyond each face that is an outlet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Before<'a> {
    pub air: ([&'a [f32]; 4], usize),
    /// Populations of these cells, where outlets pass on what is beside the equilibrium.
    pub parts: Option<&'a [[f32; Q]]>,
    pub wind: &'a [Vec<f32>; 3],
    /// How it leans with the height, over that by x and z.
    pub lean: (&'a [f32], [f32; 2]),
    pub density: [f32; 6],
}

impl Ghost {
    /// The plane of cells before which it lies.
    #[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "sizes fit; clamped to the domain")]
    pub(super) fn plane(&self, planes: usize) -> usize {
        self.place[2].clamp(0, planes as isize - 1) as usize
    }
}

impl Mouths {
    /// `ghosts`: by plane, in an order that puts those that are alike side by side. Returns for each where it sends.
    pub(super) fn new(ghosts: Vec<Ghost>, planes: usize) -> (Self, Vec<Sends>) {
        let mut groups: Vec<Group> = Vec::new();
        let mut outlets: [Vec<u32>; 6] = std::array::from_fn(|_| Vec::new());
        let (mut inlets, mut last) = (0, None);
        let mut parts = vec![(0..0, 0..0); planes];
        for (first, g) in ghosts.iter().enumerate() {
            let out = (!g.inlet).then_some(g.out);
            let key = Some((g.plane(planes), out, g.solid));
            if let Some(group) = groups.last_mut().filter(|l| key == last && l.count < PART) {
                group.near = group.near.filter(|near| near + small(group.count) == g.near);
                (group.count, group.sends) = (group.count + 1, group.sends | g.sends);
            } else {
                let near = Some(g.near);
                groups.push(Group { first, count: 1, sends: g.sends, out, solid: g.solid, inlet: inlets, near });
            }
            last = key;
            inlets += usize::from(g.inlet);
            if let Some(face) = g.face.filter(|_| !g.inlet && !g.solid) {
                outlets[face].push(g.near);
            }
        }
        let (mut places, mut at, mut number) = (Vec::new(), 0, 0);
        for (z, (mine, sent)) in parts.iter_mut().enumerate() {
            let (group, from) = (number, at);
            while let Some(g) = groups.get(number).filter(|g| ghosts[g.first].plane(planes) == z) {
                places.extend((0..g.count).map(|k| Sends { at: at + k, apart: g.count, along: g.sends }));
                (at, number) = (at + g.len(), number + 1);
            }
            (*mine, *sent) = (group..number, from..at);
        }
        (Self { ghosts, groups, planes: parts, outlets }, places)
    }

    /// Where air comes in, in the order of the velocities of [`Before::wind`].
    pub(super) fn inlets(&self) -> Vec<[isize; 3]> {
        self.ghosts.iter().filter(|g| g.inlet).map(|g| g.place).collect()
    }

    /// Places beyond just one open face, before air: their face.
    pub(super) fn before_air(&self) -> impl Iterator<Item = ([isize; 3], usize)> {
        self.ghosts.iter().filter(|g| !g.solid).filter_map(|g| Some((g.place, g.face?)))
    }

    /// Mean outward velocity before each face that is an outlet, cells a step.
    pub(super) fn outflow(&self, air: &[Vec<f32>; 4]) -> [f32; 6] {
        std::array::from_fn(|f| {
            let cells = &self.outlets[f];
            let sum: f64 = cells.iter().map(|n| f64::from(air[1 + f / 2][*n as usize])).sum();
            let out = if f.is_multiple_of(2) { -1.0 } else { 1.0 };
            if cells.is_empty() { 0.0 } else { osier_base::math::narrow(out * sum / cells.len() as f64) }
        })
    }

    /// Numbers that are sent before each plane.
    pub(super) fn sent(&self, z: usize) -> Range<usize> {
        self.planes[z].1.clone()
    }

    /// Numbers that are sent.
    pub(super) fn len(&self) -> usize {
        self.planes.last().map_or(0, |(_, sent)| sent.end)
    }

    /// Finds what is sent from before the plane z.
    #[inline(always)]
    pub(super) fn send<S: Simd>(&self, simd: S, z: usize, before: Before<'_>, mut out: &mut [f32]) {
        for group in &self.groups[self.planes[z].0.clone()] {
            let (mine, others) = std::mem::take(&mut out).split_at_mut(group.len());
            let ghosts = &self.ghosts[group.first..group.first + group.count];
            group.send(simd, ghosts, before, mine);
            out = others;
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.ghosts)
    }
}

impl Group {
    /// Numbers that it sends.
    fn len(&self) -> usize {
        self.count * self.sends.count_ones() as usize
    }

    #[inline(always)]
    fn send<S: Simd>(&self, simd: S, ghosts: &[Ghost], before: Before<'_>, out: &mut [f32]) {
        match self.near.filter(|_| self.count >= S::F32_LANES && before.parts.is_none()) {
            Some(near) => self.send_side_by_side(simd, near as usize, before, out),
            None => self.send_singly(ghosts, before, out),
        }
    }

    /// Where the cells before these places are numbered one after the other: many at once.
    #[inline(always)]
    fn send_side_by_side<S: Simd>(&self, simd: S, near: usize, before: Before<'_>, out: &mut [f32]) {
        let load = |from: &[f32]| F32Lanes::new(simd, S::as_simd_f32s(&from[..S::F32_LANES]).0[0]);
        let mut from = 0;
        while from < self.count {
            // The last ones, some of them again.
            let at = from.min(self.count - S::F32_LANES);
            from += S::F32_LANES;
            let kind = match self.out {
                None => {
                    let [x, y, z] = before.wind;
                    let inlet = self.inlet + at;
                    let lean = load(&before.lean.0[inlet..]);
                    let lean = before.lean.1.map(|along| lean * F32Lanes::from_scalar(simd, along));
                    Kind::Inlet([load(&x[inlet..]), load(&y[inlet..]), load(&z[inlet..])], lean)
                }
                Some(out) => Kind::Outlet(out, F32Lanes::from_scalar(simd, mean_of(out, before.density)), false),
            };
            let ([drho, x, y, z], first) = (before.air.0, near - before.air.1 + at);
            let air = if self.solid {
                [F32Lanes::from_scalar(simd, 0.0); 4]
            } else {
                [load(&drho[first..]), load(&x[first..]), load(&y[first..]), load(&z[first..])]
            };
            let beyond = Beyond::new((air[0], [air[1], air[2], air[3]]), kind);
            let mut to = at;
            for i in 1..Q {
                if self.sends >> i & 1 == 1 {
                    let sent = beyond.sends(i, F32Lanes::from_scalar(simd, 0.0));
                    S::as_mut_simd_f32s(&mut out[to..to + S::F32_LANES]).0[0] = sent.value;
                    to += self.count;
                }
            }
        }
    }

    fn send_singly(&self, ghosts: &[Ghost], before: Before<'_>, out: &mut [f32]) {
        let parts = before.parts.filter(|_| !self.solid);
        for (k, ghost) in ghosts.iter().enumerate() {
            let near = (ghost.near as usize).wrapping_sub(before.air.1);
            let air = if self.solid { [0.0; 4] } else { before.air.0.map(|a| a[near]) };
            let kind = match self.out {
                None => {
                    let inlet = self.inlet + k;
                    let lean = before.lean.1.map(|along| along * before.lean.0[inlet]);
                    Kind::Inlet([0, 1, 2].map(|a| before.wind[a][inlet]), lean)
                }
                Some(out) => Kind::Outlet(out, mean_of(out, before.density), parts.is_some()),
            };
            let beyond = Beyond::new((air[0], [air[1], air[2], air[3]]), kind);
            let along = (1..Q).filter(|i| self.sends >> i & 1 == 1);
            for (nth, i) in along.enumerate() {
                out[nth * self.count + k] = beyond.sends(i, parts.map_or(0.0, |parts| parts[near][i]));
            }
        }
    }
}

/// Numbers of cells, which planning holds below 2^32.
fn small(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// Mean of what is said of the faces beyond which a place lies; `out`: their sides.
pub(super) fn mean_of<L: Lane>(out: [i8; 3], faces: [L; 6]) -> L {
    let (mut sum, mut count) = (faces[0].splat(0.0), 0.0);
    for (a, side) in out.iter().enumerate().filter(|(_, side)| **side != 0) {
        sum = sum + faces[2 * a + usize::from(*side > 0)];
        count += 1.0;
    }
    if count > 0.0 { sum.div(sum.splat(count)) } else { sum }
}
