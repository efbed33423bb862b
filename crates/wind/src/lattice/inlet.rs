//! The wind that comes in, as a function of place and time: profile, gusts and turbulence.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};
use pulp::{Arch, Simd, WithSimd};

use super::super::{CALM_SPEED, Wind};
use super::ground::shear_coefficient;
use super::tuning::{
    GUST_MEMORY, GUST_TICKS, MAX_GUST, RAMP_STEPS, TURBULENCE_FULL_HEIGHT, TURBULENCE_WAVELENGTHS, TURN_PER_INTERVAL,
};
use osier_base::math::{self, cos, exp, ln, narrow, pow, sin, sqrt};
use osier_base::rng::Rng;
use osier_base::simd::F32Lanes;

/// How the mean grows with the height above the ground.
#[derive(Debug, Clone, PartialEq)]
pub enum WindProfile {
    /// ln((y + z0)/z0) over its value at the reference height; roughness z0, m.
    Log(f64),
    /// A power of the height over the reference height.
    Power(f64),
    /// The same at all heights.
    Uniform,
    /// Heights, m, rising, and factors on the speed; straight between them.
    Table(Vec<[f64; 2]>),
}

/// What comes in.
#[derive(Debug, Clone, PartialEq)]
pub struct InletOptions {
    /// Level unit vector that the wind blows towards.
    pub direction: DVec3,
    /// Mean speed at the reference height, m/s.
    pub speed: f64,
    /// Times, s, rising, and speeds there, m/s, straight between them and the same before and after; none for always `speed`, which is the largest
    /// of them.
    pub speed_curve: Vec<[f64; 2]>,
    /// Times, s, from 0 on and rising, and by what angles, rad, the wind has turned there from `direction` to the left as seen from above,
    /// straight between them and the same before and after; none for never.
    pub direction_curve: Vec<[f64; 2]>,
    /// How it grows with the height.
    pub profile: WindProfile,
    /// Height at which the speed is `speed`, m; none for 10 m, or the height of the box if that is less.
    pub reference_height: Option<f64>,
    /// Strength of gusts over the mean.
    pub gust_strength: f64,
    /// Time after which a gust is forgotten, s.
    pub gust_period: f64,
    /// Strength of each component of turbulence over the mean.
    pub turbulence: f64,
    /// Waves that turbulence is made of.
    pub turbulence_modes: u32,
    /// Seed of gusts and turbulence.
    pub seed: u64,
}

/// Inlet nodes whose waves are summed at a time: their sums stay in the nearest cache.
const NODES_AT_A_TIME: usize = 1024;

/// One wave of turbulence.
#[derive(Debug, Clone, Copy)]
struct FourierMode {
    /// Wave vector, 1/m.
    k: DVec3,
    /// Velocity, m/s, across the wave vector: it has no divergence.
    e: DVec3,
    phase: f64,
}

/// Air that comes in: u = gust(t) U p(y) d + u'(x - int U d dt). As a wind of its own it has no wakes.
/// Source: own, after Kraichnan's random Fourier modes; \[catkin\] names no inlet.
#[derive(Debug, Clone)]
pub struct InletWind {
    options: InletOptions,
    /// Lowest corner of the box, m, whose bottom is the ground.
    origin: DVec3,
    /// Spacing of the lattice, m.
    spacing: f64,
    reference: f64,
    modes: Vec<FourierMode>,
}

/// What holds everywhere at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct InletState {
    direction: DVec3,
    /// Factor on the mean.
    gust: f64,
    /// How far the mean has taken the air since 0 s, m.
    way: DVec3,
    /// Speed over the largest.
    strength: f64,
}

impl InletWind {
    /// `origin`: lowest corner of the box, m; `spacing`: of the lattice, m; `cells`: its size. `periodic`: axes whose
    /// faces are joined, on which turbulence repeats.
    pub fn new(options: InletOptions, origin: DVec3, spacing: f64, cells: [u32; 3], periodic: [bool; 3]) -> Self {
        let size = DVec3::from_array(cells.map(f64::from)) * spacing;
        let reference = options.reference_height.unwrap_or(size.y.min(10.0));
        let modes = fourier_modes(&options, spacing, size, periodic);
        Self { options, origin, spacing, reference, modes }
    }

    /// Factor on the speed at a height above the ground, m.
    pub fn profile(&self, height: f64) -> f64 {
        let y = height.max(0.0);
        match &self.options.profile {
            WindProfile::Log(z0) => ln((y + z0) / z0) / ln((self.reference + z0) / z0),
            WindProfile::Power(a) => pow(y / self.reference, *a),
            WindProfile::Uniform => 1.0,
            WindProfile::Table(rows) => interpolate_rows(rows, y),
        }
    }

    /// Growth of that factor with the height, 1/m.
    fn profile_slope(&self, height: f64) -> f64 {
        let near = self.spacing / 8.0;
        if height < near {
            return 0.0;
        }
        (self.profile(height + near) - self.profile(height - near)) / (2.0 * near)
    }

    /// How the mean wind leans at a height along its direction ([`super::ground::lean`]), m/s. `tau`: relaxation time there.
    pub(super) fn shear_at(&self, tau: f64, height: f64) -> f64 {
        shear_coefficient(tau, self.options.speed * self.profile_slope(height) * self.spacing)
    }

    /// Level unit vector that the wind blows towards at a time, s.
    pub(super) fn direction(&self, t: f64) -> DVec3 {
        direction_at(&self.options, t)
    }

    /// Mean speed, cells in a step of `dt` s, and the height at which it is that, cells.
    pub(super) fn speed_and_height_in_cells(&self, dt: f64) -> (f64, f64) {
        (self.options.speed * dt / self.spacing, self.reference / self.spacing)
    }

    /// The fastest mean with gusts, up to a height, m/s.
    pub fn peak(&self, height: f64) -> f64 {
        let steps = 64;
        let fastest = (0..=steps).map(|i| self.profile(height * f64::from(i) / f64::from(steps))).fold(0.0, f64::max);
        let rows: &[[f64; 2]] = if let WindProfile::Table(rows) = &self.options.profile { rows } else { &[] };
        let fastest = rows.iter().filter(|r| r[0] <= height).map(|r| r[1]).fold(fastest, f64::max);
        self.options.speed * fastest * (1.0 + MAX_GUST * self.options.gust_strength)
    }

    /// Speed at a time over the largest.
    pub(super) fn speed_factor(&self, t: f64) -> f64 {
        if self.options.speed_curve.is_empty() {
            1.0
        } else {
            interpolate_rows(&self.options.speed_curve, t) / self.options.speed.max(CALM_SPEED)
        }
    }

    /// How far the mean wind has taken the air since 0 s, m.
    fn mean_displacement(&self, t: f64) -> DVec3 {
        let o = &self.options;
        // Between the times of both curves all is straight.
        let mut times: Vec<f64> =
            [0.0, t].into_iter().chain(o.speed_curve.iter().chain(&o.direction_curve).map(|row| row[0])).collect();
        times.retain(|at| *at * (*at - t) <= 0.0);
        times.sort_by(f64::total_cmp);
        let all: DVec3 = times.windows(2).map(|w| self.displacement_between(w[0], w[1])).sum();
        if t < 0.0 { -all } else { all }
    }

    /// The same between two times between which speed and angle are straight lines, by Simpson's rule.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred parts")]
    fn displacement_between(&self, from: f64, to: f64) -> DVec3 {
        let velocity = |t: f64| self.direction(t) * (self.options.speed * self.speed_factor(t));
        let angle = angle(&self.options, to) - angle(&self.options, from);
        let parts = (angle.abs() / TURN_PER_INTERVAL).ceil().clamp(1.0, 1e4) as u32;
        let long = (to - from) / f64::from(parts);
        let part = |k: u32| {
            let at = from + long * f64::from(k);
            (velocity(at) + 4.0 * velocity(at + long / 2.0) + velocity(at + long)) * (long / 6.0)
        };
        (0..parts).map(part).sum()
    }

    /// What holds everywhere at a time. `gust`: factor on the mean.
    pub(super) fn state_at(&self, t: f64, gust: f64) -> InletState {
        InletState {
            direction: self.direction(t),
            gust,
            way: self.mean_displacement(t),
            strength: self.speed_factor(t),
        }
    }

    /// Factor on the mean: the curve of speeds, and gusts, an Ornstein-Uhlenbeck process of unit variance, cut at two, times the strength.
    pub fn gust(&self, t: f64) -> f64 {
        self.gust_from(t, |tick| self.ornstein_uhlenbeck(tick))
    }

    /// The same from draws by tick.
    #[allow(clippy::cast_possible_truncation, reason = "whole numbers of ticks")]
    fn gust_from(&self, t: f64, mut drawn: impl FnMut(i64) -> f64) -> f64 {
        if self.options.gust_strength <= 0.0 {
            return self.speed_factor(t);
        }
        let ticks = t * GUST_TICKS / self.options.gust_period;
        let (tick, part) = (ticks.floor() as i64, ticks - ticks.floor());
        let (a, b) = (drawn(tick), drawn(tick + 1));
        (1.0 + self.options.gust_strength * (a + (b - a) * part).clamp(-MAX_GUST, MAX_GUST)) * self.speed_factor(t)
    }

    /// The process at a tick: what is left of all draws before.
    #[allow(clippy::cast_possible_truncation, reason = "a few hundred")]
    fn ornstein_uhlenbeck(&self, tick: i64) -> f64 {
        let keep = exp(-1.0 / GUST_TICKS);
        let (mut sum, mut share) = (0.0, sqrt(1.0 - keep * keep));
        for late in 0..(GUST_MEMORY * GUST_TICKS) as i64 {
            let key = ["wind".into(), "gust".into(), (tick - late).into()];
            sum += share * Rng::at(self.options.seed, &key).normal();
            share *= keep;
        }
        sum
    }

    /// The part of turbulence that is left near the ground.
    pub(super) fn envelope(&self, height: f64) -> f64 {
        (height / (TURBULENCE_FULL_HEIGHT * self.spacing)).clamp(0.0, 1.0)
    }

    /// Speed of the mean at a height, m/s.
    pub(super) fn mean_speed(&self, height: f64, gust: f64) -> f64 {
        self.options.speed * gust * self.profile(height)
    }

    /// Mean velocity at a height, m, as it blows at a time, s.
    pub(super) fn mean_then(&self, height: f32, t: f64) -> Vec3 {
        (self.direction(t) * self.mean_speed(f64::from(height) - self.origin.y, 1.0)).as_vec3()
    }

    /// Velocity at a place, m, and time, s.
    pub fn velocity(&self, place: DVec3, t: f64) -> DVec3 {
        self.velocity_in(place, &self.state_at(t, self.gust(t)))
    }

    pub(super) fn velocity_in(&self, place: DVec3, now: &InletState) -> DVec3 {
        let at = place - self.origin;
        if at.y < 0.0 {
            return DVec3::ZERO;
        }
        let came = at - now.way;
        let eddies: DVec3 = self.modes.iter().map(|m| m.e * cos(m.k.dot(came) + m.phase)).sum();
        now.direction * self.mean_speed(at.y, now.gust) + eddies * (self.envelope(at.y) * now.strength)
    }
}

impl Wind for InletWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        let now = self.state_at(t, self.gust(t));
        for (place, u) in places.iter().zip(out) {
            *u = self.velocity_in(place.as_dvec3(), &now).as_vec3();
        }
    }

    fn mean(&self) -> Vec3 {
        self.mean_at(10.0)
    }

    fn mean_at(&self, height: f32) -> Vec3 {
        self.mean_then(height, 0.0)
    }

    fn period(&self) -> Option<f64> {
        None
    }
}

/// By how much a wind has turned at a time, rad.
fn angle(options: &InletOptions, t: f64) -> f64 {
    if options.direction_curve.is_empty() { 0.0 } else { interpolate_rows(&options.direction_curve, t) }
}

/// Level unit vector that a wind blows towards at a time, s.
pub(super) fn direction_at(options: &InletOptions, t: f64) -> DVec3 {
    let d = options.direction;
    if options.direction_curve.is_empty() {
        return d;
    }
    let angle = angle(options, t);
    let (c, s) = (cos(angle), sin(angle));
    DVec3::new(d.x * c + d.z * s, 0.0, d.z * c - d.x * s)
}

/// Straight lines between rows.
fn interpolate_rows(rows: &[[f64; 2]], y: f64) -> f64 {
    let above = rows.partition_point(|r| r[0] <= y);
    match (above.checked_sub(1).and_then(|i| rows.get(i)), rows.get(above)) {
        (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (y - a[0]) / (b[0] - a[0]),
        (Some(only), None) | (None, Some(only)) => only[1],
        (None, None) => 1.0,
    }
}

fn fourier_modes(options: &InletOptions, spacing: f64, size: DVec3, periodic: [bool; 3]) -> Vec<FourierMode> {
    if options.turbulence <= 0.0 || options.turbulence_modes == 0 {
        return Vec::new();
    }
    let shortest = TURBULENCE_WAVELENGTHS[0] * spacing;
    let longest = (TURBULENCE_WAVELENGTHS[1] * spacing).min(size.y).max(shortest);
    let count = f64::from(options.turbulence_modes);
    let lengths: Vec<f64> = (0..options.turbulence_modes)
        .map(|m| {
            let place = (f64::from(m) + draw(options.seed, m, "length").unit_f64()) / count;
            shortest * pow(longest / shortest, place)
        })
        .collect();
    // Of half the sum of the squares of all strengths, each component has a third.
    let power: f64 = lengths.iter().map(|l| pow(*l, 2.0 / 3.0) / 2.0).sum();
    let strength = sqrt(3.0 / power) * options.turbulence * options.speed;
    (0..options.turbulence_modes)
        .zip(&lengths)
        .map(|(m, length)| fourier_mode(options, m, *length, strength, size, periodic))
        .collect()
}

fn draw(seed: u64, m: u32, what: &str) -> Rng {
    Rng::at(seed, &["wind".into(), "mode".into(), m.into(), what.into()])
}

/// One wave of a length, m. `strength`: amplitude of a wave of 1 m, m/s; `size`: of the box, m; `periodic`: axes on which it
/// repeats.
fn fourier_mode(
    options: &InletOptions,
    m: u32,
    length: f64,
    strength: f64,
    size: DVec3,
    periodic: [bool; 3],
) -> FourierMode {
    let mut k = random_direction(&mut draw(options.seed, m, "towards")) * (TAU / length);
    for a in 0..3 {
        if periodic[a] {
            let whole = TAU / size[a];
            k[a] = whole * (k[a] / whole).round();
        }
    }
    let unit = if k.length() > 0.0 { k / k.length() } else { DVec3::Y };
    let mut across = draw(options.seed, m, "across");
    let e = loop {
        let e = random_direction(&mut across);
        let e = e - unit * e.dot(unit);
        if e.length() > 0.1 {
            break e / e.length();
        }
    };
    FourierMode {
        k,
        e: e * (strength * pow(length, 1.0 / 3.0)),
        phase: TAU * draw(options.seed, m, "phase").unit_f64(),
    }
}

/// A direction, all alike.
fn random_direction(rng: &mut Rng) -> DVec3 {
    let y = 2.0 * rng.unit_f64() - 1.0;
    let (turn, level) = (TAU * rng.unit_f64(), sqrt((1.0 - y * y).max(0.0)));
    DVec3::new(level * cos(turn), y, level * sin(turn))
}

/// The wind at every place where air comes into a lattice.
#[derive(Debug)]
pub(super) struct InletNodes {
    /// Mean speed, cells a step.
    mean: Vec<f32>,
    /// How the mean leans with the height, as [`super::ground::lean`] has it.
    lean: Vec<f32>,
    /// By wave: cosine and sine of its phase at each place, times the envelope.
    waves: Vec<[Vec<f32>; 2]>,
    gusts: GustCache,
}

/// What is the same at every place where air comes in, in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct InletStep {
    /// Time, s, and share of the wind that blows already.
    pub at: (f64, f64),
    /// Factor on the mean wind, with that share.
    pub share: f32,
    /// Direction it blows towards.
    pub toward: [f32; 3],
}

impl InletNodes {
    /// `places`: where, m, with the height of the ground there over the bottom of the box, m. `tau`: relaxation time at a height over that bottom, m.
    /// `pace`: cells a step of 1 m/s.
    pub(super) fn new(inlet: &InletWind, places: &[(DVec3, f64)], tau: impl Fn(f64) -> f64, pace: f64) -> Self {
        let height = |(place, ground): &(DVec3, f64)| place.y - inlet.origin.y - ground;
        let mean = places.iter().map(|p| narrow(inlet.options.speed * inlet.profile(height(p)) * pace)).collect();
        let lean = |p: &(DVec3, f64)| narrow(inlet.shear_at(tau(p.0.y - inlet.origin.y), height(p)) * pace);
        let lean = places.iter().map(lean).collect();
        let wave = |m: &FourierMode| {
            let turn = |p: &(DVec3, f64)| m.k.dot(p.0 - inlet.origin) + m.phase;
            let strong = |p: &(DVec3, f64)| inlet.envelope(height(p)) * pace;
            [
                places.iter().map(|p| narrow(cos(turn(p)) * strong(p))).collect(),
                places.iter().map(|p| narrow(sin(turn(p)) * strong(p))).collect(),
            ]
        };
        let waves = inlet.modes.iter().map(wave).collect();
        Self { mean, lean, waves, gusts: GustCache::default() }
    }

    /// Velocity at every place, by component, cells a step.
    pub(super) fn velocities(&self, inlet: &InletWind, now: InletStep, arch: Arch, out: &mut [Vec<f32>; 3]) {
        out.iter_mut().for_each(|o| o.resize(self.mean.len(), 0.0));
        let (t, ramp) = now.at;
        let (way, ramp) = (inlet.mean_displacement(t), ramp * inlet.speed_factor(t));
        let turn = |m: &FourierMode| {
            let late = m.k.dot(way);
            (m.e.to_array().map(narrow), narrow(cos(late) * ramp), narrow(sin(late) * ramp))
        };
        let waves: Vec<_> = inlet.modes.iter().map(turn).collect();
        arch.dispatch(VelocityKernel { nodes: self, now, waves: &waves, out });
    }

    /// How the mean leans at every place with the height, and by how much of that along x and z.
    pub(super) fn shear(&self, now: InletStep) -> (&[f32], [f32; 2]) {
        (&self.lean, [now.toward[0] * now.share, now.toward[2] * now.share])
    }

    /// What blows at a time, s. `ramp`: share of the wind that blows already.
    pub(super) fn step_at(&mut self, inlet: &InletWind, t: f64, ramp: f64) -> InletStep {
        let share = narrow(inlet.gust_from(t, |tick| self.gusts.draw(inlet, tick)) * ramp);
        InletStep { at: (t, ramp), share, toward: inlet.direction(t).to_array().map(narrow) }
    }
}

/// Draws of gusts, which hold for many steps.
#[derive(Debug, Default)]
struct GustCache([Option<(i64, f64)>; 2]);

impl GustCache {
    fn draw(&mut self, inlet: &InletWind, tick: i64) -> f64 {
        let slot = &mut self.0[usize::from(tick.rem_euclid(2) == 1)];
        match slot {
            Some((known, drawn)) if *known == tick => *drawn,
            _ => slot.insert((tick, inlet.ornstein_uhlenbeck(tick))).1,
        }
    }
}

struct VelocityKernel<'a> {
    nodes: &'a InletNodes,
    now: InletStep,
    /// Of every wave: velocity, cosine and sine of the phase now.
    waves: &'a [([f32; 3], f32, f32)],
    out: &'a mut [Vec<f32>; 3],
}

impl WithSimd for VelocityKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { nodes, now, waves, out } = self;
        let all = nodes.mean.len();
        for first in (0..all).step_by(NODES_AT_A_TIME) {
            let here = first..all.min(first + NODES_AT_A_TIME);
            for (out, along) in out.iter_mut().zip(now.toward) {
                for (u, mean) in out[here.clone()].iter_mut().zip(&nodes.mean[here.clone()]) {
                    *u = along * (mean * now.share);
                }
            }
            for ((e, c, s), [cosine, sine]) in waves.iter().zip(&nodes.waves) {
                for (out, e) in out.iter_mut().zip(e) {
                    // cos(a - b) = cos a cos b + sin a sin b.
                    add_wave(simd, &mut out[here.clone()], e * c, &cosine[here.clone()], e * s, &sine[here.clone()]);
                }
            }
        }
    }
}

/// to += c cosine + s sine, element by element.
#[inline(always)]
fn add_wave<S: Simd>(simd: S, to: &mut [f32], c: f32, cosine: &[f32], s: f32, sine: &[f32]) {
    let (lanes, rest) = S::as_mut_simd_f32s(to);
    let ((a, a_rest), (b, b_rest)) = (S::as_simd_f32s(cosine), S::as_simd_f32s(sine));
    let (c_all, s_all) = (F32Lanes::from_scalar(simd, c), F32Lanes::from_scalar(simd, s));
    for ((u, a), b) in lanes.iter_mut().zip(a).zip(b) {
        let wave = F32Lanes::new(simd, *a) * c_all + F32Lanes::new(simd, *b) * s_all;
        *u = (F32Lanes::new(simd, *u) + wave).value;
    }
    for ((u, a), b) in rest.iter_mut().zip(a_rest).zip(b_rest) {
        *u += *a * c + *b * s;
    }
}

/// How much of the wind blows after so many steps from rest: a sudden start would send a wave of pressure.
pub(super) fn spin_up_ramp(steps: u64) -> f64 {
    f64::from(math::smoothstep(0.0, RAMP_STEPS, steps.min(1000) as f32))
}
