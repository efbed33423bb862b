//! Leaves that have maps of their own water: each a mesh with a material of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::Vec3;

use crate::bake::motion::rain::{SceneLeaf, WETNESS};
use crate::recipe::Recipe;
use osier_base::math::{self, narrow};
use osier_base::{Error, Result};
use osier_motion::rain::{LeafMaps, LeafSurface, UvRaster};
use osier_scene::{
    Asset, AssetFrame, Coat, InstanceState, Instancer, InstancerFrame, InstancerMotion, MapEncoding, MapFrame,
    MapLayer, MapSequence, MapTexels, Material, Mesh, MeshMotion, MeshObject, SkinWeights, Subset, Trs,
};

/// Albedo of a wet leaf as a share of that of a dry one: light is caught in the film of water. Own: chosen by eye against
/// photographs of wet leaves, 0.4..0.8; a smaller value darkens wet leaves in previews and POV-Ray.
const WET_ALBEDO: f32 = 0.55;

/// The maps of a leaf.
const LAYERS: [MapLayer; 3] = [
    MapLayer { name: "height", file_kind: "exr.height", encoding: MapEncoding::Height },
    MapLayer { name: WETNESS, file_kind: "exr.wetness", encoding: MapEncoding::Unit },
    MapLayer { name: "normal", file_kind: "exr.normal", encoding: MapEncoding::Normal },
];

/// The map of water alone, on request. A blade without relief has no other height, so that it shares the first map's memory.
const WATER_LAYER: MapLayer = MapLayer { name: "water", file_kind: "exr.water", encoding: MapEncoding::Thickness };

/// A leaf's maps in the order of [`LAYERS`]; `water`: with [`WATER_LAYER`].
pub fn map_frame(maps: &LeafMaps, water: bool) -> MapFrame {
    let height = || MapTexels::Scalar(Arc::clone(&maps.height));
    let layers = [height(), MapTexels::Scalar(Arc::clone(&maps.wetness)), MapTexels::Vector(Arc::clone(&maps.normal))];
    MapFrame { layers: layers.into_iter().chain(water.then(height)).collect() }
}

/// Per asset, per instancer, per instance: whether it is still one.
pub type InstanceMasks = Vec<Vec<Vec<bool>>>;

/// One chart per form of leaf.
pub fn charts(found: &[SceneLeaf], mapped_leaves: &[usize], side: usize) -> Vec<Arc<UvRaster>> {
    let mut made: Vec<(Arc<LeafSurface>, Arc<UvRaster>)> = Vec::new();
    mapped_leaves
        .iter()
        .map(|i| {
            let sheet = &found[*i].sheet;
            let known = made.iter().find(|(s, _)| Arc::ptr_eq(s, sheet)).map(|(_, c)| Arc::clone(c));
            known.unwrap_or_else(|| {
                let chart = Arc::new(UvRaster::new(sheet, side));
                made.push((Arc::clone(sheet), Arc::clone(&chart)));
                chart
            })
        })
        .collect()
}

/// Takes leaves with maps out of their instancers and shows each as a mesh with a material of its own.
pub fn add_leaf_maps(
    assets: &mut [Asset],
    materials: &mut Vec<Material>,
    found: &[SceneLeaf],
    mapped_leaves: &[usize],
    stands: &[Trs],
    recipe: &Recipe,
) -> Result<(Vec<MapSequence>, InstanceMasks)> {
    let mut numbers = vec![0_usize; stands.len()];
    let mut number = vec![0_usize; found.len()];
    for (i, f) in found.iter().enumerate() {
        number[i] = numbers[f.at.0];
        numbers[f.at.0] += 1;
    }
    let mut sequences = Vec::new();
    let mut gone: BTreeSet<(usize, usize, usize)> = BTreeSet::new();
    for i in mapped_leaves {
        let f = &found[*i];
        let (a, n, k) = f.at;
        let asset = &mut assets[a];
        let instancer = &asset.instancers[n];
        let prototype = &instancer.prototypes[instancer.protos[k] as usize];
        let id = format!("l{:04}", number[*i]);
        let name = format!("{}_{id}", asset.id);
        let trs = instancer.transform(&instancer.rest, k);
        let mut mesh = moved(&prototype.mesh, &trs);
        let index = u32::try_from(sequences.len()).map_err(|_| Error::input("S004", "too many leaves with maps"))?;
        assign_wet_material(&mut mesh, materials, &name, index);
        let skin = f.joint.map(|j| SkinWeights {
            joints: vec![[j, 0, 0, 0]; mesh.points.len()],
            weights: vec![[1.0, 0.0, 0.0, 0.0]; mesh.points.len()],
        });
        let motion = if skin.is_some() { MeshMotion::Skinned } else { MeshMotion::Still };
        asset.meshes.push(MeshObject { name: format!("leaf_{id}"), mesh, motion, skin });
        sequences.push(MapSequence {
            name,
            side: recipe.maps.resolution as usize,
            height_range: narrow(recipe.maps.height_range),
            layers: LAYERS.into_iter().chain(recipe.maps.water.then_some(WATER_LAYER)).collect(),
            rest: None,
        });
        gone.insert(f.at);
    }
    let mut kept = InstanceMasks::new();
    for (a, asset) in assets.iter_mut().enumerate() {
        let mask = |(n, i): (usize, &Instancer)| (0..i.len()).map(|k| !gone.contains(&(a, n, k))).collect();
        let masks: Vec<Vec<bool>> = asset.instancers.iter().enumerate().map(mask).collect();
        asset.instancers.iter_mut().zip(&masks).for_each(|(i, keep)| thin(i, keep));
        asset.instancers.retain(|i| !i.is_empty());
        kept.push(masks);
    }
    Ok((sequences, kept))
}

/// Each material that a leaf wears as one of its own, with water.
fn assign_wet_material(mesh: &mut Mesh, materials: &mut Vec<Material>, name: &str, index: u32) {
    let mut own: BTreeMap<u32, u32> = BTreeMap::new();
    for Subset { material, .. } in &mut mesh.subsets {
        let next = u32::try_from(materials.len()).unwrap_or(u32::MAX);
        let id = *own.entry(*material).or_insert(next);
        if id == next
            && let Some(plain) = materials.get(*material as usize).cloned()
        {
            let suffix = if own.len() > 1 { format!("_{}", own.len()) } else { String::new() };
            let coat = Some(Coat { sequence: index, weight: WETNESS, darkening: WET_ALBEDO });
            materials.push(Material { name: format!("{name}{suffix}"), coat, ..plain });
        }
        *material = id;
    }
}

fn moved(mesh: &Mesh, trs: &Trs) -> Mesh {
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

/// Leaves some instances out.
fn thin(instancer: &mut Instancer, keep: &[bool]) {
    retain_masked(&mut instancer.ids, keep);
    retain_masked(&mut instancer.protos, keep);
    retain_masked(&mut instancer.scales, keep);
    thin_state(&mut instancer.rest, keep);
    if let InstancerMotion::Joints(joints) = &mut instancer.motion {
        retain_masked(joints, keep);
    }
}

fn thin_state(state: &mut InstanceState, keep: &[bool]) {
    retain_masked(&mut state.positions, keep);
    retain_masked(&mut state.orientations, keep);
    retain_masked(&mut state.alive, keep);
    retain_masked(&mut state.velocities, keep);
    retain_masked(&mut state.angular_velocities, keep);
    state.attributes.iter_mut().for_each(|a| a.data.retain(keep));
}

/// Leaves the same instances out of a frame.
pub fn thin_frame(frame: &mut AssetFrame, masks: &[Vec<bool>]) {
    for (state, keep) in frame.instancers.iter_mut().zip(masks) {
        if let InstancerFrame::State(state) = state {
            thin_state(state, keep);
        }
    }
    let mut masks = masks.iter();
    frame.instancers.retain(|_| masks.next().is_none_or(|keep| keep.contains(&true)));
}
