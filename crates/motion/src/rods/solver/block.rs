//! Direct solver for linear systems over a tree of sections: 9x9 blocks, eliminated from the tips to the roots.

use pulp::{Arch, NullaryFnOnce};

use crate::rods::prism::Vector9;
use osier_scene::plant::NONE;

/// Elements of a row: diagonal block, blocks to both predecessors, right-hand side, and padding to whole cache lines.
pub(crate) const ROW_LENGTH: usize = 32;
/// First column of either predecessor's block, and the column of the right-hand side.
pub(crate) const PREDECESSOR: usize = 9;
pub(crate) const SECOND_PREDECESSOR: usize = 18;
pub(crate) const RIGHT_HAND_SIDE: usize = 27;

/// The nine rows of a section, aligned to cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct BlockRow(pub [[f64; ROW_LENGTH]; 9]);

impl Default for BlockRow {
    fn default() -> Self {
        Self([[0.0; ROW_LENGTH]; 9])
    }
}

impl BlockRow {
    pub(crate) fn set_right_hand_side(&mut self, r: &Vector9) {
        for k in 0..9 {
            self.0[k][RIGHT_HAND_SIDE] = r[k];
        }
    }

    /// Largest entry on the diagonal of the section's block; 0 if no entry is positive.
    pub(crate) fn max_diagonal(&self) -> f64 {
        (0..9).fold(0.0, |m, k| self.0[k][k].max(m))
    }
}

/// Index of the preceding section and of the one before that, or [`NONE`]; both are lower than that of the section.
pub(crate) type PrecedingSections = [u32; 2];

/// Solves a symmetric positive definite system in place and writes the solution to `out`; false if a pivot was not positive. The
/// second predecessor of a section, if there is one, must be the first predecessor of its first, so that no fill-in occurs.
/// Own: block Cholesky in elimination-tree order; a section is coupled to two others only.
pub(crate) fn solve_block_system(
    rows: &mut [BlockRow],
    predecessors: &[PrecedingSections],
    out: &mut [Vector9],
) -> bool {
    Arch::new().dispatch(BlockSolveKernel { rows, predecessors, out })
}

struct BlockSolveKernel<'a> {
    rows: &'a mut [BlockRow],
    predecessors: &'a [PrecedingSections],
    out: &'a mut [Vector9],
}

impl NullaryFnOnce for BlockSolveKernel<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { rows, predecessors, out } = self;
        // Forward elimination from the tips to the roots. A section couples only to its two predecessors, which couple
        // to each other, so eliminating it changes blocks that exist already: no fill-in, cost linear in the sections.
        for i in (0..rows.len()).rev() {
            let (before, rest) = rows.split_at_mut(i);
            let own = &mut rest[0];
            if !factorize_block(own) {
                return false;
            }
            let [up, over] = predecessors[i];
            if up != NONE {
                eliminate_into_predecessor(own, &mut before[up as usize]);
            }
            if over != NONE {
                eliminate_into_second_predecessor(own, &mut before[over as usize]);
            }
        }
        // Back substitution from the roots to the tips: U x = y - U_up x_up - U_over x_over.
        for i in 0..rows.len() {
            let [up, over] = predecessors[i].map(|k| if k == NONE { [0.0; 9] } else { out[k as usize] });
            out[i] = back_substitute_section(&rows[i], &up, &over);
        }
        true
    }
}

/// Factorizes the diagonal block A = U^T U in place and multiplies the rest of the rows by U^-T on the way.
#[inline(always)]
fn factorize_block(own: &mut BlockRow) -> bool {
    for k in 0..9 {
        // Row k of U is row k of A divided by the root of its pivot. If the pivot is not positive, A is not positive definite (or
        // holds NaN), and the step has failed.
        let pivot = own.0[k][k];
        if pivot <= 0.0 || pivot.is_nan() {
            return false;
        }
        let scale = 1.0 / pivot.sqrt();
        for v in &mut own.0[k] {
            *v *= scale;
        }
        // Schur update of the rows below, off-diagonal blocks and right-hand side included.
        let row = own.0[k];
        for j in k + 1..9 {
            let f = row[j];
            for c in 0..ROW_LENGTH {
                own.0[j][c] -= f * row[c];
            }
        }
    }
    true
}

/// Schur complement of an eliminated section on its predecessor: blocks (up, up) and (up, over), and the right-hand
/// side.
#[inline(always)]
fn eliminate_into_predecessor(own: &BlockRow, up: &mut BlockRow) {
    for a in 0..9 {
        // The 18 columns of the blocks (up, over), the right-hand side, and one column of padding for SIMD.
        let mut sum = [0.0; 20];
        for k in 0..9 {
            let f = own.0[k][PREDECESSOR + a];
            for c in 0..20 {
                sum[c] += f * own.0[k][PREDECESSOR + c];
            }
        }
        for c in 0..18 {
            up.0[a][c] -= sum[c];
        }
        up.0[a][RIGHT_HAND_SIDE] -= sum[18];
    }
}

/// Schur complement on the second predecessor: block (over, over) and the right-hand side.
#[inline(always)]
fn eliminate_into_second_predecessor(own: &BlockRow, over: &mut BlockRow) {
    for a in 0..9 {
        // Nine columns of the block (over), the right-hand side and two of padding.
        let mut sum = [0.0; 12];
        for k in 0..9 {
            let f = own.0[k][SECOND_PREDECESSOR + a];
            for c in 0..12 {
                sum[c] += f * own.0[k][SECOND_PREDECESSOR + c];
            }
        }
        for c in 0..9 {
            over.0[a][c] -= sum[c];
        }
        over.0[a][RIGHT_HAND_SIDE] -= sum[9];
    }
}

/// Solution at one section, given the solution at its predecessors, from its factorized block row.
#[inline(always)]
fn back_substitute_section(own: &BlockRow, up: &Vector9, over: &Vector9) -> Vector9 {
    let mut x = [0.0; 9];
    for k in (0..9).rev() {
        let row = &own.0[k];
        let mut sum = row[RIGHT_HAND_SIDE];
        for c in 0..9 {
            sum -= row[PREDECESSOR + c] * up[c] + row[SECOND_PREDECESSOR + c] * over[c];
        }
        for c in k + 1..9 {
            sum -= row[c] * x[c];
        }
        x[k] = sum / row[k];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of five sections with a branch of three at the third: A = B^T B + 1 with the block pattern of rods.
    #[test]
    fn branched_block_system_is_solved_exactly() {
        let predecessors: Vec<PrecedingSections> =
            vec![[NONE, NONE], [0, NONE], [1, 0], [2, 1], [3, 2], [2, NONE], [5, 2], [6, 5]];
        let n = predecessors.len();
        let mut draw = osier_base::rng::Rng::at(3, &["blocks".into()]);
        let mut rows = vec![BlockRow::default(); n];
        // Springs between all unknowns of neighbours: the matrix is positive definite for any stiffness.
        let mut dense = vec![vec![0.0; 9 * n]; 9 * n];
        for i in 0..n {
            for k in predecessors[i].into_iter().filter(|k| *k != NONE) {
                for a in 0..9 {
                    for b in 0..9 {
                        let (p, q, s) = (9 * i + a, 9 * k as usize + b, draw.range(0.1, 2.0));
                        dense[p][p] += s;
                        dense[q][q] += s;
                        dense[p][q] -= s;
                        dense[q][p] -= s;
                    }
                }
            }
        }
        (0..9 * n).for_each(|p| dense[p][p] += 1.0);
        let wanted: Vec<f64> = (0..9 * n).map(|_| draw.range(-1.0, 1.0)).collect();
        for i in 0..n {
            for a in 0..9 {
                let p = 9 * i + a;
                let mut line = |at: usize, k: usize| {
                    for b in 0..9 {
                        rows[i].0[a][at + b] = dense[p][9 * k + b];
                    }
                };
                line(0, i);
                predecessors[i]
                    .iter()
                    .enumerate()
                    .filter(|(_, k)| **k != NONE)
                    .for_each(|(w, k)| line(PREDECESSOR + 9 * w, *k as usize));
                rows[i].0[a][RIGHT_HAND_SIDE] = (0..9 * n).fold(0.0, |s, q| s + dense[p][q] * wanted[q]);
            }
        }
        let mut out = vec![[0.0; 9]; n];
        assert!(solve_block_system(&mut rows, &predecessors, &mut out));
        let worst = out.as_flattened().iter().zip(&wanted).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(worst < 1e-11, "{worst}");
        rows[2].0[0][0] = f64::NAN;
        assert!(!solve_block_system(&mut rows, &predecessors, &mut out), "what is no number is no pivot");
    }
}
