//! The plants of a scene: their materials, growth, assets and motions.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::growth_site::GrowthSite;
use crate::bake::assets::material_set::{MaterialSet, PlantMaterials};
use crate::bake::assets::obstacles::solid_form;
use crate::bake::assets::plant_growth::{GrownPlant, grow_plant};
use crate::bake::assets::plant_materials::plant_materials;
use crate::bake::assets::plant_mesh::{BoundPlant, build_bound_plant, build_plant_asset, is_shown_by_segments};
use crate::bake::assets::rigged_plant::build_rigged_plant;
use crate::bake::assets::seasons::add_season_materials;
use crate::bake::assets::shape_growth::grows_round_solids;
use crate::bake::assets::species_growth::{grow_species, needs_solids, shared_individuals};
use crate::bake::assets::terrain::shown_terrain_solid;
use crate::bake::motion::AssetMotion;
use crate::bake::motion::growth::{GrowthMotion, GrowthSpan};
use crate::bake::motion::rain::PlantInRain;
use crate::bake::motion::rod_plant::{FrameClock, RodPlantMotion, build_rod_plant_at_rest};
use crate::bake::motion::season::SeasonMotion;
use crate::bake::motion::sway::SwayMotion;
use crate::bake::motion::years::YearsMotion;
use crate::bake::scene::builder::SceneBuilder;
use crate::bake::scene::plant_layout::{Individual, PlantInstance, PlantLayout};
use crate::bake::scene::scatter;
use crate::bake::wind::plant_wind::PlantWind;
use crate::recipe::scene::{BarkMotion, RainPreset};
use crate::recipe::{Growth, PlantRecipe, Recipe, SolidRecipe};
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::Names;
use osier_base::par::par_map;
use osier_base::{Error, Result};
use osier_plants::surface::terrain::Terrain;
use osier_scene::solid::{Form, Solid};
use osier_scene::{Asset, ClipChange, Placement, RiggedPlant, Trs};
use osier_wind::{UniformWind, Wind};

/// Results of [`add_plant_assets`] beside the assets, which go to the scene's builder.
pub(crate) struct PlantBuildResult {
    /// Angles that the paper's sway model clamped to 90 degrees, over all plants and frames.
    pub(crate) clamped_angles: u64,
    /// Motion that the rain's simulation adds drops to, for each plant, parallel to the layout's individuals.
    pub(crate) motions_in_rain: Vec<PlantInRain>,
}

/// One plant's asset and motion, built in parallel with others, before it is added to the scene.
struct BuiltPlant {
    asset: Asset,
    motion: Option<Arc<dyn AssetMotion>>,
    clamped_angles: u64,
    motion_in_rain: PlantInRain,
    diagnostics: Vec<Diagnostic>,
}

impl BuiltPlant {
    fn without_motion(asset: Asset, diagnostics: Vec<Diagnostic>) -> Self {
        Self { asset, motion: None, clamped_angles: 0, motion_in_rain: PlantInRain::Still, diagnostics }
    }

    fn moved_by(motion: impl AssetMotion + 'static, asset: Asset, diagnostics: Vec<Diagnostic>) -> Self {
        Self { motion: Some(Arc::new(motion)), ..Self::without_motion(asset, diagnostics) }
    }

    /// Adds the plant at rest with joints on its branches to the asset. A plant that changes over the clip is shown at one time of it.
    fn with_rig(
        mut self,
        recipe: &Recipe,
        plant: &PlantRecipe,
        grown: &GrownPlant,
        materials: &PlantMaterials,
        context: &BakeContext<'_>,
    ) -> Result<Self> {
        let joints = recipe.output.unreal.joints;
        let at_one_time = grown.at_one_time(plant, context.limits)?;
        let still = at_one_time.as_ref().unwrap_or(grown);
        let rig = build_rigged_plant(still, plant, materials, &self.asset, joints, context)?;
        let grows = grown.clip.is_some() || (plant.keys.growth_clip.is_some() && recipe.clip.len() > 1);
        let change = match &grown.season {
            _ if grows => ClipChange::Growth,
            Some(_) => ClipChange::Season,
            None => ClipChange::None,
        };
        self.asset.rigged = Some(Arc::new(RiggedPlant { change, ..rig }));
        Ok(self)
    }
}

/// Bark, leaf and organ materials of each plant of a recipe, parallel to these; an empty set for a plant that is placed
/// nowhere.
/// # Errors
/// The first error of [`plant_materials`], in the order of the plants.
pub(crate) fn plant_material_sets(
    recipe: &Recipe,
    layout: &PlantLayout,
    context: &BakeContext<'_>,
) -> Result<Vec<MaterialSet>> {
    let indexed: Vec<_> = recipe.plants.iter().enumerate().collect();
    let sets = par_map(&indexed, |(i, plant)| {
        context.cancel.check()?;
        let used = layout.individuals.iter().any(|n| n.plant == *i);
        let mut set = MaterialSet::default();
        if used {
            set = plant_materials(plant, recipe.general.seed, context)?;
            add_season_materials(&mut set, plant, recipe.general.seed)?;
        }
        context.progress.advance(1);
        Ok(set)
    });
    sets.into_iter().collect()
}

/// Grows all individuals of a layout in parallel; returns them in its order, with their warnings. `terrain`: the scene's, if it
/// has one.
/// # Errors
/// `Input` with the faults of all individuals together; else the first other error.
pub(crate) fn grow_plants(
    recipe: &Recipe,
    layout: &PlantLayout,
    terrain: Option<&Terrain>,
    sets: &[MaterialSet],
    context: &BakeContext<'_>,
) -> Result<(Vec<GrownPlant>, Report)> {
    let solids = growth_solids(recipe, terrain)?;
    let transforms = layout.first_transforms();
    let trees = grow_species(recipe, layout, &solids, context.limits)?;
    let frames = f64::from(recipe.clip.end.saturating_sub(recipe.clip.start));
    let individuals: Vec<_> = layout.individuals.iter().zip(transforms).zip(&trees).collect();
    let grown = par_map(&individuals, |((individual, transform), tree)| {
        context.cancel.check()?;
        let (plant, set) = plant_and_parallel_item(recipe, sets, individual)?;
        let site = GrowthSite { solids: &solids, transform: *transform, tree: tree.as_ref(), frames };
        let grown = grow_plant(plant, individual, set, site, context);
        context.progress.advance(1);
        grown
    });
    let mut report = Report::default();
    let mut plants = Vec::new();
    for result in grown {
        match result {
            Ok(mut plant) => {
                report.extend(std::mem::take(&mut plant.report));
                plants.push(plant);
            }
            Err(Error::Input(faults)) => report.extend(*faults),
            Err(other) => return Err(other),
        }
    }
    report.into_result(plants)
}

/// Refuses plants that grow for their place and stand in more places than they have individuals. `layout`: the whole layout, not the
/// sample that an estimate grows, whose individuals stand for several.
/// # Errors
/// S003, one for each such plant.
pub(crate) fn check_individuals(recipe: &Recipe, layout: &PlantLayout) -> Result<()> {
    let mut report = Report { diagnostics: shared_individuals(recipe, layout), ..Report::default() };
    for i in (0..recipe.plants.len()).filter(|i| grows_round_solids(&recipe.plants[*i])) {
        let individuals = layout.individuals.iter().filter(|n| n.plant == i).count();
        let copies = layout.instances.iter().filter(|s| layout.individuals[s.individual].plant == i).count();
        if copies > individuals {
            let name = &recipe.plants[i].name;
            let text = format!(
                "plant \"{name}\" grows round solids but stands in {copies} places as {individuals} individuals"
            );
            report.push(Diagnostic::about("S003", text).help(format!("give its [[place]] individuals = {copies}")));
        }
    }
    report.into_result(()).map(drop)
}

/// The solids of the scene, in world space, and its terrain; empty if no plant grows round solids.
/// # Errors
/// X010 for a mesh without triangles.
fn growth_solids(recipe: &Recipe, terrain: Option<&Terrain>) -> Result<Vec<Solid>> {
    let reads_solids =
        |p: &PlantRecipe| grows_round_solids(p) || matches!(&p.growth, Growth::Species(s) if needs_solids(s));
    if !recipe.plants.iter().any(reads_solids) {
        return Ok(Vec::new());
    }
    let solid =
        |s: &SolidRecipe| Ok(Solid { name: s.keys.name.clone(), form: solid_form(s)?, humidity: s.keys.humidity });
    let mut solids = recipe.solids.iter().map(solid).collect::<Result<Vec<Solid>>>()?;
    // The solid of the terrain has an empty name, which no solid of a scene can have.
    let land = terrain.and_then(shown_terrain_solid).map(|land| Form::Land(Arc::new(land)));
    solids.extend(land.map(|form| Solid { name: String::new(), form, humidity: 0.0 }));
    Ok(solids)
}

/// The recipe of an individual's plant, and the element that belongs to it in a list parallel to the recipe's plants.
fn plant_and_parallel_item<'a, T>(
    recipe: &'a Recipe,
    list: &'a [T],
    individual: &Individual,
) -> Result<(&'a PlantRecipe, &'a T)> {
    let both = recipe.plants.get(individual.plant).zip(list.get(individual.plant));
    both.ok_or_else(|| Error::input("S005", "a place names a plant that is not there"))
}

/// Builds the assets of all grown plants in parallel and adds them to the scene, one per individual, without placements.
/// # Errors
/// The first error of a plant, in the order of the individuals.
pub(crate) fn add_plant_assets(
    recipe: &Recipe,
    wind: Option<&PlantWind>,
    layout: &PlantLayout,
    materials: &[PlantMaterials],
    grown: &[GrownPlant],
    builder: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<PlantBuildResult> {
    let jobs: Vec<(usize, &Individual, &GrownPlant)> =
        layout.individuals.iter().zip(grown).enumerate().map(|(i, (n, g))| (i, n, g)).collect();
    let transforms = layout.first_transforms();
    let built = par_map(&jobs, |(i, individual, grown)| {
        let (plant, materials) = plant_and_parallel_item(recipe, materials, individual)?;
        let transform = transforms.get(*i).copied().unwrap_or(Trs::IDENTITY);
        let built = build_plant(recipe, plant, wind, grown, materials, individual, transform, context);
        let built = built.and_then(|built| match needs_rig(recipe, plant, grown) {
            true => built.with_rig(recipe, plant, grown, materials, context),
            false => Ok(built),
        });
        context.progress.advance(1);
        built
    });
    let mut added = PlantBuildResult { clamped_angles: 0, motions_in_rain: Vec::new() };
    let built: Vec<BuiltPlant> = built.into_iter().collect::<Result<_>>()?;
    for (plant, individual) in built.into_iter().zip(&layout.individuals) {
        let group = recipe.plants.get(individual.plant).map(|p| p.id.clone()).unwrap_or_default();
        builder.add_asset(Asset { group, ..plant.asset }, plant.motion);
        added.clamped_angles += plant.clamped_angles;
        added.motions_in_rain.push(plant.motion_in_rain);
        plant.diagnostics.into_iter().for_each(|d| report.push(d));
    }
    Ok(added)
}

/// Whether a plant is also built at one time of the clip, with joints. Formats whose readers simulate the wind need it of still
/// plants and of plants on rods, too: their joints do not depend on the motion. Meshes at rest need it of trees whose years the
/// clip shows.
fn needs_rig(recipe: &Recipe, plant: &PlantRecipe, grown: &GrownPlant) -> bool {
    let has_years = grown.clip.is_some() && !is_shown_by_segments(grown, plant);
    recipe.output.writes_unreal() || (has_years && recipe.output.writes(&osier_export::obj::FORMAT))
}

/// Builds one plant: on rods where its recipe has `[plants.NAME.rods]`, else on the elements of the sway model.
/// `transform`: world transform of its first copy; all copies sway in the wind of its place.
fn build_plant(
    recipe: &Recipe,
    plant: &PlantRecipe,
    wind: Option<&PlantWind>,
    grown: &GrownPlant,
    materials: &PlantMaterials,
    individual: &Individual,
    transform: Trs,
    context: &BakeContext<'_>,
) -> Result<BuiltPlant> {
    let seconds = recipe.clip.seconds(recipe.clip.end);
    // A plant that grows over the clip follows the clock of its growth and no wind.
    if let Some(clip) = &grown.clip {
        let BoundPlant { mut asset, bindings, .. } =
            build_bound_plant(grown, plant, materials, individual, None, context)?;
        YearsMotion::prepare(&mut asset, materials, &**clip);
        let motion = YearsMotion::new(clip.clone(), materials, &bindings, is_shown_by_segments(grown, plant), seconds);
        return Ok(BuiltPlant::moved_by(motion, asset, Vec::new()));
    }
    if let Some(shares) = plant.keys.growth_clip.filter(|_| recipe.clip.len() > 1) {
        let (asset, motion) =
            build_growing_plant(grown, plant, materials, individual, GrowthSpan { shares, seconds }, context)?;
        return Ok(BuiltPlant::moved_by(motion, asset, Vec::new()));
    }
    // A plant whose leaves change over the clip follows no wind either.
    if let Some(season) = &grown.season {
        let BoundPlant { mut asset, .. } = build_bound_plant(grown, plant, materials, individual, None, context)?;
        let motion = SeasonMotion::new(&grown.plant, materials, season, seconds);
        motion.prepare(&mut asset);
        return Ok(BuiltPlant::moved_by(motion, asset, Vec::new()));
    }
    let still = matches!(plant.keys.motion, BarkMotion::Still | BarkMotion::Static);
    let clock = FrameClock { fps: recipe.clip.fps(), first: recipe.clip.start };
    let build_rods =
        || build_rod_plant_at_rest(grown, plant, materials, individual, transform, clock, recipe.gravity(), context);
    let moves_on_rods = plant.rods.is_some() && !still;

    // In the rain the rods are stepped together with the drops, by the rain simulation: only hand them over.
    if moves_on_rods && recipe.rain.is_some() && recipe.clip.len() > 1 {
        let built = build_rods()?;
        // In calm weather the air resists what drops move; the rain of the paper has no air.
        let has_air = recipe.rain.as_ref().is_some_and(|rain| rain.keys.preset != RainPreset::Paper);
        let calm = has_air.then(|| Arc::new(UniformWind(Vec3::ZERO)) as Arc<dyn Wind>);
        let rods = Box::new(built.rods.with_wind(calm));
        let motion_in_rain = PlantInRain::Rods { rods, binding: built.binding };
        return Ok(BuiltPlant { motion_in_rain, ..BuiltPlant::without_motion(built.asset, built.diagnostics) });
    }
    // Without rain the rods step by themselves in the wind.
    if let Some(wind) = wind.filter(|_| moves_on_rods) {
        let built = build_rods()?;
        let motion = RodPlantMotion::new(built.rods, built.binding, plant, wind, clock.fps);
        return Ok(BuiltPlant::moved_by(motion, built.asset, built.diagnostics));
    }
    // A still plant with rods keeps the petiole meshes that are built from them, but no joints.
    if plant.rods.is_some() {
        let mut built = build_rods()?;
        let mut diagnostics = std::mem::take(&mut built.diagnostics);
        // Leaves beyond the budget (S043) have no petioles at rest either. The weight (S042) only counts in motion.
        diagnostics.retain(|d| d.code == "S043");
        return Ok(BuiltPlant::without_motion(built.into_still_asset(), diagnostics));
    }
    let (asset, sway) = build_plant_asset(grown, plant, materials, individual, wind.map(|w| (w, transform)), context)?;
    let clamped_angles = sway.as_ref().map_or(0, SwayMotion::clamp_count);
    // In the rain the drops' motion is added to the sway, and the record of the rain holds both.
    let sway = sway.map(Arc::new);
    let (motion, motion_in_rain) = match sway {
        Some(sway) if recipe.rain.is_some() => (None, PlantInRain::Sway(sway)),
        sway => (sway.map(|m| m as Arc<dyn AssetMotion>), PlantInRain::Still),
    };
    Ok(BuiltPlant { clamped_angles, motion, motion_in_rain, ..BuiltPlant::without_motion(asset, Vec::new()) })
}

/// Builds the asset of a plant that grows over the clip, and the motion that shows it at the ages of `clip`.
/// # Errors
/// As [`build_plant_asset`].
fn build_growing_plant(
    grown: &GrownPlant,
    recipe: &PlantRecipe,
    materials: &PlantMaterials,
    individual: &Individual,
    clip: GrowthSpan,
    context: &BakeContext<'_>,
) -> Result<(Asset, GrowthMotion)> {
    let BoundPlant { mut asset, bindings, .. } =
        build_bound_plant(grown, recipe, materials, individual, None, context)?;
    let by_segments = is_shown_by_segments(grown, recipe);
    GrowthMotion::prepare(&mut asset);
    Ok((asset, GrowthMotion::new(&grown.plant, materials, &bindings, by_segments, clip)))
}

/// Placements of the plants' assets, with unique names. In a looping wind a copy shows its asset's motion shifted by the
/// time that gusts take from the first copy to it.
pub(crate) fn place_plants(wind: Option<&PlantWind>, builder: &SceneBuilder, layout: &PlantLayout) -> Vec<Placement> {
    let SceneBuilder { assets, motions, .. } = builder;
    let mut names = Names::default();
    let mut first: BTreeMap<usize, Vec3> = BTreeMap::new();
    let mut place = |instance: &PlantInstance| {
        let id = assets.get(instance.individual).map_or("plant", |a| &a.id);
        let first = *first.entry(instance.individual).or_insert(instance.transform.t);
        // Rods are stepped from frame to frame and cannot be evaluated at a second phase.
        let phased = motions.get(instance.individual).and_then(Option::as_ref).is_some_and(|m| m.supports_phases());
        let phase = wind.filter(|_| phased).map_or(0, |wind| wind.phase_offset(first, instance.transform.t));
        Placement { name: names.unique(id), asset: instance.individual, transform: instance.transform, phase }
    };
    layout.instances.iter().map(&mut place).collect()
}

/// Radius of each individual's foot, m, as [`scatter::footprint_radius`].
pub(crate) fn stem_foot_radii(recipe: &Recipe, layout: &PlantLayout, grown: &[GrownPlant]) -> Vec<f32> {
    let footprint_radius = |(individual, grown): (&Individual, &GrownPlant)| {
        recipe.plants.get(individual.plant).map_or(0.0, |plant| scatter::footprint_radius(&grown.plant, &plant.skin))
    };
    layout.individuals.iter().zip(grown).map(footprint_radius).collect()
}
