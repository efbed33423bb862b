//! Draws attractors as points with colours.
//!
//! # Examples
//! ```
//! use glam::DVec3;
//! use osier_base::limits::Limits;
//! use osier_ifs::cloud::{DrawRequest, cloud, thin_to_voxels};
//! use osier_ifs::color::{ColorLabels, ColorMode};
//! use osier_ifs::game::{InstructionSet, extent};
//! use osier_ifs::{dynamics::study, read::read, weights::WeightRule};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let system = &systems[0];
//! let study = study(system, WeightRule::File);
//! let request = DrawRequest { system, study: &study, seed: 1, points: 10_000, tier: InstructionSet::Best };
//! let labels = ColorLabels::new(system, ColorMode::Map, &[]);
//! let extent = extent(system, &study).expect("an attractor");
//! let mut points = cloud(&request, &labels, &extent, DVec3::ZERO, 2.0);
//! assert_eq!(points.positions.len(), 10_000);
//! // Thinned to one point per cube, each with the number of points that it stands for.
//! let counts = thin_to_voxels(&mut points, 0.25);
//! assert_eq!(counts.iter().sum::<u32>(), 10_000);
//! # Ok::<(), osier_base::Error>(())
//! ```

use glam::{DVec3, Vec3};

use super::Ifs;
use super::affine::AxisScaling;
use super::color::ColorLabels;
use super::dynamics::SystemAnalysis;
use super::game::{CHUNK_STEPS, ChaosGame, Chunk, Escapes, Extent, InstructionSet, LANES, PointSink};
use osier_base::convert::limit;
use osier_base::math::narrow;
use osier_base::par::par_each;
use osier_base::rng::{Rng, word};

/// Distance from the origin, in diagonals of the attractor's box, beyond which a lane has escaped and restarts.
const ESCAPE_DIAGONALS: f64 = 1e4;

/// Points as structure of arrays, in the order block, step, lane.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AttractorPoints {
    /// Positions, table units times the scale asked for.
    pub positions: Vec<Vec3>,
    /// Linear RGB by point.
    pub colors: Vec<[f32; 3]>,
    /// Index of the map that made each point; indices above 255 are stored as 255.
    pub maps: Vec<u8>,
    /// Steps since the start or the last jump, at most 255.
    pub depths: Vec<u8>,
    /// Number of tests for escaped lanes, and how many lanes had escaped.
    pub escapes: Escapes,
}

/// An attractor to draw, with how many points and which seed.
#[derive(Debug, Clone, Copy)]
pub struct DrawRequest<'a> {
    /// System whose attractor is drawn, with its final map and condensation sets.
    pub system: &'a Ifs,
    /// Analysis of `system`: probabilities and warm-up.
    pub study: &'a SystemAnalysis,
    /// Seed of the draws of all blocks; equal seeds give equal points on every instruction set.
    pub seed: u64,
    /// Number of points over all blocks.
    pub points: u64,
    /// Instruction set; results do not depend on it.
    pub tier: InstructionSet,
}

struct PointBlock<'a> {
    index: u64,
    at: usize,
    labels: ColorLabels,
    label: Box<[[u32; LANES]; CHUNK_STEPS]>,
    positions: &'a mut [Vec3],
    colors: &'a mut [[f32; 3]],
    maps: &'a mut [u8],
    depths: &'a mut [u8],
    /// Maps of the system, and steps of each lane since its start or last jump.
    count: u32,
    depth: [u8; LANES],
    escapes: Escapes,
    last: Option<super::affine::Affine>,
}

impl PointSink for PointBlock<'_> {
    #[allow(clippy::cast_possible_truncation, reason = "clamped to 255 before the cast")]
    fn take(&mut self, chunk: &Chunk) {
        // The colour of a point depends on its word, the last maps applied; the labels carry words over from chunk to
        // chunk.
        self.labels.label(chunk, &mut self.label);
        // The last chunk of a cloud may hold more points than are asked for.
        let left = self.positions.len() - self.at;
        let count = left.min(chunk.steps * LANES);
        let range = self.at..self.at + count;
        for (i, (((p, c), m), d)) in self.positions[range.clone()]
            .iter_mut()
            .zip(&mut self.colors[range.clone()])
            .zip(&mut self.maps[range.clone()])
            .zip(&mut self.depths[range])
            .enumerate()
        {
            let (step, lane) = (i / LANES, i % LANES);
            *p = Vec3::new(chunk.x[step][lane], chunk.y[step][lane], chunk.z[step][lane]);
            *c = self.labels.colors.get(self.label[step][lane] as usize).copied().unwrap_or([1.0; 3]);
            *m = chunk.map[step][lane].min(255) as u8;
            let depth = &mut self.depth[lane];
            *depth = if chunk.map[step][lane] >= self.count { 0 } else { depth.saturating_add(1) };
            *d = *depth;
        }
        // The final map acts on the points that are output and is never fed back into the iteration.
        if let Some(last) = &self.last {
            for p in &mut self.positions[self.at..self.at + count] {
                let q = last.apply(p.as_dvec3());
                *p = Vec3::new(narrow(q.x), narrow(q.y), narrow(q.z));
            }
        }
        self.at += count;
    }

    fn warm_up(&mut self, chunk: &Chunk) {
        // Colours and depths of the first points depend on the maps before them.
        self.labels.label(chunk, &mut self.label);
        for maps in chunk.map.iter().take(chunk.steps) {
            for (depth, map) in self.depth.iter_mut().zip(maps) {
                *depth = if *map >= self.count { 0 } else { depth.saturating_add(1) };
            }
        }
    }

    fn restart(&mut self, lane: usize) {
        self.labels.restart(lane);
        self.depth[lane] = 0;
    }
}

/// Draws points at u = scale (x - origin). The result is the same at any thread count.
pub fn cloud(
    request: &DrawRequest<'_>,
    labels: &ColorLabels,
    extent: &Extent,
    origin: DVec3,
    scale: f64,
) -> AttractorPoints {
    let n = limit(request.points);
    // The escape radius is relative to the size of the attractor in the units of the points.
    let diagonal = (extent.bounds.1 - extent.bounds.0).length().max(1e-30) * scale;
    let frame = AxisScaling { scale: DVec3::splat(scale), shift: -origin * scale };
    // Maps are conjugated with u = scale (x - origin), so that points come out in these units without a further step.
    let game = ChaosGame::new(
        request.system,
        request.study,
        request.seed,
        frame,
        narrow((diagonal * ESCAPE_DIAGONALS).min(1e15)),
    );
    let game = game.with_tier(request.tier);
    // Blocks of equal length; the last one may be cut short by the size of the arrays.
    let (_, steps) = ChaosGame::plan(request.points);
    let size = limit(steps).saturating_mul(LANES).max(1);
    let last = request.system.last.map(|l| l.conjugated(frame.scale, frame.shift));
    let mut out = AttractorPoints {
        positions: vec![Vec3::ZERO; n],
        colors: vec![[0.0; 3]; n],
        maps: vec![0; n],
        depths: vec![0; n],
        escapes: Escapes::default(),
    };
    // Every block writes a separate slice of the arrays, so that blocks can be drawn by any thread.
    let parts = out
        .positions
        .chunks_mut(size)
        .zip(out.colors.chunks_mut(size))
        .zip(out.maps.chunks_mut(size))
        .zip(out.depths.chunks_mut(size));
    let count = game.map_count();
    let block = |(index, (((positions, colors), maps), depths))| PointBlock {
        index,
        at: 0,
        labels: labels.clone(),
        label: Box::new([[0; LANES]; CHUNK_STEPS]),
        positions,
        colors,
        maps,
        depths,
        count,
        depth: [0; LANES],
        escapes: Escapes::default(),
        last,
    };
    let mut blocks: Vec<PointBlock<'_>> = (0_u64..).zip(parts).map(block).collect();
    par_each(&mut blocks, |b| b.escapes = game.play(b.index, steps, b));
    let escapes = blocks.iter().fold(Escapes::default(), |s, b| s.plus(b.escapes));
    AttractorPoints { escapes, ..out }
}

/// Keeps, of the points that each map made, a share equal to the map's opacity. Which points stay depends on the seed
/// and on the index of a point. All points of condensation sets stay.
pub fn drop_hidden(cloud: &mut AttractorPoints, ifs: &Ifs, seed: u64) {
    if ifs.maps.iter().all(|m| m.opacity >= 1.0) {
        return;
    }
    let id = word(&ifs.name);
    let is_drawn = |(i, map): (u64, &u8)| {
        let opacity = ifs.maps.get(usize::from(*map)).map_or(1.0, |m| m.opacity);
        opacity >= 1.0 || Rng::at(seed, &["ifs-opacity".into(), id.into(), i.into()]).unit_f64() < opacity
    };
    let drawn: Vec<bool> = (0_u64..).zip(&cloud.maps).map(is_drawn).collect();
    retain(&mut cloud.positions, &drawn);
    retain(&mut cloud.colors, &drawn);
    retain(&mut cloud.maps, &drawn);
    retain(&mut cloud.depths, &drawn);
}

fn retain<T>(list: &mut Vec<T>, kept: &[bool]) {
    let mut kept = kept.iter();
    list.retain(|_| kept.next().copied().unwrap_or(true));
}

/// Keeps the first point of every cube of the given size; returns how many points each one stands for.
pub fn thin_to_voxels(cloud: &mut AttractorPoints, size: f32) -> Vec<u32> {
    #[allow(clippy::cast_possible_truncation, reason = "saturates far beyond any scene")]
    let cell = |p: &Vec3| (*p / size).floor().to_array().map(|v| v as i64);
    // Sorted by cell, then by index: the first of each group is the first point drawn in that cell.
    let mut order: Vec<usize> = (0..cloud.positions.len()).collect();
    let cells: Vec<[i64; 3]> = cloud.positions.iter().map(cell).collect();
    order.sort_unstable_by(|a, b| cells[*a].cmp(&cells[*b]).then(a.cmp(b)));
    let mut kept: Vec<(usize, u32)> = Vec::new();
    for group in order.chunk_by(|a, b| cells[*a] == cells[*b]) {
        kept.extend(group.first().map(|i| (*i, group.iter().fold(0, |n: u32, _| n.saturating_add(1)))));
    }
    // Back to the order in which the points were drawn.
    kept.sort_unstable();
    cloud.positions = kept.iter().map(|k| cloud.positions[k.0]).collect();
    cloud.colors = kept.iter().map(|k| cloud.colors[k.0]).collect();
    cloud.maps = kept.iter().map(|k| cloud.maps[k.0]).collect();
    cloud.depths = kept.iter().map(|k| cloud.depths[k.0]).collect();
    kept.iter().map(|k| k.1).collect()
}
