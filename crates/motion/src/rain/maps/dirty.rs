//! Which texels of a map are done again: runs of columns, row by row.

use super::TILE;
use super::uv_raster::TexelWindow;

/// Bits of a word of marks.
const WORD: usize = 64;

/// Columns of texels, the end excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ColumnSpan(pub usize, pub usize);

/// Runs of each row of a map.
#[derive(Debug, Clone)]
pub(super) struct RowSpans {
    all: Vec<ColumnSpan>,
    /// Where each row's begin, and where the last one's end.
    starts: Vec<usize>,
}

impl RowSpans {
    /// All texels.
    pub fn all(side: usize) -> Self {
        Self { all: vec![ColumnSpan(0, side); side], starts: (0..=side).collect() }
    }

    /// Those of a row.
    #[inline(always)]
    pub fn of(&self, y: usize) -> &[ColumnSpan] {
        &self.all[self.starts[y]..self.starts[y + 1]]
    }

    /// One row's after the other's.
    fn by_row(side: usize, mut row: impl FnMut(usize, &mut Vec<ColumnSpan>)) -> Self {
        let (mut all, mut starts) = (Vec::new(), vec![0]);
        for y in 0..side {
            row(y, &mut all);
            starts.push(all.len());
        }
        Self { all, starts }
    }
}

/// What changed of a leaf's water.
pub(super) struct DirtySpans {
    /// Texels whose heights may.
    pub poured: RowSpans,
    /// And those whose normals may with them.
    pub turned: RowSpans,
}

impl DirtySpans {
    /// All texels.
    pub fn all(side: usize) -> Self {
        Self { poured: RowSpans::all(side), turned: RowSpans::all(side) }
    }

    pub fn new(marks: &DirtyTiles) -> Self {
        let n = marks.side;
        let poured = RowSpans::by_row(n, |y, all| all.extend(runs(marks.row(y), n)));
        let mut around = Vec::new();
        let turned = RowSpans::by_row(n, |y, all| {
            // A normal is made of the heights of its neighbours.
            let [above, below] = [y.saturating_sub(1), (y + 1).min(n - 1)].map(|y| marks.row(y));
            around.clear();
            around.extend(marks.row(y).iter().zip(above).zip(below).map(|((own, above), below)| own | above | below));
            all.extend(runs(&around, n).map(|r| ColumnSpan(r.0.saturating_sub(1), (r.1 + 1).min(n))));
        });
        Self { poured, turned }
    }

    /// Whether anything did.
    pub fn any(&self) -> bool {
        !self.poured.all.is_empty()
    }
}

/// Pieces of rows, [`TILE`] texels long, that are marked: a bit for each, the first in a word's lowest.
#[derive(Debug, Clone)]
pub(super) struct DirtyTiles {
    side: usize,
    words: usize,
    all: Vec<u64>,
}

impl DirtyTiles {
    pub fn none(side: usize) -> Self {
        let words = side.div_ceil(TILE * WORD);
        Self { side, words, all: vec![0; side * words] }
    }

    fn row(&self, y: usize) -> &[u64] {
        &self.all[y * self.words..(y + 1) * self.words]
    }

    /// Marks what has texels of a window.
    pub fn add(&mut self, window: &TexelWindow) {
        for first in (window.lo[1]..window.hi[1]).step_by(TILE) {
            for (y, ends) in (first..window.hi[1]).zip(window.columns(first)) {
                let (from, to) = window.whole_columns(ends);
                if from < to {
                    set_bits(&mut self.all[y * self.words..(y + 1) * self.words], from / TILE, (to - 1) / TILE);
                }
            }
        }
    }
}

/// Sets bits from `first` to `last`, both included.
#[inline(always)]
fn set_bits(words: &mut [u64], first: usize, last: usize) {
    for (k, word) in words.iter_mut().enumerate().take(last / WORD + 1).skip(first / WORD) {
        let low = first.saturating_sub(k * WORD);
        let high = (last - k * WORD).min(WORD - 1);
        *word |= (u64::MAX << low) & (u64::MAX >> (WORD - 1 - high));
    }
}

/// Runs of pieces whose bits are set, as columns of texels of a row of `n`.
fn runs(words: &[u64], n: usize) -> impl Iterator<Item = ColumnSpan> + '_ {
    let end = n.div_ceil(TILE);
    let next = move |from: usize, flip: u64| {
        let mut k = from;
        while k < end {
            let left = (words[k / WORD] ^ flip) >> (k % WORD);
            if left != 0 {
                return (k + left.trailing_zeros() as usize).min(end);
            }
            k = (k / WORD + 1) * WORD;
        }
        end
    };
    let mut k = 0;
    std::iter::from_fn(move || {
        let from = next(k, 0);
        k = next(from, u64::MAX);
        (from < end).then(|| ColumnSpan(from * TILE, (k * TILE).min(n)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_the_bits_that_were_set() {
        // 80 pieces and a part of one: bits of two words.
        let n = 80 * TILE + 5;
        let mut words = vec![0; n.div_ceil(TILE * WORD)];
        for ends in [(3, 3), (10, 70), (64, 72), (80, 80)] {
            set_bits(&mut words, ends.0, ends.1);
        }
        let meant = [ColumnSpan(3 * TILE, 4 * TILE), ColumnSpan(10 * TILE, 73 * TILE), ColumnSpan(80 * TILE, n)];
        assert_eq!(runs(&words, n).collect::<Vec<_>>(), meant);
        set_bits(&mut words, 0, 80);
        assert_eq!(runs(&words, n).collect::<Vec<_>>(), [ColumnSpan(0, n)]);
        assert_eq!(runs(&[0, 0], n).count(), 0);
    }
}
