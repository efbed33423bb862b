//! Parameters of drops on leaves: impact, wetting, friction, tails, coalescence and drying.

use crate::rain::drops::spherical_cap::{CapHeightRule, WettingParams};
use crate::rain::leaf::wetness::DryingLaw;
use crate::rain::tuning::MIN_GRAVITY;
use osier_base::physics::{WATER_DENSITY, WATER_SURFACE_TENSION};

/// Law of the impulse between a drop and the plant that it strikes: physical, or as printed in [yang-wu].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ImpactImpulseLaw {
    /// Conserves momentum; with a restitution of 0 the drop stays on the leaf.
    Momentum {
        /// Coefficient of restitution: the speed of separation as a fraction of the speed of approach, 0 to 1.
        restitution: f64,
    },
    /// Transfers a fraction of the drop's kinetic energy, as [yang-wu] eq. 2; does not conserve momentum.
    PaperEnergy {
        /// Fraction of the energy that is lost, 0 to 1.
        eps: f64,
    },
}

/// Force that opposes the motion of a drop on a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrictionModel {
    /// Retention by contact-angle hysteresis along the contact line, after Furmidge.
    Retention,
    /// [yang-wu] eq. 7: mu times the normal force, plus a constant force.
    Paper,
}

/// Distance of two drops on a leaf at which they merge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MergeRule {
    /// The sum of their base radii: they merge as soon as they touch.
    Touch,
    /// The distance at which the attraction of [yang-wu] eq. 12 exceeds friction; it is shorter than that at which drops touch.
    Paper,
}

/// Lever arm with which a drop's weight turns its leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DropWeightTorque {
    /// The distance from the stalk at which the weight acts.
    Physical,
    /// That distance times its fraction of the leaf's length, which is at most this number; from [yang-wu] eq. 15.
    Paper(f64),
}

/// Parameters of drops on leaves. The default is a leaf of average wetting on Earth, without splashes and rebounds.
///
/// # Examples
/// ```
/// use osier_motion::rain::DropParams;
///
/// // A waxy leaf: drops are rounder, and the narrow hysteresis lets them run off earlier.
/// let mut params = DropParams::default();
/// params.wetting.contact_angle = 110_f64.to_radians();
/// params.wetting.receding = 100_f64.to_radians();
/// params.wetting.advancing = 118_f64.to_radians();
/// let (waxy, average) = (params.wetting.cap(1e-8), DropParams::default().wetting.cap(1e-8));
/// assert!(waxy.top() > average.top() && waxy.a < average.a);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct DropParams {
    /// Seed of the random draws: pinning noise, splash droplets, beads.
    pub seed: u64,
    /// Contact angles, and the shape of drops that they give.
    pub wetting: WettingParams,
    /// Gravity, m/s^2, along -Y.
    pub g: f64,
    /// Law of the impulse of a drop on a leaf or on wood; physical by default.
    pub impact: ImpactImpulseLaw,
    /// Factor on that impulse, to exaggerate or damp the motion of leaves; 1 is physical.
    pub impulse_factor: f64,
    /// Fraction of the volume of a splashing drop that leaves as droplets, 0 to 1.
    pub splash: f64,
    /// Fraction of the tangential velocity that a drop keeps after impact, 0 to 1.
    pub tangent_keep: f64,
    /// Force that opposes the motion of drops; each model uses only some of the parameters below.
    pub friction: FrictionModel,
    /// Coefficient mu of dry friction, the ratio to the normal force.
    pub friction_coefficient: f64,
    /// Constant force H of [`FrictionModel::Paper`], N.
    pub friction_force: f64,
    /// Factor on the retention force of contact-angle hysteresis; 1 is Furmidge's.
    pub retention_factor: f64,
    /// Time constant of the viscous decay of a running drop's speed, s.
    pub velocity_decay_time: f64,
    /// Relative variation of the retention force over a leaf, 0 to 1.
    pub retention_variation: f64,
    /// Whether drops merge as soon as they touch, or by the attraction of [yang-wu].
    pub merge: MergeRule,
    /// Strength of the attraction of [`MergeRule::Paper`], N.
    pub attraction_force: f64,
    /// Lever arm with which the weight of drops turns a leaf.
    pub lever: DropWeightTorque,
    /// Ratio of the radii of successive caps of a tail, 0 to 1.
    pub tail_ratio: f64,
    /// Largest number of caps of a drop with its tail.
    pub tail_drops: u32,
    /// Factor on the number of caps of a tail, 0 to 1: how rough the surface is.
    pub tail_amount: f64,
    /// Probability that a cap stays behind as a bead when a tail shrinks, 0 to 1.
    pub bead_probability: f64,
    /// Radius of attachment of pendant drops at the tip, m.
    pub tip_radius: f64,
    /// Fraction of the wetness that is left after `decay_time`, 0 to 1.
    pub decay_fraction: f64,
    /// Time to which `decay_fraction` refers, s.
    pub decay_time: f64,
    /// Distance from the center of a wet spot over which wetness falls by a factor of e, m.
    pub decay_length: f64,
}

impl DropParams {
    /// The law by which wetness falls to `decay_fraction` of itself in every `decay_time`.
    pub fn drying_law(&self) -> DryingLaw {
        DryingLaw { fraction: self.decay_fraction, time: self.decay_time }
    }
}

impl Default for DropParams {
    fn default() -> Self {
        let rad = f64::to_radians;
        Self {
            seed: 1,
            wetting: WettingParams {
                contact_angle: rad(60.0),
                receding: rad(52.0),
                advancing: rad(68.0),
                height_factor: None,
                shape: CapHeightRule::Flattened,
                wedge_base: 1.05,
                capillary_length: capillary_length(9.81),
            },
            g: 9.81,
            impact: ImpactImpulseLaw::Momentum { restitution: 0.0 },
            impulse_factor: 1.0,
            splash: 0.0,
            tangent_keep: 0.3,
            friction: FrictionModel::Retention,
            friction_coefficient: 0.0,
            friction_force: 2e-5,
            retention_factor: 1.0,
            velocity_decay_time: 0.05,
            retention_variation: 0.3,
            merge: MergeRule::Touch,
            attraction_force: 1e-4,
            lever: DropWeightTorque::Physical,
            tail_ratio: 0.8,
            tail_drops: 8,
            tail_amount: 1.0,
            bead_probability: 0.25,
            tip_radius: 1e-3,
            decay_fraction: 0.5,
            decay_time: 20.0,
            decay_length: 3e-3,
        }
    }
}

/// Capillary length of water under gravity `g`, m/s^2: sqrt(gamma / (rho g)), m.
pub fn capillary_length(g: f64) -> f64 {
    osier_base::math::sqrt(WATER_SURFACE_TENSION / (WATER_DENSITY * g.max(MIN_GRAVITY)))
}
