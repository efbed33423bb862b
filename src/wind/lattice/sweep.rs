//! Steps of the whole domain: collision and streaming in place, many nodes at once.
//!
//! An even step and the odd one after it go through the domain together, the odd one a plane behind: it finds what it reads
//! in the cache, and memory is passed through once for both. Each thread has some planes of its own; the odd step leaves
//! out those at the seams, which follow when all threads are done.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::cells::Cells;
use super::collide::moments;
use super::collide::{Collided, FASTEST, Relax, collide};
use super::ends::{Ends, lane_of};
use super::grid::{BLOCK, Grid, Parity, Populations};
use super::lane::{Lane as _, Wide};
use super::links::{Arriving, Leaving, Links, Planes, parts};
use super::open::{Before, lanes, let_go};
use super::stencil::{Q, opposite};
use crate::par;

/// Fewest planes of a part of the domain: two at each seam.
const FEWEST: usize = 4;

/// Blocks of a plane that are computed, from the first to before the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    from: u32,
    to: u32,
    /// Relaxation times are those of the tables.
    sponge: bool,
}

/// How air relaxes.
#[derive(Debug, Clone)]
pub(super) struct Viscosity {
    /// Relaxation time without eddies, steps.
    pub tau: f32,
    /// As [`super::collide::eddies`].
    pub eddies: f32,
    /// Least relaxation times by x and by z, where a sponge lies before an outlet; `tau` elsewhere.
    pub sponge: [Vec<f32>; 2],
    /// Body force, cells a step squared; 0 in every wind.
    pub force: [f32; 3],
}

/// What is asked of open faces in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked<'a> {
    /// Velocity at each inlet, by component, cells a step, in the order of [`super::open::Mouths::inlets`].
    pub wind: &'a [Vec<f32>; 3],
    /// Mean outward velocity at each face that is an outlet, cells a step.
    pub wanted: [f32; 6],
}

/// What is computed, and how.
#[derive(Debug)]
pub(super) struct Sweep {
    grid: Grid,
    viscosity: Viscosity,
    /// Those of every plane.
    planes: Vec<Vec<Run>>,
    /// As `viscosity.sponge`, in the order of memory: a row of numbers, and a block more of the next.
    across: Vec<f32>,
    pub(super) arch: Arch,
}

/// One or two steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pace {
    Even,
    Odd,
    Both,
}

impl Sweep {
    pub(super) fn new(cells: &Cells, viscosity: Viscosity) -> Self {
        let grid = cells.grid;
        let planes = (0..grid.n[2]).map(|z| runs(cells, &viscosity, z)).collect();
        let across = |k: usize| viscosity.sponge[0].get(k % grid.row).copied().unwrap_or(viscosity.tau);
        let across = (0..grid.row + BLOCK).map(across).collect();
        Self { grid, viscosity, planes, across, arch: Arch::new() }
    }

    /// Computes every fluid cell once, or an even step and the odd one after it if `second` asks for that. Returns for
    /// each how many cells were too fast and clamped.
    pub(super) fn step(
        &self,
        populations: &mut Populations,
        links: &mut Links,
        (parity, cells): (Parity, &Cells),
        (first, second): (Asked<'_>, Option<Asked<'_>>),
    ) -> [u64; 2] {
        let pace = match (parity, second) {
            (Parity::Odd, _) => Pace::Odd,
            (Parity::Even, None) => Pace::Even,
            (Parity::Even, Some(_)) => Pace::Both,
        };
        if parity == Parity::Even {
            links.mean = links.mouths.outflow(&links.last.vents.air);
        }
        self.send(links, first);
        let cuts = self.cuts();
        let mut clamped = [0; 2];
        let mut add = |more: [u64; 2]| (0..2).for_each(|k| clamped[k] += more[k]);
        self.inner(populations, links, (pace, &cuts, cells), second).into_iter().for_each(&mut add);
        if pace != Pace::Even {
            self.seams(populations, links, (pace, &cuts, cells)).into_iter().for_each(&mut add);
        }
        std::mem::swap(&mut links.last, &mut links.next);
        if pace == Pace::Odd { [clamped[1], 0] } else { clamped }
    }

    /// Finds what open faces send in the first step.
    fn send(&self, links: &mut Links, asked: Asked<'_>) {
        let (mouths, air) = (&links.mouths, &links.last.vents);
        let before = Before {
            air: (air.air.each_ref().map(|a| &a[..]), 0),
            parts: links.plan.rest.then_some(&air.parts[..]),
            wind: asked.wind,
            density: density(asked, links.mean),
        };
        let ranges: Vec<_> = (0..self.grid.n[2]).map(|z| mouths.sent(z)).collect();
        let mut parts: Vec<_> = parts(&mut links.sent[0], &ranges).into_iter().enumerate().collect();
        parts.retain(|(_, out)| !out.is_empty());
        par::par_each(&mut parts, |(z, out)| {
            self.arch.dispatch(SendPlane { mouths, z: *z, before, out });
        });
    }

    /// Where the planes are cut into parts, from 0 to their number.
    fn cuts(&self) -> Vec<usize> {
        let n = self.grid.n[2];
        let count = par::threads().min(n / FEWEST).max(1);
        (0..=count).map(|k| k * n / count).collect()
    }

    /// The arrays cut at planes: those from one before the first to one after the last of each range.
    fn planes<'a>(&self, populations: &'a mut Populations, ranges: &[Range<usize>], margin: usize) -> Vec<Planes<'a>> {
        let plane = self.grid.plane;
        let whole: Vec<_> = ranges.iter().map(|r| r.start + 1 - margin..r.end + 1 + margin).collect();
        let elements: Vec<_> = whole.iter().map(|r| r.start * plane..r.end * plane).collect();
        let mut planes: Vec<_> = whole.iter().map(|r| Planes { arrays: Vec::with_capacity(Q), low: r.start }).collect();
        for array in populations.arrays_mut() {
            let cut = parts(array, &elements);
            planes.iter_mut().zip(cut).for_each(|(planes, part)| planes.arrays.push(part));
        }
        planes
    }

    /// The first step of every plane, and the second of those that no other part touches.
    fn inner(
        &self,
        populations: &mut Populations,
        links: &mut Links,
        (pace, cuts, cells): (Pace, &[usize], &Cells),
        second: Option<Asked<'_>>,
    ) -> Vec<[u64; 2]> {
        let Links { plan, mouths, last, next, middle, sent, mean } = links;
        let all: Vec<_> = cuts.windows(2).map(|w| w[0]..w[1]).collect();
        let inside: Vec<_> =
            all.iter().map(|r| if r.len() < FEWEST { r.start..r.start } else { r.start + 1..r.end - 1 }).collect();
        let [first_sent, second_sent] = sent;
        let ranges: Vec<_> = all.iter().map(|r| mouths.sent(r.start).start..mouths.sent(r.end - 1).end).collect();
        let sends = parts(second_sent, &ranges).into_iter().zip(&ranges);
        let (firsts, seconds): (Vec<Option<Leaving<'_>>>, Vec<Option<Leaving<'_>>>) = match pace {
            Pace::Even => (next.cut(plan, &all).into_iter().map(Some).collect(), all.iter().map(|_| None).collect()),
            Pace::Odd => (all.iter().map(|_| None).collect(), next.cut(plan, &inside).into_iter().map(Some).collect()),
            Pace::Both => (
                middle.cut(plan, &all).into_iter().map(Some).collect(),
                next.cut(plan, &inside).into_iter().map(Some).collect(),
            ),
        };
        let arriving = Arriving { plan, pieces: (&last.pieces, 0), sent: (first_sent, 0) };
        let planes = self.planes(populations, &all, 0);
        let jobs = planes.into_iter().zip(firsts).zip(seconds).zip(sends).zip(all.iter().zip(&inside));
        let mut jobs: Vec<_> = jobs
            .map(|((((planes, first), second), sent), (all, inside))| Job {
                planes,
                first,
                second,
                sent: (sent.0, sent.1.start),
                all: all.clone(),
                inside: inside.clone(),
            })
            .collect();
        let later = second.map(|asked| (asked.wind, density(asked, *mean)));
        let mouths = &*mouths;
        par::par_map_mut(&mut jobs, |job| {
            self.dispatch(Turn { sweep: self, job, cells, arriving, later: later.map(|l| (mouths, l)) })
        })
    }

    /// The second step of the planes at seams.
    fn seams(
        &self,
        populations: &mut Populations,
        links: &mut Links,
        (pace, cuts, cells): (Pace, &[usize], &Cells),
    ) -> Vec<[u64; 2]> {
        let Links { plan, last, next, middle, sent, .. } = links;
        let n = self.grid.n[2];
        let seams: Vec<_> =
            if n < FEWEST { vec![0..n] } else { cuts.iter().map(|c| c.saturating_sub(1)..(c + 1).min(n)).collect() };
        let (left, sent) = if pace == Pace::Both { (middle, &sent[1]) } else { (last, &sent[0]) };
        let arriving = Arriving { plan, pieces: (&left.pieces, 0), sent: (sent, 0) };
        let jobs = self.planes(populations, &seams, 1).into_iter().zip(next.cut(plan, &seams)).zip(&seams);
        let mut jobs: Vec<_> = jobs
            .map(|((planes, room), seam)| Job {
                planes,
                first: None,
                second: Some(room),
                sent: (&mut [][..], 0),
                all: seam.clone(),
                inside: seam.clone(),
            })
            .collect();
        par::par_map_mut(&mut jobs, |job| self.dispatch(Turn { sweep: self, job, cells, arriving, later: None }))
    }

    fn dispatch(&self, turn: Turn<'_, '_>) -> [u64; 2] {
        let forced = self.viscosity.force.iter().any(|f| f.abs() > 0.0);
        match (self.viscosity.eddies > 0.0, forced) {
            (true, false) => self.arch.dispatch(With::<true, false>(turn)),
            (false, false) => self.arch.dispatch(With::<false, false>(turn)),
            (_, true) => self.arch.dispatch(With::<false, true>(turn)),
        }
    }
}

/// Density less 1 beyond each outlet.
fn density(asked: Asked<'_>, mean: [f32; 6]) -> [f32; 6] {
    std::array::from_fn(|f| let_go(asked.wanted[f], mean[f]))
}

/// Blocks of a plane that hold air, joined while they are of one kind.
fn runs(cells: &Cells, viscosity: &Viscosity, z: usize) -> Vec<Run> {
    let grid = cells.grid;
    let deep = viscosity.sponge[1].get(z).is_some_and(|t| *t > viscosity.tau);
    let rises: Vec<bool> =
        (0..grid.n[0]).map(|x| viscosity.sponge[0].get(x).is_some_and(|t| *t > viscosity.tau)).collect();
    let mut runs: Vec<Run> = Vec::new();
    for block in 0..grid.span().div_ceil(BLOCK) {
        let from = block * BLOCK;
        let air = |k: usize| {
            let (x, y) = (k % grid.row, k / grid.row);
            (x < grid.n[0] && y < grid.n[1] && !cells.is_solid([x, y, z])).then_some(x)
        };
        if !(from..from + BLOCK).any(|k| air(k).is_some()) {
            continue;
        }
        let at = u32::try_from(block).unwrap_or(u32::MAX);
        let sponge = deep || (from..from + BLOCK).filter_map(air).any(|x| rises[x]);
        match runs.last_mut() {
            Some(last) if last.to == at && last.sponge == sponge => last.to += 1,
            _ => runs.push(Run { from: at, to: at + 1, sponge }),
        }
    }
    runs
}

struct SendPlane<'a> {
    mouths: &'a super::open::Mouths,
    z: usize,
    before: Before<'a>,
    out: &'a mut [f32],
}

impl WithSimd for SendPlane<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.mouths.send(simd, self.z, self.before, self.out);
    }
}

/// A part of the domain: planes of its own, and rooms for what they leave.
struct Job<'a> {
    planes: Planes<'a>,
    /// Rooms for what the first step leaves, and the second.
    first: Option<Leaving<'a>>,
    second: Option<Leaving<'a>>,
    /// Room for what open faces send in the second step, and what comes before it in the whole.
    sent: (&'a mut [f32], usize),
    /// Planes of the first step, and of the second.
    all: Range<usize>,
    inside: Range<usize>,
}

type Later<'a> = (&'a super::open::Mouths, (&'a [Vec<f32>; 3], [f32; 6]));

struct Turn<'a, 'b> {
    sweep: &'a Sweep,
    job: &'a mut Job<'b>,
    cells: &'a Cells,
    arriving: Arriving<'a>,
    /// What open faces are asked in the second of two steps.
    later: Option<Later<'a>>,
}

struct With<'a, 'b, const EDDIES: bool, const FORCE: bool>(Turn<'a, 'b>);

impl<const EDDIES: bool, const FORCE: bool> WithSimd for With<'_, '_, EDDIES, FORCE> {
    type Output = [u64; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [u64; 2] {
        self.0.run::<S, EDDIES, FORCE>(simd)
    }
}

impl Turn<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const EDDIES: bool, const FORCE: bool>(self, simd: S) -> [u64; 2] {
        let Self { sweep, job, cells, arriving, later } = self;
        let Job { planes, first, second, sent: (sent, before), all, inside } = job;
        let mut ends = Ends::new(&sweep.grid);
        let mut clamped = [0; 2];
        // The odd step is a plane behind.
        for z in all.start..all.end + 1 {
            if let Some(room) = first.as_mut().filter(|_| z < all.end) {
                let place = Place { sweep, cells, arriving, z };
                clamped[0] += place.step::<S, false, EDDIES, FORCE>(simd, planes, &mut ends, room);
                if let Some((mouths, (wind, density))) = later {
                    let parts = arriving.plan.rest.then_some(&room.parts[..]);
                    let asked =
                        Before { air: (room.air.0.each_ref().map(|a| &a[..]), room.air.1), parts, wind, density };
                    let range = mouths.sent(z);
                    mouths.send(simd, z, asked, &mut sent[range.start - *before..range.end - *before]);
                }
            }
            let behind = z.wrapping_sub(1);
            if let Some(room) = second.as_mut().filter(|_| inside.contains(&behind)) {
                let arriving = match first {
                    Some(left) => {
                        let pieces = (&left.pieces.0[..], left.pieces.1);
                        Arriving { plan: arriving.plan, pieces, sent: (&sent[..], *before) }
                    }
                    None => arriving,
                };
                let place = Place { sweep, cells, arriving, z: behind };
                clamped[1] += place.step::<S, true, EDDIES, FORCE>(simd, planes, &mut ends, room);
            }
        }
        clamped
    }
}

/// A plane in hand.
#[derive(Clone, Copy)]
struct Place<'a> {
    sweep: &'a Sweep,
    cells: &'a Cells,
    arriving: Arriving<'a>,
    z: usize,
}

/// The fifteen arrays of a plane under names of their own, all of one length that the compiler knows to be one.
macro_rules! bind {
    ($simd:ty, $arrays:expr, $start:expr, $length:expr; $($name:ident $k:literal)*) => {
        let [$($name),*] = $arrays else { return 0 };
        let count = $length / <$simd>::F32_LANES;
        $(let $name = &mut <$simd>::as_mut_simd_f32s(&mut $name[$start($k)..][..$length]).0[..count];)*
    };
}

impl Place<'_> {
    /// A step of the plane, from what arrives at it to what leaves it.
    #[inline(always)]
    fn step<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool>(
        self,
        simd: S,
        planes: &mut Planes<'_>,
        ends: &mut Ends,
        room: &mut Leaving<'_>,
    ) -> u64 {
        let parity = if ODD { Parity::Odd } else { Parity::Even };
        self.arriving.put(planes, ends, (parity, self.z));
        let clamped = self.collide::<S, ODD, EDDIES, FORCE>(simd, planes, ends, room);
        self.arriving.take(planes, (parity, self.z), room);
        self.vent(simd, planes, parity, room);
        clamped
    }

    #[inline(always)]
    fn collide<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool>(
        self,
        simd: S,
        planes: &mut Planes<'_>,
        ends: &Ends,
        room: &mut Leaving<'_>,
    ) -> u64 {
        let Self { sweep, cells, z, .. } = self;
        let grid = &sweep.grid;
        let length = grid.span().next_multiple_of(BLOCK);
        let first = planes.before(grid, z) + grid.first;
        let parity = if ODD { Parity::Odd } else { Parity::Even };
        let start = |k: usize| first.wrapping_add_signed(grid.aside(parity, k));
        let mut clamped = 0;
        let parts = BLOCK / S::F32_LANES;
        let v = &sweep.viscosity;
        let deep = v.sponge[1].get(z).copied().unwrap_or(v.tau);
        let plain = Relax {
            tau: Wide::splat(simd, v.tau),
            eddies: Wide::splat(simd, v.eddies),
            force: [Wide::splat(simd, v.force[0]), Wide::splat(simd, v.force[1]), Wide::splat(simd, v.force[2])],
        };
        bind!(S, planes.arrays.as_mut_slice(), start, length;
            a0 0 a1 1 a2 2 a3 3 a4 4 a5 5 a6 6 a7 7 a8 8 a9 9 a10 10 a11 11 a12 12 a13 13 a14 14);
        for run in &sweep.planes[z] {
            let mut relax = plain;
            let (from, to) = (run.from as usize * parts, (run.to as usize * parts).min(length / S::F32_LANES));
            // Place of a block in its row.
            let mut x = from * S::F32_LANES % grid.row;
            for b in from..to {
                let node = b * S::F32_LANES;
                let end = x == 0 || x + S::F32_LANES >= grid.n[0];
                if run.sponge {
                    let along = Wide::new(simd, S::as_simd_f32s(&sweep.across[x..]).0[0]);
                    relax.tau = Wide::new(simd, simd.max_f32s(along.value, simd.splat_f32s(deep)));
                }
                let read = [
                    a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b],
                    a13[b], a14[b],
                ];
                let mut g = [relax.tau; Q];
                for i in 0..Q {
                    g[i] = Wide::new(simd, read[if ODD { opposite(i) } else { i }]);
                }
                if end {
                    ends.hand(simd, grid, node, &mut g);
                }
                let after = collide::<_, EDDIES, FORCE>(&g, relax);
                if after.square.any_above(FASTEST * FASTEST) {
                    clamped += too_fast(cells, &spelt(simd, after.square)[..S::F32_LANES], node, z);
                }
                let mut done = [after.g[0].value; Q];
                for i in 0..Q {
                    done[if ODD { i } else { opposite(i) }] = after.g[i].value;
                }
                [
                    a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b],
                    a13[b], a14[b],
                ] = done;
                if end {
                    self.vent_ends(simd, node, &after, room);
                }
                x += S::F32_LANES;
                while x >= grid.row {
                    x -= grid.row;
                }
            }
        }
        clamped
    }

    /// Takes the air in the cells of a block that are at open ends of rows. `node`: the block's first.
    #[inline(always)]
    fn vent_ends<S: Simd>(self, simd: S, node: usize, after: &Collided<Wide<S>>, room: &mut Leaving<'_>) {
        let (grid, plan) = (&self.sweep.grid, self.arriving.plan);
        let columns = plan.joints[self.z].columns;
        if columns[0].is_none() && columns[1].is_none() {
            return;
        }
        let air = [after.drho, after.u[0], after.u[1], after.u[2]].map(|value| spelt(simd, value));
        for end in 0..2 {
            let Some(column) = columns[end] else { continue };
            let mut y = node / grid.row;
            while y * grid.row < node + S::F32_LANES {
                if let Some(lane) = lane_of(grid, (node, S::F32_LANES), (end, y)) {
                    let number = column + y - room.air.1;
                    for a in 0..4 {
                        room.air.0[a][number] = air[a][lane];
                    }
                    if plan.rest {
                        for i in 0..Q {
                            room.parts[number][i] = spelt(simd, after.g[i])[lane];
                        }
                    }
                }
                y += 1;
            }
        }
    }

    /// Takes the air in the other cells before open faces.
    #[inline(always)]
    fn vent<S: Simd>(self, simd: S, planes: &Planes<'_>, parity: Parity, room: &mut Leaving<'_>) {
        let plan = self.arriving.plan;
        let joint = &plan.joints[self.z];
        let mut number = joint.first_run(plan.grid.n[1]) - room.air.1;
        for run in &plan.near[joint.near.clone()] {
            for skip in (0..run.count as usize).step_by(BLOCK) {
                let count = BLOCK.min(run.count as usize - skip);
                let mut g = [[0.0_f32; BLOCK]; Q];
                self.arriving.vent(planes, (parity, self.z), (*run, skip), &mut g);
                for part in 0..count.div_ceil(S::F32_LANES) {
                    let mut all = [Wide::splat(simd, 0.0); Q];
                    for i in 0..Q {
                        all[i] = lanes(simd, &g[i], part);
                    }
                    let (drho, u) = moments(&all);
                    let from = part * S::F32_LANES;
                    let some = S::F32_LANES.min(count - from);
                    for (to, value) in room.air.0.iter_mut().zip([drho, u[0], u[1], u[2]]) {
                        to[number + from..][..some].copy_from_slice(&spelt(simd, value)[..some]);
                    }
                }
                if plan.rest {
                    for k in 0..count {
                        for i in 0..Q {
                            room.parts[number + k][i] = g[i][k];
                        }
                    }
                }
                number += count;
            }
        }
    }
}

/// Lanes as numbers.
#[inline(always)]
fn spelt<S: Simd>(simd: S, value: Wide<S>) -> [f32; BLOCK] {
    let _ = simd;
    let mut numbers = [0.0; BLOCK];
    S::as_mut_simd_f32s(&mut numbers).0[0] = value.value;
    numbers
}

/// Fluid cells among some nodes whose squared speed is over the limit. `at`: the first node's number in its plane, from the
/// first cell.
#[cold]
#[inline(never)]
fn too_fast(cells: &Cells, squares: &[f32], at: usize, z: usize) -> u64 {
    let limit = crate::math::narrow(FASTEST * FASTEST);
    let hit = |(k, uu): (usize, &f32)| {
        let (x, y) = ((at + k) % cells.grid.row, (at + k) / cells.grid.row);
        *uu > limit && x < cells.grid.n[0] && y < cells.grid.n[1] && !cells.is_solid([x, y, z])
    };
    squares.iter().enumerate().filter(|s| hit(*s)).count() as u64
}
