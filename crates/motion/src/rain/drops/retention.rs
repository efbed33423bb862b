//! The forces on a drop that rests on a leaf: gravity with the leaf's acceleration, and retention by contact-angle hysteresis.

use glam::{DVec2, DVec3};

use super::drop::SurfaceDrop;
use super::rain_leaf::{LeafStep, RainLeaf};
use super::shape::{SphericalCap, TENSION};
use crate::rain::leaf::surface::SurfacePoint;
use crate::rain::params::DropParams;
use crate::rain::tuning::{FRONT_DISTANCE, MAX_LEAF_ACCELERATION, PINNING_NOISE_CELLS, WET_RELIEF};
use osier_base::math;
use osier_base::noise::gradient2;
use osier_base::rng::Rng;

/// Gravity less the leaf's acceleration, in leaf space, split at the surface.
pub(super) struct EffectiveGravity {
    /// Unit normal of the surface on the drop's side.
    pub normal: DVec3,
    /// The whole of it, m/s^2.
    pub total: DVec3,
    /// Component along the surface, m/s^2.
    pub tangential: DVec3,
    /// Component towards the surface, m/s^2; negative where it pulls the drop off.
    pub onto: f64,
}

/// Gravity less the leaf's acceleration at a point of leaf space, in leaf space, m/s^2.
pub(super) fn effective_gravity(step: &LeafStep<'_>, local: DVec3) -> DVec3 {
    let point = step.world_point(local);
    let acceleration = step.pose.acceleration_at(point).clamp_length_max(MAX_LEAF_ACCELERATION);
    step.pose.orientation.inverse() * (DVec3::NEG_Y * step.params.g - acceleration)
}

/// Retention of a straight contact line per m of its width, N/m. Source: Furmidge 1962, gamma (cos receding - cos advancing).
fn hysteresis(params: &DropParams) -> f64 {
    math::cos(params.wetting.receding) - math::cos(params.wetting.advancing)
}

/// Force that holds a drop of base radius `a`, m, on a dry, even surface, N.
pub(super) fn dry_retention(params: &DropParams, a: f64) -> f64 {
    params.k_f * TENSION * 2.0 * a * hysteresis(params)
}

impl RainLeaf {
    /// Effective gravity at a surface point for a drop on a side of the leaf (1 above, -1 below).
    pub(super) fn gravity_on(&self, surface: &SurfacePoint, side: f64, step: &LeafStep<'_>) -> EffectiveGravity {
        let g = effective_gravity(step, surface.p);
        let normal = surface.n * side;
        EffectiveGravity { normal, total: g, tangential: g - normal * g.dot(normal), onto: -g.dot(normal) }
    }

    /// Force that holds back a drop that moves or would move along `direction`, N: Furmidge's, uneven over the leaf, and less
    /// where the surface ahead is wet.
    pub(super) fn retention_force(
        &self,
        drop: &SurfaceDrop,
        cap: &SphericalCap,
        surface: &SurfacePoint,
        direction: DVec3,
        step: &LeafStep<'_>,
    ) -> f64 {
        let params = step.params;
        // A stretched footprint is narrower across its motion.
        let width = 2.0 * cap.a / drop.stretch();
        let noise = self.pinning_noise(drop.uv, params);
        let ahead = drop.uv + surface.uv(direction * (FRONT_DISTANCE * cap.a));
        let wet = self.dew.wetness(ahead, step.t, params.drying());
        let even = params.k_f * TENSION * width * hysteresis(params);
        even * (1.0 + params.pin_noise * noise) * (1.0 - WET_RELIEF * wet)
    }

    /// Unevenness of the leaf's retention at texture coordinates, about -1 to 1.
    pub(super) fn pinning_noise(&self, uv: DVec2, params: &DropParams) -> f64 {
        let p = [math::narrow(uv.x * PINNING_NOISE_CELLS), math::narrow(uv.y * PINNING_NOISE_CELLS)];
        let key = Rng::key(params.seed, &["pin".into(), self.number.into()]);
        f64::from(gradient2(key, p, [4096, 4096]))
    }
}
