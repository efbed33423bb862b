//! The lattice Boltzmann wind of a recipe: options, run over the clip, memory, checks.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::obstacles::{Obstacles, has_lattice_clip};
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::cache::wind_spin_up;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::Recipe;
use crate::recipe::scene::{LatticeGround, LatticeOutlet, LatticeProfile, LatticeSides, WindModel, WindSolver};
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report, codes};
use osier_base::geometry::Bounds;
use osier_base::math::{cos, narrow, sin};
use osier_scene::solid::Solid;
use osier_wind::{
    GroundCondition, InletOptions, InletWind, LatticeMemory, LatticeOptions, LatticeSolver, LatticeWarning,
    RecordedWind, RecordingOptions, SideCondition, UniformWind, Wind, WindProfile,
};

/// Margin for leaves around a plant's nodes, m, within which the wind is recorded. Own: longer than leaf and petiole of the presets;
/// leaves outside sample the border value.
const LEAF_MARGIN: f32 = 0.5;

/// Extent of a recording of the lattice wind.
#[derive(Debug, Clone, Copy)]
pub struct LatticeRequest<'a> {
    /// Box that is recorded, m; the whole domain if this is empty.
    pub bounds: Bounds,
    /// Obstacles and land.
    pub solids: &'a [Solid],
    /// Length of the loop in frames; `None` for the clip without a loop.
    pub loop_frames: Option<usize>,
}

/// World bounds of all plants with `LEAF_MARGIN`, m.
pub fn plant_bounds(layout: &PlantLayout, grown: &[GrownPlant]) -> Bounds {
    let own: Vec<Bounds> =
        grown.iter().map(|g| Bounds::of(g.plant.nodes.p.iter().copied()).grown(LEAF_MARGIN)).collect();
    // Bounds of each individual once, then the corners of every copy of it.
    let corners = layout.instances.iter().filter_map(|s| {
        let bounds = own.get(s.individual).filter(|b| !b.is_empty())?;
        Some(bounds.corners().map(|c| s.transform.apply(c)))
    });
    Bounds::of(corners.flatten())
}

/// Solids of a recipe's lattice wind; none for any other wind.
pub fn lattice_solids(recipe: &Recipe, obstacles: &Obstacles<'_>) -> Vec<Solid> {
    if !has_lattice_clip(recipe) {
        return Vec::new();
    }
    let [x, _, z] = recipe.lattice.cells;
    // A square around the origin that holds the domain, wherever its base centre lies.
    let side = 2.0 * (x.max(z) * recipe.lattice.cell_size + recipe.lattice.at[0].abs().max(recipe.lattice.at[2].abs()));
    obstacles.solids_within(narrow(side)).list().to_vec()
}

/// Options of the solver from the keys of `[wind]` and `[wind.lattice]`.
pub fn lattice_options(recipe: &Recipe) -> LatticeOptions {
    let (wind, keys) = (&recipe.wind, &recipe.lattice);
    let direction = DVec3::new(cos(wind.direction), 0.0, -sin(wind.direction));
    // cos(90 degrees) is 6e-17 in floating point: set such components to zero, so that the wind is exactly along an axis.
    let direction = DVec3::from_array(direction.to_array().map(|d| if d.abs() < 1e-12 { 0.0 } else { d })).normalize();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers from 8 to 4096")]
    let cells = keys.cells.map(|n| n as u32);
    LatticeOptions {
        cells,
        spacing: keys.cell_size,
        base_center: DVec3::from_array(keys.at),
        inlet: InletOptions {
            direction,
            speed: wind.speed,
            speed_curve: keys.speed_curve.clone(),
            direction_curve: keys.direction_changes(),
            profile: match keys.profile {
                LatticeProfile::Log => WindProfile::Log(keys.roughness),
                LatticeProfile::Power => WindProfile::Power(keys.exponent),
                LatticeProfile::Uniform => WindProfile::Uniform,
                LatticeProfile::Table => WindProfile::Table(keys.profile_table.clone()),
            },
            reference_height: keys.reference_height,
            gust_strength: keys.gust,
            gust_period: keys.gust_period,
            turbulence: keys.turbulence,
            turbulence_modes: keys.modes,
            seed: recipe.general.seed,
        },
        viscosity: keys.viscosity,
        fps: recipe.clip.fps(),
        steps_per_frame: keys.steps,
        smagorinsky: keys.smagorinsky,
        tau_floor: keys.tau_floor,
        ground: match keys.ground {
            LatticeGround::Rough => GroundCondition::Rough(keys.roughness),
            LatticeGround::Smooth => GroundCondition::Smooth,
        },
        sides: match keys.sides {
            LatticeSides::Auto => SideCondition::Auto,
            LatticeSides::Slip => SideCondition::Slip,
            LatticeSides::Open => SideCondition::Open,
        },
        outlet_nonequilibrium: keys.outlet == LatticeOutlet::Nonequilibrium,
        sponge_cells: keys.sponge,
        spin_up: keys.spin_up,
    }
}

/// The analytic stand-in for a lattice wind: the inlet's profile and gusts in the whole domain, without solids.
pub fn analytic_inlet(options: &LatticeOptions) -> InletWind {
    let size = DVec3::from_array(options.cells.map(f64::from)) * options.spacing;
    let origin = options.base_center - DVec3::new(size.x, 0.0, size.z) / 2.0;
    InletWind::new(options.inlet.clone(), origin, options.spacing, options.cells, [false; 3])
}

/// The wind of a recipe's lattice for the whole clip.
/// # Errors
/// Those of [`LatticeSolver::new`] and [`RecordedWind::record`].
pub fn run_lattice(
    recipe: &Recipe,
    request: &LatticeRequest<'_>,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<Arc<dyn Wind>> {
    let options = lattice_options(recipe);
    match recipe.lattice.solver {
        WindSolver::Still => return Ok(Arc::new(UniformWind(Vec3::ZERO))),
        WindSolver::Analytic => return Ok(Arc::new(analytic_inlet(&options))),
        WindSolver::Lbm => {}
    }
    let mut lattice = wind_spin_up::load_or_spin_up(&options, request.solids, context)?;
    let repeats = request.loop_frames.is_some();
    let frames = request.loop_frames.unwrap_or(recipe.clip.len());
    let options = RecordingOptions { bounds: request.bounds, frames, fps: recipe.clip.fps(), repeats };
    let recorded = RecordedWind::record(&mut lattice, options, context.limits, context.progress, context.cancel)?;
    report_warnings(&lattice, report);
    Ok(Arc::new(recorded))
}

/// Memory of a recipe's lattice wind, bytes, by purpose; empty without one.
pub fn lattice_memory(recipe: &Recipe) -> Vec<(&'static str, u64)> {
    let solved = recipe.wind.model == WindModel::Lattice && recipe.lattice.solver == WindSolver::Lbm;
    if !solved || recipe.clip.len() < 2 || !recipe.wind.blows() {
        return Vec::new();
    }
    let m = LatticeMemory::estimate(&lattice_options(recipe));
    vec![
        ("air", m.populations),
        ("snapshots", m.snapshots),
        ("solid cells", m.solid_cells),
        ("open faces", m.open_faces),
    ]
}

/// Memory of a lattice, bytes, up to which a check voxelizes its solids; a larger one is checked by its options alone.
const MAX_CHECKED_BYTES: u64 = 200_000_000;

/// Reports the warnings of a recipe's lattice without running it; those of solids only up to `MAX_CHECKED_BYTES`.
/// # Errors
/// Those of [`LatticeSolver::new`].
pub fn check_lattice(recipe: &Recipe, solids: &[Solid], context: &BakeContext<'_>, report: &mut Report) -> Result<()> {
    if lattice_memory(recipe).is_empty() {
        return Ok(());
    }
    let options = lattice_options(recipe);
    if LatticeMemory::estimate(&options).total() > MAX_CHECKED_BYTES {
        push_warnings(&LatticeSolver::check_options(&options, context.limits)?, report);
    } else {
        report_warnings(&LatticeSolver::new(&options, solids, context.limits)?, report);
    }
    Ok(())
}

/// Adds the warnings of a lattice to a report.
pub fn report_warnings(lattice: &LatticeSolver, report: &mut Report) {
    push_warnings(lattice.warnings(), report);
}

fn push_warnings(warnings: &[LatticeWarning], report: &mut Report) {
    for note in warnings {
        let code = codes::find(note.code).map_or("S020", |c| c.code);
        report.push(Diagnostic::about(code, note.text.clone()));
    }
}
