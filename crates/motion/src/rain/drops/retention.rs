//! The forces on a drop that rests on a leaf: gravity with the leaf's acceleration, and retention by contact-angle hysteresis.

use glam::{DVec2, DVec3};

use super::rain_leaf::{LeafStep, RainLeaf};
use super::spherical_cap::SphericalCap;
use super::surface_drop::SurfaceDrop;
use crate::rain::leaf::surface::SurfacePoint;
use crate::rain::params::DropParams;
use crate::rain::tuning::{FRONT_DISTANCE, MAX_LEAF_ACCELERATION, PINNING_NOISE_CELLS, WET_RELIEF};
use osier_base::math;
use osier_base::noise::gradient2;
use osier_base::physics::WATER_SURFACE_TENSION;
use osier_base::rng::Rng;

/// Effective gravity on a drop, in leaf space, with its components at the surface.
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

/// Effective gravity in the accelerated frame of the leaf, g - a, at a point of leaf space, in leaf space, m/s^2.
pub(super) fn effective_gravity(step: &LeafStep<'_>, local: DVec3) -> DVec3 {
    let point = step.world_point(local);
    // An impact accelerates the leaf within a single step; unlimited it would throw off every drop.
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

    /// Retention force by contact-angle hysteresis on a drop that moves or would move along the unit tangent `direction`, N. Pinning
    /// varies over the leaf, and a wet surface ahead holds less.
    pub(super) fn retention_force(
        &self,
        drop: &SurfaceDrop,
        cap: &SphericalCap,
        surface: &SurfacePoint,
        direction: DVec3,
        step: &LeafStep<'_>,
    ) -> f64 {
        let params = step.params;
        // The force acts on the width of the contact line across the motion, which a stretch reduces.
        let width = 2.0 * cap.a / drop.stretch();
        let noise = self.pinning_noise(drop.uv, params);
        // Only the advancing front meets a new surface, so its wetness counts, not that under the drop.
        let ahead = drop.uv + surface.uv_offset(direction * (FRONT_DISTANCE * cap.a));
        let wet = self.wetness_grid.wetness(ahead, step.t, params.drying_law());
        let uniform = params.retention_factor * WATER_SURFACE_TENSION * width * contact_angle_hysteresis(params);
        uniform * (1.0 + params.pinning_noise * noise) * (1.0 - WET_RELIEF * wet)
    }

    /// Gradient noise of the leaf's pinning at texture coordinates, about -1 to 1; constant over time, different from leaf to leaf.
    pub(super) fn pinning_noise(&self, uv: DVec2, params: &DropParams) -> f64 {
        // The key differs from leaf to leaf; the noise repeats only far beyond the texture.
        let p = [math::narrow(uv.x * PINNING_NOISE_CELLS), math::narrow(uv.y * PINNING_NOISE_CELLS)];
        let key = Rng::key(params.seed, &["pin".into(), self.index.into()]);
        f64::from(gradient2(key, p, [4096, 4096]))
    }
}
