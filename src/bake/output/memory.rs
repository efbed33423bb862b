//! Predicts the peak of memory of a run, so that a limit can stop it before it allocates.
//!
//! The terms are what a run holds: pictures as they are drawn and packed, geometry as it is grown and written, a binary glTF
//! file, which is put together in memory, the maps of two frames of rain, air.
//!
//! Own: the factors were fitted to the resident peaks of all presets on two threads, and hold them within a quarter; an imported tree,
//! whose skeleton is found in its mesh, takes a little more.

use crate::bake::output::bake_estimate::BakeEstimate;
use crate::bake::wind::lattice::lattice_memory;
use crate::recipe::{Recipe, TerrainFile};
use osier_export::format::FormatInfo;
use osier_export::usd;
use osier_scene::{Image, Pixels, Scene, VolumeGrid};

/// The program itself, and what each thread has on its stack and in its buffers, bytes.
const PROGRAM_BYTES: u64 = 16_000_000;
const THREAD_BYTES: u64 = 4_000_000;
/// Tenths of a byte of memory for each byte of a picture, which is held both decoded and packed.
const PICTURE_BYTE_TENTHS: u64 = 22;
/// Bytes of memory for each vertex, and the same for each triangle, of all meshes.
const VERTEX_BYTES: u64 = 42;
/// Bytes for each instance: transform, site on the plant, motion.
const INSTANCE_BYTES: u64 = 130;
/// Bytes for each point of a cloud, and additional ones if USD is written.
const POINT_BYTES: u64 = 50;
const USD_POINT_BYTES: u64 = 26;
/// Bytes for each vertex that frames carry: position, normal and velocity in the frame that is written and in the next, and the binding
/// of the vertex to its branch. Runs with 0.24 to 2.9 million of them take 85 to 140 bytes each.
const POSED_VERTEX_BYTES: u64 = 120;
/// Additional bytes for each point of a cloud that morphs: velocities in two frames, and the positions half a frame before and after,
/// from which they are found. Runs of 0.5 to 3 million points take 56 to 81 bytes each.
const MORPHING_POINT_BYTES: u64 = 70;
/// Bytes of trees that grow over the clip year by year, for each vertex and the same for each triangle of their bark: their internodes at
/// the end of all years and in the frame that is written; and for each leaf that is seen at once: the leaves that follow each other there.
/// Runs with 27,000 to 590,000 vertices and triangles and 15,000 to 365,000 leaves are predicted within a quarter.
const GROWING_ELEMENT_BYTES: u64 = 380;
const GROWING_LEAF_BYTES: u64 = 440;
/// Bytes for each texel of the maps of rain.
const TEXEL_BYTES: u64 = 150;

/// Bytes for each triangle of an imported terrain beside its mesh: the mesh of the file, the triangles by which heights are
/// found, and their index.
const TERRAIN_TRIANGLE_BYTES: u64 = 70;

/// Bytes for each catkin in flight beside its instance: its state (320 bytes) and its start (48), the grid of contacts, its row in the
/// frame that is written and in the next. Runs of 200,000 and of a million took 1,080 to 1,500 bytes each with a second state, 272 bytes more;
/// the value lies between.
const CATKIN_BYTES: u64 = 890;

/// Bytes of the record of rain at each frame: for a leaf its pose, its water and its place on the plant; for a drop in the air.
const RECORDED_LEAF_BYTES: u64 = 350;
const RECORDED_DROP_BYTES: u64 = 96;
/// Bytes of the simulation of rain for each leaf, whatever the number of frames: its mesh in the search for hits, its motion and its water.
/// Storms over oaks with 21,000 to 56,000 leaves are predicted within a tenth.
const RAINED_LEAF_BYTES: u64 = 1200;

/// Bytes for each cell of a volume of vectors (centre, velocity in two frames, packed copy), and of a sparse volume of scalars.
const VOXEL_BYTES: u64 = 70;
const SCALAR_VOXEL_BYTES: u64 = 600;

/// Parts of a scene that take memory beside their meshes and instances.
#[derive(Debug, Clone, Copy)]
pub struct AnimatedCounts {
    /// Vertices that frames carry, without those of growing plants.
    pub posed_vertices: u64,
    /// Vertices and triangles of the bark of trees that grow over the clip year by year.
    pub growing_elements: u64,
    /// Leaves of these trees that are seen at once.
    pub growing_leaves: u64,
    /// Leaves that drops of rain can strike.
    pub rained_leaves: u64,
}

/// Bytes of memory at the peak of a run, by purpose. `counts`: the counts and file sizes of the run; `carried`: what its frames carry.
pub fn predict_memory(
    scene: &Scene,
    formats: &[&FormatInfo],
    recipe: &Recipe,
    counts: &BakeEstimate,
    carried: AnimatedCounts,
) -> Vec<(&'static str, u64)> {
    let texels: u64 = scene.map_sequences.iter().map(|s| s.texels() as u64).sum();
    let size = |format: &str| counts.sizes.iter().find(|s| s.0 == format).map_or(0, |s| s.1);
    // Each format declares the share of its file that it holds in memory at once.
    let writers = formats.iter().map(|f| size(f.word) / 100 * f.memory_percent).sum();
    let voxel = |g: &VolumeGrid| g.max_cells.saturating_mul(if g.is_vector { VOXEL_BYTES } else { SCALAR_VOXEL_BYTES });
    let volumes = scene.volumes.iter().map(voxel).fold(0, u64::saturating_add);
    let point =
        if formats.iter().any(|f| f.word == usd::FORMAT.word) { POINT_BYTES + USD_POINT_BYTES } else { POINT_BYTES };
    // Rain is simulated as a whole before the first frame is written.
    let recorded = match &recipe.rain {
        Some(_) if counts.frames > 1 => {
            let leaves = RECORDED_LEAF_BYTES.saturating_mul(carried.rained_leaves);
            let frame = leaves.saturating_add(RECORDED_DROP_BYTES.saturating_mul(counts.points));
            counts.frames.saturating_mul(frame).saturating_add(RAINED_LEAF_BYTES.saturating_mul(carried.rained_leaves))
        }
        _ => 0,
    };
    let morphs = recipe.clouds.iter().filter(|cloud| cloud.morph.is_some());
    let morphing_points: u64 = morphs.map(|cloud| u64::from(cloud.keys.points)).sum();
    let posed = POSED_VERTEX_BYTES.saturating_mul(carried.posed_vertices);
    let moved = posed.saturating_add(MORPHING_POINT_BYTES.saturating_mul(morphing_points));
    let years = GROWING_ELEMENT_BYTES.saturating_mul(carried.growing_elements);
    let mut parts = vec![
        ("program", PROGRAM_BYTES + THREAD_BYTES * osier_base::par::threads() as u64),
        ("pictures", scene.images.iter().map(decoded_bytes).sum::<u64>() / 10 * PICTURE_BYTE_TENTHS),
        ("meshes", VERTEX_BYTES.saturating_mul(counts.vertices + counts.triangles)),
        ("instances", INSTANCE_BYTES.saturating_mul(counts.instances)),
        ("points", point.saturating_mul(counts.points)),
        ("frames", if counts.frames > 1 { moved } else { 0 }),
        ("years of trees", years.saturating_add(GROWING_LEAF_BYTES.saturating_mul(carried.growing_leaves))),
        ("writers", writers),
        ("maps of rain", TEXEL_BYTES * texels),
        ("record of rain", recorded),
        (
            "flights",
            CATKIN_BYTES.saturating_mul(recipe.flight.as_ref().map_or(0, |flight| u64::from(flight.keys.count))),
        ),
        ("volumes", volumes),
        ("terrain", TERRAIN_TRIANGLE_BYTES.saturating_mul(terrain_triangles(recipe))),
    ];
    parts.extend(lattice_memory(recipe));
    parts.retain(|p| p.1 > 0);
    parts
}

/// Triangles of an imported terrain; 0 for other terrains.
fn terrain_triangles(recipe: &Recipe) -> u64 {
    match recipe.terrain.as_ref().and_then(|t| t.file.as_ref()) {
        Some(TerrainFile::Mesh(imported)) => imported.mesh.triangles.len() as u64,
        _ => 0,
    }
}

/// Bytes of a picture's samples in memory, without mipmaps.
pub(crate) fn decoded_bytes(image: &Image) -> u64 {
    let deep = if matches!(image.pixels, Pixels::U16(_)) { 2 } else { 1 };
    u64::from(image.width) * u64::from(image.height) * u64::from(image.channels) * deep
}
