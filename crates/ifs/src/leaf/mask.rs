//! The silhouette of a leaf: closed, in one piece, without pinholes.

use super::edt;

/// A square of pixels, rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Pixels along a side.
    pub side: usize,
    /// One entry per pixel, `side` x `side`: true inside the leaf.
    pub set: Vec<bool>,
}

/// What [`Mask::clean`] found and changed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CleaningReport {
    /// Number of connected parts before all but the largest were dropped.
    pub components: usize,
    /// Share of the set pixels in the largest part.
    pub largest: f64,
    /// Number of holes that were small enough to be filled.
    pub filled: usize,
    /// Number of holes that were too large to be filled.
    pub holes: usize,
}

impl Mask {
    /// Closes by a disc of `close` pixels, keeps the largest 8-connected part, fills holes of at most `hole` pixels.
    /// `None` for an empty mask.
    pub fn clean(self, close: f64, hole: usize) -> Option<(Self, CleaningReport)> {
        let closed = if close > 0.0 { self.closed(close) } else { self };
        // Largest 8-connected part of the set pixels; ties go to the first.
        let (labels, sizes) = closed.components(true, true);
        let all: usize = sizes.iter().sum();
        let best = (0..sizes.len()).max_by_key(|i| (sizes[*i], usize::MAX - i))?;
        let keep = u32::try_from(best).ok()?;
        let mut mask = Self { side: closed.side, set: labels.iter().map(|l| *l == keep).collect() };
        let (labels, sizes) = mask.components(false, false);
        // Unset parts that touch the border are the outside, the others are holes.
        let border = mask.border_components(&labels, sizes.len());
        let small: Vec<bool> = (0..sizes.len()).map(|i| !border[i] && sizes[i] <= hole).collect();
        for (set, l) in mask.set.iter_mut().zip(&labels) {
            *set |= small.get(*l as usize).copied().unwrap_or(false);
        }
        let filled = small.iter().filter(|s| **s).count();
        let holes = (0..sizes.len()).filter(|i| !border[*i]).count() - filled;
        #[allow(clippy::cast_precision_loss, reason = "pixels")]
        let largest = size_share(all, best, &closed.components(true, true).1);
        Some((mask, CleaningReport { components: closed.components(true, true).1.len(), largest, filled, holes }))
    }

    fn closed(&self, radius: f64) -> Self {
        let n = self.side;
        let limit = radius * radius;
        // Morphological closing by a disc: dilation, then erosion, both by thresholds of the exact distance.
        let grown: Vec<bool> = edt::nearest(&self.set, n, n).0.iter().map(|d| *d <= limit).collect();
        let rest: Vec<bool> = grown.iter().map(|g| !g).collect();
        let shrunk = edt::nearest(&rest, n, n).0.iter().map(|d| *d > limit).collect();
        Self { side: n, set: shrunk }
    }

    /// Labels of the connected parts of set (or unset) pixels and their sizes; `u32::MAX` for other pixels.
    fn components(&self, of_set: bool, diagonal: bool) -> (Vec<u32>, Vec<usize>) {
        let n = self.side;
        let mut labels = vec![u32::MAX; self.set.len()];
        let mut sizes = Vec::new();
        let mut next_label = 0_u32;
        let mut stack = Vec::new();
        for start in 0..labels.len() {
            if self.set[start] != of_set || labels[start] != u32::MAX {
                continue;
            }
            let label = next_label;
            next_label += 1;
            labels[start] = label;
            stack.push(start);
            let mut size = 0;
            // Flood fill with an explicit stack.
            while let Some(i) = stack.pop() {
                size += 1;
                for j in neighbours(i, n, diagonal) {
                    if self.set[j] == of_set && labels[j] == u32::MAX {
                        labels[j] = label;
                        stack.push(j);
                    }
                }
            }
            sizes.push(size);
        }
        (labels, sizes)
    }

    /// For each part, whether it touches the border of the picture.
    fn border_components(&self, labels: &[u32], count: usize) -> Vec<bool> {
        let n = self.side;
        let mut out = vec![false; count];
        for k in 0..n {
            for i in [k, (n - 1) * n + k, k * n, k * n + n - 1] {
                if let Some(b) = labels.get(i).and_then(|l| out.get_mut(*l as usize)) {
                    *b = true;
                }
            }
        }
        out
    }

    /// Share of the picture that is set.
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    pub fn cover(&self) -> f64 {
        self.set.iter().filter(|s| **s).count() as f64 / self.set.len().max(1) as f64
    }
}

#[allow(clippy::cast_precision_loss, reason = "pixels")]
fn size_share(all: usize, best: usize, sizes: &[usize]) -> f64 {
    sizes.get(best).copied().unwrap_or(0) as f64 / all.max(1) as f64
}

/// The four or eight pixels around one, those in the picture.
pub(super) fn neighbours(i: usize, n: usize, diagonal: bool) -> impl Iterator<Item = usize> {
    const STEPS: [(isize, isize); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];
    let (x, y) = (i % n, i / n);
    STEPS.into_iter().take(if diagonal { 8 } else { 4 }).filter_map(move |(dx, dy)| {
        let (u, v) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        (u < n && v < n).then_some(v * n + u)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(rows: &[&str]) -> Mask {
        Mask { side: rows.len(), set: rows.iter().flat_map(|r| r.bytes().map(|b| b == b'#')).collect() }
    }

    #[test]
    fn pinholes_are_filled_and_crumbs_dropped() {
        let m = mask(&["######.#", "#....#..", "#.##.#..", "#.##.#..", "#....#..", "######..", "..##.#..", "..####.."]);
        let (clean, report) = m.clean(0.0, 1).expect("some");
        assert_eq!((report.components, report.filled, report.holes), (3, 1, 1), "{report:?}");
        assert!(!clean.set[7] && clean.set[6 * 8 + 4] && !clean.set[8 + 1]);
        assert!(mask(&["..", ".."]).clean(2.0, 1).is_none());
    }

    #[test]
    fn closing_bridges_gaps_and_keeps_the_rest() {
        let m = mask(&["........", "........", "........", "###.####", "........", "........", "........", "........"]);
        let (clean, report) = m.clean(1.5, 0).expect("some");
        assert_eq!((report.components, clean.set.iter().filter(|s| **s).count()), (1, 8));
    }
}
