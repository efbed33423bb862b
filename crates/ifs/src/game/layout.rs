//! Memory layout of the cells of a picture: square tiles, so that neighbouring pixels are close in memory, and rows of
//! a power of two do not compete for the same cache lines.

use osier_base::par::par_each;

/// log2 of the side of a tile; `avx2` has it as literals.
const SIDE: usize = 5;
const MASK: usize = (1 << SIDE) - 1;

/// Cells of a picture, tile after tile, with one more cell for points outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileLayout {
    /// Pixels per row of the picture.
    pub width: usize,
    /// Number of rows of the picture.
    pub height: usize,
}

impl TileLayout {
    /// Tiles in a row; the last one may reach beyond the picture.
    pub fn across(self) -> usize {
        self.width.div_ceil(1 << SIDE)
    }

    /// Index of the one cell for all points outside the picture, after all others.
    pub fn outside(self) -> usize {
        (self.across() * self.height.div_ceil(1 << SIDE)) << (2 * SIDE)
    }

    /// Number of cells, including the unused ones of tiles that reach beyond the picture and the cell of the outside.
    pub fn cells(self) -> usize {
        self.outside() + 1
    }

    /// Index of the cell of the pixel (x, y), which must lie in the picture; row 0 is the top.
    #[inline]
    pub fn cell(self, x: usize, y: usize) -> usize {
        let tile = (y >> SIDE) * self.across() + (x >> SIDE);
        (tile << (2 * SIDE)) | ((y & MASK) << SIDE) | (x & MASK)
    }

    /// Computes a value for every pixel from the index of its cell, rows from the top.
    pub fn rows<T: Default + Clone + Send>(self, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
        let mut out = vec![T::default(); self.width * self.height];
        let mut rows: Vec<(usize, &mut [T])> = out.chunks_mut(self.width.max(1)).enumerate().collect();
        par_each(&mut rows, |(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                *value = of(self.cell(x, *y));
            }
        });
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_has_a_cell_of_its_own() {
        for (width, height) in [(1, 1), (31, 65), (64, 32), (100, 33)] {
            let layout = TileLayout { width, height };
            let mut cells = layout.rows(|c| c);
            assert_eq!(cells.len(), width * height);
            assert_eq!(cells[(height - 1) * width], layout.cell(0, height - 1));
            cells.sort_unstable();
            cells.dedup();
            assert!(cells.len() == width * height && cells.iter().all(|c| *c < layout.outside()));
        }
    }
}
