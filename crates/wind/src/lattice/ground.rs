//! Rough ground: the wall stress of a logarithmic profile, and a mixing-length viscosity in the cells above it.
//!
//! Bounce-back half a cell below the first cell centres is wrong for wind: the logarithmic profile is much steeper there
//! than the straight line that bounce-back assumes, so the wall takes more momentum from the lowest cells than the profile
//! supplies, and the deficit shows as waves of a few cells in the cells above. Instead, the ground is a free-slip face
//! with a wall model: a drag on the lowest cells equal to the stress of the logarithmic profile through their centres. In
//! the lowest cells the relaxation time is at least that of the mixing length kappa y, since eddies near the ground are
//! smaller than the lattice resolves.

use super::stencil::{Q, VELOCITIES, weight};
use super::tuning::{MIN_MIXING_LENGTH_CELLS, MIXING_LENGTH_PER_BOX_HEIGHT, MIXING_LENGTH_PER_REFERENCE_HEIGHT};
use osier_base::math::{ln, narrow};
use osier_base::simd::Lane;

/// Von Karman's constant k in the logarithmic law u = u* ln((y + z0)/z0) / k.
const KARMAN: f64 = 0.4;

/// Wall stress and eddy viscosity over rough ground, and how the outlet sponge varies with height.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct GroundModel {
    /// Drag coefficient: wall stress divided by density and by the square of the speed in the lowest cells. 0 for
    /// bounce-back ground, and without ground.
    pub drag: f32,
    /// Least relaxation time by height, steps, of the cells in the mixing-length layer ([`mixing_layer_cells`]).
    pub min_tau: Vec<f32>,
    /// By height, the share of the outlet sponge's viscosity, 0 to 1; empty for 1 everywhere.
    pub sponge_profile: Vec<f32>,
    /// Increase of the drag coefficient in the full sponge, as a multiple of the drag coefficient.
    pub sponge_drag: f32,
}

impl GroundModel {
    /// Ground of a roughness length, cells, under a logarithmic wind of `speed`, cells per step, at `height`, cells.
    /// `tau`: relaxation time of the air, steps; `smagorinsky`: constant of the eddy viscosity; `cells`: height of the box.
    ///
    /// A sponge of uniform viscosity would mix the profile ahead of an outlet, with an effect far upstream. Its viscosity
    /// is therefore that of a logarithmic profile in a channel of height H, proportional to y (1 - y/H), and the drag
    /// rises with it.
    /// Source: own; stress and mixing length of the logarithmic law, von Karman 1930.
    pub(super) fn for_log_profile(
        roughness: f64,
        tau: f64,
        smagorinsky: f64,
        speed: f64,
        height: f64,
        cells: usize,
    ) -> Self {
        // Friction velocity u* = kappa u / ln((y + z0)/z0); eddy viscosity kappa u* (y + z0), which fades to 0 where the lattice
        // itself resolves the eddies. tau = tau_0 + 3 nu.
        let friction = KARMAN * speed / ln((height + roughness) / roughness);
        let layer = mixing_layer_cells(height, cells as f64);
        let viscosity = |y: f64| KARMAN * friction * (y + roughness) * (1.0 - y / layer).max(0.0);
        let min_tau = (0..cells)
            .map(|y| y as f64 + 0.5)
            .take_while(|y| *y < layer)
            .map(|y| narrow(tau + 3.0 * viscosity(y)))
            .collect();
        let top = cells as f64;
        let profile = |y: f64| (4.0 * (y + roughness) * (1.0 - y / top) / top).min(1.0);
        let sponge_profile = (0..cells).map(|y| narrow(profile(y as f64 + 0.5))).collect();
        let sponge_drag = (1.0 - tau).max(0.0) * 4.0 / (3.0 * top * KARMAN * friction).max(f64::MIN_POSITIVE);
        // Momentum flux from the second cells into the lowest, in units of u*^2 (mixing length plus Smagorinsky); nearly 1. The
        // drag is this flux divided by the square of the lowest cells' speed, so that the profile is a discrete steady state.
        let [low, second] = [0.5, 1.5].map(|y: f64| ln((y + roughness) / roughness) / KARMAN);
        let slope = second - low;
        let flux = KARMAN * (1.0 + roughness) * (1.0 - 1.0 / layer) * slope + smagorinsky * smagorinsky * slope * slope;
        let drag = narrow(flux / (low * low));
        Self { drag, min_tau, sponge_profile, sponge_drag: narrow(sponge_drag) }
    }

    /// Least relaxation time at height `y`, cells; `tau` above the modelled cells.
    pub(super) fn min_tau_at(&self, y: usize, tau: f32) -> f32 {
        self.min_tau.get(y).copied().unwrap_or(tau)
    }

    /// Increase of the relaxation time `tau` in the full sponge at height `y`, cells.
    pub(super) fn sponge_tau(&self, y: usize, tau: f32) -> f32 {
        (1.0 - tau).max(0.0) * self.sponge_profile.get(y).copied().unwrap_or(1.0)
    }
}

/// Depth of the mixing-length layer above rough ground, cells. In metres it does not depend on the size of the cells,
/// so that results converge as the cells are refined; in coarse lattices it is at least [`MIN_MIXING_LENGTH_CELLS`].
/// `reference_height`, `box_height`: cells.
fn mixing_layer_cells(reference_height: f64, box_height: f64) -> f64 {
    let layer = (MIXING_LENGTH_PER_REFERENCE_HEIGHT * reference_height).min(MIXING_LENGTH_PER_BOX_HEIGHT * box_height);
    layer.max(MIN_MIXING_LENGTH_CELLS)
}

/// Applies the wall stress drag rho u |u| to populations arriving at the lowest cells: the upward diagonals, which were
/// reflected from the ground, lose the momentum. Density stays.
/// `drag`: as [`GroundModel::drag`]; `sponge_drag`: increase by the sponge, as a multiple of `drag`.
#[inline(always)]
pub(super) fn apply_wall_stress<L: Lane>(g: &mut [L; Q], drag: L, sponge_drag: L) {
    // The four upward diagonals change by share (u_x +- u_z) with the signs below: density and c_y momentum stay, and
    // the momentum along x and z changes by -4 share u = -drag rho |u| u.
    let drag = drag + drag * sponge_drag;
    let (drho, u) = super::collide::moments(g);
    let one = drag.splat(1.0);
    let rate = drag * u[0].mul_add(u[0], u[2] * u[2]).sqrt();
    // Implicit, rate/(1 + rate): the loss never exceeds the momentum, for any roughness of the ground.
    let share = (drag.splat(0.25) * (one + drho) * rate).div(one + rate);
    let (plus, minus) = (share * (u[0] + u[2]), share * (u[0] - u[2]));
    // Directions (1,1,1), (1,1,-1), (-1,1,-1), (-1,1,1): their changes cancel in density and in y.
    g[7] = g[7] - plus;
    g[9] = g[9] - minus;
    g[12] = g[12] + plus;
    g[13] = g[13] + minus;
}

/// Non-equilibrium part of direction `i` in a wind that increases with height; without it an inlet's profile arrives as if
/// relaxed with tau = 1. `shear`: along x and z, [`shear_coefficient`] times the wind's direction.
/// Source: own; first order of Chapman and Enskog, (1 - tau) 3 w_i c_iy (c_ix du_x/dy + c_iz du_z/dy).
#[inline(always)]
pub(super) fn shear_nonequilibrium_population<L: Lane>(i: usize, shear: [L; 2]) -> L {
    let c = VELOCITIES[i].map(|c| shear[0].splat(f64::from(c)));
    shear[0].splat(weight(i)) * c[1] * (c[0] * shear[0] + c[2] * shear[1])
}

/// 3 (1 - tau) du/dy: the factor of [`shear_nonequilibrium_population`]. `slope`: du/dy, 1 per step.
pub(super) fn shear_coefficient(tau: f64, slope: f64) -> f64 {
    3.0 * (1.0 - tau) * slope
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wall_stress_removes_only_its_momentum() {
        let drag = 0.05;
        let mut g: [f64; Q] = std::array::from_fn(|i| super::super::collide::equilibrium(i, 0.01, [0.06, 0.0, -0.08]));
        let sums = |g: &[f64; Q]| -> [f64; 4] {
            std::array::from_fn(|a| {
                g.iter().zip(VELOCITIES).map(|(g, c)| if a < 3 { g * f64::from(c[a]) } else { *g }).sum()
            })
        };
        let before = sums(&g);
        apply_wall_stress(&mut g, drag / 2.0, 1.0);
        let after = sums(&g);
        // Against the wind, drag rho u^2.
        let stress = 0.05 * 1.01 * 0.1 / 1.005;
        for (a, u) in [0.06, 0.0, -0.08].into_iter().enumerate() {
            assert!((after[a] - before[a] + stress * u).abs() < 1e-15, "{before:?} {after:?}");
        }
        assert!((after[3] - before[3]).abs() < 1e-15);
    }

    #[test]
    fn extreme_roughness_never_reverses_the_flow() {
        let rough = GroundModel::for_log_profile(100.0, 0.5005, 0.16, 0.1, 70.0, 70);
        let mut g: [f64; Q] = std::array::from_fn(|i| super::super::collide::equilibrium(i, 0.0, [0.1, 0.0, 0.0]));
        apply_wall_stress(&mut g, f64::from(rough.drag), 0.0);
        let left = super::super::collide::moments(&g).1[0];
        assert!((0.0..0.001).contains(&left), "{left}");
        assert!(rough.min_tau.iter().all(|t| *t > 0.5));
    }
}
