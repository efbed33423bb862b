//! The impulse between a drop and the leaf or wood that it strikes.

use glam::DVec3;

use crate::rain::params::{DropParams, ImpactImpulseLaw};
use crate::rain::tuning::REBOUND_WEBER_NUMBER;
use osier_base::math;
use osier_base::physics::{WATER_DENSITY, WATER_SURFACE_TENSION};

/// Weber number of a drop of `diameter`, m, and `speed`, m/s: rho u^2 d / gamma, the ratio of inertia to surface tension.
pub fn weber_number(speed: f64, diameter: f64) -> f64 {
    WATER_DENSITY * speed * speed * diameter / WATER_SURFACE_TENSION
}

/// A drop at the moment in which it strikes a leaf; all vectors in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impact {
    /// Mass of the drop, kg.
    pub mass: f64,
    /// Diameter of the drop, m.
    pub diameter: f64,
    /// Velocity of the drop relative to the leaf's material point, m/s.
    pub relative: DVec3,
    /// Unit normal of the leaf on the side of the drop.
    pub normal: DVec3,
    /// Velocity of the leaf's material point, m/s.
    pub surface_velocity: DVec3,
}

/// Result of an impact on a leaf: the impulse on the leaf and the motion of the drop afterwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpulseAndRebound {
    /// Impulse on the leaf and the water that stays on it, N s.
    pub impulse: DVec3,
    /// Velocity of the drop afterwards, relative to the velocity of the leaf's material point before, m/s; along
    /// the leaf if it stays.
    pub relative: DVec3,
    /// Whether the drop rebounds and falls on; else it stays on the leaf.
    pub bounces: bool,
}

impl Impact {
    /// Speed of approach along the normal, m/s; 0 for a drop that moves away.
    pub fn approach_speed(&self) -> f64 {
        (-self.relative.dot(self.normal)).max(0.0)
    }

    /// The impulse of an impact by the law of `params`. `inverse_mass`: inverse effective mass of the leaf along a unit vector,
    /// 1/kg; 0 if it does not move.
    ///
    /// With [`ImpactImpulseLaw::Momentum`] the impulse is the momentum that the drop loses, along the normal and along the leaf
    /// alike. The mass of a drop that stays is added to that of the leaf at the velocity of the leaf, so that the impulse on both
    /// is the whole relative momentum except for the part that the drop keeps along the leaf.
    /// Source: conservation of momentum; or [yang-wu] eq. 2 with M_e the effective mass along the drop's flight.
    pub fn impulse_and_rebound(&self, params: &DropParams, inverse_mass: impl Fn(DVec3) -> f64) -> ImpulseAndRebound {
        let Self { mass, diameter, relative, normal, surface_velocity } = *self;
        let approach = self.approach_speed();
        let along = relative + normal * approach;
        let kept = along * params.tangent_keep;
        let restitution = match params.impact {
            ImpactImpulseLaw::Momentum { restitution } => restitution,
            ImpactImpulseLaw::PaperEnergy { eps } => {
                let direction = relative.normalize_or(-normal);
                let energy = (1.0 - eps) * 0.5 * mass * relative.length_squared();
                let inverse_mass = inverse_mass(direction);
                // A rigid target takes up no energy: the drop stops.
                let j = if inverse_mass <= 0.0 {
                    mass * approach
                } else {
                    energy_impulse(energy, 1.0 / inverse_mass, surface_velocity.dot(direction))
                };
                return ImpulseAndRebound { impulse: direction * j, relative: kept, bounces: false };
            }
        };
        if weber_number(restitution * approach, diameter) <= REBOUND_WEBER_NUMBER {
            return ImpulseAndRebound { impulse: (relative - kept) * mass, relative: kept, bounces: false };
        }
        // Two bodies that separate: j = (1 + e) u / (1/m + 1/M) makes the relative speed after the impact e u; likewise along the leaf.
        let to_common_velocity = |direction: DVec3| 1.0 / (1.0 / mass + inverse_mass(direction));
        let mut impulse = normal * (-(1.0 + restitution) * approach * to_common_velocity(normal));
        if along != DVec3::ZERO {
            impulse += (along - kept) * to_common_velocity(along.normalize());
        }
        ImpulseAndRebound { impulse, relative: relative - impulse / mass, bounces: true }
    }
}

/// Impulse on wood that absorbs a drop of `mass`, kg, with velocity `relative` to it, m/s: both have a common velocity
/// afterwards.
/// `inverse_mass`: inverse effective mass of the wood along that velocity, 1/kg.
pub fn wood_impulse(law: ImpactImpulseLaw, mass: f64, relative: DVec3, inverse_mass: f64) -> DVec3 {
    let direction = relative.normalize_or_zero();
    match law {
        ImpactImpulseLaw::PaperEnergy { eps } if inverse_mass > 0.0 => {
            direction * energy_impulse((1.0 - eps) * 0.5 * mass * relative.length_squared(), 1.0 / inverse_mass, 0.0)
        }
        _ => relative / (1.0 / mass + inverse_mass),
    }
}

/// Impulse that adds `energy`, J, to a body of `mass`, kg, with `speed`, m/s, along it: M v'^2 / 2 = M v^2 / 2 + E, solved for
/// M (v' - v).
fn energy_impulse(energy: f64, mass: f64, speed: f64) -> f64 {
    mass * (math::sqrt(speed * speed + 2.0 * energy / mass) - speed)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DROP: f64 = 4.2e-6;
    const LEAF: f64 = 3e-4;

    fn slanting(speed: f64) -> Impact {
        let (relative, normal) = (DVec3::new(0.4, -1.0, 0.2).normalize() * speed, DVec3::Y);
        Impact { mass: DROP, diameter: 2e-3, relative, normal, surface_velocity: DVec3::new(0.1, 0.2, -0.3) }
    }

    fn with(restitution: f64) -> DropParams {
        DropParams { impact: ImpactImpulseLaw::Momentum { restitution }, ..DropParams::default() }
    }

    #[test]
    fn a_drop_that_stays_moves_with_a_free_leaf_and_loses_no_momentum() {
        let impact = slanting(6.5);
        let outcome = impact.impulse_and_rebound(&with(0.0), |_| 1.0 / LEAF);
        assert!(!outcome.bounces);
        // The impulse acts on leaf and drop as one body of both masses, which moves at the velocity of the leaf.
        let both = impact.surface_velocity + outcome.impulse / (LEAF + DROP);
        let pushed = (both - impact.surface_velocity).y;
        assert!((pushed / impact.approach_speed() + DROP / (LEAF + DROP)).abs() < 1e-12, "{pushed}");
        assert!((outcome.relative.dot(DVec3::Y)).abs() < 1e-15);
        let after = both * (LEAF + DROP) + outcome.relative * DROP;
        let before = impact.surface_velocity * LEAF + (impact.surface_velocity + impact.relative) * DROP;
        assert!((after - before).length() < 1e-12 * before.length());
    }

    #[test]
    fn a_drop_bounces_with_the_restitution_and_energy_never_grows() {
        for e in [0.1, 0.5, 0.9] {
            let impact = slanting(6.5);
            let outcome = impact.impulse_and_rebound(&with(e), |_| 1.0 / LEAF);
            assert!(outcome.bounces);
            // Velocities in the frame of the leaf before the impact.
            let (leaf, drop) = (outcome.impulse / LEAF, outcome.relative);
            let parting = drop - leaf;
            assert!((parting.y - e * impact.approach_speed()).abs() < 1e-9, "{parting}");
            let sliding = (impact.relative + DVec3::Y * impact.approach_speed()) * 0.3;
            assert!((parting - DVec3::Y * parting.y - sliding).length() < 1e-9);
            assert!((leaf * LEAF + drop * DROP - impact.relative * DROP).length() < 1e-15);
            let after = DROP * drop.length_squared() + LEAF * leaf.length_squared();
            assert!(after < DROP * impact.relative.length_squared());
        }
        // Below the Weber number of a rebound the drop stays.
        assert!(!slanting(0.3).impulse_and_rebound(&with(0.5), |_| 1.0 / LEAF).bounces);
    }

    #[test]
    fn the_papers_energy_throws_a_leaf_eight_times_as_fast() {
        let straight = Impact { relative: DVec3::NEG_Y * 6.5, surface_velocity: DVec3::ZERO, ..slanting(6.5) };
        let paper = DropParams { impact: ImpactImpulseLaw::PaperEnergy { eps: 0.1 }, ..DropParams::default() };
        let outcome = straight.impulse_and_rebound(&paper, |_| 1.0 / LEAF);
        let leaf = outcome.impulse.length() / LEAF;
        let energy = 0.5 * DROP * 6.5 * 6.5;
        assert!((0.5 * LEAF * leaf * leaf / (0.9 * energy) - 1.0).abs() < 1e-6);
        assert!((leaf - 0.73).abs() < 0.005, "{leaf}");
        assert!(
            (straight.impulse_and_rebound(&with(0.0), |_| 1.0 / LEAF).impulse.length() / (LEAF + DROP) - 0.09).abs()
                < 0.001
        );
    }

    #[test]
    fn wood_takes_up_a_drop_as_one_body() {
        let relative = DVec3::new(1.0, -5.0, 0.5);
        let j = wood_impulse(ImpactImpulseLaw::Momentum { restitution: 0.5 }, DROP, relative, 1.0 / LEAF);
        assert!((j / LEAF - (relative - j / DROP)).length() < 1e-12, "a common velocity");
        let still = wood_impulse(ImpactImpulseLaw::PaperEnergy { eps: 0.1 }, DROP, relative, 0.0);
        assert!((still - relative * DROP).length() < 1e-18);
    }
}
