//! One step of all drops on a leaf, and the loads that they put on it.

use glam::DVec3;

use super::rain_leaf::{AttachedWater, LeafStep, LeafStepResult, PointForce, PointImpulse, RainLeaf, WetSpot};
use super::retention::StepConstants;
use super::spherical_cap::SphericalCap;
use super::surface_drop::LeafDrop;
use crate::rain::event::{DropEventKind, RainEvent};
use crate::rain::params::DropWeightTorque;
use crate::rain::tuning::{
    MAX_DROP_SHIFT, MAX_REST_STEP, MAX_RUN_STEP, MAX_SUBSTEPS, MIN_BEAD_RADIUS, MIN_CAP_RADIUS, TRACK_DISTANCE,
    WET_MARK_INTERVAL,
};
use osier_base::physics::WATER_DENSITY;
use osier_base::rng::Rng;

impl RainLeaf {
    /// Advances all drops by one step, in substeps: pendant drops neck and detach, sessile drops rest or run and deposit beads; then
    /// drops that touch merge. At the end the water's loads are collected.
    pub fn step_drops(&mut self, step: &LeafStep<'_>) -> LeafStepResult {
        let mut result = LeafStepResult::default();
        let constants = &StepConstants::new(self, step.params);
        // The blade may have changed since the last step.
        self.drops.iter_mut().for_each(|drop| drop.set_located_surface(None));
        let substeps = self.substeps(constants, step);
        let h = step.h / f64::from(substeps);
        for k in 1..=substeps {
            let t = step.t - f64::from(substeps - k) * h;
            self.advance_drops(constants, &LeafStep { t, h, ..*step }, &mut result);
        }
        self.collect_loads(step, &mut result);
        result
    }

    /// Number of substeps, so many that no drop can run past another within one.
    fn substeps(&self, constants: &StepConstants, step: &LeafStep<'_>) -> u32 {
        let running = |drop: &LeafDrop| {
            let reach = MAX_DROP_SHIFT * drop.head_cap_by_law(&constants.cap_law, step.params).a.max(MIN_CAP_RADIUS);
            step.h * (drop.v.length() / reach).max(1.0 / MAX_RUN_STEP)
        };
        let running_drops = self.drops.iter().filter(|drop| drop.pendant.is_none() && drop.v != DVec3::ZERO);
        let needed = running_drops.map(running).fold(step.h / MAX_REST_STEP, f64::max);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let substeps = needed.ceil().clamp(1.0, f64::from(MAX_SUBSTEPS)) as u32;
        substeps
    }

    /// Advances all drops by one substep, adds beads, removes drops that have detached as a whole, and merges drops that touch.
    fn advance_drops(&mut self, constants: &StepConstants, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let mut drops = std::mem::take(&mut self.drops);
        // The order of drops determines the order of events and mergers, so it must not depend on how they came to the leaf.
        drops.sort_by_key(|d| d.id);
        let attractions = self.attractions(&drops, step.params);
        let mut beads: Vec<LeafDrop> = Vec::new();
        for (drop, attraction) in drops.iter_mut().zip(attractions) {
            if drop.pendant.is_some() {
                self.step_pendant(drop, step, result);
            } else {
                let cap = drop.update_head_cap(&constants.cap_law, step.params);
                self.step_sessile(drop, &cap, attraction, constants, step, result);
                self.resize_tail(drop, &cap, step, &mut beads, result);
                drop.update_head_cap(&constants.cap_law, step.params);
            }
        }
        // Drops that have detached as a whole have no volume left.
        drops.retain(|d| d.volume > 0.0);
        drops.append(&mut beads);
        self.merge_drops(&mut drops, step, result);
        self.drops = drops;
        self.mark_wet_spots(step, result);
    }

    /// Lets the tail of a sessile drop grow or shrink. Where a tail of full caps begins to shrink, its last cap stays on the leaf as a
    /// bead with probability [`DropParams::bead_probability`](crate::rain::DropParams::bead_probability). `cap`: the cap of its head.
    fn resize_tail(
        &self,
        drop: &mut LeafDrop,
        cap: &SphericalCap,
        step: &LeafStep<'_>,
        beads: &mut Vec<LeafDrop>,
        result: &mut LeafStepResult,
    ) {
        if drop.volume <= 0.0 || drop.pendant.is_some() {
            return;
        }
        let after = drop.tail_count_after(step.h, cap.a, step.params);
        // Whether a bead stays is drawn at each whole number of caps that the count passes, so that it does not depend on the time step.
        let before = drop.tail_count;
        let mut full = before.floor();
        while full > after.max(1.0) {
            drop.tail_count = full;
            if let Some(bead) = self.shed_bead(drop, step, result) {
                beads.push(bead);
                drop.tail_count = full - 1.0;
            }
            full -= 1.0;
        }
        drop.tail_count = if after > before { after } else { after.min(drop.tail_count) };
    }

    /// Makes the last cap of a drop's tail a bead, by chance and if it is large enough. The bead takes its water from the drop.
    fn shed_bead(&self, drop: &mut LeafDrop, step: &LeafStep<'_>, result: &mut LeafStepResult) -> Option<LeafDrop> {
        let params = step.params;
        let bead = drop.caps(params).pop().filter(|b| b.cap.r > MIN_BEAD_RADIUS)?;
        // The address holds the drop and the number of its draws so far, so that other drops do not change the result.
        let address = ["drop".into(), drop.id.into(), "bead".into(), drop.bead_draws.into()];
        let mut draw = Rng::at(params.seed, &address);
        drop.bead_draws += 1;
        if !draw.chance(params.bead_probability) {
            return None;
        }
        let surface = self.point_at(bead.uv)?;
        let p = step.world_point(surface.p);
        drop.volume -= bead.volume;
        // The bead is at rest: it gives its momentum to the leaf.
        result.record_reaction(step, p, -drop.v * (WATER_DENSITY * bead.volume));
        // Its identifier has the highest bit set, which emitted drops never have.
        let id = draw.next_u64() | (1 << 63);
        let mut deposited = LeafDrop::new(id, drop.side, bead.uv, DVec3::ZERO, bead.volume);
        deposited.axis = drop.axis;
        result.counters.beads += 1;
        let event = RainEvent::new(DropEventKind::Bead, id, step.t, p, bead.volume);
        result.events.push(RainEvent { other: Some(drop.id), ..event });
        Some(deposited)
    }

    /// Collects the mass and center of mass of the water on the leaf, and the forces of drops beyond their weight and inertia.
    /// Source: [yang-wu] eq. 14 and 15, as forces.
    fn collect_loads(&self, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let (mut mass, mut moment) = (0.0, DVec3::ZERO);
        for drop in &self.drops {
            let local = match drop.pendant {
                Some(pendant) => Some(pendant.margin.p),
                None => self.surface_under(drop).map(|s| s.p),
            };
            let Some(local) = local else { continue };
            let point = step.world_point(local);
            let m = WATER_DENSITY * drop.volume;
            // The weight acts through the attached mass; only the difference that the paper adds needs a separate force.
            let excess = DVec3::NEG_Y * (m * step.params.g * (self.lever_factor(local, step) - 1.0));
            if excess != DVec3::ZERO {
                result.forces.push(PointForce { point, force: excess });
            }
            mass += m;
            moment += point * m;
        }
        let center = if mass > 0.0 { moment / mass } else { step.pose.position };
        result.attached = AttachedWater { mass, center };
        // Reactions become forces over the next step: the same impulse, without a jolt of the leaf.
        for PointImpulse { point, impulse } in std::mem::take(&mut result.reactions) {
            let local = step.pose.orientation.inverse() * (point - step.pose.position);
            result.forces.push(PointForce { point, force: impulse * (self.lever_factor(local, step) / step.h) });
        }
    }

    /// Factor on the loads at a point of leaf space. The point of application already contains the lever arm; the paper
    /// multiplies by the arm once more.
    fn lever_factor(&self, local: DVec3, step: &LeafStep<'_>) -> f64 {
        match step.params.lever {
            DropWeightTorque::Physical => 1.0,
            DropWeightTorque::Paper(most) => (local.length() / self.leaf_reach()).min(most),
        }
    }

    /// Largest distance of a vertex of the leaf from the end of its stalk, m; at least 1 micrometre.
    fn leaf_reach(&self) -> f64 {
        self.blade.points().iter().fold(1e-6, |m: f64, p| m.max(p.length())) * self.scale
    }

    /// Records that a running drop of base radius `a`, m, at `p`, in leaf space, m, wets the leaf there; does nothing until the
    /// drop has moved on by a fraction of its radius.
    pub(super) fn mark_wet_trail(
        &self,
        drop: &mut LeafDrop,
        p: DVec3,
        a: f64,
        step: &LeafStep<'_>,
        result: &mut LeafStepResult,
    ) {
        if drop.last_wet_p.is_some_and(|last| last.distance(p) < WET_MARK_INTERVAL * a) {
            return;
        }
        let from = drop.last_wet_uv.unwrap_or(drop.uv);
        result.wet_spots.push(WetSpot { uv: drop.uv, from, a, t: step.t });
        drop.last_wet_uv = Some(drop.uv);
        drop.last_wet_p = Some(p);
        // Only tracks well behind a running drop act on drops, so that the water that a drop spreads does not act on itself.
        result.tracks.extend(drop.place_behind(TRACK_DISTANCE * a).map(|uv| WetSpot { uv, from: uv, a, t: step.t }));
    }

    /// Records the places of drops that are new on the leaf, and marks the tracks of running drops in the wetness grid.
    fn mark_wet_spots(&mut self, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        for drop in self.drops.iter_mut().filter(|d| d.pendant.is_none() && d.last_wet_uv.is_none()) {
            drop.last_wet_uv = Some(drop.uv);
            drop.last_wet_p = self.blade.point_at(drop.uv, self.scale).map(|surface| surface.p);
            result.wet_spots.push(WetSpot { uv: drop.uv, from: drop.uv, a: drop.head_cap(step.params).a, t: step.t });
        }
        for WetSpot { uv, a, t, .. } in std::mem::take(&mut result.tracks) {
            if let Some(surface) = self.point_at(uv) {
                self.wetness_grid.mark_covered(uv, surface.max_uv_rate() * a, t);
            }
        }
    }
}
