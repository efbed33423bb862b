//! The slowest swing of each rod, and what follows from it.

use super::rods::{Manner, Rods};
use crate::math;

impl Rods {
    /// Measures all rods anew: after bodies were added.
    pub(super) fn measure(&mut self) {
        let masses = self.carried();
        for rod in 0..self.manners.len() {
            let stuff = self.tree.spans[rod].stuff;
            let hertz = self.slowest(rod, &masses);
            let anchored = self.is_anchored(rod);
            let recovery = if anchored { stuff.recovery } else { 0.0 };
            let swing = std::f64::consts::TAU * hertz;
            let w = swing * math::sqrt(1.0 + recovery);
            // Without anything to hang on only bending is damped, not flight.
            let (mass, stiffness) =
                if anchored { (stuff.zeta * w, stuff.zeta / w) } else { (0.0, 2.0 * stuff.zeta / w) };
            self.manners[rod] = Manner { hertz, recovery: recovery * swing * swing, mass, stiffness };
        }
        self.horizon = self.reach();
    }

    /// Mass of each section with the plant's bodies on it, and the rods, kg.
    fn carried(&self) -> Vec<f64> {
        let mut m: Vec<f64> = self.tree.sections.iter().map(|s| 3.0 * s.mass).collect();
        for body in self.bodies.iter().filter(|b| b.own) {
            m[body.section] += body.mass;
        }
        for span in self.tree.spans.iter().rev() {
            if let Some(base) = span.base {
                let sum = span.sections.clone().fold(0.0, |s, i| s + m[i]);
                m[self.tree.bases[base].on as usize] += sum;
            }
        }
        m
    }

    /// Slowest swing of a rod, Hz: of one that is fixed somewhere by its deflection under its own weight from the side, of
    /// another one as if it were pinned at both ends.
    /// Source: Rayleigh's quotient w^2 = g sum(m y) / sum(m y^2); [yang-wu] eq. 1 for the deflection.
    fn slowest(&self, rod: usize, masses: &[f64]) -> f64 {
        let span = &self.tree.spans[rod];
        let n = span.intervals.len();
        if !self.is_anchored(rod) {
            let total = span.sections.clone().fold(0.0, |s, i| s + masses[i]);
            let mean = span.intervals.iter().fold(0.0, |s, l| s + l.bending()) / n as f64;
            let k = std::f64::consts::PI / span.length;
            return k * k * math::sqrt(mean * span.length / total) / std::f64::consts::TAU;
        }
        // Of the base that rides on another rod the mass is that rod's.
        let first = n + 1 - span.sections.len();
        let mass = |j: usize| if j < first { 0.0 } else { masses[span.sections.start + j - first] };
        let at = self.held_at(rod).map_or(0, |i| i - span.sections.start);
        let (mut top, mut bottom) = (0.0, 0.0);
        for forth in [true, false] {
            let count = if forth { n - at } else { at };
            let interval = |k: usize| if forth { &span.intervals[at + k] } else { &span.intervals[at - 1 - k] };
            let weight = |k: usize| mass(if forth { at + k } else { at - k });
            // Moment at each section, from the free end inwards, for one newton on each kilogram.
            let (mut moment, mut shear) = (vec![0.0; count + 1], 0.0);
            for k in (0..count).rev() {
                shear += weight(k + 1);
                moment[k] = moment[k + 1] + shear * interval(k).length;
            }
            let (mut slope, mut y) = (0.0, 0.0);
            for k in 0..count {
                let (l, ei) = (interval(k).length, interval(k).bending());
                y += slope * l + l * l * (2.0 * moment[k] + moment[k + 1]) / (6.0 * ei);
                slope += l * (moment[k] + moment[k + 1]) / (2.0 * ei);
                top += weight(k + 1) * y;
                bottom += weight(k + 1) * y * y;
            }
        }
        math::sqrt(top / bottom.max(1e-300)) / std::f64::consts::TAU
    }
}
