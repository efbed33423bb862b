//! Parameters of a flight.

use glam::{DVec3, Vec3};

use osier_base::geometry::Bounds;

/// Radius and relative frequency of one kind of catkin, such as the fruits of one species.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CatkinKind {
    /// Bounding radius of all hairs about their common origin, m, > 0.
    pub radius: f32,
    /// Relative frequency, >= 0.
    pub weight: f64,
}

/// Boundary condition at a pair of opposite vertical sides of the box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SideBoundary {
    /// Periodic with the opposite side.
    Periodic,
    /// Catkins leave for good.
    Exit,
    /// Catkins reenter, after two hidden frames, through an inflow side.
    Recycle,
}

/// Where a catkin starts and when it is released. Its position in the list of starts becomes its index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CatkinStart {
    /// Position in the world at the start, m; a plant that moves can shift it until the release.
    pub at: DVec3,
    /// Time or wind of its release; until then it is pending.
    pub wait: ReleaseCondition,
}

/// When a pending catkin is released: at a fixed time, or at a random time that depends on the local wind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReleaseCondition {
    /// At a time since the start, s; infinity for never.
    Until(f64),
    /// By the wind: when the integral of [`FlightParams::release_rate`] times the relative excess of the local wind
    /// over [`FlightParams::release_speed`] reaches `exposure`, from the time `ripe` on, s.
    Wind {
        /// Integral that is left until the release; decreases while the wind exceeds the release speed.
        exposure: f64,
        /// Time since the start before which it is not released, s.
        ripe: f64,
    },
}

/// Humidity of the ground, from 0 (dry) to 1 (nothing lifts off), uniform or by position.
#[derive(Debug, Clone, PartialEq)]
pub enum GroundHumidity {
    /// The same humidity everywhere, 0 to 1.
    Even(f64),
    /// A raster over the box, its first row at -z.
    Map {
        /// Pixels of the map along x.
        width: usize,
        /// Rows from -z to +z, 0 to 1.
        values: Vec<f32>,
    },
}

impl GroundHumidity {
    /// Humidity of the pixel at a position; positions outside take that of the border. `inside`: the box that the map covers, m.
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

/// Parameters of a `FlightSimulation`. Lengths in m, times in s, speeds in m/s.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightParams {
    /// Seed of the random draws; they are addressed by catkin, so that one catkin's draws do not depend on the others.
    pub seed: u64,
    /// Frame rate of the clip, frames per second, > 0.
    pub fps: f64,
    /// Time steps per frame, >= 1.
    pub substeps: u32,
    /// Duration of the first interval between two frames, s; it has as many steps as the others. 0: as long as the others. It is
    /// shorter if a spin-up does not last a whole number of frames.
    pub first_interval: f64,
    /// Box of the simulated air in the world, m.
    pub inside: Bounds,
    /// Boundary condition of the sides across x, and across z.
    pub edges: [SideBoundary; 2],
    /// Range of heights in which recycled catkins reenter, as fractions of the height of the box.
    pub band: [f64; 2],
    /// Kinds of catkins, drawn in proportion to their weights; at least one.
    pub kinds: Vec<CatkinKind>,
    /// Range in which the factor on a kind's radius is drawn, uniformly for each catkin.
    pub scales: [f64; 2],
    /// Mass at scale 1, kg; mass grows with the square of the scale.
    pub mass: f64,
    /// Mean settling speed of single catkins in calm air, m/s.
    pub fall: f64,
    /// Relative standard deviation of the settling speed; deviations are limited to two of it.
    pub fall_spread: f64,
    /// Horizontal speed of a catkin whose tuft is level, divided by its settling speed, 0 to 1.
    pub glide: f64,
    /// Whether velocities relax towards the wind with the time constant v_s / g; else they follow at once.
    pub inertia: bool,
    /// Gravitational acceleration g, m/s^2, > 0.
    pub gravity: f64,
    /// Whether clusters rotate with the vorticity of the wind.
    pub cluster_rotation: bool,
    /// Exponent beta: clusters of n settle n^beta times as fast as a single.
    pub beta: f64,
    /// Release rate, 1/s, where the wind is twice `release_speed`.
    pub release_rate: f64,
    /// Wind speed up to which no catkin is released.
    pub release_speed: f64,
    /// Least contact radius in the air, m; a catkin whose radius is larger makes contact at that radius.
    pub stick_radius: f64,
    /// Probability that a contact in the air holds.
    pub stick_probability: f64,
    /// Distance to which bonded catkins contract, as a fraction of the sum of their radii.
    pub stick_close: f64,
    /// Decay of attraction with distance, 1/m^2, > 0; gamma of \[catkin\] eq. 14.
    pub gamma: f64,
    /// Humidity of the ground, which raises the threshold of lift-off; walls have the humidity of their solid.
    pub humidity: GroundHumidity,
    /// Threshold of the wind speed at 0.1 m height, m/s, above which a dry single catkin can lift off.
    pub lift_speed: f64,
    /// Lift-off rate, 1/s, where the wind at 0.1 m is twice its threshold.
    pub lift_rate: f64,
    /// Increase of the lift-off wind speed with the humidity h: k in the factor 1 + k h / (1 - h).
    pub lift_wet: f64,
    /// Least height above a surface at which the wind field is resolved, m; below, the logarithmic law is used.
    pub min_resolved_height: f64,
    /// Height above a surface below which the wind normal to it decreases to 0, m; equal to `min_resolved_height` for a wind
    /// field that does not blow through solids.
    pub blocking_height: f64,
    /// Displacement per step above which steps are counted in `FlightStats::long_steps`, m.
    pub longest_step: f64,
    /// Aerodynamic roughness length of the ground, m.
    pub roughness: f64,
    /// Strength of tumbling: 1 is natural, 0 for none.
    pub flutter: f64,
    /// Whether catkins are sorted by location at intervals, for speed; changes no result.
    pub sorted: bool,
}

impl Default for FlightParams {
    fn default() -> Self {
        Self {
            seed: 0,
            fps: 24.0,
            substeps: 1,
            first_interval: 0.0,
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
            gravity: osier_base::physics::GRAVITY,
            cluster_rotation: true,
            beta: 0.0,
            release_rate: 0.2,
            release_speed: 0.6,
            stick_radius: 0.05,
            stick_probability: 1.0,
            stick_close: 0.8,
            gamma: 4.605,
            humidity: GroundHumidity::Even(0.3),
            lift_speed: 0.25,
            lift_rate: 1.0,
            lift_wet: 3.0,
            min_resolved_height: 0.25,
            blocking_height: 1.0,
            longest_step: f64::INFINITY,
            roughness: 0.05,
            flutter: 1.0,
            sorted: true,
        }
    }
}

impl FlightParams {
    /// Length of a step, s: 1 / (`fps` `substeps`). The steps of the first interval may be shorter.
    pub fn time_step(&self) -> f64 {
        1.0 / (self.fps * f64::from(self.substeps.max(1)))
    }

    /// Whether the step of this number, counted from 0, lies in a first interval that is shorter than the others.
    pub(super) fn is_shorter(&self, step: u64) -> bool {
        self.first_interval > 0.0 && step < u64::from(self.substeps.max(1))
    }

    /// Length, s, of the step of this number, counted from 0.
    pub(super) fn length_of_step(&self, step: u64) -> f64 {
        if self.is_shorter(step) { self.first_interval / f64::from(self.substeps.max(1)) } else { self.time_step() }
    }

    /// Time, s, at which the step of this number begins.
    pub(super) fn start_of_step(&self, step: u64) -> f64 {
        if self.is_shorter(step) {
            return step as f64 * self.length_of_step(step);
        }
        // Without a shorter first interval only the second term counts, so that times are exact multiples of the step.
        let steps_before = if self.first_interval > 0.0 { u64::from(self.substeps.max(1)) } else { 0 };
        self.first_interval + (step - steps_before) as f64 * self.time_step()
    }

    /// Velocity relaxation time v_s / g of a body with settling speed `fall`, m/s, in s; 0 without inertia.
    pub(super) fn relaxation_time(&self, fall: f64) -> f64 {
        if self.inertia { fall / self.gravity } else { 0.0 }
    }

    /// Whether a position is past a side of the box or above its top; below the ground does not count.
    pub(super) fn is_outside(&self, x: DVec3) -> bool {
        self.is_past_a_side(x) || x.y > f64::from(self.inside.max.y)
    }

    /// Whether a position is past one of the four vertical sides of the box, at any height.
    pub(super) fn is_past_a_side(&self, x: DVec3) -> bool {
        let (low, high) = (self.inside.min.as_dvec3(), self.inside.max.as_dvec3());
        x.x < low.x || x.x > high.x || x.z < low.z || x.z > high.z
    }

    /// Whether a position is past a side through which catkins leave: not a periodic one, which brings them back.
    pub(super) fn is_past_an_open_side(&self, x: DVec3) -> bool {
        let (low, high) = (self.inside.min.as_dvec3(), self.inside.max.as_dvec3());
        let is_past = |edge: SideBoundary, x: f64, low: f64, high: f64| {
            edge != SideBoundary::Periodic && !(low..=high).contains(&x)
        };
        is_past(self.edges[0], x.x, low.x, high.x) || is_past(self.edges[1], x.z, low.z, high.z)
    }

    /// Range of attraction, m: where it has decayed to a hundredth.
    pub fn attraction_radius(&self) -> f64 {
        // exp(-gamma r^2) = 1/100 solved for r.
        osier_base::math::sqrt(osier_base::math::ln(100.0) / self.gamma)
    }
}
