//! The lattice Boltzmann wind of a recipe: options, plan of its run, steps from frame to frame, memory estimate, checks.

use std::sync::Arc;

use glam::{DVec3, Vec2};

use crate::bake::BakeContext;
use crate::bake::assets::obstacles::{Obstacles, reads_lattice_wind};
use crate::bake::cache::wind_spin_up;
use crate::bake::wind::needs::WindNeeds;
use crate::recipe::scene::{SolidShape, WindSolver};
use crate::recipe::{Recipe, SolidRecipe};
use osier_base::diagnostic::{Diagnostic, Report, codes};
use osier_base::files::BakeCache;
use osier_base::geometry::Bounds;
use osier_base::limits::{Limits, grouped};
use osier_base::math::narrow;
use osier_base::progress::{Cancel, Progress, Silent};
use osier_base::{Error, Result};
use osier_scene::solid::{Form, LandForm, Solid};
use osier_wind::{
    InletWind, InterpolatedWind, LatticeMemory, LatticeOptions, LatticeSolver, LatticeStats, LatticeWarning,
    RecordingOptions, Wind, WindSnapshot,
};

/// Solids around which a recipe's lattice wind flows, including the land if it reaches the centre of a cell; empty for every
/// other wind.
pub fn lattice_solids(recipe: &Recipe, obstacles: &Obstacles<'_>) -> Vec<Solid> {
    if !reads_lattice_wind(recipe) {
        return Vec::new();
    }
    let [x, _, z] = recipe.lattice.cells;
    // Sample the land over a square around the origin that contains the domain.
    let side = 2.0 * (x.max(z) * recipe.lattice.cell_size + recipe.lattice.at[0].abs().max(recipe.lattice.at[2].abs()));
    // Lower land, such as the waves of a ground, is represented by the bottom of the box with its wall stress: bounce-back at the
    // links that it cuts would slow the wind like smooth ground.
    let options = recipe.lattice_options();
    let is_met = |solid: &&Solid| match &solid.form {
        Form::Land(land) => reaches_a_center(land, &options),
        Form::Prism(_) | Form::Shell(_) => true,
    };
    obstacles.solids_and_land(narrow(side)).list().iter().filter(is_met).cloned().collect()
}

/// Whether a land reaches the centre of a cell of a lattice's box; its height elsewhere has no effect.
fn reaches_a_center(land: &LandForm, options: &LatticeOptions) -> bool {
    let (base, spacing) = (options.base_center, options.spacing);
    let lowest_centers = base.y + spacing / 2.0;
    // Coordinates of the centres along a horizontal axis; the base of the box is in its middle.
    let centers =
        |n: u32, middle: f64| (0..n).map(move |i| narrow(middle + (f64::from(i) + 0.5 - f64::from(n) / 2.0) * spacing));
    // For most lands the highest point is sufficient for the decision, without a test of the columns of cells.
    f64::from(land.height_range()[1]) > lowest_centers
        && centers(options.cells[0], base.x).any(|x| {
            centers(options.cells[2], base.z).any(|z| f64::from(land.height(Vec2::new(x, z))) > lowest_centers)
        })
}

/// The analytic replacement of a lattice wind: profile and gusts of its inlet in the whole domain, without the influence of
/// solids.
pub fn analytic_inlet(recipe: &Recipe, land: Option<Arc<LandForm>>) -> InletWind {
    let options = recipe.lattice_options();
    let size = DVec3::from_array(options.cells.map(f64::from)) * options.spacing;
    let origin = options.base_center - DVec3::new(size.x, 0.0, size.z) / 2.0;
    InletWind::new(options.inlet, origin, options.spacing, options.cells, [false; 3]).over_land(land)
}

/// The part of a lattice wind that is recorded ahead of the frames, and the part that is stepped along with them.
#[derive(Debug, Clone)]
pub struct LatticePlan {
    /// Options of the solver, common to recording and steps.
    pub options: LatticeOptions,
    /// Region and frames that are recorded ahead of the frame loop; `None` if nothing is.
    pub recorded: Option<RecordingOptions>,
    /// Whether the whole box is stepped along with the frame loop.
    pub stepped: bool,
}

impl LatticePlan {
    /// The plan for a recipe; `None` if it has no simulated lattice, or if no part of the scene reads it.
    ///
    /// A loop is recorded, of the whole box if catkins, rain or files read it. Without a loop, samples read ahead of the frames
    /// are recorded, and samples read frame by frame are stepped. If a scene has both, one recording of the whole box serves
    /// both as long as it fits in memory; else the lattice is simulated a second time, with the same velocities.
    /// # Errors
    /// `Limit` for a recording that is too large.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most an hour of frames")]
    pub fn new(recipe: &Recipe, needs: &WindNeeds, limits: &Limits) -> Result<Option<Self>> {
        let solved = recipe.has_lattice_wind() && recipe.lattice.solver == WindSolver::Lbm && recipe.wind.blows();
        if !solved || needs.is_empty() {
            return Ok(None);
        }
        let (fps, loop_frames) = (recipe.clip.fps(), recipe.sway.loop_frames(&recipe.clip));
        let frames = loop_frames.unwrap_or(recipe.clip.len());
        // Subtract a small number, so that rounding errors do not add a frame to a spin-up of whole frames.
        let in_frames = |seconds: f64| (seconds * fps - 1e-6).ceil().max(0.0) as u32;
        let (region_lead, box_lead) = (in_frames(needs.region_lead), in_frames(needs.box_lead));
        let reads_box = needs.box_ahead || needs.box_by_frame;
        let lead_frames = match loop_frames {
            Some(frames) => RecordingOptions::loop_lead(frames, fps),
            None => region_lead.max(if reads_box { box_lead } else { 0 }),
        };
        let options = LatticeOptions { lead_frames, ..recipe.lattice_options() };
        let (lead, repeats) = (lead_frames, loop_frames.is_some());
        let whole = RecordingOptions { bounds: Bounds::of([]), lead, frames, fps, repeats };
        let region = RecordingOptions { bounds: needs.region, ..whole };
        let solver_bytes = LatticeMemory::estimate(&options).total();
        // The recording may take half of the memory that the solver leaves; the rest of the bake needs memory too.
        let budget = limits.get("wind-bytes").min(limits.get("memory").saturating_sub(solver_bytes) / 2);
        // The cases in order: the whole box read ahead; nothing read ahead, so that stepping is sufficient; a region read ahead
        // and nothing frame by frame; both, with one recording if it fits; both, by two runs.
        let (recorded, stepped) = if repeats || needs.box_ahead {
            (Some(if reads_box { whole } else { region }), false)
        } else if needs.region.is_empty() {
            (None, true)
        } else if !needs.box_by_frame {
            (Some(region), false)
        } else if whole.predicted_bytes(&options) <= budget {
            (Some(whole), false)
        } else {
            (Some(RecordingOptions { lead: region_lead, ..region }), true)
        };
        let plan = Self { options, recorded, stepped };
        plan.check_limits(limits)?;
        Ok(Some(plan))
    }

    /// Predicted bytes of the wind that is recorded ahead of the frames; 0 if none is recorded.
    pub fn recorded_bytes(&self) -> u64 {
        self.recorded.map_or(0, |recorded| recorded.predicted_bytes(&self.options))
    }

    fn check_limits(&self, limits: &Limits) -> Result<()> {
        let (bytes, limit) = (self.recorded_bytes(), limits.get("wind-bytes"));
        if bytes > limit {
            // A loop of the whole box is large; without a loop, catkins can read a lattice that is stepped along with the frames.
            let loops = self.recorded.is_some_and(|recorded| recorded.repeats);
            let help = if loops { "set sway.repeat = false or a shorter sway.loop" } else { "" };
            return Err(Error::Limit {
                name: "the bytes of the recorded wind".into(),
                wanted: grouped(bytes),
                limit: grouped(limit),
                flag: "--max-wind-bytes".into(),
                help: help.into(),
            });
        }
        // Without a recording the solver itself reports that it does not fit.
        if bytes == 0 {
            return Ok(());
        }
        let all = LatticeMemory::estimate(&self.options).total().saturating_add(bytes);
        limits.check("memory", all, "the memory of the lattice wind and its recording, in bytes,")
    }
}

/// Warning S034 if land within the box of a lattice lies more than a cell below its base, below which there is no air.
pub fn report_land_below_lattice(recipe: &Recipe, land: &LandForm, report: &mut Report) {
    let options = recipe.lattice_options();
    let [x, _, z] = options.cells.map(|n| f64::from(n) * options.spacing);
    let (base, spacing) = (options.base_center, options.spacing);
    let along = |size: f64, n: u32, middle: f64| (0..=n).map(move |i| middle - size / 2.0 + f64::from(i) * spacing);
    let heights = along(x, options.cells[0], base.x).flat_map(|x| {
        along(z, options.cells[2], base.z).map(move |z| f64::from(land.height(Vec2::new(narrow(x), narrow(z)))))
    });
    let lowest = heights.fold(f64::INFINITY, f64::min);
    // The staircase approximation by cells may lose a part of a cell in any case.
    if lowest < base.y - spacing {
        let text = format!(
            "the ground goes down to {lowest:.1} m in the box of the lattice wind, whose base is at {:.1} m: there is no wind below",
            base.y
        );
        let help = format!("set the second number of wind.lattice.at to {:.1}, and add cells upwards", lowest.floor());
        let d = Diagnostic::about("S034", text).help(help);
        report.extend(recipe.places_of_keys.report_at("wind.lattice.at", d, "the base of this box"));
    }
}

/// Options, solids and context of a lattice, kept for rebuilding it when an earlier frame is requested.
#[derive(Debug)]
pub struct LatticeConfig {
    options: LatticeOptions,
    solids: Vec<Solid>,
    limits: Limits,
    cancel: Cancel,
    cache: Option<BakeCache>,
}

impl LatticeConfig {
    /// Copies limits, cancellation and cache out of the context of a bake.
    pub fn new(options: LatticeOptions, solids: &[Solid], context: &BakeContext<'_>) -> Self {
        let (limits, cancel, cache) = (context.limits.clone(), context.cancel.clone(), context.cache.cloned());
        Self { options, solids: solids.to_vec(), limits, cancel, cache }
    }

    /// Builds the lattice, spins it up and computes its first snapshots.
    fn start(&self, progress: &dyn Progress) -> Result<LatticeState> {
        let context = BakeContext { limits: &self.limits, cancel: &self.cancel, progress, cache: self.cache.as_ref() };
        let mut solver = wind_spin_up::load_or_spin_up(&self.options, &self.solids, &context)?;
        let before = SteppedSnapshot::advance(&mut solver, progress, &self.cancel)?;
        // Velocities between two frames are interpolated, which requires two snapshots.
        let after = SteppedSnapshot::advance(&mut solver, progress, &self.cancel)?;
        Ok(LatticeState { solver, before, after, frame: -i64::from(self.options.lead_frames) })
    }
}

/// A lattice that is stepped from frame to frame and holds the two snapshots between which the wind is interpolated.
#[derive(Debug)]
pub struct SteppedLattice {
    config: LatticeConfig,
    state: LatticeState,
}

#[derive(Debug)]
struct LatticeState {
    solver: LatticeSolver,
    before: SteppedSnapshot,
    after: SteppedSnapshot,
    /// Frame of `before`, counted from the clip's first.
    frame: i64,
}

/// A snapshot of the velocities, and the statistics of the solver at its time.
#[derive(Debug, Clone)]
struct SteppedSnapshot {
    wind: Arc<WindSnapshot>,
    stats: LatticeStats,
}

impl SteppedSnapshot {
    fn advance(solver: &mut LatticeSolver, progress: &dyn Progress, cancel: &Cancel) -> Result<Self> {
        Ok(Self { wind: solver.advance(progress, cancel)?, stats: solver.stats() })
    }
}

impl SteppedLattice {
    /// Builds a lattice, spins it up or loads its spun-up state, and takes its first two snapshots.
    /// # Errors
    /// Errors of [`LatticeSolver::new`] and [`LatticeSolver::advance`].
    pub fn start(config: LatticeConfig, progress: &dyn Progress) -> Result<Self> {
        let state = config.start(progress)?;
        Ok(Self { config, state })
    }

    /// The solver in its present state; callers read its warnings.
    pub fn solver(&self) -> &LatticeSolver {
        &self.state.solver
    }

    /// The wind between a frame and the next; frames count from the clip's first. An earlier frame than that of the last call
    /// restarts the lattice.
    /// # Errors
    /// Errors of [`LatticeSolver::advance`].
    pub fn wind_until_next_frame(&mut self, frame: i64) -> Result<Arc<dyn Wind>> {
        let (config, frame) = (&self.config, frame.max(-i64::from(self.config.options.lead_frames)));
        // A lattice cannot be stepped backwards: run again from the spin-up, which the cache may hold.
        if frame < self.state.frame {
            self.state = config.start(&Silent)?;
        }
        let state = &mut self.state;
        while state.frame < frame {
            let next = SteppedSnapshot::advance(&mut state.solver, &Silent, &config.cancel)?;
            state.before = std::mem::replace(&mut state.after, next);
            state.frame += 1;
        }
        let [before, after] = [&state.before, &state.after].map(|snapshot| Arc::clone(&snapshot.wind));
        let (t0, t1) = (before.time(), after.time());
        Ok(Arc::new(InterpolatedWind { before, after, t0, t1 }))
    }

    /// Statistics of the solver at the frame of the last call, or at the one after it.
    pub fn stats(&self, frame: i64) -> LatticeStats {
        if frame > self.state.frame { self.state.after.stats } else { self.state.before.stats }
    }
}

/// Memory of a recipe's lattice wind, bytes, by purpose; empty without one.
pub fn lattice_memory(recipe: &Recipe) -> Vec<(&'static str, u64)> {
    if !reads_lattice_wind(recipe) || recipe.lattice.solver != WindSolver::Lbm || !recipe.wind.blows() {
        return Vec::new();
    }
    let m = LatticeMemory::estimate(&recipe.lattice_options());
    vec![
        ("air", m.populations),
        ("snapshots", m.snapshots),
        ("solid cells", m.solid_cells),
        ("open faces", m.open_faces),
    ]
}

/// Size of a solid in cells of the lattice, which shows the user how well it is resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct SolidSizeInCells {
    /// Name of the solid, as in its key `name`.
    pub name: String,
    /// Height above its foot, cells.
    pub height: f64,
    /// Smaller horizontal extent before rotation, cells; `None` for meshes.
    pub thickness: Option<f64>,
}

/// Sizes of a recipe's solids in cells of its lattice; empty without one.
pub fn solids_in_cells(recipe: &Recipe) -> Vec<SolidSizeInCells> {
    if lattice_memory(recipe).is_empty() {
        return Vec::new();
    }
    let cell = recipe.lattice.cell_size;
    let of_solid = |solid: &SolidRecipe| {
        let keys = &solid.keys;
        let (height, thickness) = match &solid.mesh {
            Some(mesh) => (f64::from(Bounds::of(mesh.mesh.points.iter().copied()).size().y), None),
            None if keys.shape == SolidShape::House => (keys.size[1] + keys.roof, Some(keys.size[0].min(keys.size[2]))),
            None => (keys.size[1], Some(keys.size[0].min(keys.size[2]))),
        };
        SolidSizeInCells { name: solid.id.clone(), height: height / cell, thickness: thickness.map(|t| t / cell) }
    };
    recipe.solids.iter().map(of_solid).collect()
}

/// Memory of a lattice, bytes, up to which a check voxelizes its solids; for larger lattices it checks only the options.
const MAX_CHECKED_BYTES: u64 = 200_000_000;

/// Reports the warnings of a recipe's lattice without running it; those of its solids only up to `MAX_CHECKED_BYTES`.
/// # Errors
/// Errors of [`LatticeSolver::new`].
pub fn check_lattice(recipe: &Recipe, solids: &[Solid], context: &BakeContext<'_>, report: &mut Report) -> Result<()> {
    if lattice_memory(recipe).is_empty() {
        return Ok(());
    }
    let options = recipe.lattice_options();
    if LatticeMemory::estimate(&options).total() > MAX_CHECKED_BYTES {
        push_warnings(&LatticeSolver::check_options(&options, solids, context.limits)?, report);
    } else {
        report_warnings(&LatticeSolver::new(&options, solids, context.limits)?, report);
    }
    Ok(())
}

/// Adds the warnings that a lattice has collected to a report, each with its code, or with S020 if the code is not registered.
pub fn report_warnings(lattice: &LatticeSolver, report: &mut Report) {
    push_warnings(lattice.warnings(), report);
}

fn push_warnings(warnings: &[LatticeWarning], report: &mut Report) {
    for note in warnings {
        let code = codes::find(note.code).map_or("S020", |c| c.code);
        report.push(Diagnostic::about(code, note.text.clone()));
    }
}
