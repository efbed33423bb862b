//! What a run will make, told before it is written.

use std::collections::BTreeSet;

use super::blow::lattice_options;
use super::memory::{predicted, raw};
use super::write::Stage;
use crate::recipe::Recipe;
use crate::recipe::sections::{Format, Profile};
use crate::recipe::wind_keys::{Solver, WindModel};
use osier_scene::{Asset, InstancerMotion, MeshMotion, Scene};
use osier_wind::LatticeMemory;

/// Numbers of things, over all assets.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Counts {
    /// Assets with files of their own.
    pub assets: u64,
    /// Showings of assets.
    pub placements: u64,
    /// Modules of all final strings.
    pub modules: u64,
    /// Vertices of meshes, prototypes counted once.
    pub vertices: u64,
    /// Triangles of meshes, prototypes counted once.
    pub triangles: u64,
    /// Instances of prototypes.
    pub instances: u64,
    /// Points of clouds.
    pub points: u64,
    /// Joints.
    pub joints: u64,
    /// Frames that are written; 0 for a still scene.
    pub frames: u64,
    /// Bytes written, estimated.
    pub bytes: u64,
    /// Of these, what each format takes, by its word, and pictures.
    pub sizes: Vec<(&'static str, u64)>,
    /// Bytes of memory at the peak of the run, by what they are for.
    pub memory: Vec<(&'static str, u64)>,
}

impl Counts {
    /// Bytes of memory at the peak of the run.
    pub fn peak(&self) -> u64 {
        self.memory.iter().map(|p| p.1).sum()
    }
}

/// Counts a stage of which `frames` frames will be written.
/// `weights`: how many assets each of the first stands for, itself included.
pub fn count(stage: &Stage, recipe: &Recipe, frames: u64, weights: &[u64]) -> Counts {
    let mut c = Counts { frames, placements: stage.scene.placements.len() as u64, ..Counts::default() };
    let pictures: u64 = stage.scene.images.iter().map(picture).sum();
    let formats = &recipe.output.formats;
    let mut sizes: Vec<u64> =
        formats.iter().map(|f| shared(*f, pictures, recipe) + sheets(*f, &stage.scene, recipe, frames)).collect();
    let mut shown: Vec<(BTreeSet<u32>, u64)> = vec![Default::default(); stage.scene.assets.len()];
    for placement in &stage.scene.placements {
        if let Some((times, copies)) = shown.get_mut(placement.asset) {
            times.insert(placement.phase);
            *copies += 1;
        }
    }
    for (i, (asset, (times, copies))) in stage.scene.assets.iter().zip(shown).enumerate() {
        let weight = weights.get(i).copied().unwrap_or(1);
        // Copies that stand still share meshes; in a plan they are those of all individuals that this one stands for.
        let copies = if asset.moves() && frames > 0 { 1 } else { copies.div_ceil(weight.max(1)).max(1) };
        let size = Size { times: times.len().max(1) as u64, copies, ..Size::of(asset) };
        c.assets += weight;
        c.vertices += weight * (size.vertices + size.proto_vertices);
        c.triangles += weight * (size.triangles + size.proto_triangles);
        c.instances += weight * size.instances;
        c.points += weight * size.points;
        c.joints += weight * size.joints;
        sizes.iter_mut().zip(formats).for_each(|(sum, f)| *sum += weight * bytes(*f, &size, recipe, frames));
    }
    let wind = air(&stage.scene, frames);
    c.sizes = formats.iter().map(|f| f.word()).zip(sizes).chain([("pictures", pictures)]).collect();
    c.sizes.extend((wind > 0).then_some(("wind", wind)));
    c.bytes = c.sizes.iter().map(|s| s.1).sum();
    c.memory = predicted(&stage.scene, recipe, &c);
    c
}

/// What a format takes for the whole scene.
fn shared(format: Format, pictures: u64, recipe: &Recipe) -> u64 {
    match format {
        // Pictures are embedded in the scene's file, and in each asset's where those have some.
        Format::Glb => {
            let each = |p: &Profile| if *p == Profile::Web { pictures / JPEG } else { pictures };
            glb_files(recipe) * recipe.output.gltf.profiles.iter().map(each).sum::<u64>()
        }
        _ => 0,
    }
}

/// How many times smaller pictures are as JPEG. Own: measured on barks, grounds and leaves.
const JPEG: u64 = 4;

/// In how many binary glTF files of a profile an asset appears.
fn glb_files(recipe: &Recipe) -> u64 {
    if recipe.output.gltf.assets { 2 } else { 1 }
}

/// What the maps of wet sheets take. Own: bytes a texel as measured on leaves in rain; a file of each map per frame.
fn sheets(format: Format, scene: &Scene, recipe: &Recipe, frames: u64) -> u64 {
    let texels: u64 = scene.wet.iter().map(|w| (w.side * w.side) as u64).sum();
    let frames = frames.max(1);
    match format {
        Format::Exr => {
            let together = if recipe.maps.atlas { 2 } else { 1 };
            let tenths = HEIGHT + WETNESS + NORMAL + if recipe.maps.water { WETNESS } else { 0 };
            texels * frames * tenths * together / 10
        }
        Format::Pov => texels * (frames / u64::from(recipe.output.pov.step.max(1))).max(1) * (HEIGHT + WETNESS) / 10,
        _ => 0,
    }
}

/// Bytes of memory of a recipe's lattice wind, by what they are for; none without.
pub fn lattice(recipe: &Recipe) -> Vec<(&'static str, u64)> {
    let solved = recipe.wind.model == WindModel::Lattice && recipe.lattice.solver == Solver::Lbm;
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

/// What planes and boxes of wind take.
fn air(scene: &Scene, frames: u64) -> u64 {
    scene.air.iter().map(|g| frames.div_ceil(u64::from(g.every.max(1))).saturating_mul(12 * g.count())).sum()
}

/// Tenths of a byte that a texel takes in a packed map.
const HEIGHT: u64 = 1;
const WETNESS: u64 = 1;
const NORMAL: u64 = 3;

#[derive(Debug, Default)]
struct Size {
    vertices: u64,
    triangles: u64,
    cached: u64,
    instances: u64,
    /// Instances that frames carry one by one.
    free: u64,
    instance_vertices: u64,
    instance_triangles: u64,
    proto_vertices: u64,
    proto_triangles: u64,
    points: u64,
    moving_points: u64,
    /// Points of curves that frames carry.
    drawn_points: u64,
    joints: u64,
    /// Vertices that move by joints or by themselves.
    moving: u64,
    /// Different times of the clip at which copies show it.
    times: u64,
    /// Copies that stand still.
    copies: u64,
}

impl Size {
    fn of(asset: &Asset) -> Self {
        let mut s = Self { joints: asset.skeleton.as_ref().map_or(0, |k| k.joints.len() as u64), ..Self::default() };
        for m in &asset.meshes {
            s.vertices += m.mesh.points.len() as u64;
            s.triangles += m.mesh.triangles.len() as u64;
            if m.motion != MeshMotion::Still {
                s.moving += m.mesh.points.len() as u64;
            }
            if m.motion == MeshMotion::Deforming {
                s.cached += m.mesh.points.len() as u64;
            }
        }
        for p in &asset.points {
            let n = p.positions.len() as u64;
            s.points += n;
            s.moving_points += if p.moving { n } else { 0 };
        }
        s.drawn_points = asset.curves.iter().filter(|c| c.moving).map(|c| c.points.len() as u64).sum();
        for i in &asset.instancers {
            let sizes: Vec<(u64, u64)> =
                i.prototypes.iter().map(|p| (p.mesh.points.len() as u64, p.mesh.triangles.len() as u64)).collect();
            s.instances += i.len() as u64;
            s.free += if i.motion == InstancerMotion::Free { i.len() as u64 } else { 0 };
            s.proto_vertices += sizes.iter().map(|p| p.0).sum::<u64>();
            s.proto_triangles += sizes.iter().map(|p| p.1).sum::<u64>();
            for p in &i.protos {
                let (v, t) = sizes.get(*p as usize).copied().unwrap_or_default();
                s.instance_vertices += v;
                s.instance_triangles += t;
            }
        }
        s
    }
}

/// PNG takes about half of noise-like pictures' bytes.
fn picture(image: &osier_scene::Image) -> u64 {
    raw(image) / 2
}

/// Own: bytes per vertex, triangle, instance and sample as the writers lay them out.
fn bytes(format: Format, s: &Size, recipe: &Recipe, frames: u64) -> u64 {
    let moving = if s.joints > 0 { frames } else { 0 };
    let flowing = s.moving_points * frames;
    let spheres = |n: u64| n.min(100_000) * 110;
    match format {
        Format::Usd => {
            let still = (s.vertices + s.proto_vertices) * 44 + (s.triangles + s.proto_triangles) * 8 + s.instances * 40;
            // Place, turn, two rates; the twin once more, with four numbers.
            let tracks = (s.free * 124 + s.drawn_points * 12) * frames;
            still + tracks + s.points * 44 + flowing * 40 + moving * (s.cached * 24 + s.instances * 20 + s.joints * 34)
        }
        Format::Glb => {
            let keys = &recipe.output.gltf;
            let nodes = if keys.frame.is_some() { 0 } else { s.free.min(u64::from(keys.nodes)) };
            let vertices = s.vertices + s.instance_vertices;
            // Points, normals, coordinates, tangents; bark has joints and weights as well.
            let skinned = if s.joints > 0 { s.vertices * 24 } else { 0 };
            let merged = vertices * 48 + skinned + (s.triangles + s.instance_triangles) * 12;
            let web = s.vertices * 48 + s.triangles * 12 + s.proto_vertices * 28 + s.instances * s.copies * 32;
            let (tracks, points) = (moving * s.joints * 16 + nodes * frames * 44, (s.points - s.moving_points) * 18);
            // In the scene's file, which has tracks for each of the times, and in the asset's own if it has one.
            let files = glb_files(recipe);
            let times = s.times.min(u64::from(keys.skins)) + files - 1;
            let each = |p: &Profile| match p {
                Profile::Blender => files * (merged + points) + times * tracks,
                Profile::Web => files * (web + points) + times * tracks,
            };
            recipe.output.gltf.profiles.iter().map(each).sum()
        }
        Format::Pc2 => moving * s.cached * 12,
        Format::Obj => (s.vertices + s.instance_vertices) * 80 + (s.triangles + s.instance_triangles) * 40,
        Format::Ply => s.instances * 60 + (s.points - s.moving_points) * 22 + flowing * 22,
        // Four maps of half floats at the default size, packed to about half.
        Format::Exr => 4 << 20,
        Format::Csv => frames * 200,
        // Joints; drops are counted for the whole scene.
        Format::Tracks => frames * s.joints * 36,
        Format::Pov => {
            let still = (s.triangles + s.proto_triangles) * 100 + s.instances * 170;
            let shown = |frames: u64| frames / u64::from(recipe.output.pov.step.max(1));
            let points = spheres(s.points - s.moving_points) + shown(frames) * spheres(s.moving_points);
            // A frame has points and normals of what moves, and one line for the leaves of each joint.
            still
                + points
                + shown(frames) * (s.free * 170 + s.drawn_points * 120)
                + shown(moving) * (s.moving * 70 + s.joints * 170)
        }
    }
}
