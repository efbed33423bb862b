//! Copies of a plant that share meshes: one instanced node for each mesh in `web`, one node for each copy in `blender`.
//!
//! glTF cannot instance a skin, so that a copy that sways costs a skeleton and its tracks. A file has a budget of them; the copies
//! beyond it stand still, with the attributes by which shaders sway them.

use std::collections::{BTreeMap, BTreeSet};

use super::Profile;
use super::document::{Document, finite, marked};
use super::instances::members;
use super::json::Index;
use super::materials::Shown;
use super::meshes::Drawn;
use crate::Warning;
use crate::merge::merged;
use osier_base::Result;
use osier_scene::{Asset, InstancerMotion, MeshMotion, Placement, Trs, ribbons};

/// Most transforms that an instanced node of copies holds: copies times the leaves of each: 32 bytes each, 6 MB of the file.
const TRANSFORMS: usize = 200_000;
/// Draw calls that `web` spends on leaves that ride on joints, over all placements that sway: a call is one prototype on one
/// joint. Own: with bark, ground and copies a scene stays below 500, which browsers of phones draw at 60 Hz.
const DRAWS: usize = 300;
/// Fewest joints of a plant that sways.
const FEWEST: usize = 8;

/// Whether a placement of an asset costs a skin.
fn is_skinned(asset: &Asset) -> bool {
    asset.skeleton.is_some()
        && (asset.meshes.iter().any(|m| m.skin.is_some() && m.motion != MeshMotion::Still)
            || asset.instancers.iter().any(|i| matches!(i.motion, InstancerMotion::Joints(_))))
}

/// Whether all of an asset can be shown at rest by shared meshes.
fn is_sharable(asset: &Asset) -> bool {
    let free = asset.instancers.iter().any(|i| i.motion == InstancerMotion::Free);
    let morphs = asset.meshes.iter().any(|m| m.motion != MeshMotion::Still && m.skin.is_none());
    !free && !morphs && asset.points.is_empty() && !asset.curves.iter().any(|c| c.moving)
}

impl Document<'_> {
    /// Chooses the placements that share meshes: still plants of which there are several, and swaying ones beyond the budget
    /// of skins. Those of plants with few copies keep their skins first, then those nearest to the camera.
    pub(super) fn share(&mut self, placements: &[Placement]) -> BTreeSet<usize> {
        let scene = self.from.scene;
        let moves = !self.from.tracks.is_still();
        let (mut several, mut grouped): (BTreeMap<usize, usize>, BTreeMap<&str, usize>) = Default::default();
        for p in placements {
            *several.entry(p.asset).or_default() += 1;
            let group = scene.assets.get(p.asset).map_or("", |a| a.group.as_str());
            *grouped.entry(group).or_default() += 1;
        }
        let mut shared = BTreeSet::new();
        let mut swaying = Vec::new();
        for (i, p) in placements.iter().enumerate() {
            let Some(asset) = scene.assets.get(p.asset).filter(|a| !a.group.is_empty() && is_sharable(a)) else {
                continue;
            };
            if moves && is_skinned(asset) {
                let far = (p.transform.t - scene.camera.eye).length_squared().to_bits();
                swaying.push((grouped.get(asset.group.as_str()).copied().unwrap_or(1), far, i));
            } else if !asset.moves() || !moves {
                shared.extend(several.get(&p.asset).filter(|n| **n > 1).map(|_| i));
            }
        }
        swaying.sort_unstable();
        let beyond = swaying.split_off(self.from.skins.min(swaying.len()));
        if !beyond.is_empty() {
            let message = format!(
                "{} of {} plants that sway stand still in glTF, which cannot share skins: the farthest from the camera; \
                 output.gltf.skins = {} lets all sway, USD has all of them",
                beyond.len(),
                beyond.len() + swaying.len(),
                beyond.len() + swaying.len()
            );
            self.warnings.push(Warning { code: "X021", message });
        }
        shared.extend(beyond.iter().map(|(.., i)| *i));
        if self.from.profile == Profile::Web && moves {
            self.joints = self.affordable(placements, &shared);
        }
        shared
    }

    /// Joints that each swaying plant may have for all to stay within [`DRAWS`].
    fn affordable(&self, placements: &[Placement], shared: &BTreeSet<usize>) -> usize {
        let riding = |p: &Placement| {
            let asset = self.from.scene.assets.get(p.asset)?;
            let joints = asset.instancers.iter().filter(|i| matches!(i.motion, InstancerMotion::Joints(_)));
            Some(joints.map(|i| i.prototypes.len()).sum::<usize>())
        };
        let swaying = placements.iter().enumerate().filter(|(i, _)| !shared.contains(i));
        let prototypes: usize = swaying.filter_map(|(_, p)| riding(p)).sum();
        DRAWS.checked_div(prototypes).map_or(super::rig::JOINTS, |n| n.max(FEWEST))
    }

    /// Adds the placements that share meshes.
    pub(super) fn copies(&mut self, placements: &[Placement], shared: &BTreeSet<usize>) -> Result<()> {
        let mut of: BTreeMap<usize, Vec<&Placement>> = BTreeMap::new();
        for p in shared.iter().filter_map(|i| placements.get(*i)) {
            finite(&p.transform, || format!("placement {}", p.name))?;
            of.entry(p.asset).or_default().push(p);
        }
        for (index, list) in of {
            let Some(asset) = self.from.scene.assets.get(index) else { continue };
            match self.from.profile {
                Profile::Web => self.instanced_copies(asset, &list)?,
                Profile::Blender => self.node_copies(asset, &list)?,
            }
        }
        Ok(())
    }

    /// One node for each copy, all with one mesh of everything that the plant shows.
    fn node_copies(&mut self, asset: &Asset, list: &[&Placement]) -> Result<()> {
        let mut whole = merged(asset);
        for curves in &asset.curves {
            let tile = self.from.scene.materials.get(curves.material as usize).map_or(1.0, |m| m.tile);
            whole.append(&ribbons(curves, &curves.points, tile));
        }
        let what = format!("asset {}", asset.id);
        let drawn = Drawn { name: &asset.id, what: &what, mesh: &whole, shown: Shown::Mesh, skin: None, shapes: &[] };
        let Some(mesh) = self.mesh(drawn)? else { return Ok(()) };
        for p in list {
            let mut node = marked(p.name.clone(), &p.transform, asset.id.clone(), asset.kind.word());
            node.mesh = Some(mesh);
            let node = self.node(node)?;
            self.attach(None, node);
        }
        Ok(())
    }

    /// One instanced node for each mesh and each prototype of the plant, which shows it on all copies.
    fn instanced_copies(&mut self, asset: &Asset, list: &[&Placement]) -> Result<()> {
        let stands: Vec<Trs> = list.iter().map(|p| p.transform).collect();
        for object in &asset.meshes {
            let what = format!("asset {}, mesh {}", asset.id, object.name);
            let drawn = Drawn {
                name: &object.name,
                what: &what,
                mesh: &object.mesh,
                shown: Shown::Mesh,
                skin: None,
                shapes: &[],
            };
            if let Some(mesh) = self.mesh(drawn)? {
                self.instanced(&format!("{}_{}", asset.id, object.name), mesh, &stands, asset)?;
            }
        }
        for curves in &asset.curves {
            let what = format!("asset {}, curves {}", asset.id, curves.name);
            let tile = self.from.scene.materials.get(curves.material as usize).map_or(1.0, |m| m.tile);
            let mesh = ribbons(curves, &curves.points, tile);
            let drawn =
                Drawn { name: &curves.name, what: &what, mesh: &mesh, shown: Shown::Ribbon, skin: None, shapes: &[] };
            if let Some(mesh) = self.mesh(drawn)? {
                self.instanced(&format!("{}_{}", asset.id, curves.name), mesh, &stands, asset)?;
            }
        }
        for instancer in &asset.instancers {
            let what = format!("asset {}, instancer {}", asset.id, instancer.name);
            for (proto, members) in members(instancer, &instancer.rest).into_iter().enumerate() {
                if members.is_empty() {
                    continue;
                }
                let Some(mesh) = self.prototype(instancer, proto, &what)? else { continue };
                let name = format!("{}_{}_{}", asset.id, instancer.name, instancer.prototypes[proto].name);
                let own: Vec<Trs> = members.iter().map(|i| instancer.transform(&instancer.rest, *i)).collect();
                // All copies in one node, or in as few as hold them.
                for stands in stands.chunks((TRANSFORMS / own.len()).max(1)) {
                    let all: Vec<Trs> = stands.iter().flat_map(|s| own.iter().map(|o| s.then_inner(o))).collect();
                    self.instanced(&name, mesh, &all, asset)?;
                }
            }
        }
        Ok(())
    }

    /// A node that shows a mesh at many places.
    fn instanced(&mut self, name: &str, mesh: Index, places: &[Trs], asset: &Asset) -> Result<()> {
        let extensions = Some(self.instancing_at(places, &format!("asset {}, copies", asset.id))?);
        let marked = marked(name.to_owned(), &Trs::IDENTITY, asset.id.clone(), "instancer");
        let node = self.node(super::json::Node { mesh: Some(mesh), extensions, ..marked })?;
        self.attach(None, node);
        Ok(())
    }
}
