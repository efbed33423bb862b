//! Parameters of drops and of rainfall from the keys of `[rain]`.

use crate::recipe::Recipe;
use crate::recipe::scene::{
    DropFriction, DropLever, DropMerge, DropShape, ImpactModel, RainEnvelope, RainRecipe, RainSize,
};
use osier_motion::rain::{
    CapHeightRule, DropParams, DropSizes, DropWeightTorque, FrictionModel, ImpactImpulseLaw, IntensityEnvelope,
    MergeRule, RainfallParams, WettingParams, capillary_length,
};

/// Parameters of wetting, impact, friction, merging and trails from `[rain.drop]`, `[rain.impact]` and `[rain.wet]`.
pub(super) fn drop_params(rain: &RainRecipe, seed: u64) -> DropParams {
    let (drop, impact, wet) = (&rain.drop, &rain.impact, &rain.wet);
    // Keys are in SI units; the choices of the scene select the physical law or the one printed in the paper.
    DropParams {
        seed,
        wetting: WettingParams {
            contact_angle: drop.contact_angle,
            receding: drop.receding,
            advancing: drop.advancing,
            height_factor: drop.omega,
            shape: match drop.shape {
                DropShape::Flattened => CapHeightRule::Flattened,
                DropShape::Paper => CapHeightRule::Paper,
                DropShape::PaperWedge => CapHeightRule::Wedge,
            },
            wedge_base: drop.lambda,
            capillary_length: capillary_length(rain.keys.gravity),
        },
        g: rain.keys.gravity,
        impact: match impact.model {
            ImpactModel::Momentum => ImpactImpulseLaw::Momentum { restitution: impact.restitution },
            ImpactModel::PaperEnergy => ImpactImpulseLaw::PaperEnergy { eps: impact.energy_loss },
        },
        impulse_factor: impact.impulse_factor,
        splash: impact.splash,
        tangent_keep: impact.tangent_keep,
        friction: match drop.friction {
            DropFriction::Retention => FrictionModel::Retention,
            DropFriction::Paper => FrictionModel::Paper,
        },
        friction_coefficient: drop.friction_coefficient,
        friction_force: drop.paper_friction,
        retention_factor: drop.retention_factor,
        velocity_decay_time: drop.velocity_decay,
        retention_variation: drop.pin_noise,
        merge: match drop.merge {
            DropMerge::Touch => MergeRule::Touch,
            DropMerge::Paper => MergeRule::Paper,
        },
        attraction_force: drop.paper_attraction,
        lever: match drop.lever {
            DropLever::Physical => DropWeightTorque::Physical,
            DropLever::Paper => DropWeightTorque::Paper(drop.paper_lever_max),
        },
        tail_ratio: drop.tail_ratio,
        tail_drops: drop.tail_drops,
        tail_amount: drop.rough,
        bead_probability: drop.bead,
        tip_radius: drop.tip_radius,
        decay_fraction: wet.decay_fraction,
        decay_time: wet.decay_time,
        decay_length: wet.length,
    }
}

/// Intensity, drop sizes and envelope of the rainfall. Times in the keys are relative to the start of the clip, times in the
/// simulation to the start of the spin-up.
pub(super) fn rainfall_params(rain: &RainRecipe, recipe: &Recipe) -> RainfallParams {
    let keys = &rain.keys;
    let duration = recipe.clip.len() as f64 / recipe.clip.fps() + keys.spin_up;
    RainfallParams {
        seed: recipe.general.seed,
        intensity: keys.rate,
        size: match keys.size {
            RainSize::Natural => DropSizes::MarshallPalmer,
            RainSize::Fixed => DropSizes::Fixed(keys.diameter),
            RainSize::LogNormal => DropSizes::LogNormal { median: keys.diameter, sigma: keys.spread },
        },
        total: keys.total.map(f64::from),
        envelope: match keys.envelope {
            RainEnvelope::Constant => IntensityEnvelope::Constant,
            RainEnvelope::Bell => {
                // Without keys the bell has its maximum in the middle of the clip and the width of a quarter of it.
                let half = keys.spin_up + (duration - keys.spin_up) / 2.0;
                let middle = keys.middle.map_or(half, |t| t + keys.spin_up);
                IntensityEnvelope::Bell { center: middle, width: keys.width.unwrap_or((duration - keys.spin_up) / 4.0) }
            }
            RainEnvelope::Keys => IntensityEnvelope::Keys(
                keys.envelope_keyframes
                    .iter()
                    .map(|k| [k[0] + keys.spin_up, k.get(1).copied().unwrap_or(0.0)])
                    .collect(),
            ),
        },
        jitter: keys.jitter,
        duration,
        spin_up: keys.spin_up,
        g: keys.gravity,
    }
}
