//! What boundaries pass on, found once: which populations go where.

use std::collections::BTreeMap;
use std::ops::Range;

use super::cells::{Cells, Face, Source};
use super::links::{BAND, Ghost, Joint, Links, Piece, Plan, Taken};
use super::stencil::{C, Q, weight};

/// Populations side by side that come from other populations side by side.
struct Copied {
    /// Directions in which they arrive, and in which they left.
    arrive: usize,
    leave: usize,
    to: [usize; 3],
    from: [usize; 3],
    count: usize,
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
    sends: Vec<(usize, [usize; 3], usize, usize)>,
    /// Cell before each ghost.
    near: Vec<Option<[usize; 3]>>,
}

impl<'a> List<'a> {
    pub(super) fn new(cells: &'a Cells) -> Self {
        let [nx, ny, nz] = cells.grid.n;
        let (copies, ghosts, by_place) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut list = Self { cells, copies, ghosts, by_place, sends: Vec::new(), near: Vec::new() };
        for z in 0..nz {
            for first in (0..ny).step_by(BAND) {
                for i in 1..Q {
                    for y in first..ny.min(first + BAND) {
                        list.row(i, (y, z), nx);
                    }
                }
            }
        }
        list
    }

    fn row(&mut self, i: usize, (y, z): (usize, usize), nx: usize) {
        let n = self.cells.grid.n;
        let edge = y == 0 || y + 1 == n[1] || z == 0 || z + 1 == n[2];
        for x in 0..nx {
            if !self.cells.is_solid([x, y, z]) && (edge || x == 0 || x + 1 == nx || self.cells.beside([x, y, z], i)) {
                self.add([x, y, z], i);
            }
        }
    }

    fn add(&mut self, x: [usize; 3], i: usize) {
        match self.cells.source(x, i) {
            Source::Neighbour => {}
            Source::Left(leave, q) => self.copy(Copied { arrive: i, leave, to: x, from: q, count: 1, struck: None }),
            Source::Struck(leave, q, velocity) => {
                let along: f64 = (0..3).map(|a| f64::from(C[i][a]) * velocity[a]).sum();
                let more = crate::math::narrow(6.0 * weight(i) * along);
                self.copy(Copied { arrive: i, leave, to: x, from: q, count: 1, struck: Some(more) });
            }
            Source::Ghost(along, place) => {
                let ghost = self.ghost(place);
                self.ghosts[ghost].sends |= 1 << along;
                self.sends.push((i, x, ghost, along));
            }
        }
    }

    fn copy(&mut self, one: Copied) {
        if let Some(last) = self.copies.last_mut() {
            let follows = |a: [usize; 3], b: [usize; 3]| a[0] + last.count == b[0] && a[1] == b[1] && a[2] == b[2];
            let alike = (last.arrive, last.leave) == (one.arrive, one.leave);
            if alike
                && one.struck.is_none()
                && last.struck.is_none()
                && follows(last.to, one.to)
                && follows(last.from, one.from)
            {
                last.count += 1;
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
        let is_inlet = faces.iter().flatten().any(|(_, f)| *f == Face::Inlet);
        let side = |f: &Option<(usize, Face)>| match f {
            Some((f, Face::Outlet)) if f % 2 == 1 => 1,
            Some((_, Face::Outlet)) => -1,
            _ => 0,
        };
        let near: [usize; 3] = std::array::from_fn(|a| place[a].clamp(0, self.cells.grid.n[a] as isize - 1) as usize);
        let number = self.ghosts.len();
        // Which inlet it is will be counted in the end.
        let inlet = is_inlet.then_some(0);
        let mut beyond = faces.iter().flatten().map(|f| f.0);
        let face = beyond.next().filter(|_| beyond.next().is_none());
        let out = std::array::from_fn(|a| side(&faces[a]));
        self.ghosts.push(Ghost { place, near: None, sends: 0, at: 0, inlet, out, face });
        self.near.push((!self.cells.is_solid(near)).then_some(near));
        self.by_place.insert(place, number);
        number
    }

    fn band(&self, cell: [usize; 3]) -> usize {
        cell[2] * self.cells.grid.bands() + cell[1] / BAND
    }

    /// Number of a cell's node in its plane.
    fn node(&self, cell: [usize; 3]) -> u32 {
        small(super::grid::BLOCK + cell[0] + self.cells.grid.row * (cell[1] + 1))
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
            take.push(self.piece(c.leave, c.from, (c.count, at)));
            at += c.count;
        }
        let mut put = Vec::new();
        for (c, at) in self.copies.iter().zip(&place) {
            grow(&mut joints[self.band(c.to)].put, put.len(), 1);
            put.push(self.piece(c.arrive, c.to, (c.count, *at)));
        }
        let near = self.number_ghosts(&mut joints);
        let (mut sent, mut inlets) = (0, 0);
        for ghost in &mut self.ghosts {
            ghost.at = small(sent);
            sent += ghost.sends.count_ones() as usize;
            if let Some(number) = &mut ghost.inlet {
                *number = inlets;
                inlets += 1;
            }
        }
        let mut open = Vec::new();
        for (i, cell, ghost, along) in &self.sends {
            let ghost = &self.ghosts[*ghost];
            let before = ghost.sends & ((1 << along) - 1);
            grow(&mut joints[self.band(*cell)].open, open.len(), 1);
            open.push(self.piece(*i, *cell, (1, (ghost.at + before.count_ones()) as usize)));
        }
        let taken = Taken { pieces: vec![0.0; at], near: vec![[0.0; Q]; near.len()] };
        follow(&mut joints);
        Links {
            plan: Plan { grid, joints, put, open, take, near },
            ghosts: self.ghosts,
            struck,
            rest,
            last: taken.clone(),
            next: taken,
            sent: vec![0.0; sent],
        }
    }

    fn piece(&self, along: usize, cell: [usize; 3], (count, at): (usize, usize)) -> Piece {
        Piece { along: u8::try_from(along).unwrap_or(0), node: self.node(cell), count: small(count), at: small(at) }
    }

    /// Sorts the cells before open faces by band and tells each ghost its own.
    fn number_ghosts(&mut self, joints: &mut [Joint]) -> Vec<u32> {
        let mut cells: Vec<[usize; 3]> = self.near.iter().flatten().copied().collect();
        cells.sort_by_key(|c| (self.band(*c), c[1], c[0]));
        cells.dedup();
        for (k, cell) in cells.iter().enumerate() {
            grow(&mut joints[self.band(*cell)].near, k, 1);
        }
        let number: BTreeMap<[usize; 3], u32> = cells.iter().enumerate().map(|(k, c)| (*c, small(k))).collect();
        for (ghost, near) in self.ghosts.iter_mut().zip(&self.near) {
            ghost.near = near.and_then(|cell| number.get(&cell).copied());
        }
        cells.iter().map(|c| self.node(*c)).collect()
    }
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
    let mut ends = [0; 5];
    for joint in joints {
        let ranges = [&mut joint.put, &mut joint.open, &mut joint.take, &mut joint.taken, &mut joint.near];
        for (range, end) in ranges.into_iter().zip(&mut ends) {
            if range.start == range.end {
                *range = *end..*end;
            }
            *end = range.end;
        }
    }
}

/// Numbers of nodes and links, which planning holds below 2^32.
fn small(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
