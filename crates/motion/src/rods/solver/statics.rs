//! Where rods hang still, the shape from which they do so as drawn, and their energy.

use crate::rods::prism::{Corners, dot};
use crate::rods::springs::{energy, spans};
use crate::rods::system::{Rods, minus};

/// Most rounds of Newton's method, and the change, in lengths of everything, that ends them.
const ROUNDS: usize = 600;
const STILL: f64 = 1e-10;
/// A round moves nothing by more than this share of the length of everything.
const STRIDE: f64 = 0.1;
/// Share of the error that a round of the search for the shape without load takes back, its rounds, and its end, m.
const SHARE: f64 = 0.7;
const SEARCH: usize = 20;
const NEAR: f64 = 1e-5;
/// Rounds of the search that does not wait for rest, and its end, m.
const BALANCE: usize = 300;
const EVEN: f64 = 1e-7;

impl Rods {
    /// Moves to where all forces balance, from where it is, with the forces from outside; velocities become zero.
    /// Returns whether it got there.
    /// Own: Newton's method with steps that never raise the energy.
    pub fn hang(&mut self) -> bool {
        let length = self.tree.spans.iter().fold(0.0, |s, r| s + r.length);
        self.v.iter_mut().for_each(|v| *v = [0.0; 9]);
        self.step.factors.fill(1.0);
        self.step.damping.fill(0.0);
        let mut still = false;
        for _ in 0..ROUNDS {
            let Some(most) = self.yielding() else { return false };
            self.stride((STRIDE * length / most.max(1e-300)).min(1.0));
            still = most < STILL * length;
            if still {
                break;
            }
        }
        self.restart();
        still
    }

    /// Fills `step.change` with how far everything gives way where it is, by its stiffness there, and returns the most of
    /// that, m; none for what has no stiffness.
    fn yielding(&mut self) -> Option<f64> {
        self.prepare(0.0);
        self.step.next.copy_from_slice(&self.x);
        self.step.speed.fill([0.0; 9]);
        self.assemble(true);
        for i in 0..self.x.len() {
            let back = self.manners[self.tree.sections[i].rod].recovery;
            let drawn = self.drawn_back(i);
            let right = std::array::from_fn(|k| self.step.force[i][k] + self.step.load[i][k] - back * drawn[k]);
            // A trace of mass keeps what hangs on a thread from being singular.
            self.add_mass(i, 1e-6, back);
            self.step.rows[i].set_right(&right);
        }
        self.clamp();
        if !self.solve() {
            return None;
        }
        let most = self.step.change.iter().flatten().fold(0.0_f64, |m, d| m.max(d.abs()));
        Some(most).filter(|m| m.is_finite())
    }

    /// Goes along the change, half as far until the energy does not rise.
    fn stride(&mut self, most: f64) {
        let from = self.x.clone();
        let start = self.standing();
        let mut share = most;
        for _ in 0..12 {
            for i in 0..from.len() {
                self.x[i] = std::array::from_fn(|k| from[i][k] + share * self.step.change[i][k]);
            }
            if self.standing() <= start + 1e-12 * start.abs() {
                return;
            }
            share *= 0.5;
        }
    }

    /// Energy of springs and of loads as they were prepared, J.
    fn standing(&self) -> f64 {
        let loads = self.x.iter().zip(&self.step.load).fold(0.0, |s, (x, f)| s + dot(x, f));
        self.stored() - loads
    }

    /// Energy of all springs, J.
    pub fn stored(&self) -> f64 {
        let mut sum = 0.0;
        for (i, s) in self.tree.sections.iter().enumerate() {
            let [up, over] = self.tree.neighbours(i, &self.x);
            sum += energy(&spans(&self.x[i], &up, &over), &s.k, &s.l);
            let away = minus(&self.x[i], &self.step.places[i]);
            sum += 0.5 * self.manners[s.rod].recovery * dot(&away, &self.massed(i, &away, true));
        }
        sum
    }

    /// Energy of motion, J.
    pub fn moving(&self) -> f64 {
        (0..self.x.len()).fold(0.0, |s, i| s + 0.5 * dot(&self.v[i], &self.massed(i, &self.v[i], false)))
    }

    /// Finds the shape without load from which the rods hang as they are drawn; false if none was found, and nothing is
    /// changed then. Own: fixed-point search, X <- X - 0.7 (x_eq(X) - drawn).
    pub fn prestress(&mut self) -> bool {
        let drawn = self.tree.drawn.clone();
        let mut shape = drawn.clone();
        for _ in 0..SEARCH {
            self.shape(&shape);
            self.x.copy_from_slice(&drawn);
            if !self.hang() {
                break;
            }
            let error = self.x.iter().zip(&drawn).map(|(a, b)| minus(a, b)).collect::<Vec<Corners>>();
            if error.iter().flatten().all(|e| e.abs() < NEAR) {
                self.x.copy_from_slice(&drawn);
                return true;
            }
            for (x, e) in shape.iter_mut().zip(&error) {
                (0..9).for_each(|k| x[k] -= SHARE * e[k]);
            }
        }
        self.shape(&drawn);
        self.x.copy_from_slice(&drawn);
        false
    }

    /// The same as [`Rods::prestress`] for many rods: a round asks how far the drawn pose gives way, not where it would come
    /// to rest. Own.
    pub fn balance(&mut self) -> bool {
        let drawn = self.tree.drawn.clone();
        let mut shape = drawn.clone();
        self.x.copy_from_slice(&drawn);
        self.v.fill([0.0; 9]);
        self.step.factors.fill(1.0);
        self.step.damping.fill(0.0);
        let mut least = f64::MAX;
        for _ in 0..BALANCE {
            self.shape(&shape);
            let Some(most) = self.yielding() else { break };
            if most < EVEN {
                self.restart();
                return true;
            }
            if most > 100.0 * least {
                break;
            }
            least = least.min(most);
            for (x, e) in shape.iter_mut().zip(&self.step.change) {
                (0..9).for_each(|k| x[k] -= SHARE * e[k]);
            }
        }
        self.shape(&drawn);
        self.restart();
        false
    }

    /// Makes these corners the shape without load.
    fn shape(&mut self, x: &[Corners]) {
        self.tree.rest(x);
        self.settle_home(x);
    }
}
