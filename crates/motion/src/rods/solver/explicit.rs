//! Integrators for comparison with the literature: symplectic and explicit Euler, and XPBD by single Gauss-Seidel
//! passes.

use crate::rods::StepFailed;
use crate::rods::prism::{
    CornerRigidMotion, SectionFrame, Vector9, add_to_corner, corner, corner_dot, transposed_matrix_vector,
};
use crate::rods::springs::{FIRST_BEND_SPRING, FIRST_LINK_SPRING, SPRINGS_PER_SECTION};
use crate::rods::system::RodSystem;
use osier_base::math;
use osier_scene::plant::NONE;

/// Largest k h^2 / m at which one Gauss-Seidel pass per step still carries a rod's weight.
pub const MAX_GAUSS_SEIDEL_STIFFNESS: f64 = 10.0;

#[derive(Debug, Clone, Copy)]
struct SpringEnds {
    /// Corner of the section that has the spring, 0 to 2.
    corner: usize,
    /// Predecessor at the far end: 0 the section before, 1 the one before that; `None` for the section itself.
    predecessor: Option<usize>,
    /// Corner, 0 to 2, at which the spring ends on the far section.
    far_corner: usize,
}

impl RodSystem {
    /// Computes accelerations `step.change`, m/s^2, from springs and loads at the present positions, without damping.
    fn compute_undamped_accelerations(&mut self, h: f64) {
        self.share = 1.0;
        self.prepare_step(h);
        let Self { x, v, step, .. } = self;
        step.next.copy_from_slice(x);
        step.speed.copy_from_slice(v);
        step.damping.fill(0.0);
        self.assemble_springs(false);
        for i in 0..self.x.len() {
            let back = self.dampings[self.tree.sections[i].rod].recovery;
            let displacement = self.mass_times_rest_offset(i);
            let f = std::array::from_fn(|k| self.step.force[i][k] + self.step.load[i][k] - back * displacement[k]);
            self.step.change[i] = self.apply_inverse_mass(i, &f);
        }
    }

    /// Mass damping coefficient, 1/s, of section `i` in the explicit integrators. It is twice that of the implicit integrator, in
    /// which the stiffness part provides half of the damping.
    pub(crate) fn explicit_mass_damping(&self, i: usize) -> f64 {
        2.0 * self.dampings[self.tree.sections[i].rod].mass
    }

    /// Symplectic Euler: v = (v + h F/m) / (1 + a h), then x = x + h v; stable for h < 2 / w_max.
    pub fn step_symplectic_euler(&mut self, h: f64) {
        self.compute_undamped_accelerations(h);
        for i in 0..self.x.len() {
            let a = self.explicit_mass_damping(i);
            for k in 0..9 {
                self.v[i][k] = (self.v[i][k] + h * self.step.change[i][k]) / (1.0 + a * h);
            }
        }
        self.set_clamp_velocities(h);
        for i in 0..self.x.len() {
            (0..9).for_each(|k| self.x[i][k] += h * self.v[i][k]);
        }
    }

    /// Explicit Euler of [yang-wu]: x = x + h v with the velocity before the step; stable only for h <= a / w_max^2,
    /// never without damping.
    pub fn step_forward_euler(&mut self, h: f64) {
        self.compute_undamped_accelerations(h);
        let mut to: Vec<Vector9> = self.x.clone();
        for i in 0..self.x.len() {
            let a = self.explicit_mass_damping(i);
            for k in 0..9 {
                to[i][k] += h * self.v[i][k];
                self.v[i][k] += h * (self.step.change[i][k] - a * self.v[i][k]);
            }
        }
        self.set_clamp_velocities(h);
        // Clamped sections follow their corrected velocity, so that they reach their targets in this step.
        for clamp in 0..self.clamps.len() {
            let i = self.clamps[clamp].section;
            to[i] = std::array::from_fn(|k| self.x[i][k] + h * self.v[i][k]);
        }
        self.x = to;
    }

    /// Upper bound of the highest angular frequency, rad/s: w^2 <= max 2 sum(k) / m.
    /// Source: Gershgorin's circles.
    pub fn max_angular_frequency_bound(&mut self) -> f64 {
        self.update_section_masses();
        let mut sums = vec![[0.0; 3]; self.x.len()];
        // Sum the stiffness of all springs at each corner; those of a section also end at its predecessors.
        for (i, s) in self.tree.sections.iter().enumerate() {
            let [up, over] = self.tree.predecessors[i];
            for c in 0..3 {
                sums[i][c] += s.stiffness[c] + s.stiffness[FIRST_BEND_SPRING + c];
                sums[i][(c + 1) % 3] += s.stiffness[c];
                if over != NONE {
                    sums[over as usize][c] += s.stiffness[FIRST_BEND_SPRING + c];
                }
                for o in 0..3 {
                    sums[i][c] += s.stiffness[FIRST_LINK_SPRING + 3 * c + o];
                    if up != NONE {
                        sums[up as usize][o] += s.stiffness[FIRST_LINK_SPRING + 3 * c + o];
                    }
                }
            }
        }
        // Gershgorin: each row of M^-1 K sums to at most 2 sum(k)/m, plus the restoring springs.
        let bound = |(i, k): (usize, &[f64; 3])| {
            let back = self.dampings[self.tree.sections[i].rod].recovery;
            2.0 * k.iter().fold(0.0_f64, |m, k| m.max(*k)) / self.tree.sections[i].mass + back
        };
        math::sqrt(sums.iter().enumerate().map(bound).fold(0.0, f64::max))
    }

    /// One XPBD step with a single Gauss-Seidel pass over the springs: converges for soft ropes only.
    /// Source: M. Macklin et al., "XPBD", 2016, with the springs of [yang-wu] as constraints.
    /// # Errors
    /// [`StepFailed`] if a coordinate is not finite.
    pub fn step_gauss_seidel(&mut self, h: f64) -> Result<(), StepFailed> {
        self.share = 1.0;
        self.prepare_step(h);
        // Predict velocities and positions from external loads, with implicit mass damping.
        for i in 0..self.x.len() {
            let m = self.dampings[self.tree.sections[i].rod];
            let response = self.apply_inverse_mass(i, &self.step.load[i]);
            for k in 0..9 {
                self.v[i][k] = (self.v[i][k] + h * response[k]) / (1.0 + 2.0 * m.mass * h);
            }
        }
        self.set_clamp_velocities(h);
        for i in 0..self.x.len() {
            self.step.next[i] = std::array::from_fn(|k| self.x[i][k] + h * self.v[i][k]);
        }
        for i in 0..self.x.len() {
            // Project spring after spring; the last lane is padding without stiffness.
            for lane in 0..SPRINGS_PER_SECTION - 1 {
                self.project_spring_xpbd(i, lane, h);
            }
            self.project_restoring_spring(i, h);
        }
        for i in 0..self.x.len() {
            for k in 0..9 {
                // Velocities follow from the projected positions.
                self.v[i][k] = (self.step.next[i][k] - self.x[i][k]) / h;
            }
        }
        self.set_clamp_velocities(h);
        for i in 0..self.x.len() {
            for k in 0..9 {
                self.x[i][k] += h * self.v[i][k];
                if !self.x[i][k].is_finite() {
                    return Err(StepFailed);
                }
            }
        }
        Ok(())
    }

    /// The ends of the spring in `lane`, 0 to 14, of a section.
    fn spring_ends(lane: usize) -> SpringEnds {
        // Springs of the triangle itself come first, then those between all corners of it and of the section before, then those
        // across two intervals, which resist bending.
        let (corner, predecessor, far_corner) = match lane {
            0..FIRST_LINK_SPRING => (lane, None, (lane + 1) % 3),
            FIRST_LINK_SPRING..FIRST_BEND_SPRING => {
                ((lane - FIRST_LINK_SPRING) / 3, Some(0), (lane - FIRST_LINK_SPRING) % 3)
            }
            _ => ((lane - FIRST_BEND_SPRING) % 3, Some(1), (lane - FIRST_BEND_SPRING) % 3),
        };
        SpringEnds { corner, predecessor, far_corner }
    }

    /// XPBD projection of one spring: moves both of its ends. `i`: section; `lane`: spring of the section; `h`: step,
    /// s.
    fn project_spring_xpbd(&mut self, i: usize, lane: usize, h: f64) {
        let section = &self.tree.sections[i];
        let (k, rest) = (section.stiffness[lane], section.rest_lengths[lane]);
        if k <= 0.0 {
            return;
        }
        let SpringEnds { corner: c, predecessor, far_corner: o } = Self::spring_ends(lane);
        let (on, base) = match predecessor {
            None => (i, NONE),
            Some(which) => (self.tree.predecessors[i][which] as usize, section.base[which]),
        };
        let held =
            |i: usize| self.clamps.iter().any(|k| k.section == i && k.hold == crate::rods::system::SupportKind::Fixed);
        let inverse_mass = |i: usize| if held(i) { 0.0 } else { 1.0 / self.tree.sections[i].mass };
        let here = corner(&self.step.next[i], c);
        // An attached base has the position and Jacobian that follow from the present iterate of the section that carries it.
        let rider = (base != NONE).then(|| {
            let b = &self.tree.bases[base as usize];
            let x = SectionFrame::from_corners(&self.step.next[on]).local_positions_to_world(&b.local);
            (CornerRigidMotion::from_corners(&self.step.next[on]).attachment_jacobian(&x), x)
        });
        let there = rider.as_ref().map_or_else(|| corner(&self.step.next[on], o), |(_, x)| corner(x, o));
        let d = there - here;
        let length = d.length();
        if length < 1e-30 {
            return;
        }
        let e = d / length;
        // XPBD correction: lambda = (|d| - L0) / (w_a + w_b + alpha), compliance alpha = 1/(k h^2); an attached base
        // maps its share onto its section by J^T.
        let mut pull = [0.0; 9];
        add_to_corner(&mut pull, o, e);
        let pull = rider.map_or(pull, |(j, _)| transposed_matrix_vector(&j, &pull));
        let (a, b) = (inverse_mass(i), inverse_mass(on) * corner_dot(&pull, &pull));
        let f = (length - rest) / (a + b + 1.0 / (k * h * h));
        add_to_corner(&mut self.step.next[i], c, e * (f * a));
        let by = inverse_mass(on) * f;
        (0..9).for_each(|k| self.step.next[on][k] -= by * pull[k]);
    }

    /// XPBD projection of a section towards its rest position. The stiffness is k times the mass, so that the section moves by
    /// the share k h^2 / (1 + k h^2).
    fn project_restoring_spring(&mut self, i: usize, h: f64) {
        let back = self.dampings[self.tree.sections[i].rod].recovery * h * h;
        let share = back / (1.0 + back);
        for k in 0..9 {
            self.step.next[i][k] += share * (self.step.places[i][k] - self.step.next[i][k]);
        }
    }

    /// Largest k h^2 / m of all springs in a step of `h` seconds; above [`MAX_GAUSS_SEIDEL_STIFFNESS`] a single pass per step
    /// lets a rod sag.
    pub fn max_step_stiffness_ratio(&self, h: f64) -> f64 {
        let one = |s: &crate::rods::layout::SectionProperties| {
            s.stiffness.iter().fold(0.0_f64, |m, k| m.max(*k)) * h * h / s.mass
        };
        self.tree.sections.iter().map(one).fold(0.0, f64::max)
    }
}
