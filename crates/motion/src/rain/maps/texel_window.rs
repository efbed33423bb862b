//! Windows of texels: those that an ellipse in the texture may cover.

use std::ops::Range;

use glam::DVec2;

use super::TILE;

/// A span of columns of texels; the end is excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ColumnSpan {
    pub start: usize,
    pub end: usize,
}

/// The texels that an ellipse in the texture may cover: its bounding box, restricted row by row to the ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TexelWindow {
    /// First column and row.
    pub lo: [usize; 2],
    /// Column and row after the last.
    pub hi: [usize; 2],
    /// Center of the ellipse, in texels.
    pub center: DVec2,
    /// Columns by which the middle of a row shifts per row.
    pub shear: f64,
    /// Square of the half width of the middle row, in columns.
    pub half_width2: f64,
    /// Decrease of the square of the half width per square of the distance from the middle row.
    pub half_width2_decrease: f64,
}

impl TexelWindow {
    /// All texels of a map of `side` by `side`: an ellipse of infinite width.
    pub fn full(side: usize) -> Self {
        Self {
            lo: [0; 2],
            hi: [side; 2],
            center: DVec2::ZERO,
            shear: 0.0,
            half_width2: f64::INFINITY,
            half_width2_decrease: 0.0,
        }
    }

    pub fn overlaps_rows(&self, rows: &Range<usize>) -> bool {
        self.lo[1] < rows.end && rows.start < self.hi[1]
    }

    /// A span of columns that holds the window's texels in all of `rows`.
    pub fn columns_of_rows(&self, rows: Range<usize>) -> ColumnSpan {
        // The middles of the first and the last row bound those between; the widest row is the one nearest to the center.
        let rows = [rows.start.max(self.lo[1]), rows.end.min(self.hi[1]).saturating_sub(1)];
        let [first, last] = rows.map(|y| y as f64 + 0.5 - self.center.y);
        let widest = first.max(0.0).min(last.max(first));
        let half = (self.half_width2 - self.half_width2_decrease * widest * widest).max(0.0).sqrt() + 1.0;
        let [a, b] = [first, last].map(|dy| self.center.x + self.shear * dy);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let (start, end) = ((a.min(b) - half) as usize, (a.max(b) + half + 1.0) as usize);
        ColumnSpan { start: start.max(self.lo[0]), end: end.min(self.hi[0]) }
    }

    /// Fractional bounds of the columns of [`TILE`] rows from `first` on. They are computed for all rows at once, since the
    /// processor evaluates several square roots together and most windows are narrow.
    #[inline(always)]
    pub fn tile_row_bounds(&self, first: usize) -> [[f64; 2]; TILE] {
        let mut bounds = [[0.0; TILE]; 2];
        let y = first as f64 + 0.5 - self.center.y;
        let [starts, ends] = &mut bounds;
        for (i, (start, end)) in starts.iter_mut().zip(ends).enumerate() {
            // The middle of the row shifts linearly with dy, the square of the half width falls with dy^2.
            let dy = y + i as f64;
            let middle = self.center.x + self.shear * dy;
            // Texels whose center lies inside of the ellipse, and a tenth of a texel for rounding.
            let half = (self.half_width2 - self.half_width2_decrease * dy * dy).max(0.0).sqrt() + 0.1;
            (*start, *end) = (middle - half - 0.5, middle + half + 0.5);
        }
        std::array::from_fn(|i| [bounds[0][i], bounds[1][i]])
    }

    /// Columns of texels within both the fractional bounds of a row and the bounding box.
    #[inline(always)]
    pub fn columns_within(&self, [start, end]: [f64; 2]) -> ColumnSpan {
        // Casts to integers saturate: negative bounds become 0.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let (start, end) = (start as usize, end as usize);
        ColumnSpan { start: start.max(self.lo[0]), end: end.min(self.hi[0]) }
    }
}
