//! Material of wood and leaves.

use crate::sway::tuning::{MIN_MOVING_LEAF_MASS, THICK_WOOD, THIN_WOOD};

/// Density of air at sea level, kg/m^3, in the drag of branches and leaves.
pub const AIR_DENSITY: f64 = osier_base::physics::AIR_DENSITY;
/// Wind speed at which leaves reconfigure (fold), m/s: above it their drag grows linearly instead of quadratically.
pub const LEAF_FOLD_SPEED: f64 = 8.0;

/// Mechanical and aerodynamic properties of a plant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WoodParams {
    /// Young's modulus of its wood, Pa; `None` for 8 GPa in thick wood falling to 5 GPa in twigs.
    pub elasticity: Option<f64>,
    /// Density of wood, kg/m^3.
    pub density: f64,
    /// Mass of leaves per one-sided area, kg/m^2.
    pub leaf_mass: f64,
    /// Drag coefficient of wood for its projected area.
    pub drag: f64,
    /// Drag coefficient of leaves for their one-sided area.
    pub leaf_drag: f64,
    /// Factor on Young's modulus, `elasticity` or the default.
    pub stiffness: f64,
    /// Fundamental frequency of the trunk, Hz; `None` to compute it from the shape.
    pub trunk_hertz: Option<f64>,
    /// Factor on all natural frequencies, that of `trunk_hertz` included.
    pub hertz: f64,
    /// Factor on all damping ratios, which `damping_ratio` gives by branching order.
    pub damping: f64,
    /// Whether slopes are computed from taper and load; if not, from a uniform cantilever under a uniform load.
    pub measured: bool,
    /// Whether trunks and main branches also oscillate in their second mode.
    pub second_modes: bool,
}

impl Default for WoodParams {
    fn default() -> Self {
        Self {
            elasticity: None,
            density: 900.0,
            leaf_mass: 0.2,
            drag: 1.1,
            leaf_drag: 0.4,
            stiffness: 1.0,
            trunk_hertz: None,
            hertz: 1.0,
            damping: 1.0,
            measured: false,
            second_modes: false,
        }
    }
}

impl WoodParams {
    /// Mass of leaves per one-sided area in models in which they swing by themselves, in rain and on rods, kg/m^2. It is at least
    /// that of very thin leaves, since air and drops would accelerate a blade without mass to any speed.
    pub fn moving_leaf_mass(&self) -> f64 {
        self.leaf_mass.max(MIN_MOVING_LEAF_MASS)
    }

    /// Bending stiffness E I of a round section, N m^2: I = pi r^4 / 4.
    pub fn rigidity(&self, r: f64) -> f64 {
        self.elasticity_at(r) * std::f64::consts::FRAC_PI_4 * r * r * r * r
    }

    /// Young's modulus of wood of radius `r`, m, in Pa: `elasticity`, or the value by thickness, times `stiffness`.
    pub fn elasticity_at(&self, r: f64) -> f64 {
        let own = || {
            let x = ((r - THIN_WOOD.1) / (THICK_WOOD.1 - THIN_WOOD.1)).clamp(0.0, 1.0);
            THIN_WOOD.0 + (THICK_WOOD.0 - THIN_WOOD.0) * x * x * (3.0 - 2.0 * x)
        };
        self.stiffness * self.elasticity.unwrap_or_else(own)
    }
}

/// Damping ratio: by branching order for trunk and main branches with their crowns, for branches and for twigs; another for
/// petioles of any order.
pub fn damping_ratio(order: u8, petiole: bool) -> f64 {
    match order {
        _ if petiole => 0.30,
        0 | 1 => 0.08,
        2 => 0.12,
        _ => 0.20,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thick_wood_is_stiffer_than_twigs() {
        let wood = WoodParams::default();
        let e = |r: f64| wood.rigidity(r) / (std::f64::consts::FRAC_PI_4 * r * r * r * r);
        assert!((e(0.2) - 8e9).abs() < 1.0 && (e(0.001) - 5e9).abs() < 1.0);
        assert!(e(0.02) > 5e9 && e(0.02) < 8e9);
        let soft = WoodParams { elasticity: Some(1e9), stiffness: 0.5, ..wood };
        assert!((soft.rigidity(0.1) - 0.5e9 * std::f64::consts::FRAC_PI_4 * 1e-4).abs() < 1.0);
    }
}
