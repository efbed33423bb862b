//! Fundamental frequency of each rod, and the Rayleigh damping that follows from it.

use crate::rods::system::{RodModalParams, RodSystem};
use osier_base::math;

/// Mass of a section and its attached bodies, kg, with the first and second moment along the rod about the section, kg
/// m and kg m^2.
#[derive(Debug, Clone, Copy, Default)]
struct MassMoments {
    mass: f64,
    first: f64,
    second: f64,
}

impl RodSystem {
    /// Recomputes frequencies and damping coefficients of all rods; to be called after bodies were added.
    pub(crate) fn update_damping(&mut self) {
        let lumps = self.lumped_mass_moments();
        for rod in 0..self.dampings.len() {
            let material = self.tree.rods[rod].material;
            let hertz = self.estimate_rod_hz(rod, &lumps);
            let anchored = self.is_anchored(rod);
            let recovery = if anchored { material.recovery } else { 0.0 };
            // Rayleigh damping with equal mass and stiffness parts at the fundamental w: a = zeta w, b = zeta / w, so that
            // (a / w + b w) / 2 = zeta.
            let swing = std::f64::consts::TAU * hertz;
            let w = swing * math::sqrt(1.0 + recovery);
            // A free-floating rod: mass damping would brake its flight, so that only the stiffness part damps bending.
            let (mass, stiffness) = if anchored {
                (material.damping_ratio * w, material.damping_ratio / w)
            } else {
                (0.0, 2.0 * material.damping_ratio / w)
            };
            self.dampings[rod] = RodModalParams { hertz, recovery: recovery * swing * swing, mass, stiffness };
        }
        self.divergence_limit = self.divergence_radius();
    }

    /// Lumped mass of each section with the bodies of the plant, and with the child rods that it carries.
    fn lumped_mass_moments(&self) -> Vec<MassMoments> {
        let mut lumps: Vec<MassMoments> =
            self.tree.sections.iter().map(|s| MassMoments { mass: 3.0 * s.mass, ..MassMoments::default() }).collect();
        // Bodies of the plant count; foreign ones (water, weights) must not change the damping of the wood.
        for body in self.bodies.iter().filter(|b| b.of_plant) {
            let (lump, lever) = (&mut lumps[body.section], body.at.z);
            lump.mass += body.mass;
            lump.first += body.mass * lever;
            let about = body.inertia.x_axis.x + body.inertia.y_axis.y;
            lump.second += body.mass * lever * lever + 0.5 * about;
        }
        // Children come after their parents: from the last rod to the first, add the total mass of each rod to the section
        // that carries it.
        for span in self.tree.rods.iter().rev() {
            if let Some(base) = span.base {
                let sum = span.sections.clone().fold(0.0, |s, i| s + lumps[i].mass);
                lumps[self.tree.bases[base].on as usize].mass += sum;
            }
        }
        lumps
    }

    /// Fundamental frequency of a rod, Hz: of an anchored rod from its static deflection under lateral gravity, of a
    /// free one as a beam pinned at both ends.
    /// Source: Rayleigh's quotient w^2 = g sum(m y) / sum(m y^2); [yang-wu] eq. 1 for the deflection.
    fn estimate_rod_hz(&self, rod: usize, lumps: &[MassMoments]) -> f64 {
        let span = &self.tree.rods[rod];
        let n = span.intervals.len();
        if !self.is_anchored(rod) {
            let total = span.sections.clone().fold(0.0, |s, i| s + lumps[i].mass);
            let mean = span.intervals.iter().fold(0.0, |s, l| s + l.bending_rigidity()) / n as f64;
            // Pinned at both ends: w = (pi / L)^2 sqrt(EI L / m).
            let k = std::f64::consts::PI / span.length;
            return k * k * math::sqrt(mean * span.length / total) / std::f64::consts::TAU;
        }
        // The mass of an attached base belongs to the parent rod.
        let first = n + 1 - span.sections.len();
        let lump = |j: usize| if j < first { MassMoments::default() } else { lumps[span.sections.start + j - first] };
        let at = self.clamped_section_of_rod(rod).map_or(0, |i| i - span.sections.start);
        let (mut top, mut bottom) = (0.0, 0.0);
        // Both sides of the clamp are cantilevers; numerator and denominator of the quotient add up.
        for forth in [true, false] {
            let count = if forth { n - at } else { at };
            let interval = |k: usize| if forth { &span.intervals[at + k] } else { &span.intervals[at - 1 - k] };
            let beyond = |k: usize| {
                let lump = lump(if forth { at + k } else { at - k });
                MassMoments { first: if forth { lump.first } else { -lump.first }, ..lump }
            };
            // Moments at both ends of each interval, from the free end inwards, for one newton on each kilogram.
            let (mut moments, mut moment, mut shear) = (vec![[0.0; 2]; count], 0.0, 0.0);
            for k in (0..count).rev() {
                shear += beyond(k + 1).mass;
                let outer = moment + beyond(k + 1).first;
                moment = outer + shear * interval(k).length;
                moments[k] = [moment, outer];
            }
            // Integrate the curvature M / (E I), linear over each interval, twice: slope and deflection y under the weight of the
            // rod, and with them the numerator and denominator of Rayleigh's quotient.
            let (mut slope, mut y) = (0.0, 0.0);
            for k in 0..count {
                let (l, ei, [inner, outer]) = (interval(k).length, interval(k).bending_rigidity(), moments[k]);
                y += slope * l + l * l * (2.0 * inner + outer) / (6.0 * ei);
                slope += l * (inner + outer) / (2.0 * ei);
                let m = beyond(k + 1);
                top += m.mass * y + m.first * slope;
                bottom += m.mass * y * y + 2.0 * m.first * y * slope + m.second * slope * slope;
            }
        }
        math::sqrt(top / bottom.max(1e-300)) / std::f64::consts::TAU
    }
}
