//! Linear systems over the sections of a plant: blocks of nine, eliminated from the tips to the roots.

use pulp::{Arch, NullaryFnOnce};

use crate::rods::prism::Corners;
use osier_scene::plant::NONE;

/// Numbers of a row: own block, block to the section above, block to the one above that, right side, room.
pub(crate) const ROW: usize = 32;
/// Where in a row the blocks and the right side begin.
pub(crate) const UP: usize = 9;
pub(crate) const OVER: usize = 18;
pub(crate) const RIGHT: usize = 27;

/// The nine rows of a section.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Rows(pub [[f64; ROW]; 9]);

impl Default for Rows {
    fn default() -> Self {
        Self([[0.0; ROW]; 9])
    }
}

impl Rows {
    /// The right side.
    pub(crate) fn set_right(&mut self, r: &Corners) {
        for k in 0..9 {
            self.0[k][RIGHT] = r[k];
        }
    }

    /// Largest number on the diagonal.
    pub(crate) fn peak(&self) -> f64 {
        (0..9).fold(0.0, |m, k| self.0[k][k].max(m))
    }
}

/// The section above, and the one above that, or [`NONE`]; both have lower indices.
pub(crate) type Above = [u32; 2];

/// Solves a symmetric positive system in place. `above[i][1]` is what `above[above[i][0]][0]` is: then nothing fills in.
/// Returns whether all pivots were positive; `out` holds the solution.
/// Own: block Cholesky in elimination-tree order; a section is coupled to two others only.
pub(crate) fn solve(rows: &mut [Rows], above: &[Above], out: &mut [Corners]) -> bool {
    Arch::new().dispatch(Elimination { rows, above, out })
}

struct Elimination<'a> {
    rows: &'a mut [Rows],
    above: &'a [Above],
    out: &'a mut [Corners],
}

impl NullaryFnOnce for Elimination<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { rows, above, out } = self;
        for i in (0..rows.len()).rev() {
            let (before, rest) = rows.split_at_mut(i);
            let own = &mut rest[0];
            if !factor(own) {
                return false;
            }
            let [up, over] = above[i];
            if up != NONE {
                take_up(own, &mut before[up as usize]);
            }
            if over != NONE {
                take_over(own, &mut before[over as usize]);
            }
        }
        for i in 0..rows.len() {
            let [up, over] = above[i].map(|k| if k == NONE { [0.0; 9] } else { out[k as usize] });
            out[i] = back(&rows[i], &up, &over);
        }
        true
    }
}

/// Rows of A become rows of U with A = U^T U; the rest of the rows is divided by U^T on the way.
#[inline(always)]
fn factor(own: &mut Rows) -> bool {
    for k in 0..9 {
        let pivot = own.0[k][k];
        if pivot <= 0.0 || pivot.is_nan() {
            return false;
        }
        let scale = 1.0 / pivot.sqrt();
        for v in &mut own.0[k] {
            *v *= scale;
        }
        let row = own.0[k];
        for j in k + 1..9 {
            let f = row[j];
            for c in 0..ROW {
                own.0[j][c] -= f * row[c];
            }
        }
    }
    true
}

/// What eliminating a section leaves on the one above: blocks (up, up) and (up, over), and its right side.
#[inline(always)]
fn take_up(own: &Rows, up: &mut Rows) {
    for a in 0..9 {
        let mut sum = [0.0; 20];
        for k in 0..9 {
            let f = own.0[k][UP + a];
            for c in 0..20 {
                sum[c] += f * own.0[k][UP + c];
            }
        }
        for c in 0..18 {
            up.0[a][c] -= sum[c];
        }
        up.0[a][RIGHT] -= sum[18];
    }
}

/// The same on the one above that: block (over, over).
#[inline(always)]
fn take_over(own: &Rows, over: &mut Rows) {
    for a in 0..9 {
        let mut sum = [0.0; 12];
        for k in 0..9 {
            let f = own.0[k][OVER + a];
            for c in 0..12 {
                sum[c] += f * own.0[k][OVER + c];
            }
        }
        for c in 0..9 {
            over.0[a][c] -= sum[c];
        }
        over.0[a][RIGHT] -= sum[9];
    }
}

/// The unknowns of a section, once those above are known.
#[inline(always)]
fn back(own: &Rows, up: &Corners, over: &Corners) -> Corners {
    let mut x = [0.0; 9];
    for k in (0..9).rev() {
        let row = &own.0[k];
        let mut sum = row[RIGHT];
        for c in 0..9 {
            sum -= row[UP + c] * up[c] + row[OVER + c] * over[c];
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

    /// A chain of five with a branch of three at its third: A = B^T B + 1 with the pattern of rods.
    #[test]
    fn a_branched_system_is_solved_and_the_rest_of_it_is_what_was_asked() {
        let above: Vec<Above> = vec![[NONE, NONE], [0, NONE], [1, 0], [2, 1], [3, 2], [2, NONE], [5, 2], [6, 5]];
        let n = above.len();
        let mut draw = osier_base::rng::Rng::at(3, &["blocks".into()]);
        let mut rows = vec![Rows::default(); n];
        // Springs between all unknowns of neighbours: positive whatever their strengths.
        let mut dense = vec![vec![0.0; 9 * n]; 9 * n];
        for i in 0..n {
            for k in above[i].into_iter().filter(|k| *k != NONE) {
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
                above[i]
                    .iter()
                    .enumerate()
                    .filter(|(_, k)| **k != NONE)
                    .for_each(|(w, k)| line(UP + 9 * w, *k as usize));
                rows[i].0[a][RIGHT] = (0..9 * n).fold(0.0, |s, q| s + dense[p][q] * wanted[q]);
            }
        }
        let mut out = vec![[0.0; 9]; n];
        assert!(solve(&mut rows, &above, &mut out));
        let worst = out.as_flattened().iter().zip(&wanted).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(worst < 1e-11, "{worst}");
        rows[2].0[0][0] = f64::NAN;
        assert!(!solve(&mut rows, &above, &mut out), "what is no number is no pivot");
    }
}
