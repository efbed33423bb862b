//! Static equilibrium, rest shapes whose equilibrium is the reference shape, and energies.

use crate::rods::prism::{Vector9, corner_dot};
use crate::rods::springs::{section_spring_energy, spring_vectors};
use crate::rods::system::{RodSystem, subtract_corners};
use crate::rods::tuning::{
    EQUILIBRIUM_TOLERANCE, MAX_EQUILIBRIUM_ITERATIONS, MAX_EQUILIBRIUM_SOLVES, MAX_NEWTON_STEP,
    MAX_RESIDUAL_ITERATIONS, RESIDUAL_TOLERANCE, REST_SHAPE_RELAXATION, REST_SHAPE_TOLERANCE,
};

impl RodSystem {
    /// Moves from the present shape to static equilibrium with the external forces; velocities become zero. Returns
    /// whether it converged.
    /// Own: Newton's method with steps that never raise the energy.
    pub fn solve_equilibrium(&mut self) -> bool {
        let length = self.tree.rods.iter().fold(0.0, |s, r| s + r.length);
        self.v.iter_mut().for_each(|v| *v = [0.0; 9]);
        self.step.factors.fill(1.0);
        self.step.damping.fill(0.0);
        let mut converged = false;
        for _ in 0..MAX_EQUILIBRIUM_ITERATIONS {
            // Newton step on the equilibrium K dx = f(x), cut to a share of the total length so that large rotations stay
            // within reach of the linearisation, then shortened until the energy does not rise.
            let Some(largest) = self.compute_newton_displacement() else { return false };
            self.line_search((MAX_NEWTON_STEP * length / largest.max(1e-300)).min(1.0));
            converged = largest < EQUILIBRIUM_TOLERANCE * length;
            if converged {
                break;
            }
        }
        self.reset_history();
        converged
    }

    /// Fills `step.change` with the Newton displacement K^-1 f at the present shape and returns its largest component,
    /// m; `None` if the stiffness is singular.
    fn compute_newton_displacement(&mut self) -> Option<f64> {
        self.prepare_step(0.0);
        self.step.next.copy_from_slice(&self.x);
        self.step.speed.fill([0.0; 9]);
        self.assemble_springs(true);
        for i in 0..self.x.len() {
            let back = self.dampings[self.tree.sections[i].rod].recovery;
            let displacement = self.mass_times_rest_offset(i);
            let right = std::array::from_fn(|k| self.step.force[i][k] + self.step.load[i][k] - back * displacement[k]);
            // Regularization: a very small mass keeps mechanisms, such as a rod on a slack thread, from being singular.
            self.add_section_mass_to_block(i, 1e-6, back);
            self.step.rows[i].set_right_hand_side(&right);
        }
        self.add_clamp_penalties_to_rows();
        if !self.solve_newton_update() {
            return None;
        }
        let largest = self.step.change.iter().flatten().fold(0.0_f64, |m, d| m.max(d.abs()));
        Some(largest).filter(|m| m.is_finite())
    }

    /// Moves along `step.change` by at most the share `max_share`, which is halved until the potential energy does not
    /// rise.
    fn line_search(&mut self, max_share: f64) {
        let from = self.x.clone();
        let start = self.potential_energy();
        let mut share = max_share;
        for _ in 0..12 {
            for i in 0..from.len() {
                self.x[i] = std::array::from_fn(|k| from[i][k] + share * self.step.change[i][k]);
            }
            if self.potential_energy() <= start + 1e-12 * start.abs() {
                return;
            }
            share *= 0.5;
        }
    }

    /// Potential energy of springs and prepared loads, J.
    fn potential_energy(&self) -> f64 {
        // Potential energy = elastic energy - f . x for loads that do not depend on the position.
        let loads = self.x.iter().zip(&self.step.load).fold(0.0, |s, (x, f)| s + corner_dot(x, f));
        self.elastic_energy() - loads
    }

    /// Elastic energy of springs and restoring springs in the present shape, J.
    pub fn elastic_energy(&self) -> f64 {
        let mut sum = 0.0;
        for (i, s) in self.tree.sections.iter().enumerate() {
            let [up, over] = self.tree.predecessor_corner_positions(i, &self.x);
            sum += section_spring_energy(&spring_vectors(&self.x[i], &up, &over), &s.stiffness, &s.rest_lengths);
            let away = subtract_corners(&self.x[i], &self.step.places[i]);
            sum += 0.5 * self.dampings[s.rod].recovery * corner_dot(&away, &self.apply_mass(i, &away, true));
        }
        sum
    }

    /// Kinetic energy of all sections and attached bodies, J.
    pub fn kinetic_energy(&self) -> f64 {
        (0..self.x.len()).fold(0.0, |s, i| s + 0.5 * corner_dot(&self.v[i], &self.apply_mass(i, &self.v[i], false)))
    }

    /// Finds the stress-free shape whose equilibrium under load is the reference shape; false, with nothing changed,
    /// if the search does not converge.
    /// Own: fixed-point search, X <- X - 0.7 (x_eq(X) - reference).
    pub fn find_rest_shape_by_equilibrium(&mut self) -> bool {
        let reference = self.tree.reference.clone();
        let mut shape = reference.clone();
        // Fixed point for the rest shape X: with springs relaxed at X the rods sag to x_eq(X). X is moved against a damped share
        // of the error x_eq - reference, until the sagged shape is the reference shape.
        for _ in 0..MAX_EQUILIBRIUM_SOLVES {
            self.set_rest_shape(&shape);
            self.x.copy_from_slice(&reference);
            if !self.solve_equilibrium() {
                break;
            }
            let error = self.x.iter().zip(&reference).map(|(a, b)| subtract_corners(a, b)).collect::<Vec<Vector9>>();
            if error.iter().flatten().all(|e| e.abs() < REST_SHAPE_TOLERANCE) {
                self.x.copy_from_slice(&reference);
                return true;
            }
            for (x, e) in shape.iter_mut().zip(&error) {
                (0..9).for_each(|k| x[k] -= REST_SHAPE_RELAXATION * e[k]);
            }
        }
        self.set_rest_shape(&reference);
        self.x.copy_from_slice(&reference);
        false
    }

    /// As [`RodSystem::find_rest_shape_by_equilibrium`], but cheaper for many rods: an iteration takes one Newton
    /// displacement at the reference shape in place of an equilibrium. Own.
    pub fn find_rest_shape_by_residual(&mut self) -> bool {
        let reference = self.tree.reference.clone();
        let mut shape = reference.clone();
        self.x.copy_from_slice(&reference);
        self.v.fill([0.0; 9]);
        self.step.factors.fill(1.0);
        self.step.damping.fill(0.0);
        let mut least = f64::MAX;
        for _ in 0..MAX_RESIDUAL_ITERATIONS {
            self.set_rest_shape(&shape);
            let Some(largest) = self.compute_newton_displacement() else { break };
            if largest < RESIDUAL_TOLERANCE {
                self.reset_history();
                return true;
            }
            // The residual grows again: the plant cannot carry its weight in the reference shape.
            if largest > 100.0 * least {
                break;
            }
            least = least.min(largest);
            for (x, e) in shape.iter_mut().zip(&self.step.change) {
                (0..9).for_each(|k| x[k] -= REST_SHAPE_RELAXATION * e[k]);
            }
        }
        self.set_rest_shape(&reference);
        self.reset_history();
        false
    }

    /// Makes `x` both the stress-free shape of the springs and the rest positions of the restoring springs.
    fn set_rest_shape(&mut self, x: &[Vector9]) {
        self.tree.set_rest_lengths(x);
        self.store_rest_positions(x);
    }
}
