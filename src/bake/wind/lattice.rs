//! The lattice wind of a recipe.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::obstacles::{Obstacles, flows_round};
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

/// Room for leaves around a plant's wood, m.
const LEAF_MARGIN: f32 = 0.5;

/// What a lattice wind is asked for.
#[derive(Debug, Clone, Copy)]
pub struct LatticeRequest<'a> {
    /// Where it is kept, m; the whole box if this is empty.
    pub bounds: Bounds,
    /// What stands in it.
    pub solids: &'a [Solid],
    /// Frames after which it repeats.
    pub repeats: Option<usize>,
}

/// Where plants are, with room for their leaves.
pub fn plant_bounds(layout: &PlantLayout, grown: &[GrownPlant]) -> Bounds {
    let own: Vec<Bounds> =
        grown.iter().map(|g| Bounds::of(g.plant.nodes.p.iter().copied()).grown(LEAF_MARGIN)).collect();
    let corners = layout.standings.iter().filter_map(|s| {
        let bounds = own.get(s.individual).filter(|b| !b.is_empty())?;
        Some(bounds.corners().map(|c| s.transform.apply(c)))
    });
    Bounds::of(corners.flatten())
}

/// What stands in a recipe's lattice wind; nothing in another one.
pub fn lattice_solids(recipe: &Recipe, obstacles: &Obstacles<'_>) -> Vec<Solid> {
    if !flows_round(recipe) {
        return Vec::new();
    }
    let [x, _, z] = recipe.lattice.cells;
    let reach =
        2.0 * (x.max(z) * recipe.lattice.cell_size + recipe.lattice.at[0].abs().max(recipe.lattice.at[2].abs()));
    obstacles.within(narrow(reach)).list().to_vec()
}

/// What a recipe says of its lattice.
pub fn lattice_options(recipe: &Recipe) -> LatticeOptions {
    let (wind, keys) = (&recipe.wind, &recipe.lattice);
    let direction = DVec3::new(cos(wind.direction), 0.0, -sin(wind.direction));
    // A quarter turn is along an axis, whatever cosines say.
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

/// The analytic wind of a recipe: what comes in, everywhere.
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
    wanted: &LatticeRequest<'_>,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<Arc<dyn Wind>> {
    let options = lattice_options(recipe);
    match recipe.lattice.solver {
        WindSolver::Still => return Ok(Arc::new(UniformWind(Vec3::ZERO))),
        WindSolver::Analytic => return Ok(Arc::new(analytic_inlet(&options))),
        WindSolver::Lbm => {}
    }
    let mut lattice = wind_spin_up::load_or_spin_up(&options, wanted.solids, context)?;
    let repeats = wanted.repeats.is_some();
    let frames = wanted.repeats.unwrap_or(recipe.clip.len());
    let take = RecordingOptions { bounds: wanted.bounds, frames, fps: recipe.clip.fps(), repeats };
    let recorded = RecordedWind::record(&mut lattice, take, context.limits, context.progress, context.cancel)?;
    report_notes(&lattice, report);
    Ok(Arc::new(recorded))
}

/// Bytes of memory of a recipe's lattice wind, by what they are for; none without.
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

/// Memory of a lattice up to which its cells are made to be looked at, bytes.
const MAX_CHECKED_BYTES: u64 = 200_000_000;

/// What a recipe's lattice would say of itself before it runs; of a large one without what stands in it.
/// # Errors
/// Those of [`LatticeSolver::new`].
pub fn check_lattice(recipe: &Recipe, solids: &[Solid], context: &BakeContext<'_>, report: &mut Report) -> Result<()> {
    if lattice_memory(recipe).is_empty() {
        return Ok(());
    }
    let options = lattice_options(recipe);
    if LatticeMemory::estimate(&options).total() > MAX_CHECKED_BYTES {
        push_notes(&LatticeSolver::check_options(&options, context.limits)?, report);
    } else {
        report_notes(&LatticeSolver::new(&options, solids, context.limits)?, report);
    }
    Ok(())
}

/// Passes on what a lattice wind says of itself.
pub fn report_notes(lattice: &LatticeSolver, report: &mut Report) {
    push_notes(lattice.warnings(), report);
}

fn push_notes(notes: &[LatticeWarning], report: &mut Report) {
    for note in notes {
        let code = codes::find(note.code).map_or("S020", |c| c.code);
        report.push(Diagnostic::about(code, note.text.clone()));
    }
}
