//! One particle: its state and its step, by the corrected equations and as [hoetzlein] prints them.

use glam::DVec3;

use super::params::{ShapeParams, Variant};
use osier_base::math::{cos, exp, sin, sqrt};
use osier_base::rng::Rng;

/// A vector shorter than this has no direction.
const MIN_LENGTH: f64 = 1e-9;
/// The printed equations do not turn a velocity about a direction shorter than this.
const PAPER_MIN_AXIS: f64 = 1e-6;
/// Growth time of a step of the printed equations, t.
pub(super) const PAPER_STEP: f64 = 0.05;
/// With the printed equations a velocity above this multiple of `speed` is cut, because their direction can grow without bound.
const PAPER_MAX_SPEED: f64 = 4.0;

/// The tip of a growing axis.
#[derive(Debug, Clone)]
pub struct Particle {
    /// Position in plant space, m.
    pub p: DVec3,
    /// Velocity of growth in plant space, m/t.
    pub v: DVec3,
    /// Target direction: a unit vector; with [`Variant::Paper`] of any length, m/t.
    pub d: DVec3,
    /// Home direction, about which a coiling axis winds; unit.
    pub home: DVec3,
    /// Unit tangent of growth.
    pub tangent: DVec3,
    /// Unit roll reference, perpendicular to the tangent.
    pub reference: DVec3,
    /// Arc length grown, m.
    pub s: f64,
    /// Growth time since the axis began, t.
    pub age: f64,
}

/// External influences on a particle during a step: rates of change of its target direction, 1/t.
#[derive(Debug, Clone, Copy, Default)]
pub struct Influence {
    /// Turn away from shade, times the rate `light`.
    pub light: DVec3,
    /// Turn towards the crown guide, times the rate `attract`, and turn away from or towards solids.
    pub other: DVec3,
}

/// Rates of the motion of one axis, and the length of its steps.
#[derive(Debug, Clone, Copy)]
pub struct StepRates {
    /// Speed to which the particle tends, m/t; above 0.
    pub speed: f64,
    /// Rate at which its velocity follows its target direction, 1/t.
    pub spread: f64,
    /// Random walk of the target direction, t^-1/2.
    pub wander: f64,
    /// Rotation of the velocity about the target direction, rad/t.
    pub twist: f64,
    /// Rotation of the target direction about the home direction, rad/t.
    pub coil: f64,
    /// Downward acceleration at the full length, m/t^2.
    pub gravity: f64,
    /// Rate at which the target direction turns upwards, 1/t.
    pub up: f64,
    /// Length of a step, m, at which the time step aims.
    pub step_length: f64,
    /// Length that the axis grows to, m.
    pub length: f64,
    /// Printed factor `spread` of a step, 0..1.
    pub paper_spread: f64,
}

impl StepRates {
    /// The rates of an axis of a level that grows to `length`, m.
    pub fn new(params: &ShapeParams, level: u8, length: f64) -> Self {
        let m = &params.motion;
        Self {
            speed: m.speed.at(level),
            spread: m.spread.at(level),
            wander: m.wander.at(level),
            twist: m.twist.at(level),
            coil: m.coil.at(level),
            gravity: m.gravity.at(level),
            up: m.up.at(level),
            step_length: params.step_length(level),
            length,
            paper_spread: m.paper_spread,
        }
    }
}

/// The vector turned about a unit axis by an angle (Rodrigues' formula).
#[inline]
pub fn rotated(v: DVec3, axis: DVec3, angle: f64) -> DVec3 {
    let (sin, cos) = (sin(angle), cos(angle));
    v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos))
}

/// The reference carried from one unit tangent to another by the smallest rotation between them.
#[inline]
pub fn carried(reference: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    // Rotation that takes `from` to `to`, with k = 1 + from . to: x' = x - (from + to)(to . x)/k for x perpendicular to
    // `from`. Opposite tangents leave the reference as it is.
    let k = 1.0 + from.dot(to);
    let moved = if k > 1e-12 { reference - (from + to) * (to.dot(reference) / k) } else { reference };
    // Projected once more, because rounding would add up over thousands of steps.
    let flat = moved - to * to.dot(moved);
    flat.try_normalize().unwrap_or_else(|| to.any_orthonormal_vector())
}

#[inline]
fn normalize_or(v: DVec3, fallback: DVec3) -> DVec3 {
    let length = v.length();
    if length > MIN_LENGTH { v / length } else { fallback }
}

impl Particle {
    /// A particle at the start of an axis: `direction` is the target direction, `heading` that of the first velocity; both are
    /// unit vectors.
    pub fn new(p: DVec3, direction: DVec3, heading: DVec3, rates: &StepRates, variant: Variant) -> Self {
        let d = if variant == Variant::Paper { direction * rates.speed } else { direction };
        Self {
            p,
            v: heading * rates.speed,
            d,
            home: direction,
            tangent: heading,
            reference: heading.any_orthonormal_vector(),
            s: 0.0,
            age: 0.0,
        }
    }

    /// Turns the target direction away from home, towards the roll reference: a coiling axis begins on its helix.
    pub fn tilt_from_home(&mut self, angle: f64) {
        let across = self.reference - self.home * self.home.dot(self.reference);
        let across = across.try_normalize().unwrap_or_else(|| self.home.any_orthonormal_vector());
        self.d = self.home * cos(angle) + across * sin(angle);
    }

    /// Growth time of the next step: the particle moves by the step length, but takes at most four times as long as at full
    /// speed.
    #[inline]
    pub fn time_step(&self, rates: &StepRates) -> f64 {
        let longest = 4.0 * rates.step_length / rates.speed;
        let speed = self.v.length();
        if speed > 0.0 { (rates.step_length / speed).min(longest) } else { longest }
    }

    /// Advances direction and velocity by `dt`; the caller moves the particle. Own:
    /// `d' = normalize(d + wander sqrt(dt) N3 + dt (up Y + influences))`, then turned about the home direction by coil dt;
    /// `v' = w + (v - w) exp(-spread dt)`, w = speed d - (gravity / spread)(s/L)^2 Y, turned about d by twist dt.
    #[inline]
    pub fn turn(&mut self, rates: &StepRates, influence: &Influence, dt: f64, draws: &mut Rng) {
        // The target direction walks at random and follows its tropisms.
        let up = DVec3::Y * rates.up + influence.light;
        let mut change = (up + influence.other) * dt;
        if rates.wander > 0.0 {
            let noise = DVec3::new(draws.normal_by_quantile(), draws.normal_by_quantile(), draws.normal_by_quantile());
            change += noise * (rates.wander * sqrt(dt));
        }
        self.d = normalize_or(self.d + change, self.d);
        if rates.coil != 0.0 {
            self.home = normalize_or(self.home + up * dt, self.home);
            self.d = rotated(self.d, self.home, rates.coil * dt);
        }
        // The velocity approaches its limit w exponentially; without spread it only falls.
        let grown = self.s / rates.length;
        let fall = rates.gravity * grown * grown;
        if rates.spread > 0.0 {
            let limit = self.d * rates.speed - DVec3::Y * (fall / rates.spread);
            self.v = limit + (self.v - limit) * exp(-rates.spread * dt);
        } else {
            self.v -= DVec3::Y * (fall * dt);
        }
        if rates.twist != 0.0 {
            self.v = rotated(self.v, self.d, rates.twist * dt);
        }
    }

    /// As [`Particle::turn`] by the printed lines of \[hoetzlein\] section 3 with a time step of 0.05 t:
    /// `d' = d + rand[-1,1] wander dt`, `v' = [v + spread (d' - v)] Q(twist, d)`. Returns whether the velocity had to be cut.
    pub fn turn_as_printed(&mut self, rates: &StepRates, draws: &mut Rng) -> bool {
        let old = self.d;
        let noise = DVec3::new(draws.range(-1.0, 1.0), draws.range(-1.0, 1.0), draws.range(-1.0, 1.0));
        self.d += noise * (rates.wander * PAPER_STEP);
        self.v += (self.d - self.v) * rates.paper_spread;
        let length = old.length();
        if length >= PAPER_MIN_AXIS {
            self.v = rotated(self.v, old / length, rates.twist);
        }
        let (speed, most) = (self.v.length(), PAPER_MAX_SPEED * rates.speed);
        if speed > most {
            self.v *= most / speed;
        }
        speed > most
    }

    /// Moves the particle to `p`, `dt` later, and turns its frame: carried along without torsion, then rolled by `roll`, rad.
    #[inline]
    pub fn move_to(&mut self, p: DVec3, dt: f64, roll: f64) {
        let step = p - self.p;
        let length = step.length();
        let tangent = if length > MIN_LENGTH { step / length } else { self.tangent };
        self.reference = carried(self.reference, self.tangent, tangent);
        if roll != 0.0 {
            self.reference = rotated(self.reference, tangent, roll);
        }
        self.tangent = tangent;
        self.p = p;
        self.s += length;
        self.age += dt;
    }
}
