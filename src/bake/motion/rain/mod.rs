//! Rain on the plants of a scene: the simulation recorded over the clip, and the assets that show it.

mod bark_maps;
mod chart_textures;
mod drop_records;
mod expected_drops;
mod ground;
mod initial_drops;
pub(crate) mod leaf_maps;
mod params;
mod plant_in_rain;
mod scene_leaf;
mod stats;
mod wet_film;
mod wet_surfaces;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::{DQuat, DVec3, Vec3};

use self::bark_maps::{BarkSetting, StruckBark, add_bark_maps};
pub use self::drop_records::enum_labels;
use self::expected_drops::ExpectedDrops;
pub use self::ground::RainGround;
pub(crate) use self::plant_in_rain::PlantInRain;
use self::plant_in_rain::{PlantStepParams, PointCarrier, RainedPlant, RainedPlantRecorder, target_and_recorder};
use self::scene_leaf::{SceneLeaf, WETNESS, scene_leaves, select_mapped_leaves, set_leaf_wetness};
use crate::bake::BakeContext;
use crate::bake::assets::obstacles::rain_faces;
use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::motion::rod_plant::BoundPoints;
use crate::bake::motion::{AssetMotion, CarriedPoints, FrameTime, PointOnAxis, TableRow};
use crate::bake::scene::builder::{RAIN_ID, SceneBuilder};
use crate::bake::scene::camera_light::ScreenScale;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::scene::{RainRecipe, SwayStart};
use crate::recipe::{KeyPlaces, Recipe};
use osier_base::Result;
use osier_base::convert::{index, limit, saturating_index, to_usize};
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par::{par_map, par_map_mut};
use osier_motion::rain::{
    BarkPatch, DropDetail, DropMesh, DropParams, LeafOnPlant, LeafPose, LeafWaterMaps, PendantFamily, RainConfig,
    RainEmitter, RainExposure, RainFrame, RainLeaf, RainPlant, RainSimulation, RainSolids, StillRainPlant, UvRaster,
    WoodSegment, sphere_diameter,
};
use osier_motion::rods::PLANT_SPIN_UP_SECONDS;
use osier_scene::plant::{AxisKind, Plant};
use osier_scene::{
    Asset, AssetFrame, AssetKind, Attribute, AttributeData, Image, MapFrame, MapSequence, Material, MaterialClass,
    MeshFrame, MeshMotion, MeshObject, Points, PointsFrame, RecordTable, Table, Trs, attribute_number,
};
use osier_wind::{ShiftedWind, Wind};

/// Least number of time steps per frame and per second if rods do not require more. Own: a drop of 2 mm then falls about 3 cm per
/// step; with a step of 1/32 s only a tenth as many drops hang from margins as with this step or a shorter one.
const DEFAULT_SUBSTEPS: u32 = 8;
const DEFAULT_STEPS_PER_SECOND: f64 = 192.0;
/// Bytes of recorded drops that count as one key of the limit `motion-keys`.
const BYTES_PER_KEY: u64 = 64;
/// Gravity, m/s^2, below which a message about too many drops mentions it. Own: that of the Moon, under which drops fall 2.5
/// times as slowly as on Earth, is 1.62.
const SLOW_GRAVITY: f64 = 1.6;
/// Name of the quantity counted against the limit `motion-keys`, for its message.
const LIMITED_QUANTITY: &str = "the number of leaves and raindrops times frames";
/// Index of refraction of the material of drops.
const WATER_IOR: f32 = osier_base::physics::WATER_IOR;

/// A leaf with individual water maps, and the raster over which they are drawn.
#[derive(Debug)]
struct MappedLeaf {
    leaf: usize,
    raster: Arc<UvRaster>,
}

/// Recorded rain: the drops of every frame, and the frames of the plants that the drops move.
#[derive(Debug)]
pub struct RainPlayback {
    frames: Vec<RainFrame>,
    /// Dry leaves: their blades and sizes, with which the maps and meshes of each frame begin.
    leaves: Vec<RainLeaf>,
    mapped_leaves: Vec<MappedLeaf>,
    /// Patches of bark that drops wet, whose maps follow those of leaves; set once the materials of the scene are complete.
    barks: OnceLock<Vec<StruckBark>>,
    /// Frames of each plant; empty for a plant that does not move.
    plants: Vec<Vec<AssetFrame>>,
    params: DropParams,
    /// Consecutive numbers of the drops by their ids, as in the tables.
    numbers: BTreeMap<u64, u32>,
    /// Slots of the airborne drops in the point cloud, by frame, parallel to the drops.
    slots: Vec<Vec<u32>>,
    /// Number of points of the cloud; a slot without a drop has width 0.
    capacity: usize,
    /// Shapes of pendant drops, by the bits of the radius that they hang from.
    shapes: BTreeMap<u64, PendantFamily>,
    material: u32,
    shown: MeshedDropSelection,
    maps: Mutex<AdvancingLeafMaps>,
    /// Whether maps have a layer of water thickness.
    water_maps: bool,
}

/// Selection of the drops on leaves that a frame shows as meshes.
#[derive(Debug, Clone, Copy)]
struct MeshedDropSelection {
    /// Largest number of meshed drops of a frame.
    max_drops: usize,
    /// Scale of the camera's picture: the drops that appear largest are selected, and the detail of their meshes follows their
    /// size in the picture.
    picture: ScreenScale,
}

/// The drops on leaves that a frame shows as meshes.
enum ShownDrops {
    All,
    Ids(BTreeSet<u64>),
}

impl ShownDrops {
    fn includes(&self, id: u64) -> bool {
        match self {
            Self::All => true,
            Self::Ids(ids) => ids.contains(&id),
        }
    }
}

#[derive(Debug)]
struct AdvancingLeafMaps {
    /// Number of frames by which the maps have advanced.
    frames: u64,
    /// Parallel to the mapped leaves.
    leaves: Vec<LeafWaterMaps>,
    /// Parallel to the patches of bark.
    barks: Vec<BarkPatch>,
}

impl AdvancingLeafMaps {
    /// Before the first frame.
    const NONE: Self = Self { frames: 0, leaves: Vec::new(), barks: Vec::new() };
}

/// Results of the rain's simulation, before they are added to the scene.
struct SimulatedRain {
    /// Drops on leaves as a mesh, airborne ones as points.
    asset: Asset,
    playback: Arc<RainPlayback>,
    map_sequences: Vec<MapSequence>,
    /// Textures of leaves that were resampled to charts, to be appended to those of the scene.
    images: Vec<Image>,
    table: Table,
    wet_surfaces: WetSurfaces,
    /// Expected contents of a frame, averaged over the whole clip; only in an estimate of falling rain.
    expected: Option<ExpectedDrops>,
    /// Numbers of leaves that drops can strike, by plant asset.
    leaf_counts: Vec<u64>,
}

/// Surfaces that earlier rain has left a film of water on, and bark that drops of the clip wet.
struct WetSurfaces {
    /// Fraction of a wet face that the film covers, 0 to 1; 0 without a film.
    cover: f32,
    exposure: RainExposure,
    /// Bounds of the solids, m; empty without any.
    solids: Bounds,
    /// Whether drops fall, which strike bark.
    falls: bool,
}

/// Additions of rain to a scene besides assets; empty without rain.
#[derive(Default)]
pub(crate) struct AddedRain {
    /// Declarations of water maps, one per leaf with maps; wet materials refer to them by index.
    pub(crate) map_sequences: Vec<MapSequence>,
    /// Statistics, one row per frame; `None` in a still scene.
    pub(crate) table: Option<Table>,
    /// Numbers of leaves that drops can strike, by plant asset.
    pub(crate) leaf_counts: Vec<u64>,
    /// What the rain wets besides leaves, and the record of the drops that do it.
    wet: Option<(WetSurfaces, Arc<RainPlayback>)>,
}

impl AddedRain {
    /// Gives bark, solids and ground of a complete scene a wet material where rain reaches them, if `rain.wet.film` is above 0, and bark
    /// a map of the spots that the drops of the clip wet. `plants`: number of plants, the first assets.
    /// # Errors
    /// `Limit` for a mesh that would get too many vertices, `Cancelled`, `TooMany` beyond 2^32 materials, images or map sequences.
    pub(crate) fn add_wet_surfaces(
        &mut self,
        recipe: &Recipe,
        plants: usize,
        builder: &mut SceneBuilder,
        context: &BakeContext<'_>,
    ) -> Result<()> {
        let Some((WetSurfaces { cover, exposure, solids, falls }, playback)) = &self.wet else { return Ok(()) };
        let has_film = *cover > 0.0;
        let film = if has_film {
            wet_surfaces::wet_exposed_surfaces(*cover, exposure, *solids, builder, context)?
        } else {
            BTreeSet::new()
        };
        if !falls {
            return Ok(());
        }
        let setting = BarkSetting {
            exposure,
            film: has_film.then_some(&film),
            film_albedo: wet_film::film_albedo(*cover),
            params: &playback.params,
            plants,
            height_range: narrow(recipe.maps.height_range),
        };
        let (barks, mut sequences) = add_bark_maps(&setting, self.map_sequences.len(), builder)?;
        playback.set_barks(barks);
        // A still scene has the maps of its one frame, after those of leaves.
        if playback.frames.len() == 1 {
            let maps = playback.map_frames(0).into_iter().skip(self.map_sequences.len());
            sequences.iter_mut().zip(maps).for_each(|(sequence, maps)| sequence.rest = Some(maps));
        }
        self.map_sequences.extend(sequences);
        Ok(())
    }
}

/// Parts of a scene on which rain falls.
struct RainInputs<'a> {
    /// In an estimate, the whole recipe, of which `recipe` has only the first frame; otherwise `None`.
    full: Option<&'a Recipe>,
    recipe: &'a Recipe,
    /// Assets of the grown plants; leaves with maps are taken out of their instancers.
    assets: &'a mut Vec<Asset>,
    materials: &'a mut Vec<Material>,
    /// Images of the materials' maps; empty in an estimate.
    images: &'a [Image],
    /// World transform of each plant's first copy, parallel to `assets`.
    transforms: &'a [Trs],
    /// The grown plants, parallel to `assets`.
    plants: &'a [&'a Plant],
    /// Motion of each plant, to which that by drops is added, parallel to `assets`.
    plant_motions: Vec<PlantInRain>,
    wind: Option<Arc<dyn Wind>>,
    ground: RainGround,
    solids: RainSolids,
}

/// Simulates the rain of a recipe on its plants and adds it to the scene: an asset of drops, motions of the plants that drops
/// move, meshes of leaves with maps. `full`: in an estimate the recipe to estimate, of which `recipe` is the first frame; images
/// then contain no pixels, so that leaves have no alpha.
/// # Errors
/// `Simulation`, `Limit`, `Cancelled`.
pub(crate) fn add_rain(
    recipe: &Recipe,
    full: Option<&Recipe>,
    layout: &PlantLayout,
    grown: &[GrownPlant],
    wind: Option<Arc<dyn Wind>>,
    ground: RainGround,
    plant_motions: Vec<PlantInRain>,
    builder: &mut SceneBuilder,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<AddedRain> {
    let Some(rain) = &recipe.rain else { return Ok(AddedRain::default()) };
    // This must precede the leaves with maps, which copy their materials.
    if rain.wet.film > 0.0 {
        wet_film::apply_film_to_leaf_materials(narrow(rain.wet.film), &mut builder.materials, &mut builder.images);
    }
    let transforms = layout.first_transforms();
    let plants: Vec<&Plant> = grown.iter().map(|g| &g.plant).collect();
    // Points are carried only for the catkins of a flight.
    let carrier = |motion: &PlantInRain| recipe.flight.as_ref().map_or(PointCarrier::Still, |_| motion.point_carrier());
    let carriers: Vec<PointCarrier> = plant_motions.iter().map(carrier).collect();
    let scene = RainInputs {
        recipe,
        assets: &mut builder.assets,
        materials: &mut builder.materials,
        images: if full.is_some() { &[] } else { &builder.images },
        full,
        transforms: &transforms,
        plants: &plants,
        plant_motions,
        wind,
        ground,
        solids: RainSolids::new(&rain_faces(recipe))?,
    };
    let simulated = simulate_rain(scene, rain, context, report)?;
    let mut drops = simulated.asset;
    if full.is_some() {
        // An estimate simulates only one frame; add the drops that the whole clip is expected to contain.
        simulated.expected.into_iter().for_each(|expected| expected.fill(&mut drops));
    } else {
        builder.images.extend(simulated.images);
    }
    // Plants that rain moves take their motion from its record.
    for ((plant, motion), carrier) in builder.motions.iter_mut().enumerate().zip(carriers) {
        if simulated.playback.plant_moves(plant) {
            *motion = Some(Arc::new(PlantMotionInRain { rain: Arc::clone(&simulated.playback), plant, carrier }));
        }
    }
    let moves = recipe.clip.len() > 1;
    let motion = moves.then(|| Arc::clone(&simulated.playback) as Arc<dyn AssetMotion>);
    builder.add_placed(drops, Trs::IDENTITY, motion);
    Ok(AddedRain {
        map_sequences: simulated.map_sequences,
        table: moves.then_some(simulated.table),
        leaf_counts: simulated.leaf_counts,
        wet: Some((simulated.wet_surfaces, simulated.playback)),
    })
}

/// Simulates the rain over spin-up and clip and records every frame, for plants moved by rods or wind and for still ones.
fn simulate_rain(
    scene: RainInputs<'_>,
    rain: &RainRecipe,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<SimulatedRain> {
    let RainInputs { recipe, full, assets, materials, images, transforms, plants, plant_motions, wind, ground, solids } =
        scene;

    // The targets: leaf blades on plants that rods or the wind move, or on static plants.
    let scene_leaves = scene_leaves(assets, materials, images, transforms, &plant_motions, report);
    let mut leaf_counts = vec![0_u64; assets.len()];
    scene_leaves.iter().for_each(|leaf| leaf_counts[leaf.instance.asset] += 1);
    let picture = ScreenScale::new(recipe, rest_bounds(assets, transforms).fold(Bounds::default(), Bounds::union));
    let mapped_leaves = select_mapped_leaves(recipe, &scene_leaves, &picture);
    let steps = steps_per_frame(rain, recipe, &plant_motions, wind.as_deref());
    // The simulation's clock starts with the spin-up, that of the wind with the clip.
    let step = 1.0 / (recipe.clip.fps() * f64::from(steps));
    let lead = spin_up_steps(rain, step) as f64 * step;
    let wind = wind.map(|wind| Arc::new(ShiftedWind { wind, lead }) as Arc<dyn Wind>);
    let starts_from_rest = recipe.sway.start == SwayStart::Rest;
    // If plants start at rest, the spin-up of rods only measures the bounds that they sweep. Limit it to the number of simulated
    // steps, so that it reads no wind beyond the time of the rain.
    let simulated_steps = spin_up_steps(rain, step) + u64::from(steps) * (recipe.clip.len() as u64).saturating_sub(1);
    let trial_steps = if starts_from_rest { saturating_index(limit(simulated_steps)) } else { u32::MAX };
    let clock = PlantStepParams {
        fps: recipe.clip.fps(),
        lead,
        step,
        rod_spin_up_steps: if full.is_some() { 0 } else { rod_spin_up_steps(step).min(trial_steps) },
        rods_start_at_rest: starts_from_rest,
        gravity: rain.keys.gravity,
    };
    // For each plant a target, which drops hit and load, and a recorder, which converts its state to frames of the asset.
    let (mut targets, mut recorders) = (Vec::new(), Vec::new());
    for (k, motion) in plant_motions.into_iter().enumerate() {
        let on_plant = scene_leaves.iter().filter(|leaf| leaf.instance.asset == k).collect();
        let of = RainedPlant { plant: plants[k], asset: &assets[k], transform: transforms[k], leaves: on_plant };
        let (target, recorder) = target_and_recorder(motion, &of, clock, wind.clone(), || still_plant(&of))?;
        targets.push(target);
        recorders.push(recorder);
    }

    // Rain falls from an emitter above the plants' bounds, displaced by the wind.
    let bounds = plant_bounds(assets, transforms, &recorders);
    let params = params::drop_params(rain, recipe.general.seed);
    let clip = recipe.clip;
    let frames = clip.len() as u64;
    // An estimate simulates the first interval of the whole clip's rain, since the total number of drops refers to the whole
    // clip.
    let whole = full.unwrap_or(recipe);
    let rainfall = params::rainfall_params(rain, whole);
    let height = f64::from(bounds.size().y);
    let lowest = f64::from(bounds.min.y);
    // In scenes without a ground, drops end below the lowest point of plants and solids.
    let ground = ground.into_height(solids.height_range().map_or(lowest, |[low, _]| low.min(lowest)));
    let wet_surfaces = WetSurfaces {
        cover: narrow(rain.wet.film),
        exposure: RainExposure::new(&rainfall, wind.clone(), solids.clone(), Arc::clone(&ground)),
        solids: solids.bounds(),
        falls: rain.keys.falls,
    };
    let emitter = rain.keys.falls.then(|| RainEmitter::new(rainfall, bounds, wind.clone()));
    let center = bounds.center();
    let foot = ground.height(f64::from(center.x), f64::from(center.z));
    let (rate, area) = (emitter.as_ref().map(RainEmitter::rate), emitter.as_ref().map(RainEmitter::mean_area));
    RainCost {
        drop_rate: emitter.as_ref().map_or(0.0, RainEmitter::mean_drop_rate),
        fall_time: emitter.as_ref().map_or(0.0, |emitter| emitter.mean_fall_time(foot)),
        duration: whole.clip.len() as f64 / whole.clip.fps() + whole.rain.as_ref().map_or(0.0, |r| r.keys.spin_up),
        step,
        frames: whole.clip.len() as u64,
        leaves: scene_leaves.len(),
    }
    .check(rain, &recipe.places_of_keys, context)?;
    let expected = full.zip(emitter.as_ref()).map(|(f, e)| ExpectedDrops::new(e, height, &scene_leaves, f, &picture));
    let leaves = scene_leaves.iter().enumerate().map(|(i, f)| {
        let leaf = RainLeaf::new(Arc::clone(&f.surface), f.scale, i as u64);
        (leaf, LeafOnPlant { plant: f.instance.asset, leaf: f.number, collider: Arc::clone(&f.collider) })
    });
    let config =
        RainConfig { params: params.clone(), emitter, plants: targets, leaves: leaves.collect(), wind, ground, solids };
    let mut simulation = RainSimulation::new(config);
    // The simulation changes its leaves; maps and meshes of each frame begin with dry copies.
    let dry_leaves = simulation.leaves().to_vec();
    initial_drops::check_initial_drops(&rain.lying, &dry_leaves, &recipe.places_of_keys)?;
    let RecordedRain { frames: rain_frames, mut plants } =
        record_frames(&mut simulation, rain, recipe, steps, assets, &recorders, &scene_leaves, context)?;

    // Water's material, then the materials of the leaves with maps.
    let material = index(materials.len(), "materials of a scene")?;
    materials.push(Material {
        ior: WATER_IOR,
        roughness: 0.0,
        ..Material::plain("water".into(), MaterialClass::Water, [0.98, 0.99, 1.0], 0.0)
    });
    let rasters = leaf_maps::build_uv_rasters(&scene_leaves, &mapped_leaves, assets, materials, images);
    let leaf_maps::AddedLeafMaps { sequences: mut map_sequences, images: new_images, separated } =
        leaf_maps::add_leaf_maps(assets, materials, images, &scene_leaves, &mapped_leaves, recipe)?;
    // The recorded frames still contain these leaves as instances.
    for (frames, leaves) in plants.iter_mut().zip(&separated) {
        frames.iter_mut().for_each(|frame| leaf_maps::separate_frame_instances(frame, leaves));
    }
    let mapped_leaves: Vec<MappedLeaf> =
        mapped_leaves.iter().zip(rasters).map(|(mapped, raster)| MappedLeaf { leaf: mapped.leaf, raster }).collect();
    let (slots, capacity) = drop_records::assign_point_slots(&rain_frames);
    let max_drops = to_usize(rain.keys.max_drop_meshes);
    let most = rain_frames.iter().map(|frame| frame.sessile.len() + frame.pendant.len()).max().unwrap_or(0);
    report_hidden_drops(most, max_drops, &recipe.places_of_keys, report);
    let playback = RainPlayback {
        shown: MeshedDropSelection { max_drops, picture },
        shapes: pendant_families_by_radius(&rain_frames, params.g),
        numbers: drop_records::number_drops(&rain_frames)?,
        maps: Mutex::new(AdvancingLeafMaps::NONE),
        barks: OnceLock::new(),
        water_maps: recipe.maps.water,
        leaves: dry_leaves,
        plants,
        frames: rain_frames,
        mapped_leaves,
        params,
        slots,
        capacity,
        material,
    };
    let moves = frames > 1;
    let asset = playback.asset(moves, bounds);
    // A still scene has the maps of its one frame.
    if !moves {
        for (sequence, maps) in map_sequences.iter_mut().zip(playback.map_frames(0)) {
            sequence.rest = Some(maps);
        }
    }
    let table = stats::rain_table(&playback.params, rate, area);
    Ok(SimulatedRain {
        asset,
        playback: Arc::new(playback),
        map_sequences,
        images: new_images,
        table,
        wet_surfaces,
        expected,
        leaf_counts,
    })
}

/// The collision targets of a plant that does not move: its leaves, and its stems as tapered capsules between nodes.
fn still_plant(of: &RainedPlant<'_>) -> Box<dyn RainPlant> {
    let RainedPlant { plant, transform, .. } = of;
    let leaves: Vec<(DVec3, DQuat)> = of.leaves.iter().map(|f| (f.position, f.rotation)).collect();
    let mut segments = Vec::new();
    for axis in plant.axes.iter().filter(|a| a.kind != AxisKind::Root) {
        let range = plant.nodes_of(axis);
        for i in range.start..range.end.saturating_sub(1) {
            // Stems consist of straight segments between two nodes; roots are left out, because rain does not reach them.
            let end = |i: usize| transform.apply(plant.nodes.p[i]).as_dvec3();
            let radius = |i: usize| f64::from(plant.nodes.r[i] * transform.s.x);
            segments.push(WoodSegment { ends: [end(i), end(i + 1)], radii: [radius(i), radius(i + 1)] });
        }
    }
    Box::new(StillRainPlant::new(&leaves, segments))
}

/// World bounds of each plant at rest, m.
fn rest_bounds<'a>(assets: &'a [Asset], transforms: &'a [Trs]) -> impl Iterator<Item = Bounds> + 'a {
    let rest = AssetFrame::default();
    assets.iter().zip(transforms).map(move |(asset, trs)| {
        let corners = osier_scene::asset_bounds(asset, &rest).corners();
        Bounds::of(corners.map(|c| trs.apply(c)))
    })
}

/// World bounds of the plants, m; for plants that the wind moves, over their motion.
fn plant_bounds(assets: &[Asset], transforms: &[Trs], recorders: &[RainedPlantRecorder]) -> Bounds {
    let bounds = rest_bounds(assets, transforms).zip(recorders).map(|(rest, recorder)| recorder.bounds_in_wind(rest));
    bounds.fold(Bounds::default(), Bounds::union)
}

/// Cost of the rain of a bake, predicted before the simulation. Drops on leaves are counted while they are recorded
/// ([`record_frames`]).
#[derive(Debug, Clone, Copy)]
struct RainCost {
    /// Mean number of drops that are emitted per second.
    drop_rate: f64,
    /// Mean time from the emitter to the ground, s; drops that leaves intercept take less.
    fall_time: f64,
    /// Duration of spin-up and clip, s.
    duration: f64,
    /// Time step, s.
    step: f64,
    /// Number of frames of the clip.
    frames: u64,
    /// Number of leaves that drops can strike.
    leaves: usize,
}

impl RainCost {
    /// Time for which drops fall within the simulation, s.
    fn time_in_air(&self) -> f64 {
        self.fall_time.min(self.duration)
    }

    /// Recorded leaf poses and airborne drops of all frames, in units of [`BYTES_PER_KEY`].
    fn recorded_keys(&self) -> f64 {
        // Drops in the air at once: emission rate times the fall time; 96 bytes each.
        let falling = self.drop_rate * self.time_in_air() * 96.0;
        (falling + (self.leaves * size_of::<LeafPose>()) as f64) * self.frames as f64 / BYTES_PER_KEY as f64
    }

    /// Number of drops in the air, summed over all time steps. It rises linearly until the first drops land, then stays constant.
    fn drop_steps(&self) -> f64 {
        let rise = self.time_in_air();
        self.drop_rate * rise * (self.duration - 0.5 * rise) / self.step
    }

    /// Compares the record with the limit `motion-keys` and the work with `drop-steps`.
    /// # Errors
    /// S004 at the key that sets the amount of rain; `Limit` if the scene has no such key.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "compared, saturating")]
    fn check(&self, rain: &RainRecipe, places: &KeyPlaces, context: &BakeContext<'_>) -> Result<()> {
        let amount = amount_key(rain);
        // Under little gravity drops fall slowly, and the wind carries them from far away.
        let slow = if rain.keys.gravity < SLOW_GRAVITY { ", or raise rain.gravity" } else { "" };
        let record = format!("lower {amount} or the number of frames{slow}");
        let keys = self.recorded_keys() as u64;
        let recorded = context.limits.check_with_help("motion-keys", keys, LIMITED_QUANTITY, &record);
        recorded.map_err(|e| places.limit_at(amount, e))?;
        let work = format!("lower {amount}, wind.speed or rain.spin_up_s{slow}");
        let what = "the number of raindrops in the air times time steps";
        let steps = context.limits.check_with_help("drop-steps", self.drop_steps() as u64, what, &work);
        steps.map_err(|e| places.limit_at(amount, e))
    }
}

/// The key that sets how much rain falls.
fn amount_key(rain: &RainRecipe) -> &'static str {
    if rain.keys.total.is_some() { "rain.total" } else { "rain.rate_mm_per_h" }
}

/// Time steps per frame if rods do not require more.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, saturates")]
fn default_substeps(fps: f64) -> u32 {
    // Rounded, so that 23.976 frames per second have as many as 24.
    ((DEFAULT_STEPS_PER_SECOND / fps).round() as u32).max(DEFAULT_SUBSTEPS)
}

/// Time steps per frame: those of the key `substeps`, otherwise as many as the stiffest rods require in the wind, at least
/// [`default_substeps`].
fn steps_per_frame(rain: &RainRecipe, recipe: &Recipe, plant_motions: &[PlantInRain], wind: Option<&dyn Wind>) -> u32 {
    let fps = recipe.clip.fps();
    let needed = plant_motions
        .iter()
        .filter_map(PlantInRain::rods)
        .fold(default_substeps(fps), |m, (rods, _)| m.max(rods.steps_per_frame(fps, wind)));
    rain.keys.substeps.unwrap_or(needed)
}

/// Number of time steps of `h` s in the spin-up.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most ten minutes of steps")]
fn spin_up_steps(rain: &RainRecipe, h: f64) -> u64 {
    (rain.keys.spin_up / h).round() as u64
}

/// Number of time steps of `h` s in which plants on rods spin up before it rains.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds of steps")]
fn rod_spin_up_steps(h: f64) -> u32 {
    (PLANT_SPIN_UP_SECONDS / h).round() as u32
}

/// Record of the simulation, frame by frame.
struct RecordedRain {
    frames: Vec<RainFrame>,
    /// Frames of each plant's asset; empty for a plant that does not move.
    plants: Vec<Vec<AssetFrame>>,
}

/// Steps the simulation through spin-up and clip and captures every frame.
fn record_frames(
    simulation: &mut RainSimulation,
    rain: &RainRecipe,
    recipe: &Recipe,
    steps: u32,
    assets: &[Asset],
    recorders: &[RainedPlantRecorder],
    scene_leaves: &[SceneLeaf],
    context: &BakeContext<'_>,
) -> Result<RecordedRain> {
    let fps = recipe.clip.fps();
    let h = 1.0 / (fps * f64::from(steps));
    let frames = recipe.clip.len() as u64;
    let spin_up_steps = spin_up_steps(rain, h);
    context.progress.stage("raining", frames + spin_up_steps / u64::from(steps));
    // Spin-up: the clip's first frame shows the drops and wet traces of this time, but events before it are discarded.
    for k in 0..spin_up_steps {
        simulation.step(h)?;
        if k % u64::from(steps) == 0 {
            context.cancel.check()?;
            context.progress.advance(1);
            simulation.take_events();
        }
    }
    // Also discard the events of the steps after the last whole frame; but the deposition of the initial drops belongs to the
    // clip.
    simulation.take_events();
    initial_drops::deposit_initial_drops(simulation, &rain.lying);

    // Clip: capture, then step to the next frame.
    let mut rain_frames = Vec::new();
    // Check the memory while it grows, because only the simulation shows how many drops stay on leaves.
    let mut recorded_bytes = 0;
    let mut plants: Vec<Vec<AssetFrame>> = vec![Vec::new(); recorders.len()];
    for (number, frame) in (recipe.clip.start..).zip(0..frames) {
        context.cancel.check()?;
        simulation.check_water_budget(number)?;
        simulation.check_impact_momentum(number)?;
        let rain_frame = RainFrame::capture(simulation);
        recorded_bytes += rain_frame.memory_bytes();
        let (keys, amount) = (recorded_bytes / BYTES_PER_KEY, amount_key(rain));
        let help = format!("lower {amount} or the number of frames");
        let recorded = context.limits.check_with_help("motion-keys", keys, LIMITED_QUANTITY, &help);
        recorded.map_err(|e| recipe.places_of_keys.limit_at(amount, e))?;
        let time = FrameTime { seconds: frame as f64 / fps, step: fps.recip() };
        for (k, (target, recorder)) in simulation.plants().iter().zip(recorders).enumerate() {
            plants[k].extend(recorder.frame(&assets[k], &**target, time));
        }
        set_leaf_wetness(&mut plants, scene_leaves, &rain_frame.wetness);
        rain_frames.push(rain_frame);
        context.progress.advance(1);
        // No step follows the last frame.
        if frame + 1 < frames {
            (0..steps).try_for_each(|_| simulation.step(h))?;
        }
    }
    Ok(RecordedRain { frames: rain_frames, plants })
}

/// Warning X024 if `most` drops, the largest number on leaves at a frame, are more than a frame shows as meshes. A scene that
/// sets that number itself gets a note instead.
fn report_hidden_drops(most: usize, max_drops: usize, places: &KeyPlaces, report: &mut Report) {
    const KEY: &str = "rain.max_drop_meshes";
    if most <= max_drops {
        return;
    }
    let text = format!("up to {most} drops are on leaves at a frame, of which {max_drops} are shown as meshes");
    if places.sets(KEY) {
        report.output += &format!("note: {text}; {KEY} = {most} shows all\n");
        return;
    }
    let help = format!(
        "the others wet their leaves; {KEY} = {most} shows all, and a scene with {KEY} = {max_drops} gets no warning"
    );
    report.extend(places.report_at("rain", Diagnostic::about("X024", text).help(help), "rain of so many drops"));
}

/// Shapes of pendant drops for every radius that occurs in the clip, by the bits of the radius; `g` in m/s^2.
fn pendant_families_by_radius(frames: &[RainFrame], g: f64) -> BTreeMap<u64, PendantFamily> {
    // Drops at one margin have few distinct radii, so that a family of shapes is solved once for each radius.
    let radii: BTreeSet<u64> = frames.iter().flat_map(|f| &f.pendant).map(|h| h.radius.to_bits()).collect();
    let radii: Vec<u64> = radii.into_iter().collect();
    let shapes = par_map(&radii, |bits| PendantFamily::new(f64::from_bits(*bits), g));
    radii.into_iter().zip(shapes).collect()
}

impl RainPlayback {
    /// The `nth` recorded frame; the last one if `nth` is beyond the clip.
    fn frame_at(&self, nth: u64) -> &RainFrame {
        let last = self.frames.len().saturating_sub(1);
        &self.frames[limit(nth).min(last)]
    }

    /// Selects the drops on leaves that a frame shows as meshes.
    fn leaf_drops_shown_as_meshes(&self, frame: &RainFrame) -> ShownDrops {
        let count = frame.sessile.len() + frame.pendant.len();
        if count <= self.shown.max_drops {
            return ShownDrops::All;
        }
        // Rank drops by their size in the picture; of equal ones the lower id comes first.
        let rank = |leaf: usize, volume: f64| {
            -sphere_diameter(volume) * self.shown.picture.pixels_per_metre(frame.leaf_poses[leaf].position)
        };
        let sessile = frame.sessile.iter().map(|d| (rank(d.leaf, d.volume), d.id));
        let mut ranked: Vec<(f64, u64)> =
            sessile.chain(frame.pendant.iter().map(|d| (rank(d.leaf, d.volume), d.id))).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ShownDrops::Ids(ranked.into_iter().take(self.shown.max_drops).map(|(_, id)| id).collect())
    }

    /// Mesh of the selected sessile and pendant drops at the `nth` frame of the clip, world space.
    fn drops_mesh(&self, nth: u64) -> DropMesh {
        let frame = self.frame_at(nth);
        let shown = self.leaf_drops_shown_as_meshes(frame);
        let mut water = DropMesh::default();
        // Attribute `drop_id` of each vertex: after a drop is appended, its number fills the list up to the last vertex.
        let mut ids: Vec<i32> = Vec::new();
        let number = |id: &u64| self.numbers.get(id).map_or(-1, |n| attribute_number(*n));
        let detail = |leaf: usize, radius: f64| {
            DropDetail::at_distance(radius, self.shown.picture.distance(frame.leaf_poses[leaf].position))
        };
        for drop in frame.sessile.iter().filter(|drop| shown.includes(drop.id)) {
            water.detail = detail(drop.leaf, drop.caps.first().map_or(0.0, |head| head.cap.widest_radius()));
            water.add_sessile(&self.leaves[drop.leaf], &frame.leaf_poses[drop.leaf], drop);
            ids.resize(water.mesh.points.len(), number(&drop.id));
        }
        for drop in frame.pendant.iter().filter(|drop| shown.includes(drop.id)) {
            if let Some(shapes) = self.shapes.get(&drop.radius.to_bits()) {
                water.detail = detail(drop.leaf, drop.radius);
                water.add_pendant(&frame.leaf_poses[drop.leaf], drop, shapes);
                ids.resize(water.mesh.points.len(), number(&drop.id));
            }
        }
        // Full wetness, so that materials that read the attribute treat drops and wet leaves alike.
        let wetness = vec![1.0; ids.len()];
        water.mesh.attributes = vec![
            Attribute::vertex("drop_id", AttributeData::I32(ids)),
            Attribute::vertex(WETNESS, AttributeData::Unit1(wetness)),
        ];
        water.mesh = water.mesh.with_material(self.material);
        water
    }

    /// World positions, diameters and velocities of the point cloud of airborne drops; a slot without a drop has diameter 0.
    fn airborne_points(&self, nth: u64) -> (Vec<Vec3>, Vec<f32>, Vec<Vec3>) {
        let frame = self.frame_at(nth);
        // Points keep their index over frames, so that renderers can blur the motion of each.
        let slots = self.slots.get(limit(nth)).map_or(&[][..], Vec::as_slice);
        let n = self.capacity;
        let (mut p, mut w, mut v) = (vec![Vec3::ZERO; n], vec![0.0; n], vec![Vec3::ZERO; n]);
        for (drop, slot) in frame.airborne.iter().zip(slots) {
            let k = to_usize(*slot);
            (p[k], w[k], v[k]) = (drop.p.as_vec3(), narrow(sphere_diameter(drop.volume)), drop.v.as_vec3());
        }
        (p, w, v)
    }

    /// The asset of drops at the first frame, in world space. `plants`: bounds of the plants, which limit the points' extent
    /// for cameras.
    fn asset(&self, moves: bool, plants: Bounds) -> Asset {
        let mut water = self.drops_mesh(0);
        // Attributes of drops belong to frames; the mesh at rest has none.
        water.mesh.attributes.clear();
        let (positions, widths, _) = self.airborne_points(0);
        let motion = if moves { MeshMotion::Varying } else { MeshMotion::Still };
        let empty = water.mesh.points.is_empty() && !moves;
        let drops = MeshObject { name: "drops".into(), mesh: water.mesh, motion, skin: None };
        let falling = Points {
            name: "falling".into(),
            material: self.material,
            positions,
            widths,
            colors: Vec::new(),
            attributes: Vec::new(),
            moving: moves,
            reach: plants.expanded(0.6),
        };
        Asset {
            id: RAIN_ID.into(),
            kind: AssetKind::Tracks,
            group: String::new(),
            skeleton: None,
            meshes: if empty { Vec::new() } else { vec![drops] },
            instancers: Vec::new(),
            points: if self.capacity > 0 { vec![falling] } else { Vec::new() },
            curves: Vec::new(),
            rigged: None,
        }
    }

    /// Mesh and points of the drops at the `nth` frame of the clip.
    fn drops_frame(&self, nth: u64) -> AssetFrame {
        let DropMesh { mesh, velocities, .. } = self.drops_mesh(nth);
        let (positions, widths, point_velocities) = self.airborne_points(nth);
        let points = PointsFrame::State { positions, widths, velocities: point_velocities, colors: Vec::new() };
        AssetFrame {
            meshes: vec![MeshFrame::Whole { mesh, velocities }],
            points: if self.capacity > 0 { vec![points] } else { Vec::new() },
            ..AssetFrame::default()
        }
    }

    /// Whether the rain has recorded frames of plant `k`; false for a plant that drops do not move and for an index without a
    /// plant.
    pub fn plant_moves(&self, k: usize) -> bool {
        self.plants.get(k).is_some_and(|frames| !frames.is_empty())
    }

    /// Recorded state of plant `k` at the `nth` frame of the clip; the last one beyond the clip.
    pub fn plant_frame(&self, k: usize, nth: u64) -> AssetFrame {
        let frames = self.plants.get(k).map_or(&[][..], Vec::as_slice);
        let nth = limit(nth).min(frames.len().saturating_sub(1));
        frames.get(nth).cloned().unwrap_or_default()
    }

    /// Sets the patches of bark that drops wet; maps start again from dry ones.
    fn set_barks(&self, barks: Vec<StruckBark>) {
        // Set once for each scene; a second call would change nothing.
        _ = self.barks.set(barks);
        *self.maps.lock().unwrap_or_else(PoisonError::into_inner) = AdvancingLeafMaps::NONE;
    }

    /// Maps of the mapped leaves, then of bark, at the `nth` frame of the clip. Traces dry over time, so that maps advance frame by frame; an earlier
    /// frame starts from dry leaves.
    pub fn map_frames(&self, nth: u64) -> Vec<MapFrame> {
        let mut state = self.maps.lock().unwrap_or_else(PoisonError::into_inner);
        // The maps may be at frame `nth` already; earlier frames need a new start.
        let barks = self.barks.get().map_or(&[][..], Vec::as_slice);
        if state.frames > nth + 1 || state.frames == 0 {
            let dry = |m: &MappedLeaf| LeafWaterMaps::new(Arc::clone(&m.raster), self.leaves[m.leaf].scale);
            let leaves = self.mapped_leaves.iter().map(dry).collect();
            *state = AdvancingLeafMaps { frames: 0, leaves, barks: barks.iter().map(StruckBark::dry_patch).collect() };
        }
        while state.frames <= nth {
            let frame = self.frame_at(state.frames);
            let mut jobs: Vec<(&mut LeafWaterMaps, &MappedLeaf)> =
                state.leaves.iter_mut().zip(&self.mapped_leaves).collect();
            par_map_mut(&mut jobs, |(maps, mapped)| {
                let water = frame.leaf_map_input(mapped.leaf);
                maps.advance(&self.leaves[mapped.leaf].blade, &water.caps, &water.wet_spots, frame.t, &self.params);
            });
            state.barks.iter_mut().zip(barks).for_each(|(patch, bark)| bark.wet(patch, frame));
            state.frames += 1;
        }
        let t = self.frame_at(nth).t;
        let leaves = state.leaves.iter().map(|l| leaf_maps::leaf_map_frame(l.maps(), self.water_maps));
        leaves.chain(state.barks.iter().map(|patch| bark_maps::bark_map_frame(patch, t))).collect()
    }
}

impl AssetMotion for RainPlayback {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.drops_frame(time.index()))
    }

    fn row(&self, frame: u64) -> Result<Option<TableRow>> {
        Ok(Some(TableRow { table: stats::TABLE, values: stats::rain_row(self.frame_at(frame)) }))
    }

    fn maps(&self, frame: u64) -> Vec<MapFrame> {
        self.map_frames(frame)
    }

    fn records(&self, frame: u64) -> Vec<RecordTable> {
        drop_records::record_tables(self.frame_at(frame), &self.leaves, &self.numbers, self.frame_at(0).t)
    }

    fn point_tables(&self, frame: u64) -> Result<Vec<RecordTable>> {
        Ok(vec![drop_records::drop_points(self.frame_at(frame), &self.leaves, &self.numbers)])
    }
}

/// Motion of a plant that drops move, played back from the record of the rain.
#[derive(Debug)]
struct PlantMotionInRain {
    /// The recorded rain, which holds the frames of all plants.
    rain: Arc<RainPlayback>,
    /// Index of the plant's asset.
    plant: usize,
    /// Motion of points of the plant.
    carrier: PointCarrier,
}

impl AssetMotion for PlantMotionInRain {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.rain.plant_frame(self.plant, time.index()))
    }

    fn bind_points(self: Arc<Self>, plant: &Plant, points: &[PointOnAxis]) -> Option<Arc<dyn CarriedPoints>> {
        match &self.carrier {
            PointCarrier::Still => None,
            PointCarrier::Sway(sway) => Arc::clone(sway).bind_points(plant, points),
            PointCarrier::Rods { rods, binding } => {
                let points = binding.bind_points(rods, points);
                Some(Arc::new(PointsOnRodsInRain { motion: Arc::clone(&self), points }))
            }
        }
    }
}

/// Points of a plant on rods, which the joints of the recorded frames carry.
#[derive(Debug)]
struct PointsOnRodsInRain {
    motion: Arc<PlantMotionInRain>,
    points: BoundPoints,
}

impl CarriedPoints for PointsOnRodsInRain {
    fn positions(&self, time: FrameTime) -> Result<Vec<Vec3>> {
        let PlantMotionInRain { rain, plant, .. } = &*self.motion;
        Ok(self.points.carried_by_joints(&rain.plant_frame(*plant, time.index()).pose))
    }
}

#[cfg(test)]
mod tests;
