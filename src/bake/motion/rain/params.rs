//! From keys of a recipe to how drops behave and how rain falls.

use crate::recipe::Recipe;
use crate::recipe::scene::{
    DropFriction, DropLever, DropMerge, DropShape, ImpactModel, RainEnvelope, RainRecipe, RainSize,
};
use osier_motion::rain::{
    CapShape, DropParams, DropSizes, FrictionModel, ImpactLaw, IntensityEnvelope, LeverArm, MergeRule, RainfallParams,
    WettingParams, capillary_length,
};

pub(super) fn manner(rain: &RainRecipe, seed: u64) -> DropParams {
    let (drop, impact, wet) = (&rain.drop, &rain.impact, &rain.wet);
    DropParams {
        seed,
        wetting: WettingParams {
            contact_angle: drop.theta,
            receding: drop.receding,
            advancing: drop.advancing,
            height_factor: drop.omega,
            shape: match drop.shape {
                DropShape::Flattened => CapShape::Flattened,
                DropShape::Paper => CapShape::Paper,
                DropShape::PaperWedge => CapShape::Wedge,
            },
            wedge_base: drop.lambda,
            capillary_length: capillary_length(rain.keys.g),
        },
        g: rain.keys.g,
        impact: match impact.model {
            ImpactModel::Momentum => ImpactLaw::Momentum { restitution: impact.restitution },
            ImpactModel::PaperEnergy => ImpactLaw::PaperEnergy { eps: impact.eps },
        },
        impulse_factor: impact.gain,
        splash: impact.splash,
        tangent_keep: impact.tangent_keep,
        friction: match drop.friction {
            DropFriction::Retention => FrictionModel::Retention,
            DropFriction::Paper => FrictionModel::Paper,
        },
        friction_coefficient: drop.mu,
        friction_force: drop.h,
        retention_factor: drop.k_f,
        velocity_decay_time: drop.tau_v,
        pinning_noise: drop.pin_noise,
        merge: match drop.merge {
            DropMerge::Touch => MergeRule::Touch,
            DropMerge::Paper => MergeRule::Paper,
        },
        attraction_force: drop.k_h,
        lever: match drop.lever {
            DropLever::Physical => LeverArm::Physical,
            DropLever::Paper => LeverArm::Paper(drop.phi_c),
        },
        tail_ratio: drop.tail_beta,
        tail_drops: drop.tail_n,
        tail_amount: drop.rough,
        bead_probability: drop.bead,
        tip_radius: drop.tip_radius,
        decay_fraction: wet.zeta,
        decay_time: wet.half_life,
        decay_length: wet.length,
    }
}

pub(super) fn rainfall(rain: &RainRecipe, recipe: &Recipe) -> RainfallParams {
    let keys = &rain.keys;
    let duration = recipe.clip.len() as f64 / recipe.clip.fps() + keys.before;
    RainfallParams {
        seed: recipe.general.seed,
        intensity: keys.rate / 3.6e6,
        size: match keys.size {
            RainSize::Natural => DropSizes::MarshallPalmer,
            RainSize::Fixed => DropSizes::Fixed(keys.diameter),
            RainSize::LogNormal => DropSizes::LogNormal { median: keys.diameter, sigma: keys.spread },
        },
        total: keys.total.map(f64::from),
        envelope: match keys.envelope {
            RainEnvelope::Constant => IntensityEnvelope::Constant,
            RainEnvelope::Bell => {
                let half = keys.before + (duration - keys.before) / 2.0;
                let middle = keys.middle.map_or(half, |t| t + keys.before);
                IntensityEnvelope::Bell { center: middle, width: keys.width.unwrap_or((duration - keys.before) / 4.0) }
            }
            RainEnvelope::Keys => IntensityEnvelope::Keys(
                keys.keys.iter().map(|k| [k[0] + keys.before, k.get(1).copied().unwrap_or(0.0)]).collect(),
            ),
        },
        jitter: keys.jitter,
        duration,
        g: keys.g,
    }
}
