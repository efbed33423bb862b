//! The default integrator: BDF2 with Newton's method on the whole system.

use crate::rods::prism::Vector9;
use crate::rods::system::{RodSystem, SolverBuffers, subtract_corners};
use crate::rods::tuning::{DIVERGENCE_LENGTHS, MAX_STEP_ITERATIONS, NEWTON_TOLERANCE};

/// Share of an impulse that acts in a first (implicit Euler) step; the BDF2 steps that follow add the remaining third
/// of its momentum.
const FIRST_STEP_IMPULSE_SHARE: f64 = 2.0 / 3.0;

/// A step failed: the system was not positive definite, not finite, or diverged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepFailed;

impl RodSystem {
    /// Advances by `h` seconds; on failure positions and velocities stay as before.
    /// Source: springs as constraints of compliance 1/k of [yang-wu]'s network, solved directly; Own: BDF2 in time,
    /// damping a M + b K, Newton's method with a stiffness that is never indefinite.
    /// # Errors
    /// [`StepFailed`] if a value is not finite, leaves the divergence limit, or if Newton updates grow three times
    /// running.
    pub fn step_implicit(&mut self, h: f64) -> Result<(), StepFailed> {
        let ht = if self.history_reset { h } else { 2.0 * h / 3.0 };
        // An impulse J enters a first (Euler) step as 2/3 J/h: the BDF2 steps that follow carry the rest of it, so that
        // the momentum gained in the end is J.
        self.share = if self.history_reset { FIRST_STEP_IMPULSE_SHARE } else { 1.0 };
        self.prepare_step(h);
        // Rayleigh damping D = a M + b K. Its stiffness part scales the tangent stiffness by 1 + b/ht, since
        // v = dx/ht + const within the step.
        for (rod, m) in self.dampings.iter().enumerate() {
            self.step.damping[rod] = m.stiffness;
            self.step.factors[rod] = 1.0 + m.stiffness / ht;
        }
        self.step.next.copy_from_slice(&self.x);
        self.step.moved.fill([0.0; 9]);
        let tolerance = NEWTON_TOLERANCE * self.shortest_interval();
        let (mut previous_update, mut growing) = (f64::MAX, 0);
        // Newton: solve J dx = r at the current iterate, update, and stop once no corner moves by more than the
        // tolerance. Updates that grow three times running, or corners beyond the divergence limit, fail the step.
        for _ in 0..MAX_STEP_ITERATIONS {
            self.assemble_newton_system(ht);
            if !self.solve_newton_update() {
                return Err(StepFailed);
            }
            let mut largest_update = 0.0_f64;
            let SolverBuffers { next, moved, change, .. } = &mut self.step;
            for (((next, moved), d), x) in next.iter_mut().zip(moved).zip(change).zip(&self.x) {
                for k in 0..9 {
                    moved[k] += d[k];
                    next[k] = x[k] + moved[k];
                    largest_update = largest_update.max(d[k].abs());
                }
            }
            growing = if largest_update > previous_update { growing + 1 } else { 0 };
            let far = self.step.next.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
            if !largest_update.is_finite() || growing >= 3 || far > self.divergence_limit {
                return Err(StepFailed);
            }
            previous_update = largest_update;
            if largest_update < tolerance {
                break;
            }
        }
        self.accept_step(ht);
        Ok(())
    }

    /// [M (1/ht^2 + a/ht) + (1 + b/ht) K] dx = -M (x - xhat)/ht^2 + S(x) - (a M + b K) v(x), at `step.next`.
    fn assemble_newton_system(&mut self, ht: f64) {
        let inverse = 1.0 / ht;
        let [now, then] = self.bdf2_weights();
        for i in 0..self.x.len() {
            self.step.speed[i] = self.velocity_of_step(i, inverse);
        }
        // Spring forces S(x) with stiffness damping, and the blocks (1 + b/ht) K of the tangent stiffness.
        self.assemble_springs(true);
        for i in 0..self.x.len() {
            let m = self.dampings[self.tree.sections[i].rod];
            let back = m.recovery;
            // Inertia: -M (v - v_hat) / ht, v_hat the BDF2 combination of the last two velocities.
            let mut all = [0.0; 9];
            for k in 0..9 {
                let predicted = now * self.v[i][k] - then * self.before[1][i][k];
                all[k] = (predicted - self.step.speed[i][k]) * inverse;
            }
            // Restoring force and damping of the mass of the plant: -M_own [k (x - x_rest) + (a + b k) v], k the recovery
            // per mass; bodies that do not belong to the plant have inertia only.
            let away = subtract_corners(&self.step.next[i], &self.step.places[i]);
            let own: [f64; 9] =
                std::array::from_fn(|k| -back * away[k] - (m.mass + m.stiffness * back) * self.step.speed[i][k]);
            let (all, own) = (self.apply_mass(i, &all, false), self.apply_mass(i, &own, true));
            let right = std::array::from_fn(|k| all[k] + own[k] + self.step.force[i][k] + self.step.load[i][k]);
            // Diagonal block: M / ht^2 + M_own [a / ht + k (1 + b / ht)], the derivative of the right-hand side above.
            self.add_section_mass_to_block(
                i,
                inverse * inverse,
                m.mass * inverse + back * (1.0 + m.stiffness * inverse),
            );
            self.step.rows[i].set_right_hand_side(&right);
        }
        self.add_clamp_penalties_to_rows();
    }

    /// Weights of the present and the preceding state in the BDF2 formula. A first step is implicit Euler (weights 1, 0), whose
    /// error is that of a single step. If a state before the start were assumed instead, velocities would lag by a third of a
    /// step for ever.
    fn bdf2_weights(&self) -> [f64; 2] {
        if self.history_reset { [1.0, 0.0] } else { [4.0 / 3.0, 1.0 / 3.0] }
    }

    /// BDF2 velocity of section `i` at the iterate, v = (x - 4/3 x_n + 1/3 x_(n-1)) / ht with ht = 2h/3; implicit Euler in a first
    /// step. It is computed from displacements, d - 1/3 d_n: differences of positions, which lie far from the origin, would lose
    /// the digits of small ones.
    fn velocity_of_step(&self, i: usize, inverse: f64) -> Vector9 {
        let [_, then] = self.bdf2_weights();
        std::array::from_fn(|k| (self.step.moved[i][k] - then * self.before[0][i][k]) * inverse)
    }

    fn accept_step(&mut self, ht: f64) {
        let inverse = 1.0 / ht;
        // Shift the history: the new velocity is that of the last iterate.
        for i in 0..self.x.len() {
            let v = self.velocity_of_step(i, inverse);
            (self.before[0][i], self.x[i]) = (self.step.moved[i], self.step.next[i]);
            (self.before[1][i], self.v[i]) = (self.v[i], v);
        }
        self.history_reset = false;
    }

    /// Invalidates the BDF2 history, so that the next step is implicit Euler; needed at jumps and where the step length changes.
    pub fn reset_history(&mut self) {
        self.history_reset = true;
    }

    /// Length of the shortest interval of all rods, m.
    fn shortest_interval(&self) -> f64 {
        self.tree.rods.iter().flat_map(|s| &s.intervals).fold(f64::MAX, |m, l| m.min(l.length))
    }

    /// Distance from the origin, m, beyond which the motion counts as diverged.
    pub(crate) fn divergence_radius(&self) -> f64 {
        let length = self.tree.rods.iter().fold(0.0, |s, r| s + r.length);
        let far = self.x.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        far + DIVERGENCE_LENGTHS * length
    }
}
