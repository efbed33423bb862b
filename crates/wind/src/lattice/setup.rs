//! Options of the lattice wind, and quantities derived from them: lattice units, boundary conditions and time steps.

use glam::DVec3;

use super::cells::CellGeometry;
use super::domain::{Domain, FaceCondition};
use super::ground::GroundModel;
use super::inlet::{InletOptions, InletWind, WindProfile, direction_at};
use super::report::LatticeWarning;
use super::tuning::{
    MAX_SPONGE_SHARE, MIN_CARRIED_TURBULENCE, MIN_TAU_WITHOUT_EDDIES, OPEN_SIDES_CROSSINGS, PARALLEL_COMPONENT,
    REFUSED_SPEED, SLOW_SPEED, SPIN_UP_SOUND_CROSSINGS, SPONGE_CELLS, SPONGE_DEPTH, TARGET_SPEED, WARN_SPEED,
};
use osier_base::math::{cos, narrow};
use osier_base::physics::AIR_VISCOSITY;
use osier_base::rng;
use osier_base::{Error, Result};

/// Boundary condition of the two vertical faces parallel to the wind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SideCondition {
    /// Periodic if the wind is within a degree of an axis, otherwise open.
    Auto,
    /// Free slip: no flow through the face, no friction at it.
    Slip,
    /// Inlet or outlet, depending on the direction of the wind.
    Open,
}

/// Friction at the bottom face; the height profile of the inflow is set separately.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GroundCondition {
    /// Wall stress of a logarithmic profile over a roughness length, m.
    Rough(f64),
    /// No slip: a wall half a cell below the lowest cell centres, by halfway bounce-back.
    Smooth,
}

/// Box, inflow, faces and numerics of a [`LatticeSolver`](super::LatticeSolver).
#[derive(Debug, Clone, PartialEq)]
pub struct LatticeOptions {
    /// Number of cells along x, y and z.
    pub cells: [u32; 3],
    /// Edge of a cubic cell, m.
    pub spacing: f64,
    /// Centre of the bottom face, m, which is the ground.
    pub base_center: DVec3,
    /// Profile, gusts and turbulence of the inflow.
    pub inlet: InletOptions,
    /// Kinematic viscosity, m^2/s; higher where the relaxation time would be less than `tau_floor`.
    pub viscosity: f64,
    /// Frame rate of the snapshots, frames per second.
    pub fps: f64,
    /// Number of time steps per frame; `None` for the smallest at which the wind moves no more than a tenth of a cell per step.
    pub steps_per_frame: Option<u32>,
    /// Smagorinsky constant; 0 for no eddy viscosity.
    pub smagorinsky: f64,
    /// Least relaxation time, steps, above 0.5.
    pub tau_floor: f64,
    /// Friction at the bottom face. A roughness length given here does not change the profile of the inflow.
    pub ground: GroundCondition,
    /// Condition of the two vertical faces that are parallel to the wind, or most nearly so.
    pub sides: SideCondition,
    /// Whether outlets also extrapolate the non-equilibrium part of the populations, which damps the flow less.
    pub outlet_nonequilibrium: bool,
    /// Depth of the sponge before each outlet, cells, over which the viscosity rises; `None` for 4 m, within limits.
    pub sponge_cells: Option<u32>,
    /// Spin-up time before the first snapshot, s; `None` for one flow through the box, two with open sides.
    pub spin_up: Option<f64>,
    /// Number of snapshots before time 0, at which gusts and the curves of speed and direction begin.
    pub lead_frames: u32,
}

impl Default for LatticeOptions {
    /// A cube of 70 cells of 0.5 m per axis, 4.5 m/s towards +X, 24 frames per second: the defaults of a scene file.
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
                turbulence_length: None,
                turbulence_modes: 24,
                seed: 0,
            },
            viscosity: AIR_VISCOSITY,
            fps: 24.0,
            steps_per_frame: None,
            smagorinsky: 0.16,
            tau_floor: 0.5005,
            ground: GroundCondition::Rough(0.05),
            sides: SideCondition::Auto,
            outlet_nonequilibrium: false,
            sponge_cells: None,
            spin_up: None,
            lead_frames: 0,
        }
    }
}

impl LatticeOptions {
    /// Lowest corner of the box, m.
    pub(super) fn origin(&self) -> DVec3 {
        let size = DVec3::from_array(self.cells.map(f64::from)) * self.spacing;
        self.base_center - DVec3::new(size.x, 0.0, size.z) / 2.0
    }

    /// Whether the flow is periodic along x and along z.
    pub fn periodic_sides(&self) -> [bool; 2] {
        let [x, _, z] = periodic_axes(self);
        [x, z]
    }
}

/// Axes along which the flow is periodic, so that their two faces are joined.
pub(super) fn periodic_axes(options: &LatticeOptions) -> [bool; 3] {
    let faces = face_conditions(options, 0.0);
    [0, 2, 4].map(|f| faces[f] == FaceCondition::Periodic)
}

/// Lattice units and durations derived from the options, such as time step, relaxation time and spin-up.
#[derive(Debug, Clone)]
pub(super) struct LatticeSetup {
    pub n: [usize; 3],
    pub origin: DVec3,
    pub spacing: f64,
    pub fps: f64,
    /// Time steps from one snapshot to the next.
    pub steps: u32,
    /// Duration of a time step, s.
    pub dt: f64,
    /// Relaxation time of the kinematic viscosity, steps, at least `tau_floor` of the options.
    pub tau: f64,
    pub ground: GroundModel,
    /// Axis to which the wind is most nearly parallel, 0 or 2.
    pub along: usize,
    /// Number of time steps before the first snapshot.
    pub spin_up: u64,
    /// Number of snapshots before time 0.
    pub lead_frames: u32,
    /// Depth of the sponge before each outlet, cells.
    sponge: f64,
    /// Hash of options, solid cells and cut links: a checkpoint fits only a flow with the same one.
    fingerprint: u64,
}

fn range_error(name: &str, value: f64, min: f64, max: f64, unit: &'static str) -> Error {
    Error::Range { name: name.to_owned(), value, min, max, unit }
}

/// An option of a lattice wind that contradicts others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LatticeFault {
    /// Too few time steps: the wind would cross too many cells in one step.
    TimeSteps {
        /// Requested number per frame.
        steps: u32,
        /// Least number per frame.
        needed: f64,
    },
    /// Too short a relaxation time for a flow without eddy viscosity.
    RelaxationTime {
        /// The relaxation time, steps.
        tau: f64,
        /// Least relaxation time, steps.
        least: f64,
    },
}

impl From<LatticeFault> for Error {
    fn from(fault: LatticeFault) -> Self {
        match fault {
            LatticeFault::TimeSteps { steps, needed } => {
                range_error("wind.lattice.steps", f64::from(steps), needed, 1e6, "steps per frame for this wind")
            }
            LatticeFault::RelaxationTime { tau, least } => {
                range_error("wind.lattice.tau_floor without smagorinsky", tau, least, 1.0, "steps")
            }
        }
    }
}

/// The first of the options that contradicts others, for messages before a solver is created; `None` if there is none.
pub fn lattice_fault(options: &LatticeOptions) -> Option<LatticeFault> {
    let height = f64::from(options.cells[1]) * options.spacing;
    let (origin, periodic) = (options.origin(), periodic_axes(options));
    let inlet = InletWind::new(options.inlet.clone(), origin, options.spacing, options.cells, periodic);
    time_step(options, inlet.peak_speed(height), &mut Vec::new()).err()
}

/// Time step and relaxation time.
struct TimeStep {
    /// Steps per frame.
    steps: u32,
    /// Time step, s.
    dt: f64,
    /// Relaxation time of the kinematic viscosity, steps.
    tau: f64,
}

/// Time step and relaxation time of the options. `peak`: largest speed of the inflow, m/s.
fn time_step(
    options: &LatticeOptions,
    peak: f64,
    warnings: &mut Vec<LatticeWarning>,
) -> std::result::Result<TimeStep, LatticeFault> {
    let steps = steps_per_frame(options, peak, warnings)?;
    let dt = 1.0 / (options.fps * f64::from(steps));
    let tau = (0.5 + 3.0 * options.viscosity * dt / (options.spacing * options.spacing)).max(options.tau_floor);
    if options.smagorinsky <= 0.0 && tau < MIN_TAU_WITHOUT_EDDIES {
        return Err(LatticeFault::RelaxationTime { tau, least: MIN_TAU_WITHOUT_EDDIES });
    }
    Ok(TimeStep { steps, dt, tau })
}

impl LatticeSetup {
    /// Converts the options to lattice units. Fails with `Range` if options contradict each other.
    pub(super) fn new(options: &LatticeOptions) -> Result<(Self, Vec<LatticeWarning>)> {
        let direction = options.inlet.direction;
        if direction.y.abs() > 1e-9 || (direction.length() - 1.0).abs() > 1e-6 {
            return Err(range_error("the length of the wind's horizontal direction", direction.length(), 1.0, 1.0, ""));
        }
        check_direction_curve(options)?;
        // The box, its faces and the inflow, in metres.
        let n = options.cells.map(|n| n as usize);
        let size = DVec3::from_array(options.cells.map(f64::from)) * options.spacing;
        let origin = options.origin();
        let along = usize::from(direction.z.abs() > direction.x.abs()) * 2;
        let periodic = periodic_axes(options);
        let inlet = InletWind::new(options.inlet.clone(), origin, options.spacing, options.cells, periodic);
        // The largest inflow speed determines the time step, and nu = (tau - 1/2)/3 in lattice units the relaxation time.
        let peak = inlet.peak_speed(size.y);
        let mut warnings: Vec<LatticeWarning> =
            warn_of_unresolved_turbulence(&inlet, options.spacing).into_iter().collect();
        let TimeStep { steps, dt, tau } = time_step(options, peak, &mut warnings)?;
        let ground = match options.ground {
            GroundCondition::Rough(z0) => {
                let (speed, height) = inlet.speed_and_height_in_cells(dt);
                GroundModel::for_log_profile(z0 / options.spacing, tau, options.smagorinsky, speed, height, n[1])
            }
            GroundCondition::Smooth => GroundModel::default(),
        };
        let spin_up = spin_up_steps(options, dt, size, n, along);
        // Include the spin-up steps: their default is not one of the options, and after another spin-up the gusts differ.
        let fingerprint = rng::child(options_hash(options), spin_up);
        let (spacing, fps, lead_frames) = (options.spacing, options.fps, options.lead_frames);
        let sponge = options.sponge_cells.map_or_else(|| default_sponge_depth(n[along], spacing), f64::from);
        let setup =
            Self { n, origin, spacing, fps, steps, dt, tau, ground, along, spin_up, lead_frames, sponge, fingerprint };
        Ok((setup, warnings))
    }

    /// Time of a snapshot, s. `snapshot`: index counted from the first snapshot; may be fractional.
    pub(super) fn snapshot_time(&self, snapshot: f64) -> f64 {
        (snapshot - f64::from(self.lead_frames)) / self.fps
    }

    pub(super) fn cells(&self) -> CellGeometry {
        CellGeometry { origin: self.origin, spacing: self.spacing }
    }

    pub(super) fn cell_count(&self) -> u64 {
        self.n.iter().map(|n| *n as u64).product()
    }

    /// Unit of velocity: one cell per step in m/s.
    pub(super) fn speed_unit(&self) -> f64 {
        self.spacing / self.dt
    }

    /// Relaxation time, steps, at a height above the bottom of the box, m, outside the sponge.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "cells, cut at both ends")]
    pub(super) fn tau_without_sponge(&self, height: f64) -> f64 {
        let y = (height / self.spacing).clamp(0.0, 1e6) as usize;
        f64::from(self.ground.min_tau_at(y, narrow(self.tau)))
    }

    /// Kinematic viscosity of the lattice, m^2/s; at the least relaxation time it is far above that of air.
    pub(super) fn viscosity(&self) -> f64 {
        (self.tau - 0.5) * self.spacing * self.spacing / (3.0 * self.dt)
    }

    /// Hash of options, solid cells and cut links; a checkpoint fits only a lattice with the same fingerprint.
    pub(super) fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Adds the solid cells and cut half links, packed into words of 64 bits, to the fingerprint.
    pub(super) fn add_solids_to_fingerprint(&mut self, domain: &Domain) {
        let cells = domain.solid.chunks(64).map(|c| c.iter().fold(0, |bits, s| bits << 1 | u64::from(*s)));
        let halves = domain.cuts.halves().chunks(4).map(|c| c.iter().fold(0, |bits, h| bits << 16 | u64::from(*h)));
        self.fingerprint = cells.chain(halves).fold(self.fingerprint, rng::child);
    }

    /// Strength of the sponge by x and by z: it increases with the square of the depth from 0 to 1 at an outlet; in proportion to
    /// it the relaxation time increases to 1.
    pub(super) fn sponge_strength(&self, faces: [FaceCondition; 6]) -> [Vec<f32>; 2] {
        let strength = |axis: usize| {
            let (n, depth) = (self.n[axis], self.sponge);
            // Depth into the sponge from either face, divided by its thickness; with the square the sponge begins smoothly, so
            // that it reflects little.
            let at_cell = |x: usize| {
                let low = if faces[2 * axis] == FaceCondition::Outlet { depth - x as f64 } else { 0.0 };
                let high = if faces[2 * axis + 1] == FaceCondition::Outlet { depth - (n - 1 - x) as f64 } else { 0.0 };
                let share = if depth > 0.0 { low.max(high).max(0.0) / depth } else { 0.0 };
                narrow(share * share)
            };
            (0..n).map(at_cell).collect()
        };
        [strength(0), strength(2)]
    }
}

/// Boundary condition of each face at time `t`, s. A vertical face is an inlet if the wind blows into the box there, and an
/// outlet if it blows out; if the wind is parallel to it, [`LatticeOptions::sides`] determines the condition.
pub(super) fn face_conditions(options: &LatticeOptions, t: f64) -> [FaceCondition; 6] {
    // `across`: the horizontal axis to which the wind is less parallel; its two faces are the sides.
    let d = direction_at(&options.inlet, t);
    let across = if d.z.abs() > d.x.abs() { 0 } else { 2 };
    // A turning wind does not stay parallel to an axis, and its turning emits sound waves, which slip faces would reflect again
    // and again: all its sides are open.
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
        // Component of the wind along the outward normal of face f: in, out, or parallel.
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

/// Boundary conditions in which each face that is open at any time is open, for the sizes of tables. In a turning wind the choice
/// of inlet or outlet is a placeholder.
pub(super) fn faces_ever_open(options: &LatticeOptions) -> [FaceCondition; 6] {
    let mut faces = face_conditions(options, 0.0);
    if !options.inlet.direction_curve.is_empty() {
        [faces[0], faces[1], faces[4], faces[5]] =
            [FaceCondition::Inlet, FaceCondition::Outlet, FaceCondition::Inlet, FaceCondition::Outlet];
    }
    faces
}

/// Checks that a turning wind turns only after spin-up, in ascending times, and that its sides can be open.
fn check_direction_curve(options: &LatticeOptions) -> Result<()> {
    let turns = &options.inlet.direction_curve;
    if let Some(first) = turns.first().filter(|row| row[0] < 0.0) {
        return Err(range_error("the first time of the wind's direction curve", first[0], 0.0, 1e9, "s"));
    }
    if turns.windows(2).any(|w| w[0][0] >= w[1][0]) || !turns.is_empty() && options.sides == SideCondition::Slip {
        return Err(range_error(
            "the validity of the wind's direction curve (ascending times, sides other than slip)",
            0.0,
            1.0,
            1.0,
            "",
        ));
    }
    Ok(())
}

/// Depth of a sponge, cells: [`SPONGE_DEPTH`] within limits. `cells`: length of the box along the wind.
fn default_sponge_depth(cells: usize, spacing: f64) -> f64 {
    let [least, most] = SPONGE_CELLS;
    (SPONGE_DEPTH / spacing).round().clamp(least, most).min((MAX_SPONGE_SHARE * cells as f64).round().max(least))
}

/// Warns if the cells are too coarse for the turbulence of the inflow.
fn warn_of_unresolved_turbulence(inlet: &InletWind, spacing: f64) -> Option<LatticeWarning> {
    let carried = inlet.carried_turbulence();
    let text = format!(
        "cells of {spacing} m carry only {:.0} % of the inflow's turbulence, whose eddies are {:.1} m long; lower \
         wind.lattice.dx or raise wind.lattice.turbulence_length",
        100.0 * carried,
        inlet.turbulence_length()
    );
    (carried < MIN_CARRIED_TURBULENCE).then_some(LatticeWarning { code: "S033", text })
}

/// Number of steps per frame: the requested one, or the smallest at which the wind moves no more than [`TARGET_SPEED`] cells per
/// step. `peak`: largest speed of the inflow, m/s.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few, or refused")]
fn steps_per_frame(
    options: &LatticeOptions,
    peak: f64,
    warnings: &mut Vec<LatticeWarning>,
) -> std::result::Result<u32, LatticeFault> {
    let cells_per_frame = peak / (options.fps * options.spacing);
    // 1e-9: a quotient that is an integer except for rounding counts as that integer.
    let needed = (cells_per_frame / TARGET_SPEED - 1e-9).ceil().max(1.0);
    let steps = options.steps_per_frame.unwrap_or(needed.min(1e6) as u32).max(1);
    let speed = cells_per_frame / f64::from(steps);
    if speed > REFUSED_SPEED {
        return Err(LatticeFault::TimeSteps { steps, needed });
    }
    if speed > WARN_SPEED {
        let text = format!(
            "the lattice wind moves {speed:.3} cells per step, at which compressibility errors are large; set \
             wind.lattice.steps to {needed} or more"
        );
        warnings.push(LatticeWarning { code: "S020", text });
    }
    if speed < SLOW_SPEED {
        let text = format!(
            "the lattice wind moves only {speed:.4} cells per step, so that rounding errors are no longer small; lower \
             wind.lattice.steps or wind.lattice.dx"
        );
        warnings.push(LatticeWarning { code: "S020", text });
    }
    Ok(steps)
}

/// Number of steps before the first frame: the requested one, or one flow through the box ([`OPEN_SIDES_CROSSINGS`] with open
/// sides), but at least [`SPIN_UP_SOUND_CROSSINGS`] crossings of sound, whose speed is 1/sqrt(3) cells per step.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times are limited")]
fn spin_up_steps(options: &LatticeOptions, dt: f64, size: DVec3, n: [usize; 3], along: usize) -> u64 {
    if let Some(seconds) = options.spin_up {
        return (seconds / dt).ceil() as u64;
    }
    // Inlet and outlet are always open; further open faces are sides.
    let open = face_conditions(options, 0.0).into_iter().filter(|face| face.is_open()).count();
    let crossings = if open > 2 { OPEN_SIDES_CROSSINGS } else { 1.0 };
    // Sound crosses one cell in sqrt(3) steps.
    let flow_through = crossings * size[along] / options.inlet.speed.max(0.01) / dt;
    let longest = n.iter().copied().max().unwrap_or(0) as f64;
    flow_through.max(SPIN_UP_SOUND_CROSSINGS * longest * osier_base::math::sqrt(3.0)).ceil() as u64
}

/// Hash of the `Debug` output of the options.
fn options_hash(options: &LatticeOptions) -> u64 {
    rng::word(&format!("{options:?}"))
}
