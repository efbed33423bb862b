//! Assembles the scene of a recipe: assets in the order in which files list them, each with its motion, camera and light.

use std::borrow::Cow;
use std::sync::Arc;

use crate::bake::BakeContext;
use crate::bake::assets::attractor::add_ifs_attractors;
use crate::bake::assets::ground::{add_ground, ground_materials, place_on_ground};
use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::obstacles::{GroundSurface, Obstacles, add_obstacles};
use crate::bake::assets::plant_mesh::choose_shader_wind;
use crate::bake::assets::plants::{
    add_plant_assets, check_individuals, grow_plants, place_plants, plant_material_sets, stem_foot_radii,
};
use crate::bake::assets::terrain::{add_terrain, lift_camera, terrain_height_field};
use crate::bake::assets::turtle_colors::add_worn_colors;
use crate::bake::motion::flight::assembly::add_catkins;
use crate::bake::motion::flight::canopy::Canopy;
use crate::bake::motion::rain::{RainGround, add_rain, enum_labels};
use crate::bake::motion::rod::add_rods;
use crate::bake::motion::sway::report_clamped_angles;
use crate::bake::output::bake_estimate::BakeEstimate;
use crate::bake::output::estimate::estimate;
use crate::bake::scene::animated::AnimatedScene;
use crate::bake::scene::builder::SceneBuilder;
use crate::bake::scene::camera_light::{scene_camera, scene_sky, scene_sun};
use crate::bake::scene::layout::{SceneLayout, added_asset_ids, lay_out_scene};
use crate::bake::scene::reduction;
use crate::bake::scene::scatter::sink_feet;
use crate::bake::wind::lattice::{check_lattice, lattice_solids};
use crate::bake::wind::needs::WindNeeds;
use crate::bake::wind::output::{WindGridSampler, placed_grids, velocity_grid};
use crate::bake::wind::plant_wind::PlantWind;
use crate::bake::wind::scene_wind::{SceneWind, WindObserver, WindSurroundings, WindUser};
use crate::recipe::Recipe;
use osier_base::diagnostic::Report;
use osier_base::par::join;
use osier_base::{Error, Result};
use osier_motion::rain::GroundHeight;
use osier_scene::Scene;

/// Optional parts of an assembled scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SceneOptions {
    /// Whether the ground or the terrain becomes an asset. Plants stand on a terrain either way; without the ground they keep the
    /// heights of their places, as with `[ground] show = false`.
    pub ground: bool,
    /// Whether maps of ground and bark that no format of the bake has are drawn at their full size. Previews and single files show
    /// them; a bake does not.
    pub unused_textures: bool,
}

impl SceneOptions {
    /// Options of a bake and of its estimate.
    pub const BAKE: Self = Self { ground: true, unused_textures: false };
    /// Those of a still file of the plants alone.
    pub const WITHOUT_GROUND: Self = Self { ground: false, unused_textures: true };
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self { ground: true, unused_textures: true }
    }
}

/// A scene with its motions, and the results of its assembly that are not part of it.
#[derive(Debug)]
pub struct AssembledScene {
    /// The scene at rest and the motions of its assets.
    pub animated: AnimatedScene,
    /// Warnings of grammars, turtles, growth and wind.
    pub report: Report,
    /// Modules of the final strings of all individuals; 0 if no grammar grows a plant.
    pub modules: u64,
    /// In an estimate, the number of individuals that each of the first assets represents; empty in a scene that can be
    /// written.
    pub weights: Vec<u64>,
    /// Number of leaves of all plants that drops of rain can strike; 0 without rain.
    pub rained_leaves: u64,
    /// The wind of the scene, which all of its parts share.
    pub wind: Arc<SceneWind>,
}

impl AssembledScene {
    /// Predicts the counts and bytes of a bake of these frames; no frames for a still scene.
    pub fn estimate(&self, recipe: &Recipe, frames: &[u32]) -> BakeEstimate {
        let mut counts = estimate(&self.animated, recipe, frames.len() as u64, &self.weights, self.rained_leaves);
        counts.memory.extend(Some(("recorded wind", self.wind.recorded_bytes())).filter(|part| part.1 > 0));
        BakeEstimate { modules: self.modules, ..counts }
    }
}

/// Grows the plants of a recipe, builds all of its assets and simulates the motions that are recorded ahead: lattice wind,
/// rods, rain.
/// # Errors
/// `Input` with the faults of grammars, `Limit`, `Cancelled`.
pub fn assemble_scene(recipe: &Recipe, parts: SceneOptions, context: &BakeContext<'_>) -> Result<AssembledScene> {
    assemble(&with_drawn_textures(recipe, parts), None, parts, None, context)
}

/// As [`assemble_scene`]; `observer` receives all samples that parts of the scene take of its wind, in later frames too.
/// # Errors
/// As [`assemble_scene`].
pub fn assemble_observed_scene(
    recipe: &Recipe,
    parts: SceneOptions,
    observer: Arc<dyn WindObserver>,
    context: &BakeContext<'_>,
) -> Result<AssembledScene> {
    assemble(&with_drawn_textures(recipe, parts), None, parts, Some(observer), context)
}

/// As [`assemble_scene`] for an estimate: maps are not drawn; wind, rain and motions are not simulated. The scene can be
/// counted, but not written.
/// # Errors
/// As [`assemble_scene`].
pub fn assemble_for_estimate(
    recipe: &Recipe,
    parts: SceneOptions,
    context: &BakeContext<'_>,
) -> Result<AssembledScene> {
    let full = with_drawn_textures(recipe, parts);
    assemble(&reduction::reduced_recipe(&full), Some(&full), parts, None, context)
}

/// The recipe, or its copy without the textures that `parts` leaves out.
fn with_drawn_textures(recipe: &Recipe, parts: SceneOptions) -> Cow<'_, Recipe> {
    if parts.unused_textures { Cow::Borrowed(recipe) } else { reduction::without_unused_textures(recipe) }
}

/// Common part of the functions above. `full`: in an estimate, the recipe of which `recipe` is a reduction; else `None`.
fn assemble(
    recipe: &Recipe,
    full: Option<&Recipe>,
    parts: SceneOptions,
    observer: Option<Arc<dyn WindObserver>>,
    context: &BakeContext<'_>,
) -> Result<AssembledScene> {
    if recipe.is_layered_picture() {
        let reason = format!("\"{}\" is a picture, not a scene in space: osier grow {0} -o {0}.png", recipe.name);
        return Err(Error::input("S006", reason));
    }
    let estimating = full.is_some();

    // Placement: where each plant stands, and which individual of its kind it shows. An estimate grows a sample of the
    // individuals, each with a weight.
    let SceneLayout { plants: mut layout, terrain, report: layout_report } = lay_out_scene(recipe, context)?;
    check_individuals(recipe, &layout)?;
    let weights = if estimating {
        reduction::sample_individuals_of_each_plant(&mut layout, recipe.plants.len())
    } else {
        Vec::new()
    };
    context.limits.check("instances", layout.instances.len() as u64, "the number of placements")?;
    context.progress.stage("drawing ground, bark and leaves", recipe.plants.len() as u64);
    let has_ground = parts.ground && recipe.ground.show && terrain.is_none();
    let ground = has_ground.then(|| place_on_ground(recipe, &mut layout));

    // Materials, then growth. The ground's map and mesh are made at the same time, where the growth of few plants leaves
    // threads idle.
    let (plants, ground_surface) = join(
        || {
            let mut sets = plant_material_sets(recipe, &layout, context)?;
            let full_plants = full.iter().flat_map(|m| &m.plants);
            sets.iter_mut().zip(full_plants).for_each(|(set, plant)| reduction::restore_image_sizes(set, plant));
            context.progress.stage("growing", layout.individuals.len() as u64);
            let mut grown = grow_plants(recipe, &layout, terrain.as_ref(), &sets, context)?;
            add_worn_colors(recipe, &layout, &mut sets, &mut grown.0)?;
            Ok::<_, Error>((sets, grown))
        },
        || {
            ground
                .as_ref()
                .map(|ground| {
                    let mut set = ground_materials(&ground.shape, &recipe.ground, recipe.sky.horizon)?;
                    full.iter().for_each(|m| reduction::restore_ground_sizes(&mut set, m.ground.side));
                    Ok::<_, Error>((set, ground.shape.mesh()?))
                })
                .transpose()
        },
    );
    let ((material_sets, (grown, mut report)), ground_surface) = (plants?, ground_surface?);
    report.extend(layout_report);
    material_sets.iter().filter_map(|l| l.tree.as_ref()).for_each(|tree| report.extend(tree.report.clone()));
    // Feet are sunk into slopes by their radius, which is known after growth.
    if let Some(terrain) = &terrain {
        let stem_foot_radii = stem_foot_radii(recipe, &layout, &grown);
        sink_feet(&mut layout, &stem_foot_radii, terrain);
    }
    let mut builder = SceneBuilder { reserved: added_asset_ids(recipe), ..SceneBuilder::default() };
    let mut materials: Vec<PlantMaterials> =
        material_sets.into_iter().map(|set| builder.add_materials(set)).collect::<Result<_>>()?;
    choose_shader_wind(recipe, &layout, &mut materials);
    context.progress.stage("skinning", layout.individuals.len() as u64);
    let weight = |i: usize| weights.get(i).copied().unwrap_or(1);
    let modules = grown.iter().enumerate().map(|(i, g)| g.modules * weight(i)).sum();

    // Solids: obstacles and the land, around which a lattice wind flows and on which catkins come to rest.
    let surface = match (&terrain, &ground) {
        (Some(terrain), _) => GroundSurface::Terrain(terrain),
        (None, Some(ground)) => GroundSurface::Waves(&ground.shape, ground.center),
        _ => GroundSurface::Level,
    };
    let obstacles = Obstacles::from_recipe(recipe, surface)?;
    let solids = lattice_solids(full.unwrap_or(recipe), &obstacles);
    full.map_or(Ok(()), |full| check_lattice(full, &solids, context, &mut report))?;

    // The wind, which all of the following parts share.
    let needs = WindNeeds::of_scene(full.unwrap_or(recipe), &layout, &grown);
    let surroundings = WindSurroundings { solids: &solids, land: obstacles.wind_height_datum(recipe) };
    let scene_wind = Arc::new(SceneWind::new(recipe, full, &needs, &surroundings, observer, context, &mut report)?);
    let wind = PlantWind::new(recipe, &scene_wind);
    let wind = if estimating { wind.map(PlantWind::for_estimate) } else { wind };

    // Plants. In the rain they move together with the drops.
    let added =
        add_plant_assets(recipe, wind.as_ref(), &layout, &materials, &grown, &mut builder, context, &mut report)?;
    report_clamped_angles(added.clamped_angles, &mut report);
    builder.placements = place_plants(wind.as_ref(), &builder, &layout);

    // Rain reads the assets of the plants as they were just built, and takes leaves with water maps out of them. An estimate
    // simulates one frame of it, from the first drop.
    let short_recipe = full.map(reduction::recipe_cut_to_first_interval);
    let rain_recipe = short_recipe.as_ref().unwrap_or(recipe);
    let rain_ground = match (&terrain, &ground) {
        (Some(terrain), _) if recipe.rain.is_some() => RainGround::Terrain(terrain.clone()),
        (_, Some(ground)) => RainGround::Waves(ground.shape.clone(), ground.center),
        _ => RainGround::Level { shown: recipe.ground.show },
    };
    let mut rain = add_rain(
        rain_recipe,
        full,
        &layout,
        &grown,
        scene_wind.wind_at_all_times(WindUser::Rain).filter(|_| recipe.clip.len() >= 2),
        rain_ground,
        added.motions_in_rain,
        &mut builder,
        context,
        &mut report,
    )?;

    // Other visible assets. Files list assets in this order.
    add_ifs_attractors(recipe, &mut builder, context)?;
    let canopy = Canopy::of_scene(recipe, &layout, &grown, &builder);
    let flight = add_catkins(recipe, &obstacles, &scene_wind, canopy, &mut builder, context, &mut report)?;
    let rod_wind = scene_wind.wind_at_all_times(WindUser::Rods);
    // Bodies released by rods fall to the ground beneath, or to y = 0 without a ground.
    let rod_ground: Box<dyn GroundHeight> = match (&terrain, &ground) {
        (Some(terrain), _) if !recipe.rods.is_empty() => Box::new(RainGround::Terrain(terrain.clone())),
        (_, Some(ground)) => Box::new(RainGround::Waves(ground.shape.clone(), ground.center)),
        _ => Box::new(0.0_f64),
    };
    add_rods(recipe, rod_wind.as_deref(), &*rod_ground, estimating, &mut builder, context, &mut report)?;
    add_obstacles(recipe, &mut builder)?;

    let (flight_table, fields, flight_volumes) =
        flight.map_or((None, Vec::new(), Vec::new()), |f| (Some(f.table), f.fields, f.volumes));
    let wind_output = WindGridSampler::from_recipe(recipe, &scene_wind, &obstacles, context)?;
    let wind_volume = velocity_grid(recipe, &obstacles).filter(|_| wind_output.is_some());
    let air = if wind_output.is_some() { placed_grids(recipe, &obstacles) } else { Vec::new() };

    // A camera without keys frames the assets so far; the larger ground is framed only in scenes without other assets.
    let empty = builder.placements.is_empty();
    let camera = if empty { None } else { Some(scene_camera(recipe, &builder.assets, &builder.placements)) };
    if let Some((ground, (materials, mesh))) = ground.as_ref().zip(ground_surface) {
        add_ground(materials, mesh, ground.center, &mut builder)?;
    }
    let terrain = terrain.filter(|_| parts.ground);
    if let Some((terrain, of)) = terrain.as_ref().zip(recipe.terrain.as_ref()) {
        add_terrain(terrain, of, recipe.general.seed, &mut builder)?;
    }
    rain.add_wet_surfaces(recipe, grown.len(), &mut builder, context)?;
    let rained_leaves = rain.leaf_counts.iter().enumerate().map(|(i, leaves)| leaves * weight(i)).sum();
    builder.make_material_names_unique();
    builder.make_image_names_unique()?;
    let mut camera = camera.unwrap_or_else(|| scene_camera(recipe, &builder.assets, &builder.placements));
    if let Some(terrain) = &terrain {
        lift_camera(&mut camera, terrain);
    }

    // Tables and fields are in the order in which their motions were added: flight, then rain. The wind's volume comes first.
    let mut scene = Scene {
        name: recipe.name.clone(),
        title: recipe.general.title.clone(),
        seed: recipe.general.seed,
        hash: recipe.hash.clone(),
        clip: recipe.clip,
        camera,
        sun: scene_sun(recipe),
        sky: scene_sky(recipe),
        images: builder.images,
        materials: builder.materials,
        assets: builder.assets,
        placements: builder.placements,
        land: terrain.map(terrain_height_field),
        tables: flight_table.into_iter().chain(rain.table).collect(),
        enum_labels: enum_labels(),
        fields,
        air,
        volumes: wind_volume.into_iter().chain(flight_volumes).collect(),
        map_sequences: rain.map_sequences,
    };
    scene.remove_unused_textures();
    Ok(AssembledScene {
        animated: AnimatedScene { scene: Arc::new(scene), motions: builder.motions, wind: wind_output },
        report,
        modules,
        weights,
        rained_leaves,
        wind: scene_wind,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::{Request, resolve};
    use osier_base::limits::Limits;
    use osier_base::progress::{Cancel, Silent};

    /// A turf is blades alone: it has neither thick axes nor leaves, whose textures would be files that nothing shows.
    #[test]
    fn textures_of_materials_that_nothing_has_are_left_out() {
        let text = "[plants.turf]\nshapes = \"turf.shapes\"\n[plants.turf.growth]\nroots = 3\n[ground]\nside = 64\n";
        let request = Request { text: text.into(), ..Request::default() };
        let recipe = resolve(&request).expect("scene").0;
        let context =
            BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
        let scene = assemble_scene(&recipe, SceneOptions::default(), &context).expect("scene").animated.scene;
        let names: Vec<&str> = scene.images.iter().map(|image| image.name.as_str()).collect();
        assert!(names.iter().all(|name| name.starts_with("turf_shoot_") || name.starts_with("ground_")), "{names:?}");
        assert!(names.contains(&"turf_shoot_color") && names.contains(&"ground_rough"), "{names:?}");
        // The materials that stay have their own images under the new numbers.
        for material in &scene.materials {
            for image in material.maps.all().into_iter().flatten() {
                assert!(names[image as usize].starts_with(&format!("{}_", material.name)), "{}", material.name);
            }
        }
    }
}
