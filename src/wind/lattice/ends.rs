//! The ends of rows: what arrives there from boundaries is handed over while a step reads, not put into memory.
//!
//! A face across x has one cell in each row. Put into memory, its five populations would be single numbers in lines of the
//! cache that the step is about to read as a whole: the processor waits for such stores, row by row, as long as for
//! everything else.

use pulp::Simd;

use super::grid::{BLOCK, Grid};
use super::lane::Wide;
use super::stencil::{C, Q};

/// Directions that arrive at the first cell of a row from outside, and at the last.
const ARRIVE: [[usize; PER]; 2] = [[1, 7, 9, 11, 14], [2, 8, 10, 12, 13]];
/// Populations that arrive at an end.
const PER: usize = 5;
/// Lanes by number.
const LANES: [f32; BLOCK] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// What arrives at the ends of the rows of a plane: by end, by direction, by row.
#[derive(Debug)]
pub(super) struct Ends {
    rows: usize,
    arrived: Vec<f32>,
}

impl Ends {
    pub(super) fn new(grid: &Grid) -> Self {
        Self { rows: grid.n[1], arrived: vec![0.0; 2 * PER * grid.n[1]] }
    }

    /// Where the population has its place that arrives along `i` at the cell (x, y) of a plane; none if it comes from
    /// inside.
    pub(super) fn place(grid: &Grid, i: usize, [x, y]: [usize; 2]) -> Option<usize> {
        let end = match C[i][0] {
            1 if x == 0 => 0,
            -1 if x + 1 == grid.n[0] => 1,
            _ => return None,
        };
        let nth = ARRIVE[end].iter().position(|known| *known == i)?;
        Some((end * PER + nth) * grid.n[1] + y)
    }

    /// Takes over what arrives at some rows.
    pub(super) fn take(&mut self, to: usize, from: &[f32]) {
        if let [one] = from {
            self.arrived[to] = *one;
        } else {
            self.arrived[to..to + from.len()].copy_from_slice(from);
        }
    }

    /// Hands over what arrives at the ends of rows among the nodes of a block, and nothing to nodes between rows.
    /// `first`: the block's first node, counted from the first cell of the plane.
    #[inline(always)]
    pub(super) fn hand<S: Simd>(&self, simd: S, grid: &Grid, first: usize, g: &mut [Wide<S>; Q]) {
        let lanes = S::as_simd_f32s(&LANES).0[0];
        let mut y = first / grid.row;
        while y < self.rows && y * grid.row < first + S::F32_LANES {
            if let Some(lane) = lane_of(grid, (first, S::F32_LANES), (0, y)) {
                self.arrive::<S, 0>(simd, (lane, y), g);
            }
            if let Some(lane) = lane_of(grid, (first, S::F32_LANES), (1, y)) {
                self.arrive::<S, 1>(simd, (lane, y), g);
            }
            let between = y * grid.row + grid.n[0];
            let from = between.max(first) - first;
            // The last row is followed by nothing.
            let to = if y + 1 == self.rows { BLOCK } else { (between + 2).saturating_sub(first).min(BLOCK) };
            if from < to && from < S::F32_LANES {
                let after = simd.greater_than_or_equal_f32s(lanes, simd.splat_f32s(LANES[from]));
                let here = simd.and_m32s(after, simd.less_than_or_equal_f32s(lanes, simd.splat_f32s(LANES[to - 1])));
                for g in g.iter_mut() {
                    *g = Wide::new(simd, simd.select_f32s(here, simd.splat_f32s(0.0), g.value));
                }
            }
            y += 1;
        }
    }
}

impl Ends {
    #[inline(always)]
    fn arrive<S: Simd, const END: usize>(&self, simd: S, (lane, y): (usize, usize), g: &mut [Wide<S>; Q]) {
        let here = simd.equal_f32s(S::as_simd_f32s(&LANES).0[0], simd.splat_f32s(LANES[lane]));
        let from = &self.arrived[END * PER * self.rows + y..];
        for nth in 0..PER {
            let g = &mut g[ARRIVE[END][nth]];
            *g = Wide::new(simd, simd.select_f32s(here, simd.splat_f32s(from[nth * self.rows]), g.value));
        }
    }
}

/// The lane of a block that is the first cell of row y, or with `end` 1 the last. `first`: the block's first node.
#[inline(always)]
pub(super) fn lane_of(grid: &Grid, (first, lanes): (usize, usize), (end, y): (usize, usize)) -> Option<usize> {
    let node = y * grid.row + end * (grid.n[0] - 1);
    if y < grid.n[1] && node >= first && node < first + lanes { Some(node - first) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_arrives_at_an_end_comes_from_outside() {
        for (end, list) in ARRIVE.iter().enumerate() {
            let outside: Vec<usize> = (0..Q).filter(|i| C[*i][0] == [1, -1][end]).collect();
            let mut list = list.to_vec();
            list.sort_unstable();
            assert_eq!(list, outside);
        }
    }
}
