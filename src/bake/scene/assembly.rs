//! From a recipe to a scene with what moves in it.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::attractor;
use crate::bake::assets::catkin;
use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::obstacles::{self, GroundSurface, Obstacles};
use crate::bake::assets::plant_growth::{GrownPlant, grow_plant};
use crate::bake::assets::plant_materials::{ground_materials, ground_shape, plant_materials};
use crate::bake::assets::plant_mesh::{PlantMaterials, build_plant_asset};
use crate::bake::assets::terrain;
use crate::bake::motion::AssetMotion;
use crate::bake::motion::flight::FlightPlayback;
use crate::bake::motion::flight::{self, FlightContext};
use crate::bake::motion::rain::{self, RainedPlantMotion};
use crate::bake::motion::rod;
use crate::bake::motion::rod_plant::{RodPlantMotion, SkinBinding, build_rod_plant};
use crate::bake::motion::sway::SwayMotion;
use crate::bake::output::bake_estimate::BakeEstimate;
use crate::bake::output::estimate::estimate;
use crate::bake::scene::animated::AnimatedScene;
use crate::bake::scene::camera_light::{camera, sky, sun};
use crate::bake::scene::dry_run;
use crate::bake::scene::layout::lay_out_scene;
use crate::bake::scene::plant_layout::{Individual, PlantInstance, PlantLayout};
use crate::bake::scene::scatter;
use crate::bake::wind::lattice::{LatticeRequest, check_lattice, lattice_solids, plant_bounds};
use crate::bake::wind::output::{WindOutput, WindUsers};
use crate::bake::wind::plant_wind::PlantWind;
use crate::bake::wind::playback::WindPlayback;
use crate::recipe::scene::BarkMotion;
use crate::recipe::scene::CatkinKeys;
use crate::recipe::scene::TerrainKeys;
use crate::recipe::scene::WindModel;
use crate::recipe::{KeyTable as _, Recipe};
use osier_base::convert::index;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::Names;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par::{join, par_map};
use osier_base::{Error, Result};
use osier_motion::rods::RodPlant;
use osier_plants::surface::ground::Ground;
use osier_plants::surface::terrain::Terrain;
use osier_scene::plant::AxisKind;
use osier_scene::{
    Asset, AssetKind, Field, Image, MapSequence, Material, Mesh, MeshMotion, MeshObject, Placement, Scene, Table, Trs,
};

/// Which parts of a recipe are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SceneParts {
    /// The ground.
    pub ground: bool,
}

impl Default for SceneParts {
    fn default() -> Self {
        Self { ground: true }
    }
}

/// A stage with what was said while it was made.
#[derive(Debug)]
pub struct AssembledScene {
    /// Scene and movers.
    pub animated: AnimatedScene,
    /// Warnings of grammars and turtles.
    pub report: Report,
    /// Modules of all final strings.
    pub modules: u64,
    /// In a plan: how many individuals each of the first assets stands for. Empty in what was built.
    pub weights: Vec<u64>,
}

impl AssembledScene {
    /// What writing `frames` (none: still) will make.
    pub fn counts(&self, recipe: &Recipe, frames: &[u32]) -> BakeEstimate {
        BakeEstimate { modules: self.modules, ..estimate(&self.animated, recipe, frames.len() as u64, &self.weights) }
    }
}

/// Grows and dresses everything that a recipe names.
/// # Errors
/// `Input` with the faults of grammars, `Limit`, `Cancelled`.
pub fn assemble_scene(recipe: &Recipe, parts: SceneParts, context: &BakeContext<'_>) -> Result<AssembledScene> {
    assemble(recipe, None, parts, context)
}

/// As [`assemble_scene`] for a look at what would be made: no map is drawn, no air, rain or motion is simulated. The stage can be
/// counted, not written.
/// # Errors
/// As [`assemble_scene`].
pub fn assemble_for_estimate(recipe: &Recipe, parts: SceneParts, context: &BakeContext<'_>) -> Result<AssembledScene> {
    assemble(&dry_run::reduced_recipe(recipe), Some(recipe), parts, context)
}

/// `meant`: what the recipe is a draft of.
fn assemble(
    recipe: &Recipe,
    meant: Option<&Recipe>,
    parts: SceneParts,
    context: &BakeContext<'_>,
) -> Result<AssembledScene> {
    if !recipe.layers.is_empty() && recipe.plants.is_empty() && recipe.clouds.is_empty() && recipe.terrain.is_none() {
        let reason = format!("\"{}\" is a picture, not a scene in space: osier grow {0} -o {0}.png", recipe.name);
        return Err(Error::input("S006", reason));
    }
    let (mut layout, land) = lay_out_scene(recipe, context)?;
    let weights =
        if meant.is_some() { dry_run::sample_individuals(&mut layout, recipe.plants.len()) } else { Vec::new() };
    context.limits.check("instances", layout.standings.len() as u64, "the number of placements")?;
    context.progress.stage("drawing ground, bark and leaves", recipe.plants.len() as u64);
    let shown = parts.ground && recipe.ground.show && land.is_none();
    let soil = shown.then(|| place_on_ground(recipe, &mut layout));
    // The ground is made where growing leaves threads idle.
    let (plants, ground) = join(
        || {
            let mut looks = build_materials(recipe, &layout, context)?;
            let plants = meant.iter().flat_map(|m| &m.plants);
            looks.iter_mut().zip(plants).for_each(|(look, plant)| dry_run::restore_image_sizes(look, plant));
            context.progress.stage("growing", layout.individuals.len() as u64);
            let grown = grow_all(recipe, &layout, &looks, context)?;
            Ok::<_, Error>((looks, grown))
        },
        || {
            soil.as_ref()
                .map(|(shape, _)| {
                    let mut look = ground_materials(shape, &recipe.ground, recipe.sky.horizon)?;
                    meant.iter().for_each(|m| dry_run::restore_ground_sizes(&mut look, m.ground.side));
                    Ok::<_, Error>((look, shape.mesh()?))
                })
                .transpose()
        },
    );
    let ((looks, (grown, mut report)), ground) = (plants?, ground?);
    looks.iter().filter_map(|l| l.tree.as_ref()).for_each(|tree| report.extend(tree.report.clone()));
    if let Some(land) = &land {
        let feet = foot_radii(recipe, &layout, &grown);
        scatter::snap_to_terrain(&mut layout, &feet, land);
    }
    let mut made = SceneBuilder::default();
    let mut kinds: Vec<PlantMaterials> = looks.into_iter().map(|look| made.add_materials(look)).collect();
    crate::bake::assets::plant_mesh::mark_shader_wind(recipe, &layout, &mut kinds);
    context.progress.stage("skinning", layout.individuals.len() as u64);
    let weight = |i: usize| weights.get(i).copied().unwrap_or(1);
    let modules = grown.iter().enumerate().map(|(i, g)| g.modules * weight(i)).sum();
    let footing = match (&land, &soil) {
        (Some(land), _) => GroundSurface::Land(land),
        (None, Some((shape, middle))) => GroundSurface::Ground(shape, *middle),
        _ => GroundSurface::Level,
    };
    let obstacles = Obstacles::of(recipe, footing)?;
    let solids = lattice_solids(meant.unwrap_or(recipe), &obstacles);
    meant.map_or(Ok(()), |m| check_lattice(m, &solids, context, &mut report))?;
    // Who tells the wind tells all of it, if no flight has one of its own.
    let all = !recipe.output.wind.grids.is_empty() && recipe.flight.is_none();
    let bounds = if all { Bounds::of([]) } else { plant_bounds(&layout, &grown) };
    let wanted = LatticeRequest { bounds, solids: &solids, repeats: None };
    // A wind that nothing sways in is not kept.
    let sways = !layout.individuals.is_empty();
    let air = if sways { PlantWind::of(recipe, &wanted, context, &mut report)? } else { None };
    let air = if meant.is_some() { air.map(PlantWind::for_estimate) } else { air };
    // Leaves that rain falls on are moved by rods or not at all.
    let swaying = air.as_ref().filter(|_| recipe.rain.is_none());
    add_plants(recipe, swaying, &layout, &kinds, &grown, &mut made, context, &mut report)?;
    crate::bake::motion::sway::report_clamped_angles(made.clamped_angles, &mut report);
    made.placements = place_plants(swaying, &made, &layout);
    let short = meant.map(dry_run::first_rain_frame);
    let raining = short.as_ref().unwrap_or(recipe);
    let rain_ground = rain_ground(recipe, land.as_ref(), soil.as_ref().map(|(shape, middle)| (shape, *middle)));
    let (map_sequences, rained) =
        add_rain(raining, meant.is_some(), &layout, &grown, air.as_ref(), rain_ground, &mut made, context)?;
    add_attractors(recipe, &mut made, context)?;
    let twigs = twig_tips(recipe, &layout, &grown);
    let flown = add_catkins(recipe, &obstacles, &twigs, &mut made, context, &mut report)?;
    let measures: Vec<RecordedTable> = flown.into_iter().chain(rained.map(|table| (table, Vec::new()))).collect();
    add_rods(recipe, meant.is_some(), &mut made, context, &mut report)?;
    add_obstacles(recipe, &mut made)?;
    let others = WindUsers { flight: made.flight.clone(), air: air.as_ref(), solids: &solids };
    let breeze = WindOutput::of(recipe, &others, context, &mut report)?;
    let bare = made.placements.is_empty();
    let plants = if bare { None } else { Some(camera(recipe, &made.assets, &made.placements)) };
    if let Some(((_, middle), ground)) = soil.as_ref().zip(ground) {
        add_ground(ground.0, ground.1, *middle, &mut made);
    }
    let land = land.filter(|_| parts.ground);
    if let Some((land, keys)) = land.as_ref().zip(recipe.terrain.as_ref()) {
        add_terrain(land, keys, recipe.general.seed, &mut made)?;
    }
    let mut camera = plants.unwrap_or_else(|| camera(recipe, &made.assets, &made.placements));
    if let Some(land) = &land {
        terrain::lift_camera(&mut camera, land);
    }
    let scene = Scene {
        name: recipe.name.clone(),
        title: recipe.general.title.clone(),
        seed: recipe.general.seed,
        hash: recipe.hash.clone(),
        clip: recipe.clip,
        camera,
        sun: sun(recipe),
        sky: sky(recipe),
        images: made.images,
        materials: made.materials,
        assets: made.assets,
        placements: made.placements,
        land: land.map(terrain::field),
        tables: measures.iter().map(|m| m.0.clone()).collect(),
        code_lists: rain::code_lists(),
        fields: measures.into_iter().flat_map(|m| m.1).collect(),
        air: if breeze.is_some() { recipe.output.wind.grids.clone() } else { Vec::new() },
        map_sequences,
    };
    Ok(AssembledScene {
        animated: AnimatedScene { scene: Arc::new(scene), motions: made.motions, wind: breeze },
        report,
        modules,
        weights,
    })
}

/// What is collected for the scene.
#[derive(Default)]
struct SceneBuilder {
    images: Vec<Image>,
    materials: Vec<Material>,
    assets: Vec<Asset>,
    /// Parallel to the assets.
    motions: Vec<Option<Arc<dyn AssetMotion>>>,
    placements: Vec<Placement>,
    flight: Option<Arc<FlightPlayback>>,
    /// Angles that the paper's sway model clamped, over all plants.
    clamped_angles: u64,
    /// Plants on rods that rain falls on, by asset.
    rod_plants: Vec<Option<(RodPlant, SkinBinding)>>,
}

impl SceneBuilder {
    /// Adds an asset with what moves it; returns its index.
    fn add_asset(&mut self, asset: Asset, motion: Option<Arc<dyn AssetMotion>>) -> usize {
        self.assets.push(asset);
        self.motions.push(motion);
        self.assets.len() - 1
    }

    /// Adds an asset that is shown once, under its own id.
    fn add_placed(&mut self, asset: Asset, transform: Trs, motion: Option<Arc<dyn AssetMotion>>) {
        let name = asset.id.clone();
        let asset = self.add_asset(asset, motion);
        self.placements.push(Placement { name, asset, transform, phase: 0 });
    }

    /// Makes an id that no asset has yet, by appending `suffix`.
    fn make_unique(&self, id: &mut String, suffix: &str) {
        while self.assets.iter().any(|a| a.id == *id) {
            id.push_str(suffix);
        }
    }

    /// Adds materials and pictures; returns where they start.
    fn add_materials(&mut self, look: MaterialSet) -> PlantMaterials {
        let index = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let organ_names = look.names;
        let tile = look.materials.first().map_or(0.5, |bark| bark.tile);
        let (first_material, first_image) = (index(self.materials.len()), index(self.images.len()));
        self.images.extend(look.images);
        self.materials.extend(look.materials.into_iter().map(|mut m| {
            for map in [&mut m.maps.color, &mut m.maps.normal, &mut m.maps.roughness, &mut m.maps.height] {
                *map = map.map(|i| i + first_image);
            }
            m
        }));
        PlantMaterials { first_material, tile, organ_names, shader_wind: false }
    }
}

/// The first failure in order, or all results.
fn in_order<T>(results: Vec<Result<T>>) -> Result<Vec<T>> {
    results.into_iter().collect()
}

/// Bark, leaves and what else plants wear; nothing for those that stand nowhere.
fn build_materials(recipe: &Recipe, layout: &PlantLayout, context: &BakeContext<'_>) -> Result<Vec<MaterialSet>> {
    let indexed: Vec<_> = recipe.plants.iter().enumerate().collect();
    in_order(par_map(&indexed, |(i, plant)| {
        context.cancel.check()?;
        let used = layout.individuals.iter().any(|n| n.plant == *i);
        let look = if used { plant_materials(plant, recipe.general.seed, context) } else { Ok(MaterialSet::default()) };
        context.progress.advance(1);
        look
    }))
}

fn grow_all(
    recipe: &Recipe,
    layout: &PlantLayout,
    looks: &[MaterialSet],
    context: &BakeContext<'_>,
) -> Result<(Vec<GrownPlant>, Report)> {
    let grown = par_map(&layout.individuals, |individual| {
        context.cancel.check()?;
        let (plant, look) = pair(recipe, looks, individual)?;
        let grown = grow_plant(plant, individual, look, context);
        context.progress.advance(1);
        grown
    });
    let mut report = Report::default();
    let mut plants = Vec::new();
    for result in grown {
        match result {
            Ok(mut g) => {
                report.extend(std::mem::take(&mut g.report));
                plants.push(g);
            }
            Err(Error::Input(faults)) => report.extend(*faults),
            Err(other) => return Err(other),
        }
    }
    report.into_result(plants)
}

fn pair<'a, T>(
    recipe: &'a Recipe,
    list: &'a [T],
    individual: &Individual,
) -> Result<(&'a crate::recipe::PlantRecipe, &'a T)> {
    let both = recipe.plants.get(individual.plant).zip(list.get(individual.plant));
    both.ok_or_else(|| Error::input("S005", "a place names a plant that is not there"))
}

/// A plant as it is shown.
struct BuiltPlant {
    asset: Asset,
    motion: Option<Arc<dyn AssetMotion>>,
    clamped_angles: u64,
    /// Rods that rain moves.
    rod_plants: Option<(RodPlant, SkinBinding)>,
    told: Vec<Diagnostic>,
}

impl BuiltPlant {
    fn new(asset: Asset, told: Vec<Diagnostic>) -> Self {
        Self { asset, motion: None, clamped_angles: 0, rod_plants: None, told }
    }
}

fn add_plants(
    recipe: &Recipe,
    air: Option<&PlantWind>,
    layout: &PlantLayout,
    kinds: &[PlantMaterials],
    grown: &[GrownPlant],
    made: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<()> {
    let jobs: Vec<(usize, &Individual, &GrownPlant)> =
        layout.individuals.iter().zip(grown).enumerate().map(|(i, (n, g))| (i, n, g)).collect();
    let stands = layout.first_stands();
    let dressed = par_map(&jobs, |(i, individual, grown)| {
        let (plant, kind) = pair(recipe, kinds, individual)?;
        let stand = stands.get(*i).copied().unwrap_or(Trs::IDENTITY);
        let still = matches!(plant.keys.motion, BarkMotion::Still | BarkMotion::Static);
        let clock = (recipe.clip.fps(), recipe.clip.start);
        let rods = || build_rod_plant(grown, plant, kind, individual, stand, clock, recipe.gravity(), context);
        let springs = plant.rods.is_some() && !still;
        let dressed = if springs && recipe.rain.is_some() && recipe.clip.len() > 1 {
            let rod_plants = rods()?;
            BuiltPlant {
                rod_plants: Some((rod_plants.boughs, rod_plants.dressing)),
                ..BuiltPlant::new(rod_plants.asset, rod_plants.told)
            }
        } else if let Some(air) = air.filter(|_| springs) {
            let rod_plants = rods()?;
            let shiver = RodPlantMotion::new((rod_plants.boughs, rod_plants.dressing), plant, air, clock.0);
            let motion: Option<Arc<dyn AssetMotion>> = Some(Arc::new(shiver));
            BuiltPlant { motion, ..BuiltPlant::new(rod_plants.asset, rod_plants.told) }
        } else if plant.rods.is_some() {
            BuiltPlant::new(rods()?.stilled(), Vec::new())
        } else {
            let (asset, mover) = build_plant_asset(grown, plant, kind, individual, air.map(|a| (a, stand)), context)?;
            BuiltPlant {
                clamped_angles: mover.as_ref().map_or(0, SwayMotion::clamped),
                motion: mover.map(|m| Arc::new(m) as Arc<dyn AssetMotion>),
                ..BuiltPlant::new(asset, Vec::new())
            }
        };
        context.progress.advance(1);
        Ok(dressed)
    });
    for (dressed, individual) in in_order(dressed)?.into_iter().zip(&layout.individuals) {
        let group = recipe.plants.get(individual.plant).map(|p| p.id.clone()).unwrap_or_default();
        made.add_asset(Asset { group, ..dressed.asset }, dressed.motion);
        made.clamped_angles += dressed.clamped_angles;
        made.rod_plants.push(dressed.rod_plants);
        dressed.told.into_iter().for_each(|d| report.push(d));
    }
    Ok(())
}

fn place_plants(air: Option<&PlantWind>, made: &SceneBuilder, layout: &PlantLayout) -> Vec<Placement> {
    let SceneBuilder { assets, motions, .. } = made;
    let mut names = Names::default();
    let mut first: BTreeMap<usize, Vec3> = BTreeMap::new();
    let mut of = |s: &PlantInstance| {
        let id = assets.get(s.individual).map_or("plant", |a| &a.id);
        let first = *first.entry(s.individual).or_insert(s.transform.t);
        // Rods swing on and on: their frames come one after another.
        let moves = motions.get(s.individual).and_then(Option::as_ref).is_some_and(|m| m.supports_phases());
        let phase = air.filter(|_| moves).map_or(0, |air| air.phase(first, s.transform.t));
        Placement { name: names.unique(id), asset: s.individual, transform: s.transform, phase }
    };
    layout.standings.iter().map(&mut of).collect()
}

/// Sets the plants on the ground, whose middle is theirs, and returns it with its place.
fn place_on_ground(recipe: &Recipe, layout: &mut PlantLayout) -> (Ground, Vec3) {
    let shape = ground_shape(&recipe.ground, recipe.general.seed);
    let feet = Bounds::of(layout.standings.iter().map(|s| s.transform.t));
    let middle = feet.center() * Vec3::new(1.0, 0.0, 1.0);
    for s in &mut layout.standings {
        let at = s.transform.t - middle;
        s.transform.t.y += shape.height(at.x, at.z);
    }
    (shape, middle)
}

/// How far the feet of the individuals reach.
fn foot_radii(recipe: &Recipe, layout: &PlantLayout, grown: &[GrownPlant]) -> Vec<f32> {
    let one = |(individual, grown): (&Individual, &GrownPlant)| {
        recipe.plants.get(individual.plant).map_or(0.0, |plant| scatter::foot_radius(&grown.plant, &plant.skin))
    };
    layout.individuals.iter().zip(grown).map(one).collect()
}

fn add_terrain(shape: &Terrain, keys: &TerrainKeys, seed: u64, builder: &mut SceneBuilder) -> Result<()> {
    let materials = builder.add_materials(terrain::look(shape, keys, seed)?);
    builder.add_placed(terrain::asset(shape, materials.first_material), Trs::IDENTITY, None);
    Ok(())
}

fn add_ground(materials: MaterialSet, mut mesh: Mesh, middle: Vec3, builder: &mut SceneBuilder) {
    let materials = builder.add_materials(materials);
    for s in &mut mesh.subsets {
        s.material += materials.first_material;
    }
    let asset = Asset {
        id: "ground".into(),
        kind: AssetKind::Terrain,
        group: String::new(),
        skeleton: None,
        meshes: vec![MeshObject { name: "ground".into(), mesh, motion: MeshMotion::Still, skin: None }],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    };
    builder.add_placed(asset, Trs::translation(middle), None);
}

/// Adds the points of attractors where the scene wants them.
fn add_attractors(recipe: &Recipe, builder: &mut SceneBuilder, context: &BakeContext<'_>) -> Result<()> {
    for cloud in &recipe.clouds {
        let material = index(builder.materials.len(), "materials of a scene")?;
        let moving = recipe.clip.len() > 1;
        let new = attractor::build_attractor(cloud, recipe.general.seed, moving, material, context)?;
        builder.materials.push(new.surface);
        let motion = new.morphing.map(|morph| Arc::new(morph) as Arc<dyn AssetMotion>);
        builder.add_placed(new.asset, new.stand, motion);
    }
    Ok(())
}

/// The box of air that catkins fly in: a lattice's own, or one around the origin.
fn flight_bounds(recipe: &Recipe, size: [f64; 3]) -> Bounds {
    let lattice = recipe.wind.model == WindModel::Lattice;
    let [w, h, d] = if lattice { recipe.lattice.cells.map(|n| n * recipe.lattice.cell_size) } else { size }.map(narrow);
    let at = if lattice { Vec3::from_array(recipe.lattice.at.map(narrow)) } else { Vec3::ZERO };
    Bounds { min: at - Vec3::new(w / 2.0, 0.0, d / 2.0), max: at + Vec3::new(w / 2.0, h, d / 2.0) }
}

/// What a flight or rain measures.
type RecordedTable = (Table, Vec<Field>);

/// Lets catkins fly, or shows their kinds side by side.
fn add_catkins(
    recipe: &Recipe,
    obstacles: &Obstacles<'_>,
    twigs: &[(Vec3, f64)],
    made: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<Option<RecordedTable>> {
    if recipe.catkin.is_none() && recipe.flight.is_none() {
        return Ok(None);
    }
    let own = CatkinKeys::defaults();
    let keys = recipe.catkin.as_ref().unwrap_or(&own);
    let models = catkin::catkin_models(keys, recipe.general.seed, context)?;
    let levels = catkin::CatkinLods::of(keys);
    let kind = made.add_materials(catkin::materials(&models, &levels));
    let (asset, mover, measures) = match &recipe.flight {
        None => (catkin::row(&models, &levels, kind.first_material), None, None),
        Some(flight) => {
            let inside = flight_bounds(recipe, flight.keys.size);
            let points = f64::from(flight.keys.count) * (flight.keys.trails * recipe.clip.fps()).round();
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "far below 2^53")]
            context.limits.check("vertices", points as u64, "the number of points of flight.trails")?;
            let solids = Arc::new(obstacles.within(inside.size().max_element()));
            let early = flight::before(flight, recipe) as f64 / recipe.clip.fps();
            let mut stream = WindPlayback::new(recipe, solids.list(), early, context);
            let before = report.diagnostics.len();
            stream.spin_up(context.progress, report)?;
            let (known_height, cell) = (stream.known_height(), stream.cell());
            let setting = FlightContext { recipe, flight, inside, solids, known_height, cell, twigs };
            let course = FlightPlayback::new(&setting, stream, &models);
            if course.buried() > 0 {
                let text = format!("{} catkins found no place to start outside of solids", course.buried());
                let help = "raise flight.band, or make room between the solids";
                report.push(Diagnostic::about("S026", text).help(help));
            }
            let prototypes = models.iter().map(|m| m.prototype(&levels, kind.first_material)).collect();
            let said = report.diagnostics.iter().skip(before).map(|d| (d.code, d.message.clone())).collect();
            let (table, fields) = course.measures(&flight.keys, said);
            let measures = (table, fields.to_vec());
            let asset = course.asset(prototypes, kind.first_material, recipe.clip.len() < 2)?;
            let course = Arc::new(course);
            made.flight = Some(Arc::clone(&course));
            (asset, Some(course as Arc<dyn AssetMotion>), Some(measures))
        }
    };
    made.add_placed(asset, Trs::IDENTITY, mover);
    Ok(measures)
}

/// Ends of the twigs that let catkins go, m, with the weights of their plants.
fn twig_tips(recipe: &Recipe, layout: &PlantLayout, grown: &[GrownPlant]) -> Vec<(Vec3, f64)> {
    let Some(flight) = &recipe.flight else { return Vec::new() };
    let mut out = Vec::new();
    for standing in &layout.standings {
        let Some((individual, grown)) = layout.individuals.get(standing.individual).zip(grown.get(standing.individual))
        else {
            continue;
        };
        let Some((_, weight)) = flight.canopy.iter().find(|(plant, _)| *plant == individual.plant) else { continue };
        let plant = &grown.plant;
        let stems = plant.axes.iter().filter(|a| a.kind == AxisKind::Stem && a.order > 0);
        let ends = stems.filter_map(|a| plant.nodes.p.get(plant.nodes_of(a)).and_then(<[Vec3]>::last));
        out.extend(ends.map(|p| (standing.transform.apply(*p), *weight)));
    }
    out
}

/// The ground that rain ends on.
fn rain_ground(recipe: &Recipe, land: Option<&Terrain>, soil: Option<(&Ground, Vec3)>) -> rain::RainGround {
    match (land, soil) {
        (Some(land), _) if recipe.rain.is_some() => rain::RainGround::Hills(land.clone()),
        (_, Some((shape, middle))) => rain::RainGround::Waves(shape.clone(), middle),
        _ => rain::RainGround::Level(recipe.ground.show),
    }
}

/// Lets it rain on the plants; `draft`: their pictures hold no pixels.
fn add_rain(
    recipe: &Recipe,
    draft: bool,
    layout: &PlantLayout,
    grown: &[GrownPlant],
    air: Option<&PlantWind>,
    soil: rain::RainGround,
    made: &mut SceneBuilder,
    context: &BakeContext<'_>,
) -> Result<(Vec<MapSequence>, Option<Table>)> {
    let Some(rain) = &recipe.rain else { return Ok((Vec::new(), None)) };
    let stands = layout.first_stands();
    let plants: Vec<&osier_scene::plant::Plant> = grown.iter().map(|g| &g.plant).collect();
    let under = rain::RainScene {
        recipe,
        assets: &mut made.assets,
        materials: &mut made.materials,
        images: if draft { &[] } else { &made.images },
        stands: &stands,
        plants: &plants,
        rod_plants: std::mem::take(&mut made.rod_plants),
        wind: air.map(|a| Arc::clone(&a.wind)),
        soil,
    };
    let fallen = rain::simulate_rain(under, rain, context)?;
    // Plants that rain moves take their motion from its record.
    for (plant, motion) in made.motions.iter_mut().enumerate() {
        if fallen.rain.moves(plant) {
            *motion = Some(Arc::new(RainedPlantMotion { rain: Arc::clone(&fallen.rain), plant }));
        }
    }
    let moves = recipe.clip.len() > 1;
    made.add_placed(fallen.asset, Trs::IDENTITY, moves.then_some(fallen.rain as Arc<dyn AssetMotion>));
    Ok((fallen.map_sequences, moves.then_some(fallen.table)))
}

/// Adds rods; `draft`: without their motion.
fn add_rods(
    recipe: &Recipe,
    draft: bool,
    builder: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<()> {
    let first = index(builder.materials.len(), "materials of a scene")?;
    for mut new in rod::build_rod_assets(recipe, draft, first, context, report)? {
        builder.make_unique(&mut new.asset.id, "_rod");
        builder.materials.extend(new.materials);
        let motion = new.motion.map(|motion| Arc::new(motion) as Arc<dyn AssetMotion>);
        builder.add_placed(new.asset, Trs::IDENTITY, motion);
    }
    Ok(())
}

/// Adds the meshes of the obstacles that are shown.
fn add_obstacles(recipe: &Recipe, builder: &mut SceneBuilder) -> Result<()> {
    for solid in recipe.solids.iter().filter(|s| s.keys.show) {
        let (materials, build) = obstacles::build_obstacle(solid);
        let materials = builder.add_materials(materials);
        let mut asset = build(materials.first_material)?;
        builder.make_unique(&mut asset.id, "_solid");
        builder.add_placed(asset, Trs::IDENTITY, None);
    }
    Ok(())
}
