//! Steps of the whole domain: collision and streaming in place, many nodes at once.
//!
//! An even step and the odd one after it go through the domain together, the odd one a plane behind: it finds what it reads
//! in the cache, and memory is passed through once for both. Each thread has some planes of its own; the odd step leaves
//! out those at the seams, which follow when all threads are done.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::domain::Cells;
use super::exchange::{Arriving, Leaving, Links, Plan, Planes, Taken, parts};
use super::grid::{BLOCK, Grid, Parity, Populations};
use super::ground::Surface;
use super::open_boundary::{Before, Mouths, let_go};
use super::plane_step::{Desk, Place};
use super::row_halo::End;
use super::snapshot::{Field, Pages, Plane, Reading};
use super::stencil::Q;
use osier_base::par;

/// Fewest planes of a part of the domain: two at each seam.
const FEWEST: usize = 4;

/// Blocks of a plane that are computed, from the first to before the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub from: u32,
    pub to: u32,
    /// Relaxation times are those of the tables.
    pub varied: bool,
}

/// How air relaxes.
#[derive(Debug, Clone)]
pub(super) struct Viscosity {
    /// Relaxation time without eddies, steps.
    pub tau: f32,
    /// As [`super::collide::eddies`].
    pub eddies: f32,
    /// Shares of a sponge by x and by z, from 0 to 1 before an outlet.
    pub sponge: [Vec<f32>; 2],
    /// What the ground does.
    pub ground: Surface,
    /// Body force, cells a step squared; 0 in every wind.
    pub force: [f32; 3],
}

/// What is asked of open faces in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked<'a> {
    /// Velocity at each inlet, by component, cells a step, in the order of [`super::open_boundary::Mouths::inlets`].
    pub wind: &'a [Vec<f32>; 3],
    /// How it leans with the height there, and by how much of that along x and z.
    pub lean: (&'a [f32], [f32; 2]),
    /// Mean outward velocity at each face that is an outlet, cells a step.
    pub wanted: [f32; 6],
}

/// What is computed, and how.
#[derive(Debug)]
pub(super) struct Sweep {
    pub(super) grid: Grid,
    pub(super) viscosity: Viscosity,
    /// Those of every plane.
    runs: Vec<Vec<Run>>,
    /// Least relaxation times in a plane where no sponge is by z, from its first cell on, and what a whole sponge adds.
    pub(super) least: [Vec<f32>; 2],
    /// Drag of the ground on the lowest row of a plane and the block where it ends, and shares of the sponge there; empty
    /// if there is none.
    pub(super) drag: [Vec<f32>; 2],
    /// Blocks of a plane with ends of rows.
    pub(super) ends: Vec<End>,
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
        let nodes = 0..grid.span() + BLOCK;
        let all = nodes.clone().map(|k| least(&viscosity, [k % grid.row, k / grid.row])).collect();
        let least = [all, nodes.map(|k| viscosity.ground.sponge(k / grid.row, viscosity.tau)).collect()];
        let drag = |k: usize| if k < grid.n[0] { viscosity.ground.drag } else { 0.0 };
        let dragged = if viscosity.ground.drag > 0.0 { grid.n[0] + BLOCK } else { 0 };
        let share = |k: usize| viscosity.sponge[0].get(k).copied().unwrap_or(0.0);
        let drag = [(0..dragged).map(drag).collect(), (0..dragged).map(share).collect()];
        let arch = Arch::new();
        let runs = (0..grid.n[2]).map(|z| runs(cells, &viscosity, z)).collect();
        let ends = End::list(&grid, arch.dispatch(Together));
        Self { grid, viscosity, runs, least, drag, ends, arch }
    }

    /// Has it computed with other instructions than the machine's best.
    #[cfg(test)]
    pub(super) fn compute_by(&mut self, arch: Arch) {
        (self.ends, self.arch) = (End::list(&self.grid, arch.dispatch(Together)), arch);
    }

    /// Blocks of a plane that hold air.
    pub(super) fn runs(&self, z: usize) -> &[Run] {
        &self.runs[z]
    }

    /// Computes every fluid cell once, or an even step and the odd one after it if `second` asks for that. Returns for
    /// each how many cells were too fast and clamped, and what was seen of the planes if a snapshot is written.
    pub(super) fn step(
        &self,
        populations: &mut Populations,
        links: &mut Links,
        (parity, cells): (Parity, &Cells),
        ((first, second), pages): ((Asked<'_>, Option<Asked<'_>>), Option<Pages<'_>>),
    ) -> ([u64; 2], Reading) {
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
        let snapshot = pages.as_ref().map(|p| (p.field, p.speed));
        let mut pages: Vec<_> = pages.map_or_else(Vec::new, Pages::planes).into_iter().enumerate().collect();
        let mut done = self.inner(populations, links, (pace, &cuts, cells), (second, &mut (snapshot, &mut pages)));
        if pace != Pace::Even {
            done.extend(self.seams(populations, links, (pace, &cuts, cells), &mut (snapshot, &mut pages)));
        }
        std::mem::swap(&mut links.last, &mut links.next);
        let clamped = [0, 1].map(|k| done.iter().map(|d| d.clamped[k]).sum());
        let mut planes: Vec<_> = done.into_iter().flat_map(|d| d.seen).collect();
        planes.sort_by_key(|(z, _)| *z);
        let reading = Reading { planes: planes.into_iter().map(|(_, plane)| plane).collect() };
        (if pace == Pace::Odd { [clamped[1], 0] } else { clamped }, reading)
    }

    /// Finds what open faces send in the first step.
    fn send(&self, links: &mut Links, asked: Asked<'_>) {
        let (mouths, air) = (&links.mouths, &links.last.vents);
        let before = Before {
            air: (air.air.each_ref().map(|a| &a[..]), 0),
            parts: links.plan.rest.then_some(&air.parts[..]),
            wind: asked.wind,
            lean: asked.lean,
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
        (second, book): (Option<Asked<'_>>, &mut Book<'_, '_>),
    ) -> Vec<Done> {
        let Links { plan, mouths, last, next, middle, sent, mean, fastest } = links;
        let all: Vec<_> = cuts.windows(2).map(|w| w[0]..w[1]).collect();
        let inside: Vec<_> =
            all.iter().map(|r| if r.len() < FEWEST { r.start..r.start } else { r.start + 1..r.end - 1 }).collect();
        let [first_sent, second_sent] = sent;
        let ranges: Vec<_> = all.iter().map(|r| mouths.sent(r.start).start..mouths.sent(r.end - 1).end).collect();
        let sends = parts(second_sent, &ranges).into_iter().zip(&ranges);
        let (first, later) = match pace {
            Pace::Even => (Some(next), None),
            Pace::Odd => (None, Some(next)),
            Pace::Both => (Some(middle), Some(next)),
        };
        let rooms = rooms(plan, first, &all).into_iter().zip(rooms(plan, later, &inside));
        let arriving = Arriving { plan, pieces: (&last.pieces, 0), sent: (first_sent, 0) };
        let planes = self.planes(populations, &all, 0);
        let fastest = parts(fastest, &all).into_iter();
        let jobs = planes.into_iter().zip(fastest).zip(rooms).zip(sends).zip(all.iter().zip(&inside));
        let mut jobs: Vec<_> = jobs
            .map(|((((planes, fastest), (first, second)), sent), (all, inside))| Job {
                planes,
                fastest,
                first,
                second,
                sent: (sent.0, sent.1.start),
                desk: desk(&self.grid, book, if pace == Pace::Even { all } else { inside }),
                all: all.clone(),
                inside: inside.clone(),
            })
            .collect();
        let later = second.map(|asked| (asked, density(asked, *mean)));
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
        book: &mut Book<'_, '_>,
    ) -> Vec<Done> {
        let Links { plan, last, next, middle, sent, fastest, .. } = links;
        let n = self.grid.n[2];
        let seams = cuts.iter().map(|c| c.saturating_sub(1)..(c + 1).min(n));
        // Too few planes for two seams are one.
        let seams: Vec<_> = if n < FEWEST { std::iter::once(0..n).collect() } else { seams.collect() };
        let (left, sent) = if pace == Pace::Both { (middle, &sent[1]) } else { (last, &sent[0]) };
        let arriving = Arriving { plan, pieces: (&left.pieces, 0), sent: (sent, 0) };
        let fastest = parts(fastest, &seams);
        let planes = self.planes(populations, &seams, 1).into_iter().zip(fastest);
        let jobs = planes.zip(next.cut(plan, &seams)).zip(&seams);
        let mut jobs: Vec<_> = jobs
            .map(|(((planes, fastest), room), seam)| Job {
                planes,
                fastest,
                first: None,
                second: Some(room),
                sent: (&mut [][..], 0),
                desk: desk(&self.grid, book, seam),
                all: seam.clone(),
                inside: seam.clone(),
            })
            .collect();
        par::par_map_mut(&mut jobs, |job| self.dispatch(Turn { sweep: self, job, cells, arriving, later: None }))
    }

    fn dispatch(&self, turn: Turn<'_, '_>) -> Done {
        let forced = self.viscosity.force.iter().any(|f| f.abs() > 0.0);
        match (self.viscosity.eddies > 0.0, forced) {
            (true, false) => self.arch.dispatch(With::<true, false>(turn)),
            (false, false) => self.arch.dispatch(With::<false, false>(turn)),
            (_, true) => self.arch.dispatch(With::<false, true>(turn)),
        }
    }
}

/// Rooms at some ranges of planes, where any are asked for.
fn rooms<'a>(plan: &Plan, taken: Option<&'a mut Taken>, ranges: &[Range<usize>]) -> Vec<Option<Leaving<'a>>> {
    match taken {
        Some(taken) => taken.cut(plan, ranges).into_iter().map(Some).collect(),
        None => ranges.iter().map(|_| None).collect(),
    }
}

/// Density less 1 beyond each outlet.
fn density(asked: Asked<'_>, mean: [f32; 6]) -> [f32; 6] {
    std::array::from_fn(|f| let_go(asked.wanted[f], mean[f]))
}

/// Least relaxation time at a cell of any plane.
fn least(viscosity: &Viscosity, [x, y]: [usize; 2]) -> f32 {
    let (tau, ground) = (viscosity.tau, &viscosity.ground);
    let share = viscosity.sponge[0].get(x).copied().unwrap_or(0.0);
    (tau + share * ground.sponge(y, tau)).max(ground.tau(y, tau))
}

/// Blocks of a plane that hold air, joined while they are of one kind.
fn runs(cells: &Cells, viscosity: &Viscosity, z: usize) -> Vec<Run> {
    let grid = cells.grid;
    let deep = viscosity.sponge[1].get(z).is_some_and(|share| *share > 0.0);
    let mut runs: Vec<Run> = Vec::new();
    for block in 0..grid.span().div_ceil(BLOCK) {
        let from = block * BLOCK;
        let air = |k: usize| {
            let (x, y) = (k % grid.row, k / grid.row);
            (x < grid.n[0] && y < grid.n[1] && !cells.is_solid([x, y, z])).then_some([x, y])
        };
        if !(from..from + BLOCK).any(|k| air(k).is_some()) {
            continue;
        }
        let at = u32::try_from(block).unwrap_or(u32::MAX);
        let varied = deep || (from..from + BLOCK).filter_map(air).any(|at| least(viscosity, at) > viscosity.tau);
        match runs.last_mut() {
            Some(last) if last.to == at && last.varied == varied => last.to += 1,
            _ => runs.push(Run { from: at, to: at + 1, varied }),
        }
    }
    runs
}

/// How many nodes are computed together.
struct Together;

impl WithSimd for Together {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}

struct SendPlane<'a> {
    mouths: &'a Mouths,
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
    /// Squares of the largest speeds in the planes of `all`.
    fastest: &'a mut [f32],
    /// Rooms for what the first step leaves, and the second.
    first: Option<Leaving<'a>>,
    second: Option<Leaving<'a>>,
    /// Room for what open faces send in the second step, and what comes before it in the whole.
    sent: (&'a mut [f32], usize),
    desk: Desk<'a>,
    /// Planes of the first step, and of the second.
    all: Range<usize>,
    inside: Range<usize>,
}

/// What a part has done: cells that were too fast and clamped in the first step and the second, and what was seen of
/// planes.
struct Done {
    clamped: [u64; 2],
    seen: Vec<(usize, Plane)>,
}

/// Where a snapshot is written, if one is: its field with m/s of one cell a step, and planes by number.
type Book<'a, 'b> = (Option<(&'a Field, f32)>, &'b mut Vec<(usize, &'a mut [[f32; 4]])>);

/// What a thread has at hand for some planes.
fn desk<'a>(grid: &Grid, (snapshot, pages): &mut Book<'a, '_>, planes: &Range<usize>) -> Desk<'a> {
    let mut mine: Vec<_> = pages.extract_if(.., |(z, _)| planes.contains(z)).collect();
    mine.reverse();
    Desk::new(grid, *snapshot, mine)
}

type Later<'a> = (&'a Mouths, (Asked<'a>, [f32; 6]));

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
    type Output = Done;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Done {
        self.0.run::<S, EDDIES, FORCE>(simd)
    }
}

impl Turn<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const EDDIES: bool, const FORCE: bool>(self, simd: S) -> Done {
        let Self { sweep, job, cells, arriving, later } = self;
        let Job { planes, fastest, first, second, sent: (sent, before), desk, all, inside } = job;
        let mut clamped = [0; 2];
        // The odd step is a plane behind.
        for z in all.start..all.end + 1 {
            if let Some(room) = first.as_mut().filter(|_| z < all.end) {
                let place = Place { sweep, cells, arriving, z, last: second.is_none() };
                let fastest = &mut fastest[z - all.start];
                clamped[0] += place.step::<S, false, EDDIES, FORCE>(simd, planes, desk, (&mut *room, fastest));
                if let Some((mouths, (asked, density))) = later {
                    let parts = arriving.plan.rest.then_some(&room.parts[..]);
                    let air = (room.air.0.each_ref().map(|a| &a[..]), room.air.1);
                    let Asked { wind, lean, .. } = asked;
                    let before_faces = Before { air, parts, wind, lean, density };
                    let range = mouths.sent(z);
                    mouths.send(simd, z, before_faces, &mut sent[range.start - *before..range.end - *before]);
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
                let place = Place { sweep, cells, arriving, z: behind, last: true };
                let fastest = &mut fastest[behind - all.start];
                clamped[1] += place.step::<S, true, EDDIES, FORCE>(simd, planes, desk, (&mut *room, fastest));
            }
        }
        Done { clamped, seen: std::mem::take(&mut desk.seen) }
    }
}
