//! What boundaries pass on, found once: which populations go where.

use std::collections::BTreeMap;
use std::ops::Range;

use super::cells::{Cells, Face, Source};
use super::links::{BAND, Joint, Links, Piece, Plan, Run, Taken, VENT, Vents};
use super::open::{Ghost, Mouths};
use super::stencil::{C, Q, weight};

/// A cell: its plane, and its number in the plane, counted from the first cell.
type Spot = (usize, usize);

/// Populations at equal distances that come from other populations at the same distances.
struct Copied {
    /// Directions in which they arrive, and in which they left.
    arrive: usize,
    leave: usize,
    to: Spot,
    from: Spot,
    count: usize,
    stride: usize,
    struck: Option<f32>,
}

/// Lists being made.
pub(super) struct List<'a> {
    cells: &'a Cells,
    /// By band of arrival.
    copies: Vec<Copied>,
    ghosts: Vec<Ghost>,
    by_place: BTreeMap<[isize; 3], usize>,
    /// Direction of arrival, cell, ghost, direction sent; by band of arrival.
    sends: Vec<(usize, Spot, usize, usize)>,
    /// Cell before each ghost.
    near: Vec<[usize; 3]>,
}

impl<'a> List<'a> {
    pub(super) fn new(cells: &'a Cells) -> Self {
        let grid = &cells.grid;
        let (copies, ghosts, by_place) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut list = Self { cells, copies, ghosts, by_place, sends: Vec::new(), near: Vec::new() };
        for z in 0..grid.n[2] {
            for first in (0..grid.span()).step_by(BAND) {
                let last = grid.span().min(first + BAND);
                for i in 1..Q {
                    for y in first / grid.row..=(last - 1) / grid.row {
                        let from = first.saturating_sub(y * grid.row);
                        let to = grid.n[0].min(last - y * grid.row);
                        list.row(i, (y, z), from..to);
                    }
                }
            }
        }
        list
    }

    fn row(&mut self, i: usize, (y, z): (usize, usize), part: Range<usize>) {
        let n = self.cells.grid.n;
        let edge = y == 0 || y + 1 == n[1] || z == 0 || z + 1 == n[2];
        for x in part {
            if !self.cells.is_solid([x, y, z]) && (edge || x == 0 || x + 1 == n[0] || self.cells.beside([x, y, z], i)) {
                self.add([x, y, z], i);
            }
        }
    }

    fn spot(&self, [x, y, z]: [usize; 3]) -> Spot {
        (z, x + y * self.cells.grid.row)
    }

    fn add(&mut self, x: [usize; 3], i: usize) {
        let to = self.spot(x);
        let copied = |leave, from, struck| Copied { arrive: i, leave, to, from, count: 1, stride: 1, struck };
        match self.cells.source(x, i) {
            Source::Neighbour => {}
            Source::Left(leave, q) => self.copy(copied(leave, self.spot(q), None)),
            Source::Struck(leave, q, velocity) => {
                let along: f64 = (0..3).map(|a| f64::from(C[i][a]) * velocity[a]).sum();
                let more = crate::math::narrow(6.0 * weight(i) * along);
                self.copy(copied(leave, self.spot(q), Some(more)));
            }
            Source::Ghost(along, place) => {
                let ghost = self.ghost(place);
                self.ghosts[ghost].sends |= 1 << along;
                self.sends.push((i, to, ghost, along));
            }
        }
    }

    fn copy(&mut self, one: Copied) {
        let row = self.cells.grid.row;
        if let Some(last) = self.copies.last_mut() {
            let alike = (last.arrive, last.leave) == (one.arrive, one.leave) && last.struck.is_none();
            let step = following((last.to, last.count, last.stride), one.to, (row, BAND));
            if alike
                && one.struck.is_none()
                && step.is_some()
                && step == following((last.from, last.count, last.stride), one.from, (row, BAND))
            {
                (last.count, last.stride) = (last.count + 1, step.unwrap_or(1));
                return;
            }
        }
        self.copies.push(one);
    }

    #[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "sizes fit; clamped to the domain")]
    fn ghost(&mut self, place: [isize; 3]) -> usize {
        if let Some(known) = self.by_place.get(&place) {
            return *known;
        }
        let faces = self.cells.beyond(place).map(|f| f.map(|f| (f, self.cells.faces[f])));
        let inlet = faces.iter().flatten().any(|(_, f)| *f == Face::Inlet);
        let side = |f: &Option<(usize, Face)>| match f {
            Some((f, Face::Outlet)) if f % 2 == 1 => 1,
            Some((_, Face::Outlet)) => -1,
            _ => 0,
        };
        let near: [usize; 3] = std::array::from_fn(|a| place[a].clamp(0, self.cells.grid.n[a] as isize - 1) as usize);
        let number = self.ghosts.len();
        let mut beyond = faces.iter().flatten().map(|f| f.0);
        let face = beyond.next().filter(|_| beyond.next().is_none());
        let out = std::array::from_fn(|a| side(&faces[a]));
        let solid = self.cells.is_solid(near);
        self.ghosts.push(Ghost { place, near: 0, solid, sends: 0, inlet, out, face });
        self.near.push(near);
        self.by_place.insert(place, number);
        number
    }

    fn band(&self, (z, k): Spot) -> usize {
        z * self.cells.grid.bands() + k / BAND
    }

    pub(super) fn links(mut self, rest: bool) -> Links {
        let grid = self.cells.grid;
        let mut joints = vec![Joint::default(); grid.bands() * grid.n[2]];
        let mut struck = Vec::new();
        // Taken in the order of bands they leave, put in the order of bands they reach.
        let mut order: Vec<usize> = (0..self.copies.len()).collect();
        order.sort_by_key(|k| self.band(self.copies[*k].from));
        let mut place = vec![0; self.copies.len()];
        let (mut take, mut at) = (Vec::new(), 0);
        for k in order {
            let c = &self.copies[k];
            place[k] = at;
            struck.extend(c.struck.map(|more| (small(at), more)));
            let joint = &mut joints[self.band(c.from)];
            grow(&mut joint.take, take.len(), 1);
            grow(&mut joint.taken, at, c.count);
            take.push(self.piece(c.leave, (c.from, c.count, c.stride), at));
            at += c.count;
        }
        let mut put = Vec::new();
        for (c, at) in self.copies.iter().zip(&place) {
            grow(&mut joints[self.band(c.to)].put, put.len(), 1);
            put.push(self.piece(c.arrive, (c.to, c.count, c.stride), *at));
        }
        let (near, beside) = self.number_near(&mut joints);
        let (mouths, places) = self.mouths();
        let open = self.open(&mouths, &places, &mut joints);
        let parts = if rest { beside + 1 } else { 0 };
        let vents = Vents { air: vec![[0.0; 4]; beside + 1], parts: vec![[0.0; Q]; parts] };
        let taken = Taken { pieces: vec![0.0; at], vents };
        follow(&mut joints);
        let plan = Plan { grid, joints, put, open, take, near, rest };
        Links { plan, mouths, struck, last: taken.clone(), next: taken }
    }

    /// Sorts places outside so that those that are alike follow each other.
    fn mouths(&mut self) -> (Mouths, Vec<(usize, usize)>) {
        let mut order: Vec<usize> = (0..self.ghosts.len()).collect();
        order.sort_by_key(|k| {
            let g = &self.ghosts[*k];
            (g.inlet, g.sends, g.out, g.solid, g.place[2], g.place[1], g.place[0])
        });
        let (mouths, places) = Mouths::new(order.iter().map(|k| self.ghosts[*k]).collect());
        let mut number = vec![(0, 0); order.len()];
        order.iter().zip(places).for_each(|(k, place)| number[*k] = place);
        (mouths, number)
    }

    /// What open faces send, joined while it lies at equal distances.
    fn open(&self, mouths: &Mouths, places: &[(usize, usize)], joints: &mut [Joint]) -> Vec<Piece> {
        debug_assert_eq!(mouths.ghosts.len(), places.len());
        let (mut open, mut last): (Vec<Piece>, Option<(usize, Spot)>) = (Vec::new(), None);
        for (i, spot, ghost, along) in &self.sends {
            let before = (self.ghosts[*ghost].sends & ((1 << along) - 1)).count_ones() as usize;
            let at = places[*ghost].0 + before * places[*ghost].1;
            let band = self.band(*spot);
            if let (Some(piece), Some((of, first))) = (open.last_mut(), last) {
                let (count, stride) = (piece.run.count as usize, piece.run.stride as usize);
                let step = following((first, count, stride), *spot, (self.cells.grid.row, BAND));
                let follows = piece.along == direction(*i) && piece.at as usize + count == at && of == band;
                if let Some(step) = step.filter(|_| follows) {
                    (piece.run.count, piece.run.stride) = (piece.run.count + 1, small(step));
                    continue;
                }
            }
            grow(&mut joints[band].open, open.len(), 1);
            open.push(self.piece(*i, (*spot, 1, 1), at));
            last = Some((band, *spot));
        }
        open
    }

    fn piece(&self, along: usize, run: (Spot, usize, usize), at: usize) -> Piece {
        Piece { along: direction(along), run: self.run(run), at: small(at) }
    }

    fn run(&self, ((_, k), count, stride): (Spot, usize, usize)) -> Run {
        Run { node: small(self.cells.grid.first() + k), count: small(count), stride: small(stride) }
    }

    /// Sorts the cells before open faces by band and tells each ghost its own. Returns their runs, and how many there are.
    fn number_near(&mut self, joints: &mut [Joint]) -> (Vec<Run>, usize) {
        let (n, row) = (self.cells.grid.n, self.cells.grid.row);
        let air = |(near, ghost): (&[usize; 3], &Ghost)| (!ghost.solid).then_some(*near);
        let mut cells: Vec<[usize; 3]> = self.near.iter().zip(&self.ghosts).filter_map(air).collect();
        // Those at the ends of rows as columns.
        let column = |c: &[usize; 3]| if c[0] == 0 || c[0] + 1 == n[0] { c[0] + 1 } else { 0 };
        // The band after which it is looked at.
        let after = |(z, k): Spot| self.band((z, (k / VENT * VENT + VENT - BAND).min(self.cells.grid.span() - 1)));
        cells.sort_by_key(|c| (after(self.spot(*c)), column(c), c[1], c[0]));
        cells.dedup();
        let mut runs: Vec<(Spot, usize, usize)> = Vec::new();
        for (k, cell) in cells.iter().enumerate() {
            let spot = self.spot(*cell);
            let joint = &mut joints[after(spot)];
            grow(&mut joint.beside, k, 1);
            if let Some(last) = runs.last_mut()
                && let Some(step) = following(*last, spot, (row, VENT))
            {
                (last.1, last.2) = (last.1 + 1, step);
                continue;
            }
            grow(&mut joint.near, runs.len(), 1);
            runs.push((spot, 1, 1));
        }
        let number: BTreeMap<[usize; 3], u32> = cells.iter().enumerate().map(|(k, c)| (*c, small(k))).collect();
        for (ghost, near) in self.ghosts.iter_mut().zip(&self.near) {
            ghost.near = number.get(near).copied().unwrap_or(small(cells.len()));
        }
        (runs.into_iter().map(|run| self.run(run)).collect(), cells.len())
    }
}

/// Distance at which a cell follows some others, along the row or across rows: one after the other in a band of
/// so many nodes.
fn following(
    ((z, first), count, stride): (Spot, usize, usize),
    next: Spot,
    (row, band): (usize, usize),
) -> Option<usize> {
    let step = next.1.checked_sub(first + (count - 1) * stride)?;
    let good = next.0 == z && first / band == next.1 / band && (step == 1 || step == row);
    (good && (count == 1 || step == stride)).then_some(step)
}

/// Makes a range that is filled in order longer.
fn grow(range: &mut Range<usize>, at: usize, count: usize) {
    if range.start == range.end {
        *range = at..at;
    }
    range.end += count;
}

/// Empty ranges begin where the ones before end.
fn follow(joints: &mut [Joint]) {
    let mut ends = [0; 6];
    for joint in joints {
        let ranges =
            [&mut joint.put, &mut joint.open, &mut joint.take, &mut joint.taken, &mut joint.near, &mut joint.beside];
        for (range, end) in ranges.into_iter().zip(&mut ends) {
            if range.start == range.end {
                *range = *end..*end;
            }
            *end = range.end;
        }
    }
}

fn direction(i: usize) -> u8 {
    u8::try_from(i).unwrap_or(0)
}

/// Numbers of nodes and links, which planning holds below 2^32.
fn small(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
