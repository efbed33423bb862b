//! From a recipe to a scene with what moves in it.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use super::Work;
use super::air::Air;
use super::blow::{Blown, foretell, plants_room, standing};
use super::boughs::{Dressing, Shiver, dress_sprung};
use super::breeze::{Breeze, Others};
use super::counts::{Counts, count};
use super::course::{self, Course, Setting};
use super::dress::{Kind, dress};
use super::layout::{Individual, Layout, Standing, lay_out_all};
use super::looks::{Look, ground_shape, of_ground, of_plant};
use super::mover::Moving;
use super::plants::{Grown, grow};
use super::solids::{self, Footing, Obstacles};
use super::stream::Stream;
use super::view::{camera, sky, sun};
use super::write::Stage;
use super::{catkin, draft, land, rain, rods, scatter};
use crate::recipe::catkin_keys::CatkinKeys;
use crate::recipe::land_keys::TerrainKeys;
use crate::recipe::sections::Motion;
use crate::recipe::wind_keys::WindModel;
use crate::recipe::{Recipe, Section as _};
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::fence::Names;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par::{join, par_map};
use osier_base::{Error, Result};
use osier_motion::rods::RodPlant;
use osier_plants::surface::ground::Ground;
use osier_plants::surface::terrain::Land;
use osier_scene::plant::AxisKind;
use osier_scene::{
    Asset, AssetKind, Field, Image, Material, Mesh, MeshMotion, MeshObject, Placement, Scene, Table, Trs, Wet,
};

/// Which parts of a recipe are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parts {
    /// The ground.
    pub ground: bool,
}

impl Default for Parts {
    fn default() -> Self {
        Self { ground: true }
    }
}

/// A stage with what was said while it was made.
#[derive(Debug)]
pub struct Built {
    /// Scene and movers.
    pub stage: Stage,
    /// Warnings of grammars and turtles.
    pub report: Report,
    /// Modules of all final strings.
    pub modules: u64,
    /// In a plan: how many individuals each of the first assets stands for. Empty in what was built.
    pub weights: Vec<u64>,
}

impl Built {
    /// What writing `frames` (none: still) will make.
    pub fn counts(&self, recipe: &Recipe, frames: &[u32]) -> Counts {
        Counts { modules: self.modules, ..count(&self.stage, recipe, frames.len() as u64, &self.weights) }
    }
}

/// Grows and dresses everything that a recipe names.
/// # Errors
/// `Input` with the faults of grammars, `Limit`, `Cancelled`.
pub fn build(recipe: &Recipe, parts: Parts, work: &Work<'_>) -> Result<Built> {
    made(recipe, None, parts, work)
}

/// As [`build`] for a look at what would be made: no map is drawn, no air, rain or motion is simulated. The stage can be
/// counted, not written.
/// # Errors
/// As [`build`].
pub fn plan(recipe: &Recipe, parts: Parts, work: &Work<'_>) -> Result<Built> {
    made(&draft::of(recipe), Some(recipe), parts, work)
}

/// `meant`: what the recipe is a draft of.
#[allow(clippy::too_many_lines, reason = "the kinds of things in a scene, one after the other")]
fn made(recipe: &Recipe, meant: Option<&Recipe>, parts: Parts, work: &Work<'_>) -> Result<Built> {
    if !recipe.layers.is_empty() && recipe.plants.is_empty() && recipe.clouds.is_empty() && recipe.terrain.is_none() {
        let reason = format!("\"{}\" is a picture, not a scene in space: osier grow {0} -o {0}.png", recipe.name);
        return Err(Error::export("S006", reason));
    }
    let (mut layout, land) = lay_out_all(recipe, work)?;
    let weights = if meant.is_some() { draft::thin(&mut layout, recipe.plants.len()) } else { Vec::new() };
    work.limits.check("instances", layout.standings.len() as u64, "the number of placements")?;
    work.progress.stage("drawing ground, bark and leaves", recipe.plants.len() as u64);
    let shown = parts.ground && recipe.ground.show && land.is_none();
    let soil = shown.then(|| lay_ground(recipe, &mut layout));
    // The ground is made where growing leaves threads idle.
    let (plants, ground) = join(
        || {
            let mut looks = look_all(recipe, &layout, work)?;
            let plants = meant.iter().flat_map(|m| &m.plants);
            looks.iter_mut().zip(plants).for_each(|(look, plant)| draft::enlarge(look, plant));
            work.progress.stage("growing", layout.individuals.len() as u64);
            let grown = grow_all(recipe, &layout, &looks, work)?;
            Ok::<_, Error>((looks, grown))
        },
        || {
            soil.as_ref()
                .map(|(shape, _)| {
                    let mut look = of_ground(shape, &recipe.ground, recipe.sky.horizon)?;
                    meant.iter().for_each(|m| draft::enlarge_all(&mut look, m.ground.side));
                    Ok::<_, Error>((look, shape.mesh()?))
                })
                .transpose()
        },
    );
    let ((looks, (grown, mut report)), ground) = (plants?, ground?);
    looks.iter().filter_map(|l| l.tree.as_ref()).for_each(|tree| report.extend(tree.report.clone()));
    if let Some(land) = &land {
        let feet = feet(recipe, &layout, &grown);
        scatter::sink(&mut layout, &feet, land);
    }
    let mut made = Made::default();
    let mut kinds: Vec<Kind> = looks.into_iter().map(|look| made.take(look)).collect();
    super::dress::mark_beyond_skins(recipe, &layout, &mut kinds);
    work.progress.stage("skinning", layout.individuals.len() as u64);
    let weight = |i: usize| weights.get(i).copied().unwrap_or(1);
    let modules = grown.iter().enumerate().map(|(i, g)| g.modules * weight(i)).sum();
    let footing = match (&land, &soil) {
        (Some(land), _) => Footing::Land(land),
        (None, Some((shape, middle))) => Footing::Ground(shape, *middle),
        _ => Footing::Level,
    };
    let obstacles = Obstacles::of(recipe, footing)?;
    let solids = standing(meant.unwrap_or(recipe), &obstacles);
    meant.map_or(Ok(()), |m| foretell(m, &solids, work, &mut report))?;
    // Who tells the wind tells all of it, if no flight has one of its own.
    let all = !recipe.output.air.grids.is_empty() && recipe.flight.is_none();
    let bounds = if all { Bounds::of([]) } else { plants_room(&layout, &grown) };
    let wanted = Blown { bounds, solids: &solids, repeats: None };
    // A wind that nothing sways in is not kept.
    let sways = !layout.individuals.is_empty();
    let air = if sways { Air::of(recipe, &wanted, work, &mut report)? } else { None };
    let air = if meant.is_some() { air.map(Air::drafted) } else { air };
    // Leaves that rain falls on are moved by rods or not at all.
    let swaying = air.as_ref().filter(|_| recipe.rain.is_none());
    dress_all((recipe, swaying), (&layout, &kinds, &grown), &mut made, (work, &mut report))?;
    super::mover::tell_clamped(&made.movers, &mut report);
    let mut placements = placements(swaying, &made, &layout);
    let short = meant.map(draft::shower);
    let raining = short.as_ref().unwrap_or(recipe);
    let under = (air.as_ref(), rained_on(recipe, land.as_ref(), soil.as_ref().map(|(shape, middle)| (shape, *middle))));
    let (wet, rained) =
        add_rain((raining, meant.is_some()), (&layout, &grown), under, (&mut made, &mut placements), work)?;
    add_clouds(recipe, &mut made, &mut placements, work)?;
    let twigs = twigs(recipe, &layout, &grown);
    let flown = add_catkins(recipe, (&obstacles, &twigs), (&mut made, &mut placements), (work, &mut report))?;
    let measures: Vec<Measures> = flown.into_iter().chain(rained.map(|table| (table, Vec::new()))).collect();
    add_rods((recipe, meant.is_some()), (&mut made, &mut placements), (work, &mut report))?;
    add_solids(recipe, &mut made, &mut placements)?;
    let others = Others { movers: &made.movers, air: air.as_ref(), solids: &solids };
    let breeze = Breeze::of(recipe, &others, work, &mut report)?;
    let bare = placements.is_empty();
    let plants = if bare { None } else { Some(camera(recipe, &made.assets, &placements)) };
    if let Some(((_, middle), ground)) = soil.as_ref().zip(ground) {
        add_ground(ground, *middle, &mut made, &mut placements);
    }
    let land = land.filter(|_| parts.ground);
    if let Some((land, keys)) = land.as_ref().zip(recipe.terrain.as_ref()) {
        add_land(land, keys, recipe.seed, &mut made, &mut placements)?;
    }
    let mut camera = plants.unwrap_or_else(|| camera(recipe, &made.assets, &placements));
    if let Some(land) = &land {
        land::unbury(&mut camera, land);
    }
    let scene = Scene {
        name: recipe.name.clone(),
        title: recipe.title.clone(),
        seed: recipe.seed,
        hash: recipe.hash.clone(),
        clip: recipe.clip,
        camera,
        sun: sun(recipe),
        sky: sky(recipe),
        images: made.images,
        materials: made.materials,
        assets: made.assets,
        placements,
        land: land.map(land::field),
        tables: measures.iter().map(|m| m.0.clone()).collect(),
        fields: measures.into_iter().flat_map(|m| m.1).collect(),
        air: if breeze.is_some() { recipe.output.air.grids.clone() } else { Vec::new() },
        wet,
    };
    Ok(Built { stage: Stage { scene: Arc::new(scene), movers: made.movers, air: breeze }, report, modules, weights })
}

/// What is collected for the scene.
#[derive(Default)]
struct Made {
    images: Vec<Image>,
    materials: Vec<Material>,
    assets: Vec<Asset>,
    movers: Vec<Option<Moving>>,
    /// Plants on rods that rain falls on, by asset.
    sprung: Vec<Option<(RodPlant, Dressing)>>,
}

impl Made {
    /// Adds a look's materials and pictures and returns where they start.
    fn take(&mut self, look: Look) -> Kind {
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
        Kind { first_material, tile, organ_names, shader_wind: false }
    }
}

/// The first failure in order, or all results.
fn in_order<T>(results: Vec<Result<T>>) -> Result<Vec<T>> {
    results.into_iter().collect()
}

/// Bark, leaves and what else plants wear; nothing for those that stand nowhere.
fn look_all(recipe: &Recipe, layout: &Layout, work: &Work<'_>) -> Result<Vec<Look>> {
    let indexed: Vec<_> = recipe.plants.iter().enumerate().collect();
    in_order(par_map(&indexed, |(i, plant)| {
        work.cancel.check()?;
        let used = layout.individuals.iter().any(|n| n.plant == *i);
        let look = if used { of_plant(plant, recipe.seed, work) } else { Ok(Look::default()) };
        work.progress.advance(1);
        look
    }))
}

fn grow_all(recipe: &Recipe, layout: &Layout, looks: &[Look], work: &Work<'_>) -> Result<(Vec<Grown>, Report)> {
    let grown = par_map(&layout.individuals, |individual| {
        work.cancel.check()?;
        let (plant, look) = pair(recipe, looks, individual)?;
        let grown = grow(plant, individual, look, work);
        work.progress.advance(1);
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
    both.ok_or_else(|| Error::export("S005", "a place names a plant that is not there"))
}

/// A plant as it is shown.
struct Dressed {
    asset: Asset,
    mover: Option<Moving>,
    /// Rods that rain moves.
    sprung: Option<(RodPlant, Dressing)>,
    told: Vec<Diagnostic>,
}

impl Dressed {
    fn new(asset: Asset, told: Vec<Diagnostic>) -> Self {
        Self { asset, mover: None, sprung: None, told }
    }
}

fn dress_all(
    (recipe, air): (&Recipe, Option<&Air>),
    (layout, kinds, grown): (&Layout, &[Kind], &[Grown]),
    made: &mut Made,
    (work, report): (&Work<'_>, &mut Report),
) -> Result<()> {
    let jobs: Vec<(usize, &Individual, &Grown)> =
        layout.individuals.iter().zip(grown).enumerate().map(|(i, (n, g))| (i, n, g)).collect();
    let stands = layout.first_stands();
    let dressed = par_map(&jobs, |(i, individual, grown)| {
        let (plant, kind) = pair(recipe, kinds, individual)?;
        let stand = stands.get(*i).copied().unwrap_or(Trs::IDENTITY);
        let still = matches!(plant.keys.motion, Motion::Still | Motion::Static);
        let clock = (recipe.clip.fps(), recipe.clip.start);
        let rods = || dress_sprung(grown, plant, (kind, individual), (stand, clock), recipe.gravity(), work);
        let springs = plant.rods.is_some() && !still;
        let dressed = if springs && recipe.rain.is_some() && recipe.clip.len() > 1 {
            let sprung = rods()?;
            Dressed { sprung: Some((sprung.boughs, sprung.dressing)), ..Dressed::new(sprung.asset, sprung.told) }
        } else if let Some(air) = air.filter(|_| springs) {
            let sprung = rods()?;
            let shiver = Shiver::new((sprung.boughs, sprung.dressing), plant, air, clock.0);
            let mover = Some(Moving::Boughs(Arc::new(shiver)));
            Dressed { mover, ..Dressed::new(sprung.asset, sprung.told) }
        } else if plant.rods.is_some() {
            Dressed::new(rods()?.stilled(), Vec::new())
        } else {
            let (asset, mover) = dress(grown, plant, (kind, individual), air.map(|a| (a, stand)), work)?;
            Dressed { mover: mover.map(|m| Moving::Plant(Box::new(m))), ..Dressed::new(asset, Vec::new()) }
        };
        work.progress.advance(1);
        Ok(dressed)
    });
    for (dressed, individual) in in_order(dressed)?.into_iter().zip(&layout.individuals) {
        let group = recipe.plants.get(individual.plant).map(|p| p.id.clone()).unwrap_or_default();
        made.assets.push(Asset { group, ..dressed.asset });
        made.movers.push(dressed.mover);
        made.sprung.push(dressed.sprung);
        dressed.told.into_iter().for_each(|d| report.push(d));
    }
    Ok(())
}

fn placements(air: Option<&Air>, made: &Made, layout: &Layout) -> Vec<Placement> {
    let Made { assets, movers, .. } = made;
    let mut names = Names::default();
    let mut first: BTreeMap<usize, Vec3> = BTreeMap::new();
    let mut of = |s: &Standing| {
        let id = assets.get(s.individual).map_or("plant", |a| &a.id);
        let first = *first.entry(s.individual).or_insert(s.transform.t);
        // Rods swing on and on: their frames come one after another.
        let moves = matches!(movers.get(s.individual), Some(Some(Moving::Plant(_))));
        let phase = air.filter(|_| moves).map_or(0, |air| air.phase(first, s.transform.t));
        Placement { name: names.unique(id), asset: s.individual, transform: s.transform, phase }
    };
    layout.standings.iter().map(&mut of).collect()
}

/// Sets the plants on the ground, whose middle is theirs, and returns it with its place.
fn lay_ground(recipe: &Recipe, layout: &mut Layout) -> (Ground, Vec3) {
    let shape = ground_shape(&recipe.ground, recipe.seed);
    let feet = Bounds::of(layout.standings.iter().map(|s| s.transform.t));
    let middle = feet.center() * Vec3::new(1.0, 0.0, 1.0);
    for s in &mut layout.standings {
        let at = s.transform.t - middle;
        s.transform.t.y += shape.height(at.x, at.z);
    }
    (shape, middle)
}

/// How far the feet of the individuals reach.
fn feet(recipe: &Recipe, layout: &Layout, grown: &[Grown]) -> Vec<f32> {
    let one = |(individual, grown): (&Individual, &Grown)| {
        recipe.plants.get(individual.plant).map_or(0.0, |plant| scatter::foot(&grown.plant, &plant.skin))
    };
    layout.individuals.iter().zip(grown).map(one).collect()
}

fn add_land(
    shape: &Land,
    keys: &TerrainKeys,
    seed: u64,
    made: &mut Made,
    placements: &mut Vec<Placement>,
) -> Result<()> {
    let kind = made.take(land::look(shape, keys, seed)?);
    placements.push(Placement {
        name: land::NAME.into(),
        asset: made.assets.len(),
        transform: Trs::IDENTITY,
        phase: 0,
    });
    made.movers.push(None);
    made.assets.push(land::asset(shape, kind.first_material));
    Ok(())
}

fn add_ground((look, mut mesh): (Look, Mesh), middle: Vec3, made: &mut Made, placements: &mut Vec<Placement>) {
    let kind = made.take(look);
    for s in &mut mesh.subsets {
        s.material += kind.first_material;
    }
    let transform = Trs::translation(middle);
    placements.push(Placement { name: "ground".into(), asset: made.assets.len(), transform, phase: 0 });
    made.movers.push(None);
    made.assets.push(Asset {
        id: "ground".into(),
        kind: AssetKind::Terrain,
        group: String::new(),
        skeleton: None,
        meshes: vec![MeshObject { name: "ground".into(), mesh, motion: MeshMotion::Still, skin: None }],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    });
}

/// Adds the points of attractors where the scene wants them.
fn add_clouds(recipe: &Recipe, made: &mut Made, placements: &mut Vec<Placement>, work: &Work<'_>) -> Result<()> {
    for cloud in &recipe.clouds {
        let material = u32::try_from(made.materials.len()).unwrap_or(u32::MAX);
        let new = super::clouds::made(cloud, (recipe.seed, recipe.clip.len() > 1), material, work)?;
        let name = new.asset.id.clone();
        placements.push(Placement { name, asset: made.assets.len(), transform: new.stand, phase: 0 });
        made.materials.push(new.surface);
        made.assets.push(new.asset);
        made.movers.push(new.morphing.map(Moving::Cloud));
    }
    Ok(())
}

/// The box of air that catkins fly in: a lattice's own, or one around the origin.
fn box_of_air(recipe: &Recipe, size: [f64; 3]) -> Bounds {
    let lattice = recipe.wind.model == WindModel::Lattice;
    let [w, h, d] = if lattice { recipe.lattice.cells.map(|n| n * recipe.lattice.dx) } else { size }.map(narrow);
    let at = if lattice { Vec3::from_array(recipe.lattice.at.map(narrow)) } else { Vec3::ZERO };
    Bounds { min: at - Vec3::new(w / 2.0, 0.0, d / 2.0), max: at + Vec3::new(w / 2.0, h, d / 2.0) }
}

/// What a flight or rain measures.
type Measures = (Table, Vec<Field>);

/// Lets catkins fly, or shows their kinds side by side.
fn add_catkins(
    recipe: &Recipe,
    (obstacles, twigs): (&Obstacles<'_>, &[(Vec3, f64)]),
    (made, placements): (&mut Made, &mut Vec<Placement>),
    (work, report): (&Work<'_>, &mut Report),
) -> Result<Option<Measures>> {
    if recipe.catkin.is_none() && recipe.flight.is_none() {
        return Ok(None);
    }
    let own = CatkinKeys::defaults();
    let keys = recipe.catkin.as_ref().unwrap_or(&own);
    let models = catkin::catkin_models(keys, recipe.seed, work)?;
    let levels = catkin::Levels::of(keys);
    let kind = made.take(catkin::materials(&models, &levels));
    let (asset, mover, measures) = match &recipe.flight {
        None => (catkin::row(&models, &levels, kind.first_material), None, None),
        Some(flight) => {
            let inside = box_of_air(recipe, flight.keys.size);
            let points = f64::from(flight.keys.count) * (flight.keys.trails * recipe.clip.fps()).round();
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "far below 2^53")]
            work.limits.check("vertices", points as u64, "the number of points of flight.trails")?;
            let solids = Arc::new(obstacles.within(inside.size().max_element()));
            let early = course::before(flight, recipe) as f64 / recipe.clip.fps();
            let mut stream = Stream::new(recipe, solids.list(), early, work);
            let before = report.diagnostics.len();
            stream.run_up(work.progress, report)?;
            let (known_height, cell) = (stream.known_height(), stream.cell());
            let setting = Setting { recipe, flight, inside, solids, known_height, cell, twigs };
            let course = Course::new(&setting, stream, &models);
            if course.buried() > 0 {
                let text = format!("{} catkins found no place to start outside of solids", course.buried());
                let help = "raise flight.band, or make room between the solids";
                report.push(Diagnostic::about("S026", text).help(help));
            }
            let prototypes = models.iter().map(|m| m.prototype(&levels, kind.first_material)).collect();
            let said = report.diagnostics.iter().skip(before).map(|d| (d.code, d.message.clone())).collect();
            let (table, fields) = course.measures(&flight.keys, said);
            let measures = (table, fields.to_vec());
            (
                course.asset(prototypes, kind.first_material, recipe.clip.len() < 2)?,
                Some(Moving::Flight(Arc::new(course))),
                Some(measures),
            )
        }
    };
    let name = asset.id.clone();
    placements.push(Placement { name, asset: made.assets.len(), transform: Trs::IDENTITY, phase: 0 });
    made.assets.push(asset);
    made.movers.push(mover);
    Ok(measures)
}

/// Ends of the twigs that let catkins go, m, with the weights of their plants.
fn twigs(recipe: &Recipe, layout: &Layout, grown: &[Grown]) -> Vec<(Vec3, f64)> {
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
fn rained_on(recipe: &Recipe, land: Option<&Land>, soil: Option<(&Ground, Vec3)>) -> rain::Soil {
    match (land, soil) {
        (Some(land), _) if recipe.rain.is_some() => rain::Soil::Hills(land.clone()),
        (_, Some((shape, middle))) => rain::Soil::Waves(shape.clone(), middle),
        _ => rain::Soil::Level(recipe.ground.show),
    }
}

/// Lets it rain on the plants; `draft`: their pictures hold no pixels.
fn add_rain(
    (recipe, draft): (&Recipe, bool),
    (layout, grown): (&Layout, &[Grown]),
    (air, soil): (Option<&Air>, rain::Soil),
    (made, placements): (&mut Made, &mut Vec<Placement>),
    work: &Work<'_>,
) -> Result<(Vec<Wet>, Option<Table>)> {
    let Some(rain) = &recipe.rain else { return Ok((Vec::new(), None)) };
    let stands = layout.first_stands();
    let plants: Vec<&osier_scene::plant::Plant> = grown.iter().map(|g| &g.plant).collect();
    let under = rain::Under {
        recipe,
        assets: &mut made.assets,
        materials: &mut made.materials,
        images: if draft { &[] } else { &made.images },
        stands: &stands,
        plants: &plants,
        sprung: std::mem::take(&mut made.sprung),
        wind: air.map(|a| Arc::clone(&a.wind)),
        soil,
    };
    let fallen = rain::fall(under, rain, work)?;
    placements.push(Placement { name: "rain".into(), asset: made.assets.len(), transform: Trs::IDENTITY, phase: 0 });
    made.assets.push(fallen.asset);
    for (k, mover) in made.movers.iter_mut().enumerate() {
        if fallen.rain.moves(k) {
            *mover = Some(Moving::Rained(Arc::clone(&fallen.rain), k));
        }
    }
    let moves = recipe.clip.len() > 1;
    made.movers.push(moves.then_some(Moving::Rain(fallen.rain)));
    Ok((fallen.wet, moves.then_some(fallen.table)))
}

/// Adds rods; `draft`: without their motion.
fn add_rods(
    (recipe, draft): (&Recipe, bool),
    (made, placements): (&mut Made, &mut Vec<Placement>),
    (work, report): (&Work<'_>, &mut Report),
) -> Result<()> {
    let first = u32::try_from(made.materials.len()).unwrap_or(u32::MAX);
    for mut new in rods::made((recipe, draft), first, work, report)? {
        while made.assets.iter().any(|a| a.id == new.asset.id) {
            new.asset.id = format!("{}_rod", new.asset.id);
        }
        let name = new.asset.id.clone();
        placements.push(Placement { name, asset: made.assets.len(), transform: Trs::IDENTITY, phase: 0 });
        made.materials.extend(new.materials);
        made.assets.push(new.asset);
        made.movers.push(new.motion.map(Moving::Rod));
    }
    Ok(())
}

/// Shows what stands in the way.
fn add_solids(recipe: &Recipe, made: &mut Made, placements: &mut Vec<Placement>) -> Result<()> {
    for solid in recipe.solids.iter().filter(|s| s.keys.show) {
        let (look, build) = solids::seen(solid);
        let kind = made.take(look);
        let mut asset = build(kind.first_material)?;
        while made.assets.iter().any(|a| a.id == asset.id) {
            asset.id = format!("{}_solid", asset.id);
        }
        let name = asset.id.clone();
        placements.push(Placement { name, asset: made.assets.len(), transform: Trs::IDENTITY, phase: 0 });
        made.assets.push(asset);
        made.movers.push(None);
    }
    Ok(())
}
