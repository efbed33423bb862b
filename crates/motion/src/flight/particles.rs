//! One catkin in flight.

use glam::{DVec3, Quat, Vec3};

use super::params::{CatkinStart, FlightParams, ReleaseCondition};
use osier_base::math::{exp, narrow};
use osier_base::rng::{self, Rng};

/// What it is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CatkinState {
    /// Not yet released; not seen.
    Pending,
    /// In the air.
    Airborne,
    /// On the ground, a roof, the top of a wall.
    Grounded,
    /// At a steep face, sinking.
    OnWall,
    /// Between ground and wall.
    Corner,
    /// Out of the box, or between leaving and coming back; not seen.
    Exited,
}

impl CatkinState {
    /// On something.
    pub fn is_deposited(self) -> bool {
        matches!(self, Self::Grounded | Self::OnWall | Self::Corner)
    }

    /// There to be seen.
    pub fn is_seen(self) -> bool {
        self == Self::Airborne || self.is_deposited()
    }
}

/// No other catkin.
pub(super) const NO_TARGET: u32 = u32::MAX;

/// One catkin. Its number is its place in the order of starts.
///
/// Lines of 64 bytes by who reads them, for a step of many waits for memory: the search for contacts needs but the first,
/// tumbling the first and the third, flying these and the second.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Catkin {
    pub(super) id: u32,
    /// Smallest number of the cluster that it belongs to; its own if it is alone.
    pub(super) root: u32,
    pub(super) radius: f32,
    pub(super) state: CatkinState,
    /// Member of a cluster.
    pub(super) clustered: bool,
    /// In the air at all times since the last check for contacts.
    pub(super) free: bool,
    /// Came to rest or moved along since that check.
    pub(super) moved_since_check: bool,
    pub(super) x: DVec3,
    /// Way since that check, never wrapped.
    pub(super) travel: DVec3,

    pub(super) v: DVec3,
    pub(super) mass: f64,
    pub(super) lag: VelocityDecay,
    /// Upward air that took it off, m/s, and when.
    pub(super) lift: f64,
    pub(super) lifted: f64,

    pub(super) q: Quat,
    pub(super) omega: Vec3,
    /// Torque that nobody can foresee, rad/s^2.
    pub(super) random_torque: Vec3,
    /// Speed of the air that it is moved by, relative to it.
    pub(super) flow: Vec3,
    /// How often it has come back.
    pub(super) generation: u32,
    pub(super) fall: f64,

    pub(super) scale: f32,
    pub(super) kind: u16,
    /// Out of sight and put where it will come back.
    pub(super) moved: bool,
    /// Of the surface that it lies on.
    pub(super) normal: Vec3,
    pub(super) face: Option<u32>,
    /// Whom it is drawn to, and the logarithm of what is left of the way after a tick.
    pub(super) target: u32,
    pub(super) pull: f64,
    /// Where and when this flight began.
    pub(super) from: DVec3,
    pub(super) since: f64,
    /// When it came to rest, s; below 0 while it flies.
    pub(super) rested: f64,
    pub(super) wait: ReleaseCondition,
}

/// What a step leaves of the difference between a body's velocity and that of the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VelocityDecay {
    /// Left after a step, and after half of one.
    pub whole: f64,
    pub half: f64,
}

impl VelocityDecay {
    /// Of something that settles at `fall`, m/s.
    pub fn of(fall: f64, options: &FlightParams) -> Self {
        if !options.inertia {
            return Self { whole: 0.0, half: 0.0 };
        }
        let (tau, dt) = (options.relaxation_time(fall), options.time_step());
        Self { whole: exp(-dt / tau), half: exp(-dt / (2.0 * tau)) }
    }
}

impl Catkin {
    /// A catkin as it is drawn for number `id`.
    pub(super) fn new(id: u32, start: CatkinStart, options: &FlightParams) -> Self {
        let mut draw = Rng::at(options.seed, &["flight".into(), id.into(), 0_u64.into(), "what".into()]);
        let weights: Vec<f64> = options.kinds.iter().map(|k| k.weight).collect();
        let kind = draw.pick(&weights).min(options.kinds.len().saturating_sub(1));
        let scale = draw.range(options.scales[0], options.scales[1]);
        let fall = options.fall * (1.0 + options.fall_spread * draw.normal().clamp(-2.0, 2.0));
        let base = options.kinds.get(kind).map_or(0.02, |k| k.radius);
        let waits = !matches!(start.wait, ReleaseCondition::Until(t) if t <= 0.0);
        let state = if waits { CatkinState::Pending } else { CatkinState::Airborne };
        Self {
            id,
            root: id,
            clustered: false,
            kind: u16::try_from(kind).unwrap_or(0),
            state,
            generation: 0,
            x: start.at,
            v: DVec3::ZERO,
            travel: DVec3::ZERO,
            free: state == CatkinState::Airborne,
            moved_since_check: false,
            q: any_turn(&mut draw),
            omega: Vec3::ZERO,
            random_torque: Vec3::ZERO,
            scale: narrow(scale),
            radius: base * narrow(scale),
            mass: options.mass * scale * scale,
            fall,
            lag: VelocityDecay::of(fall, options),
            lift: 0.0,
            lifted: 0.0,
            normal: Vec3::Y,
            face: None,
            target: NO_TARGET,
            pull: 0.0,
            from: start.at,
            since: 0.0,
            rested: -1.0,
            moved: false,
            wait: start.wait,
            flow: Vec3::ZERO,
        }
    }

    /// Its number.
    pub fn id(&self) -> u32 {
        self.id
    }

    /// What it is doing.
    pub fn state(&self) -> CatkinState {
        self.state
    }

    /// Where the hairs start from, m.
    pub fn position(&self) -> DVec3 {
        self.x
    }

    /// Its place among [`FlightParams::kinds`].
    pub fn kind(&self) -> u16 {
        self.kind
    }

    /// Factor on its kind's size.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Radius of its ball, m.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// kg.
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// The way its tuft points, as a rotation of +Y.
    pub fn turn(&self) -> Quat {
        self.q
    }

    /// Smallest number in its cluster.
    pub fn root(&self) -> u32 {
        self.root
    }

    /// The solid that it lies on, none for the level ground, and the way out of it.
    pub fn rests_on(&self) -> (Option<u32>, Vec3) {
        (self.face, self.normal)
    }

    /// The way its tuft points.
    pub(super) fn tuft(&self) -> Vec3 {
        self.q * Vec3::Y
    }

    /// Upward air that still carries it after taking off, m/s.
    pub(super) fn lift_at(&self, t: f64) -> f64 {
        rising(self.lift, t - self.lifted)
    }

    /// The one that stands for its cluster, or a single.
    pub(super) fn leads(&self) -> bool {
        self.root == self.id
    }
}

/// How long the air that lifts something keeps rising with it, s.
const UPDRAFT_TIME: f64 = 0.6;

/// What is left after a time, s, of air that rose at `speed`, m/s.
pub(super) fn rising(speed: f64, after: f64) -> f64 {
    if speed > 0.0 { speed * exp(-after / UPDRAFT_TIME) } else { 0.0 }
}

/// A rotation, all alike.
/// Source: K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992.
fn any_turn(draw: &mut Rng) -> Quat {
    let (u, a, b) = (draw.unit_f64(), draw.unit_f64(), draw.unit_f64());
    let (s, c) = (osier_base::math::sqrt(1.0 - u), osier_base::math::sqrt(u));
    let (a, b) = (a * std::f64::consts::TAU, b * std::f64::consts::TAU);
    use osier_base::math::{cos, sin};
    Quat::from_xyzw(narrow(s * sin(a)), narrow(s * cos(a)), narrow(c * sin(b)), narrow(c * cos(b))).normalize()
}

/// Key of the draws of all flutter.
pub(super) fn flutter_root(seed: u64) -> u64 {
    rng::child(seed, rng::word("flutter"))
}

/// Key of the draws of one catkin's flutter.
pub(super) fn flutter_key(root: u64, id: u32, generation: u32) -> u64 {
    rng::child(rng::child(root, u64::from(id)), u64::from(generation))
}
