//! Copies of a plant that share meshes: an instanced node for each mesh in `web`, a node for each copy in `blender`.
//!
//! glTF cannot instance a skin, so each swaying copy costs a skeleton and its keys. A file has a budget of skins; the copies
//! beyond it do not move, but have the attributes by which shaders can sway them.

use std::collections::{BTreeMap, BTreeSet};

use glam::Quat;

use super::Profile;
use super::document::{GeometryKind, GltfDocument, check_finite, node_with_extras};
use super::instances::{InstanceGroup, live_by_prototype};
use super::json::Index;
use super::meshes::{MeshSource, StoredMesh};
use super::quantize::place_stored;
use super::stream::Stream;
use crate::Warning;
use crate::merge::merge_asset;
use osier_base::Result;
use osier_scene::{Asset, InstancerMotion, MeshMotion, Placement, Trs, ribbons};

/// Most transforms (copies times leaves of each) of an instanced node. At 32 bytes each it limits an accessor to 6 MB; copies
/// beyond it get further nodes.
const MAX_NODE_TRANSFORMS: usize = 200_000;
/// Most draw calls of the `web` profile for leaves attached to joints, over all swaying placements: one call per
/// prototype and joint. Own: with bark, ground and copies a scene stays below 500 calls, which browsers on phones draw
/// at 60 Hz; a larger value keeps more joints.
const MAX_LEAF_DRAW_CALLS: usize = 300;
/// Fewest joints of a swaying plant, however many there are. Own: trunk and main branches still bend.
const MIN_JOINTS: usize = 8;

/// Whether a placement of a moving asset needs a skeleton: a mesh with a skin or an instancer on joints.
fn is_skinned(asset: &Asset) -> bool {
    asset.skeleton.is_some()
        && (asset.meshes.iter().any(|m| m.skin.is_some() && m.motion != MeshMotion::Still)
            || asset.instancers.iter().any(|i| matches!(i.motion, InstancerMotion::Joints(_))))
}

/// Whether nodes with shared meshes can represent all of an asset at rest: no free instances, morphs, points or moving curves.
fn is_sharable(asset: &Asset) -> bool {
    let free = asset.instancers.iter().any(|i| i.motion == InstancerMotion::Free);
    let morphs = asset.meshes.iter().any(|m| m.motion != MeshMotion::Still && m.skin.is_none());
    !free && !morphs && asset.points.is_empty() && !asset.curves.iter().any(|c| c.moving)
}

impl GltfDocument<'_> {
    /// Selects the placements that share meshes: static assets with several placements, and swaying ones beyond the budget of
    /// skins (X021). Skins go to plants with few copies first, then to those nearest to the camera.
    pub(super) fn choose_copies(&mut self, placements: &[Placement]) -> BTreeSet<usize> {
        let scene = self.input.scene;
        let moves = !self.input.tracks.is_still();
        let (mut placements_of_asset, mut placements_of_group): (BTreeMap<usize, usize>, BTreeMap<&str, usize>) =
            Default::default();
        for p in placements {
            *placements_of_asset.entry(p.asset).or_default() += 1;
            let group = scene.assets.get(p.asset).map_or("", |a| a.group.as_str());
            *placements_of_group.entry(group).or_default() += 1;
        }
        // Static assets with several placements always share. Swaying ones are ranked by the number of placements of their plant,
        // then by distance from the camera. The bits of floats that are not negative sort as the floats do.
        let mut copies = BTreeSet::new();
        let mut swaying = Vec::new();
        for (i, p) in placements.iter().enumerate() {
            let Some(asset) = scene.assets.get(p.asset).filter(|a| !a.group.is_empty() && is_sharable(a)) else {
                continue;
            };
            if moves && is_skinned(asset) {
                let distance = (p.transform.t - scene.camera.eye).length_squared().to_bits();
                swaying.push((placements_of_group.get(asset.group.as_str()).copied().unwrap_or(1), distance, i));
            } else if !asset.moves() || !moves {
                copies.extend(placements_of_asset.get(&p.asset).filter(|n| **n > 1).map(|_| i));
            }
        }
        swaying.sort_unstable();
        let excess = swaying.split_off(self.input.options.skins.min(swaying.len()));
        if !excess.is_empty() {
            let message = format!(
                "{} of {} plants that sway stand still in glTF, which cannot share skins: the farthest from the camera; \
                 output.gltf.skins = {} lets all sway, USD has all of them",
                excess.len(),
                excess.len() + swaying.len(),
                excess.len() + swaying.len()
            );
            self.warnings.push(Warning { code: "X021", message });
        }
        copies.extend(excess.iter().map(|(.., i)| *i));
        if self.input.options.profile == Profile::Web && moves {
            self.max_joints = self.joints_within_draw_calls(placements, &copies);
        }
        copies
    }

    /// Largest number of joints of each swaying plant with which the scene stays within [`MAX_LEAF_DRAW_CALLS`].
    fn joints_within_draw_calls(&self, placements: &[Placement], copies: &BTreeSet<usize>) -> usize {
        let riding = |p: &Placement| {
            let asset = self.input.scene.assets.get(p.asset)?;
            let joints = asset.instancers.iter().filter(|i| matches!(i.motion, InstancerMotion::Joints(_)));
            Some(joints.map(|i| i.prototypes.len()).sum::<usize>())
        };
        let swaying = placements.iter().enumerate().filter(|(i, _)| !copies.contains(i));
        let prototypes: usize = swaying.filter_map(|(_, p)| riding(p)).sum();
        // Each joint of a swaying plant costs a draw call for each prototype on it: limit = calls / sum of prototypes.
        // Without instances there is no limit; the minimum keeps a forest of many plants from becoming rigid.
        MAX_LEAF_DRAW_CALLS.checked_div(prototypes).map_or(super::rig::MAX_JOINTS, |n| n.max(MIN_JOINTS))
    }

    /// Adds the placements selected by [`Self::choose_copies`], at rest.
    pub(super) fn add_copies(&mut self, placements: &[Placement], copies: &BTreeSet<usize>) -> Result<()> {
        // A map with sorted keys: assets are written in the order of the scene, whatever the order of the placements.
        let mut by_asset: BTreeMap<usize, Vec<&Placement>> = BTreeMap::new();
        for p in copies.iter().filter_map(|i| placements.get(*i)) {
            check_finite(&p.transform, || format!("placement {}", p.name))?;
            by_asset.entry(p.asset).or_default().push(p);
        }
        for (index, list) in by_asset {
            let Some(asset) = self.input.scene.assets.get(index) else { continue };
            match self.input.options.profile {
                Profile::Web => self.add_copies_as_instances(asset, &list)?,
                Profile::Blender | Profile::Engine => self.add_copies_as_nodes(asset, &list)?,
            }
        }
        Ok(())
    }

    /// A node for each copy, all with one mesh of all geometry of the plant.
    fn add_copies_as_nodes(&mut self, asset: &Asset, list: &[&Placement]) -> Result<()> {
        let mut mesh_data = merge_asset(asset)?;
        for curves in &asset.curves {
            let tile = self.input.scene.materials.get(curves.material as usize).map_or(1.0, |m| m.tile);
            mesh_data.append(&ribbons(curves, &curves.points, tile));
        }
        let label = format!("asset {}", asset.id);
        let mesh_source = MeshSource::of(&asset.id, &label, &mesh_data);
        let Some(mesh) = self.add_mesh(mesh_source)? else { return Ok(()) };
        for p in list {
            let place = place_stored(&p.transform, mesh.cube);
            let mut node = node_with_extras(p.name.clone(), &place, asset.id.clone(), asset.kind.word());
            node.mesh = Some(mesh.index);
            let node = self.add_node(node)?;
            self.attach_node(None, node);
        }
        Ok(())
    }

    /// An instanced node for each mesh and each prototype of the plant, with the transforms of all copies.
    fn add_copies_as_instances(&mut self, asset: &Asset, list: &[&Placement]) -> Result<()> {
        let transforms: Vec<Trs> = list.iter().map(|p| p.transform).collect();
        for object in &asset.meshes {
            let label = format!("asset {}, mesh {}", asset.id, object.name);
            let mesh_source = MeshSource::of(&object.name, &label, &object.mesh);
            if let Some(mesh) = self.add_mesh(mesh_source)? {
                let name = format!("{}_{}", asset.id, object.name);
                self.add_instanced_node(&name, mesh, &transforms, BTreeMap::new(), asset)?;
            }
        }
        for curves in &asset.curves {
            let label = format!("asset {}, curves {}", asset.id, curves.name);
            let tile = self.input.scene.materials.get(curves.material as usize).map_or(1.0, |m| m.tile);
            let mesh = ribbons(curves, &curves.points, tile);
            let mesh_source =
                MeshSource { geometry: GeometryKind::Ribbon, ..MeshSource::of(&curves.name, &label, &mesh) };
            if let Some(mesh) = self.add_mesh(mesh_source)? {
                let name = format!("{}_{}", asset.id, curves.name);
                self.add_instanced_node(&name, mesh, &transforms, BTreeMap::new(), asset)?;
            }
        }
        for instancer in &asset.instancers {
            let label = format!("asset {}, instancer {}", asset.id, instancer.name);
            for (proto, members) in live_by_prototype(instancer, &instancer.rest).into_iter().enumerate() {
                if members.is_empty() {
                    continue;
                }
                let Some(mesh) = self.add_prototype_mesh(instancer, proto, &label)? else { continue };
                let name = format!("{}_{}_{}", asset.id, instancer.name, instancer.prototypes[proto].name);
                // Instances of instances: each instance of the plant, then the transform of each copy; copies x
                // instances in all.
                let own: Vec<Trs> = members.iter().map(|i| instancer.transform(&instancer.rest, *i)).collect();
                let group = InstanceGroup { instancer, state: &instancer.rest, proto, members, label: &label };
                // All copies in one node, or in as few as the limit allows.
                // A plant with more leaves than the limit still gets at least one copy per node.
                for transforms in transforms.chunks((MAX_NODE_TRANSFORMS / own.len()).max(1)) {
                    let all: Vec<Trs> = transforms.iter().flat_map(|s| own.iter().map(|o| s.then_inner(o))).collect();
                    let turns: Vec<Quat> = transforms.iter().map(|s| s.r).collect();
                    let custom = self.leaf_attributes(&group, &turns)?;
                    self.add_instanced_node(&name, mesh, &all, custom, asset)?;
                }
            }
        }
        Ok(())
    }

    /// A root node that shows a mesh once per transform, by EXT_mesh_gpu_instancing; `transforms` are in the space of the scene,
    /// `custom` has further attributes of these instances.
    fn add_instanced_node(
        &mut self,
        name: &str,
        mesh: StoredMesh,
        transforms: &[Trs],
        custom: BTreeMap<String, Index>,
        asset: &Asset,
    ) -> Result<()> {
        let places: Vec<Trs> = transforms.iter().map(|t| place_stored(t, mesh.cube)).collect();
        let mut extensions =
            self.add_instancing(&places, Stream::KEY_ROTATIONS, &format!("asset {}, copies", asset.id))?;
        extensions.instancing.attributes.custom = custom;
        let extensions = Some(extensions);
        let base = node_with_extras(name.to_owned(), &Trs::IDENTITY, asset.id.clone(), "instancer");
        let node = self.add_node(super::json::Node { mesh: Some(mesh.index), extensions, ..base })?;
        self.attach_node(None, node);
        Ok(())
    }
}
