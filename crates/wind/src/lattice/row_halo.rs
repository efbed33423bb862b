//! The ends of rows: what arrives there from boundaries is handed over while a step reads, not put into memory.
//!
//! A face across x has one cell in each row. Put into memory, its five populations would be single numbers in lines of the
//! cache that the step is about to read as a whole: the processor waits for such stores, row by row, as long as for
//! everything else.

use pulp::Simd;

use super::grid::{BLOCK, Grid};
use super::stencil::{C, Q};
use osier_base::simd::F32Lanes;

/// Directions that arrive at the first cell of a row from outside, and at the last.
const ARRIVE: [[usize; PER]; 2] = [[1, 7, 9, 11, 14], [2, 8, 10, 12, 13]];
/// Populations that arrive at an end.
const PER: usize = 5;
/// Lanes by number.
const LANES: [f32; BLOCK] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// No lane.
pub(super) const NONE: u32 = u32::MAX;

/// A block of a plane that holds an end of a row, or nodes between this row and the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct End {
    pub block: usize,
    pub y: u32,
    /// Lanes of the row's first cell and its last; [`NONE`] for those in other blocks.
    pub lanes: [u32; 2],
    /// Lanes of nodes between rows, from the first to before the last.
    between: [u32; 2],
}

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

    /// Hands over what arrives at the ends of a row in a block, and nothing to nodes between rows.
    #[inline(always)]
    pub(super) fn hand<S: Simd>(&self, simd: S, end: End, g: &mut [F32Lanes<S>; Q]) {
        let y = end.y as usize;
        if end.lanes[0] != NONE {
            self.arrive::<S, 0>(simd, (end.lanes[0] as usize, y), g);
        }
        if end.lanes[1] != NONE {
            self.arrive::<S, 1>(simd, (end.lanes[1] as usize, y), g);
        }
        let [from, to] = end.between.map(|lane| lane as usize);
        if from < to {
            let lanes = S::as_simd_f32s(&LANES).0[0];
            let after = simd.greater_than_or_equal_f32s(lanes, simd.splat_f32s(LANES[from]));
            let here = simd.and_m32s(after, simd.less_than_or_equal_f32s(lanes, simd.splat_f32s(LANES[to - 1])));
            for g in g.iter_mut() {
                *g = F32Lanes::new(simd, simd.select_f32s(here, simd.splat_f32s(0.0), g.value));
            }
        }
    }
}

impl Ends {
    #[inline(always)]
    fn arrive<S: Simd, const END: usize>(&self, simd: S, (lane, y): (usize, usize), g: &mut [F32Lanes<S>; Q]) {
        let here = simd.equal_f32s(S::as_simd_f32s(&LANES).0[0], simd.splat_f32s(LANES[lane]));
        let from = &self.arrived[END * PER * self.rows + y..];
        for nth in 0..PER {
            let g = &mut g[ARRIVE[END][nth]];
            *g = F32Lanes::new(simd, simd.select_f32s(here, simd.splat_f32s(from[nth * self.rows]), g.value));
        }
    }
}

impl End {
    /// All of a plane, block by block, when so many nodes are computed together; the last one is of no block.
    pub(super) fn list(grid: &Grid, together: usize) -> Vec<Self> {
        let mut list: Vec<Self> = (0..grid.n[1]).flat_map(|y| Self::of_row(grid, together, y)).collect();
        list.push(Self { block: usize::MAX, y: 0, lanes: [NONE; 2], between: [0; 2] });
        list
    }

    /// Blocks with an end of a row, or with nodes between it and the next.
    fn of_row(grid: &Grid, together: usize, y: usize) -> impl Iterator<Item = Self> {
        let (first, last) = (y * grid.row, y * grid.row + grid.n[0] - 1);
        // The last row is followed by nothing up to the end of its block.
        let until = if y + 1 == grid.n[1] { (last + 1).next_multiple_of(BLOCK) } else { first + grid.row };
        let blocks = first / together..until.div_ceil(together);
        blocks.filter_map(move |block| {
            let nodes = block * together..(block + 1) * together;
            let lane = |node: usize| if nodes.contains(&node) { small(node - nodes.start) } else { NONE };
            let lanes = [lane(first), lane(last)];
            let between = [last + 1, until].map(|node| small(node.clamp(nodes.start, nodes.end) - nodes.start));
            (lanes != [NONE; 2] || between[0] < between[1]).then_some(Self { block, y: small(y), lanes, between })
        })
    }
}

fn small(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(NONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_end_is_in_one_block_and_so_is_every_node_between() {
        for (n, together) in [([70, 9, 4], 16), ([8, 5, 4], 16), ([33, 3, 4], 4), ([16, 8, 4], 8)] {
            let grid = Grid::new(n);
            let list = End::list(&grid, together);
            assert!(list.is_sorted_by_key(|end| end.block));
            let mut seen = vec![0; grid.span().next_multiple_of(BLOCK)];
            for end in &list[..list.len() - 1] {
                let first = end.block * together;
                for (lane, x) in end.lanes.into_iter().zip([0, n[0] - 1]).filter(|(lane, _)| *lane != NONE) {
                    assert_eq!(first + lane as usize, end.y as usize * grid.row + x);
                    seen[first + lane as usize] += 1;
                }
                (end.between[0]..end.between[1]).for_each(|lane| seen[first + lane as usize] += 1);
            }
            for (k, times) in seen.into_iter().enumerate() {
                let (x, y) = (k % grid.row, k / grid.row);
                let inside = y < n[1] && x > 0 && x + 1 < n[0];
                assert_eq!(times, i32::from(!inside), "{n:?} at {x}, {y}");
            }
        }
    }

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
