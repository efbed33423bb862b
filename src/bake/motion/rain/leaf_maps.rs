//! Leaves with water maps of their own: each becomes a mesh with its own material and map sequence.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::Vec3;

use crate::bake::motion::rain::scene_leaf::{LeafInstance, SceneLeaf, WETNESS};
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::math::{self, narrow};
use osier_motion::rain::{LeafMaps, LeafSurface, UvRaster};
use osier_scene::{
    Asset, AssetFrame, Coat, InstanceState, Instancer, InstancerFrame, InstancerMotion, MapEncoding, MapFrame,
    MapLayer, MapSequence, MapTexels, Material, Mesh, MeshMotion, MeshObject, SkinWeights, Subset, Trs,
};

/// Albedo of a wet leaf as a share of that of a dry one: light is caught in the film of water. Own: chosen by eye against
/// photographs of wet leaves, 0.4..0.8; a smaller value darkens wet leaves in previews and POV-Ray.
const WET_ALBEDO: f32 = 0.55;

/// The layers of every leaf's map sequence.
const LAYERS: [MapLayer; 3] = [
    MapLayer { name: "height", file_kind: "exr.height", encoding: MapEncoding::Height },
    MapLayer { name: WETNESS, file_kind: "exr.wetness", encoding: MapEncoding::Unit },
    MapLayer { name: "normal", file_kind: "exr.normal", encoding: MapEncoding::Normal },
];

/// The layer of water thickness, on request. The blade of the mesh has no relief of its own, so the height map is the water's
/// thickness, and both layers share its memory.
const WATER_LAYER: MapLayer = MapLayer { name: "water", file_kind: "exr.water", encoding: MapEncoding::Thickness };

/// A leaf's maps in the order of [`LAYERS`]; `water`: with [`WATER_LAYER`].
pub fn map_frame(maps: &LeafMaps, water: bool) -> MapFrame {
    let height = || MapTexels::Scalar(Arc::clone(&maps.height));
    let layers = [height(), MapTexels::Scalar(Arc::clone(&maps.wetness)), MapTexels::Vector(Arc::clone(&maps.normal))];
    MapFrame { layers: layers.into_iter().chain(water.then(height)).collect() }
}

/// Per asset, instancer and instance: whether the instance stays in its instancer.
pub type InstanceMasks = Vec<Vec<Vec<bool>>>;

/// Rasters of the mapped leaves' texture coordinates; leaves with one blade share one. `side`: texels.
pub fn uv_rasters(leaves: &[SceneLeaf], mapped_leaves: &[usize], side: usize) -> Vec<Arc<UvRaster>> {
    let mut rasters: Vec<(Arc<LeafSurface>, Arc<UvRaster>)> = Vec::new();
    mapped_leaves
        .iter()
        .map(|i| {
            let surface = &leaves[*i].surface;
            let known = rasters.iter().find(|(s, _)| Arc::ptr_eq(s, surface)).map(|(_, r)| Arc::clone(r));
            known.unwrap_or_else(|| {
                let raster = Arc::new(UvRaster::new(surface, side));
                rasters.push((Arc::clone(surface), Arc::clone(&raster)));
                raster
            })
        })
        .collect()
}

/// Takes mapped leaves out of their instancers and adds each as a mesh with a wet material and a map sequence.
/// # Errors
/// `TooMany` beyond 2^32 sequences or materials.
pub fn add_leaf_maps(
    assets: &mut [Asset],
    materials: &mut Vec<Material>,
    leaves: &[SceneLeaf],
    mapped_leaves: &[usize],
    recipe: &Recipe,
) -> Result<(Vec<MapSequence>, InstanceMasks)> {
    // Number of each leaf on its plant, which names its mesh and maps.
    let mut leaf_counts = vec![0_usize; assets.len()];
    let mut numbers = vec![0_usize; leaves.len()];
    for (number, leaf) in numbers.iter_mut().zip(leaves) {
        *number = leaf_counts[leaf.instance.asset];
        leaf_counts[leaf.instance.asset] += 1;
    }
    let mut sequences = Vec::new();
    let mut removed: BTreeSet<LeafInstance> = BTreeSet::new();
    for i in mapped_leaves {
        let leaf = &leaves[*i];
        let LeafInstance { asset, instancer, instance } = leaf.instance;
        let asset = &mut assets[asset];
        let instancer = &asset.instancers[instancer];
        let prototype = &instancer.prototypes[to_usize(instancer.protos[instance])];
        let id = format!("l{:04}", numbers[*i]);
        let name = format!("{}_{id}", asset.id);
        let trs = instancer.transform(&instancer.rest, instance);
        let mut mesh = transform_mesh(&prototype.mesh, &trs);
        let sequence = index(sequences.len(), "leaves with maps")?;
        assign_wet_material(&mut mesh, materials, &name, sequence)?;
        let skin = leaf.joint.map(|j| SkinWeights {
            joints: vec![[j, 0, 0, 0]; mesh.points.len()],
            weights: vec![[1.0, 0.0, 0.0, 0.0]; mesh.points.len()],
        });
        let motion = if skin.is_some() { MeshMotion::Skinned } else { MeshMotion::Still };
        asset.meshes.push(MeshObject { name: format!("leaf_{id}"), mesh, motion, skin });
        sequences.push(MapSequence {
            name,
            side: to_usize(recipe.maps.resolution),
            height_range: narrow(recipe.maps.height_range),
            layers: LAYERS.into_iter().chain(recipe.maps.water.then_some(WATER_LAYER)).collect(),
            rest: None,
        });
        removed.insert(leaf.instance);
    }
    // Filter the instancers; those that lose their last leaf are removed.
    let mut kept = InstanceMasks::new();
    for (a, asset) in assets.iter_mut().enumerate() {
        let is_kept = |instancer, instance| !removed.contains(&LeafInstance { asset: a, instancer, instance });
        let mask = |(n, i): (usize, &Instancer)| (0..i.len()).map(|k| is_kept(n, k)).collect();
        let masks: Vec<Vec<bool>> = asset.instancers.iter().enumerate().map(mask).collect();
        asset.instancers.iter_mut().zip(&masks).for_each(|(i, keep)| retain_instances(i, keep));
        asset.instancers.retain(|i| !i.is_empty());
        kept.push(masks);
    }
    Ok((sequences, kept))
}

/// Replaces each material of a leaf by a copy with a coat of water, which reads map sequence `sequence`.
fn assign_wet_material(mesh: &mut Mesh, materials: &mut Vec<Material>, name: &str, sequence: u32) -> Result<()> {
    let mut own: BTreeMap<u32, u32> = BTreeMap::new();
    for Subset { material, .. } in &mut mesh.subsets {
        let next = index(materials.len(), "materials of a scene")?;
        let id = *own.entry(*material).or_insert(next);
        if id == next
            && let Some(plain) = materials.get(*material as usize).cloned()
        {
            let suffix = if own.len() > 1 { format!("_{}", own.len()) } else { String::new() };
            let coat = Some(Coat { sequence, weight: WETNESS, darkening: WET_ALBEDO });
            materials.push(Material { name: format!("{name}{suffix}"), coat, ..plain });
        }
        *material = id;
    }
    Ok(())
}

fn transform_mesh(mesh: &Mesh, trs: &Trs) -> Mesh {
    Mesh {
        points: mesh.points.iter().map(|p| trs.apply(*p)).collect(),
        normals: mesh.normals.iter().map(|n| math::normalize_or(trs.r * *n, Vec3::Y)).collect(),
        ..mesh.clone()
    }
}

fn retain_masked<T>(list: &mut Vec<T>, keep: &[bool]) {
    let mut k = 0;
    list.retain(|_| {
        k += 1;
        keep.get(k - 1).copied().unwrap_or(true)
    });
}

/// Keeps the instances whose flag in `keep` is set.
fn retain_instances(instancer: &mut Instancer, keep: &[bool]) {
    retain_masked(&mut instancer.ids, keep);
    retain_masked(&mut instancer.protos, keep);
    retain_masked(&mut instancer.scales, keep);
    retain_states(&mut instancer.rest, keep);
    if let InstancerMotion::Joints(joints) = &mut instancer.motion {
        retain_masked(joints, keep);
    }
}

fn retain_states(state: &mut InstanceState, keep: &[bool]) {
    retain_masked(&mut state.positions, keep);
    retain_masked(&mut state.orientations, keep);
    retain_masked(&mut state.alive, keep);
    retain_masked(&mut state.velocities, keep);
    retain_masked(&mut state.angular_velocities, keep);
    state.attributes.iter_mut().for_each(|a| a.data.retain(keep));
}

/// Keeps the same instances in a frame of the asset.
pub fn retain_frame_instances(frame: &mut AssetFrame, masks: &[Vec<bool>]) {
    for (state, keep) in frame.instancers.iter_mut().zip(masks) {
        if let InstancerFrame::State(state) = state {
            retain_states(state, keep);
        }
    }
    let mut masks = masks.iter();
    frame.instancers.retain(|_| masks.next().is_none_or(|keep| keep.contains(&true)));
}
