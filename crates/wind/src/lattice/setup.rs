//! Units, faces and steps of a lattice, from what a scene says.

use glam::DVec3;

use super::domain::FaceCondition;
use super::ground::GroundModel;
use super::inlet::{InletOptions, InletWind, WindProfile, direction_at};
use super::report::LatticeWarning;
use super::tuning::{
    MIN_TAU_WITHOUT_EDDIES, PARALLEL_COMPONENT, REFUSED_SPEED, SLOW_SPEED, SPIN_UP_SOUND_CROSSINGS, TARGET_SPEED,
    WARN_SPEED,
};
use osier_base::math::{cos, narrow};
use osier_base::rng;
use osier_base::{Error, Result};

/// What the faces along the wind do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SideCondition {
    /// Joined, if the wind blows along an axis; else open.
    Auto,
    /// Nothing passes, nothing drags.
    Slip,
    /// Air comes in or goes out, as the wind has it.
    Open,
}

/// What the ground does to the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GroundCondition {
    /// It takes the stress of a logarithmic profile over a roughness, m.
    Rough(f64),
    /// It holds the air, half a cell below the lowest middles.
    Smooth,
}

/// What a lattice wind is like.
#[derive(Debug, Clone, PartialEq)]
pub struct LatticeOptions {
    /// Cells along x, y and z.
    pub cells: [u32; 3],
    /// Spacing, m.
    pub spacing: f64,
    /// Middle of the bottom of the box, m: the ground.
    pub base_center: DVec3,
    /// What comes in.
    pub inlet: InletOptions,
    /// Kinematic viscosity, m^2/s.
    pub viscosity: f64,
    /// Frames a second.
    pub fps: f64,
    /// Steps a frame; none for as many as are needed.
    pub steps_per_frame: Option<u32>,
    /// Smagorinsky's constant; 0 for no eddy viscosity.
    pub smagorinsky: f64,
    /// Least relaxation time, steps.
    pub tau_floor: f64,
    /// The bottom of the box.
    pub ground: GroundCondition,
    /// Faces along the wind.
    pub sides: SideCondition,
    /// Outlets also pass on what is beside the equilibrium: less damped.
    pub outlet_nonequilibrium: bool,
    /// Cells before an outlet in which the air thickens.
    pub sponge_cells: u32,
    /// Time before the first frame, s; none for one flow through the box.
    pub spin_up: Option<f64>,
}

impl Default for LatticeOptions {
    /// What a scene that says nothing gets: 70 cells of half a metre each way, 4.5 m/s towards +X, 24 frames a second.
    fn default() -> Self {
        Self {
            cells: [70; 3],
            spacing: 0.5,
            base_center: DVec3::ZERO,
            inlet: InletOptions {
                direction: DVec3::X,
                speed: 4.5,
                speed_curve: Vec::new(),
                direction_curve: Vec::new(),
                profile: WindProfile::Log(0.05),
                reference_height: None,
                gust_strength: 0.2,
                gust_period: 8.0,
                turbulence: 0.1,
                turbulence_modes: 24,
                seed: 0,
            },
            viscosity: 1.5e-5,
            fps: 24.0,
            steps_per_frame: None,
            smagorinsky: 0.16,
            tau_floor: 0.5005,
            ground: GroundCondition::Rough(0.05),
            sides: SideCondition::Auto,
            outlet_nonequilibrium: false,
            sponge_cells: 8,
            spin_up: None,
        }
    }
}

/// What follows from the options.
#[derive(Debug, Clone)]
pub(super) struct LatticeSetup {
    pub n: [usize; 3],
    pub origin: DVec3,
    pub spacing: f64,
    pub fps: f64,
    /// Steps a frame, and the time of one, s.
    pub steps: u32,
    pub dt: f64,
    pub tau: f64,
    pub ground: GroundModel,
    /// Axis that the wind is most along.
    pub along: usize,
    /// Steps before the first frame.
    pub spin_up: u64,
    sponge: u32,
    key: u64,
}

fn range(name: &str, value: f64, min: f64, max: f64, unit: &'static str) -> Error {
    Error::Range { name: name.to_owned(), value, min, max, unit }
}

impl LatticeSetup {
    pub(super) fn new(options: &LatticeOptions) -> Result<(Self, Vec<LatticeWarning>)> {
        let direction = options.inlet.direction;
        if direction.y.abs() > 1e-9 || (direction.length() - 1.0).abs() > 1e-6 {
            return Err(range("the length of the wind's level direction", direction.length(), 1.0, 1.0, ""));
        }
        check_direction_curve(options)?;
        let n = options.cells.map(|n| n as usize);
        let size = DVec3::from_array(options.cells.map(f64::from)) * options.spacing;
        let origin = options.base_center - DVec3::new(size.x, 0.0, size.z) / 2.0;
        let faces = face_conditions(options, 0.0);
        let along = usize::from(direction.z.abs() > direction.x.abs()) * 2;
        let mut notes = Vec::new();
        let periodic = [0, 2, 4].map(|f| faces[f] == FaceCondition::Periodic);
        let inlet = InletWind::new(options.inlet.clone(), origin, options.spacing, options.cells, periodic);
        let peak = inlet.peak(size.y);
        let steps = steps_per_frame(options, peak, &mut notes)?;
        let dt = 1.0 / (options.fps * f64::from(steps));
        let tau = (0.5 + 3.0 * options.viscosity * dt / (options.spacing * options.spacing)).max(options.tau_floor);
        if options.smagorinsky <= 0.0 && tau < MIN_TAU_WITHOUT_EDDIES {
            return Err(range("wind.lattice.tau_floor without smagorinsky", tau, MIN_TAU_WITHOUT_EDDIES, 1.0, "steps"));
        }
        let ground = match options.ground {
            GroundCondition::Rough(z0) => {
                let (speed, height) = inlet.speed_and_height_in_cells(dt);
                GroundModel::rough(z0 / options.spacing, tau, options.smagorinsky, speed, height, n[1])
            }
            GroundCondition::Smooth => GroundModel::default(),
        };
        let spin_up = spin_up_steps(options, dt, size, n, along);
        let key = key(options);
        let (spacing, fps, sponge) = (options.spacing, options.fps, options.sponge_cells);
        Ok((Self { n, origin, spacing, fps, steps, dt, tau, ground, along, spin_up, sponge, key }, notes))
    }

    pub(super) fn cell_count(&self) -> u64 {
        self.n.iter().map(|n| *n as u64).product()
    }

    /// m/s of one cell a step.
    pub(super) fn speed_unit(&self) -> f64 {
        self.spacing / self.dt
    }

    /// Relaxation time at a height over the bottom, m, where no sponge is.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "cells, cut at both ends")]
    pub(super) fn tau_at(&self, height: f64) -> f64 {
        let y = (height / self.spacing).clamp(0.0, 1e6) as usize;
        f64::from(self.ground.min_tau_at(y, narrow(self.tau)))
    }

    /// Kinematic viscosity in effect, m^2/s.
    pub(super) fn viscosity(&self) -> f64 {
        (self.tau - 0.5) * self.spacing * self.spacing / (3.0 * self.dt)
    }

    /// What tells one lattice from another.
    pub(super) fn fingerprint(&self) -> u64 {
        self.key
    }

    /// Counts what stands in the wind among what tells lattices apart.
    pub(super) fn add_solids_to_key(&mut self, solid: &[bool]) {
        let bits = solid.chunks(64).map(|c| c.iter().fold(0, |bits, s| bits << 1 | u64::from(*s)));
        self.key = bits.fold(self.key, rng::child);
    }

    /// Shares of a sponge by x and by z: towards an outlet they rise to 1, where relaxation times do.
    pub(super) fn sponge(&self, faces: [FaceCondition; 6]) -> [Vec<f32>; 2] {
        let rise = |axis: usize| {
            let (n, depth) = (self.n[axis], f64::from(self.sponge));
            let at = |x: usize| {
                let low = if faces[2 * axis] == FaceCondition::Outlet { depth - x as f64 } else { 0.0 };
                let high = if faces[2 * axis + 1] == FaceCondition::Outlet { depth - (n - 1 - x) as f64 } else { 0.0 };
                let share = if depth > 0.0 { low.max(high).max(0.0) / depth } else { 0.0 };
                narrow(share * share)
            };
            (0..n).map(at).collect()
        };
        [rise(0), rise(2)]
    }
}

/// What the faces do at a time, s: where the wind blows in from outside, it comes in.
pub(super) fn face_conditions(options: &LatticeOptions, t: f64) -> [FaceCondition; 6] {
    let d = direction_at(&options.inlet, t);
    let across = if d.z.abs() > d.x.abs() { 0 } else { 2 };
    // A wind that turns does not stay along an axis; and when it turns it sounds, which sides that slip would keep for ever.
    let turns = !options.inlet.direction_curve.is_empty();
    let straight = !turns && d[across].abs() < cos(std::f64::consts::FRAC_PI_2 - 1.0_f64.to_radians());
    std::array::from_fn(|f| {
        let axis = f / 2;
        if axis == 1 {
            return match options.ground {
                _ if f == 3 => FaceCondition::Slip,
                GroundCondition::Rough(_) => FaceCondition::Rough,
                GroundCondition::Smooth => FaceCondition::Wall([0.0; 3]),
            };
        }
        let side = axis == across;
        match options.sides {
            SideCondition::Auto if side && straight => return FaceCondition::Periodic,
            SideCondition::Slip if side => return FaceCondition::Slip,
            _ => {}
        }
        let out = d[axis] * if f.is_multiple_of(2) { -1.0 } else { 1.0 };
        if out < -PARALLEL_COMPONENT {
            FaceCondition::Inlet
        } else if out > PARALLEL_COMPONENT || turns {
            FaceCondition::Outlet
        } else {
            FaceCondition::Slip
        }
    })
}

/// Faces with as many open as there will be.
pub(super) fn most_open_faces(options: &LatticeOptions) -> [FaceCondition; 6] {
    let mut all = face_conditions(options, 0.0);
    if !options.inlet.direction_curve.is_empty() {
        [all[0], all[1], all[4], all[5]] =
            [FaceCondition::Inlet, FaceCondition::Outlet, FaceCondition::Inlet, FaceCondition::Outlet];
    }
    all
}

/// A wind that turns does so in the clip, not while it sets in, and through all four sides.
fn check_direction_curve(options: &LatticeOptions) -> Result<()> {
    let turns = &options.inlet.direction_curve;
    if let Some(first) = turns.first().filter(|row| row[0] < 0.0) {
        return Err(range("the first time of a wind that turns", first[0], 0.0, 1e9, "s"));
    }
    if turns.windows(2).any(|w| w[0][0] >= w[1][0]) || !turns.is_empty() && options.sides == SideCondition::Slip {
        return Err(range("turns that rise in time, and open sides", 0.0, 1.0, 1.0, ""));
    }
    Ok(())
}

/// Steps a frame: the fewest at which the wind does not pass a tenth of a cell.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few, or refused")]
fn steps_per_frame(options: &LatticeOptions, peak: f64, notes: &mut Vec<LatticeWarning>) -> Result<u32> {
    let one = peak / (options.fps * options.spacing);
    let wanted = options.steps_per_frame.unwrap_or((one / TARGET_SPEED - 1e-9).ceil().clamp(1.0, 1e6) as u32).max(1);
    let speed = one / f64::from(wanted);
    let needed = (one / TARGET_SPEED - 1e-9).ceil().max(1.0);
    if speed > REFUSED_SPEED {
        return Err(range("wind.lattice.steps", f64::from(wanted), needed, 1e6, "steps a frame for this wind"));
    }
    if speed > WARN_SPEED {
        let text = format!(
            "the lattice wind passes {speed:.3} cells a step, which is coarse; {needed} steps a frame would be fine"
        );
        notes.push(LatticeWarning { code: "S020", text });
    }
    if speed < SLOW_SPEED {
        let text = format!(
            "the lattice wind passes only {speed:.4} cells a step and drowns in rounding; take fewer steps a frame or a \
             smaller dx"
        );
        notes.push(LatticeWarning { code: "S020", text });
    }
    Ok(wanted)
}

/// Steps before the first frame: one flow through the box, at least three passages of sound.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times are limited")]
fn spin_up_steps(options: &LatticeOptions, dt: f64, size: DVec3, n: [usize; 3], along: usize) -> u64 {
    if let Some(seconds) = options.spin_up {
        return (seconds / dt).ceil() as u64;
    }
    let through = size[along] / options.inlet.speed.max(0.01) / dt;
    let longest = n.iter().copied().max().unwrap_or(0) as f64;
    through.max(SPIN_UP_SOUND_CROSSINGS * longest * osier_base::math::sqrt(3.0)).ceil() as u64
}

fn key(options: &LatticeOptions) -> u64 {
    rng::word(&format!("{options:?}"))
}

impl WindProfile {
    /// Whether its rows rise and its numbers are within their ranges.
    pub fn is_sound(&self) -> bool {
        match self {
            Self::Log(z0) => *z0 > 0.0,
            Self::Power(a) => *a >= 0.0,
            Self::Uniform => true,
            Self::Table(rows) => !rows.is_empty() && rows.windows(2).all(|w| w[0][0] < w[1][0]),
        }
    }
}
