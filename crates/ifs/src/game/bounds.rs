//! Bounding box of an attractor, estimated from a sample of its points.

use glam::DVec3;

use super::{CHUNK_STEPS, ChaosGame, Chunk, Escapes, LANES, PointSink};
use crate::Ifs;
use crate::affine::{Affine, AxisScaling};
use crate::dynamics::SystemAnalysis;
use osier_base::diagnostic::Diagnostic;
use osier_base::math::narrow;
use osier_base::par::par_map;

const SAMPLE_POINTS: u64 = 1 << 20;
/// Magnitude beyond which a point of the sample has escaped.
const ESCAPE_RADIUS: f32 = 1e15;
/// Shares of the sample outside the quantile box, on each side of each axis.
const TAIL_QUANTILE: f64 = 0.0005;
/// Largest share of escapes with which a system still counts as having an attractor.
const MAX_ESCAPES: f64 = 1e-3;

/// Bounding box of an attractor's sample, with and without outliers, table units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Smallest and largest coordinates: the box with outliers.
    pub bounds: (DVec3, DVec3),
    /// 0.0005 and 0.9995 quantiles of each coordinate: the box without outliers.
    pub quantile: (DVec3, DVec3),
}

#[derive(Default)]
struct SampleCollector {
    points: [Vec<f32>; 3],
}

impl PointSink for SampleCollector {
    fn take(&mut self, chunk: &Chunk) {
        for step in 0..chunk.steps.min(CHUNK_STEPS) {
            for (list, row) in self.points.iter_mut().zip([&chunk.x, &chunk.y, &chunk.z]) {
                list.extend_from_slice(&row[step]);
            }
        }
    }
}

/// Samples an attractor: 2^20 points with seed 0.
/// Own: intervals derived from the largest ratio would be useless, 4.5e5 for a figure 8.6 wide where a ratio is near 1.
/// # Errors
/// I023 if more than 0.001 of the tests find an escaped lane.
pub fn extent(ifs: &Ifs, study: &SystemAnalysis) -> Result<Extent, Box<Diagnostic>> {
    let game = ChaosGame::new(ifs, study, 0, AxisScaling::IDENTITY, ESCAPE_RADIUS);
    let (blocks, steps) = ChaosGame::plan(SAMPLE_POINTS);
    let blocks: Vec<u64> = (0..blocks).collect();
    let parts = par_map(&blocks, |block| {
        let mut sink = SampleCollector::default();
        let escapes = game.play(*block, steps, &mut sink);
        (sink.points, escapes)
    });
    let mut all: [Vec<f32>; 3] = Default::default();
    let mut escapes = Escapes::default();
    for (points, found) in parts {
        for (list, more) in all.iter_mut().zip(points) {
            list.extend(more);
        }
        escapes = escapes.plus(found);
    }
    // Measure the points as they are drawn: after the final map.
    if let Some(last) = &ifs.last {
        show(last, &mut all);
    }
    let finite = |i: &usize| all.iter().all(|l| l[*i].is_finite());
    let kept: Vec<usize> = (0..all[0].len()).filter(finite).collect();
    #[allow(clippy::cast_precision_loss, reason = "counts of a million")]
    let share = escapes.found as f64 / escapes.tests.max(1) as f64;
    if share > MAX_ESCAPES || kept.is_empty() {
        return Err(Box::new(escaped(ifs, &all, share)));
    }
    let mut out = Extent { bounds: (DVec3::ZERO, DVec3::ZERO), quantile: (DVec3::ZERO, DVec3::ZERO) };
    for axis in 0..ifs.dim.min(3) {
        // Bounds and quantiles by selection, one axis after the other.
        let mut values: Vec<f32> = kept.iter().map(|i| all[axis][*i]).collect();
        let end = values.len() - 1;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "a place in the sample"
        )]
        let tail = (TAIL_QUANTILE * end as f64) as usize;
        let mut at = |k: usize| f64::from(*values.select_nth_unstable_by(k, f32::total_cmp).1);
        (out.quantile.0[axis], out.quantile.1[axis]) = (at(tail), at(end - tail));
        (out.bounds.0[axis], out.bounds.1[axis]) = (at(0), at(end));
    }
    Ok(out)
}

/// Applies the final map in place to the points, one list per coordinate.
fn show(last: &Affine, [xs, ys, zs]: &mut [Vec<f32>; 3]) {
    for ((x, y), z) in xs.iter_mut().zip(ys).zip(zs) {
        let shown = last.apply(DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)));
        [*x, *y, *z] = shown.to_array().map(narrow);
    }
}

fn escaped(ifs: &Ifs, all: &[Vec<f32>; 3], share: f64) -> Diagnostic {
    // The last point of a lane that was still within range, for the message.
    let near = |i: &usize| all.iter().all(|l| l[*i].abs() <= ESCAPE_RADIUS);
    let last = (0..all[0].len())
        .rev()
        .step_by(LANES)
        .find(near)
        .map_or(DVec3::ZERO, |i| DVec3::new(f64::from(all[0][i]), f64::from(all[1][i]), f64::from(all[2][i])));
    let text = format!("\"{}\" diverges: {:.1} % of the tests find a point beyond 1e15", ifs.name, share * 100.0);
    let d = Diagnostic::error("I023", text, ifs.span, "no attractor");
    d.help(format!(
        "the last point within range was ({:.3e}, {:.3e}, {:.3e}); reduce the scale of the maps",
        last.x, last.y, last.z
    ))
}
