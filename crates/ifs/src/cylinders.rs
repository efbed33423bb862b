//! An attractor cut into cylinders: the images w(A) of the whole under words of maps.
//!
//! If all maps of a word are applied to a point of the attractor, the result is again a point of the attractor, in the small part
//! of the picture that belongs to the word. So a pool of points is drawn once by the chaos game and then mapped into one cylinder
//! after the other, each of which takes its share: no draw, no choice of a map, and cells that lie together while they are
//! counted.

use std::ops::Range;

use glam::DVec3;

use super::affine::{Affine, AxisScaling};
use super::cloud::DrawRequest;
use super::color::ColorLabels;
use super::dynamics::SystemAnalysis;
use super::game::{CHUNK_STEPS, ChaosGame, Chunk, Escapes, LANES, PointSink};
use super::{Ifs, Map};
use osier_base::convert::saturating_index;
use osier_base::math::narrow;

/// Most and fewest points of a batch. Larger batches reuse the pool more, smaller ones share work among threads.
const MAX_BATCH: u64 = 1 << 24;
const MIN_BATCH: u64 = 1 << 16;
/// Target number of batches, so that every thread has work. Each further batch costs a pass over all words.
const TARGET_BATCHES: u64 = 8;
/// Number of points of a batch for each point of the pool, and the fewest points of a pool. The pattern of a smaller
/// pool would repeat visibly.
const POOL_SHARE: u64 = 64;
const MIN_POOL: u64 = 1 << 16;
/// A cylinder whose box covers more pixels than this is split, so that the cells it writes fit into the processor's
/// caches.
const MAX_CYLINDER_PIXELS: f64 = 16_384.0;
/// A cylinder with fewer points in a batch than this is not split for its size: the word would cost more than its points.
const MIN_POINTS_TO_SPLIT: f64 = 512.0;
/// Maximum number of letters of a word; without it, words of maps that hardly shrink would be extended without end.
const MAX_WORD_LENGTH: usize = 4096;
/// Number of words beyond which none is split further unless labels need it; systems of hundreds of maps would fill the
/// memory.
const MAX_WORDS: usize = 1 << 17;
/// Magnitude beyond which a point counts as escaped, table units.
const ESCAPE_RADIUS: f32 = 1e15;
/// Share of the pool's points that its box leaves out on each side of each axis.
const TAIL_QUANTILE: f64 = 0.02;

/// Points of an attractor as separate lists of x, y and z, with their colour coordinates.
#[derive(Debug, Default)]
pub(super) struct PointPool {
    /// x, y and z of every point, in the units of [`unit_frame`].
    pub place: [Vec<f32>; 3],
    /// Colour coordinates, 0 to 1, or empty.
    pub coord: Vec<f32>,
    labels: Option<ColorLabels>,
}

impl PointSink for PointPool {
    fn take(&mut self, chunk: &Chunk) {
        for step in 0..chunk.steps.min(CHUNK_STEPS) {
            for (list, row) in self.place.iter_mut().zip([&chunk.x, &chunk.y, &chunk.z]) {
                list.extend_from_slice(&row[step]);
            }
            if let Some(labels) = &mut self.labels {
                self.coord.extend(labels.color_coords(&chunk.map[step]));
            }
        }
    }

    fn warm_up(&mut self, chunk: &Chunk) {
        if let Some(labels) = &mut self.labels {
            chunk.map.iter().take(chunk.steps).for_each(|maps| {
                labels.color_coords(maps);
            });
        }
    }

    fn begin(&mut self) {
        self.place.iter_mut().for_each(Vec::clear);
        self.coord.clear();
        (0..LANES).for_each(|lane| self.restart(lane));
    }

    fn restart(&mut self, lane: usize) {
        if let Some(labels) = &mut self.labels {
            labels.restart(lane);
        }
    }
}

impl PointPool {
    /// An empty pool. It stores colour coordinates only if the labels need them.
    pub fn new(labels: Option<&ColorLabels>) -> Self {
        Self { labels: labels.filter(|l| l.is_by_coord()).cloned(), ..Self::default() }
    }

    /// Bounding box of the pool without its outermost points.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a place in the list"
    )]
    fn bounds(&self) -> [[f64; 2]; 3] {
        self.place.each_ref().map(|row| {
            let mut sorted: Vec<f32> = row.iter().copied().filter(|v| v.is_finite()).collect();
            let Some(end) = sorted.len().checked_sub(1) else { return [0.0; 2] };
            let tail = (TAIL_QUANTILE * end as f64) as usize;
            let mut at = |k: usize| f64::from(*sorted.select_nth_unstable_by(k, f32::total_cmp).1);
            [at(tail), at(end - tail)]
        })
    }
}

/// One cylinder: the image of the whole attractor under one word.
#[derive(Debug, Clone)]
pub(super) struct Cylinder {
    /// Map from pool coordinates to pixels, the maps of the word included: rows of A, then b.
    pub map: [f32; 12],
    /// The map that is applied last.
    pub newest: usize,
    /// Label of all points of the cylinder, if labels do not depend on the single point.
    pub label: u32,
    /// Factor on a point's colour coordinate, and the value added to it.
    pub pull: (f32, f32),
    /// Running sum of the cylinders' shares, up to and including this one.
    end: f64,
}

/// Number of batches that are drawn, and of points in each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Batches {
    /// Batches to draw; each draws a new pool.
    pub count: u64,
    /// Points of each batch, all cylinders together.
    pub points: u64,
}

impl Batches {
    /// Batches for at least `points` points.
    pub fn new(points: u64) -> Self {
        let count = points.div_ceil((points / TARGET_BATCHES).clamp(MIN_BATCH, MAX_BATCH)).max(1);
        Self { count, points: points.div_ceil(count).max(1) }
    }

    /// Points of a pool, a whole number of steps of all lanes.
    fn pool_points(self) -> u64 {
        (self.points / POOL_SHARE).max(MIN_POOL).next_multiple_of(LANES as u64)
    }
}

/// The cylinders of an attractor in the order of their words.
#[derive(Debug)]
pub(super) struct CylinderCut {
    cylinders: Vec<Cylinder>,
    batches: Batches,
}

/// A word that may still be split.
struct OpenWord {
    affine: Affine,
    share: f64,
    newest: usize,
    /// Maps of the word, newest first; only as many as the labels need.
    letters: Vec<usize>,
    length: usize,
    pull: (f64, f64),
}

/// True if an attractor can be cut into cylinders: it has no chaos matrix and no condensation sets, and labels do not
/// depend on the whole word.
pub(super) fn is_applicable(ifs: &Ifs, study: &SystemAnalysis, labels: Option<&ColorLabels>) -> bool {
    study.next.is_none() && ifs.condensation.is_empty() && !labels.is_some_and(ColorLabels::is_by_order)
}

impl CylinderCut {
    /// Splits words until each cylinder is small in the picture or holds few points, and takes no more points than the pool has.
    /// `game`: in units of [`unit_frame`]; `window`: scale and shift from table units to pixels.
    /// Source: J. Hutchinson, "Fractals and self similarity", 1981: A is the union of w(A) over any full set of words.
    pub fn new(request: &DrawRequest<'_>, game: &ChaosGame, window: AxisScaling, labels: Option<&ColorLabels>) -> Self {
        let DrawRequest { system, study, .. } = *request;
        let batches = Batches::new(request.points);
        let mut pool = PointPool::default();
        game.play(0, batches.pool_points() / LANES as u64, &mut pool);
        let bounds = pool.bounds();
        let window = Affine::scaling(window.scale, window.shift);
        // The map from table units to pixels, including the final map.
        let shown = system.last.map_or(window, |l| window.after(&l));
        let AxisScaling { scale, shift } = game.frame();
        let table = Affine::scaling(scale.recip(), -shift / scale);
        #[allow(clippy::cast_precision_loss, reason = "some million points")]
        let (all, most) = (batches.points as f64, batches.pool_points() as f64 / batches.points as f64);
        let letters = labels.map_or(1, ColorLabels::letters);
        let mut cut = Self { cylinders: Vec::new(), batches };
        // Depth-first search over words from the empty word; `end` is the running sum of the shares of finished
        // cylinders.
        let mut open = vec![OpenWord::empty()];
        let mut end = 0.0;
        while let Some(word) = open.pop() {
            // A word is split while its cylinder covers many pixels and holds enough points, while its share is larger than
            // the pool, or while labels need more letters.
            // The map from pool units to pixels is composed in double precision, so that a deep zoom is as sharp as a
            // picture of the whole.
            let map = shown.after(&word.affine).after(&table);
            let wide = covered_pixels(&map, &bounds) > MAX_CYLINDER_PIXELS && word.share * all >= MIN_POINTS_TO_SPLIT;
            let short = word.letters.len() < letters;
            let may_split = word.length < MAX_WORD_LENGTH && cut.cylinders.len() + open.len() < MAX_WORDS;
            if short || ((wide || word.share > most) && may_split) {
                let drawn = |i: &usize| study.probabilities.get(*i).is_some_and(|p| *p > 0.0);
                open.extend((0..system.maps.len()).rev().filter(drawn).map(|i| {
                    let (map, share) = (&system.maps[i], study.probabilities[i]);
                    word.append_map(i, map, share, letters)
                }));
                continue;
            }
            end += word.share;
            cut.cylinders.push(word.finish(&map, labels, end));
        }
        cut
    }

    pub fn batches(&self) -> Batches {
        self.batches
    }

    /// Draws one batch: fills the pool, then calls `emit` for every cylinder with ranges of the pool. Each cylinder
    /// takes its share of the points, rounded to a whole number.
    pub fn draw(
        &self,
        batch: u64,
        game: &ChaosGame,
        pool: &mut PointPool,
        mut emit: impl FnMut(&Cylinder, &PointPool, Range<usize>),
    ) -> Escapes {
        let steps = self.batches.pool_points() / LANES as u64;
        let escapes = game.play(batch, steps, pool);
        let size = pool.place[0].len();
        let mut draw = game.draws("cylinders", batch);
        // Systematic sampling: cylinder k takes the points between its running shares plus one random offset, so that
        // each gets its share to within one point and the sum is exact.
        let offset = draw.unit_f64();
        let total = self.cylinders.last().map_or(1.0, |c| c.end);
        let mut done = 0;
        for cylinder in &self.cylinders {
            let until = self.points_until(cylinder.end / total, offset);
            let mut left = until - done;
            done = until;
            // The pool holds at most 2^24 / POOL_SHARE points.
            let mut at = draw.below(saturating_index(size)) as usize;
            while left > 0 {
                // A window of the pool from a random start, continued from the beginning.
                let n = left.min(size - at);
                emit(cylinder, pool, at..at + n);
                (left, at) = (left - n, 0);
            }
        }
        escapes
    }

    /// Points of all cylinders up to the one whose shares end here.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "between 0 and some million"
    )]
    fn points_until(&self, end: f64, offset: f64) -> usize {
        if end >= 1.0 { self.batches.points as usize } else { (end * self.batches.points as f64 + offset) as usize }
    }
}

impl OpenWord {
    fn empty() -> Self {
        Self { affine: Affine::IDENTITY, share: 1.0, newest: 0, letters: Vec::new(), length: 0, pull: (1.0, 0.0) }
    }

    /// The word extended by one map, which is applied before all others.
    fn append_map(&self, i: usize, map: &Map, probability: f64, letters: usize) -> Self {
        let mut all = self.letters.clone();
        if all.len() < letters {
            all.push(i);
        }
        Self {
            affine: self.affine.after(&map.affine),
            share: self.share * probability,
            newest: if self.length == 0 { i } else { self.newest },
            letters: all,
            length: self.length + 1,
            // Composition of c -> (1 - speed) c + speed coord before the maps applied so far.
            pull: (self.pull.0 * (1.0 - map.speed), self.pull.1 + self.pull.0 * map.speed * map.coord),
        }
    }

    fn finish(&self, map: &Affine, labels: Option<&ColorLabels>, end: f64) -> Cylinder {
        Cylinder {
            map: map.single(),
            newest: self.newest,
            label: labels.map_or(0, |l| l.of_word(&self.letters)),
            pull: (narrow(self.pull.0), narrow(self.pull.1)),
            end,
        }
    }
}

/// Scale and shift from table units to pool units, in which all but the outermost points lie between -1 and 1.
pub(super) fn unit_frame(system: &Ifs, study: &SystemAnalysis) -> AxisScaling {
    let game = ChaosGame::new(system, study, 0, AxisScaling::IDENTITY, ESCAPE_RADIUS);
    let mut pool = PointPool::default();
    game.play(0, MIN_POOL / LANES as u64, &mut pool);
    let bounds = pool.bounds().map(|[low, high]| [(low + high) * 0.5, (high - low) * 0.5]);
    // One scale for all axes keeps shapes; the widest axis spans -1 to 1.
    let half = bounds.iter().fold(0.0, |h: f64, b| h.max(b[1]));
    let scale = if half > 1e-300 { 1.0 / half } else { 1.0 };
    AxisScaling { scale: DVec3::splat(scale), shift: DVec3::from_array(bounds.map(|b| -b[0] * scale)) }
}

/// Number of pixels that the bounding box of the image of `bounds` covers.
fn covered_pixels(map: &Affine, bounds: &[[f64; 2]; 3]) -> f64 {
    let c = map.coefficients(3);
    // Width of the image of a box along an axis: sum over k of |a_k| times the side k.
    let side = |row: usize| (0..3).fold(0.0, |s, k| s + (c[row * 3 + k] * (bounds[k][1] - bounds[k][0])).abs());
    (side(0) + 1.0) * (side(1) + 1.0)
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "counts")]
mod tests {
    use super::*;
    use crate::color::ColorMode;
    use crate::dynamics::study;
    use crate::game::{InstructionSet, extent};
    use crate::histogram::{Histogram, PictureWindow, histogram};
    use crate::read;
    use crate::tests::system;
    use crate::weights::WeightRule;
    use osier_base::limits::Limits;

    const POINTS: u64 = 1 << 21;

    fn drawn(ifs: &Ifs, mode: ColorMode, side: usize) -> Histogram {
        let s = study(ifs, WeightRule::File);
        let (low, high) = extent(ifs, &s).expect("one").bounds;
        let window = PictureWindow::fitted(low, high, side, side);
        let request = DrawRequest { system: ifs, study: &s, seed: 5, points: POINTS, tier: InstructionSet::Best };
        histogram(&request, Some(&ColorLabels::new(ifs, mode, &[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])), &window)
    }

    /// The same system with a chaos matrix that changes nothing, so that it is drawn step by step.
    fn stepped(ifs: &Ifs) -> Ifs {
        Ifs { chaos: Some(vec![vec![1.0; ifs.maps.len()]; ifs.maps.len()]), ..ifs.clone() }
    }

    #[test]
    fn cylinders_hold_what_the_chaos_game_draws() {
        for name in ["fern_leaf", "bamboo_leaf", "green_tree", "monopodial"] {
            let ifs = system(name);
            for mode in [ColorMode::Map, ColorMode::Prefix(3), ColorMode::Coord] {
                let (a, b) = (drawn(&ifs, mode, 24), drawn(&stepped(&ifs), mode, 24));
                let scale = a.points as f64 / b.points as f64;
                for i in 0..a.hits.len() {
                    let (x, y) = (a.hits[i] as f64, b.hits[i] as f64 * scale);
                    assert!((x - y).abs() <= 8.0 * (x + y).sqrt() + 8.0, "{name} {mode:?} cell {i}: {x} for {y}");
                    for k in (0..3).filter(|_| x.min(y) > 2000.0) {
                        let mean = |h: &Histogram| h.sums[i][k] as f64 / h.hits[i] as f64 / 4095.0;
                        assert!((mean(&a) - mean(&b)).abs() < 0.05, "{name} {mode:?} cell {i} colour {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_batch_takes_all_of_its_points() {
        for points in [1, 1000, 300_000, 5_000_001] {
            let ifs = system("hill");
            let s = study(&ifs, WeightRule::File);
            let game = ChaosGame::new(&ifs, &s, 2, unit_frame(&ifs, &s), 1e9);
            let request = DrawRequest { system: &ifs, study: &s, seed: 2, points, tier: InstructionSet::Best };
            let cut = CylinderCut::new(
                &request,
                &game,
                AxisScaling { scale: DVec3::splat(10.0), shift: DVec3::splat(50.0) },
                None,
            );
            let mut pool = PointPool::new(None);
            let mut laid = 0;
            for batch in 0..cut.batches().count {
                cut.draw(batch, &game, &mut pool, |_, _, range| laid += range.len() as u64);
            }
            assert_eq!(laid, cut.batches().count * cut.batches().points);
            assert!(laid >= points && laid < points + cut.batches().count);
        }
    }

    #[test]
    fn a_deep_look_is_as_sharp_as_one_at_the_whole() {
        let text = "g {\n.5 0 0 .5 0 0 .9\n.5 0 0 .5 .5 0 .05\n.5 0 0 .5 0 .5 .05\n}";
        let ifs = read::read("g.ifs", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
        let s = study(&ifs, WeightRule::File);
        let request = DrawRequest { system: &ifs, study: &s, seed: 5, points: POINTS, tier: InstructionSet::Best };
        let looked = |side: f64| {
            // Beyond the side the next part begins.
            let window = PictureWindow { width: 32, height: 32, center: [side * 0.49; 2], pixel: side * 0.98 / 32.0 };
            histogram(&request, None, &window)
        };
        // The first map 24 times over: the corner 2^-24 wide is the whole again, with .9^24 of the points.
        let (whole, deep) = (looked(1.0), looked(1.0 / 16_777_216.0));
        let share = 0.079_766_443;
        for (a, b) in whole.hits.iter().zip(&deep.hits) {
            let (a, b) = (*a as f64 * share, *b as f64);
            assert!((a - b).abs() <= 8.0 * (a + b).sqrt() + 8.0, "{b} for {a}");
        }
    }

    #[test]
    fn many_maps_that_hardly_shrink_are_cut_within_bounds() {
        let row = |k: u32| format!("0 .9 -.9 0 {} {} .005", k % 20, k / 20);
        let text = format!("m {{\n{}\n}}", (0..200).map(row).collect::<Vec<_>>().join("\n"));
        let ifs = read::read("m.ifs", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
        let s = study(&ifs, WeightRule::File);
        let game = ChaosGame::new(&ifs, &s, 2, unit_frame(&ifs, &s), 1e9);
        let request = DrawRequest { system: &ifs, study: &s, seed: 2, points: 1 << 30, tier: InstructionSet::Best };
        let cut = CylinderCut::new(
            &request,
            &game,
            AxisScaling { scale: DVec3::splat(400.0), shift: DVec3::splat(9000.0) },
            None,
        );
        assert!(cut.cylinders.len() < MAX_WORDS + ifs.maps.len(), "{}", cut.cylinders.len());
        let end = cut.cylinders.last().map_or(0.0, |c| c.end);
        assert!((end - 1.0).abs() < 1e-9, "all of it is there: {end}");
    }

    #[test]
    fn cuts_end() {
        // A system of one map, and one whose map nearly always follows itself and hardly shrinks: no cut makes these small.
        for text in ["a {\n.5 0 0 .5 1 1 1\n}", "b {\n.9999 0 0 .9999 1 0 .9999\n.5 0 0 .5 0 0 .0001\n}"] {
            let ifs = read::read("x.ifs", text.as_bytes(), &Limits::default()).expect("reads").0.remove(0);
            let h = drawn(&ifs, ColorMode::Map, 64);
            assert_eq!(h.hits.iter().sum::<u64>() + h.outside, h.points);
        }
    }

    #[test]
    fn pictures_are_shown_by_the_final_map() {
        let turned = |last| Ifs { last: Some(last), ..system("fern_leaf") };
        let upside_down = turned(Affine::plane([-1.0, 0.0, 0.0, -1.0, 3.0, 4.0]));
        for ifs in [upside_down.clone(), stepped(&upside_down)] {
            let (h, plain) = (drawn(&ifs, ColorMode::Map, 16), drawn(&system("fern_leaf"), ColorMode::Map, 16));
            let scale = plain.points as f64 / h.points as f64;
            for (a, b) in h.hits.iter().rev().zip(&plain.hits) {
                let (a, b) = (*a as f64 * scale, *b as f64);
                assert!((a - b).abs() < 0.02 * (a + b) + 300.0, "{a} for {b}");
            }
        }
    }
}
