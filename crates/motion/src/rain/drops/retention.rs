//! The forces on a drop that rests on a leaf: gravity with the leaf's acceleration, and retention by contact-angle hysteresis.

use glam::{DVec2, DVec3};

use super::rain_leaf::{LeafStep, RainLeaf};
use super::spherical_cap::{CapLaw, SphericalCap};
use super::surface_drop::LeafDrop;
use crate::rain::leaf::surface::SurfacePoint;
use crate::rain::params::{DropParams, FrictionModel};
use crate::rain::tuning::{
    DYNAMIC_RETENTION, FRONT_DISTANCE, MAX_LEAF_ACCELERATION, PINNING_NOISE_CELLS, STOP_SPEED, WET_RELIEF,
};
use osier_base::math;
use osier_base::noise::gradient2;
use osier_base::physics::{WATER_DENSITY, WATER_SURFACE_TENSION};
use osier_base::rng::Rng;

/// Effective gravity on a drop, with its components along and across the surface; all vectors in leaf space.
pub(super) struct EffectiveGravity {
    /// Unit normal of the surface on the drop's side.
    pub normal: DVec3,
    /// Gravity less the leaf's acceleration, m/s^2.
    pub total: DVec3,
    /// Component along the surface, m/s^2.
    pub tangential: DVec3,
    /// Component towards the surface, m/s^2; negative where it pulls the drop off.
    pub onto: f64,
}

/// Quantities of a step that are the same for all drops of a leaf.
pub(super) struct StepConstants {
    /// Shape of caps at rest by volume, for the contact angle of the wetting.
    pub cap_law: CapLaw,
    pub sin_receding: f64,
    /// Contact-angle hysteresis cos(receding) - cos(advancing).
    pub hysteresis: f64,
    /// Random key of the leaf's pinning noise.
    pub pinning_key: u64,
}

impl StepConstants {
    pub fn new(leaf: &RainLeaf, params: &DropParams) -> Self {
        Self {
            cap_law: params.wetting.cap_law(),
            sin_receding: math::sin(params.wetting.receding),
            hysteresis: contact_angle_hysteresis(params),
            // The key differs from leaf to leaf.
            pinning_key: Rng::key(params.seed, &["pin".into(), leaf.index.into()]),
        }
    }
}

/// Driving and retaining forces on a drop along the surface.
pub(super) struct SurfaceForces {
    /// Weight along the surface and the attraction of other drops, in leaf space, N.
    pub drive: DVec3,
    /// Largest drive that leaves a drop at rest where it is, N.
    pub holding: f64,
    /// Dry friction against the motion of a drop, N; at most `holding`.
    pub resistance: f64,
    /// Skew of the drop as a fraction of the largest, 0 to 1.
    pub lean: f64,
}

impl SurfaceForces {
    /// Whether the drive is at most `holding`, so that a drop at rest does not begin to run.
    pub fn stays_at_rest(&self) -> bool {
        self.drive.length() <= self.holding
    }
}

/// Effective gravity in the accelerated frame of the leaf, g - a, at a point of leaf space, in leaf space, m/s^2.
pub(super) fn effective_gravity(step: &LeafStep<'_>, local: DVec3) -> DVec3 {
    let point = step.world_point(local);
    // An impact accelerates the leaf within a single step: without a limit it would throw off every drop.
    let acceleration = step.pose.acceleration_at(point).clamp_length_max(MAX_LEAF_ACCELERATION);
    step.pose.orientation.inverse() * (DVec3::NEG_Y * step.params.g - acceleration)
}

/// Contact-angle hysteresis cos(receding) - cos(advancing). Source: Furmidge 1962; times gamma it is the retention force per width
/// of the contact line.
fn contact_angle_hysteresis(params: &DropParams) -> f64 {
    math::cos(params.wetting.receding) - math::cos(params.wetting.advancing)
}

/// Retention force on a dry, uniform surface, N: k gamma 2 a (cos receding - cos advancing). `a`: base radius, m.
pub(super) fn dry_retention(params: &DropParams, a: f64) -> f64 {
    params.retention_factor * WATER_SURFACE_TENSION * 2.0 * a * contact_angle_hysteresis(params)
}

impl RainLeaf {
    /// Effective gravity at a surface point for a drop on a side of the leaf (1 above, -1 below).
    pub(super) fn surface_gravity(&self, surface: &SurfacePoint, side: f64, step: &LeafStep<'_>) -> EffectiveGravity {
        let g = effective_gravity(step, surface.p);
        let normal = surface.n * side;
        EffectiveGravity { normal, total: g, tangential: g - normal * g.dot(normal), onto: -g.dot(normal) }
    }

    /// The forces on a drop along the surface: drive, holding and resistance. `attraction`: force of other drops on it, in leaf space, N.
    pub(super) fn surface_forces(
        &self,
        drop: &LeafDrop,
        cap: &SphericalCap,
        surface: &SurfacePoint,
        gravity: &EffectiveGravity,
        attraction: DVec3,
        constants: &StepConstants,
        step: &LeafStep<'_>,
    ) -> SurfaceForces {
        let params = step.params;
        let m = WATER_DENSITY * drop.volume;
        let drive = gravity.tangential * m + attraction - gravity.normal * attraction.dot(gravity.normal);
        let sliding = params.friction_coefficient * m * gravity.onto.abs();
        match params.friction {
            FrictionModel::Retention => {
                let heading = if drop.v.length() > STOP_SPEED { drop.v } else { drive }.normalize_or(drop.axis);
                let retention = self.retention_force(drop, cap, surface, heading, constants, step);
                // The hysteresis of a moving contact line is smaller. Friction, if there is any, also holds a drop at rest.
                let resistance = DYNAMIC_RETENTION * retention + sliding;
                // A drop leans in proportion to the load on its contact line, fully at the point of slipping.
                let lean = if retention > 0.0 { (drive.length() / retention).min(1.0) } else { 1.0 };
                SurfaceForces { drive, holding: retention.max(resistance), resistance, lean }
            }
            // [yang-wu] eq. 7: mu m g_n + H.
            FrictionModel::Paper => {
                let friction = sliding + params.friction_force;
                SurfaceForces { drive, holding: friction, resistance: friction, lean: 1.0 }
            }
        }
    }

    /// Retention force by contact-angle hysteresis on a drop that moves or would move along the unit tangent `direction`, N. Pinning
    /// varies over the leaf, and a wet surface ahead holds less.
    pub(super) fn retention_force(
        &self,
        drop: &LeafDrop,
        cap: &SphericalCap,
        surface: &SurfacePoint,
        direction: DVec3,
        constants: &StepConstants,
        step: &LeafStep<'_>,
    ) -> f64 {
        let params = step.params;
        // The force acts on the width of the contact line across the motion, which a stretch reduces.
        let width = 2.0 * cap.a / drop.stretch();
        let noise = pinning_noise(constants.pinning_key, drop.uv);
        // Only the advancing front meets a new surface, so its wetness counts, not that under the drop.
        let ahead = drop.uv + surface.uv_offset(direction * (FRONT_DISTANCE * cap.a));
        let wet = self.wetness_grid.wetness(ahead, step.t, params.drying_law());
        let uniform = params.retention_factor * WATER_SURFACE_TENSION * width * constants.hysteresis;
        uniform * (1.0 + params.retention_variation * noise) * (1.0 - WET_RELIEF * wet)
    }
}

/// Gradient noise of a leaf's pinning at texture coordinates, about -1 to 1; constant over time. `key`: [`StepConstants::pinning_key`].
pub(super) fn pinning_noise(key: u64, uv: DVec2) -> f64 {
    // The period of the noise is far larger than the texture.
    let p = [math::narrow(uv.x * PINNING_NOISE_CELLS), math::narrow(uv.y * PINNING_NOISE_CELLS)];
    f64::from(gradient2(key, p, [4096, 4096]))
}
