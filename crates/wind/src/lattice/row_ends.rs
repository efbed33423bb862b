//! Halo of the rows' ends: populations that arrive there through faces -x and +x, inserted into registers when a step reads them.
//!
//! A face across x has one cell in each row. Written to memory, its five populations would be single numbers in cache lines that
//! the step is about to read as a whole. The processor stalls on each such store (store forwarding fails), which costs as much as
//! the rest of the step. The populations are therefore stored in a compact buffer and selected into the lanes that need them.

use pulp::Simd;

use super::grid::{BLOCK, LatticeGrid};
use super::stencil::{Q, VELOCITIES};
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::simd::F32Lanes;

/// Directions that enter the domain at a row's first cell, and at its last.
const INCOMING: [[usize; INCOMING_COUNT]; 2] = [[1, 7, 9, 11, 14], [2, 8, 10, 12, 13]];
/// Populations that enter at one end of a row.
const INCOMING_COUNT: usize = 5;
/// The index of each lane, in that lane.
const LANE_NUMBERS: [f32; BLOCK] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// Marks a row end that is not in a block.
pub(super) const NO_LANE: u32 = u32::MAX;

/// A register-sized block of a plane that holds an end of a row, or halo nodes between two rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RowEndLanes {
    pub block: usize,
    pub y: u32,
    /// Lanes of the row's first cell and its last; [`NO_LANE`] for those in other blocks.
    pub lanes: [u32; 2],
    /// Lanes of the halo nodes between this row and the next, end exclusive.
    halo: [u32; 2],
}

/// Populations that arrive at the ends of a plane's rows: by end, direction and row.
#[derive(Debug)]
pub(super) struct RowEndPopulations {
    rows: usize,
    populations: Vec<f32>,
}

impl RowEndPopulations {
    pub(super) fn new(grid: &LatticeGrid) -> Self {
        Self { rows: grid.n[1], populations: vec![0.0; 2 * INCOMING_COUNT * grid.n[1]] }
    }

    /// Index of the population that arrives in direction `i` at the cell (x, y) of a plane; `None` if it comes from within the
    /// row.
    pub(super) fn halo_index_of(grid: &LatticeGrid, i: usize, [x, y]: [usize; 2]) -> Option<usize> {
        // Only directions that point into the row from its end: +x at the first cell, -x at the last.
        let end = match VELOCITIES[i][0] {
            1 if x == 0 => 0,
            -1 if x + 1 == grid.n[0] => 1,
            _ => return None,
        };
        let nth = INCOMING[end].iter().position(|known| *known == i)?;
        Some((end * INCOMING_COUNT + nth) * grid.n[1] + y)
    }

    /// Stores populations of consecutive rows, beginning at index `to`.
    pub(super) fn store_rows(&mut self, to: usize, from: &[f32]) {
        if let [one] = from {
            self.populations[to] = *one;
        } else {
            self.populations[to..to + from.len()].copy_from_slice(from);
        }
    }

    /// Inserts the populations that arrive at row ends in a block into those read from memory, and sets halo nodes between rows
    /// to 0, so that their meaningless values cannot exceed the speed limit.
    #[inline(always)]
    pub(super) fn insert_into_lanes<S: Simd>(&self, simd: S, end: RowEndLanes, g: &mut [F32Lanes<S>; Q]) {
        let y = to_usize(end.y);
        if end.lanes[0] != NO_LANE {
            self.insert_row_end::<S, 0>(simd, to_usize(end.lanes[0]), y, g);
        }
        if end.lanes[1] != NO_LANE {
            self.insert_row_end::<S, 1>(simd, to_usize(end.lanes[1]), y, g);
        }
        let [from, to] = end.halo.map(to_usize);
        if from < to {
            // Mask of the lanes from..to, by comparing lane numbers; masked lanes become 0.
            let lanes = S::as_simd_f32s(&LANE_NUMBERS).0[0];
            let after = simd.greater_than_or_equal_f32s(lanes, simd.splat_f32s(LANE_NUMBERS[from]));
            let before = simd.less_than_or_equal_f32s(lanes, simd.splat_f32s(LANE_NUMBERS[to - 1]));
            let here = simd.and_m32s(after, before);
            for g in g.iter_mut() {
                *g = F32Lanes::new(simd, simd.select_f32s(here, simd.splat_f32s(0.0), g.value));
            }
        }
    }

    #[inline(always)]
    fn insert_row_end<S: Simd, const END: usize>(&self, simd: S, lane: usize, y: usize, g: &mut [F32Lanes<S>; Q]) {
        // Select the stored population into the one lane of the row's end, direction by direction.
        let here = simd.equal_f32s(S::as_simd_f32s(&LANE_NUMBERS).0[0], simd.splat_f32s(LANE_NUMBERS[lane]));
        let from = &self.populations[END * INCOMING_COUNT * self.rows + y..];
        for nth in 0..INCOMING_COUNT {
            let g = &mut g[INCOMING[END][nth]];
            *g = F32Lanes::new(simd, simd.select_f32s(here, simd.splat_f32s(from[nth * self.rows]), g.value));
        }
    }
}

impl RowEndLanes {
    /// All row ends of a plane in order, for registers of `lane_count` lanes; a sentinel that matches no block ends the list.
    /// # Errors
    /// `Limit` for more rows than an index of 32 bits counts.
    pub(super) fn list_of_plane(grid: &LatticeGrid, lane_count: usize) -> Result<Vec<Self>> {
        let mut list = Vec::new();
        for y in 0..grid.n[1] {
            let (first, last) = (y * grid.row_stride, y * grid.row_stride + grid.n[0] - 1);
            // After the last row only its block is filled up.
            let until = if y + 1 == grid.n[1] { (last + 1).next_multiple_of(BLOCK) } else { first + grid.row_stride };
            let checked_u32 = |n: usize| index(n, "rows of a plane of the lattice");
            // All registers that contain a part of this row's ends or of the halo nodes after it; other registers are omitted.
            for block in first / lane_count..until.div_ceil(lane_count) {
                let nodes = block * lane_count..(block + 1) * lane_count;
                let lane =
                    |node: usize| if nodes.contains(&node) { checked_u32(node - nodes.start) } else { Ok(NO_LANE) };
                let lanes = [lane(first)?, lane(last)?];
                let in_block = |node: usize| checked_u32(node.clamp(nodes.start, nodes.end) - nodes.start);
                let halo = [in_block(last + 1)?, in_block(until)?];
                if lanes != [NO_LANE; 2] || halo[0] < halo[1] {
                    list.push(Self { block, y: checked_u32(y)?, lanes, halo });
                }
            }
        }
        list.push(Self { block: usize::MAX, y: 0, lanes: [NO_LANE; 2], halo: [0; 2] });
        Ok(list)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_ends_and_halo_nodes_are_each_in_one_block() {
        for (n, lane_count) in [([70, 9, 4], 16), ([8, 5, 4], 16), ([33, 3, 4], 4), ([16, 8, 4], 8)] {
            let grid = LatticeGrid::new(n);
            let list = RowEndLanes::list_of_plane(&grid, lane_count).expect("blocks");
            assert!(list.is_sorted_by_key(|end| end.block));
            let mut seen = vec![0; grid.plane_span().next_multiple_of(BLOCK)];
            for end in &list[..list.len() - 1] {
                let first = end.block * lane_count;
                for (lane, x) in end.lanes.into_iter().zip([0, n[0] - 1]).filter(|(lane, _)| *lane != NO_LANE) {
                    assert_eq!(first + lane as usize, end.y as usize * grid.row_stride + x);
                    seen[first + lane as usize] += 1;
                }
                (end.halo[0]..end.halo[1]).for_each(|lane| seen[first + lane as usize] += 1);
            }
            for (k, times) in seen.into_iter().enumerate() {
                let (x, y) = (k % grid.row_stride, k / grid.row_stride);
                let inside = y < n[1] && x > 0 && x + 1 < n[0];
                assert_eq!(times, i32::from(!inside), "{n:?} at {x}, {y}");
            }
        }
    }

    #[test]
    fn incoming_directions_enter_the_row() {
        for (end, list) in INCOMING.iter().enumerate() {
            let inward: Vec<usize> = (0..Q).filter(|i| VELOCITIES[*i][0] == [1, -1][end]).collect();
            let mut list = list.to_vec();
            list.sort_unstable();
            assert_eq!(list, inward);
        }
    }
}
