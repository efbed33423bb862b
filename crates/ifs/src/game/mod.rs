//! The chaos game: points of an attractor, the same at any thread count and on any processor.
//!
//! Points come in blocks of 32 lanes. Each lane has a separate random stream and steps from map to map; the points of a block are
//! ordered by step, then lane.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::{dynamics::study, game::extent, read::read, weights::WeightRule};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let analysis = study(&systems[0], WeightRule::Equal);
//! let (low, high) = extent(&systems[0], &analysis).expect("an attractor").bounds;
//! assert!(low.x >= 0.0 && high.x <= 1.0 && high.x > 0.99);
//! # Ok::<(), osier_base::Error>(())
//! ```

#[cfg(target_arch = "x86_64")]
mod avx2;
mod bounds;
mod condensed;
mod lanes;
mod layout;

use crate::affine::AxisScaling;
use glam::DVec3;

use super::dynamics::SystemAnalysis;
use super::{Condensation, Ifs};
pub use bounds::{Extent, extent};
use lanes::Lanes;
pub(super) use layout::TileLayout;
use osier_base::convert::limit;
use osier_base::math::narrow;
use osier_base::rng::{Rng, word};

/// Chains of a block that step side by side, each with a separate random stream.
pub const LANES: usize = 32;
/// Steps of all lanes that a sink receives at once.
pub const CHUNK_STEPS: usize = 32;
/// Least number of blocks, and most points of one. Both fix the result: other values draw other points.
const MIN_BLOCKS: u64 = 32;
const MAX_BLOCK_POINTS: u64 = 1 << 20;
/// Chunks between two tests for escaped lanes.
const CHUNKS_PER_ESCAPE_TEST: usize = 2;

/// Instruction set of the inner loops; results are the same bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstructionSet {
    /// The widest set that the processor supports.
    Best,
    /// Scalar loops, the reference.
    Plain,
}

/// Up to [`CHUNK_STEPS`] steps of all lanes, one array per coordinate, lane after lane within a step.
#[derive(Debug)]
pub struct Chunk {
    /// Number of valid steps, at most [`CHUNK_STEPS`].
    pub steps: usize,
    /// x of every point, by step and lane.
    pub x: [[f32; LANES]; CHUNK_STEPS],
    /// y of every point, by step and lane.
    pub y: [[f32; LANES]; CHUNK_STEPS],
    /// z of every point, by step and lane; 0 in the plane.
    pub z: [[f32; LANES]; CHUNK_STEPS],
    /// The map that made each point; the number of maps for a point of the condensation set.
    pub map: [[u32; LANES]; CHUNK_STEPS],
}

impl Chunk {
    /// A chunk without valid steps, boxed because its arrays are too large for the stacks of threads.
    pub fn new() -> Box<Self> {
        let zero = [[0.0; LANES]; CHUNK_STEPS];
        Box::new(Self { steps: 0, x: zero, y: zero, z: zero, map: [[0; LANES]; CHUNK_STEPS] })
    }
}

/// Receives the points of one block, chunk after chunk.
pub trait PointSink {
    /// Receives up to [`CHUNK_STEPS`] steps of all lanes, of which `chunk.steps` are valid.
    fn take(&mut self, chunk: &Chunk);
    /// Receives steps of the warm-up. Their points are not drawn, but their maps are part of the words of the points
    /// that follow.
    fn warm_up(&mut self, _chunk: &Chunk) {}
    /// A block begins: state of the block before must be cleared.
    fn begin(&mut self) {}
    /// A lane has escaped and restarts at the start point: its history must be cleared.
    fn restart(&mut self, _lane: usize) {}
}

/// Number of tests for escaped lanes, and how many lanes had escaped.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Escapes {
    /// Number of lanes tested: [`LANES`] for each test of a block.
    pub tests: u64,
    /// Number of lanes found beyond the guard radius or not finite.
    pub found: u64,
}

impl Escapes {
    /// Sums of the counts of two blocks.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { tests: self.tests + other.tests, found: self.found + other.found }
    }
}

/// One map in single precision: rows of A, then b.
pub(super) type Coefficients = [f32; 12];

/// A system prepared for the chaos game: maps in single precision, thresholds of probabilities, start point.
#[derive(Debug, Clone)]
pub struct ChaosGame {
    maps: Vec<Coefficients>,
    dim: usize,
    /// Running sums of probabilities as 31-bit numbers: one row, or with a chaos matrix one row for each last map.
    rows: Vec<Vec<u32>>,
    start: [f32; 3],
    /// Map that counts as the last one before the first step.
    first: u32,
    /// Number of maps, which is also the label of points of the condensation set.
    map_count: u32,
    warm_up: u32,
    guard: f32,
    condensation: Vec<Condensation>,
    /// Scale and shift of the coordinates that points come in.
    frame: AxisScaling,
    id: u64,
    seed: u64,
    tier: InstructionSet,
}

impl ChaosGame {
    /// Prepares a system. Points come as u = scale x + shift; `guard`: |u| beyond which a lane starts again.
    /// Own: the start is the fixed point of the map [`SystemAnalysis::first`], moved by the warm-up of [`SystemAnalysis::warm_up`] steps.
    pub fn new(ifs: &Ifs, study: &SystemAnalysis, seed: u64, frame: AxisScaling, guard: f32) -> Self {
        let AxisScaling { scale, shift } = frame;
        let best = study.first;
        // With a chaos matrix the start must be a fixed point that the chain can stay at.
        let stays = study.next.as_ref().is_none_or(|n| n.get(best).and_then(|r| r.get(best)).is_some_and(|p| *p > 0.0));
        let fixed = ifs.maps.get(best).filter(|m| stays && m.affine.spectral_radius() < 1.0);
        let start = fixed.and_then(|m| m.affine.fixed_point()).unwrap_or(DVec3::ZERO) * scale + shift;
        let maps = ifs.maps.iter().map(|m| m.affine.conjugated(scale, shift).single());
        let rows = match &study.next {
            Some(next) => next.iter().map(|r| thresholds(r)).collect(),
            None => vec![thresholds(&study.probabilities)],
        };
        Self {
            maps: maps.collect(),
            dim: ifs.dim,
            rows,
            start: start.to_array().map(narrow),
            first: ifs.maps.iter().take(best).fold(0, |n, _| n + 1),
            map_count: ifs.maps.iter().fold(0, |n, _| n + 1),
            warm_up: study.warm_up(),
            guard,
            condensation: ifs.condensation.clone(),
            frame,
            id: word(&ifs.name),
            seed,
            tier: InstructionSet::Best,
        }
    }

    /// The same game with another instruction set; its points stay the same bit for bit.
    #[must_use]
    pub fn with_tier(self, tier: InstructionSet) -> Self {
        Self { tier, ..self }
    }

    /// Number of maps, without condensation sets.
    pub fn maps(&self) -> usize {
        self.maps.len()
    }

    /// [`ChaosGame::maps`] in the type of the labels of [`Chunk::map`].
    pub(super) fn map_count(&self) -> u32 {
        self.map_count
    }

    /// A random stream independent of those of the lanes, addressed by purpose and block.
    pub(super) fn draws(&self, what: &str, block: u64) -> Rng {
        Rng::at(self.seed, &["ifs".into(), self.id.into(), what.into(), block.into()])
    }

    /// Scale and shift of the coordinates that points come in.
    pub(super) fn frame(&self) -> AxisScaling {
        self.frame
    }

    pub(super) fn tier(&self) -> InstructionSet {
        self.tier
    }

    /// Number of blocks and of steps of each lane for `points` points; the last step may make more points than asked
    /// for.
    pub fn plan(points: u64) -> (u64, u64) {
        let blocks = points.div_ceil(MAX_BLOCK_POINTS).max(MIN_BLOCKS);
        (blocks, points.div_ceil(blocks * LANES as u64))
    }

    /// Plays one block of `steps` steps and passes its points to `sink`.
    /// Source: M. Barnsley, "Fractals Everywhere", 1988: the random iteration algorithm, 32 chains at a time.
    pub fn play(&self, block: u64, steps: u64, sink: &mut impl PointSink) -> Escapes {
        let mut lanes = self.lanes(block);
        let mut chunk = Chunk::new();
        sink.begin();
        // Warm-up: steps until the start is forgotten; their points are not drawn.
        let mut left = u64::from(self.warm_up);
        while left > 0 {
            left -= self.advance(&mut lanes, &mut chunk, left);
            sink.warm_up(&chunk);
        }
        let mut escapes = Escapes::default();
        let (mut left, mut count) = (steps, 0);
        while left > 0 {
            left -= self.advance(&mut lanes, &mut chunk, left);
            count += 1;
            sink.take(&chunk);
            if count % CHUNKS_PER_ESCAPE_TEST == 0 {
                escapes = escapes.plus(self.restart_escaped(&mut lanes, sink));
            }
        }
        escapes
    }

    /// All lanes of a block at the start point, each with its own random stream.
    fn lanes(&self, block: u64) -> Lanes {
        let mut lanes = Lanes::at(self.start, self.first);
        for lane in 0..LANES {
            // A lane is addressed by system, block and lane, so that any thread can play any block.
            let mut draw = Rng::at(self.seed, &["ifs".into(), self.id.into(), block.into(), lane.into()]);
            let words = [draw.next_u64(), draw.next_u64()];
            lanes.seed(lane, words);
        }
        lanes
    }

    /// Advances by up to `left` steps, at most one chunk; returns the number of steps.
    fn advance(&self, lanes: &mut Lanes, chunk: &mut Chunk, left: u64) -> u64 {
        chunk.steps = limit(left).min(CHUNK_STEPS);
        let steps = chunk.steps as u64;
        if !self.condensation.is_empty() {
            // Condensation needs a draw more per step and has separate loops.
            condensed::advance(self, lanes, chunk);
            return steps;
        }
        #[cfg(target_arch = "x86_64")]
        if self.tier == InstructionSet::Best && avx2::advance(self, lanes, chunk) {
            return steps;
        }
        lanes.advance(self, chunk);
        steps
    }

    /// Restarts lanes beyond the guard radius, or not finite, at the start point.
    fn restart_escaped(&self, lanes: &mut Lanes, sink: &mut impl PointSink) -> Escapes {
        let mut found = 0;
        for lane in 0..LANES {
            let inside = |v: f32| v.abs() <= self.guard;
            if !(inside(lanes.x[lane]) && inside(lanes.y[lane]) && inside(lanes.z[lane])) {
                found += 1;
                [lanes.x[lane], lanes.y[lane], lanes.z[lane]] = self.start;
                lanes.map[lane] = self.first;
                sink.restart(lane);
            }
        }
        Escapes { tests: LANES as u64, found }
    }
}

/// Index of the cell that the image of every point under a map falls into; the outside cell for images beyond the
/// picture.
/// `place`: as many x and y as `out` is long, and as many z or, for maps of the plane, none.
pub(super) fn images(
    tier: InstructionSet,
    map: &Coefficients,
    place: [&[f32]; 3],
    layout: TileLayout,
    out: &mut [u32],
) {
    #[cfg(target_arch = "x86_64")]
    if tier == InstructionSet::Best && avx2::images(map, place, layout, out) {
        return;
    }
    lanes::images(map, place, layout, out);
}

/// floor(2^31 times the running sum) for all maps but the last; 2^31, which no draw reaches, from the last map of
/// positive probability on.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=2^31 before the cast")]
fn thresholds(q: &[f64]) -> Vec<u32> {
    let last = q.iter().rposition(|p| *p > 0.0).unwrap_or(0);
    let mut sum = 0.0;
    // A draw d selects the number of thresholds t with t <= d. Rounding must not select maps behind the last one of
    // positive probability.
    let bound = |(i, p): (usize, &f64)| {
        sum += p;
        if i >= last { 1 << 31 } else { (sum * 2_147_483_648.0).clamp(0.0, 2_147_483_648.0) as u32 }
    };
    q.iter().take(q.len().saturating_sub(1)).enumerate().map(bound).collect()
}
