//! The inflow of the lattice as a function of position and time: mean profile, gusts and synthetic turbulence.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::{Arc, PoisonError, RwLock};

use glam::{DVec3, Vec2, Vec3};
use pulp::{Arch, Simd, WithSimd};

use super::super::{CALM_SPEED, Wind};
use super::ground::shear_coefficient;
use super::tuning::{
    GUST_MEMORY, GUST_TICKS, LULL_SPEED_FACTOR, MAX_GUST, RAMP_STEPS, SHORTEST_WAVELENGTH_CELLS,
    TURBULENCE_FULL_HEIGHT, TURBULENCE_LENGTH_PER_HEIGHT, TURBULENCE_RANGE, TURN_PER_INTERVAL,
};
use osier_base::keyframes::interpolate;
use osier_base::math::{self, cos, exp, ln, narrow, pow, sin, sqrt};
use osier_base::rng::Rng;
use osier_base::simd::F32Lanes;
use osier_scene::solid::LandForm;

/// Factor on the mean speed as a function of the height above the ground.
#[derive(Debug, Clone, PartialEq)]
pub enum WindProfile {
    /// Logarithmic law ln((y + z0)/z0), divided by its value at the reference height; roughness length z0, m.
    Log(f64),
    /// Power law: (height / reference height) to this exponent.
    Power(f64),
    /// The same speed at all heights.
    Uniform,
    /// Rows of ascending height, m, and factor on the speed, linearly interpolated.
    Table(Vec<[f64; 2]>),
}

/// Mean wind, gusts, turbulence and seed of an [`InletWind`].
#[derive(Debug, Clone, PartialEq)]
pub struct InletOptions {
    /// Horizontal unit vector towards which the wind blows.
    pub direction: DVec3,
    /// Mean speed at the reference height, m/s.
    pub speed: f64,
    /// Rows of ascending time, s, and mean speed, m/s, linearly interpolated and constant before and after; empty for a
    /// constant `speed`, which is the largest of them.
    pub speed_curve: Vec<[f64; 2]>,
    /// Rows of ascending time, s, from 0 on, and angle, rad, from `direction` counterclockwise as seen from above; linearly
    /// interpolated and constant before and after; empty for a constant direction.
    pub direction_curve: Vec<[f64; 2]>,
    /// Factor on the mean speed by height above the ground.
    pub profile: WindProfile,
    /// Height at which the speed is `speed`, m; `None` for 10 m, or for the height of the box if that is lower.
    pub reference_height: Option<f64>,
    /// Standard deviation of gusts divided by the mean speed.
    pub gust_strength: f64,
    /// Correlation time of gusts, s.
    pub gust_period: f64,
    /// Turbulence intensity: standard deviation of each component divided by the mean speed.
    pub turbulence: f64,
    /// Longest wavelength of the turbulence, m; `None` for twice the reference height, at most the height of the box.
    pub turbulence_length: Option<f64>,
    /// Number of Fourier modes of the turbulence.
    pub turbulence_modes: u32,
    /// Seed of gusts and turbulence.
    pub seed: u64,
}

/// Largest number of stored values of the gust process: some hours of short gusts.
const MOST_GUST_VALUES: usize = 1 << 20;

/// Number of inlet nodes for which all modes are summed before the next nodes, so that their velocities stay in the L1 cache.
const NODE_BLOCK: usize = 1024;

/// One Fourier mode of the turbulence: e cos(k . x + phase).
#[derive(Debug, Clone, Copy)]
struct FourierMode {
    /// Wave vector, rad/m.
    k: DVec3,
    /// Amplitude, m/s, perpendicular to `k`, so that the mode is free of divergence.
    e: DVec3,
    /// Phase at the origin of the box, rad.
    phase: f64,
}

/// Undisturbed inflow: u = gust(t) U p(y) d + u'(x - int U d dt), with profile p, direction d and turbulence u' that the mean
/// wind advects (Taylor's frozen turbulence). Used alone as a wind field, it has no wakes.
/// Source: own, after Kraichnan's random Fourier modes; \[catkin\] names no inlet.
/// ```
/// use glam::DVec3;
/// use osier_wind::{InletWind, LatticeOptions, Wind};
///
/// let options = LatticeOptions::default();
/// let inlet = InletWind::new(options.inlet, DVec3::ZERO, options.spacing, options.cells, [false; 3]);
/// assert!((inlet.profile(10.0) - 1.0).abs() < 1e-12);
/// assert!(inlet.peak_speed(35.0) > 4.5 && inlet.mean_at(2.0 * glam::Vec3::Y).x < 4.5);
/// ```
#[derive(Debug, Clone)]
pub struct InletWind {
    options: InletOptions,
    /// Lowest corner of the box, m; its bottom is the ground where no land rises above it.
    origin: DVec3,
    /// Terrain in the box, from which heights of the profile are measured.
    land: Option<Arc<LandForm>>,
    /// Spacing of the lattice, m: waves shorter than six cells are omitted.
    spacing: f64,
    /// Height at which the mean speed applies, m.
    reference_height: f64,
    /// Longest wavelength of the turbulence, m.
    turbulence_length: f64,
    /// Modes whose wavelengths the cells can resolve.
    modes: Vec<FourierMode>,
    /// As [`InletWind::carried_turbulence`].
    carried_turbulence: f64,
    /// Values of the gust process by tick, computed on demand. A value takes some hundred draws, and many positions and times
    /// need the same values. Clones share it, because they have the same process.
    gusts: Arc<RwLock<BTreeMap<i64, f64>>>,
}

/// Time-dependent values that are the same at all positions.
#[derive(Debug, Clone, Copy)]
pub(super) struct InletState {
    direction: DVec3,
    /// Factor on the mean speed, including the speed curve.
    gust: f64,
    /// Displacement of the air by the mean wind since 0 s, m.
    displacement: DVec3,
    /// Value of the speed curve divided by its maximum; 1 without a curve.
    speed_factor: f64,
}

impl InletWind {
    /// Draws the turbulence modes. `origin`: lowest corner of the box, m; `spacing`: edge of a cell, m; `cells`: number of cells
    /// of the box along each axis; `periodic`: axes whose faces are periodic, along which the turbulence must repeat.
    pub fn new(options: InletOptions, origin: DVec3, spacing: f64, cells: [u32; 3], periodic: [bool; 3]) -> Self {
        let size = DVec3::from_array(cells.map(f64::from)) * spacing;
        let reference_height = options.reference_height.unwrap_or(size.y.min(10.0));
        let default_length = (TURBULENCE_LENGTH_PER_HEIGHT * reference_height).min(size.y);
        let turbulence_length = options.turbulence_length.unwrap_or(default_length);
        let (modes, carried_turbulence) = fourier_modes(&options, turbulence_length, spacing, size, periodic);
        Self {
            options,
            origin,
            land: None,
            spacing,
            reference_height,
            turbulence_length,
            modes,
            carried_turbulence,
            gusts: Arc::default(),
        }
    }

    /// Longest wavelength of the turbulence, m.
    pub fn turbulence_length(&self) -> f64 {
        self.turbulence_length
    }

    /// Root mean square of the turbulence that the cells resolve, divided by that of all turbulence, 0 to 1: waves shorter than
    /// six cells are omitted.
    pub fn carried_turbulence(&self) -> f64 {
        self.carried_turbulence
    }

    /// The same inflow over terrain, from whose surface the heights of the profile are measured.
    #[must_use]
    pub fn over_land(self, land: Option<Arc<LandForm>>) -> Self {
        Self { land, ..self }
    }

    /// Height of the ground at a position above the bottom of the box, m; 0 without terrain, and where terrain is lower than the
    /// bottom.
    fn ground_height(&self, position: DVec3) -> f64 {
        self.land.as_ref().map_or(0.0, |land| {
            let [x, z] = [position.x, position.z].map(narrow);
            (f64::from(land.height(Vec2::new(x, z))) - self.origin.y).max(0.0)
        })
    }

    fn height_above_ground(&self, position: DVec3) -> f64 {
        position.y - self.origin.y - self.ground_height(position)
    }

    /// Mean speed at a height above the ground, m, divided by that at the reference height.
    pub fn profile(&self, height: f64) -> f64 {
        let y = height.max(0.0);
        // Divide by the value at the reference height, so that `speed` is the speed there for any profile.
        match &self.options.profile {
            WindProfile::Log(z0) => ln((y + z0) / z0) / ln((self.reference_height + z0) / z0),
            WindProfile::Power(a) => pow(y / self.reference_height, *a),
            WindProfile::Uniform => 1.0,
            WindProfile::Table(rows) => interpolate(rows, y).unwrap_or(1.0),
        }
    }

    /// Derivative of [`InletWind::profile`], 1/m, by a central difference of a quarter cell; 0 where the difference would extend
    /// below the ground.
    fn profile_slope(&self, height: f64) -> f64 {
        let step = self.spacing / 8.0;
        if height < step {
            return 0.0;
        }
        (self.profile(height + step) - self.profile(height - step)) / (2.0 * step)
    }

    /// Shear coefficient of the mean wind at a height above the ground, m, in m/s: [`shear_coefficient`] times spacing
    /// / time step.
    /// `tau`: relaxation time there, steps.
    pub(super) fn mean_shear_coefficient(&self, tau: f64, height: f64) -> f64 {
        shear_coefficient(tau, self.options.speed * self.profile_slope(height) * self.spacing)
    }

    /// Horizontal unit vector towards which the wind blows at time `t`, s.
    pub(super) fn direction(&self, t: f64) -> DVec3 {
        direction_at(&self.options, t)
    }

    /// Whether the direction of the mean wind changes.
    pub(super) fn direction_varies(&self) -> bool {
        !self.options.direction_curve.is_empty()
    }

    /// Mean speed, cells per step of `dt` s, and its reference height, cells.
    pub(super) fn speed_and_height_in_cells(&self, dt: f64) -> (f64, f64) {
        (self.options.speed * dt / self.spacing, self.reference_height / self.spacing)
    }

    /// Largest speed of mean and gusts up to a height above the ground, m, in m/s; turbulence is added to it.
    pub fn peak_speed(&self, height: f64) -> f64 {
        // Sample the profile at equidistant heights, and at the rows of a table, whose maximum may lie between these heights.
        let steps = 64;
        let fastest = (0..=steps).map(|i| self.profile(height * f64::from(i) / f64::from(steps))).fold(0.0, f64::max);
        let rows: &[[f64; 2]] = if let WindProfile::Table(rows) = &self.options.profile { rows } else { &[] };
        let fastest = rows.iter().filter(|r| r[0] <= height).map(|r| r[1]).fold(fastest, f64::max);
        self.options.speed * fastest * (1.0 + MAX_GUST * self.options.gust_strength)
    }

    /// Value of the speed curve at time `t`, s, divided by its maximum; 1 without a curve.
    pub(super) fn speed_factor(&self, t: f64) -> f64 {
        if self.options.speed_curve.is_empty() {
            1.0
        } else {
            interpolate(&self.options.speed_curve, t).unwrap_or(1.0) / self.options.speed.max(CALM_SPEED)
        }
    }

    /// Displacement of the air by the mean wind between 0 s and `t`, m: int U d dt.
    fn mean_displacement(&self, t: f64) -> DVec3 {
        let o = &self.options;
        // Speed and angle are linear between the rows of both curves: integrate from row to row, from 0 to t.
        let mut times: Vec<f64> =
            [0.0, t].into_iter().chain(o.speed_curve.iter().chain(&o.direction_curve).map(|row| row[0])).collect();
        times.retain(|time| *time * (*time - t) <= 0.0);
        times.sort_by(f64::total_cmp);
        let sum: DVec3 = times.windows(2).map(|w| self.integrate_displacement(w[0], w[1])).sum();
        if t < 0.0 { -sum } else { sum }
    }

    /// Displacement between two times, s, as in [`Self::mean_displacement`], for linear speed and angle, by the composite
    /// Simpson's rule with at most [`TURN_PER_INTERVAL`] of turn per interval.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred intervals")]
    fn integrate_displacement(&self, from: f64, to: f64) -> DVec3 {
        let velocity = |t: f64| self.direction(t) * (self.options.speed * self.speed_factor(t));
        let angle = direction_angle(&self.options, to) - direction_angle(&self.options, from);
        let intervals = (angle.abs() / TURN_PER_INTERVAL).ceil().clamp(1.0, 1e4) as u32;
        let length = (to - from) / f64::from(intervals);
        let integral = |k: u32| {
            let start = from + length * f64::from(k);
            (velocity(start) + 4.0 * velocity(start + length / 2.0) + velocity(start + length)) * (length / 6.0)
        };
        (0..intervals).map(integral).sum()
    }

    /// Values at time `t`, s, that are the same at all positions. `gust`: [`InletWind::gust_factor`] at that time.
    pub(super) fn state_at(&self, t: f64, gust: f64) -> InletState {
        InletState {
            direction: self.direction(t),
            gust,
            displacement: self.mean_displacement(t),
            speed_factor: self.speed_factor(t),
        }
    }

    /// Factor on the mean speed at time `t`, s: the speed curve times 1 + s g, where g is an Ornstein-Uhlenbeck process of unit
    /// variance, clamped to +-2, and s the gust strength.
    #[allow(clippy::cast_possible_truncation, reason = "ticks are integers")]
    pub fn gust_factor(&self, t: f64) -> f64 {
        if self.options.gust_strength <= 0.0 {
            return self.speed_factor(t);
        }
        // Between ticks, of which there are GUST_TICKS per correlation time, the process is interpolated linearly, then clamped,
        // so that `peak_speed` is a bound.
        let ticks = t * GUST_TICKS / self.options.gust_period;
        let (tick, fraction) = (ticks.floor() as i64, ticks - ticks.floor());
        let (a, b) = (self.gust_process_at_tick(tick), self.gust_process_at_tick(tick + 1));
        (1.0 + self.options.gust_strength * (a + (b - a) * fraction).clamp(-MAX_GUST, MAX_GUST)) * self.speed_factor(t)
    }

    /// [`InletWind::compute_gust_process`] at a tick, drawn once.
    fn gust_process_at_tick(&self, tick: i64) -> f64 {
        let known = self.gusts.read().unwrap_or_else(PoisonError::into_inner).get(&tick).copied();
        if let Some(value) = known {
            return value;
        }
        let value = self.compute_gust_process(tick);
        let mut gusts = self.gusts.write().unwrap_or_else(PoisonError::into_inner);
        if gusts.len() >= MOST_GUST_VALUES {
            gusts.clear();
        }
        gusts.insert(tick, value);
        value
    }

    /// Ornstein-Uhlenbeck process of unit variance at a tick, a pure function of the tick: the moving average
    /// sqrt(1 - r^2) sum_j r^j n(tick - j) of normal draws n, cut off after [`GUST_MEMORY`] correlation times.
    #[allow(clippy::cast_possible_truncation, reason = "a few hundred")]
    fn compute_gust_process(&self, tick: i64) -> f64 {
        // An AR(1) process as a finite moving average is stateless, so that any frame can be computed without the frames before
        // it.
        let decay = exp(-1.0 / GUST_TICKS);
        let (mut sum, mut weight) = (0.0, sqrt(1.0 - decay * decay));
        for age in 0..(GUST_MEMORY * GUST_TICKS) as i64 {
            let key = ["wind".into(), "gust".into(), (tick - age).into()];
            sum += weight * Rng::at(self.options.seed, &key).normal();
            weight *= decay;
        }
        sum
    }

    /// Share of the turbulence at a height above the ground, m: 0 at the ground, 1 above [`TURBULENCE_FULL_HEIGHT`] longest
    /// wavelengths.
    pub(super) fn turbulence_envelope(&self, height: f64) -> f64 {
        (height / (TURBULENCE_FULL_HEIGHT * self.turbulence_length)).clamp(0.0, 1.0)
    }

    /// Mean speed at a height above the ground, m, in m/s. `gust`: factor on the speed.
    pub(super) fn speed_at(&self, height: f64, gust: f64) -> f64 {
        self.options.speed * gust * self.profile(height)
    }

    /// Largest mean velocity of the speed curve, m/s, at a height above the ground, m, in the direction of time `t`, s.
    fn peak_mean_velocity(&self, height: f64, t: f64) -> Vec3 {
        (self.direction(t) * self.speed_at(height, 1.0)).as_vec3()
    }

    /// Velocity at a position, m, and time `t`, s, in m/s.
    pub fn velocity(&self, position: DVec3, t: f64) -> DVec3 {
        self.velocity_with_state(position, &self.state_at(t, self.gust_factor(t)))
    }

    /// Velocity at a position, m, in m/s, in a state of [`InletWind::state_at`]; 0 below the ground.
    pub(super) fn velocity_with_state(&self, position: DVec3, state: &InletState) -> DVec3 {
        let offset = position - self.origin;
        let height = offset.y - self.ground_height(position);
        if height < 0.0 {
            return DVec3::ZERO;
        }
        // Frozen turbulence: evaluate the modes at the position that the air here had at 0 s.
        let upstream = offset - state.displacement;
        let eddies: DVec3 = self.modes.iter().map(|m| m.e * cos(m.k.dot(upstream) + m.phase)).sum();
        state.direction * self.speed_at(height, state.gust)
            + eddies * (self.turbulence_envelope(height) * state.speed_factor)
    }
}

impl Wind for InletWind {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        let state = self.state_at(t, self.gust_factor(t));
        for (position, u) in positions.iter().zip(out) {
            *u = self.velocity_with_state(position.as_dvec3(), &state).as_vec3();
        }
    }

    fn mean(&self) -> Vec3 {
        self.peak_mean_velocity(10.0, 0.0)
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.peak_mean_velocity(self.height_above_ground(position.as_dvec3()), 0.0)
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        let height = self.height_above_ground(position.as_dvec3());
        (self.direction(t) * self.speed_at(height, self.speed_factor(t))).as_vec3()
    }

    fn has_varying_mean(&self) -> bool {
        !(self.options.speed_curve.is_empty() && self.options.direction_curve.is_empty())
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        (self.direction(t) * self.speed_at(10.0, self.speed_factor(t).max(LULL_SPEED_FACTOR))).as_vec3()
    }

    fn period(&self) -> Option<f64> {
        None
    }
}

/// Angle of the wind from its first direction at time `t`, s, in rad, counterclockwise as seen from above.
fn direction_angle(options: &InletOptions, t: f64) -> f64 {
    interpolate(&options.direction_curve, t).unwrap_or(0.0)
}

/// Horizontal unit vector towards which the wind blows at time `t`, s.
pub(super) fn direction_at(options: &InletOptions, t: f64) -> DVec3 {
    let d = options.direction;
    if options.direction_curve.is_empty() {
        return d;
    }
    let angle = direction_angle(options, t);
    // Rotation about +Y; positive angles turn from +X towards -Z.
    let (c, s) = (cos(angle), sin(angle));
    DVec3::new(d.x * c + d.z * s, 0.0, d.z * c - d.x * s)
}

/// Draws the modes of isotropic turbulence whose spectrum decreases as in the inertial range, for wavelengths of `longest` m and
/// less. The set of modes does not depend on the size of the cells; modes too short for cells of `spacing` m are omitted from it.
/// Also returns the root mean square of the remaining modes divided by that of all. `size`: size of the box, m.
fn fourier_modes(
    options: &InletOptions,
    longest: f64,
    spacing: f64,
    size: DVec3,
    periodic: [bool; 3],
) -> (Vec<FourierMode>, f64) {
    if options.turbulence <= 0.0 || options.turbulence_modes == 0 {
        return (Vec::new(), 1.0);
    }
    let shortest = TURBULENCE_RANGE * longest;
    let count = f64::from(options.turbulence_modes);
    // Draw one wavelength in each of `count` equal intervals of the logarithm, so that all scales are represented.
    let lengths: Vec<f64> = (0..options.turbulence_modes)
        .map(|m| {
            let exponent = (f64::from(m) + mode_rng(options.seed, m, "length").unit_f64()) / count;
            shortest * pow(longest / shortest, exponent)
        })
        .collect();
    // Kolmogorov: at logarithmic spacing a mode of wavelength l has an amplitude proportional to l^(1/3). A cosine has half its
    // squared amplitude as variance, shared by three components: sum a^2 / 6 = (intensity U)^2 gives the amplitude at 1 m.
    let power_of = |l: &f64| pow(*l, 2.0 / 3.0) / 2.0;
    let power: f64 = lengths.iter().map(power_of).sum();
    let amplitude = sqrt(3.0 / power) * options.turbulence * options.speed;
    let is_carried = |length: &f64| *length >= SHORTEST_WAVELENGTH_CELLS * spacing;
    let carried: f64 = lengths.iter().filter(|l| is_carried(l)).map(power_of).sum();
    let modes = (0..options.turbulence_modes)
        .zip(&lengths)
        .filter(|(_, length)| is_carried(length))
        .map(|(m, length)| fourier_mode(options, m, *length, amplitude, size, periodic))
        .collect();
    (modes, sqrt(carried / power))
}

/// Stream of random numbers for one property of mode `m`.
fn mode_rng(seed: u64, m: u32, property: &str) -> Rng {
    Rng::at(seed, &["wind".into(), "mode".into(), m.into(), property.into()])
}

/// Draws mode `m` of wavelength `length`, m. `amplitude`: amplitude of a mode of 1 m wavelength, m/s; `size`: size of the box, m;
/// `periodic`: axes along which it must repeat.
fn fourier_mode(
    options: &InletOptions,
    m: u32,
    length: f64,
    amplitude: f64,
    size: DVec3,
    periodic: [bool; 3],
) -> FourierMode {
    // Wave vector of the given length in a random direction.
    let mut k = random_direction(&mut mode_rng(options.seed, m, "towards")) * (TAU / length);
    // Along a periodic axis a whole number of waves, possibly none, fits the box.
    for a in 0..3 {
        if periodic[a] {
            let fundamental = TAU / size[a];
            k[a] = fundamental * (k[a] / fundamental).round();
        }
    }
    let unit = if k.length() > 0.0 { k / k.length() } else { DVec3::Y };
    // Amplitude perpendicular to k, so that div u = 0; directions nearly parallel to k are drawn again.
    let mut across = mode_rng(options.seed, m, "across");
    let e = loop {
        let e = random_direction(&mut across);
        let e = e - unit * e.dot(unit);
        if e.length() > 0.1 {
            break e / e.length();
        }
    };
    FourierMode {
        k,
        e: e * (amplitude * pow(length, 1.0 / 3.0)),
        phase: TAU * mode_rng(options.seed, m, "phase").unit_f64(),
    }
}

/// Unit vector, uniformly distributed on the sphere: a uniform y and a uniform azimuth (Archimedes).
fn random_direction(rng: &mut Rng) -> DVec3 {
    let y = 2.0 * rng.unit_f64() - 1.0;
    let (azimuth, radius) = (TAU * rng.unit_f64(), sqrt((1.0 - y * y).max(0.0)));
    DVec3::new(radius * cos(azimuth), y, radius * sin(azimuth))
}

/// Position of an inlet node, outside an inlet face.
#[derive(Debug, Clone, Copy)]
pub(super) struct InletNode {
    /// Centre of the node in the world, m.
    pub position: DVec3,
    /// Height of the ground before the face above the bottom of the box, m.
    pub ground: f64,
}

/// Inflow at every inlet node, precomputed so that a step needs no trigonometry per node:
/// `cos(k . x + phase - k . s) = cos(k . x + phase) cos(k . s) + sin(k . x + phase) sin(k . s)`, where the first factors depend
/// only on the node x and the second ones only on the displacement s of the step.
#[derive(Debug)]
pub(super) struct InletNodes {
    /// Mean speed, cells per step.
    mean: Vec<f32>,
    /// Shear coefficient of the mean ([`shear_coefficient`]), cells per step.
    shear: Vec<f32>,
    /// By mode: cosine and sine of k . x + phase at each node, times the envelope, in cells per step over m/s.
    modes: Vec<[Vec<f32>; 2]>,
}

/// Values of one step that are the same at all inlet nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct InletStep {
    /// Time since the first frame, s.
    pub time: f64,
    /// Share of the full inflow during spin-up, 0 to 1.
    pub ramp: f64,
    /// Factor on the mean wind: gust times ramp.
    pub mean_factor: f32,
    /// Unit vector towards which the wind blows.
    pub direction: [f32; 3],
}

impl InletNodes {
    /// `tau`: relaxation time, steps, at a height above the bottom of the box, m; `velocity_scale`: cells per step of 1 m/s.
    pub(super) fn new(inlet: &InletWind, nodes: &[InletNode], tau: impl Fn(f64) -> f64, velocity_scale: f64) -> Self {
        // Heights are measured from the ground before the face, which terrain may raise above the bottom of the box.
        let height = |n: &InletNode| n.position.y - inlet.origin.y - n.ground;
        let mean = |n: &InletNode| narrow(inlet.options.speed * inlet.profile(height(n)) * velocity_scale);
        let mean = nodes.iter().map(mean).collect();
        let shear = |n: &InletNode| {
            narrow(inlet.mean_shear_coefficient(tau(n.position.y - inlet.origin.y), height(n)) * velocity_scale)
        };
        let shear = nodes.iter().map(shear).collect();
        // The factors of the addition theorem that do not depend on time.
        let mode = |m: &FourierMode| {
            let phase = |n: &InletNode| m.k.dot(n.position - inlet.origin) + m.phase;
            let envelope = |n: &InletNode| inlet.turbulence_envelope(height(n)) * velocity_scale;
            [
                nodes.iter().map(|n| narrow(cos(phase(n)) * envelope(n))).collect(),
                nodes.iter().map(|n| narrow(sin(phase(n)) * envelope(n))).collect(),
            ]
        };
        let modes = inlet.modes.iter().map(mode).collect();
        Self { mean, shear, modes }
    }

    /// Velocity at every node, by component, cells per step.
    pub(super) fn compute_velocities(&self, inlet: &InletWind, step: InletStep, arch: Arch, out: &mut [Vec<f32>; 3]) {
        out.iter_mut().for_each(|o| o.resize(self.mean.len(), 0.0));
        // Compute the factors that depend only on time: one cosine and one sine per mode and step.
        let displacement = inlet.mean_displacement(step.time);
        let factor = step.ramp * inlet.speed_factor(step.time);
        let phase_shift = |m: &FourierMode| {
            let angle = m.k.dot(displacement);
            ModePhaseShift {
                amplitude: m.e.to_array().map(narrow),
                cos: narrow(cos(angle) * factor),
                sin: narrow(sin(angle) * factor),
            }
        };
        let mode_steps: Vec<_> = inlet.modes.iter().map(phase_shift).collect();
        arch.dispatch(InletVelocityKernel { nodes: self, step, mode_steps: &mode_steps, out });
    }

    /// Shear coefficient at every node along the wind, and the factors on it along x and z in this step.
    pub(super) fn shear_coefficients(&self, step: InletStep) -> (&[f32], [f32; 2]) {
        (&self.shear, [step.direction[0] * step.mean_factor, step.direction[2] * step.mean_factor])
    }

    /// Values at time `t`, s, that are the same at all nodes. `ramp`: share of the full inflow during spin-up.
    pub(super) fn prepare_step(inlet: &InletWind, t: f64, ramp: f64) -> InletStep {
        let mean_factor = narrow(inlet.gust_factor(t) * ramp);
        InletStep { time: t, ramp, mean_factor, direction: inlet.direction(t).to_array().map(narrow) }
    }
}

/// One turbulence mode in one step.
#[derive(Debug, Clone, Copy)]
struct ModePhaseShift {
    /// Velocity amplitude of the mode by component, m/s.
    amplitude: [f32; 3],
    /// Cosine of k . s, times the share of the full inflow.
    cos: f32,
    /// Sine of k . s, times the share of the full inflow.
    sin: f32,
}

/// Sums mean wind and turbulence modes at every inlet node.
struct InletVelocityKernel<'a> {
    nodes: &'a InletNodes,
    step: InletStep,
    mode_steps: &'a [ModePhaseShift],
    out: &'a mut [Vec<f32>; 3],
}

impl WithSimd for InletVelocityKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { nodes, step, mode_steps, out } = self;
        let count = nodes.mean.len();
        // Sum the mean wind first, then all modes, block by block, so that the partial sums stay in the L1 cache.
        for first in (0..count).step_by(NODE_BLOCK) {
            let block = first..count.min(first + NODE_BLOCK);
            for (out, direction) in out.iter_mut().zip(step.direction) {
                for (u, mean) in out[block.clone()].iter_mut().zip(&nodes.mean[block.clone()]) {
                    *u = direction * (mean * step.mean_factor);
                }
            }
            for (mode, [cosine, sine]) in mode_steps.iter().zip(&nodes.modes) {
                for (out, e) in out.iter_mut().zip(&mode.amplitude) {
                    let (c, s) = (e * mode.cos, e * mode.sin);
                    accumulate_mode(simd, &mut out[block.clone()], c, &cosine[block.clone()], s, &sine[block.clone()]);
                }
            }
        }
    }
}

/// sum += c cosine + s sine, element by element.
#[inline(always)]
fn accumulate_mode<S: Simd>(simd: S, sum: &mut [f32], c: f32, cosine: &[f32], s: f32, sine: &[f32]) {
    // Process whole registers, then the remaining elements one by one with the same operations.
    let (lanes, rest) = S::as_mut_simd_f32s(sum);
    let ((a, a_rest), (b, b_rest)) = (S::as_simd_f32s(cosine), S::as_simd_f32s(sine));
    let (c_all, s_all) = (F32Lanes::from_scalar(simd, c), F32Lanes::from_scalar(simd, s));
    for ((u, a), b) in lanes.iter_mut().zip(a).zip(b) {
        let term = F32Lanes::new(simd, *a) * c_all + F32Lanes::new(simd, *b) * s_all;
        *u = (F32Lanes::new(simd, *u) + term).value;
    }
    for ((u, a), b) in rest.iter_mut().zip(a_rest).zip(b_rest) {
        *u += *a * c + *b * s;
    }
}

/// Share of the full inflow, 0 to 1, after a number of steps from rest: a sudden start would cause a pressure wave in the box.
pub(super) fn spin_up_ramp(steps: u64) -> f64 {
    f64::from(math::smoothstep(0.0, RAMP_STEPS, steps.min(1000) as f32))
}

#[cfg(test)]
mod tests {
    use super::super::LatticeOptions;
    use super::*;

    /// Each evaluation would need some hundred draws for each of two ticks.
    #[test]
    fn gusts_are_drawn_once_per_tick() {
        let lattice = LatticeOptions::default();
        let inlet = InletWind::new(lattice.inlet, DVec3::ZERO, lattice.spacing, lattice.cells, [false; 3]);
        let period = inlet.options.gust_period;
        assert!(inlet.options.gust_strength > 0.0);
        // A correlation time that begins before the first frame, in many small evaluations out of order, as by threads.
        let times: Vec<f64> = (0..1000_u32).map(|k| period * (f64::from(k * 607 % 1000) / 1000.0 - 0.5)).collect();
        let asked: Vec<f64> = times.iter().map(|t| inlet.gust_factor(*t)).collect();
        let kept = inlet.gusts.read().expect("values").clone();
        assert!((32..=34).contains(&kept.len()), "{} ticks", kept.len());
        assert!(kept.iter().all(|(tick, value)| value.to_bits() == inlet.compute_gust_process(*tick).to_bits()));
        // A clone shares the values; a new inlet computes the same ones.
        let fresh = InletWind { gusts: Arc::default(), ..inlet.clone() };
        for (t, asked) in times.iter().zip(asked) {
            assert_eq!(fresh.gust_factor(*t).to_bits(), asked.to_bits());
        }
    }
}
