//! Spans of texels that a frame has to recompute, row by row.

use super::TILE;
use super::texel_window::{ColumnSpan, TexelWindow};

/// Number of segments whose marks fit into a word.
const WORD_BITS: usize = 64;

/// Disjoint spans of columns for each row of a map.
#[derive(Debug, Clone)]
pub(super) struct RowSpans {
    /// The spans of all rows, one row after the other.
    spans: Vec<ColumnSpan>,
    /// Index of the first span of each row, and the number of spans.
    starts: Vec<usize>,
}

impl RowSpans {
    /// One span for each row of a map of `side` by `side` texels, over the whole row.
    pub fn full(side: usize) -> Self {
        Self { spans: vec![ColumnSpan { start: 0, end: side }; side], starts: (0..=side).collect() }
    }

    /// The spans of row `y`, disjoint and ascending.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[ColumnSpan] {
        &self.spans[self.starts[y]..self.starts[y + 1]]
    }

    /// Builds the list row by row; `append_row` appends the spans of the row `y`.
    fn from_rows(side: usize, mut append_row: impl FnMut(usize, &mut Vec<ColumnSpan>)) -> Self {
        let (mut spans, mut starts) = (Vec::new(), vec![0]);
        for y in 0..side {
            append_row(y, &mut spans);
            starts.push(spans.len());
        }
        Self { spans, starts }
    }
}

/// Texels that a frame has to recompute: of the height maps and of the normal map.
pub(super) struct DirtySpans {
    /// Texels whose height may have changed.
    pub heights: RowSpans,
    /// Texels whose normal may have changed: those and their neighbours.
    pub normals: RowSpans,
}

impl DirtySpans {
    /// Spans of every texel of a map of `side` by `side`.
    pub fn full(side: usize) -> Self {
        Self { heights: RowSpans::full(side), normals: RowSpans::full(side) }
    }

    pub fn new(segments: &DirtyBits) -> Self {
        let n = segments.side;
        let heights = RowSpans::from_rows(n, |y, spans| spans.extend(marked_spans(segments.row(y), n)));
        // A normal depends on the heights of its four neighbours: mark also the rows above and below (bitwise or), and extend each
        // span by a column on either side.
        let mut around = Vec::new();
        let normals = RowSpans::from_rows(n, |y, spans| {
            let [above, below] = [y.saturating_sub(1), (y + 1).min(n - 1)].map(|y| segments.row(y));
            around.clear();
            around
                .extend(segments.row(y).iter().zip(above).zip(below).map(|((row, above), below)| row | above | below));
            spans.extend(
                marked_spans(&around, n)
                    .map(|s| ColumnSpan { start: s.start.saturating_sub(1), end: (s.end + 1).min(n) }),
            );
        });
        Self { heights, normals }
    }

    /// Whether any height may have changed; without such a change no normal changes either.
    pub fn is_dirty(&self) -> bool {
        !self.heights.spans.is_empty()
    }
}

/// Marks on segments of rows, each [`TILE`] texels long: one bit per segment, the lowest bit for the first segment of a row.
#[derive(Debug, Clone)]
pub(super) struct DirtyBits {
    side: usize,
    words_per_row: usize,
    words: Vec<u64>,
}

impl DirtyBits {
    /// No marks on a map of `side` by `side` texels.
    pub fn none(side: usize) -> Self {
        let words_per_row = side.div_ceil(TILE * WORD_BITS);
        Self { side, words_per_row, words: vec![0; side * words_per_row] }
    }

    fn row(&self, y: usize) -> &[u64] {
        &self.words[y * self.words_per_row..(y + 1) * self.words_per_row]
    }

    /// Marks the segments that hold texels of a window.
    pub fn mark(&mut self, window: &TexelWindow) {
        for first in (window.lo[1]..window.hi[1]).step_by(TILE) {
            for (y, bounds) in (first..window.hi[1]).zip(window.tile_row_bounds(first)) {
                let ColumnSpan { start, end } = window.columns_within(bounds);
                if start < end {
                    let row = &mut self.words[y * self.words_per_row..(y + 1) * self.words_per_row];
                    set_bit_range(row, start / TILE, (end - 1) / TILE);
                }
            }
        }
    }
}

/// Sets bits from `first` to `last`, both included.
#[inline(always)]
fn set_bit_range(words: &mut [u64], first: usize, last: usize) {
    for (k, word) in words.iter_mut().enumerate().take(last / WORD_BITS + 1).skip(first / WORD_BITS) {
        // Bits of this word: from `first` or its lowest, to `last` or its highest.
        let low = first.saturating_sub(k * WORD_BITS);
        let high = (last - k * WORD_BITS).min(WORD_BITS - 1);
        *word |= (u64::MAX << low) & (u64::MAX >> (WORD_BITS - 1 - high));
    }
}

/// Runs of marked segments, as spans of texels of a row of `n`.
fn marked_spans(words: &[u64], n: usize) -> impl Iterator<Item = ColumnSpan> + '_ {
    let segments = n.div_ceil(TILE);
    // The first segment from `from` on that is marked (`flip` 0) or unmarked (`flip` all ones), by trailing zeros of words.
    let next = move |from: usize, flip: u64| {
        let mut k = from;
        while k < segments {
            let left = (words[k / WORD_BITS] ^ flip) >> (k % WORD_BITS);
            if left != 0 {
                return (k + left.trailing_zeros() as usize).min(segments);
            }
            k = (k / WORD_BITS + 1) * WORD_BITS;
        }
        segments
    };
    // Alternate between the next marked and the next unmarked segment.
    let mut k = 0;
    std::iter::from_fn(move || {
        let from = next(k, 0);
        k = next(from, u64::MAX);
        (from < segments).then(|| ColumnSpan { start: from * TILE, end: (k * TILE).min(n) })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_the_bits_that_were_set() {
        // 80 segments and a part of one: bits of two words.
        let n = 80 * TILE + 5;
        let mut words = vec![0; n.div_ceil(TILE * WORD_BITS)];
        for ends in [(3, 3), (10, 70), (64, 72), (80, 80)] {
            set_bit_range(&mut words, ends.0, ends.1);
        }
        let meant = [[3 * TILE, 4 * TILE], [10 * TILE, 73 * TILE], [80 * TILE, n]]
            .map(|[start, end]| ColumnSpan { start, end });
        assert_eq!(marked_spans(&words, n).collect::<Vec<_>>(), meant);
        set_bit_range(&mut words, 0, 80);
        assert_eq!(marked_spans(&words, n).collect::<Vec<_>>(), [ColumnSpan { start: 0, end: n }]);
        assert_eq!(marked_spans(&[0, 0], n).count(), 0);
    }
}
