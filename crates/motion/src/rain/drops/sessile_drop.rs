//! Sessile drops: when they stay pinned, how they run over the leaf, and what happens to them at the margin.

use std::f64::consts::PI;
use std::sync::LazyLock;

use glam::DVec3;

use super::rain_leaf::{LeafStep, LeafStepResult, RainLeaf};
use super::retention::{EffectiveGravity, StepConstants, SurfaceForces, pinning_noise};
use super::spherical_cap::SphericalCap;
use super::surface_drop::LeafDrop;
use crate::rain::leaf::surface::{MarginPoint, SurfacePoint};
use crate::rain::tuning::{
    AXIS_TURN_TIME, MARGIN_DISTANCE, MARGIN_ESCAPE_SPEED, MARGIN_INSET, MAX_RUN_SEGMENTS, MAX_SEGMENT_TURN,
    MIN_CAP_RADIUS, MIN_SEGMENT_TIME, SEGMENT_LENGTH, SEGMENTS_PER_DECAY_TIME, STEER_DIRECTIONS, STEER_DOWNHILL,
    STEER_INTERVAL, STEER_LOOKAHEAD, STEER_NOISE, STEER_NOISE_SCALE, STEER_TOLERANCE, STEER_VEIN, STEER_WETNESS,
    STOP_SPEED,
};
use osier_base::math;
use osier_base::physics::{WATER_DENSITY, WATER_SURFACE_TENSION};

impl RainLeaf {
    /// Advances a sessile drop: it detaches, rests or runs. `cap`: the cap of its head. `attraction`: force of other drops on it,
    /// in leaf space, N.
    pub(super) fn step_sessile(
        &self,
        drop: &mut LeafDrop,
        cap: &SphericalCap,
        attraction: DVec3,
        constants: &StepConstants,
        step: &LeafStep<'_>,
        result: &mut LeafStepResult,
    ) {
        drop.since_merge += step.h;
        let (before, m) = (drop.v, WATER_DENSITY * drop.volume);
        let start = self.surface_under(drop);
        match start {
            Some(start) => {
                let end = self.run_drop(drop, start, cap, attraction, constants, step, result);
                drop.set_located_surface(Some(end));
            }
            None => self.detach_whole(drop, step, self.clamped_blade_point(drop), drop.v, result),
        }
        // The whole gain of momentum relative to the leaf is a reaction, since the attached water already puts the weight of the
        // drop on the leaf; see [`PointImpulse`].
        let point = step.world_point(start.map_or_else(|| self.clamped_blade_point(drop), |s| s.p));
        result.record_reaction(step, point, (drop.v - before) * m);
    }

    /// Runs a drop for the step in segments of constant force. Each ends where the drop stops, where it chooses a new heading, or
    /// after a fraction of its radius, so that the drop passes neither the margin nor the end of the step unnoticed. `start`: the
    /// surface under the drop. Returns the last surface under it on the upper or lower side.
    fn run_drop(
        &self,
        drop: &mut LeafDrop,
        start: SurfacePoint,
        cap: &SphericalCap,
        attraction: DVec3,
        constants: &StepConstants,
        step: &LeafStep<'_>,
        result: &mut LeafStepResult,
    ) -> SurfacePoint {
        let params = step.params;
        let mut surface = start;
        let mut left = step.h;
        // How far the drop can move before it can come near the margin.
        let mut clearance = 0.0;
        for _ in 0..MAX_RUN_SEGMENTS {
            let gravity = self.surface_gravity(&surface, drop.side, step);
            let m = WATER_DENSITY * drop.volume;
            // Adhesion normal to the surface: surface tension around the contact line, 2 pi a gamma sin(receding).
            let adhesion = 2.0 * PI * cap.a * WATER_SURFACE_TENSION * constants.sin_receding;
            if -m * gravity.onto > adhesion {
                self.detach_whole(drop, step, surface.p + gravity.normal * cap.top(), drop.v, result);
                break;
            }
            // The surface has curved since the last segment: keep the velocity tangential.
            drop.v -= gravity.normal * drop.v.dot(gravity.normal);
            let mut forces = self.surface_forces(drop, cap, &surface, &gravity, attraction, constants, step);
            drop.lean = forces.lean;
            if drop.v.length() <= STOP_SPEED && forces.stays_at_rest() {
                drop.v = DVec3::ZERO;
                drop.turn_axis_downhill(forces.drive.normalize_or(drop.axis), left);
                break;
            }
            drop.merge_tested = false;
            let reach = SEGMENT_LENGTH * cap.a.max(MIN_CAP_RADIUS);
            if clearance < 2.0 * MARGIN_DISTANCE * cap.a + reach {
                let margin = self.blade.nearest_margin(surface.p, self.scale);
                clearance = margin.map_or(f64::INFINITY, |margin| margin.distance);
                drop.at_margin &= clearance < 2.0 * MARGIN_DISTANCE * cap.a;
                if let Some(margin) = margin.filter(|_| clearance < MARGIN_DISTANCE * cap.a) {
                    let outward = outward_at(&margin, &surface, drop.side);
                    if self.meet_margin(drop, &gravity, cap, &surface, &margin, step, result) {
                        break;
                    }
                    // The edge also takes up the component of the force across it.
                    forces.drive -= outward * forces.drive.dot(outward).max(0.0);
                    if drop.v.length() <= STOP_SPEED && forces.stays_at_rest() {
                        drop.v = DVec3::ZERO;
                        break;
                    }
                }
            }
            let farthest = reach.min((STEER_INTERVAL * cap.a - drop.since_steer).max(STEER_TOLERANCE * cap.a));
            let segment = RunSegment::new(drop.v, &forces, m, params.velocity_decay_time, left, farthest);
            let Some(end) = self.follow_segment(drop, &segment, &surface, &gravity, cap, step, result) else { break };
            surface = end;
            drop.axis = drop.v.normalize_or(drop.axis);
            self.mark_wet_trail(drop, surface.p, cap.a, step, result);
            if drop.since_steer >= (STEER_INTERVAL - STEER_TOLERANCE) * cap.a {
                self.steer(drop, &surface, &gravity, cap, constants, step);
                drop.since_steer = 0.0;
            }
            clearance -= segment.shift.length();
            left -= segment.duration;
            if left <= 0.0 {
                break;
            }
        }
        surface
    }

    /// Moves a drop by a segment of its run. A drop whose segment ends beyond the blade stays at the margin, detaches or becomes
    /// pendant. Returns the surface under the drop; `None` if it has left the upper or lower side.
    fn follow_segment(
        &self,
        drop: &mut LeafDrop,
        segment: &RunSegment,
        surface: &SurfacePoint,
        gravity: &EffectiveGravity,
        cap: &SphericalCap,
        step: &LeafStep<'_>,
        result: &mut LeafStepResult,
    ) -> Option<SurfacePoint> {
        // Map the displacement to texture coordinates by the tangent plane here.
        let next = drop.uv + surface.uv_offset(segment.shift);
        drop.v = segment.v;
        if let Some(there) = self.point_at(next) {
            drop.record_path(drop.uv, segment.shift.length(), cap.a, step.params);
            drop.uv = next;
            // Follow the curvature of the surface at constant speed.
            let n = there.n * drop.side;
            let speed = drop.v.length();
            drop.v = (drop.v - n * drop.v.dot(n)).normalize_or_zero() * speed;
            return Some(there);
        }
        // The segment would end beyond the margin: move the drop slightly inward, and let it continue along the margin.
        let Some(margin) = self.blade.nearest_margin(surface.p, self.scale) else { return Some(*surface) };
        let outward = outward_at(&margin, surface, drop.side);
        if self.meet_margin(drop, gravity, cap, surface, &margin, step, result) {
            return None;
        }
        drop.v = margin.tangent * drop.v.dot(margin.tangent);
        let inside = drop.uv + surface.uv_offset(-outward * (MARGIN_INSET * cap.a));
        let Some(there) = self.point_at(inside) else { return Some(*surface) };
        drop.uv = inside;
        Some(there)
    }

    /// Lets the margin act on a drop close to it: fast drops leave the leaf, others become pendant or lose their speed across it.
    /// Returns whether the drop has left the upper or lower side.
    fn meet_margin(
        &self,
        drop: &mut LeafDrop,
        gravity: &EffectiveGravity,
        cap: &SphericalCap,
        surface: &SurfacePoint,
        margin: &MarginPoint,
        step: &LeafStep<'_>,
        result: &mut LeafStepResult,
    ) -> bool {
        let outward = outward_at(margin, surface, drop.side);
        let across = drop.v.dot(outward);
        // The inertia of fast drops exceeds the retention of the edge.
        if across > MARGIN_ESCAPE_SPEED {
            self.detach_whole(drop, step, margin.p, drop.v, result);
            return true;
        }
        // The edge stops the motion across it; the component along the edge remains.
        drop.v -= outward * across.max(0.0);
        result.record_margin_contact(step, drop, surface.p);
        let hangs = self.try_become_pendant(drop, gravity, cap, margin, outward, step);
        if hangs {
            result.record_hung_event(step, drop, margin.p);
        }
        hangs
    }

    /// Turns a running drop to the best of a ring of directions by a weighted sum of terms: straight on, downhill, towards wet
    /// surface, along veins, and noise. `surface`: under the drop. Source: own; [yang-wu] gives no rule.
    fn steer(
        &self,
        drop: &mut LeafDrop,
        surface: &SurfacePoint,
        gravity: &EffectiveGravity,
        cap: &SphericalCap,
        constants: &StepConstants,
        step: &LeafStep<'_>,
    ) {
        let params = step.params;
        let (heading, downhill) = (drop.v.normalize_or_zero(), gravity.tangential.normalize_or_zero());
        let across = gravity.normal.cross(heading);
        let lookahead = STEER_LOOKAHEAD * cap.a;
        let mut wetness = self.wetness_grid.reader(step.t, params.drying_law());
        let mut score = |turn: &UnitTurn| {
            let d = heading * turn.cos + across * turn.sin;
            let ahead = drop.uv + surface.uv_offset(d * lookahead);
            let wet = wetness.wetness(ahead);
            let vein = self.blade.vein_depth(ahead);
            let noise = pinning_noise(constants.pinning_key, ahead * STEER_NOISE_SCALE);
            d.dot(heading)
                + STEER_DOWNHILL * d.dot(downhill)
                + STEER_WETNESS * wet
                + STEER_VEIN * vein
                + STEER_NOISE * params.retention_variation * noise
        };
        let scores = STEER_TURNS.each_ref().map(&mut score);
        let n = scores.len();
        let best = (0..n).fold(0, |best, k| if scores[k] > scores[best] { k } else { best });
        // The maximum of the parabola through the best score and its neighbours: the heading then changes continuously with the place.
        let (before, here, after) = (scores[(best + n - 1) % n], scores[best], scores[(best + 1) % n]);
        let curvature = 2.0 * here - before - after;
        let offset = if curvature > 0.0 { 0.5 * (after - before) / curvature } else { 0.0 };
        let best = UnitTurn::new(STEER_SPACING * (best as f64 + offset));
        let best = heading * best.cos + across * best.sin;
        // Only the component of the velocity in the new direction remains; turning does not create speed.
        drop.v = best * (drop.v.length() * best.dot(heading).max(0.0));
    }
}

impl LeafDrop {
    /// Turns the axis of a resting drop towards `downhill`, a unit tangent, for `h` seconds.
    fn turn_axis_downhill(&mut self, downhill: DVec3, h: f64) {
        let across = downhill - self.axis * self.axis.dot(downhill);
        self.axis = (self.axis + across * (1.0 - math::exp(-h / AXIS_TURN_TIME))).normalize_or(downhill);
    }
}

/// Unit tangent of the blade across its margin, outwards, at a point close to it on a side of the blade.
fn outward_at(margin: &MarginPoint, surface: &SurfacePoint, side: f64) -> DVec3 {
    (margin.p - surface.p).normalize_or((surface.n * side).cross(margin.tangent))
}

/// Angle between neighbouring directions that a running drop compares, rad.
const STEER_SPACING: f64 = 2.0 * PI / STEER_DIRECTIONS as f64;

/// The turns from the heading to the directions that are compared, the straight one first.
static STEER_TURNS: LazyLock<[UnitTurn; STEER_DIRECTIONS as usize]> =
    LazyLock::new(|| std::array::from_fn(|k| UnitTurn::new(STEER_SPACING * k as f64)));

/// Cosine and sine of a turn of the heading, in the tangent plane.
#[derive(Debug, Clone, Copy, PartialEq)]
struct UnitTurn {
    cos: f64,
    sin: f64,
}

impl UnitTurn {
    fn new(angle: f64) -> Self {
        Self { cos: math::cos(angle), sin: math::sin(angle) }
    }
}

/// A short piece of a run, over which the driving force, friction and heading are constant.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RunSegment {
    /// Duration of the segment, s; shorter than requested if friction stops the drop.
    duration: f64,
    /// Displacement along the tangent plane, m.
    shift: DVec3,
    /// Velocity at the end, m/s.
    v: DVec3,
}

impl RunSegment {
    /// The motion of a drop of mass `m`, kg, from the velocity `v`, m/s, for at most `longest`, s, and `farthest`, m, both positive. It
    /// ends earlier if friction stops the drop. `tau`: time constant of viscous decay, s.
    ///
    /// Along the heading the solution of dv/dt = f - v / tau is exact for any duration: v(t) = tau f + (v0 - tau f) e^(-t/tau). The
    /// force across it bends the path; the segment is short enough for that to be a small angle.
    fn new(v: DVec3, forces: &SurfaceForces, m: f64, tau: f64, longest: f64, farthest: f64) -> Self {
        let drive = forces.drive / m;
        let start = v.length();
        let heading = v.normalize_or(drive.normalize_or_zero());
        let along = drive.dot(heading);
        let across = drive - heading * along;
        let terminal = tau * (along - forces.resistance / m);
        let mut duration = longest;
        let bend = across.length();
        if bend * longest > MAX_SEGMENT_TURN * start {
            let turning = (MAX_SEGMENT_TURN * start / bend).min(tau / SEGMENTS_PER_DECAY_TIME);
            duration = duration.min(turning.max(MIN_SEGMENT_TIME));
        }
        if terminal < 0.0 {
            // Dry friction wins: the drop comes to a stop at tau ln(1 + v0 / -terminal).
            duration = duration.min(tau * math::ln(1.0 - start / terminal));
        }
        let speed = |t: f64| (terminal + (start - terminal) * math::exp(-t / tau)).max(0.0);
        let distance = |t: f64| terminal * t + (start - terminal) * tau * (1.0 - math::exp(-t / tau));
        if distance(duration) > farthest {
            duration = time_of_distance(&distance, &speed, duration, farthest);
        }
        let decay = 1.0 - math::exp(-duration / tau);
        Self {
            duration,
            shift: heading * distance(duration) + across * (tau * (duration - tau * decay)),
            v: heading * speed(duration) + across * (tau * decay),
        }
    }
}

/// The time, s, at which an increasing `distance`, m, with derivative `speed`, m/s, reaches `target`; it does so before `longest`.
fn time_of_distance(distance: &impl Fn(f64) -> f64, speed: &impl Fn(f64) -> f64, longest: f64, target: f64) -> f64 {
    // Newton's method, with bisection where it leaves the bracket.
    let (mut lo, mut hi) = (0.0, longest);
    let mut t = longest * target / distance(longest);
    for _ in 0..60 {
        let excess = distance(t) - target;
        if excess.abs() <= 1e-12 * target {
            break;
        }
        if excess > 0.0 {
            hi = t;
        } else {
            lo = t;
        }
        let next = t - excess / speed(t).max(f64::MIN_POSITIVE);
        t = if next > lo && next < hi { next } else { 0.5 * (lo + hi) };
    }
    t
}
