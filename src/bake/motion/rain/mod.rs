//! Rain of a recipe: which leaves it falls on, what a clip of it is, and how it is shown.

mod drop_records;
mod ground;
mod initial_drops;
pub(crate) mod leaf_maps;
mod params;
mod stats;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DQuat, DVec3, Vec3};

pub use self::drop_records::code_lists;
pub use self::ground::RainGround;
use crate::bake::BakeContext;
use crate::bake::motion::rod_plant::SkinBinding;
use crate::bake::motion::{AssetMotion, FrameTime, TableRow};
use crate::recipe::Recipe;
use crate::recipe::scene::RainRecipe;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::par::{par_map, par_map_mut};
use osier_motion::rain::{
    AlphaMask, DropMesh, DropParams, LeafAttachment, LeafCollider, LeafPose, LeafSurface, LeafWaterMaps, PendantFamily,
    RainConfig, RainEmitter, RainFrame, RainLeaf, RainSimulation, RainTarget, StaticPlant, UvRaster, VeinMap,
    WoodSegment, sphere_diameter,
};
use osier_motion::rods::RodPlant;
use osier_scene::plant::{AxisKind, Plant};
use osier_scene::{
    Asset, AssetFrame, AssetKind, Attribute, AttributeData, Image, InstancerFrame, MapFrame, MapSequence, Material,
    MaterialClass, MeshFrame, MeshMotion, MeshObject, Points, PointsFrame, RecordTable, Table, Trs,
};
use osier_wind::Wind;

/// Steps of a frame where nothing asks for more.
const DEFAULT_SUBSTEPS: u32 = 8;
/// Bytes of one frame's drops that are counted as one of the limit's keys, and what those are called.
const KEY: u64 = 64;
const HELD: &str = "the number of leaves and raindrops times frames";
/// Index of refraction of water.
const WATER: f32 = osier_base::physics::WATER_IOR;

/// Attribute of leaves and drops: share of the surface that is wet, 0 to 1.
const WETNESS: &str = "wetness";

/// A leaf of the scene.
pub struct SceneLeaf {
    /// Asset, instancer and instance.
    pub at: (usize, usize, usize),
    /// Its blade.
    pub sheet: Arc<LeafSurface>,
    target: Arc<LeafCollider>,
    /// Number by which its plant knows it, and the joint that it rides on.
    number: usize,
    /// See `number`.
    pub joint: Option<u16>,
    /// World from leaf space.
    p: DVec3,
    q: DQuat,
    scale: f64,
}

/// A leaf with maps of its own.
#[derive(Debug)]
struct MappedLeaf {
    leaf: usize,
    chart: Arc<UvRaster>,
}

/// Rain through a clip.
#[derive(Debug)]
pub struct RainPlayback {
    moments: Vec<RainFrame>,
    /// Leaves as they were before the first drop: their blades and sizes.
    leaves: Vec<RainLeaf>,
    mapped_leaves: Vec<MappedLeaf>,
    /// Frames of the plants that move; none of those that do not.
    plants: Vec<Vec<AssetFrame>>,
    manner: DropParams,
    /// Small numbers of the drops, by their ids.
    numbers: BTreeMap<u64, u32>,
    /// Slots of the points that show what falls, frame by frame.
    slots: Vec<Vec<u32>>,
    capacity: usize,
    /// Shapes of what hangs, by the bits of the radius.
    shapes: BTreeMap<u64, PendantFamily>,
    material: u32,
    maps: Mutex<LeafMapState>,
    /// Whether water alone has maps, too.
    water_maps: bool,
}

#[derive(Debug)]
struct LeafMapState {
    /// Frames done.
    done: u64,
    wet: Vec<LeafWaterMaps>,
}

/// What rain adds to a scene.
pub struct RainAsset {
    /// Shows drops.
    pub asset: Asset,
    /// It, through the clip.
    pub rain: Arc<RainPlayback>,
    /// Sheets that maps are made of.
    pub map_sequences: Vec<MapSequence>,
    /// What is measured.
    pub table: Table,
}

/// Parts of a scene that rain falls on.
pub struct RainScene<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// Assets of grown plants, one per standing; leaves with maps are taken out of their instancers.
    pub assets: &'a mut Vec<Asset>,
    /// Materials.
    pub materials: &'a mut Vec<Material>,
    /// Their pictures.
    pub images: &'a [Image],
    /// Where each stands.
    pub stands: &'a [Trs],
    /// The plants themselves.
    pub plants: &'a [&'a Plant],
    /// Rods that each moves by, if it has any.
    pub rod_plants: Vec<Option<(RodPlant, SkinBinding)>>,
    /// Moving air.
    pub wind: Option<Arc<dyn Wind>>,
    /// Ground.
    pub soil: RainGround,
}

/// Lets it rain.
/// # Errors
/// `Simulation`, `Limit`, `Cancelled`.
pub fn simulate_rain(under: RainScene<'_>, rain: &RainRecipe, context: &BakeContext<'_>) -> Result<RainAsset> {
    let RainScene { recipe, assets, materials, images, stands, plants, rod_plants, wind, soil } = under;
    let found = scene_leaves(assets, materials, images, stands, &rod_plants);
    let mapped_leaves = nearest(recipe, &found);
    let steps = steps(rain, recipe, &rod_plants);
    let (boughs, dressings): (Vec<Option<RodPlant>>, Vec<Option<SkinBinding>>) =
        rod_plants.into_iter().map(Option::unzip).unzip();
    let mut bearers: Vec<Box<dyn RainTarget>> = Vec::new();
    for (k, boughs) in boughs.into_iter().enumerate() {
        bearers.push(match boughs {
            Some(boughs) => Box::new(boughs.with_wind(wind.clone())),
            None => stiff(k, &found, plants, stands),
        });
    }
    let over = bounds(assets, stands);
    let manner = params::manner(rain, recipe.general.seed);
    let clip = recipe.clip;
    let frames = clip.len() as u64;
    let rainfall = params::rainfall(rain, recipe);
    let shower = rain.keys.falls.then(|| RainEmitter::new(rainfall, over, wind.clone()));
    let area = shower.as_ref().map(RainEmitter::area);
    check_memory(&shower, over, frames, found.len(), context)?;
    let hung = found.iter().enumerate().map(|(i, f)| {
        let leaf = RainLeaf::new(Arc::clone(&f.sheet), f.scale, i as u64);
        (leaf, LeafAttachment { plant: f.at.0, leaf: f.number, collider: Arc::clone(&f.target) })
    });
    let floor = soil.floor(over.min.y);
    let parts = RainConfig {
        params: manner.clone(),
        emitter: shower,
        plants: bearers,
        leaves: hung.collect(),
        wind,
        ground: floor,
    };
    let mut storm = RainSimulation::new(parts);
    let dry = storm.leaves().to_vec();
    initial_drops::check(&rain.lying, &dry)?;
    let (moments, mut plants) = record_frames(&mut storm, rain, recipe, steps, assets, &dressings, &found, context)?;
    let material = u32::try_from(materials.len()).unwrap_or(u32::MAX);
    materials.push(Material {
        ior: WATER,
        roughness: 0.0,
        ..Material::plain("water".into(), MaterialClass::Water, [0.98, 0.99, 1.0], 0.0)
    });
    let side = recipe.maps.resolution as usize;
    let charts = leaf_maps::charts(&found, &mapped_leaves, side);
    let rate = rain.keys.falls.then_some(rain.keys.rate);
    let (mut map_sequences, kept) =
        leaf_maps::add_leaf_maps(assets, materials, &found, &mapped_leaves, stands, recipe)?;
    for (frames, masks) in plants.iter_mut().zip(&kept) {
        frames.iter_mut().for_each(|frame| leaf_maps::thin_frame(frame, masks));
    }
    let mapped_leaves: Vec<MappedLeaf> =
        mapped_leaves.iter().zip(charts).map(|(leaf, chart)| MappedLeaf { leaf: *leaf, chart }).collect();
    let (slots, capacity) = drop_records::slots(&moments);
    let rain = RainPlayback {
        shapes: shapes(&moments, manner.g),
        numbers: drop_records::numbers(&moments),
        maps: Mutex::new(LeafMapState { done: 0, wet: Vec::new() }),
        water_maps: recipe.maps.water,
        leaves: dry,
        plants,
        moments,
        mapped_leaves,
        manner,
        slots,
        capacity,
        material,
    };
    let moves = frames > 1;
    let asset = rain.asset(moves, over);
    if !moves {
        for (sequence, maps) in map_sequences.iter_mut().zip(rain.map_frames(0)) {
            sequence.rest = Some(maps);
        }
    }
    let table = stats::table(&rain.manner, rate.zip(area));
    Ok(RainAsset { asset, rain: Arc::new(rain), map_sequences, table })
}

/// Every blade of the scene, plant by plant.
fn scene_leaves(
    assets: &[Asset],
    materials: &[Material],
    images: &[Image],
    stands: &[Trs],
    rod_plants: &[Option<(RodPlant, SkinBinding)>],
) -> Vec<SceneLeaf> {
    let mut found = Vec::new();
    for (a, (asset, stand)) in assets.iter().zip(stands).enumerate() {
        let rods = rod_plants.get(a).and_then(Option::as_ref);
        let mut count = 0;
        for (i, instancer) in asset.instancers.iter().enumerate() {
            let sheets: Vec<Option<(Arc<LeafSurface>, Arc<LeafCollider>)>> = instancer
                .prototypes
                .iter()
                .map(|p| {
                    let cover = AlphaMask::of_mesh_materials(&p.mesh, materials, images);
                    let grooves = VeinMap::of_mesh_materials(&p.mesh, materials, images);
                    let sheet = Arc::new(LeafSurface::new(&p.mesh)?.with_maps(cover, grooves));
                    let target = Arc::new(LeafCollider::new(&sheet));
                    Some((sheet, target))
                })
                .collect();
            for k in 0..instancer.len() {
                let Some(Some((sheet, target))) = sheets.get(instancer.protos[k] as usize) else { continue };
                let trs = stand.then_inner(&instancer.transform(&instancer.rest, k));
                let organ = rods.and_then(|(_, dressing)| dressing.groups().get(i)?.get(k).copied());
                let joint = rods.zip(organ).map(|((boughs, dressing), organ)| dressing.joint(boughs, organ));
                let number = organ.unwrap_or(count);
                count += 1;
                found.push(SceneLeaf {
                    number,
                    joint,
                    at: (a, i, k),
                    sheet: Arc::clone(sheet),
                    target: Arc::clone(target),
                    p: trs.t.as_dvec3(),
                    q: trs.r.as_dquat().normalize(),
                    scale: f64::from(trs.s.x),
                });
            }
        }
    }
    found
}

/// Leaves that have maps: the nearest to the scene's own camera, else the first.
fn nearest(recipe: &Recipe, found: &[SceneLeaf]) -> Vec<usize> {
    let most = recipe.maps.max_mapped_leaves as usize;
    let mut order: Vec<usize> = (0..found.len()).collect();
    if let Some(eye) = recipe.camera.eye {
        let eye = DVec3::from_array(eye);
        order.sort_by(|a, b| found[*a].p.distance(eye).total_cmp(&found[*b].p.distance(eye)).then(a.cmp(b)));
    }
    order.truncate(most);
    order.sort_unstable();
    order
}

/// A plant that nothing moves.
fn stiff(k: usize, found: &[SceneLeaf], plants: &[&Plant], stands: &[Trs]) -> Box<dyn RainTarget> {
    let leaves: Vec<(DVec3, DQuat)> = found.iter().filter(|f| f.at.0 == k).map(|f| (f.p, f.q)).collect();
    let mut boughs = Vec::new();
    if let Some((plant, stand)) = plants.get(k).zip(stands.get(k)) {
        for axis in plant.axes.iter().filter(|a| a.kind != AxisKind::Root) {
            let range = plant.nodes_of(axis);
            for i in range.start..range.end.saturating_sub(1) {
                let end = |i: usize| stand.apply(plant.nodes.p[i]).as_dvec3();
                let radius = |i: usize| f64::from(plant.nodes.r[i] * stand.s.x);
                boughs.push(WoodSegment { ends: [end(i), end(i + 1)], radii: [radius(i), radius(i + 1)] });
            }
        }
    }
    Box::new(StaticPlant::new(&leaves, boughs))
}

fn bounds(assets: &[Asset], stands: &[Trs]) -> Bounds {
    let rest = AssetFrame::default();
    let corners = assets
        .iter()
        .zip(stands)
        .flat_map(|(asset, stand)| osier_scene::asset_bounds(asset, &rest).corners().map(|c| stand.apply(c)));
    Bounds::of(corners)
}

/// Leaves and drops that are in the air at once, times frames, must fit. Drops on leaves are counted as they come ([`record`]).
fn check_memory(
    shower: &Option<RainEmitter>,
    over: Bounds,
    frames: u64,
    leaves: usize,
    context: &BakeContext<'_>,
) -> Result<()> {
    // The slowest fall at 2 m/s.
    let seconds = (f64::from(over.size().y) + 1.0) / 2.0;
    let falling = shower.as_ref().map_or(0.0, RainEmitter::rate) * seconds * 96.0;
    let drops = (falling + (leaves * size_of::<LeafPose>()) as f64) * frames as f64 / KEY as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "compared, saturating")]
    context.limits.check("motion-keys", drops as u64, HELD)
}

/// Steps of a frame: as many as the rods need.
fn steps(rain: &RainRecipe, recipe: &Recipe, rod_plants: &[Option<(RodPlant, SkinBinding)>]) -> u32 {
    let fps = recipe.clip.fps();
    let most = rod_plants.iter().flatten().fold(DEFAULT_SUBSTEPS, |m, (boughs, _)| m.max(boughs.steps_per_frame(fps)));
    rain.keys.substeps.unwrap_or(most)
}

/// Rain frame by frame, and the frames of each plant that moves.
type RainRecord = (Vec<RainFrame>, Vec<Vec<AssetFrame>>);

/// Steps through the clip.
fn record_frames(
    storm: &mut RainSimulation,
    rain: &RainRecipe,
    recipe: &Recipe,
    steps: u32,
    assets: &[Asset],
    dressings: &[Option<SkinBinding>],
    found: &[SceneLeaf],
    context: &BakeContext<'_>,
) -> Result<RainRecord> {
    let fps = recipe.clip.fps();
    let h = 1.0 / (fps * f64::from(steps));
    let frames = recipe.clip.len() as u64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most ten minutes of steps")]
    let before = (rain.keys.spin_up / h).round() as u64;
    context.progress.stage("raining", frames + before / u64::from(steps));
    // Wet traces from before the clip are kept for its first frame.
    for k in 0..before {
        storm.step(h)?;
        if k % u64::from(steps) == 0 {
            context.cancel.check()?;
            context.progress.advance(1);
            // What happened before the clip nobody asks for.
            storm.take_events();
        }
    }
    initial_drops::place(storm, &rain.lying);
    let mut moments = Vec::new();
    let mut held = 0;
    let mut plants: Vec<Vec<AssetFrame>> = vec![Vec::new(); dressings.len()];
    for frame in 0..frames {
        context.cancel.check()?;
        storm.check_water_budget(recipe.clip.start + u32::try_from(frame).unwrap_or(u32::MAX))?;
        let moment = RainFrame::capture(storm);
        held += moment.memory_bytes();
        context.limits.check("motion-keys", held / KEY, HELD)?;
        for (k, (bearer, dressing)) in storm.plants().iter().zip(dressings).enumerate() {
            let shown = bearer.posed_rods().zip(dressing.as_ref()).zip(assets.get(k));
            plants[k].extend(shown.map(|((rods, dressing), asset)| dressing.frame(asset, rods, &**bearer)));
        }
        moisten(&mut plants, found, &moment.wetness);
        moments.push(moment);
        context.progress.advance(1);
        if frame + 1 < frames {
            (0..steps).try_for_each(|_| storm.step(h))?;
        }
    }
    Ok((moments, plants))
}

/// Tells the newest frames of plants how wet their leaves are.
fn moisten(plants: &mut [Vec<AssetFrame>], found: &[SceneLeaf], wetness: &[f64]) {
    for (leaf, wetness) in found.iter().zip(wetness) {
        let (plant, instancer, k) = leaf.at;
        let frame = plants.get_mut(plant).and_then(|frames| frames.last_mut());
        if let Some(InstancerFrame::State(state)) = frame.and_then(|f| f.instancers.get_mut(instancer))
            && let Some(value) = state.unit_attribute_mut(WETNESS).get_mut(k)
        {
            *value = narrow(*wetness);
        }
    }
}

fn shapes(moments: &[RainFrame], g: f64) -> BTreeMap<u64, PendantFamily> {
    let radii: BTreeSet<u64> = moments.iter().flat_map(|m| &m.pendant).map(|h| h.radius.to_bits()).collect();
    let radii: Vec<u64> = radii.into_iter().collect();
    let made = par_map(&radii, |bits| PendantFamily::new(f64::from_bits(*bits), g));
    radii.into_iter().zip(made).collect()
}

impl RainPlayback {
    fn moment(&self, nth: u64) -> &RainFrame {
        let last = self.moments.len().saturating_sub(1);
        &self.moments[usize::try_from(nth).unwrap_or(usize::MAX).min(last)]
    }

    /// Water on leaves and at their margins at a frame from the first.
    fn water(&self, nth: u64) -> DropMesh {
        let moment = self.moment(nth);
        let mut water = DropMesh::default();
        // The number of its drop at each point: each drop fills the list up to the end of its own points.
        let mut ids: Vec<i32> = Vec::new();
        let number = |id: &u64| self.numbers.get(id).and_then(|n| i32::try_from(*n).ok()).unwrap_or(-1);
        for drop in &moment.sessile {
            water.add_sessile(&self.leaves[drop.leaf], &moment.leaf_poses[drop.leaf], drop);
            ids.resize(water.mesh.points.len(), number(&drop.id));
        }
        for drop in &moment.pendant {
            if let Some(shapes) = self.shapes.get(&drop.radius.to_bits()) {
                water.add_pendant(&moment.leaf_poses[drop.leaf], drop, shapes);
                ids.resize(water.mesh.points.len(), number(&drop.id));
            }
        }
        // Water is as wet as leaves under it may be.
        let wetness = vec![1.0; ids.len()];
        water.mesh.attributes = vec![
            Attribute::vertex("drop_id", AttributeData::I32(ids)),
            Attribute::vertex(WETNESS, AttributeData::Unit1(wetness)),
        ];
        water.mesh = water.mesh.with_material(self.material);
        water
    }

    /// Positions, widths and velocities of what is in the air.
    fn air(&self, nth: u64) -> (Vec<Vec3>, Vec<f32>, Vec<Vec3>) {
        let moment = self.moment(nth);
        let slots = self.slots.get(usize::try_from(nth).unwrap_or(usize::MAX)).map_or(&[][..], Vec::as_slice);
        let n = self.capacity;
        let (mut p, mut w, mut v) = (vec![Vec3::ZERO; n], vec![0.0; n], vec![Vec3::ZERO; n]);
        for (drop, slot) in moment.airborne.iter().zip(slots) {
            let k = *slot as usize;
            (p[k], w[k], v[k]) = (drop.p.as_vec3(), narrow(sphere_diameter(drop.volume)), drop.v.as_vec3());
        }
        (p, w, v)
    }

    fn asset(&self, moves: bool, over: Bounds) -> Asset {
        let mut water = self.water(0);
        // Numbers of drops join the frames of a clip; a mesh at rest has none.
        water.mesh.attributes.clear();
        let (positions, widths, _) = self.air(0);
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
            reach: over.grown(0.6),
        };
        Asset {
            id: "rain".into(),
            kind: AssetKind::Tracks,
            group: String::new(),
            skeleton: None,
            meshes: if empty { Vec::new() } else { vec![drops] },
            instancers: Vec::new(),
            points: if self.capacity > 0 { vec![falling] } else { Vec::new() },
            curves: Vec::new(),
        }
    }

    /// The drops' asset at a frame from the first.
    fn water_frame(&self, nth: u64) -> AssetFrame {
        let DropMesh { mesh, velocities } = self.water(nth);
        let (positions, widths, velocity) = self.air(nth);
        let points = PointsFrame::State { positions, widths, velocities: velocity, colors: Vec::new() };
        AssetFrame {
            meshes: vec![MeshFrame::Whole { mesh, velocities }],
            points: if self.capacity > 0 { vec![points] } else { Vec::new() },
            ..AssetFrame::default()
        }
    }

    /// Whether plant `k` moves.
    pub fn moves(&self, k: usize) -> bool {
        self.plants.get(k).is_some_and(|frames| !frames.is_empty())
    }

    /// A plant that rain moves at a frame from the first.
    pub fn plant(&self, k: usize, nth: u64) -> AssetFrame {
        let frames = self.plants.get(k).map_or(&[][..], Vec::as_slice);
        let nth = usize::try_from(nth).unwrap_or(usize::MAX).min(frames.len().saturating_sub(1));
        frames.get(nth).cloned().unwrap_or_default()
    }

    /// Maps of the leaves that have some, at a frame from the first. Asked in order they go on from the last.
    pub fn map_frames(&self, nth: u64) -> Vec<MapFrame> {
        let mut now = self.maps.lock().unwrap_or_else(PoisonError::into_inner);
        if now.done > nth + 1 || now.wet.is_empty() {
            let dry = |h: &MappedLeaf| LeafWaterMaps::new(Arc::clone(&h.chart), self.leaves[h.leaf].scale);
            *now = LeafMapState { done: 0, wet: self.mapped_leaves.iter().map(dry).collect() };
        }
        while now.done <= nth {
            let moment = self.moment(now.done);
            let mut jobs: Vec<(&mut LeafWaterMaps, &MappedLeaf)> =
                now.wet.iter_mut().zip(&self.mapped_leaves).collect();
            par_map_mut(&mut jobs, |(wet, mapped)| {
                let water = moment.leaf_map_input(mapped.leaf);
                wet.advance(&self.leaves[mapped.leaf].blade, &water.caps, &water.wet_spots, moment.t, &self.manner);
            });
            now.done += 1;
        }
        now.wet.iter().map(|w| leaf_maps::map_frame(w.maps(), self.water_maps)).collect()
    }
}

impl AssetMotion for RainPlayback {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.water_frame(time.index()))
    }

    fn row(&self, frame: u64) -> Result<Option<TableRow>> {
        Ok(Some(TableRow { table: stats::TABLE, values: stats::row(self.moment(frame)) }))
    }

    fn maps(&self, frame: u64) -> Vec<MapFrame> {
        self.map_frames(frame)
    }

    fn records(&self, frame: u64) -> Vec<RecordTable> {
        drop_records::tables(self.moment(frame), &self.leaves, &self.numbers, self.moment(0).t)
    }
}

/// Motion of a plant that rain moves.
#[derive(Debug, Clone)]
pub struct RainedPlantMotion {
    /// The recorded rain.
    pub rain: Arc<RainPlayback>,
    /// Index of the plant's asset.
    pub plant: usize,
}

impl AssetMotion for RainedPlantMotion {
    fn frame(&self, _asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.rain.plant(self.plant, time.index()))
    }
}

#[cfg(test)]
mod tests;
