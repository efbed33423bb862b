//! Counts points of an attractor into the cells of a picture: by cylinders where possible, otherwise by the chaos game.

use std::ops::Range;

use super::cloud::DrawRequest;
use super::color::ColorLabels;
use super::cylinders::{self, Cylinder, CylinderCut, PointPool};
use super::game::{CHUNK_STEPS, ChaosGame, Chunk, Escapes, InstructionSet, LANES, PointSink, TileLayout, images};
use super::window::PictureWindow;
use osier_base::convert::limit;
use osier_base::math::narrow;
use osier_base::par::{par_map, threads};

/// Bytes that the cells of all threads may take together; more pixels mean fewer threads.
const MAX_CELL_BYTES: usize = 1 << 30;
/// Diagonals of the picture, or of the unit box, beyond which a lane has escaped and restarts.
const ESCAPE_DIAGONALS: f64 = 1e4;
/// Number of points whose pixels are found at once.
pub(super) const SLICE: usize = 1024;
/// The identity map in the order of [`Affine::single`](super::affine::Affine).
const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// Finds the pixels of points, slice after slice.
struct PixelIndexer {
    tier: InstructionSet,
    layout: TileLayout,
    /// The attractor lies in space.
    deep: bool,
    index: Box<[u32; SLICE]>,
}

impl PixelIndexer {
    /// Indices of the cells of the images of up to [`SLICE`] points.
    fn cells(&mut self, map: &[f32; 12], [x, y, z]: [&[f32]; 3]) -> &[u32] {
        let out = &mut self.index[..x.len()];
        images(self.tier, map, [x, y, if self.deep { z } else { &[] }], self.layout, out);
        out
    }
}

/// Cells of a picture that count points.
pub(super) trait CellCounter {
    /// Labels of the points, if the counts depend on them.
    fn labels(&self) -> Option<&ColorLabels>;
    /// Counts points in these cells, with the map that made each and its label.
    fn add_each(&mut self, cells: &[u32], maps: &[u32], labels: &[u32]);
    /// Counts points of a cylinder; `coord`: colour coordinates of the points, or empty.
    fn add(&mut self, cells: &[u32], cylinder: &Cylinder, coord: &[f32]);
}

/// Counts points of the chaos game directly, for systems that cannot be cut into cylinders.
struct ChaosGameCounter<C> {
    cells: C,
    pixels: PixelIndexer,
    /// Final map of the system, in pixels; the identity without one.
    last: [f32; 12],
    labels: Option<ColorLabels>,
    label: Box<[[u32; LANES]; CHUNK_STEPS]>,
}

impl<C: CellCounter> PointSink for ChaosGameCounter<C> {
    fn take(&mut self, chunk: &Chunk) {
        let steps = ..chunk.steps.min(CHUNK_STEPS);
        if let Some(labels) = &mut self.labels {
            labels.label(chunk, &mut self.label);
        }
        let place = [&chunk.x, &chunk.y, &chunk.z].map(|row| row[steps].as_flattened());
        let pixels = self.pixels.cells(&self.last, place);
        self.cells.add_each(pixels, chunk.map[steps].as_flattened(), self.label[steps].as_flattened());
    }

    fn warm_up(&mut self, chunk: &Chunk) {
        if let Some(labels) = &mut self.labels {
            labels.label(chunk, &mut self.label);
        }
    }

    fn begin(&mut self) {
        (0..LANES).for_each(|lane| self.restart(lane));
    }

    fn restart(&mut self, lane: usize) {
        if let Some(labels) = &mut self.labels {
            labels.restart(lane);
        }
    }
}

/// How a system is counted: by a cut into cylinders if it allows one, otherwise by the chaos game; and the units of
/// work.
pub(super) struct CountingPlan {
    game: ChaosGame,
    /// The cut into cylinders, for systems that allow it; others are counted by the chaos game.
    cut: Option<CylinderCut>,
    /// Number of blocks or batches, and of steps of each lane of a block.
    blocks: u64,
    steps: u64,
    /// Points drawn by all blocks or batches, at least as many as asked for.
    pub points: u64,
    /// Order of the cells in memory.
    pub layout: TileLayout,
    deep: bool,
    last: [f32; 12],
}

impl CountingPlan {
    /// Chooses between cylinders and the chaos game, and divides the points into units of work for the pixels of `window`.
    pub fn new(request: &DrawRequest<'_>, labels: Option<&ColorLabels>, window: &PictureWindow) -> Self {
        let DrawRequest { system, study, seed, points, tier } = *request;
        let frame = window.frame();
        #[allow(clippy::cast_precision_loss, reason = "pixels")]
        let diagonal = (window.width + window.height) as f64;
        let by_cylinders = cylinders::is_applicable(system, study, labels);
        // Pools are drawn in units of the attractor, points of the chaos game directly in pixels.
        let (units, size) = if by_cylinders { (cylinders::unit_frame(system, study), 2.0) } else { (frame, diagonal) };
        let game =
            ChaosGame::new(system, study, seed, units, narrow((size * ESCAPE_DIAGONALS).min(1e15))).with_tier(tier);
        let cut = by_cylinders.then(|| CylinderCut::new(request, &game, frame, labels));
        // Batches of cylinders replace the blocks of the chaos game as the unit of work.
        let (blocks, steps) = ChaosGame::plan(points);
        let (blocks, points) = match &cut {
            Some(cut) => (cut.batches().count, cut.batches().count * cut.batches().points),
            None => (blocks, blocks * steps * LANES as u64),
        };
        let last = system.last.map(|l| l.conjugated(frame.scale, frame.shift).single()).unwrap_or(IDENTITY);
        Self {
            game,
            cut,
            blocks,
            steps,
            points,
            layout: TileLayout { width: window.width, height: window.height },
            deep: system.dim > 2,
            last,
        }
    }

    /// Counts all points. Each thread has a separate set of cells, `bytes` bytes per cell, as long as all sets fit in
    /// memory; `make` creates empty cells for a [`TileLayout`].
    pub fn count<C: CellCounter + Send>(&self, bytes: usize, make: impl Fn() -> C + Sync) -> (Vec<C>, Escapes) {
        let blocks = limit(self.blocks);
        // Each thread counts into separate cells, without atomics; sums of whole numbers do not depend on the division of the
        // work.
        let workers = threads().min(MAX_CELL_BYTES / (bytes * self.layout.cells())).clamp(1, blocks.max(1));
        let jobs: Vec<u64> = (0..workers as u64).collect();
        let parts = par_map(&jobs, |worker| self.count_blocks(make(), (*worker..self.blocks).step_by(workers)));
        let escapes = parts.iter().fold(Escapes::default(), |s, p| s.plus(p.1));
        (parts.into_iter().map(|p| p.0).collect(), escapes)
    }

    /// Counts the points of some blocks or batches, on one thread.
    fn count_blocks<C: CellCounter>(&self, mut cells: C, blocks: impl Iterator<Item = u64>) -> (C, Escapes) {
        let tier = self.game.tier();
        // Scratch memory of one thread, reused for all of its blocks.
        let mut pixels = PixelIndexer { tier, layout: self.layout, deep: self.deep, index: Box::new([0; SLICE]) };
        let none = Escapes::default();
        if let Some(cut) = &self.cut {
            let mut pool = PointPool::new(cells.labels());
            let mut count_cylinder = |c: &Cylinder, pool: &PointPool, range: Range<usize>| {
                count_range(&mut cells, &mut pixels, c, pool, range)
            };
            let escapes = blocks.fold(none, |s, b| s.plus(cut.draw(b, &self.game, &mut pool, &mut count_cylinder)));
            return (cells, escapes);
        }
        let labels = cells.labels().cloned();
        let label = Box::new([[0; LANES]; CHUNK_STEPS]);
        let mut sink = ChaosGameCounter { cells, pixels, last: self.last, labels, label };
        let escapes = blocks.fold(none, |s, b| s.plus(self.game.play(b, self.steps, &mut sink)));
        (sink.cells, escapes)
    }
}

/// Maps a range of the pool into a cylinder and counts its points.
fn count_range(
    cells: &mut impl CellCounter,
    pixels: &mut PixelIndexer,
    cylinder: &Cylinder,
    pool: &PointPool,
    range: Range<usize>,
) {
    for start in range.clone().step_by(SLICE) {
        // Slices are small enough for the first-level cache: first find the pixels of a slice, then count.
        let part = start..range.end.min(start + SLICE);
        let index = pixels.cells(&cylinder.map, pool.place.each_ref().map(|row| &row[part.clone()]));
        cells.add(index, cylinder, pool.coord.get(part).unwrap_or(&[]));
    }
}
