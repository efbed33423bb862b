//! The numbers that rule rain.

use crate::rain::drops::shape::{CapShape, WettingParams};
use crate::rain::leaf::wetness::DryingLaw;

/// How a drop's blow moves what it strikes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ImpactLaw {
    /// Momentum is kept.
    Momentum {
        /// Share of the speed of approach that it leaves with.
        restitution: f64,
    },
    /// A share of its energy is passed on, as [yang-wu] eq. 2 has it; momentum is not kept.
    PaperEnergy {
        /// Share of energy that is lost.
        eps: f64,
    },
}

/// What holds a drop back on a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrictionModel {
    /// Hysteresis of its contact angles.
    Retention,
    /// [yang-wu] eq. 7: mu times its weight on the leaf, and a constant.
    Paper,
}

/// When two drops become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MergeRule {
    /// When they touch.
    Touch,
    /// They draw each other by [yang-wu] eq. 12 from touching on.
    Paper,
}

/// With what arm a drop's weight turns its leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LeverArm {
    /// Its own.
    Physical,
    /// Its own, times its distance from the stalk as a share of the midrib, at most this.
    Paper(f64),
}

/// How drops behave on leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct DropParams {
    /// Seed of all draws.
    pub seed: u64,
    /// Contact angles and shape.
    pub wetting: WettingParams,
    /// Gravity, m/s^2, downwards.
    pub g: f64,
    /// What a blow does.
    pub impact: ImpactLaw,
    /// Factor on blows, for looks.
    pub gain: f64,
    /// Share of a hard-striking drop that leaves as droplets.
    pub splash: f64,
    /// Share of the speed along the leaf that a striking drop keeps.
    pub tangent_keep: f64,
    /// What holds it back.
    pub friction: FrictionModel,
    /// Of the paper's friction: mu, and H, N.
    pub mu: f64,
    /// See `mu`.
    pub h: f64,
    /// Factor on retention.
    pub k_f: f64,
    /// Time in which a running drop would lose its speed to the water's own friction, s.
    pub tau_v: f64,
    /// How unevenly a leaf holds drops.
    pub pin_noise: f64,
    /// When drops become one.
    pub merge: MergeRule,
    /// Strength of the paper's attraction, N.
    pub k_h: f64,
    /// With what arm weight acts.
    pub lever: LeverArm,
    /// Ratio of radii along a tail, its most drops, and how much of it there is.
    pub tail_beta: f64,
    /// See `tail_beta`.
    pub tail_n: u32,
    /// See `tail_beta`.
    pub rough: f64,
    /// Chance that a drop of the tail stays behind.
    pub bead: f64,
    /// Radius at which a drop hangs at the tip, m.
    pub tip_radius: f64,
    /// What wetness becomes in `half_life` seconds.
    pub zeta: f64,
    /// See `zeta`.
    pub half_life: f64,
    /// Length on which wetness falls from a drop's middle, m.
    pub wet_length: f64,
}

impl DropParams {
    /// How wet surfaces dry.
    pub fn drying(&self) -> DryingLaw {
        DryingLaw { zeta: self.zeta, half_life: self.half_life }
    }
}

impl Default for DropParams {
    fn default() -> Self {
        let rad = f64::to_radians;
        Self {
            seed: 1,
            wetting: WettingParams {
                theta: rad(60.0),
                receding: rad(52.0),
                advancing: rad(68.0),
                omega: None,
                shape: CapShape::Flattened,
                lambda: 1.05,
                capillary: capillary(9.81),
            },
            g: 9.81,
            impact: ImpactLaw::Momentum { restitution: 0.0 },
            gain: 1.0,
            splash: 0.0,
            tangent_keep: 0.3,
            friction: FrictionModel::Retention,
            mu: 0.0,
            h: 2e-5,
            k_f: 1.0,
            tau_v: 0.05,
            pin_noise: 0.3,
            merge: MergeRule::Touch,
            k_h: 1e-4,
            lever: LeverArm::Physical,
            tail_beta: 0.8,
            tail_n: 8,
            rough: 1.0,
            bead: 0.25,
            tip_radius: 1e-3,
            zeta: 0.5,
            half_life: 20.0,
            wet_length: 3e-3,
        }
    }
}

/// Capillary length of water, m, at a gravity, m/s^2.
pub fn capillary(g: f64) -> f64 {
    osier_base::math::sqrt(crate::rain::drops::shape::TENSION / (crate::rain::drops::shape::WATER * g.max(1e-3)))
}
