//! Pendant drops: when a drop at the margin begins to hang, and how it hangs, necks and detaches.

use glam::{DVec2, DVec3};

use super::drop::{PendantAnchor, SurfaceDrop};
use super::pendant::{DETACHED_FRACTION, NECKING_TIME, RADII, max_pendant_volume};
use super::rain_leaf::{DetachedDrop, LeafStep, LeafStepResult, RainLeaf};
use super::retention::{EffectiveGravity, dry_retention, effective_gravity};
use super::shape::{SphericalCap, WATER};
use crate::rain::leaf::surface::MarginPoint;
use crate::rain::tuning::{
    LOW_POINT_REACH, MAX_PENDANT_LENGTH, MAX_PENDANT_RADIUS, REST_SPEED, RETURN_INSET, STUCK_SPEED, TIPPED_OVER,
};

/// Height difference that counts as level when a lower point of the margin is sought, m.
const LEVEL_TOLERANCE: f64 = 1e-6;

impl RainLeaf {
    /// Makes a drop at the margin pendant if gravity pulls it over the edge harder than the edge holds, and it is at the tip, at
    /// a low point of the margin, or nothing drives it along. Returns whether it hangs now.
    pub(super) fn try_hang(
        &self,
        drop: &mut SurfaceDrop,
        gravity: &EffectiveGravity,
        cap: &SphericalCap,
        margin: &MarginPoint,
        outward: DVec3,
        step: &LeafStep<'_>,
    ) -> bool {
        let params = step.params;
        let m = WATER * drop.volume;
        let retention = dry_retention(params, cap.a);
        if m * gravity.tangential.dot(outward) <= retention.min(0.5 * m * gravity.total.length()) {
            return false;
        }
        let down = gravity.total.normalize_or_zero();
        let reach = cap.a.max(LOW_POINT_REACH);
        let not_lower =
            |offset: f64| (self.sheet.along_margin(margin, offset, self.scale) - margin.p).dot(down) < LEVEL_TOLERANCE;
        let tip = self.sheet.is_tip(margin.p, self.scale, reach);
        let stuck =
            m * gravity.tangential.dot(margin.along).abs() <= retention && drop.v.length() < STUCK_SPEED * REST_SPEED;
        if !(tip || (not_lower(reach) && not_lower(-reach)) || stuck) {
            return false;
        }
        let radius = if tip { params.tip_radius } else { cap.a.min(MAX_PENDANT_RADIUS) };
        // The table of largest pendant volumes covers this range of radii.
        let bounds = RADII.map(|r| r * params.wetting.capillary);
        let radius = radius.clamp(bounds[0], bounds[1]);
        drop.detach();
        drop.pendant = Some(PendantAnchor { margin: *margin, radius, outward, necking: None });
        drop.v = DVec3::ZERO;
        drop.lean = 0.0;
        drop.merge_tested = false;
        true
    }

    /// Advances a pendant drop: it runs back onto a leaf that has tipped over; one too heavy for its attachment necks for
    /// [`NECKING_TIME`], then most of it detaches. Source: Tate 1864; Harkins and Brown 1919.
    pub(super) fn step_pendant(&self, drop: &mut SurfaceDrop, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let Some(mut pendant) = drop.pendant else { return };
        let point = step.world_point(pendant.margin.p);
        let g = effective_gravity(step, pendant.margin.p);
        drop.axis = g.normalize_or(drop.axis);
        if g.dot(pendant.outward) < -TIPPED_OVER * g.length() && self.run_back(drop, &pendant) {
            return;
        }
        let largest = max_pendant_volume(pendant.radius, g.length());
        if drop.volume <= largest {
            pendant.necking = None;
        } else {
            let necking = pendant.necking.unwrap_or(0.0) + step.h;
            pendant.necking = Some(necking);
            if necking >= NECKING_TIME {
                let volume = (DETACHED_FRACTION * largest).min(drop.volume);
                drop.volume -= volume;
                pendant.necking = None;
                // The detached drop starts below the attachment, at the length of a cylinder of the largest volume.
                let length = largest / (std::f64::consts::PI * pendant.radius * pendant.radius);
                let p = point + (step.pose.orientation * drop.axis) * length.min(MAX_PENDANT_LENGTH);
                let v = step.pose.velocity_at(point);
                let is_whole = drop.volume <= 0.0;
                result.detached.push(DetachedDrop { id: drop.id, p, v, volume, is_whole });
                result.counters.fell += 1;
            }
        }
        drop.pendant = Some(pendant);
    }

    /// Moves a pendant drop back onto the blade, just inside its attachment; false if no surface is found there.
    fn run_back(&self, drop: &mut SurfaceDrop, pendant: &PendantAnchor) -> bool {
        let inside = pendant.margin.p - pendant.outward * (RETURN_INSET * pendant.radius);
        let uv = self.sheet.margin_uv(&pendant.margin);
        // Texture coordinates on the margin itself may round to outside of it: look a little towards the middle.
        let toward_middle = DVec2::splat(0.5) - uv;
        let Some(surface) = self.at(uv + toward_middle * 1e-3) else { return false };
        let back = uv + surface.uv(inside - surface.p);
        drop.uv = if self.at(back).is_some() { back } else { uv + toward_middle * 1e-2 };
        drop.detach();
        drop.axis = -pendant.outward;
        true
    }

    /// A point of the blade near a drop whose own coordinates are beyond it, m of leaf space.
    pub(super) fn nearby_point(&self, drop: &SurfaceDrop) -> DVec3 {
        let near = drop.uv.clamp(DVec2::splat(0.01), DVec2::splat(0.99));
        self.at(near).map_or(DVec3::ZERO, |s| s.p)
    }

    /// Detaches a whole drop from a position, m, with a velocity, m/s, both of leaf space.
    pub(super) fn release(
        &self,
        drop: &mut SurfaceDrop,
        step: &LeafStep<'_>,
        position: DVec3,
        velocity: DVec3,
        result: &mut LeafStepResult,
    ) {
        let p = step.world_point(position);
        let v = step.pose.velocity_at(p) + step.pose.orientation * velocity;
        result.detached.push(DetachedDrop { id: drop.id, p, v, volume: drop.volume, is_whole: true });
        result.counters.fell += 1;
        drop.volume = 0.0;
    }
}
