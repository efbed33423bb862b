//! The nodes of a document: placements, their joints, skins and meshes, and the camera.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use glam::{Mat3, Quat, Vec3};

use super::super::Warning;
use super::asset_nodes::{AssetNodes, InstanceSet, JointNode, NodeParent, NodeTemplate};
use super::buffer::last_index;
use super::document::{GltfDocument, check_finite, node_with_extras, node_with_transform};
use super::json::{Camera, Index, Node, Perspective, Skin};
use osier_base::Result;
use osier_scene::{Asset, Instancer, InstancerMotion, LEAF_COLOR, Placement, Trs};

/// Assets or placements that a document contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GltfContents {
    /// The asset of this index, at the origin.
    Asset(usize),
    /// All placements in the space of the scene; `camera`: with the scene's camera.
    Scene { camera: bool },
}

/// The moving instances that are written, by the index of their placement.
type InstancesByPlacement = BTreeMap<usize, InstanceSet>;

impl GltfDocument<'_> {
    /// Builds the document; false if it has no geometry.
    pub(super) fn assemble(&mut self, contents: GltfContents) -> Result<bool> {
        let scene = self.input.scene;
        let own;
        let (placements, name): (&[Placement], &str) = match contents {
            GltfContents::Asset(asset) => {
                let Some(id) = scene.assets.get(asset).map(|a| a.id.clone()) else { return Ok(false) };
                own = [Placement { name: id, asset, transform: Trs::IDENTITY, phase: 0 }];
                (&own, &own[0].name)
            }
            GltfContents::Scene { .. } => (&scene.placements, &scene.name),
        };
        let is_scene = matches!(contents, GltfContents::Scene { .. });
        let copies = if is_scene { self.choose_copies(placements) } else { BTreeSet::new() };
        let chosen = self.choose_moving_instances(placements, name);
        let mut nodes: BTreeMap<usize, AssetNodes> = BTreeMap::new();
        // The contents of an asset are built for its first placement and shared by the others; only the channels of its
        // joints are built again for each phase.
        let mut later: BTreeMap<(usize, u32), Vec<JointNode>> = BTreeMap::new();
        for (i, placement) in placements.iter().enumerate().filter(|(i, _)| !copies.contains(i)) {
            let asset = placement.asset;
            let asset_nodes = match nodes.entry(asset) {
                Entry::Occupied(asset_nodes) => asset_nodes.into_mut(),
                Entry::Vacant(place) => {
                    let all = instances_of_asset(placements, asset, &chosen);
                    place.insert(self.build_asset_nodes(asset, &all)?)
                }
            };
            if asset_nodes.templates.is_empty() {
                continue;
            }
            if placement.phase > 0 && !later.contains_key(&(asset, placement.phase)) {
                later.insert((asset, placement.phase), self.joints_at_phase(asset, placement.phase)?);
            }
            let joints = later.get(&(asset, placement.phase)).unwrap_or(&asset_nodes.joints);
            self.add_placement(placement, is_scene, asset_nodes, joints, chosen.get(&i))?;
        }
        // Copies come last: the time that Blender's importer takes for a skeleton grows with the number of objects before it.
        self.add_copies(placements, &copies)?;
        let filled = !self.root.nodes.is_empty();
        if contents == (GltfContents::Scene { camera: true }) {
            self.add_camera()?;
        }
        self.finish_root(name);
        Ok(filled)
    }

    /// Selects the moving instances to write: all, or those with the smallest keys if the file would have too many
    /// (X003).
    fn choose_moving_instances(&mut self, placements: &[Placement], name: &str) -> InstancesByPlacement {
        let input = self.input;
        let mut list = Vec::new();
        let mut total = 0_usize;
        let mut leaves = 0_usize;
        for (k, placement) in placements.iter().enumerate() {
            let Some(tracks) = input.tracks.assets.get(placement.asset) else { continue };
            let asset = &input.scene.assets[placement.asset];
            let stays =
                |i: usize| asset.instancers.get(i).is_some_and(|instancer| self.stays_at_rest(asset, instancer));
            // Instances that are never visible get no node.
            let moving = tracks.moving.iter().filter(|m| m.alive.contains(&true) && !stays(m.instancer));
            list.extend(moving.map(|m| (m.key, k, m.instancer, m.instance)));
            let is_shape = |n: usize| tracks.leaves.as_ref().is_some_and(|leaves| leaves.holds(n));
            let instancers = asset.instancers.iter().enumerate();
            let as_nodes = instancers.filter(|(n, i)| i.motion == InstancerMotion::Free && !is_shape(*n));
            for (_, instancer) in as_nodes {
                let sum = if self.stays_at_rest(asset, instancer) { &mut leaves } else { &mut total };
                *sum += instancer.len();
            }
        }
        if leaves > 0 {
            let message = format!(
                "{name}: {leaves} instances of leaves change over the clip, but stay as at the first frame; \
                 output.gltf.nodes = {leaves} lets them change, output.gltf.frame = N shows those of another frame"
            );
            self.warnings.push(Warning { code: "X003", message });
        }
        let most = input.tracks.max_moving;
        if total > most && !input.tracks.is_still() {
            let message = format!(
                "{name}: {total} moving instances, {most} written: those of the smallest hash(seed, id); \
                 output.gltf.nodes = {total} writes all, output.gltf.frame = N all of one frame"
            );
            self.warnings.push(Warning { code: "X003", message });
        }
        // Keys are hashes: the instances that are kept are spread over the scene, and are the same in every run.
        list.sort_unstable();
        list.truncate(most);
        let mut chosen = InstancesByPlacement::new();
        for (_, k, instancer, instance) in list {
            chosen.entry(k).or_default().insert((instancer, instance));
        }
        chosen
    }

    /// Whether the instances of an instancer are leaves that change over the clip, too many for a node each. They are
    /// then written in their rest state: with a selection of them the tree would look bare.
    pub(super) fn stays_at_rest(&self, asset: &Asset, instancer: &Instancer) -> bool {
        let of_season = |i: &Instancer| i.motion == InstancerMotion::Free && i.rest.attribute(LEAF_COLOR).is_some();
        let all: usize = asset.instancers.iter().filter(|i| of_season(i)).map(Instancer::len).sum();
        !self.input.tracks.is_still() && of_season(instancer) && all > self.input.tracks.max_moving
    }

    /// Adds the nodes of a placement: its top node, below it the joints, and a node for each template.
    fn add_placement(
        &mut self,
        placement: &Placement,
        is_scene: bool,
        nodes: &AssetNodes,
        joint_nodes: &[JointNode],
        chosen: Option<&InstanceSet>,
    ) -> Result<()> {
        let asset = &self.input.scene.assets[placement.asset];
        check_finite(&placement.transform, || format!("placement {}", placement.name))?;
        let named = |name: &str| if is_scene { format!("{}_{name}", placement.name) } else { name.to_owned() };
        let top = node_with_extras(placement.name.clone(), &placement.transform, asset.id.clone(), asset.kind.word());
        let top = self.add_node(top)?;
        self.attach_node(None, top);
        let mut root = top;
        if placement.transform.s != Vec3::ONE && !joint_nodes.is_empty() {
            // Blender's importer misplaces children of bones if the node above the joints is scaled, so an unscaled node goes
            // between.
            root = self.add_node(node_with_transform(named("skeleton"), &Trs::IDENTITY))?;
            self.attach_node(Some(top), root);
        }
        let mut joints: Vec<Index> = Vec::with_capacity(joint_nodes.len());
        for joint in joint_nodes {
            let node = self.add_node(node_with_transform(named(&joint.name), &joint.motion.rest))?;
            let parent = joint.parent.and_then(|p| joints.get(p)).copied().unwrap_or(root);
            self.attach_node(Some(parent), node);
            self.add_channels(node, &joint.motion.channels);
            joints.push(node);
        }
        let skin = match (nodes.inverse_bind, joints.first()) {
            (Some(inverse_bind_matrices), Some(&skeleton)) => {
                let name = named("skin");
                self.root.skins.push(Skin { name, inverse_bind_matrices, skeleton, joints: joints.clone() });
                Some(last_index(self.root.skins.len())?)
            }
            _ => None,
        };
        let shown = |part: &&NodeTemplate| part.moving.is_none_or(|m| chosen.is_some_and(|c| c.contains(&m)));
        for part in nodes.templates.iter().filter(shown) {
            let id = format!("{}/{}", placement.name, part.id);
            let node = Node {
                mesh: Some(part.mesh),
                skin: skin.filter(|_| part.parent == NodeParent::Skin),
                extensions: part.instancing.clone(),
                ..node_with_extras(named(&part.name), &part.motion.rest, id, part.kind)
            };
            let node = self.add_node(node)?;
            let parent = match part.parent {
                NodeParent::Placement => Some(top),
                NodeParent::Joint(k) => joints.get(k).copied(),
                NodeParent::Skin => None,
            };
            self.attach_node(parent, node);
            self.add_channels(node, &part.motion.channels);
        }
        Ok(())
    }

    /// Adds the scene's camera; glTF cameras look along -Z of their node.
    fn add_camera(&mut self) -> Result<()> {
        let view = self.input.scene.camera;
        let [right, up, back] = view.axes();
        let r = Quat::from_mat3(&Mat3::from_cols(right, up, back)).normalize();
        // The far plane includes the ground around the subject; a larger one would cost depth precision in viewports.
        let zfar = (10.0 * (view.eye - view.target).length()).max(1000.0);
        #[allow(clippy::cast_precision_loss, reason = "pictures are at most 16384 pixels wide")]
        let aspect_ratio = self.input.options.size.map(|[width, height]| width as f32 / height as f32);
        let perspective = Perspective { aspect_ratio, yfov: view.vfov, znear: 0.01, zfar };
        self.root.cameras.push(Camera { name: "camera".into(), kind: "perspective", perspective });
        let rest = Trs { t: view.eye, r, ..Trs::IDENTITY };
        check_finite(&rest, || "camera".to_owned())?;
        let node = Node { camera: Some(0), ..node_with_extras("camera".into(), &rest, "camera".into(), "camera") };
        let node = self.add_node(node)?;
        self.attach_node(None, node);
        Ok(())
    }
}

/// The moving instances that some placement of an asset shows.
fn instances_of_asset(placements: &[Placement], asset: usize, chosen: &InstancesByPlacement) -> InstanceSet {
    let here = placements.iter().enumerate().filter(|(_, p)| p.asset == asset);
    here.flat_map(|(k, _)| chosen.get(&k).into_iter().flatten().copied()).collect()
}
