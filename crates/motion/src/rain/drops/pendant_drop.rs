//! Pendant drops: when a drop at the margin becomes pendant, and how it necks and detaches.

use glam::{DVec2, DVec3};

use super::pendant_profile::{RADIUS_RANGE, max_pendant_volume};
use super::rain_leaf::{DetachedDrop, LeafStep, LeafStepResult, RainLeaf};
use super::retention::{EffectiveGravity, dry_retention, effective_gravity};
use super::spherical_cap::SphericalCap;
use super::surface_drop::{LeafDrop, PendantAnchor};
use crate::rain::leaf::surface::MarginPoint;
use crate::rain::tuning::{
    DETACHED_FRACTION, LEVEL_TOLERANCE, LOW_POINT_REACH, MARGIN_UV_SHIFT, MAX_PENDANT_LENGTH, MAX_PENDANT_RADIUS,
    NECKING_TIME, RETURN_INSET, RETURN_UV_SHIFT, STUCK_SPEED, TIPPED_OVER,
};
use osier_base::physics::WATER_DENSITY;

impl RainLeaf {
    /// Makes a drop at the margin pendant if gravity across the edge exceeds retention, and the drop is at the tip or at a low point
    /// of the margin, or no force drives it along the margin. Returns whether it is pendant now.
    pub(super) fn try_become_pendant(
        &self,
        drop: &mut LeafDrop,
        gravity: &EffectiveGravity,
        cap: &SphericalCap,
        margin: &MarginPoint,
        outward: DVec3,
        step: &LeafStep<'_>,
    ) -> bool {
        let params = step.params;
        let m = WATER_DENSITY * drop.volume;
        let retention = dry_retention(params, cap.a);
        // Half of the weight as upper limit: retention would hold a small drop anywhere, but it still hangs from a steep edge.
        if m * gravity.tangential.dot(outward) <= retention.min(0.5 * m * gravity.total.length()) {
            return false;
        }
        // The drop stays where neither direction along the margin leads further down.
        let down = gravity.total.normalize_or_zero();
        let reach = cap.a.max(LOW_POINT_REACH);
        let not_lower =
            |offset: f64| (self.blade.walk_margin(margin, offset, self.scale) - margin.p).dot(down) < LEVEL_TOLERANCE;
        let at_tip = self.blade.is_tip(margin.p, self.scale, reach);
        let stuck = m * gravity.tangential.dot(margin.tangent).abs() <= retention && drop.v.length() < STUCK_SPEED;
        if !(at_tip || (not_lower(reach) && not_lower(-reach)) || stuck) {
            return false;
        }
        let radius = if at_tip { params.tip_radius } else { cap.a.min(MAX_PENDANT_RADIUS) };
        // The table of maximum pendant volumes covers this range of radii.
        let bounds = RADIUS_RANGE.map(|r| r * params.wetting.capillary_length);
        let radius = radius.clamp(bounds[0], bounds[1]);
        drop.clear_history();
        drop.pendant = Some(PendantAnchor { margin: *margin, radius, outward, necking: None, max_volume: 0.0 });
        drop.v = DVec3::ZERO;
        drop.lean = 0.0;
        drop.merge_tested = false;
        true
    }

    /// Advances a pendant drop: it returns to a blade that has tipped over; if its volume exceeds the maximum for its attachment, it
    /// necks for [`NECKING_TIME`], then most of it detaches. Source: Tate 1864; Harkins and Brown 1919.
    pub(super) fn step_pendant(&self, drop: &mut LeafDrop, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let Some(mut pendant) = drop.pendant else { return };
        let point = step.world_point(pendant.margin.p);
        let g = effective_gravity(step, pendant.margin.p);
        drop.axis = g.normalize_or(drop.axis);
        if g.dot(pendant.outward) < -TIPPED_OVER * g.length() && self.return_to_blade(drop, &pendant) {
            return;
        }
        // Gravity less the acceleration of the leaf: upward acceleration decreases the maximum volume.
        let max_volume = max_pendant_volume(pendant.radius, g.length());
        // The excess over it is taken as linear in time, so that the necking does not depend on the step.
        let [before, after] = [pendant.max_volume, max_volume].map(|max| drop.volume - max);
        let crossing = before / (before - after);
        let exceeded = match (before > 0.0, after > 0.0) {
            (true, true) => 1.0,
            (false, true) => 1.0 - crossing,
            (true, false) => crossing,
            (false, false) => 0.0,
        };
        let earlier = pendant.necking.filter(|_| before > 0.0).unwrap_or(0.0);
        let necking = earlier + exceeded * step.h;
        pendant.necking = (after > 0.0).then_some(necking);
        pendant.max_volume = max_volume;
        if exceeded > 0.0 && necking >= NECKING_TIME {
            // Tate's law with Harkins and Brown's correction: a fixed fraction of the maximum falls.
            let volume = DETACHED_FRACTION * max_volume.min(drop.volume);
            drop.volume -= volume;
            pendant.necking = None;
            // The detached drop starts below the attachment, at the length of a cylinder of the maximum volume.
            let length = max_volume / (std::f64::consts::PI * pendant.radius * pendant.radius);
            let p = point + (step.pose.orientation * drop.axis) * length.min(MAX_PENDANT_LENGTH);
            let v = step.pose.velocity_at(point);
            result.detached.push(DetachedDrop { id: drop.id, p, v, volume, is_whole: false });
            result.counters.detachments += 1;
        }
        drop.pendant = Some(pendant);
    }

    /// Moves a pendant drop back onto the blade, just inside its attachment. Returns false, and leaves it, if no surface is there.
    fn return_to_blade(&self, drop: &mut LeafDrop, pendant: &PendantAnchor) -> bool {
        let inside = pendant.margin.p - pendant.outward * (RETURN_INSET * pendant.radius);
        let uv = self.blade.uv_of_margin_point(&pendant.margin);
        // Texture coordinates on the margin may round to outside of the blade: look slightly towards the middle.
        let toward_middle = DVec2::splat(0.5) - uv;
        let Some(surface) = self.point_at(uv + toward_middle * MARGIN_UV_SHIFT) else { return false };
        let back = uv + surface.uv_offset(inside - surface.p);
        drop.uv = if self.point_at(back).is_some() { back } else { uv + toward_middle * RETURN_UV_SHIFT };
        drop.clear_history();
        drop.axis = -pendant.outward;
        true
    }

    /// A point of the blade near a drop that is beyond it, in leaf space, m; the end of the stalk if none is found.
    pub(super) fn clamped_blade_point(&self, drop: &LeafDrop) -> DVec3 {
        let near = drop.uv.clamp(DVec2::splat(0.01), DVec2::splat(0.99));
        self.point_at(near).map_or(DVec3::ZERO, |s| s.p)
    }

    /// Detaches a whole drop at a position, m, with a velocity relative to the leaf, m/s, both in leaf space.
    pub(super) fn detach_whole(
        &self,
        drop: &mut LeafDrop,
        step: &LeafStep<'_>,
        position: DVec3,
        velocity: DVec3,
        result: &mut LeafStepResult,
    ) {
        let p = step.world_point(position);
        let v = step.pose.velocity_at(p) + step.pose.orientation * velocity;
        result.detached.push(DetachedDrop { id: drop.id, p, v, volume: drop.volume, is_whole: true });
        result.counters.detachments += 1;
        drop.volume = 0.0;
    }
}
