//! The impulse between a drop and the leaf or wood that it strikes.

use crate::rain::params::ImpactLaw;

/// Magnitude of the impulse of an impact, N s.
///
/// `mass`: of the drop, kg. `approach`: closing speed along the normal, m/s. `inverse_mass`: inverse effective mass of what is
/// struck, 1/kg; 0 if it does not move. `energy`: kinetic energy of the drop relative to it, J. `speed`: of what is struck, along
/// the impulse, m/s.
/// Source: conservation of momentum; or [yang-wu] eq. 2 with M_e = 1 / `inverse_mass`.
pub fn impact_impulse(law: ImpactLaw, mass: f64, approach: f64, inverse_mass: f64, energy: f64, speed: f64) -> f64 {
    match law {
        // j = (1 + e) u / (1/m + 1/M): relative speed after the impact is -e u.
        ImpactLaw::Momentum { restitution } => (1.0 + restitution) * approach / (1.0 / mass + inverse_mass),
        // A rigid target takes up no energy; the drop just stops.
        ImpactLaw::PaperEnergy { .. } if inverse_mass <= 0.0 => mass * approach,
        // M v'^2 / 2 = M v^2 / 2 + (1 - eps) E, solved for M (v' - v).
        ImpactLaw::PaperEnergy { eps } => {
            let effective_mass = 1.0 / inverse_mass;
            effective_mass
                * (osier_base::math::sqrt(speed * speed + 2.0 * (1.0 - eps) * energy / effective_mass) - speed)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DROP: f64 = 4.2e-6;
    const LEAF: f64 = 3e-4;

    #[test]
    fn momentum_is_kept_and_energy_never_grows() {
        for e in [0.0, 0.3, 0.9] {
            let j = impact_impulse(ImpactLaw::Momentum { restitution: e }, DROP, 6.5, 1.0 / LEAF, 0.0, 0.0);
            let (leaf, drop) = (j / LEAF, 6.5 - j / DROP);
            assert!((DROP * drop + LEAF * leaf - DROP * 6.5).abs() < 1e-6 * DROP * 6.5);
            let after = DROP * drop * drop + LEAF * leaf * leaf;
            assert!(after <= DROP * 6.5 * 6.5 * (1.0 + 1e-12));
            assert!((leaf - drop - e * 6.5).abs() < 1e-9);
        }
        let j = impact_impulse(ImpactLaw::Momentum { restitution: 0.0 }, DROP, 6.5, 1.0 / LEAF, 0.0, 0.0);
        assert!((j / LEAF - 0.09).abs() < 0.001);
    }

    #[test]
    fn the_papers_energy_throws_a_leaf_eight_times_as_fast() {
        let energy = 0.5 * DROP * 6.5 * 6.5;
        let j = impact_impulse(ImpactLaw::PaperEnergy { eps: 0.1 }, DROP, 6.5, 1.0 / LEAF, energy, 0.0);
        let leaf = j / LEAF;
        assert!((0.5 * LEAF * leaf * leaf / (0.9 * energy) - 1.0).abs() < 1e-6);
        assert!((leaf - 0.73).abs() < 0.005, "{leaf}");
    }
}
