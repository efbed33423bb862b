//! Sessile drops: when they stay pinned, how they run over the leaf, and what happens to them at the margin.

use std::f64::consts::PI;

use glam::DVec3;

use super::rain_leaf::{LeafStep, LeafStepResult, RainLeaf};
use super::retention::EffectiveGravity;
use super::spherical_cap::SphericalCap;
use super::surface_drop::SurfaceDrop;
use crate::rain::params::{DropParams, FrictionModel};
use crate::rain::tuning::{
    AXIS_TURN_TIME, DYNAMIC_RETENTION, MARGIN_DISTANCE, MARGIN_ESCAPE_SPEED, MARGIN_INSET, MAX_SUBSTEPS,
    MIN_CAP_RADIUS, REST_SPEED, STEER_DIRECTIONS, STEER_DOWNHILL, STEER_INTERVAL, STEER_LOOKAHEAD, STEER_NOISE,
    STEER_NOISE_SCALE, STEER_VEIN, STEER_WETNESS, SUBSTEP_LENGTH,
};
use osier_base::math;
use osier_base::physics::{WATER_DENSITY, WATER_SURFACE_TENSION};

/// Friction of [yang-wu] eq. 7 on a drop of mass `m`, kg: mu m g_n + H, N.
fn paper_friction(params: &DropParams, m: f64, gravity: &EffectiveGravity) -> f64 {
    params.friction_coefficient * m * gravity.onto.abs() + params.friction_force
}

impl RainLeaf {
    /// Advances a sessile drop: it detaches, rests or runs.
    pub(super) fn step_sessile(&self, drop: &mut SurfaceDrop, step: &LeafStep<'_>, result: &mut LeafStepResult) {
        let params = step.params;
        let Some(surface) = self.point_at(drop.uv) else {
            return self.detach_whole(drop, step, self.clamped_blade_point(drop), DVec3::ZERO, result);
        };
        let gravity = self.surface_gravity(&surface, drop.side, step);
        let m = WATER_DENSITY * drop.volume;
        drop.since_merge += step.h;
        // The paper's wedge shape depends on how far the drop's normal agrees with the vertical.
        let facing = (step.pose.orientation * gravity.normal).y.abs();
        let cap = drop.head_cap(params, facing);
        // Adhesion normal to the surface: surface tension around the contact line, 2 pi a gamma sin(receding).
        let adhesion = 2.0 * PI * cap.a * WATER_SURFACE_TENSION * math::sin(params.wetting.receding);
        if -m * gravity.onto > adhesion {
            return self.detach_whole(drop, step, surface.p + gravity.normal * cap.top(), drop.v, result);
        }
        // The surface has curved since the last step: keep the velocity tangential.
        drop.v -= gravity.normal * drop.v.dot(gravity.normal);
        let downhill = gravity.tangential.normalize_or(drop.axis);
        let force = m * gravity.tangential.length();
        let heading = if drop.v.length() > REST_SPEED { drop.v.normalize() } else { downhill };
        let retention = self.retention_force(drop, &cap, &surface, heading, step);
        // A drop leans in proportion to the load on its contact line, fully at the point of slipping.
        drop.lean = match params.friction {
            FrictionModel::Retention if retention > 0.0 => (force / retention).min(1.0),
            _ => 1.0,
        };
        // The footprint of a resting drop turns downhill slowly; that of a running drop points along its motion.
        let rests = drop.v.length() <= REST_SPEED;
        if rests {
            drop.v = DVec3::ZERO;
            let across = downhill - drop.axis * drop.axis.dot(downhill);
            drop.axis = (drop.axis + across * (step.h / AXIS_TURN_TIME).min(1.0)).normalize_or(downhill);
        } else {
            drop.axis = heading;
        }
        // Depinning: the drop moves once the force along the surface exceeds what holds it.
        let pinned = match params.friction {
            FrictionModel::Retention => force <= retention,
            FrictionModel::Paper => force <= paper_friction(params, m, &gravity),
        };
        if rests && pinned {
            drop.step_tail(cap.a, step.h, params);
            return;
        }
        self.accelerate(drop, &gravity, retention, &cap, step);
        self.move_along_surface(drop, &gravity, &cap, step, result);
    }

    /// Updates the velocity by gravity along the surface and friction against the motion; at intervals the drop chooses a new heading.
    fn accelerate(
        &self,
        drop: &mut SurfaceDrop,
        gravity: &EffectiveGravity,
        retention: f64,
        cap: &SphericalCap,
        step: &LeafStep<'_>,
    ) {
        let (h, params) = (step.h, step.params);
        let m = WATER_DENSITY * drop.volume;
        drop.merge_tested = false;
        drop.v += gravity.tangential * h;
        let friction = match params.friction {
            FrictionModel::Retention => {
                DYNAMIC_RETENTION * retention + params.friction_coefficient * m * gravity.onto.abs()
            }
            FrictionModel::Paper => paper_friction(params, m, gravity),
        };
        // Dry friction takes a constant h F / m, at most the whole speed; viscous drag v / tau is implicit, hence unconditionally
        // stable: v' = v / (1 + h / tau).
        let speed = drop.v.length();
        let new_speed = (speed - h * friction / m).max(0.0) / (1.0 + h / params.velocity_decay_time);
        drop.v = drop.v.normalize_or_zero() * new_speed;
        if new_speed <= REST_SPEED {
            drop.v = DVec3::ZERO;
        } else if drop.since_steer >= STEER_INTERVAL * cap.a {
            self.steer(drop, gravity, cap, step);
            drop.since_steer = 0.0;
        }
    }

    /// Turns a running drop to the best of a ring of directions by a weighted sum: straight on, downhill, towards wet surface, along
    /// veins, and noise. Source: own; [yang-wu] gives no rule.
    fn steer(&self, drop: &mut SurfaceDrop, gravity: &EffectiveGravity, cap: &SphericalCap, step: &LeafStep<'_>) {
        let params = step.params;
        let Some(surface) = self.point_at(drop.uv) else { return };
        let (heading, downhill) = (drop.v.normalize_or_zero(), gravity.tangential.normalize_or_zero());
        let across = gravity.normal.cross(heading);
        let lookahead = (drop.v.length() * step.h).max(STEER_LOOKAHEAD * cap.a);
        let (mut best_score, mut best) = (f64::NEG_INFINITY, heading);
        for k in 0..STEER_DIRECTIONS {
            let turn = 2.0 * PI * f64::from(k) / f64::from(STEER_DIRECTIONS);
            let d = heading * math::cos(turn) + across * math::sin(turn);
            let ahead = drop.uv + surface.uv_offset(d * lookahead);
            let wet = self.wetness_grid.wetness(ahead, step.t, params.drying_law());
            let vein = self.blade.vein_depth(ahead);
            let noise = self.pinning_noise(ahead * STEER_NOISE_SCALE, params);
            let score = d.dot(heading)
                + STEER_DOWNHILL * d.dot(downhill)
                + STEER_WETNESS * wet
                + STEER_VEIN * vein
                + STEER_NOISE * noise;
            if score > best_score {
                (best_score, best) = (score, d);
            }
        }
        // Only the component of the velocity in the new direction remains; turning does not create speed.
        drop.v = best * (drop.v.length() * best.dot(heading).max(0.0));
    }

    /// Moves a drop by its velocity in substeps of half a base radius, so that it cannot jump over the margin or a fold. At the margin
    /// it detaches, becomes pendant, or runs on along the margin.
    fn move_along_surface(
        &self,
        drop: &mut SurfaceDrop,
        gravity: &EffectiveGravity,
        cap: &SphericalCap,
        step: &LeafStep<'_>,
        result: &mut LeafStepResult,
    ) {
        let params = step.params;
        let distance = drop.v.length() * step.h;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let substeps =
            (distance / (SUBSTEP_LENGTH * cap.a.max(MIN_CAP_RADIUS))).ceil().clamp(1.0, f64::from(MAX_SUBSTEPS)) as u32;
        let h = step.h / f64::from(substeps);
        for _ in 0..substeps {
            let Some(surface) = self.point_at(drop.uv) else { return };
            let Some(margin) = self.blade.nearest_margin(surface.p, self.scale) else { return };
            drop.at_margin &= margin.distance < 2.0 * MARGIN_DISTANCE * cap.a;
            if margin.distance < MARGIN_DISTANCE * cap.a {
                // Fast drops leave the leaf: their inertia exceeds the retention of the edge.
                let n = surface.n * drop.side;
                let outward = (margin.p - surface.p).normalize_or(n.cross(margin.tangent));
                let across = drop.v.dot(outward);
                if across > MARGIN_ESCAPE_SPEED {
                    return self.detach_whole(drop, step, margin.p, drop.v, result);
                }
                // The edge stops the motion across it; what is left goes along it.
                drop.v -= outward * across.max(0.0);
                result.record_margin_contact(step, drop, surface.p);
                if self.try_become_pendant(drop, gravity, cap, &margin, outward, step) {
                    return result.record_pendant(step, drop, margin.p);
                }
            }
            // Map the displacement to texture coordinates by the tangent plane here.
            let shift = drop.v * h;
            let next = drop.uv + surface.uv_offset(shift);
            match self.point_at(next) {
                Some(there) => {
                    drop.record_path(drop.uv, shift.length(), cap.a, params);
                    drop.uv = next;
                    // Follow the curvature of the surface at constant speed.
                    let n = there.n * drop.side;
                    let speed = drop.v.length();
                    drop.v = (drop.v - n * drop.v.dot(n)).normalize_or_zero() * speed;
                }
                None => {
                    // The substep would end beyond the margin: keep the velocity along it and move slightly inward.
                    let outward = (margin.p - surface.p).normalize_or(surface.n.cross(margin.tangent));
                    let across = drop.v.dot(outward).max(0.0);
                    if across > MARGIN_ESCAPE_SPEED {
                        return self.detach_whole(drop, step, margin.p, drop.v, result);
                    }
                    drop.v = margin.tangent * drop.v.dot(margin.tangent);
                    result.record_margin_contact(step, drop, surface.p);
                    let inward = surface.uv_offset((surface.p - margin.p).normalize_or_zero() * (MARGIN_INSET * cap.a));
                    if self.point_at(drop.uv + inward).is_some() {
                        drop.uv += inward;
                    }
                    if self.try_become_pendant(drop, gravity, cap, &margin, outward, step) {
                        result.record_pendant(step, drop, margin.p);
                    }
                    return;
                }
            }
        }
    }
}
