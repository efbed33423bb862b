//! State of a single catkin.

use glam::{DVec3, Quat, Vec3};

use super::params::{CatkinStart, FlightParams, ReleaseCondition};
use crate::flight::tuning::UPDRAFT_TIME;
use osier_base::math::{exp, narrow};
use osier_base::rng::{self, Rng};

/// Phase of a catkin's flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CatkinState {
    /// Waiting for its release; hidden.
    Pending,
    /// In the air, carried by the wind; singly or in a cluster.
    Airborne,
    /// Deposited on the ground or on the top of a solid.
    Grounded,
    /// At a steep face, sliding down.
    OnWall,
    /// In contact with ground and wall.
    Corner,
    /// Outside of the box, or hidden before it reenters.
    Exited,
}

impl CatkinState {
    /// Whether it is at rest on the ground, on a top, at a wall or in a corner.
    pub fn is_deposited(self) -> bool {
        matches!(self, Self::Grounded | Self::OnWall | Self::Corner)
    }

    /// Whether it is visible: in the air or deposited.
    pub fn is_seen(self) -> bool {
        self == Self::Airborne || self.is_deposited()
    }
}

/// Where a catkin rests: its position, its mass, and the surface that supports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestingPlace {
    /// Origin of the hairs, m.
    pub position: DVec3,
    /// Mass of the catkin, kg.
    pub mass: f64,
    /// Whether it lies on ground or a top, is at a wall or in a corner.
    pub state: CatkinState,
    /// Index of the supporting solid, none for level ground; in a corner that of the wall.
    pub face: Option<u32>,
    /// Normal of the supporting surface.
    pub normal: Vec3,
}

/// Marks a catkin without an attraction target.
pub(super) const NO_TARGET: u32 = u32::MAX;

/// One catkin. Its index is its position among the starts.
///
/// Fields are grouped by cache lines of 64 bytes, since a step over many catkins is bound by memory: the contact
/// search reads the first line only, tumbling the first, third and fourth, flight the first four.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Catkin {
    pub(super) id: u32,
    /// Smallest index in its cluster; its index for a single.
    pub(super) root: u32,
    pub(super) radius: f32,
    pub(super) state: CatkinState,
    pub(super) clustered: bool,
    /// Whether it was airborne when the path of this step began.
    pub(super) free: bool,
    /// Whether it was deposited or displaced since the last contact search.
    pub(super) moved_since_check: bool,
    pub(super) x: DVec3,
    /// Displacement since the last contact search, about one step, not wrapped at periodic sides, m.
    pub(super) travel: DVec3,

    pub(super) v: DVec3,
    pub(super) mass: f64,
    pub(super) lag: VelocityDecay,
    /// Updraft at its lift-off, m/s, and time of the lift-off, s.
    pub(super) lift: f64,
    pub(super) lifted: f64,

    pub(super) q: Quat,
    pub(super) omega: Vec3,
    /// Random angular acceleration, rad/s^2.
    pub(super) random_torque: Vec3,
    /// Velocity of the air relative to it at the end of the last step, m/s.
    pub(super) flow: Vec3,
    /// Number of times that it was recycled; part of the address of its random draws.
    pub(super) generation: u32,
    pub(super) fall: f64,

    /// Steady velocity of the air relative to it in this step, without glide, m/s; `flow` relaxes towards it.
    pub(super) lasting_flow: Vec3,
    pub(super) scale: f32,
    pub(super) kind: u16,
    /// Whether it is hidden at the position where it will reenter.
    pub(super) moved: bool,
    /// Whether its flight begins with its next step in the air, in which `flow` starts from the wind at its place.
    pub(super) begins_flight: bool,
    /// Normal of the supporting surface.
    pub(super) normal: Vec3,
    pub(super) face: Option<u32>,
    /// Attraction target, and ln(1 - F): the logarithm of the distance's share that is left after a tick.
    pub(super) target: u32,
    pub(super) pull: f64,
    /// Lift-offs so far, and the integral of the lift-off rate that is left until the next; 0 if not yet drawn.
    pub(super) hops: u32,
    pub(super) lift_exposure: f32,
    /// Position, m, and time, s, of its release. Translations at sides of the box move this position too, so that the distance
    /// from it is the distance flown.
    pub(super) from: DVec3,
    pub(super) since: f64,
    /// Time of its deposition, s; negative in flight.
    pub(super) rested: f64,
    pub(super) wait: ReleaseCondition,
}

/// Factors by which a step reduces the difference between a body's velocity and the carrying velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VelocityDecay {
    /// exp(-dt/tau) after a whole step, and after half of one.
    pub whole: f64,
    pub half: f64,
}

impl VelocityDecay {
    /// Factors for a body with settling speed `fall`, m/s, over a step of `dt` s; 0 without inertia, so that it follows the wind at once.
    pub fn for_settling_speed(fall: f64, options: &FlightParams, dt: f64) -> Self {
        if !options.inertia {
            return Self { whole: 0.0, half: 0.0 };
        }
        // Linear drag: dv/dt = (u - v) / tau has the solution u - v = (u0 - v0) exp(-t/tau), exact for any step.
        let tau = options.relaxation_time(fall);
        Self { whole: exp(-dt / tau), half: exp(-dt / (2.0 * tau)) }
    }
}

impl Catkin {
    /// Draws kind, size, settling speed and orientation of catkin `id`.
    pub(super) fn new(id: u32, start: CatkinStart, options: &FlightParams) -> Self {
        // One stream of draws per catkin: its properties do not depend on how many catkins there are. Mass grows with
        // the area of the tuft, the square of the scale.
        let mut draw = Rng::at(options.seed, &["flight".into(), id.into(), 0_u64.into(), "what".into()]);
        let weights: Vec<f64> = options.kinds.iter().map(|k| k.weight).collect();
        let kind = draw.pick(&weights).min(options.kinds.len().saturating_sub(1));
        let (kind, base) = (0_u16..).zip(&options.kinds).nth(kind).map_or((0, 0.02), |(index, k)| (index, k.radius));
        let scale = draw.range(options.scales[0], options.scales[1]);
        // Cut off at two standard deviations, so that a spread below one half leaves every speed positive.
        let fall = options.fall * (1.0 + options.fall_spread * draw.normal().clamp(-2.0, 2.0));
        // Catkins released at time 0 are airborne from the first frame.
        let waits = !matches!(start.wait, ReleaseCondition::Until(t) if t <= 0.0);
        let state = if waits { CatkinState::Pending } else { CatkinState::Airborne };
        Self {
            id,
            root: id,
            clustered: false,
            kind,
            state,
            generation: 0,
            x: start.at,
            v: DVec3::ZERO,
            travel: DVec3::ZERO,
            free: state == CatkinState::Airborne,
            moved_since_check: false,
            q: random_rotation(&mut draw),
            omega: Vec3::ZERO,
            random_torque: Vec3::ZERO,
            scale: narrow(scale),
            radius: base * narrow(scale),
            mass: options.mass * scale * scale,
            fall,
            lag: VelocityDecay::for_settling_speed(fall, options, options.length_of_step(0)),
            lift: 0.0,
            lifted: 0.0,
            normal: Vec3::Y,
            face: None,
            target: NO_TARGET,
            pull: 0.0,
            hops: 0,
            lift_exposure: 0.0,
            from: start.at,
            since: 0.0,
            rested: -1.0,
            moved: false,
            begins_flight: true,
            wait: start.wait,
            flow: Vec3::ZERO,
            lasting_flow: Vec3::ZERO,
        }
    }

    /// Index among the starts.
    pub fn id(&self) -> u32 {
        self.id
    }

    /// Phase of its flight after the last step: pending, airborne, deposited or exited.
    pub fn state(&self) -> CatkinState {
        self.state
    }

    /// Origin of its hairs in the world, m.
    pub fn position(&self) -> DVec3 {
        self.x
    }

    /// Index of its kind in [`FlightParams::kinds`].
    pub fn kind(&self) -> u16 {
        self.kind
    }

    /// Factor on its kind's radius, drawn from [`FlightParams::scales`].
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Bounding radius of its hairs, m: the radius of its kind times its scale.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Mass of the particle with its wings or hairs, kg.
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Orientation: rotation from the rest pose, whose tuft points along +Y.
    pub fn turn(&self) -> Quat {
        self.q
    }

    /// Smallest index in its cluster; its index for a single.
    pub fn root(&self) -> u32 {
        self.root
    }

    /// Horizontal distance from its release, m; translations at sides of the box do not count.
    pub fn flight_distance(&self) -> f64 {
        let d = self.x - self.from;
        osier_base::math::sqrt(d.x * d.x + d.z * d.z)
    }

    /// Time from its release to its last deposition, s; `None` in flight.
    pub fn flight_time(&self) -> Option<f64> {
        (self.state.is_deposited() && self.rested >= 0.0).then_some(self.rested - self.since)
    }

    /// Where it rests; `None` in flight.
    pub fn resting_place(&self) -> Option<RestingPlace> {
        let Self { x: position, mass, state, face, normal, .. } = *self;
        state.is_deposited().then_some(RestingPlace { position, mass, state, face, normal })
    }

    /// Index of the supporting solid, none for level ground, and the surface normal.
    pub fn rests_on(&self) -> (Option<u32>, Vec3) {
        (self.face, self.normal)
    }

    /// Unit vector along its tuft, in world space.
    pub(super) fn tuft(&self) -> Vec3 {
        self.q * Vec3::Y
    }

    /// Updraft, m/s, that is left at time `t`, s, from the last lift-off.
    pub(super) fn lift_at(&self, t: f64) -> f64 {
        decayed_updraft(self.lift, t - self.lifted)
    }

    /// Whether it is single or the leader of its cluster.
    pub(super) fn is_cluster_leader(&self) -> bool {
        self.root == self.id
    }
}

/// Updraft, m/s, left after `after` seconds of one that began with `speed`, m/s.
pub(super) fn decayed_updraft(speed: f64, after: f64) -> f64 {
    if speed > 0.0 { speed * exp(-after / UPDRAFT_TIME) } else { 0.0 }
}

/// Uniformly distributed random rotation.
fn random_rotation(draw: &mut Rng) -> Quat {
    // A uniform point on the unit sphere in four dimensions: two circles of radii sqrt(1 - u) and sqrt(u).
    let (u, a, b) = (draw.unit_f64(), draw.unit_f64(), draw.unit_f64());
    let (s, c) = (osier_base::math::sqrt(1.0 - u), osier_base::math::sqrt(u));
    let (a, b) = (a * std::f64::consts::TAU, b * std::f64::consts::TAU);
    use osier_base::math::{cos, sin};
    Quat::from_xyzw(narrow(s * sin(a)), narrow(s * cos(a)), narrow(c * sin(b)), narrow(c * cos(b))).normalize()
}

/// Random key from which the tumbling noise of all catkins is derived.
pub(super) fn flutter_seed(seed: u64) -> u64 {
    rng::child(seed, rng::word("flutter"))
}

/// Random key of one catkin's tumbling noise; it changes whenever the catkin is recycled.
pub(super) fn flutter_key(root: u64, id: u32, generation: u32) -> u64 {
    rng::child(rng::child(root, u64::from(id)), u64::from(generation))
}
