//! Rough ground: the stress it takes from the air, and the eddies above it that are smaller than cells.
//!
//! A ground that holds the air half a cell below the first middle does not do for wind: the profile is far steeper there
//! than a straight line between them, so that the ground takes more momentum from the lowest cells than the profile hands
//! down to it, and what is missing comes back as waves of a few cells above. Here air slips over the ground, which takes
//! the stress of a logarithmic profile through the lowest middle; and the air of the lowest cells is as viscous as eddies make it that
//! are no larger than the height they are at.

use super::stencil::{C, Q, weight};
use osier_base::math::{ln, narrow};
use osier_base::simd::Lane;

/// Karman's constant.
const KARMAN: f64 = 0.4;
/// Cells above the ground up to which eddies are too small for the lattice: those at a height are about as large as it.
const LOW: f64 = 8.0;

/// What ground does to the air above it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Surface {
    /// Stress over the square of the speed in the lowest cells; 0 for ground that holds the air, or none.
    pub drag: f32,
    /// Least relaxation time by height, of the lowest cells.
    pub thick: Vec<f32>,
    /// Share of a sponge by height; empty for all of it everywhere.
    pub shape: Vec<f32>,
    /// What a whole sponge adds to the drag, over the drag.
    pub more: f32,
}

impl Surface {
    /// Ground of a roughness, in cells. `tau`: relaxation time of the air; `wind`: speed, cells a step, and height, cells,
    /// at which it blows so fast; `smagorinsky`: constant of eddies; `cells`: height of the box.
    ///
    /// A sponge of one viscosity would mix the profile before an outlet, which is felt far upwind. Its viscosity is that of
    /// a logarithmic profile in a channel instead, y (1 - y/H), and the ground takes what such a profile hands down.
    /// Source: own; stress and mixing length of the logarithmic law, von Karman 1930.
    pub(super) fn rough(
        roughness: f64,
        (tau, smagorinsky): (f64, f64),
        (speed, height): (f64, f64),
        cells: usize,
    ) -> Self {
        let friction = KARMAN * speed / ln((height + roughness) / roughness);
        let viscosity = |y: f64| KARMAN * friction * (y + roughness) * (1.0 - y / LOW);
        let thick = (0..8).map(|y| narrow(tau + 3.0 * viscosity(f64::from(y) + 0.5))).collect();
        let top = cells as f64;
        let shape = |y: f64| (4.0 * (y + roughness) * (1.0 - y / top) / top).min(1.0);
        let shape = (0..cells).map(|y| narrow(shape(y as f64 + 0.5))).collect();
        let more = (1.0 - tau).max(0.0) * 4.0 / (3.0 * top * KARMAN * friction).max(f64::MIN_POSITIVE);
        // What the second cells hand down to the lowest, by friction velocities; nearly the square of one.
        let [low, second] = [0.5, 1.5].map(|y: f64| ln((y + roughness) / roughness) / KARMAN);
        let growth = second - low;
        let handed =
            KARMAN * (1.0 + roughness) * (1.0 - 1.0 / LOW) * growth + smagorinsky * smagorinsky * growth * growth;
        let drag = narrow(handed / (low * low));
        Self { drag, thick, shape, more: narrow(more) }
    }

    /// Least relaxation time in the cells of a height; `tau` above the lowest.
    pub(super) fn tau(&self, y: usize, tau: f32) -> f32 {
        self.thick.get(y).copied().unwrap_or(tau)
    }

    /// What a whole sponge adds to the relaxation time at a height.
    pub(super) fn sponge(&self, y: usize, tau: f32) -> f32 {
        (1.0 - tau).max(0.0) * self.shape.get(y).copied().unwrap_or(1.0)
    }
}

/// Takes the ground's stress from what arrives at the lowest cells: from what comes from the ground, along it.
/// `drag`: as [`Surface::drag`]; `more`: what a sponge adds to it, over it.
#[inline(always)]
pub(super) fn hold<L: Lane>(g: &mut [L; Q], drag: L, more: L) {
    let drag = drag + drag * more;
    let (drho, u) = super::collide::moments(g);
    let one = drag.splat(1.0);
    let pull = drag * u[0].mul_add(u[0], u[2] * u[2]).sqrt();
    // Never more than there is, however rough the ground.
    let share = (drag.splat(0.25) * (one + drho) * pull).div(one + pull);
    let (plus, minus) = (share * (u[0] + u[2]), share * (u[0] - u[2]));
    // Those that go up, with x and z as they are.
    g[7] = g[7] - plus;
    g[9] = g[9] - minus;
    g[12] = g[12] + plus;
    g[13] = g[13] + minus;
}

/// What a wind that grows with the height adds to the equilibrium that is sent along a velocity: without it the profile
/// would come in as if it had been mixed at a relaxation time of 1. `lean`: by x and z, as [`lean`] has it.
/// Source: own; first order of Chapman and Enskog, (1 - tau) 3 w_i c_iy (c_ix du_x/dy + c_iz du_z/dy).
#[inline(always)]
pub(super) fn leant<L: Lane>(i: usize, lean: [L; 2]) -> L {
    let c = C[i].map(|c| lean[0].splat(f64::from(c)));
    lean[0].splat(weight(i)) * c[1] * (c[0] * lean[0] + c[2] * lean[1])
}

/// 3 (1 - tau) times the growth of the wind with the height, a step.
pub(super) fn lean(tau: f64, growth: f64) -> f64 {
    3.0 * (1.0 - tau) * growth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_takes_its_stress_and_nothing_else() {
        let drag = 0.05;
        let mut g: [f64; Q] = std::array::from_fn(|i| super::super::collide::equilibrium(i, 0.01, [0.06, 0.0, -0.08]));
        let sums = |g: &[f64; Q]| -> [f64; 4] {
            std::array::from_fn(|a| g.iter().zip(C).map(|(g, c)| if a < 3 { g * f64::from(c[a]) } else { *g }).sum())
        };
        let before = sums(&g);
        hold(&mut g, drag / 2.0, 1.0);
        let after = sums(&g);
        // Against the wind, drag rho u^2.
        let stress = 0.05 * 1.01 * 0.1 / 1.005;
        for (a, u) in [0.06, 0.0, -0.08].into_iter().enumerate() {
            assert!((after[a] - before[a] + stress * u).abs() < 1e-15, "{before:?} {after:?}");
        }
        assert!((after[3] - before[3]).abs() < 1e-15);
    }

    #[test]
    fn the_roughest_ground_stops_the_air_and_does_not_turn_it() {
        let rough = Surface::rough(100.0, (0.5005, 0.16), (0.1, 70.0), 70);
        let mut g: [f64; Q] = std::array::from_fn(|i| super::super::collide::equilibrium(i, 0.0, [0.1, 0.0, 0.0]));
        hold(&mut g, f64::from(rough.drag), 0.0);
        let left = super::super::collide::moments(&g).1[0];
        assert!((0.0..0.001).contains(&left), "{left}");
        assert!(rough.thick.iter().all(|t| *t > 0.5));
    }
}
