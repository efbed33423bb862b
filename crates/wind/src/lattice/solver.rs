//! The solver: computes a wind snapshot per frame from options and solids.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::Vec3;

use super::blockage::narrowest_open_share;
use super::cells::cell_center;
use super::collide::{MAX_SPEED, smagorinsky_factor};
use super::cut_links::CutHalfLinks;
use super::diagnostics::{FlowDiagnostics, PlaneDiagnostics, SnapshotTarget};
use super::domain::Domain;
use super::flow::{FlowState, LayerVelocityIncrement};
use super::grid::{LatticeGrid, StepParity};
use super::inlet::{InletNodes, InletStep, InletWind, spin_up_ramp};
use super::joined_sides::check_joined_sides;
use super::memory_estimate::LatticeMemory;
use super::outlet_targets::{OutletTargets, inlet_nodes, ramp_velocity_by_height};
use super::report::{LatticeStats, LatticeWarning};
use super::setup::{LatticeOptions, LatticeSetup, face_conditions, faces_ever_open, periodic_axes};
use super::snapshot::WindSnapshot;
use super::snapshot_layout::SnapshotLayout;
use super::step_tables::FlowParams;
use super::stepper::BoundaryInputs;
use super::tuning::{
    CHECK_INTERVAL, CHECKERBOARD_WARNING, DENSITY_RANGE, MAX_BLOCKAGE, MAX_CLAMPED_SHARE, REFUSED_BLOCKAGE,
};
use super::voxelize::{fill_and_check_solids, voxelize};
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::par;
use osier_base::progress::{Cancel, Progress};
use osier_base::{Error, Result};
use osier_scene::solid::{Form, Solid};

/// Number of snapshots whose memory is reused: the two between which a wind is interpolated, and the next.
const REUSED_SNAPSHOTS: usize = 3;
/// Length of a checkpoint's header, bytes.
const CHECKPOINT_HEADER: usize = 24;

/// Lattice Boltzmann solver of the wind in a box: spins up, then yields a snapshot per frame.
///
/// The spin-up starts from air at rest; it happens in [`LatticeSolver::spin_up`], or in the first call of
/// [`LatticeSolver::advance`].
#[derive(Debug)]
pub struct LatticeSolver {
    pub(super) setup: LatticeSetup,
    pub(super) flow: FlowState,
    inlet: Arc<InletWind>,
    inlet_nodes: InletNodes,
    pub(super) grid: Arc<SnapshotLayout>,
    /// Velocity at the inlet nodes in the next step and in the step after it, by component, cells per step.
    inlet_velocity: [[Vec<f32>; 3]; 2],
    outlet_targets: OutletTargets,
    /// The options, if the wind turns and faces change their conditions.
    turning: Option<LatticeOptions>,
    pub(super) warnings: Vec<LatticeWarning>,
    /// By y, along the wind, cells per step: difference of the profile from its mean, and its shear coefficient.
    ramp_velocity_by_height: Vec<[f64; 2]>,
    fluid_cells: usize,
    /// Share of the rows of cells along the wind that solids block.
    blocked: f64,
    pub(super) stats: LatticeStats,
    /// Number of snapshots delivered so far.
    frames: u32,
    /// The last snapshots, whose memory is reused.
    past: VecDeque<Arc<WindSnapshot>>,
}

impl LatticeSolver {
    /// The warnings and errors of [`LatticeSolver::new`] that follow from the options and the surfaces of the solids,
    /// without allocating any cells.
    /// # Errors
    /// As [`LatticeSolver::new`].
    pub fn check_options(options: &LatticeOptions, solids: &[Solid], limits: &Limits) -> Result<Vec<LatticeWarning>> {
        let (setup, warnings) = LatticeSetup::new(options)?;
        check_joined_sides(options, solids)?;
        limits.check("cells", setup.cell_count(), "the cells of the wind's lattice")?;
        LatticeMemory::estimate(options).check_limit(options, limits)?;
        Ok(warnings)
    }

    /// Voxelizes the solids and allocates the flow; no step is done. `solids`: obstacles in the wind.
    /// # Errors
    /// `Range` for options that contradict each other; `Limit` for too many cells; `Io` if the system cannot provide the
    /// memory; `Input` with S024 if all cells are solid, with S030 if the solids let hardly any air through, with S039 if a solid
    /// crosses one of two periodic sides.
    pub fn new(options: &LatticeOptions, solids: &[Solid], limits: &Limits) -> Result<Self> {
        // Refuse a lattice that is too large before any memory is allocated.
        let (mut setup, mut warnings) = LatticeSetup::new(options)?;
        check_joined_sides(options, solids)?;
        limits.check("cells", setup.cell_count(), "the cells of the wind's lattice")?;
        LatticeMemory::estimate(options).check_limit(options, limits)?;
        let n = setup.n;
        if LatticeGrid::population_bytes(n) / 60 > u64::from(u32::MAX) {
            let (wanted, limit) = ("more than 4,294,967,295 nodes".into(), "that".into());
            let (flag, help) = (String::new(), "use a larger dx".into());
            return Err(Error::Limit { name: "an array of the wind's lattice".into(), wanted, limit, flag, help });
        }
        // Voxelize the solids. Air is enclosed if it touches no face that is open at any time.
        let grid = LatticeGrid::new(n);
        let (origin, spacing) = (setup.origin, options.spacing);
        let faces = face_conditions(options, 0.0);
        let solid = voxelize(&grid, setup.cells(), solids);
        let cuts = CutHalfLinks::find(&grid, setup.cells(), solids, &solid);
        let mut domain = Domain { grid, faces: faces_ever_open(options), solid, cuts };
        let report = fill_and_check_solids(&mut domain, solids, setup.cells(), setup.along);
        domain.faces = faces;
        warnings.extend(report.warnings());
        check_blockage(&domain, report.blocked)?;
        setup.add_solids_to_fingerprint(&domain);
        let fluid_cells = grid.cell_count() - report.solid;
        if fluid_cells == 0 {
            return Err(all_solid_error());
        }
        let params = FlowParams {
            tau: narrow(setup.tau),
            smagorinsky_factor: narrow(smagorinsky_factor(options.smagorinsky)),
            sponge: setup.sponge_strength(faces),
            ground: setup.ground.clone(),
            force: [0.0; 3],
        };
        // Prepare the inflow, and the outflow that balances it.
        let periodic = periodic_axes(options);
        let land =
            solids.iter().find_map(|s| if let Form::Land(land) = &s.form { Some(Arc::clone(land)) } else { None });
        let inlet = InletWind::new(options.inlet.clone(), origin, spacing, options.cells, periodic).over_land(land);
        let inlet = Arc::new(inlet);
        let snapshot_layout = Arc::new(SnapshotLayout::new(&domain, setup.cells(), solids, Arc::clone(&inlet)));
        let flow = FlowState::new(domain, params, options.outlet_nonequilibrium)?;
        let inlet_nodes = inlet_nodes(&flow, &inlet, &setup);
        let outlet_targets = OutletTargets::new(&flow, &inlet, &setup);
        let ramp_velocity_by_height = ramp_velocity_by_height(&inlet, &setup);
        let stats =
            LatticeStats { steps: 0, clamped_cells: 0, peak_checkerboard: 0.0, checkerboard: 0.0, density_error: 0.0 };
        Ok(Self {
            setup,
            flow,
            inlet,
            inlet_nodes,
            grid: snapshot_layout,
            inlet_velocity: [const { [const { Vec::new() }; 3] }; 2],
            outlet_targets,
            turning: (!options.inlet.direction_curve.is_empty()).then(|| options.clone()),
            warnings,
            ramp_velocity_by_height,
            fluid_cells,
            blocked: report.blocked,
            stats,
            frames: 0,
            past: VecDeque::new(),
        })
    }

    /// The inflow without the effect of solids, which is also the wind outside the box.
    pub fn inlet(&self) -> &Arc<InletWind> {
        &self.inlet
    }

    pub(super) fn snapshot_layout(&self) -> &SnapshotLayout {
        &self.grid
    }

    /// Warnings of setup and of the steps so far, each kind once.
    pub fn warnings(&self) -> &[LatticeWarning] {
        &self.warnings
    }

    /// Statistics of the steps so far.
    pub fn stats(&self) -> LatticeStats {
        self.stats
    }

    /// Number of snapshots before time 0, which [`LatticeSolver::advance`] delivers first.
    pub fn lead_frames(&self) -> u32 {
        self.setup.lead_frames
    }

    /// Number of time steps from rest to the first snapshot.
    pub fn spin_up_steps(&self) -> u64 {
        self.setup.spin_up
    }

    /// Number of time steps of the lattice between two snapshots of [`LatticeSolver::advance`]: that of the options, or the
    /// smallest at which the wind moves no more than a tenth of a cell per step.
    pub fn steps_per_frame(&self) -> u32 {
        self.setup.steps
    }

    /// Kinematic viscosity without eddies, m^2/s, as raised by the least relaxation time.
    pub fn effective_viscosity(&self) -> f64 {
        self.setup.viscosity()
    }

    /// Does the spin-up except for its last steps, which [`LatticeSolver::advance`] does with the first snapshot; does nothing if
    /// that is done already.
    /// # Errors
    /// As [`LatticeSolver::advance`].
    pub fn spin_up(&mut self, progress: &dyn Progress, cancel: &Cancel) -> Result<()> {
        // Use an even number of steps, so that all run as fused pairs; the rest belongs to the first frame.
        let until = self.setup.spin_up.saturating_sub(1) & !1;
        if self.flow.step < until {
            progress.stage("wind", self.setup.spin_up);
        }
        par::among(|| {
            while self.flow.step < until {
                cancel.check()?;
                let steps = self.advance_one_or_two_steps(until - self.flow.step, None)?;
                progress.advance(steps);
            }
            Ok(())
        })
    }

    /// The wind of the next frame. The first call completes the spin-up and reports it to `progress`.
    /// # Errors
    /// `Input` with S024 when the flow diverges, `Cancelled` when asked to stop.
    pub fn advance(&mut self, progress: &dyn Progress, cancel: &Cancel) -> Result<Arc<WindSnapshot>> {
        let mut values = self.snapshot_buffer();
        // Stay inside the thread pool for the whole frame: entering it for every step costs more than small steps do.
        par::among(|| self.run_to_next_frame(&mut values, progress, cancel))?;
        let time = self.setup.snapshot_time(f64::from(self.frames));
        self.frames += 1;
        let snapshot = Arc::new(WindSnapshot { grid: Arc::clone(&self.grid), values, time });
        self.past.push_back(Arc::clone(&snapshot));
        Ok(snapshot)
    }

    /// Memory for a snapshot: that of an earlier snapshot without other owners, because touching fresh memory takes as long as a
    /// step.
    fn snapshot_buffer(&mut self) -> Vec<[f32; 4]> {
        // A strong count of 1: only this queue still refers to it.
        let free = self.past.iter().position(|old| Arc::strong_count(old) == 1);
        if let Some(old) = free.and_then(|k| self.past.remove(k)).and_then(|old| Arc::try_unwrap(old).ok()) {
            return old.values;
        }
        // Drop the oldest snapshots; a caller that still holds them keeps them alive.
        while self.past.len() >= REUSED_SNAPSHOTS {
            self.past.pop_front();
        }
        vec![[0.0; 4]; self.grid.value_count()]
    }

    /// Runs to the next frame and writes its snapshot.
    fn run_to_next_frame(&mut self, values: &mut [[f32; 4]], progress: &dyn Progress, cancel: &Cancel) -> Result<()> {
        // Frame k is reached after the spin-up and k times the steps of a frame.
        let until = self.setup.spin_up + u64::from(self.frames) * u64::from(self.setup.steps);
        if self.frames == 0 && self.flow.step == 0 {
            progress.stage("wind", until);
        }
        self.update_faces(u64::from(self.frames))?;
        let grid = Arc::clone(&self.grid);
        let speed_unit = narrow(self.setup.speed_unit());
        if self.flow.step == until {
            let diagnostics = self.flow.write_snapshot(SnapshotTarget { grid: &grid, speed_unit, values });
            self.check_flow(&diagnostics)?;
        }
        while self.flow.step < until {
            cancel.check()?;
            // The pass that does the last step writes the snapshot.
            let left = until - self.flow.step;
            let last = left == 1 || left == 2 && self.flow.next_parity() == StepParity::Even;
            let target = last.then(|| SnapshotTarget { grid: &grid, speed_unit, values: &mut *values });
            let steps = self.advance_one_or_two_steps(left, target)?;
            if self.frames == 0 {
                progress.advance(steps);
            }
        }
        grid.fill_halo_planes(values);
        Ok(())
    }

    /// Does one step, or two in one pass if at least two remain and the first is even. Returns the number.
    fn advance_one_or_two_steps(&mut self, left: u64, target: Option<SnapshotTarget<'_>>) -> Result<u64> {
        // The inflow and outlet targets of both steps of a pass must be known before it begins.
        let two = left >= 2 && self.flow.next_parity() == StepParity::Even;
        let now = self.update_inlet(0);
        let inflow = [now, if two { self.update_inlet(1) } else { now }];
        let [first, second] = [0, 1].map(|k| {
            let (shear, shear_scale) = self.inlet_nodes.shear_coefficients(inflow[k]);
            let outlet_velocity = self.outlet_targets.outlet_velocity(self.flow.domain.faces, inflow[k]);
            BoundaryInputs { inlet_velocity: &self.inlet_velocity[k], shear, shear_scale, outlet_velocity }
        });
        let (before, written) = (self.flow.step, target.is_some());
        let report = self.flow.advance_one_or_two_steps(first, two.then_some(second), target);
        self.stats.steps = self.flow.step;
        self.add_profile_while_ramping(before);
        for (step, count) in (before + 1..).zip(report.clamped) {
            if count > 0 {
                self.count_and_limit_clamped(step, count)?;
            }
        }
        // A written snapshot includes diagnostics; without a snapshot they are computed at intervals.
        if written {
            self.check_flow(&report.diagnostics)?;
        } else if before / CHECK_INTERVAL < self.flow.step / CHECK_INTERVAL {
            let diagnostics = self.flow.diagnose();
            self.check_flow(&diagnostics)?;
        }
        Ok(self.flow.step - before)
    }

    /// While the inflow increases, adds the increase of its profile to the air inside. The pressure that drives the start-up
    /// accelerates all heights equally; without this the slow air near the ground would have to travel in from the inlet.
    fn add_profile_while_ramping(&mut self, before: u64) {
        // The increase of the ramp in this pass; 0 after the ramp.
        let rise = spin_up_ramp(self.flow.step) - spin_up_ramp(before);
        if rise > 0.0 {
            let t = self.step_time(before);
            let (d, factor) = (self.inlet.direction(t), self.inlet.speed_factor(t) * rise);
            let along = |u: f64| [d.x, d.z].map(|d| narrow(u * d * factor));
            let layer = |[velocity, shear]: &[f64; 2]| LayerVelocityIncrement {
                velocity: along(*velocity),
                shear: along(*shear),
            };
            let layers: Vec<_> = self.ramp_velocity_by_height.iter().map(layer).collect();
            self.flow.add_layer_velocities(&layers);
        }
    }

    /// Time of a step, s; steps count from rest.
    fn step_time(&self, step: u64) -> f64 {
        (step as f64 - self.setup.spin_up as f64) * self.setup.dt + self.setup.snapshot_time(0.0)
    }

    /// Computes the inflow of the step `ahead` steps from now.
    fn update_inlet(&mut self, ahead: usize) -> InletStep {
        let step = self.flow.step + ahead as u64;
        let now = InletNodes::prepare_step(&self.inlet, self.step_time(step), spin_up_ramp(step));
        self.inlet_nodes.compute_velocities(&self.inlet, now, self.flow.tables.arch, &mut self.inlet_velocity[ahead]);
        now
    }

    /// Sets the conditions of the faces for the interval before a frame, if the wind turns.
    fn update_faces(&mut self, frame: u64) -> Result<()> {
        let Some(options) = &self.turning else { return Ok(()) };
        // Half a frame earlier: the conditions in the middle of the interval before the frame.
        let faces = face_conditions(options, self.setup.snapshot_time(frame as f64 - 0.5));
        if faces != self.flow.domain.faces {
            self.flow.set_faces(faces, self.setup.sponge_strength(faces))?;
            self.inlet_nodes = inlet_nodes(&self.flow, &self.inlet, &self.setup);
            self.outlet_targets = OutletTargets::new(&self.flow, &self.inlet, &self.setup);
        }
        Ok(())
    }

    #[cold]
    fn count_and_limit_clamped(&mut self, step: u64, count: u64) -> Result<()> {
        let speed = MAX_SPEED * self.setup.speed_unit();
        if self.stats.clamped_cells == 0 {
            let [x, y, z] = self.flow.fastest_cell();
            let at = cell_center(self.setup.cells(), [x, y, z]);
            let text = format!(
                "the lattice wind was faster than {speed:.1} m/s in {count} cells at step {step}, fastest in cell ({x}, {y}, \
                 {z}) at ({:.2}, {:.2}, {:.2}) m, and was clamped; lower wind.speed, or set wind.lattice.steps to more than {}",
                at.x, at.y, at.z, self.setup.steps
            );
            self.warnings.push(LatticeWarning { code: "S022", text });
        }
        self.stats.clamped_cells += count;
        if count as f64 > MAX_CLAMPED_SHARE * self.fluid_cells as f64 {
            return Err(self.new_divergence_error(format!("more than {speed:.1} m/s in {count} cells")));
        }
        Ok(())
    }

    /// Fails if a density is out of range; warns of a checkerboard.
    fn check_flow(&mut self, diagnostics: &FlowDiagnostics) -> Result<()> {
        // Report the first cell out of range, with its known properties.
        let planes = &diagnostics.planes;
        let bad = planes.iter().enumerate().find_map(|(z, p)| p.out_of_range.map(|[x, y]| [x, y, z]));
        if let Some(cell) = bad {
            let (drho, u) = self.flow.moments_at(cell);
            let at = cell_center(self.setup.cells(), cell);
            let u = Vec3::from_array(u) * narrow(self.setup.speed_unit());
            return Err(self.new_divergence_error(format!(
                "density {:.3} (allowed {} to {}) and velocity ({:.2}, {:.2}, {:.2}) m/s in cell ({}, {}, {}) at ({:.2}, \
                 {:.2}, {:.2}) m",
                1.0 + drho, DENSITY_RANGE[0], DENSITY_RANGE[1], u.x, u.y, u.z, cell[0], cell[1], cell[2], at.x, at.y, at.z
            )));
        }
        // Mean density error (drift of the total mass) and mean checkerboard, over fluid cells.
        let sum = |f: &dyn Fn(&PlaneDiagnostics) -> f64| planes.iter().map(f).sum::<f64>();
        self.stats.density_error = sum(&|p| p.mass) / self.fluid_cells as f64;
        let checkerboard = (sum(&|p| p.checkerboard) / self.fluid_cells as f64).abs();
        if checkerboard > CHECKERBOARD_WARNING && self.stats.peak_checkerboard <= CHECKERBOARD_WARNING {
            let text = format!(
                "the density of the lattice wind has a checkerboard pattern of {checkerboard:.1e} at step {}; raise \
                 wind.lattice.tau_floor",
                self.flow.step
            );
            self.warnings.push(LatticeWarning { code: "S023", text });
        }
        self.stats.peak_checkerboard = self.stats.peak_checkerboard.max(checkerboard);
        self.stats.checkerboard = checkerboard;
        Ok(())
    }

    fn new_divergence_error(&self, what: String) -> Error {
        let message = format!("the lattice wind diverged in frame {} at step {}: {what}", self.frames, self.flow.step);
        let wider = if self.blocked > MAX_BLOCKAGE {
            format!(
                "enlarge the box with wind.lattice.cells (solids block {:.0} % of its section), ",
                100.0 * self.blocked
            )
        } else {
            String::new()
        };
        let help = format!(
            "{wider}raise wind.lattice.tau_floor or wind.lattice.steps (now {}), or lower wind.speed",
            self.setup.steps
        );
        Diagnostic::about("S024", message).help(help).into()
    }

    /// The flow as bytes, to continue from with [`LatticeSolver::resume`]: step and frame, exchange history, populations.
    pub fn checkpoint(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(self.setup.fingerprint().to_le_bytes());
        bytes.extend(self.flow.step.to_le_bytes());
        bytes.extend(u64::from(self.frames).to_le_bytes());
        self.flow.exchange.checkpoint_values().for_each(|value| bytes.extend(value.to_le_bytes()));
        for array in self.flow.populations.arrays() {
            array.iter().for_each(|g| bytes.extend(g.to_le_bytes()));
        }
        bytes
    }

    /// Continues from the checkpoint of a solver with the same options, seed and solids; all later results have the bytes of an
    /// uninterrupted run.
    /// # Errors
    /// `Input` if the checkpoint is of another lattice wind.
    pub fn resume(&mut self, bytes: &[u8]) -> Result<()> {
        let (head, body) = bytes.split_at_checked(CHECKPOINT_HEADER).ok_or_else(checkpoint_mismatch_error)?;
        // Header: fingerprint, step, frame.
        let word = |k: usize| head[8 * k..].first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b));
        let frames = u32::try_from(word(2)).map_err(|_| checkpoint_mismatch_error())?;
        self.update_faces(word(2).saturating_sub(1))?;
        let elements: usize = self.flow.populations.arrays().iter().map(|a| a.len()).sum();
        let history = self.flow.exchange.checkpoint_values().count();
        if word(0) != self.setup.fingerprint() || body.len() != 4 * (elements + history) {
            return Err(checkpoint_mismatch_error());
        }
        (self.flow.step, self.frames) = (word(1), frames);
        let (history, populations) = body.split_at(4 * history);
        let mut populations = populations.as_chunks::<4>().0.iter();
        for array in self.flow.populations.arrays_mut() {
            array.iter_mut().zip(&mut populations).for_each(|(g, b)| *g = f32::from_le_bytes(*b));
        }
        // Rebuild the buffers from the populations, then restore the state that these do not determine.
        self.flow.exchange.rebuild_from_populations(&self.flow.populations, self.flow.next_parity());
        let history = history.as_chunks::<4>().0;
        self.flow.exchange.checkpoint_values_mut().zip(history).for_each(|(value, b)| *value = f32::from_le_bytes(*b));
        Ok(())
    }

    /// Bytes of memory of the solver, without snapshots.
    pub fn memory_bytes(&self) -> u64 {
        LatticeGrid::population_bytes(self.setup.n)
            + self.flow.exchange.memory_bytes() as u64
            + 3 * self.flow.domain.solid.len() as u64
            + self.flow.domain.cuts.memory_bytes() as u64
    }
}

/// Fails if the solids leave the wind hardly any passage. `blocked`: share of the rows of cells that they block.
fn check_blockage(domain: &Domain, blocked: f64) -> Result<()> {
    // The exact search is costly, and unnecessary while enough rows are free.
    if blocked <= REFUSED_BLOCKAGE {
        return Ok(());
    }
    let open = narrowest_open_share(domain, 1.0 - REFUSED_BLOCKAGE);
    if open >= 1.0 - REFUSED_BLOCKAGE {
        return Ok(());
    }
    let share = 100.0 * (1.0 - open);
    let message =
        format!("solids block {share:.0} % of the section of the lattice wind's inflow: the air cannot pass them");
    let help =
        "enlarge the box with wind.lattice.cells until half of the section stays open, or leave a gap in the solids";
    Err(Diagnostic::about("S030", message).help(help).into())
}

fn all_solid_error() -> Error {
    let message = "all cells of the lattice wind are inside solids";
    Diagnostic::about("S024", message).help("move or enlarge the box of the lattice").into()
}

/// The error of a checkpoint that is damaged, or was written by a lattice with other options, seed or solids.
pub(super) fn checkpoint_mismatch_error() -> Error {
    let message = "the checkpoint is of another lattice wind";
    Diagnostic::about("S025", message).help("simulate the wind from the start").into()
}
