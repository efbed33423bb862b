//! One step of all drops on a leaf, and the loads that they put on it.

use glam::DVec3;

use super::rain_leaf::{AttachedWater, LeafStep, LeafStepResult, PointForce, RainLeaf, WetSpot};
use super::surface_drop::SurfaceDrop;
use crate::rain::event::{DropEventKind, RainEvent};
use crate::rain::params::LeverArm;
use crate::rain::tuning::{DYNAMIC_RETENTION, MIN_BEAD_RADIUS, REST_SPEED, WET_MARK_INTERVAL};
use osier_base::physics::WATER_DENSITY;
use osier_base::rng::Rng;

impl RainLeaf {
    /// Advances all drops by one step: pendant drops neck and detach, sessile drops rest or run and deposit beads; then drops that
    /// touch merge, and the water's loads and wet spots are collected.
    pub fn step_drops(&mut self, step: &LeafStep<'_>) -> LeafStepResult {
        let mut result = LeafStepResult::default();
        let mut drops = std::mem::take(&mut self.drops);
        // The order of drops determines the order of events and mergers, so it must not depend on how they came to the leaf.
        drops.sort_by_key(|d| d.id);
        let mut beads: Vec<SurfaceDrop> = Vec::new();
        for drop in &mut drops {
            if drop.pendant.is_some() {
                self.step_pendant(drop, step, &mut result);
            } else {
                self.step_sessile(drop, step, &mut result);
                self.deposit_beads(drop, step, &mut beads, &mut result);
            }
        }
        // What has detached entirely has no volume left.
        drops.retain(|d| d.volume > 0.0);
        drops.append(&mut beads);
        self.merge_drops(&mut drops, step, &mut result);
        self.drops = drops;
        self.collect_loads(step, &mut result);
        self.mark_wet_spots(step, &mut result);
        result
    }

    /// Lets the tail of a sessile drop grow or shrink. A cap of the tail that vanishes stays on the leaf as a bead with probability
    /// [`DropParams::bead_probability`](crate::rain::DropParams::bead_probability).
    fn deposit_beads(
        &self,
        drop: &mut SurfaceDrop,
        step: &LeafStep<'_>,
        beads: &mut Vec<SurfaceDrop>,
        result: &mut LeafStepResult,
    ) {
        if drop.volume <= 0.0 || drop.pendant.is_some() {
            return;
        }
        let params = step.params;
        // The caps before the tail changes: the one that vanishes is among them.
        let a = drop.head_cap(params, 1.0).a;
        let tail = (drop.tail_count > 1.0).then(|| drop.caps(params, 1.0));
        let Some((lost, tail)) = drop.step_tail(a, step.h, params).zip(tail) else { return };
        let Some(bead) = tail.get(lost).filter(|b| b.cap.r > MIN_BEAD_RADIUS) else { return };
        // The draw is addressed by the drop and by how many it has made, so that other drops do not change it.
        let address = ["drop".into(), drop.id.into(), "bead".into(), drop.bead_draws.into()];
        let mut draw = Rng::at(params.seed, &address);
        drop.bead_draws += 1;
        if !draw.chance(params.bead_probability) || self.point_at(bead.uv).is_none() {
            return;
        }
        // The bead takes its water from the drop. Its identifier has the highest bit set, which emitted drops never have.
        drop.volume -= bead.volume;
        let id = draw.next_u64() | (1 << 63);
        let mut deposited = SurfaceDrop::new(id, drop.side, bead.uv, DVec3::ZERO, bead.volume);
        deposited.axis = drop.axis;
        result.counters.beads += 1;
        let p = self.point_at(bead.uv).map_or(step.pose.position, |s| step.world_point(s.p));
        let event = RainEvent::new(DropEventKind::Bead, id, step.t, p, bead.volume);
        result.events.push(RainEvent { other: Some(drop.id), ..event });
        beads.push(deposited);
    }

    /// Collects the mass and center of mass of the water on the leaf, and the forces of drops beyond their weight.
    /// Source: [yang-wu] eq. 14 and 15, as forces.
    fn collect_loads(&self, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let params = step.params;
        let (mut mass, mut moment) = (0.0, DVec3::ZERO);
        for drop in &self.drops {
            let local = match drop.pendant {
                Some(pendant) => Some(pendant.margin.p),
                None => self.point_at(drop.uv).map(|s| s.p),
            };
            let Some(local) = local else { continue };
            let point = step.world_point(local);
            let m = WATER_DENSITY * drop.volume;
            let weight = DVec3::NEG_Y * (m * params.g);
            // The lever arm is already in the point of application; the paper multiplies the weight by it once more.
            let lever = match params.lever {
                LeverArm::Physical => 1.0,
                LeverArm::Paper(most) => (local.length() / self.leaf_reach()).min(most),
            };
            let force = match self.point_at(drop.uv).filter(|_| drop.pendant.is_none() && drop.v.length() > REST_SPEED)
            {
                None => weight,
                Some(surface) => {
                    // A running drop slides along the leaf: it passes on the normal part of its weight, and along the leaf
                    // only the drag that slows it, at most the dynamic retention.
                    let n = step.pose.orientation * surface.n * drop.side;
                    let along = weight - n * weight.dot(n);
                    let drag =
                        (along.length() * DYNAMIC_RETENTION).min(m * drop.v.length() / params.velocity_decay_time);
                    n * weight.dot(n) + along.normalize_or_zero() * drag
                }
            };
            // The weight itself acts through the attached mass; only the difference is a force of its own.
            let excess = force * lever - weight;
            if excess != DVec3::ZERO {
                result.forces.push(PointForce { point, force: excess });
            }
            mass += m;
            moment += point * m;
        }
        let center = if mass > 0.0 { moment / mass } else { step.pose.position };
        result.attached = AttachedWater { mass, center };
    }

    /// Largest distance of a vertex of the leaf from the end of its stalk, m; at least 1 micrometre.
    fn leaf_reach(&self) -> f64 {
        self.blade.points().iter().fold(1e-6, |m: f64, p| m.max(p.length())) * self.scale
    }

    /// Records the spots that sessile drops have wetted since the last step, in the result for the maps and in the wetness grid.
    fn mark_wet_spots(&mut self, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        for k in 0..self.drops.len() {
            let drop = &self.drops[k];
            if drop.pendant.is_some() {
                continue;
            }
            let a = drop.head_cap(step.params, 1.0).a;
            let (Some(surface), uv) = (self.point_at(drop.uv), drop.uv) else { continue };
            let last = drop.last_wet_uv.and_then(|w| self.point_at(w));
            let moved = last.map_or(f64::INFINITY, |w| w.p.distance(surface.p));
            // A new spot only where the drop has moved on by a part of its radius: resting drops leave one spot.
            if moved > WET_MARK_INTERVAL * a {
                result.wet_spots.push(WetSpot { uv, a, t: step.t });
                // The grid is marked only where the drop has been: the wetness under it must not lower its own retention.
                if let Some(left) = drop.last_wet_uv {
                    self.wetness_grid.mark_covered(left, surface.max_uv_rate() * a, step.t);
                }
                self.drops[k].last_wet_uv = Some(uv);
            }
        }
    }
}
