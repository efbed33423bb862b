//! The nodes of an asset, built once and instantiated by each of its placements: joints, meshes, instances, points, curves.

use std::collections::BTreeSet;

use glam::Vec3;

use super::super::Warning;
use super::Profile;
use super::document::{GeometryKind, GltfDocument, NodeAnimation, NodeChannel, check_finite};
use super::hidden_parts::HiddenParts;
use super::instances::{InstanceGroup, live_by_prototype};
use super::json::{Index, NodeExtensions};
use super::keys;
use super::leaf_shapes::{LeafMesh, LeafShapes};
use super::meshes::{MeshSource, PartTargets, SkinInfluences, StoredMesh};
use super::morph_shape::MorphShape;
use super::quantize::{QuantizedCube, place_stored};
use super::rig::{JointSelection, MAX_JOINTS};
use super::tracks::{InstanceTrack, MorphFrames, MorphTrack};
use osier_base::Result;
use osier_scene::{Asset, Instancer, InstancerMotion, Mesh, MeshMotion, MeshObject, Trs, ribbons};

/// Nodes below the top node of each placement of an asset; all placements share meshes and accessors.
#[derive(Debug, Default)]
pub(super) struct AssetNodes {
    pub joints: Vec<JointNode>,
    /// Accessor of the inverse bind matrices, if a mesh is skinned.
    pub inverse_bind: Option<Index>,
    pub templates: Vec<NodeTemplate>,
}

/// Node of a joint that is written; joints that were not selected have none.
#[derive(Debug)]
pub(super) struct JointNode {
    pub name: String,
    /// Index of the parent among the written joints.
    pub parent: Option<usize>,
    pub motion: NodeAnimation,
}

/// Parent of a node in the document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NodeParent {
    /// The top node of the placement.
    Placement,
    /// A joint, by its index among the written ones.
    Joint(usize),
    /// A root node of the scene, for a skinned mesh: glTF ignores the transform of such a node.
    Skin,
}

/// A node that is instantiated for each placement of an asset.
#[derive(Debug)]
pub(super) struct NodeTemplate {
    pub name: String,
    pub kind: &'static str,
    /// Tail of the node's id, after the placement's name.
    pub id: String,
    pub mesh: Index,
    pub parent: NodeParent,
    pub motion: NodeAnimation,
    pub instancing: Option<NodeExtensions>,
    /// The moving instance (instancer, instance) that the node shows, written only for placements that selected it.
    pub moving: Option<(usize, usize)>,
}

impl NodeTemplate {
    /// A node without animation. Its transform is the dequantization of the mesh, if any.
    pub(super) fn new(name: &str, kind: &'static str, mesh: StoredMesh, parent: NodeParent) -> Self {
        // The transform of a skin's node has no effect: its joints have the dequantization.
        let cube = mesh.cube.filter(|_| parent != NodeParent::Skin);
        let motion = NodeAnimation { rest: place_stored(&Trs::IDENTITY, cube), ..NodeAnimation::default() };
        let (name, mesh) = (name.to_owned(), mesh.index);
        Self { id: name.clone(), name, kind, mesh, parent, motion, instancing: None, moving: None }
    }
}

/// Moving instances of an asset: index of the instancer, index of the instance in it.
pub(super) type InstanceSet = BTreeSet<(usize, usize)>;

impl GltfDocument<'_> {
    /// Selects the joints of an asset to write, no more than profile and format allow; `None` without joints.
    pub(super) fn select_joints(&self, asset: usize) -> Option<JointSelection> {
        let input = self.input;
        let (source, tracks) = input.scene.assets.get(asset).zip(input.tracks.assets.get(asset))?;
        let mut selection = JointSelection::new(source, &tracks.poses, self.max_joints.min(MAX_JOINTS))?;
        let all = source.skeleton.as_ref().map_or(0, |s| s.joints.len());
        // The profile may ask for fewer joints than the format allows; only the format's limit is worth a warning.
        selection.warning = selection.warning.filter(|_| all > MAX_JOINTS);
        Some(selection)
    }

    /// Builds the nodes of an asset. `chosen`: the moving instances that some placement shows.
    pub(super) fn build_asset_nodes(&mut self, asset: usize, chosen: &InstanceSet) -> Result<AssetNodes> {
        let input = self.input;
        let Some(source) = input.scene.assets.get(asset) else { return Ok(AssetNodes::default()) };
        let Some(tracks) = input.tracks.assets.get(asset) else { return Ok(AssetNodes::default()) };
        let mut nodes = AssetNodes::default();
        // Without frames there are no poses: joints would cost nodes and skins, and would show only the rest pose.
        let selection = if input.tracks.is_still() { None } else { self.select_joints(asset) };
        // The meshes of a skin share its inverse bind matrices, and with them one cube.
        let skinned = source.meshes.iter().filter(|o| selection.is_some() && is_skinned(o));
        let cube = self.quantized_cube(skinned.flat_map(|o| o.mesh.points.iter().copied()));
        // Meshes: those in levels of detail together, all others as nodes of their own.
        let has_levels = self.has_levels(source);
        if has_levels {
            self.add_levels(&mut nodes, source, selection.as_ref())?;
        }
        for (object, shapes) in source.meshes.iter().zip(&tracks.meshes) {
            if self.is_in_levels(source, object) {
                continue;
            }
            self.add_mesh_object(&mut nodes, source, object, selection.as_ref().zip(Some(cube)), shapes)?;
        }
        // Instances: nodes that move freely, nodes below joints, or instances at rest; growing leaves follow as one mesh.
        for (i, instancer) in source.instancers.iter().enumerate() {
            let label = format!("asset {}, instancer {}", source.id, instancer.name);
            if tracks.leaves.as_ref().is_some_and(|leaves| leaves.holds(i)) && !input.tracks.is_still() {
                continue;
            }
            match (&instancer.motion, &selection) {
                (InstancerMotion::Free, _) if !input.tracks.is_still() && !self.stays_at_rest(source, instancer) => {
                    let list: Vec<&InstanceTrack> = tracks
                        .moving
                        .iter()
                        .filter(|m| m.instancer == i && chosen.contains(&(i, m.instance)))
                        .collect();
                    self.add_moving_instances(&mut nodes, instancer, &list, &label)?;
                }
                (motion, _) if has_levels && *motion != InstancerMotion::Free => {}
                (InstancerMotion::Joints(joints), Some(selection)) => {
                    self.add_joint_instances(&mut nodes, instancer, selection, joints, &label)?;
                }
                _ => self.add_static_instances(&mut nodes, instancer, &label)?,
            }
        }
        if let Some(leaves) = tracks.leaves.as_ref().filter(|_| !input.tracks.is_still()) {
            self.add_growing_leaves(&mut nodes, source, leaves)?;
        }
        // Point clouds that do not move.
        for cloud in source.points.iter().filter(|c| !c.moving || input.tracks.is_still()) {
            if let Some(mesh) = self.add_point_cloud(cloud, &format!("asset {}, points {}", source.id, cloud.name))? {
                nodes.templates.push(NodeTemplate::new(&cloud.name, "points", mesh, NodeParent::Placement));
            }
        }
        for (curves, shapes) in source.curves.iter().zip(&tracks.curves) {
            let tile = input.scene.materials.get(curves.material as usize).map_or(1.0, |m| m.tile);
            // glTF has no curves with a width: they become ribbons, and moving ones morph as meshes do.
            let rest = ribbons(curves, &curves.points, tile);
            let ribbon_shapes = |list: &[MorphShape]| -> Vec<MorphShape> {
                let ribbon = |shape: &MorphShape| ribbons(curves, &shape.points, tile);
                list.iter()
                    .map(ribbon)
                    .map(|m| MorphShape { points: m.points, normals: m.normals, unseen: Vec::new() })
                    .collect()
            };
            let (frames, shapes) = match shapes {
                MorphFrames::Frames(keys) => (&keys.frames[..], ribbon_shapes(&keys.shapes)),
                // Leave out curves with too many moving points; the warning X017 reports them.
                MorphFrames::TooMany => continue,
                MorphFrames::Still => (&[][..], Vec::new()),
            };
            let label = format!("asset {}, curves {}", source.id, curves.name);
            let mesh_source =
                MeshSource { geometry: GeometryKind::Ribbon, ..MeshSource::of(&curves.name, &label, &rest) };
            self.add_morphing_mesh(&mut nodes, mesh_source, MorphTrack { frames, shapes: &shapes }, "curves")?;
        }
        // Joints are written if a skin or an instance needs them.
        if nodes.templates.iter().any(|p| p.parent != NodeParent::Placement)
            && let Some(selection) = &selection
        {
            self.warnings.extend(selection.warning.clone());
            nodes.joints = self.joint_nodes(source, selection, &tracks.poses)?;
            if nodes.templates.iter().any(|p| p.parent == NodeParent::Skin) {
                let label = format!("asset {}, skin", source.id);
                let mut matrices = selection.inverse_bind_matrices();
                if let Some(cube) = cube {
                    matrices.iter_mut().for_each(|m| *m = cube.inverse_bind(m));
                }
                nodes.inverse_bind = Some(self.buffer.add_matrices(&matrices, &label)?);
            }
        }
        Ok(nodes)
    }

    /// Adds the leaves of a growing plant as a mesh that morphs, and the warning X003 with their number and size.
    fn add_growing_leaves(&mut self, nodes: &mut AssetNodes, asset: &Asset, leaves: &LeafShapes) -> Result<()> {
        let label = format!("asset {}, leaves", asset.id);
        let Some(leaves) = leaves.mesh(asset, &label)? else { return Ok(()) };
        self.warnings.push(Warning { code: "X003", message: leaves.words(&label) });
        let LeafMesh { mesh, frames, parts, .. } = leaves;
        let mesh_source = MeshSource::of("leaves", &label, &mesh);
        self.add_mesh_of_parts(nodes, mesh_source, &frames, &parts, "mesh")
    }

    /// A mesh of an asset: skinned, morphing, or static.
    fn add_mesh_object(
        &mut self,
        nodes: &mut AssetNodes,
        asset: &Asset,
        object: &MeshObject,
        selection: Option<(&JointSelection, Option<QuantizedCube>)>,
        shapes: &MorphFrames,
    ) -> Result<()> {
        let label = format!("asset {}, mesh {}", asset.id, object.name);
        let (mesh, name) = (&object.mesh, object.name.as_str());
        let mesh_source = MeshSource::of(name, &label, mesh);
        match (selection, &object.skin, shapes) {
            (Some((selection, cube)), Some(skin), _) if is_skinned(object) => {
                let (joints, weights) = selection.remap_weights(skin);
                let skin = SkinInfluences { joints, weights, count: selection.kept.len() };
                if let Some(mesh) = self.add_mesh(MeshSource { skin: Some(&skin), cube, ..mesh_source })? {
                    nodes.templates.push(NodeTemplate::new(name, "mesh", mesh, NodeParent::Skin));
                }
                Ok(())
            }
            (_, _, MorphFrames::Frames(keys)) => self.add_morphing_mesh(nodes, mesh_source, keys.track(), "mesh"),
            _ => self.add_morphing_mesh(nodes, mesh_source, MorphTrack::default(), "mesh"),
        }
    }

    /// A mesh with a morph target for every kept frame whose shape differs from rest, and a track of weights in which each target
    /// is 1 at its frame and 0 at the other kept ones.
    fn add_morphing_mesh(
        &mut self,
        nodes: &mut AssetNodes,
        mesh_source: MeshSource<'_>,
        morph: MorphTrack<'_>,
        kind: &'static str,
    ) -> Result<()> {
        let MorphTrack { frames, shapes } = morph;
        if let Some(parts) = HiddenParts::of(mesh_source.mesh, shapes) {
            return self.add_mesh_of_parts(nodes, mesh_source, frames, &parts, kind);
        }
        let is_rest = |mesh: &Mesh, s: &MorphShape| {
            s.points == mesh.points && (s.normals.is_empty() || s.normals == mesh.normals)
        };
        // Frames at rest need no target: all weights are 0 there. Successive frames of equal shape share a target.
        let mut morphed: Vec<usize> = Vec::new();
        let mut target_of: Vec<Option<usize>> = Vec::with_capacity(shapes.len());
        for (i, shape) in shapes.iter().enumerate() {
            let target = if i > 0 && shapes[i - 1] == *shape {
                target_of[i - 1]
            } else if is_rest(mesh_source.mesh, shape) {
                None
            } else {
                morphed.push(i);
                Some(morphed.len() - 1)
            };
            target_of.push(target);
        }
        let targets: Vec<(String, &MorphShape)> =
            morphed.iter().map(|&i| (self.target_name(frames, i), &shapes[i])).collect();
        let Some(mesh) = self.add_mesh(MeshSource { shapes: &targets, ..mesh_source })? else { return Ok(()) };
        let mut part = NodeTemplate::new(mesh_source.name, kind, mesh, NodeParent::Placement);
        if !morphed.is_empty() {
            // One key for each shape, with 1 for the target that is this shape and 0 for the others.
            let mut weights = Vec::with_capacity(target_of.len() * morphed.len());
            for target in &target_of {
                weights.extend((0..morphed.len()).map(|index| f32::from(u8::from(*target == Some(index)))));
            }
            part.motion.channels.push(self.weight_channel(frames, &weights, mesh_source.label)?);
        }
        nodes.templates.push(part);
        Ok(())
    }

    /// A mesh with hidden parts: a target that hides all parts, whose weight is always 1, and one target for each
    /// shape, whose weight is 1 at its frame and 0 at the other ones.
    fn add_mesh_of_parts(
        &mut self,
        nodes: &mut AssetNodes,
        mesh_source: MeshSource<'_>,
        frames: &[usize],
        parts: &HiddenParts,
        kind: &'static str,
    ) -> Result<()> {
        // Successive frames of equal shape share a target.
        let mut written: Vec<(usize, String)> = Vec::new();
        let mut target_of: Vec<usize> = Vec::with_capacity(parts.shapes.len());
        for (i, shape) in parts.shapes.iter().enumerate() {
            if i == 0 || parts.shapes[i - 1] != *shape {
                written.push((i, self.target_name(frames, i)));
            }
            target_of.push(written.len());
        }
        let targets = Some(PartTargets { hidden: parts, written: &written });
        let Some(mesh) = self.add_mesh(MeshSource { parts: targets, ..mesh_source })? else { return Ok(()) };
        let mut part = NodeTemplate::new(mesh_source.name, kind, mesh, NodeParent::Placement);
        let mut weights = Vec::with_capacity(target_of.len() * (written.len() + 1));
        for target in &target_of {
            // Target 0 hides all parts.
            weights.extend((0..=written.len()).map(|index| f32::from(u8::from(index == 0 || index == *target))));
        }
        part.motion.channels.push(self.weight_channel(frames, &weights, mesh_source.label)?);
        nodes.templates.push(part);
        Ok(())
    }

    /// Name of the target of the shape at index `i` of `frames`: the name of its frame.
    fn target_name(&self, frames: &[usize], i: usize) -> String {
        let frame = frames.get(i).copied().unwrap_or_default();
        let number = self.input.tracks.numbers.get(frame).copied().unwrap_or_default();
        format!("frame_{}", self.input.scene.clip.tag(number))
    }

    /// The channel of the weights of all targets. `weights`: those at the first of `frames`, then those at the second,
    /// and so on.
    fn weight_channel(&mut self, frames: &[usize], weights: &[f32], label: &str) -> Result<NodeChannel> {
        let times: Vec<f32> = frames.iter().filter_map(|f| self.input.tracks.times.get(*f)).copied().collect();
        let output = self.buffer.add_scalars(weights, label)?;
        let sampler = self.add_timed_sampler(&times, output, false)?;
        Ok(NodeChannel { sampler, path: "weights" })
    }

    /// Instances that do not move: by EXT_mesh_gpu_instancing in `web`, else merged into one mesh for each prototype.
    fn add_static_instances(&mut self, nodes: &mut AssetNodes, instancer: &Instancer, label: &str) -> Result<()> {
        for (proto, members) in
            live_by_prototype(instancer, &instancer.rest).into_iter().enumerate().filter(|(_, m)| !m.is_empty())
        {
            let group = InstanceGroup { instancer, state: &instancer.rest, proto, members, label };
            let name = format!("{}_{}", instancer.name, instancer.prototypes[proto].name);
            let (mesh, instancing) = match self.input.options.profile {
                Profile::Web => match self.add_prototype_mesh(instancer, proto, label)? {
                    Some(mesh) => {
                        let instancing = self.group_instancing(&group, &Trs::IDENTITY, mesh.cube)?;
                        // The dequantization is in the transforms of the instances, not in that of their node.
                        (Some(StoredMesh { cube: None, ..mesh }), Some(instancing))
                    }
                    None => (None, None),
                },
                Profile::Blender | Profile::Engine => {
                    (self.add_merged_mesh(name.clone(), &[group], &Trs::IDENTITY)?, None)
                }
            };
            if let Some(mesh) = mesh {
                nodes.templates.push(NodeTemplate {
                    instancing,
                    ..NodeTemplate::new(&name, "instancer", mesh, NodeParent::Placement)
                });
            }
        }
        Ok(())
    }

    /// Instances attached to joints: nodes below the joints that carry them, instanced in `web`, merged per joint otherwise.
    fn add_joint_instances(
        &mut self,
        nodes: &mut AssetNodes,
        instancer: &Instancer,
        selection: &JointSelection,
        joints: &[u16],
        label: &str,
    ) -> Result<()> {
        // Instances attached to a joint that was left out follow the written ancestor that carries it.
        let carriers: Vec<u16> =
            joints.iter().map(|j| selection.carrier.get(usize::from(*j)).copied().unwrap_or(0)).collect();
        let state = &instancer.rest;
        // The groups of each joint: one for each prototype of which it carries instances.
        let mut riders: Vec<Vec<InstanceGroup<'_>>> = selection.kept.iter().map(|_| Vec::new()).collect();
        for (proto, members) in live_by_prototype(instancer, state).into_iter().enumerate() {
            // Indices of this list are those of the joints: the order of the nodes does not depend on that of the
            // instances.
            let mut by_joint: Vec<Vec<usize>> = vec![Vec::new(); selection.kept.len()];
            for i in members {
                if let Some(list) = carriers.get(i).and_then(|c| by_joint.get_mut(usize::from(*c))) {
                    list.push(i);
                }
            }
            for (groups, members) in riders.iter_mut().zip(by_joint).filter(|(_, m)| !m.is_empty()) {
                groups.push(InstanceGroup { instancer, state, proto, members, label });
            }
        }
        if self.input.options.profile != Profile::Web {
            // One mesh as a child of each joint moves as a skinned one would, and importers need no vertex weights for it.
            for (k, groups) in riders.iter().enumerate() {
                let name = format!("{}_{k}", instancer.name);
                if let Some(mesh) = self.add_merged_mesh(name.clone(), groups, &selection.bind[selection.kept[k]])? {
                    nodes.templates.push(NodeTemplate::new(&name, "instancer", mesh, NodeParent::Joint(k)));
                }
            }
            return Ok(());
        }
        // Prototypes outside and joints inside: a prototype is encoded once, and all nodes of all joints refer to its mesh.
        let is_used = |proto: &usize| riders.iter().flatten().any(|g| g.proto == *proto);
        for proto in (0..instancer.prototypes.len()).filter(is_used) {
            let name = format!("{}_{}", instancer.name, instancer.prototypes[proto].name);
            let Some(mesh) = self.add_prototype_mesh(instancer, proto, label)? else { continue };
            for (k, groups) in riders.iter().enumerate() {
                for group in groups.iter().filter(|g| g.proto == proto) {
                    let joint = &selection.bind[selection.kept[k]];
                    let instancing = Some(self.group_instancing(group, joint, mesh.cube)?);
                    let mesh = StoredMesh { cube: None, ..mesh };
                    let name = format!("{name}_{k}");
                    nodes.templates.push(NodeTemplate {
                        instancing,
                        ..NodeTemplate::new(&name, "instancer", mesh, NodeParent::Joint(k))
                    });
                }
            }
        }
        Ok(())
    }

    /// Instances that move freely: a node each, with scale 0 while not alive.
    fn add_moving_instances(
        &mut self,
        nodes: &mut AssetNodes,
        instancer: &Instancer,
        list: &[&InstanceTrack],
        label: &str,
    ) -> Result<()> {
        // The mesh of each prototype is added when its first instance needs it. Nodes are in the order of the instances, not in
        // that of the keys by which they were selected.
        let mut meshes: Vec<Option<StoredMesh>> = vec![None; instancer.prototypes.len()];
        let mut list = list.to_vec();
        list.sort_by_key(|m| m.instance);
        let times = &self.input.tracks.times;
        let drop_keys = self.input.options.profile != Profile::Blender;
        for m in list {
            let Some(proto) = instancer.protos.get(m.instance).map(|p| *p as usize) else { continue };
            let mesh = match meshes.get(proto).copied().flatten() {
                Some(mesh) => mesh,
                None => match self.add_prototype_mesh(instancer, proto, label)? {
                    Some(mesh) => mesh,
                    None => continue,
                },
            };
            meshes[proto] = Some(mesh);
            let scale = instancer.scales.get(m.instance).copied().unwrap_or(Vec3::ONE);
            // The transform of the node is that of the first frame, for readers without animation.
            let (mut positions, orientations) = m.hold_while_dead();
            // p = t + r s (low + extent q): the dequantization moves the keys of translation and multiplies the scale.
            let sizes = m.sizes_while_dead();
            for ((p, r), size) in positions.iter_mut().zip(&orientations).zip(&sizes) {
                *p = place_stored(&Trs { t: *p, r: *r, s: scale * *size }, mesh.cube).t;
            }
            let scale = place_stored(&Trs { s: scale, ..Trs::IDENTITY }, mesh.cube).s;
            let mut motion = NodeAnimation::default();
            motion.rest.t = positions.first().copied().unwrap_or_default();
            motion.rest.r = orientations.first().copied().unwrap_or_default();
            let factor = m.sizes.first().copied().unwrap_or(1.0);
            motion.rest.s = if m.alive.first().copied().unwrap_or(true) { scale * factor } else { Vec3::ZERO };
            let NodeAnimation { rest, channels } = &mut motion;
            self.add_vector_keys(
                keys::reduce_positions(times, &positions, drop_keys),
                "translation",
                false,
                &mut rest.t,
                channels,
            )?;
            self.add_rotation_keys(keys::reduce_rotations(times, &orientations, drop_keys), &mut rest.r, channels)?;
            if m.changes_size() {
                let shown = |(alive, size): (&bool, &f32)| if *alive { scale * *size } else { Vec3::ZERO };
                let scales: Vec<Vec3> = m.alive.iter().zip(&m.sizes).map(shown).collect();
                let scales = keys::reduce_positions(times, &scales, drop_keys);
                self.add_vector_keys(scales, "scale", false, &mut rest.s, channels)?;
            } else {
                let factor = m.sizes.first().copied().unwrap_or(1.0);
                let visible = keys::visibility_scales(&m.alive, scale * factor);
                self.add_vector_keys(visible, "scale", true, &mut rest.s, channels)?;
            }
            let name = format!("{}_{}", instancer.name, m.instance);
            let id = format!("{}/{}", instancer.name, instancer.ids.get(m.instance).copied().unwrap_or_default());
            let mesh = StoredMesh { cube: None, ..mesh };
            let part = NodeTemplate::new(&name, "instance", mesh, NodeParent::Placement);
            nodes.templates.push(NodeTemplate { id, motion, moving: Some((m.instancer, m.instance)), ..part });
        }
        Ok(())
    }

    /// The joint nodes of an asset whose motion is `phase` frames ahead; the clip repeats.
    pub(super) fn joints_at_phase(&mut self, asset: usize, phase: u32) -> Result<Vec<JointNode>> {
        let input = self.input;
        let Some((source, tracks)) = input.scene.assets.get(asset).zip(input.tracks.assets.get(asset)) else {
            return Ok(Vec::new());
        };
        let Some(selection) = self.select_joints(asset).filter(|_| !tracks.poses.is_empty()) else {
            return Ok(Vec::new());
        };
        let mut poses = tracks.poses.clone();
        let count = poses.len();
        // Frames may have been skipped, so the phase is converted from frames of the clip to poses.
        let share = phase as usize * count / input.scene.clip.len().max(1);
        poses.rotate_left(share % count);
        self.joint_nodes(source, &selection, &poses)
    }

    /// The selected joints as nodes in the order of the selection, with keys of translation, rotation and scale.
    fn joint_nodes(&mut self, asset: &Asset, selection: &JointSelection, poses: &[Vec<Trs>]) -> Result<Vec<JointNode>> {
        let Some(skeleton) = &asset.skeleton else { return Ok(Vec::new()) };
        let mut joints = Vec::new();
        let times = &self.input.tracks.times;
        let drop_keys = self.input.options.profile != Profile::Blender;
        // The pose at each of `times`: motion that repeats ends with its first pose.
        let keyed = poses.iter().chain(poses.first().filter(|_| self.input.tracks.repeats));
        for (k, &i) in selection.kept.iter().enumerate() {
            let joint = &skeleton.joints[i];
            check_finite(&joint.rest, || format!("asset {}, joint {}", asset.id, joint.name))?;
            let mut motion = NodeAnimation { rest: joint.rest, ..NodeAnimation::default() };
            let NodeAnimation { rest, channels } = &mut motion;
            // Keys of one channel over all frames; `keys` leaves out what interpolation gives within the tolerance.
            let of = |f: &dyn Fn(&Trs) -> Vec3| keyed.clone().map(|p| f(&p[i])).collect::<Vec<Vec3>>();
            let turns: Vec<_> = keyed.clone().map(|p| p[i].r).collect();
            self.add_vector_keys(
                keys::reduce_positions(times, &of(&|j| j.t), drop_keys),
                "translation",
                false,
                &mut rest.t,
                channels,
            )?;
            self.add_rotation_keys(keys::reduce_rotations(times, &turns, drop_keys), &mut rest.r, channels)?;
            self.add_vector_keys(
                keys::reduce_positions(times, &of(&|j| j.s), drop_keys),
                "scale",
                false,
                &mut rest.s,
                channels,
            )?;
            let parent = selection.parent_of(skeleton, k);
            joints.push(JointNode { name: joint.name.clone(), parent, motion });
        }
        Ok(joints)
    }
}

/// Whether joints move the vertices of a mesh; it is written as a skin only if the document has these joints.
fn is_skinned(object: &MeshObject) -> bool {
    object.skin.is_some() && matches!(object.motion, MeshMotion::Skinned | MeshMotion::Deforming)
}
