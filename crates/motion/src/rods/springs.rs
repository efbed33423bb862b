//! The springs between the corners of neighbouring sections: families, stiffness and forces.

use crate::rods::prism::Vector9;
use crate::rods::tuning::{SHEAR_SHARE_RANGE, TWO_INTERVAL_BENDING_SHARE};
use osier_base::math;

/// Springs that belong to a section: 3 around it, 9 to its predecessor, 3 to the one before that, and one of zero
/// stiffness that pads to whole SIMD registers.
pub(crate) const SPRINGS_PER_SECTION: usize = 16;
/// Index of the first spring to the predecessor, and of the first to the section before that.
pub(crate) const FIRST_LINK_SPRING: usize = 3;
pub(crate) const FIRST_BEND_SPRING: usize = 12;
/// Circumradius of a section's triangle divided by the rod's radius. With this ratio bending and axial stiffness are those of a
/// solid round rod.
pub(crate) const CORNER_RADIUS_RATIO: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Geometry and material between two neighbouring sections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RodInterval {
    /// Distance between the two sections at rest, m.
    pub length: f64,
    /// Mean of the radii of its ends, m.
    pub radius: f64,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Shear modulus divided by Young's modulus.
    pub shear: f64,
    /// Factor by which the prism is widened at constant bending stiffness; its axial stiffness falls with the square of the factor.
    pub spread: f64,
}

impl RodInterval {
    /// Axial stiffness per corner k0 = E pi R^2 / (3 l), N/m; divided by the square of the spread, so that bending
    /// stiffness does not depend on it.
    pub(crate) fn corner_axial_stiffness(&self) -> f64 {
        let radius = self.radius / self.spread;
        self.young * std::f64::consts::PI * radius * radius / (3.0 * self.length)
    }

    /// Least spread at which torsion matches the material.
    pub(crate) fn spread_ratio_for_full_torsion(&self) -> f64 {
        math::sqrt(Self { spread: 1.0, ..*self }.torsional_softening_ratio())
    }

    /// Share of the axial stiffness for which diagonal springs would give exactly G J, before clamping.
    fn unclamped_shear_share(&self) -> f64 {
        let slender = self.length / (self.radius * self.spread);
        2.0 / 3.0 * self.shear * slender * slender
    }

    /// Share of the axial stiffness that the diagonal springs carry, limited to [`SHEAR_SHARE_RANGE`].
    fn diagonal_stiffness_share(&self) -> f64 {
        self.unclamped_shear_share().clamp(SHEAR_SHARE_RANGE[0], SHEAR_SHARE_RANGE[1])
    }

    /// Torsional stiffness of the material divided by that of the prism: 1 unless the interval is too long.
    pub(crate) fn torsional_softening_ratio(&self) -> f64 {
        (self.unclamped_shear_share() / SHEAR_SHARE_RANGE[1]).max(1.0)
    }

    /// Bending stiffness E I = E pi R^4 / 4, N m^2.
    pub(crate) fn bending_rigidity(&self) -> f64 {
        let r2 = self.radius * self.radius;
        self.young * std::f64::consts::PI * r2 * r2 / 4.0
    }
}

/// Stiffness, N/m, of a rod's springs, section by section.
/// Source: the families S_st, S_sh, S_fl of [yang-wu] Fig. 3. Own: the stiffness, chosen so that plane sections give
/// EI = E pi R^4 / 4 and, while the share of shear is not bounded, GJ = G pi R^4 / 2.
pub(crate) fn spring_stiffnesses(intervals: &[RodInterval]) -> Vec<[f64; SPRINGS_PER_SECTION]> {
    let n = intervals.len() + 1;
    let bend = |i: usize| {
        TWO_INTERVAL_BENDING_SHARE / 4.0
            * intervals[i].corner_axial_stiffness().min(intervals[i + 1].corner_axial_stiffness())
    };
    // Springs over two intervals exist where both intervals do; the softer one limits them.
    let mut all = vec![[0.0; SPRINGS_PER_SECTION]; n];
    for (i, k) in all.iter_mut().enumerate() {
        let near = &intervals[i.saturating_sub(1)..(i + 1).min(intervals.len())];
        let mean = near.iter().fold(0.0, |s, l| s + l.corner_axial_stiffness()) / near.len() as f64;
        // Springs around a section only keep its shape; they are stiff enough not to matter for bending.
        k[..FIRST_LINK_SPRING].fill(4.0 * mean);
        if i > 0 {
            let l = &intervals[i - 1];
            let (k0, f) = (l.corner_axial_stiffness(), l.diagonal_stiffness_share());
            // Stiffness of the springs over two intervals that span this interval: those that end in the next section, and those
            // that end in this one.
            let across = if i < intervals.len() { bend(i - 1) } else { 0.0 } + if i > 1 { bend(i - 2) } else { 0.0 };
            // Longitudinal springs carry the share of bending that the diagonals (f) and the springs over two intervals
            // leave; never less than a tenth of k0, so that the section stays stable.
            let along = (k0 * (1.0 - f) - 2.0 * across).max(0.1 * k0);
            let rho = CORNER_RADIUS_RATIO * l.radius * l.spread;
            // Diagonals join different corners, sqrt(3) rho apart, so cos^2 = l^2 / (l^2 + 3 rho^2). In bending a diagonal
            // stretches by half of the stretch at the third corner; six of them with 2 f k0 / cos^2 take the share f.
            let diagonal = 2.0 * f * k0 * (l.length * l.length + 3.0 * rho * rho) / (l.length * l.length);
            for c in 0..9 {
                k[FIRST_LINK_SPRING + c] = if c / 3 == c % 3 { along } else { diagonal };
            }
        }
        if i > 1 {
            k[FIRST_BEND_SPRING..FIRST_BEND_SPRING + 3].fill(bend(i - 2));
        }
    }
    all
}

/// One vector per spring, in structure-of-arrays layout: rows x, y, z, one lane per spring.
pub(crate) type PerSpringVectors = [[f64; SPRINGS_PER_SECTION]; 3];

/// Vector from each spring's corner of this section to its far end. `own`: corners of the section; `up`, `over`: of
/// its predecessors, m.
#[inline(always)]
pub(crate) fn spring_vectors(own: &Vector9, up: &Vector9, over: &Vector9) -> PerSpringVectors {
    let mut d = [[0.0; SPRINGS_PER_SECTION]; 3];
    for axis in 0..3 {
        let row = &mut d[axis];
        for c in 0..3 {
            row[c] = own[3 * ((c + 1) % 3) + axis] - own[3 * c + axis];
            for other in 0..3 {
                row[FIRST_LINK_SPRING + 3 * c + other] = up[3 * other + axis] - own[3 * c + axis];
            }
            row[FIRST_BEND_SPRING + c] = over[3 * c + axis] - own[3 * c + axis];
        }
    }
    d
}

/// Direction, tension and geometric stiffness of a section's springs.
pub(crate) struct SpringStates {
    /// Unit vectors towards the far ends.
    pub e: PerSpringVectors,
    /// Tension of each spring, N; negative under compression.
    pub tension: [f64; SPRINGS_PER_SECTION],
    /// Transverse (geometric) stiffness, N/m: of stretched springs only, so that the tangent stays positive definite.
    pub across: [f64; SPRINGS_PER_SECTION],
}

/// Evaluates springs of stiffness `k`, N/m, and rest length `l`, m, whose ends are `d` apart, m.
#[inline(always)]
pub(crate) fn spring_state(
    d: &PerSpringVectors,
    k: &[f64; SPRINGS_PER_SECTION],
    l: &[f64; SPRINGS_PER_SECTION],
) -> SpringStates {
    let mut s = SpringStates { e: *d, tension: [0.0; SPRINGS_PER_SECTION], across: [0.0; SPRINGS_PER_SECTION] };
    for i in 0..SPRINGS_PER_SECTION {
        let length = (d[0][i] * d[0][i] + d[1][i] * d[1][i] + d[2][i] * d[2][i]).sqrt().max(1e-30);
        let inverse = 1.0 / length;
        for axis in 0..3 {
            s.e[axis][i] = d[axis][i] * inverse;
        }
        // Transverse (geometric) stiffness k (1 - L0/|d|), only in tension: compressed springs would make the
        // tangent indefinite.
        s.tension[i] = k[i] * (length - l[i]);
        s.across[i] = k[i] * (1.0 - l[i] * inverse).max(0.0);
    }
    s
}

/// Forces on this section's corner of each spring, N: tension plus stiffness-proportional damping `b` K_t v. `v`:
/// relative velocity of the far end, m/s.
#[inline(always)]
pub(crate) fn spring_forces(
    s: &SpringStates,
    k: &[f64; SPRINGS_PER_SECTION],
    v: &PerSpringVectors,
    b: f64,
) -> PerSpringVectors {
    let mut f = [[0.0; SPRINGS_PER_SECTION]; 3];
    for i in 0..SPRINGS_PER_SECTION {
        // Damping force b K_t v with K_t v = (k - k_across) (e.v) e + k_across v.
        let along = v[0][i] * s.e[0][i] + v[1][i] * s.e[1][i] + v[2][i] * s.e[2][i];
        let pull = s.tension[i] + b * (k[i] - s.across[i]) * along;
        for axis in 0..3 {
            f[axis][i] = pull * s.e[axis][i] + b * s.across[i] * v[axis][i];
        }
    }
    f
}

/// Elastic energy, J, of springs of stiffness `k`, N/m, and rest length `l`, m, whose ends are `d` apart, m.
pub(crate) fn section_spring_energy(
    d: &PerSpringVectors,
    k: &[f64; SPRINGS_PER_SECTION],
    l: &[f64; SPRINGS_PER_SECTION],
) -> f64 {
    (0..SPRINGS_PER_SECTION).fold(0.0, |sum, i| {
        let length = (d[0][i] * d[0][i] + d[1][i] * d[1][i] + d[2][i] * d[2][i]).sqrt();
        sum + 0.5 * k[i] * (length - l[i]) * (length - l[i])
    })
}

/// Length of each spring of a section, m, from the vectors between its ends, m.
pub(crate) fn spring_lengths(d: &PerSpringVectors) -> [f64; SPRINGS_PER_SECTION] {
    std::array::from_fn(|i| (d[0][i] * d[0][i] + d[1][i] * d[1][i] + d[2][i] * d[2][i]).sqrt())
}

/// Adds spring forces to the corners of the section, and the opposite to the corners at the far ends.
#[inline(always)]
pub(crate) fn add_spring_forces(f: &PerSpringVectors, own: &mut Vector9, up: &mut Vector9, over: &mut Vector9) {
    for axis in 0..3 {
        let row = &f[axis];
        for c in 0..3 {
            own[3 * c + axis] += row[c] + row[FIRST_BEND_SPRING + c];
            own[3 * ((c + 1) % 3) + axis] -= row[c];
            over[3 * c + axis] -= row[FIRST_BEND_SPRING + c];
            for other in 0..3 {
                own[3 * c + axis] += row[FIRST_LINK_SPRING + 3 * c + other];
                up[3 * other + axis] -= row[FIRST_LINK_SPRING + 3 * c + other];
            }
        }
    }
}

/// Number of springs of a rod by family: around, longitudinal, diagonal, over two intervals, restoring.
#[cfg(test)]
pub(crate) fn count_springs_by_family(intervals: &[RodInterval]) -> [usize; 5] {
    let k = spring_stiffnesses(intervals);
    let n = k.len();
    let some = |lanes: &dyn Fn(usize) -> bool| {
        k.iter().map(|k| (0..SPRINGS_PER_SECTION).filter(|i| lanes(*i) && k[*i] > 0.0).count()).sum::<usize>()
    };
    let link = |i: usize| (FIRST_LINK_SPRING..FIRST_BEND_SPRING).contains(&i);
    let straight = |i: usize| (i - FIRST_LINK_SPRING) / 3 == (i - FIRST_LINK_SPRING) % 3;
    [
        some(&|i| i < FIRST_LINK_SPRING),
        some(&|i| link(i) && straight(i)),
        some(&|i| link(i) && !straight(i)),
        some(&|i| i >= FIRST_BEND_SPRING),
        3 * n,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spring_counts_match_the_prism_lattice() {
        for n in [3, 5, 9, 16] {
            let interval = RodInterval { length: 0.05, radius: 0.01, young: 5e9, shear: 1.0 / 15.0, spread: 1.0 };
            let counts = count_springs_by_family(&vec![interval; n - 1]);
            assert_eq!(counts, [3 * n, 3 * (n - 1), 6 * (n - 1), 3 * (n - 2), 3 * n]);
        }
    }
}
