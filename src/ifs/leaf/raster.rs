//! A leaf's attractor counted into pixels, by last map.

use super::mask::Mask;
use crate::ifs::cloud::Request;
use crate::ifs::game::{CHUNK, Chunk, Game, LANES, Sink, pixels};
use crate::ifs::histogram::Window;
use crate::par::{par_map, threads};

/// Kinds of maps told apart.
pub(super) const KINDS: usize = 4;
/// Bytes that the counts of all threads may take together.
const MEMORY: usize = 1 << 30;

/// Hits by pixel and by last map modulo [`KINDS`], rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Counts {
    cells: Vec<[u32; KINDS]>,
}

struct Counter<'a> {
    window: &'a Window,
    cells: Vec<[u32; KINDS]>,
    index: Box<[[u32; LANES]; CHUNK]>,
}

impl Sink for Counter<'_> {
    fn take(&mut self, chunk: &Chunk) {
        pixels(chunk, (self.window.width, self.window.height), &mut self.index);
        for step in 0..chunk.steps.min(CHUNK) {
            for lane in 0..LANES {
                self.cells[self.index[step][lane] as usize][chunk.map[step][lane] as usize % KINDS] += 1;
            }
        }
    }
}

/// Counts the points of a request; the same at any thread count.
pub(super) fn count(request: &Request<'_>, window: &Window) -> Counts {
    let game = Game::new(request.system, request.study, request.seed, window.frame(), 1e15).with_tier(request.tier);
    let (blocks, steps) = Game::plan(request.points);
    let cells = window.width * window.height + 1;
    let workers = threads().min(MEMORY / (cells * size_of::<[u32; KINDS]>()).max(1)).clamp(1, 64);
    let jobs: Vec<usize> = (0..workers).collect();
    let parts = par_map(&jobs, |worker| {
        let index = Box::new([[0; LANES]; CHUNK]);
        let mut counter = Counter { window, cells: vec![[0; KINDS]; cells], index };
        for block in (*worker as u64..blocks).step_by(workers) {
            game.play(block, steps, &mut counter);
        }
        counter.cells
    });
    let mut parts = parts.into_iter();
    let mut sum = parts.next().unwrap_or_default();
    for part in parts {
        for (a, b) in sum.iter_mut().zip(part) {
            for (x, y) in a.iter_mut().zip(b) {
                *x += y;
            }
        }
    }
    sum.pop();
    Counts { cells: sum }
}

impl Counts {
    /// Hits by pixel.
    pub fn hits(&self) -> Vec<u32> {
        self.cells.iter().map(|c| c.iter().sum()).collect()
    }

    /// The commonest kind of map by pixel, the first of several.
    pub fn letters(&self) -> Vec<u8> {
        let best = |c: &[u32; KINDS]| (0_u8..).zip(c).max_by_key(|(i, n)| (**n, u8::MAX - i)).map_or(0, |b| b.0);
        self.cells.iter().map(best).collect()
    }

    /// Pixels with at least so many hits.
    pub fn mask(&self, side: usize, min_hits: u32) -> Mask {
        Mask { side, set: self.cells.iter().map(|c| c.iter().sum::<u32>() >= min_hits.max(1)).collect() }
    }
}
