//! What a blow of a drop does.

use crate::rain::params::ImpactLaw;

/// The blow between a drop and what it strikes, N s, along the normal. `mass`: of the drop, kg; `u`: speed of approach, m/s;
/// `lightness`: what 1 N s changes in the speed of what is struck, 1/kg; `energy`: of the drop's motion relative to it, J;
/// `speed`: of what is struck along the blow, m/s.
/// Source: momentum; or [yang-wu] eq. 2 with M_e = 1 / lightness.
pub fn blow(model: ImpactLaw, (mass, u): (f64, f64), lightness: f64, (energy, speed): (f64, f64)) -> f64 {
    match model {
        ImpactLaw::Momentum { restitution } => (1.0 + restitution) * u / (1.0 / mass + lightness),
        // What does not give way takes no energy.
        ImpactLaw::PaperEnergy { .. } if lightness <= 0.0 => mass * u,
        ImpactLaw::PaperEnergy { eps } => {
            let heavy = 1.0 / lightness;
            heavy * (osier_base::math::sqrt(speed * speed + 2.0 * (1.0 - eps) * energy / heavy) - speed)
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
            let j = blow(ImpactLaw::Momentum { restitution: e }, (DROP, 6.5), 1.0 / LEAF, (0.0, 0.0));
            let (leaf, drop) = (j / LEAF, 6.5 - j / DROP);
            assert!((DROP * drop + LEAF * leaf - DROP * 6.5).abs() < 1e-6 * DROP * 6.5);
            let after = DROP * drop * drop + LEAF * leaf * leaf;
            assert!(after <= DROP * 6.5 * 6.5 * (1.0 + 1e-12));
            assert!((leaf - drop - e * 6.5).abs() < 1e-9);
        }
        let j = blow(ImpactLaw::Momentum { restitution: 0.0 }, (DROP, 6.5), 1.0 / LEAF, (0.0, 0.0));
        assert!((j / LEAF - 0.09).abs() < 0.001);
    }

    #[test]
    fn the_papers_energy_throws_a_leaf_eight_times_as_fast() {
        let energy = 0.5 * DROP * 6.5 * 6.5;
        let j = blow(ImpactLaw::PaperEnergy { eps: 0.1 }, (DROP, 6.5), 1.0 / LEAF, (energy, 0.0));
        let leaf = j / LEAF;
        assert!((0.5 * LEAF * leaf * leaf / (0.9 * energy) - 1.0).abs() < 1e-6);
        assert!((leaf - 0.73).abs() < 0.005, "{leaf}");
    }
}
