//! Paths through a leaf: the midrib, and the veins that join it.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec2;

use super::mask::{Mask, neighbours};

/// Stands for "no pixel" in a table of indices.
const NO_PIXEL: usize = usize::MAX;

/// Shortest paths from any pixel of a leaf back to its anchor.
#[derive(Debug, Clone, PartialEq)]
pub struct VeinPaths {
    side: usize,
    /// For each pixel, the one before it on the cheapest path from the anchor.
    before: Vec<usize>,
}

impl VeinPaths {
    /// Cheapest 8-connected paths from `anchor` to all other pixels of the mask. The cost of a step is its length
    /// divided by the square of 1 + sd, so that paths stay in the middle.
    /// Source: E. Dijkstra, "A note on two problems in connexion with graphs", 1959.
    pub fn new(mask: &Mask, sd: &[f32], anchor: usize) -> Self {
        let n = mask.side;
        let mut before = vec![NO_PIXEL; mask.set.len()];
        let mut cost = vec![f32::INFINITY; mask.set.len()];
        let mut queue = BinaryHeap::new();
        cost[anchor] = 0.0;
        queue.push(Reverse((0_u32, anchor)));
        while let Some(Reverse((bits, i))) = queue.pop() {
            // The bits of positive floats have the same order as the floats.
            if bits > cost[i].to_bits() {
                continue;
            }
            for j in neighbours(i, n, true).filter(|j| mask.set[*j]) {
                let straight = i % n == j % n || i / n == j / n;
                // Cost of a step: its length over the squared mean distance to the margin.
                let middle = 1.0 + 0.5 * (sd[i].max(0.0) + sd[j].max(0.0));
                let next = cost[i] + if straight { 1.0 } else { std::f32::consts::SQRT_2 } / (middle * middle);
                if next < cost[j] {
                    cost[j] = next;
                    before[j] = i;
                    queue.push(Reverse((next.to_bits(), j)));
                }
            }
        }
        Self { side: n, before }
    }

    /// Pixels from `end` back to the anchor, both included; only `end` if no path leads there.
    pub fn path_to_anchor(&self, end: usize) -> Vec<usize> {
        let mut out = vec![end];
        let mut at = end;
        while let Some(&b) = self.before.get(at).filter(|b| **b != NO_PIXEL) {
            at = b;
            out.push(at);
        }
        out
    }

    /// Middle of a pixel, y down.
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    pub fn point(&self, i: usize) -> DVec2 {
        DVec2::new((i % self.side) as f64 + 0.5, (i / self.side) as f64 + 0.5)
    }

    /// For each pixel the number of `tips` whose path to the anchor passes through it: 0 off the veins.
    pub fn tip_counts(&self, tips: &[usize]) -> Vec<u32> {
        let mut loads = vec![0_u32; self.before.len()];
        for tip in tips {
            for i in self.path_to_anchor(*tip) {
                loads[i] += 1;
            }
        }
        loads
    }
}

/// Resamples a line to `count` points, at least 2, at equal steps of arc length.
pub fn resampled(line: &[DVec2], count: usize) -> Vec<DVec2> {
    // Arc length at every point of the line.
    let mut arcs = vec![0.0];
    for w in line.windows(2) {
        arcs.push(arcs.last().copied().unwrap_or(0.0) + w[0].distance(w[1]));
    }
    let total = arcs.last().copied().unwrap_or(0.0);
    let count = count.max(2);
    #[allow(clippy::cast_precision_loss, reason = "a few points")]
    let at = |k: usize| {
        // The segment that contains the arc length s, then linear interpolation in it.
        let s = total * k as f64 / (count - 1) as f64;
        let i = arcs.partition_point(|a| *a <= s).clamp(1, line.len().max(2) - 1);
        let (Some(p), Some(q)) = (line.get(i - 1), line.get(i)) else {
            return line.first().copied().unwrap_or_default();
        };
        let span = arcs[i] - arcs[i - 1];
        p.lerp(*q, if span > 0.0 { ((s - arcs[i - 1]) / span).clamp(0.0, 1.0) } else { 0.0 })
    };
    (0..count).map(at).collect()
}

/// Position along a line, 0..1, of the point nearest to `p`, and the signed distance of `p` from the line, positive on
/// its left side with y up.
pub fn project_onto_line(line: &[DVec2], p: DVec2) -> (f64, f64) {
    let total: f64 = line.windows(2).map(|w| w[0].distance(w[1])).sum();
    let (mut best, mut arc) = ((f64::MAX, 0.0, 0.0), 0.0);
    for w in line.windows(2) {
        let d = w[1] - w[0];
        let t = ((p - w[0]).dot(d) / d.length_squared().max(1e-30)).clamp(0.0, 1.0);
        let distance = (p - w[0] - d * t).length();
        if distance < best.0 {
            best = (distance, arc + d.length() * t, d.perp_dot(p - w[0]).signum() * distance);
        }
        arc += d.length();
    }
    (best.1 / total.max(1e-30), best.2)
}
