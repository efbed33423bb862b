//! Hits and colours per pixel. All sums are of whole numbers, so their order does not matter.

use std::collections::BTreeMap;

use glam::DVec3;

use super::cloud::Request;
use super::color::Labels;
use super::game::{CHUNK, Chunk, Escapes, Game, LANES, Sink};
use crate::math::narrow;
use crate::par::{par_map, threads};

/// Bytes that the histograms of all threads may take together.
const MEMORY: usize = 1 << 30;
/// A cell is emptied before its colour sums could overflow: 2^20 hits of 12 bits.
const FULL: u32 = (1 << 20) - 1024;
/// Largest linear colour.
const COLOR: f32 = 4095.0;
/// Units of a whole hit where maps show a share of their points.
const SHARES: f64 = 256.0;
/// Box diagonals beyond which a lane starts again.
const GUARD: f64 = 1e4;

/// A rectangle of table units seen as pixels; row 0 at the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Middle, table units.
    pub center: [f64; 2],
    /// Table units per pixel.
    pub pixel: f64,
}

impl Window {
    /// Scale and shift from table units to pixels.
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    pub fn frame(&self) -> (DVec3, DVec3) {
        let k = 1.0 / self.pixel;
        let (w, h) = (self.width as f64 * 0.5, self.height as f64 * 0.5);
        (DVec3::new(k, -k, k), DVec3::new(w - self.center[0] * k, h + self.center[1] * k, 0.0))
    }

    /// Shows a box (smallest and largest corner) whole, with a margin of 3 % of its longer side.
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    pub fn fitted((low, high): (DVec3, DVec3), width: usize, height: usize) -> Self {
        let size = high - low;
        let margin = 0.03 * size.x.max(size.y);
        let (w, h) = (size.x + 2.0 * margin, size.y + 2.0 * margin);
        let pixel = (w / width.max(1) as f64).max(h / height.max(1) as f64);
        let middle = (low + high) * 0.5;
        let pixel = if pixel > 0.0 && pixel.is_finite() { pixel } else { 1.0 };
        Self { width, height, center: [middle.x, middle.y], pixel }
    }
}

/// What was counted.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Hits times `unit`, rows from the top.
    pub hits: Vec<u64>,
    /// Sums of 12-bit linear colours times hits, or empty.
    pub sums: Vec<[u64; 3]>,
    /// Units of one hit.
    pub unit: u64,
    /// Points drawn.
    pub points: u64,
    /// Hits outside the window, times `unit`.
    pub outside: u64,
    /// What the guard found.
    pub escapes: Escapes,
}

/// How points reach the cells; both give the same counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Splat {
    /// One after the other.
    Direct,
    /// Sorted into bands of rows first: for pictures that do not fit the cache.
    Binned,
}

/// Pixels of a band of [`Splat::Binned`], and points that wait for it.
const BAND: usize = 1 << 14;
const BUCKET: usize = 2048;

/// Counts points by pixel.
struct Hits<'a> {
    window: &'a Window,
    /// One more than pixels: the last counts what falls outside.
    cells: Vec<u32>,
    buckets: Option<Vec<Vec<u32>>>,
    index: Box<[[u32; LANES]; CHUNK]>,
}

impl Hits<'_> {
    fn flush(&mut self) {
        for bucket in self.buckets.iter_mut().flatten() {
            for i in bucket.drain(..) {
                if let Some(cell) = self.cells.get_mut(i as usize) {
                    *cell += 1;
                }
            }
        }
    }
}

impl Sink for Hits<'_> {
    fn take(&mut self, chunk: &Chunk) {
        pixels(self.window, chunk, &mut self.index);
        let index = &self.index[..chunk.steps.min(CHUNK)];
        match &mut self.buckets {
            None => {
                let cells = self.cells.as_mut_slice();
                for i in index.iter().flatten() {
                    cells[*i as usize] += 1;
                }
            }
            Some(buckets) => {
                for i in index.iter().flatten() {
                    let bucket = &mut buckets[*i as usize / BAND];
                    bucket.push(*i);
                    if bucket.len() >= BUCKET {
                        for i in bucket.drain(..) {
                            self.cells[i as usize] += 1;
                        }
                    }
                }
            }
        }
    }
}

/// Hits and colour sums of a pixel; one cache line holds four.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(16))]
struct Cell([u32; 4]);

/// Counts points and colours by pixel.
struct Colors<'a> {
    window: &'a Window,
    cells: Vec<Cell>,
    spilled: BTreeMap<u32, [u64; 4]>,
    labels: Labels,
    /// What a point of a label adds, and by map the share that is shown (empty: all of it).
    adds: &'a [[u32; 4]],
    shares: &'a [u32],
    index: Box<[[u32; LANES]; CHUNK]>,
    label: Box<[[u32; LANES]; CHUNK]>,
}

impl Sink for Colors<'_> {
    fn take(&mut self, chunk: &Chunk) {
        pixels(self.window, chunk, &mut self.index);
        let label = if self.labels.is_by_map() {
            &chunk.map
        } else {
            self.labels.label(chunk, &mut self.label);
            &*self.label
        };
        if self.shares.is_empty() {
            for step in 0..chunk.steps.min(CHUNK) {
                for (index, label) in self.index[step].iter().zip(&label[step]) {
                    let add = self.adds[*label as usize];
                    let cell = &mut self.cells[*index as usize].0;
                    *cell = std::array::from_fn(|i| cell[i] + add[i]);
                    if cell[0] >= FULL {
                        spill(&mut self.spilled, *index, cell);
                    }
                }
            }
            return;
        }
        for step in 0..chunk.steps.min(CHUNK) {
            for lane in 0..LANES {
                let index = self.index[step][lane];
                let share = self.shares.get(chunk.map[step][lane] as usize).copied().unwrap_or(256);
                let add = self.adds[label[step][lane] as usize].map(|v| v * share);
                let cell = &mut self.cells[index as usize].0;
                for (c, a) in cell.iter_mut().zip(add) {
                    *c += a;
                }
                if cell[0] >= FULL {
                    spill(&mut self.spilled, index, cell);
                }
            }
        }
    }

    fn begin(&mut self) {
        (0..LANES).for_each(|lane| self.labels.restart(lane));
    }

    fn restart(&mut self, lane: usize) {
        self.labels.restart(lane);
    }
}

#[cold]
fn spill(spilled: &mut BTreeMap<u32, [u64; 4]>, index: u32, cell: &mut [u32; 4]) {
    let sums = spilled.entry(index).or_default();
    for (s, c) in sums.iter_mut().zip(cell.iter_mut()) {
        *s += u64::from(std::mem::take(c));
    }
}

/// Pixel of every point of a chunk; the number of pixels for those outside.
fn pixels(window: &Window, chunk: &Chunk, out: &mut [[u32; LANES]; CHUNK]) {
    super::game::pixels(chunk, (window.width, window.height), out);
}

/// Draws a system into pixels.
/// Returns the same counts at any thread count, with any instructions and either way of splatting.
pub fn histogram(request: &Request<'_>, labels: Option<&Labels>, window: &Window, splat: Splat) -> Histogram {
    let frame = window.frame();
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    let diagonal = (window.width + window.height) as f64;
    let game = Game::new(request.system, request.study, request.seed, frame, narrow((diagonal * GUARD).min(1e15)));
    let game = game.with_tier(request.tier);
    let (blocks, steps) = Game::plan(request.points);
    let pixels = window.width * window.height;
    let bytes = if labels.is_some() { size_of::<Cell>() } else { size_of::<u32>() };
    let workers = threads().min(MEMORY / (pixels * bytes).max(1)).clamp(1, usize::try_from(blocks).unwrap_or(1));
    let jobs: Vec<u64> = (0..workers as u64).collect();
    let of = |worker: u64| (worker..blocks).step_by(workers);
    let parts = par_map(&jobs, |worker| match labels {
        None => hits(&game, window, splat, (of(*worker), steps)),
        Some(labels) => colors(&game, window, (labels, request), (of(*worker), steps)),
    });
    let unit = if labels.is_some() && shows_shares(request) { 256 } else { 1 };
    let mut parts = parts.into_iter();
    let mut sum = parts.next().unwrap_or_default();
    for part in parts {
        sum.add(&part);
    }
    let outside = sum.hits.pop().unwrap_or(0);
    sum.sums.pop();
    let points = blocks * steps * LANES as u64;
    let (width, height) = (window.width, window.height);
    Histogram { width, height, hits: sum.hits, sums: sum.sums, unit, points, outside, escapes: sum.escapes }
}

/// What one worker counted, with the cell for outside at the end.
#[derive(Default)]
struct Counted {
    hits: Vec<u64>,
    sums: Vec<[u64; 3]>,
    escapes: Escapes,
}

impl Counted {
    fn add(&mut self, other: &Self) {
        for (a, b) in self.hits.iter_mut().zip(&other.hits) {
            *a += b;
        }
        for (a, b) in self.sums.iter_mut().zip(&other.sums) {
            for (x, y) in a.iter_mut().zip(b) {
                *x += y;
            }
        }
        self.escapes = self.escapes.plus(other.escapes);
    }
}

type Blocks<I> = (I, u64);

fn hits(game: &Game, window: &Window, splat: Splat, (blocks, steps): Blocks<impl Iterator<Item = u64>>) -> Counted {
    let cells = window.width * window.height + 1;
    let buckets = (splat == Splat::Binned).then(|| vec![Vec::with_capacity(BUCKET); cells / BAND + 1]);
    let mut sink = Hits { window, cells: vec![0; cells], buckets, index: Box::new([[0; LANES]; CHUNK]) };
    let escapes = blocks.fold(Escapes::default(), |s, b| s.plus(game.play(b, steps, &mut sink)));
    sink.flush();
    Counted { hits: sink.cells.iter().map(|c| u64::from(*c)).collect(), sums: Vec::new(), escapes }
}

fn shows_shares(request: &Request<'_>) -> bool {
    request.system.maps.iter().any(|m| m.opacity < 1.0)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn colors(
    game: &Game,
    window: &Window,
    (labels, request): (&Labels, &Request<'_>),
    (blocks, steps): Blocks<impl Iterator<Item = u64>>,
) -> Counted {
    let twelve = |v: f32| (v.clamp(0.0, 1.0) * COLOR + 0.5) as u32;
    let adds: Vec<[u32; 4]> = labels.colors.iter().map(|c| [1, twelve(c[0]), twelve(c[1]), twelve(c[2])]).collect();
    let share = |o: f64| (o.clamp(0.0, 1.0) * SHARES + 0.5) as u32;
    let shares: Vec<u32> = request.system.maps.iter().map(|m| share(m.opacity)).collect();
    let shares = if shows_shares(request) { shares } else { Vec::new() };
    let mut sink = Colors {
        window,
        cells: vec![Cell::default(); window.width * window.height + 1],
        spilled: BTreeMap::new(),
        labels: labels.clone(),
        adds: &adds,
        shares: &shares,
        index: Box::new([[0; LANES]; CHUNK]),
        label: Box::new([[0; LANES]; CHUNK]),
    };
    let escapes = blocks.fold(Escapes::default(), |s, b| s.plus(game.play(b, steps, &mut sink)));
    let mut out = Counted {
        hits: sink.cells.iter().map(|c| u64::from(c.0[0])).collect(),
        sums: sink.cells.iter().map(|c| [u64::from(c.0[1]), u64::from(c.0[2]), u64::from(c.0[3])]).collect(),
        escapes,
    };
    for (index, more) in sink.spilled {
        if let (Some(h), Some(s)) = (out.hits.get_mut(index as usize), out.sums.get_mut(index as usize)) {
            *h += more[0];
            for (s, m) in s.iter_mut().zip(&more[1..]) {
                *s += m;
            }
        }
    }
    out
}
