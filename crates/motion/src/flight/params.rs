//! What a flight is told.

use glam::{DVec3, Vec3};

use osier_base::geometry::Bounds;

/// Acceleration of free fall, m/s^2.
const GRAVITY: f64 = osier_base::physics::GRAVITY;

/// A kind of catkin that flies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CatkinKind {
    /// Of the ball around all its hairs, about the point that they start from, m, > 0.
    pub radius: f32,
    /// How often it is met, >= 0.
    pub weight: f64,
}

/// What happens at an open side of the box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SideBoundary {
    /// Out at one side is in at the other.
    Periodic,
    /// It is gone.
    Exit,
    /// It comes back on a side that the wind enters by.
    Recycle,
}

/// When a catkin starts, and from where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CatkinStart {
    /// Where, m.
    pub at: DVec3,
    /// What it waits for.
    pub wait: ReleaseCondition,
}

/// What a start waits for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReleaseCondition {
    /// A time, s.
    Until(f64),
    /// Wind at its place: it leaves when the integral of [`FlightParams::release_rate`] times what the air is faster than
    /// [`FlightParams::release_speed`], as a share of that, reaches this.
    Wind(f64),
}

/// How wet the ground is, 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub enum GroundHumidity {
    /// Everywhere alike.
    Even(f64),
    /// A picture over the box, its top at -z.
    Map {
        /// Pixels in x.
        width: usize,
        /// Rows from -z to +z, 0 to 1.
        values: Vec<f32>,
    },
}

impl GroundHumidity {
    /// At (x, z) of a box, m.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the picture")]
    pub fn at(&self, place: Vec3, inside: Bounds) -> f64 {
        match self {
            Self::Even(h) => *h,
            Self::Map { width, values } => {
                let height = values.len() / (*width).max(1);
                let share = (place - inside.min) / inside.size();
                let pixel = |s: f32, n: usize| ((s * n as f32).max(0.0) as usize).min(n.saturating_sub(1));
                values.get(pixel(share.z, height) * width + pixel(share.x, *width)).map_or(0.0, |v| f64::from(*v))
            }
        }
    }
}

/// All that rules a flight. Lengths in m, times in s, speeds in m/s.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightParams {
    /// Of all draws.
    pub seed: u64,
    /// Frames a second, > 0.
    pub fps: f64,
    /// Steps a frame, >= 1.
    pub substeps: u32,
    /// The box of air.
    pub inside: Bounds,
    /// Sides in x and in z.
    pub edges: [SideBoundary; 2],
    /// Part of the height that recycled ones come back in.
    pub band: [f64; 2],
    /// Which ones there are; at least one.
    pub kinds: Vec<CatkinKind>,
    /// Smallest and largest factor on a kind's size.
    pub scales: [f64; 2],
    /// Mass of one of scale 1, kg.
    pub mass: f64,
    /// Settling speed.
    pub fall: f64,
    /// Its spread, as a share: standard deviation, cut at two.
    pub fall_spread: f64,
    /// How far tilted ones glide: 0 not at all, 1 strongly.
    pub glide: f64,
    /// Whether they lag behind changes of the wind.
    pub inertia: bool,
    /// Whether clusters turn.
    pub cluster_rotation: bool,
    /// Clusters of n sink n^beta times as fast.
    pub beta: f64,
    /// Release by wind: chance a second where the air is twice as fast as `release_speed`, and that speed.
    pub release_rate: f64,
    /// See `release_rate`.
    pub release_speed: f64,
    /// Reach of hairs and charge in the air, m; 0 for nothing but their own radius.
    pub stick_radius: f64,
    /// Chance that a contact in the air holds.
    pub stick_probability: f64,
    /// How close those that stick draw, as a share of both radii.
    pub stick_close: f64,
    /// Steps between two checks for contacts, >= 1.
    pub check_every: u32,
    /// How fast attraction fades with distance, 1/m^2, > 0; see \[catkin\] eq. 14.
    pub gamma: f64,
    /// Time between two looks for something to be drawn to.
    pub tick: f64,
    /// Of the ground.
    pub humidity: GroundHumidity,
    /// Wind at 0.1 m that lifts a dry one.
    pub lift_speed: f64,
    /// How much wet ground adds to it.
    pub lift_wet: f64,
    /// Least height above a surface at which the wind is known, m.
    pub known_height: f64,
    /// Further than this nothing should move in a step, m: what does is counted.
    pub longest_step: f64,
    /// Roughness of the ground, m.
    pub roughness: f64,
    /// How much they turn about: 1 is natural, 0 not at all.
    pub flutter: f64,
    /// Keeps neighbours together in memory; changes no result.
    pub sorted: bool,
}

impl Default for FlightParams {
    fn default() -> Self {
        Self {
            seed: 0,
            fps: 24.0,
            substeps: 1,
            inside: Bounds { min: Vec3::new(-17.5, 0.0, -17.5), max: Vec3::new(17.5, 35.0, 17.5) },
            edges: [SideBoundary::Recycle; 2],
            band: [0.3, 0.95],
            kinds: vec![CatkinKind { radius: 0.02, weight: 1.0 }],
            scales: [0.8, 1.2],
            mass: 1e-6,
            fall: 0.24,
            fall_spread: 0.125,
            glide: 0.5,
            inertia: true,
            cluster_rotation: true,
            beta: 0.0,
            release_rate: 0.2,
            release_speed: 0.6,
            stick_radius: 0.2,
            stick_probability: 1.0,
            stick_close: 0.8,
            check_every: 4,
            gamma: 4.605,
            tick: 0.3,
            humidity: GroundHumidity::Even(0.3),
            lift_speed: 0.25,
            lift_wet: 3.0,
            known_height: 0.25,
            longest_step: f64::INFINITY,
            roughness: 0.05,
            flutter: 1.0,
            sorted: true,
        }
    }
}

impl FlightParams {
    /// Length of a step, s.
    pub fn time_step(&self) -> f64 {
        1.0 / (self.fps * f64::from(self.substeps.max(1)))
    }

    /// Time in which the difference between the velocity of what settles at `fall`, m/s, and the air's falls to 1/e, s.
    pub(super) fn relaxation_time(&self, fall: f64) -> f64 {
        if self.inertia { fall / GRAVITY } else { 0.0 }
    }

    /// Past a side of the box, or above its top.
    pub(super) fn is_outside(&self, x: DVec3) -> bool {
        self.is_past_a_side(x) || x.y > f64::from(self.inside.max.y)
    }

    /// Past a side of the box.
    pub(super) fn is_past_a_side(&self, x: DVec3) -> bool {
        let (low, high) = (self.inside.min.as_dvec3(), self.inside.max.as_dvec3());
        x.x < low.x || x.x > high.x || x.z < low.z || x.z > high.z
    }

    /// How far a single is drawn to a cluster, m: where the attraction has fallen to a hundredth.
    pub fn attraction_radius(&self) -> f64 {
        osier_base::math::sqrt(osier_base::math::ln(100.0) / self.gamma)
    }
}
