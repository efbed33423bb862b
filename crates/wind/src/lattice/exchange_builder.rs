//! What boundaries pass on, found once: which populations go where.

use std::collections::BTreeMap;
use std::ops::Range;

use super::domain::{Cells, Face, Source};
use super::exchange::{Handed, Joint, Links, Piece, Plan, Run, Taken, Vents};
use super::open_boundary::{Ghost, Mouths, Sends};
use super::row_halo::Ends;
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
    /// Place of the first among the ends of rows, if that is where they arrive.
    end: Option<usize>,
}

/// Lists being made.
pub(super) struct List<'a> {
    cells: &'a Cells,
    /// By plane of arrival.
    copies: Vec<Copied>,
    ghosts: Vec<Ghost>,
    by_place: BTreeMap<[isize; 3], usize>,
    /// Direction of arrival, cell, ghost, direction sent; by plane of arrival.
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
            for i in 1..Q {
                for y in 0..grid.n[1] {
                    list.row(i, (y, z));
                }
            }
        }
        list
    }

    fn row(&mut self, i: usize, (y, z): (usize, usize)) {
        let n = self.cells.grid.n;
        let edge = y == 0 || y + 1 == n[1] || z == 0 || z + 1 == n[2];
        for x in 0..n[0] {
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
        let end = Ends::place(&self.cells.grid, i, [x[0], x[1]]);
        let copied = |leave, from, struck| Copied { arrive: i, leave, to, from, count: 1, stride: 1, struck, end };
        match self.cells.source(x, i) {
            Source::Neighbour => {}
            Source::Left(leave, q) => self.copy(copied(leave, self.spot(q), None)),
            Source::Struck(leave, q, velocity) => {
                let along: f64 = (0..3).map(|a| f64::from(C[i][a]) * velocity[a]).sum();
                let more = osier_base::math::narrow(6.0 * weight(i) * along);
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
            let alike = (last.arrive, last.leave, last.end.is_some()) == (one.arrive, one.leave, one.end.is_some())
                && last.struck.is_none()
                && one.struck.is_none();
            let step = following((last.to, last.count, last.stride), one.to, row);
            if alike && step.is_some() && step == following((last.from, last.count, last.stride), one.from, row) {
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

    pub(super) fn links(mut self, rest: bool) -> Links {
        let grid = self.cells.grid;
        let mut joints = vec![Joint::default(); grid.n[2]];
        // Taken in the order of planes they leave, put in the order of planes they reach.
        let mut order: Vec<usize> = (0..self.copies.len()).collect();
        order.sort_by_key(|k| self.copies[*k].from.0);
        let mut place = vec![0; self.copies.len()];
        let (mut take, mut at) = (Vec::new(), 0);
        for k in order {
            let c = &self.copies[k];
            place[k] = at;
            let joint = &mut joints[c.from.0];
            grow(&mut joint.take, take.len(), 1);
            grow(&mut joint.taken, at, c.count);
            take.push(Piece { more: c.struck.unwrap_or(0.0), ..self.piece(c.leave, (c.from, c.count, c.stride), at) });
            at += c.count;
        }
        let (mut put, mut handed) = (Vec::new(), Vec::new());
        for (c, at) in self.copies.iter().zip(&place) {
            let joint = &mut joints[c.to.0];
            if let Some(end) = c.end {
                grow(&mut joint.handed, handed.len(), 1);
                handed.push(Handed { to: small(end), at: small(*at), count: small(c.count) });
            } else {
                grow(&mut joint.put, put.len(), 1);
                put.push(self.piece(c.arrive, (c.to, c.count, c.stride), *at));
            }
        }
        let near = self.number_near(&mut joints);
        let (mouths, places) = self.mouths();
        let (open, opened) = self.open(&places, &mut joints);
        follow(&mut joints);
        let beside = joints.last().map_or(0, |j| j.beside.end);
        let air = std::array::from_fn(|_| vec![0.0; beside]);
        let vents = Vents { air, parts: vec![[0.0; Q]; if rest { beside } else { 0 }] };
        let last = Taken { pieces: vec![0.0; at], vents };
        let sent = [vec![0.0; mouths.len()], vec![0.0; mouths.len()]];
        let plan = Plan { grid, joints, put, handed, open, opened, take, near, rest };
        Links {
            plan,
            mouths,
            next: last.clone(),
            middle: last.clone(),
            last,
            sent,
            mean: [0.0; 6],
            fastest: vec![0.0; grid.n[2]],
        }
    }

    /// Sorts places outside by plane, so that those that are alike follow each other.
    fn mouths(&mut self) -> (Mouths, Vec<Sends>) {
        let planes = self.cells.grid.n[2];
        let mut order: Vec<usize> = (0..self.ghosts.len()).collect();
        order.sort_by_key(|k| {
            let g = &self.ghosts[*k];
            (g.plane(planes), g.inlet, g.out, g.solid, g.place[2], g.place[1], g.place[0])
        });
        let (mouths, places) = Mouths::new(order.iter().map(|k| self.ghosts[*k]).collect(), planes);
        let mut number = vec![Sends::default(); order.len()];
        order.iter().zip(places).for_each(|(k, place)| number[*k] = place);
        (mouths, number)
    }

    /// What open faces send, joined while it lies at equal distances: into memory, and to the ends of rows.
    fn open(&self, places: &[Sends], joints: &mut [Joint]) -> (Vec<Piece>, Vec<Handed>) {
        let grid = &self.cells.grid;
        let (mut open, mut opened): (Vec<Piece>, Vec<Handed>) = (Vec::new(), Vec::new());
        let mut last: Option<Spot> = None;
        for (i, spot, ghost, along) in &self.sends {
            let at = places[*ghost].place(*along);
            if let Some(end) = Ends::place(grid, *i, [spot.1 % grid.row, spot.1 / grid.row]) {
                let joint = &mut joints[spot.0].opened;
                let next = |h: &&mut Handed| {
                    joint.start < joint.end && (h.to + h.count, h.at + h.count) == (small(end), small(at))
                };
                if let Some(handed) = opened.last_mut().filter(next) {
                    handed.count += 1;
                } else {
                    grow(joint, opened.len(), 1);
                    opened.push(Handed { to: small(end), at: small(at), count: 1 });
                }
                continue;
            }
            if let (Some(piece), Some(first)) = (open.last_mut(), last) {
                let (count, stride) = (piece.run.count as usize, piece.run.stride as usize);
                let step = following((first, count, stride), *spot, grid.row);
                let follows = piece.along == direction(*i) && piece.at as usize + count == at;
                if let Some(step) = step.filter(|_| follows) {
                    (piece.run.count, piece.run.stride) = (piece.run.count + 1, small(step));
                    continue;
                }
            }
            grow(&mut joints[spot.0].open, open.len(), 1);
            open.push(self.piece(*i, (*spot, 1, 1), at));
            last = Some(*spot);
        }
        (open, opened)
    }

    fn piece(&self, along: usize, run: (Spot, usize, usize), at: usize) -> Piece {
        Piece { along: direction(along), run: self.run(run), at: small(at), more: 0.0 }
    }

    fn run(&self, ((_, k), count, stride): (Spot, usize, usize)) -> Run {
        Run { node: small(self.cells.grid.first + k), count: small(count), stride: small(stride) }
    }

    /// Which end of its row a cell is, if the face there is open: then the whole column counts as before it.
    fn column(&self, x: usize) -> Option<usize> {
        let ends = [0, self.cells.grid.n[0] - 1];
        (0..2).find(|end| x == ends[*end] && self.cells.faces[*end].is_open())
    }

    /// Numbers the cells before open faces, plane by plane, and tells each ghost its own. Returns the runs of those that
    /// are not at the ends of rows.
    fn number_near(&mut self, joints: &mut [Joint]) -> Vec<Run> {
        let rows = self.cells.grid.n[1];
        let air = self.near.iter().zip(&self.ghosts).filter(|(_, g)| !g.solid).map(|(cell, _)| *cell);
        let mut cells: Vec<[usize; 3]> = air.filter(|c| self.column(c[0]).is_none()).collect();
        cells.sort_by_key(|c| (c[2], c[1], c[0]));
        cells.dedup();
        let mut number: BTreeMap<[usize; 3], u32> = BTreeMap::new();
        let (mut runs, mut at, mut cells): (Vec<(Spot, usize, usize)>, usize, _) =
            (Vec::new(), 0, cells.iter().peekable());
        for (z, joint) in joints.iter_mut().enumerate() {
            for end in 0..2 {
                if self.cells.faces[end].is_open() {
                    joint.columns[end] = Some(at);
                    grow(&mut joint.beside, at, rows);
                    at += rows;
                }
            }
            while let Some(cell) = cells.next_if(|c| c[2] == z) {
                number.insert(*cell, small(at));
                grow(&mut joint.beside, at, 1);
                at += 1;
                let spot = self.spot(*cell);
                if let Some(last) = runs.last_mut().filter(|_| joint.near.start < joint.near.end)
                    && let Some(step) = following(*last, spot, self.cells.grid.row)
                {
                    (last.1, last.2) = (last.1 + 1, step);
                    continue;
                }
                grow(&mut joint.near, runs.len(), 1);
                runs.push((spot, 1, 1));
            }
        }
        let of = |cell: &[usize; 3]| match self.column(cell[0]) {
            Some(end) => joints[cell[2]].columns[end].map_or(0, |first| small(first + cell[1])),
            None => number.get(cell).copied().unwrap_or(0),
        };
        let numbers: Vec<u32> = self.near.iter().map(of).collect();
        self.ghosts.iter_mut().zip(numbers).for_each(|(ghost, near)| ghost.near = near);
        runs.into_iter().map(|run| self.run(run)).collect()
    }
}

/// Distance at which a cell follows some others, along the row or across rows of their plane.
fn following(((z, first), count, stride): (Spot, usize, usize), next: Spot, row: usize) -> Option<usize> {
    let step = next.1.checked_sub(first + (count - 1) * stride)?;
    let good = next.0 == z && (step == 1 || step == row);
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
    let mut ends = [0; 8];
    for j in joints {
        let ranges = [
            &mut j.put,
            &mut j.handed,
            &mut j.open,
            &mut j.opened,
            &mut j.take,
            &mut j.taken,
            &mut j.near,
            &mut j.beside,
        ];
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
