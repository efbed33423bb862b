//! Leaves with individual water maps: each becomes a mesh with a separate material and map sequence.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::Vec3;

use crate::bake::motion::rain::chart_textures;
use crate::bake::motion::rain::scene_leaf::{LeafInstanceIndex, SceneLeaf, SelectedLeaf, WETNESS};
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::math::{self, narrow};
use osier_motion::rain::{LeafMaps, LeafSurface, MaterialHeightMap, UvRaster};
use osier_scene::{
    Asset, AssetFrame, Coat, Image, Instancer, InstancerFrame, InstancerMotion, MapEncoding, MapFrame, MapLayer,
    MapSequence, MapTexels, Maps, Material, Mesh, MeshMotion, MeshObject, Prototype, SkinWeights, Subset, Trs,
};

/// The layers that every leaf's map sequence has, in their order.
const LAYERS: [MapLayer; 3] = [
    MapLayer { name: "height", file_kind: "exr.height", encoding: MapEncoding::Height },
    MapLayer { name: WETNESS, file_kind: "exr.wetness", encoding: MapEncoding::Unit },
    MapLayer { name: "normal", file_kind: "exr.normal", encoding: MapEncoding::Normal },
];

/// The layer of water thickness, which follows [`LAYERS`] if the key `maps.water` is set.
const WATER_LAYER: MapLayer = MapLayer { name: "water", file_kind: "exr.water", encoding: MapEncoding::Thickness };

/// A leaf's maps in the order of [`LAYERS`]; `water`: with [`WATER_LAYER`].
pub fn leaf_map_frame(maps: &LeafMaps, water: bool) -> MapFrame {
    let scalar = |map: &Arc<Vec<f32>>| MapTexels::Scalar(Arc::clone(map));
    let layers = [scalar(&maps.height), scalar(&maps.wetness), MapTexels::Vector(Arc::clone(&maps.normal))];
    MapFrame { layers: layers.into_iter().chain(water.then(|| scalar(&maps.water))).collect() }
}

/// Record of the leaves of an asset that were separated because they have maps, with which each frame is separated in the same
/// way.
#[derive(Debug, Clone, Default)]
pub struct SeparatedLeaves {
    /// Per instancer and instance: whether the instance stays in its instancer.
    kept: Vec<Vec<bool>>,
    /// Whether the separated leaves are instances of additional instancers after the original ones; otherwise they are meshes.
    instanced: bool,
}

/// Rasters of the charts of mapped leaves with the relief of their materials, parallel to these; leaves with the same blade and
/// map size share one.
pub fn build_uv_rasters(
    leaves: &[SceneLeaf],
    mapped_leaves: &[SelectedLeaf],
    assets: &[Asset],
    materials: &[Material],
    images: &[Image],
) -> Vec<Arc<UvRaster>> {
    let mut rasters: Vec<(Arc<LeafSurface>, usize, Arc<UvRaster>)> = Vec::new();
    mapped_leaves
        .iter()
        .map(|mapped| {
            let (leaf, side) = (&leaves[mapped.leaf], mapped.side);
            // A scene has few distinct blades: a linear search by identity of the surface is enough.
            let known = rasters.iter().find(|(surface, s, _)| Arc::ptr_eq(surface, &leaf.surface) && *s == side);
            let known = known.map(|(.., raster)| Arc::clone(raster));
            known.unwrap_or_else(|| {
                let relief = MaterialHeightMap::of_first_mapped_material(
                    &prototype_of_instance(assets, leaf.instance).mesh,
                    materials,
                    images,
                );
                let raster = Arc::new(UvRaster::new(&leaf.surface, side, relief.as_ref()));
                rasters.push((Arc::clone(&leaf.surface), side, Arc::clone(&raster)));
                raster
            })
        })
        .collect()
}

fn prototype_of_instance(assets: &[Asset], of: LeafInstanceIndex) -> &Prototype {
    let instancer = &assets[of.asset].instancers[of.instancer];
    &instancer.prototypes[to_usize(instancer.protos[of.instance])]
}

/// Map sequences and textures that leaves with maps add to a scene.
pub struct AddedLeafMaps {
    pub sequences: Vec<MapSequence>,
    /// Textures resampled to charts, to be appended to those of the scene.
    pub images: Vec<Image>,
    /// Which leaves were separated, parallel to the assets.
    pub separated: Vec<SeparatedLeaves>,
}

/// Removes mapped leaves from their instancers and gives each a mesh with a wet material and a map sequence. Leaves that move
/// relative to their joints stay instances, each with a separate prototype, so that a frame carries one transform instead of all
/// points. `images`: textures of the scene; empty in an estimate.
/// # Errors
/// `TooMany` beyond 2^32 sequences, materials or images.
pub fn add_leaf_maps(
    assets: &mut [Asset],
    materials: &mut Vec<Material>,
    images: &[Image],
    leaves: &[SceneLeaf],
    mapped_leaves: &[SelectedLeaf],
    recipe: &Recipe,
) -> Result<AddedLeafMaps> {
    // Number of each leaf on its plant, which is part of the names of its mesh and maps.
    let mut leaf_counts = vec![0_usize; assets.len()];
    let mut numbers = vec![0_usize; leaves.len()];
    for (number, leaf) in numbers.iter_mut().zip(leaves) {
        *number = leaf_counts[leaf.instance.asset];
        leaf_counts[leaf.instance.asset] += 1;
    }
    let mut sequences = Vec::new();
    let mut new_images = Vec::new();
    let mut charted = ChartedMaterials::default();
    let mut removed: BTreeSet<LeafInstanceIndex> = BTreeSet::new();
    let mut prototypes: BTreeMap<LeafInstanceIndex, Prototype> = BTreeMap::new();
    for mapped in mapped_leaves {
        let leaf = &leaves[mapped.leaf];
        let LeafInstanceIndex { asset, instancer, instance } = leaf.instance;
        let of_prototype = &prototype_of_instance(assets, leaf.instance).mesh;
        // If a blade has a separate chart, its textures are resampled to it.
        let mut mesh = match leaf.surface.chart() {
            Some(chart) => {
                let mut mesh = chart.apply_to(of_prototype);
                let has_textures = of_prototype.uvs.len() == of_prototype.points.len();
                charted.assign(&mut mesh, &leaf.surface, has_textures, materials, images, &mut new_images)?;
                mesh
            }
            None => of_prototype.clone(),
        };
        let asset = &mut assets[asset];
        let instancer = &asset.instancers[instancer];
        let id = format!("l{:04}", numbers[mapped.leaf]);
        let name = format!("{}_{id}", asset.id);
        let sequence = index(sequences.len(), "leaves with maps")?;
        assign_wet_material(&mut mesh, materials, &name, sequence)?;
        let mesh_name = format!("leaf_{id}");
        // A leaf that moves freely stays an instance, with its mesh as a prototype; one that is fixed to its joint becomes part of the
        // asset's skinned meshes.
        if leaf.moves_off_joint {
            prototypes.insert(leaf.instance, Prototype::new(mesh_name, mesh));
        } else {
            transform_mesh(&mut mesh, &instancer.transform(&instancer.rest, instance));
            let skin = leaf.joint.map(|j| SkinWeights {
                joints: vec![[j, 0, 0, 0]; mesh.points.len()],
                weights: vec![[1.0, 0.0, 0.0, 0.0]; mesh.points.len()],
            });
            let motion = if skin.is_some() { MeshMotion::Skinned } else { MeshMotion::Still };
            asset.meshes.push(MeshObject { name: mesh_name, mesh, motion, skin });
        }
        sequences.push(MapSequence {
            name,
            side: mapped.side,
            height_range: narrow(recipe.maps.height_range),
            layers: LAYERS.into_iter().chain(recipe.maps.water.then_some(WATER_LAYER)).collect(),
            rest: None,
        });
        // Remove instances only after all leaves are processed, because their indices must not shift before.
        removed.insert(leaf.instance);
    }
    // Filter the instancers; remove those without remaining leaves.
    let mut separated = Vec::new();
    for (a, asset) in assets.iter_mut().enumerate() {
        let is_kept = |instancer, instance| !removed.contains(&LeafInstanceIndex { asset: a, instancer, instance });
        let mask = |(n, i): (usize, &Instancer)| (0..i.len()).map(|k| is_kept(n, k)).collect();
        let kept: Vec<Vec<bool>> = asset.instancers.iter().enumerate().map(mask).collect();
        let mut own: Vec<Vec<Prototype>> = vec![Vec::new(); kept.len()];
        // The map is sorted by asset, instancer and instance, which is the order of assets here and of instances in an instancer.
        while let Some(first) = prototypes.first_entry().filter(|first| first.key().asset == a) {
            own[first.key().instancer].push(first.remove());
        }
        let instanced = own.iter().any(|list| !list.is_empty());
        let wet: Vec<Instancer> = asset
            .instancers
            .iter()
            .zip(own)
            .zip(&kept)
            .filter(|((_, own), _)| !own.is_empty())
            .map(|((instancer, own), keep)| wet_instancer(instancer, own, keep))
            .collect();
        asset.instancers.iter_mut().zip(&kept).for_each(|(i, keep)| i.retain(keep));
        asset.instancers.retain(|i| !i.is_empty());
        asset.instancers.extend(wet);
        separated.push(SeparatedLeaves { kept, instanced });
    }
    Ok(AddedLeafMaps { sequences, images: new_images, separated })
}

/// An instancer of the instances that do not stay in `instancer`, each with a separate prototype.
fn wet_instancer(instancer: &Instancer, prototypes: Vec<Prototype>, keep: &[bool]) -> Instancer {
    let mut wet = instancer.clone();
    wet.retain(&inverted(keep));
    wet.name = format!("{}_with_maps", instancer.name);
    // The blades move under the load of drops: frames write their transforms instead of following the joints.
    wet.motion = InstancerMotion::Free;
    wet.protos = (0..).take(prototypes.len()).collect();
    wet.prototypes = prototypes;
    wet
}

fn inverted(mask: &[bool]) -> Vec<bool> {
    mask.iter().map(|keep| !keep).collect()
}

/// Materials whose textures were resampled to the chart of a blade; leaves with the same blade share them.
#[derive(Default)]
struct ChartedMaterials {
    /// Blade and material, and the material that replaces it.
    done: Vec<(Arc<LeafSurface>, u32, u32)>,
}

impl ChartedMaterials {
    /// Assigns materials whose textures lie in the chart to a mesh with that chart as texture coordinates. A mesh that had no
    /// texture coordinates before gets materials without textures.
    fn assign(
        &mut self,
        mesh: &mut Mesh,
        surface: &Arc<LeafSurface>,
        has_textures: bool,
        materials: &mut Vec<Material>,
        images: &[Image],
        new_images: &mut Vec<Image>,
    ) -> Result<()> {
        for subset in &mut mesh.subsets {
            let known = self.done.iter().find(|(s, m, _)| Arc::ptr_eq(s, surface) && *m == subset.material);
            if let Some((_, _, replacement)) = known {
                subset.material = *replacement;
                continue;
            }
            let Some(plain) = materials.get(subset.material as usize).cloned() else { continue };
            // Names with the number of the chart are unique.
            let suffix = format!("_chart{}", self.done.len());
            let maps = if has_textures {
                chart_textures::resample_to_charts(surface, &plain, images, &suffix, new_images)?
            } else {
                Maps::default()
            };
            let replacement = index(materials.len(), "materials of a scene")?;
            materials.push(Material { name: format!("{}{suffix}", plain.name), maps, ..plain });
            self.done.push((Arc::clone(surface), subset.material, replacement));
            subset.material = replacement;
        }
        Ok(())
    }
}

/// Replaces each material of a leaf by a copy with a coat of water, which reads map sequence `sequence`.
fn assign_wet_material(mesh: &mut Mesh, materials: &mut Vec<Material>, name: &str, sequence: u32) -> Result<()> {
    let mut own: BTreeMap<u32, u32> = BTreeMap::new();
    for Subset { material, .. } in &mut mesh.subsets {
        let next = index(materials.len(), "materials of a scene")?;
        let id = *own.entry(*material).or_insert(next);
        // Only the first subset with a material makes the copy; for others `entry` returns the existing copy.
        if id == next
            && let Some(plain) = materials.get(*material as usize).cloned()
        {
            let suffix = if own.len() > 1 { format!("_{}", own.len()) } else { String::new() };
            let coat = Some(Coat { sequence, weight: WETNESS, darkening: Coat::WET_ALBEDO });
            materials.push(Material { name: format!("{name}{suffix}"), coat, ..plain });
        }
        *material = id;
    }
    Ok(())
}

fn transform_mesh(mesh: &mut Mesh, trs: &Trs) {
    mesh.points.iter_mut().for_each(|p| *p = trs.apply(*p));
    mesh.normals.iter_mut().for_each(|n| *n = math::normalize_or(trs.r * *n, Vec3::Y));
}

/// Separates the leaves with maps in a frame of the asset as they were separated in the asset itself.
pub fn separate_frame_instances(frame: &mut AssetFrame, leaves: &SeparatedLeaves) {
    let mut wet = Vec::new();
    for (of_instancer, keep) in frame.instancers.iter_mut().zip(&leaves.kept) {
        let separates = leaves.instanced && keep.contains(&false);
        if let InstancerFrame::State(state) = of_instancer {
            if separates {
                let mut separate = state.clone();
                separate.retain(&inverted(keep));
                wet.push(InstancerFrame::State(separate));
            }
            state.retain(keep);
        } else if separates {
            wet.push(InstancerFrame::Same);
        }
    }
    // As in the asset: instancers without leaves are removed, and instancers of mapped leaves are appended.
    let mut masks = leaves.kept.iter();
    frame.instancers.retain(|_| masks.next().is_none_or(|keep| keep.contains(&true)));
    frame.instancers.extend(wet);
}
