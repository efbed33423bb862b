//! The declarations of an asset in prototypes.inc, static.inc and the frame files.
//!
//! Identifiers have indices of asset a, mesh m, instancer i and so on: `P_a_i_p` a prototype, `G_a_m` a static mesh, `R_a_m` a
//! macro of the static part of a deforming mesh, `L_a_i` the instances of an instancer, `J_a_i_j` those attached to joint j,
//! `D_a_p` points, `H_a_c` curves, `A_a` a macro of the asset. Prototypes and static meshes with a coat, and the instances of
//! such prototypes, are macros: their texture changes with the frame.

use super::mesh::{Mesh2Faces, has_area_anywhere, split_hair, write_mesh2, write_topology, write_vectors};
use super::objects::{
    CloudFrame, MAX_SPHERES, PrototypeUse, StreakView, write_curves, write_instances, write_points, write_union,
};
use super::photons;
use super::space::PovSpace;
use crate::Warning;
use crate::text::TextBuffer;
use osier_scene::{
    Asset, AssetFrame, CurvesFrame, InstanceState, Instancer, InstancerFrame, InstancerMotion, Material, MaterialClass,
    Mesh, MeshFrame, MeshMotion, MeshObject, Trs, instance_states, joint_motions, mesh_points, skinned_normals,
    skinning_matrices,
};

/// Makes an object a target of photons.
const TARGET: &str = "photons { target reflection on refraction on collect off }";

/// An asset with the parameters that its declarations depend on.
pub(super) struct PovAsset<'a> {
    /// Index in the scene's assets.
    pub index: usize,
    pub asset: &'a Asset,
    pub space: PovSpace,
    /// Materials of the scene, which subsets, clouds and curves refer to by index.
    pub materials: &'a [Material],
    pub view: StreakView,
    /// Smallest radius of a target of photons, m; `None` traces no photons.
    pub photons: Option<f32>,
}

impl PovAsset<'_> {
    /// How instances refer to each prototype of an instancer.
    fn prototype_uses(&self, instancer: &Instancer) -> Vec<PrototypeUse> {
        let of = |mesh: &Mesh| match has_area_anywhere(mesh) {
            false => PrototypeUse::Nothing,
            true if self.is_coated(mesh) => PrototypeUse::Macro,
            true => PrototypeUse::Object,
        };
        instancer.prototypes.iter().map(|p| of(&p.mesh)).collect()
    }

    /// Whether a prototype of an instancer has a coat: its maps change with the frame, so it is declared as a macro.
    fn has_coated_prototype(&self, instancer: &Instancer) -> bool {
        instancer.prototypes.iter().any(|p| self.is_coated(&p.mesh))
    }

    /// Declares the prototypes of all instancers that have faces with an area.
    pub fn write_prototypes(&self, text: &mut TextBuffer) {
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            for (p, proto) in instancer.prototypes.iter().enumerate() {
                if !has_area_anywhere(&proto.mesh) {
                    continue;
                }
                text.put(&format!("// {} {} {}\n", self.asset.id, instancer.name, proto.name));
                // Hairs become an object separate from the rest, because `no_shadow` applies to a whole object.
                if let Some((hairs, rest)) = split_hair(&proto.mesh, self.materials) {
                    self.write_hair_prototype(text, i, p, &hairs, &rest);
                    continue;
                }
                let faces = Mesh2Faces::of(&proto.mesh, self.materials);
                if self.is_coated(&proto.mesh) {
                    text.put(&format!("#macro P_{}_{i}_{p}() ", self.index));
                    write_mesh2(text, self.space, &proto.mesh, &faces);
                    text.put("#end\n");
                    continue;
                }
                text.put(&format!("#declare P_{}_{i}_{p} = object {{ ", self.index));
                write_mesh2(text, self.space, &proto.mesh, &faces);
                if self.is_target(instancer, p, &faces) {
                    text.put(TARGET);
                }
                text.put("}\n");
            }
        }
    }

    /// Declares a prototype with hairs: ribbons of a mesh whose memory all instances share. The hairs cast no shadow, as the
    /// ribbons are wider than real hairs and would darken each other too much.
    fn write_hair_prototype(
        &self,
        text: &mut TextBuffer,
        instancer: usize,
        prototype: usize,
        hairs: &Mesh,
        rest: &Mesh,
    ) {
        text.put(&format!("#declare P_{}_{instancer}_{prototype} = union {{\nobject {{ ", self.index));
        write_mesh2(text, self.space, hairs, &Mesh2Faces::of(hairs, self.materials));
        text.put("no_shadow }\n");
        if has_area_anywhere(rest) {
            text.put("object { ");
            write_mesh2(text, self.space, rest, &Mesh2Faces::of(rest, self.materials));
            text.put("}\n");
        }
        text.put("}\n");
    }

    /// Whether prototype `p` is a drop whose largest instance has the size of a target of photons.
    fn is_target(&self, instancer: &Instancer, p: usize, faces: &Mesh2Faces) -> bool {
        let mine = |(i, _): &(usize, _)| instancer.protos.get(*i).is_some_and(|q| *q as usize == p);
        let scales = instancer.scales.iter().enumerate().filter(mine).map(|(_, s)| s.abs().max_element());
        // Half the longest side of the prototype's box times the largest scale: the radius of its largest instance, m.
        let radius = instancer.prototypes[p].mesh.bounds().size().max_element() * 0.5 * scales.fold(0.0, f32::max);
        faces.water().is_some() && photons::is_target_radius(self.photons, radius)
    }

    /// Whether the asset may have a target of photons at some frame.
    pub fn has_photon_target(&self) -> bool {
        // The mesh of a frame is not known yet, so a mesh that varies counts as a possible target.
        let rains = |m: &MeshObject| m.motion == MeshMotion::Varying || photons::is_all_water(&m.mesh, self.materials);
        if self.photons.is_some() && self.asset.meshes.iter().any(rains) {
            return true;
        }
        self.asset.instancers.iter().any(|i| {
            (0..i.prototypes.len())
                .any(|p| self.is_target(i, p, &Mesh2Faces::of(&i.prototypes[p].mesh, self.materials)))
        })
    }

    /// Declares the parts that never change, and the asset itself if it is not animated. Returns the number of instances.
    pub fn write_static(&self, text: &mut TextBuffer, warnings: &mut Vec<Warning>) -> usize {
        let a = self.index;
        text.put(&format!("\n// {}\n", self.asset.id));
        for (m, object) in self.asset.meshes.iter().enumerate() {
            if !has_area_anywhere(&object.mesh) {
                continue;
            }
            match object.motion {
                MeshMotion::Still if self.is_coated(&object.mesh) => self.declare_mesh_macro(text, m, &object.mesh),
                MeshMotion::Still => self.declare_mesh(text, m, &object.mesh),
                // Texture coordinates and faces stay: they are written once, and frames add points and normals.
                MeshMotion::Skinned | MeshMotion::Deforming => {
                    text.put(&format!("#macro R_{a}_{m}()\n"));
                    write_topology(text, &object.mesh, &Mesh2Faces::of(&object.mesh, self.materials));
                    text.put("#end\n");
                }
                MeshMotion::Varying => {}
            }
        }
        let mut count = 0;
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            count += match self.carrier_joints(instancer) {
                Some(joints) => self.declare_joint_unions(text, i, joints),
                None if instancer.motion == InstancerMotion::Still => {
                    self.declare_instances(text, i, instancer, &instancer.rest)
                }
                None => 0,
            };
        }
        // Moving points and curves are declared by the frames.
        self.declare_points(text, &AssetFrame::default(), false, warnings);
        self.declare_curves(text, &AssetFrame::default(), false);
        if !self.asset.moves() {
            self.declare_asset_macro(text, &AssetFrame::default());
        }
        count
    }

    /// Declares the parts that change at a frame, and the asset. Returns the number of instances.
    pub fn write_frame(&self, text: &mut TextBuffer, frame: &AssetFrame, warnings: &mut Vec<Warning>) -> usize {
        text.put(&format!("\n// {}\n", self.asset.id));
        for (m, object) in self.asset.meshes.iter().enumerate() {
            self.declare_moving_mesh(text, m, object, frame);
        }
        let mut count = 0;
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            if instancer.motion != InstancerMotion::Still && !self.follows_joints(instancer, i, frame) {
                let state = instance_states(self.asset, instancer, i, frame);
                count += self.declare_instances(text, i, instancer, &state);
            }
        }
        self.declare_points(text, frame, true, warnings);
        self.declare_curves(text, frame, true);
        self.declare_asset_macro(text, frame);
        count
    }

    fn declare_mesh(&self, text: &mut TextBuffer, m: usize, mesh: &Mesh) {
        text.put(&format!("#declare G_{}_{m} = ", self.index));
        if self.photons.is_some() && photons::is_all_water(mesh, self.materials) {
            return self.write_water_mesh(text, mesh);
        }
        write_mesh2(text, self.space, mesh, &Mesh2Faces::of(mesh, self.materials));
    }

    /// Writes a mesh of drops, targets of photons apart from the others.
    fn write_water_mesh(&self, text: &mut TextBuffer, mesh: &Mesh) {
        let (large, small) = photons::split_targets(mesh, self.photons);
        // POV-Ray warns of a union of a single object.
        let both = has_area_anywhere(&large) && has_area_anywhere(&small);
        text.put(if both { "union {\n" } else { "" });
        for (part, target) in [(&large, TARGET), (&small, "")] {
            if has_area_anywhere(part) {
                text.put("object { ");
                write_mesh2(text, self.space, part, &Mesh2Faces::of(part, self.materials));
                text.put(target).put("}\n");
            }
        }
        text.put(if both { "}\n" } else { "" });
    }

    /// Declares a static mesh whose texture changes as a macro, so that POV-Ray looks up the texture at each call.
    fn declare_mesh_macro(&self, text: &mut TextBuffer, m: usize, mesh: &Mesh) {
        text.put(&format!("#macro G_{}_{m}() ", self.index));
        write_mesh2(text, self.space, mesh, &Mesh2Faces::of(mesh, self.materials));
        text.put("#end\n");
    }

    /// Whether a material of a mesh has a coat, whose maps change with the frame.
    fn is_coated(&self, mesh: &Mesh) -> bool {
        mesh.subsets.iter().any(|s| self.materials.get(s.material as usize).is_some_and(|m| m.coat.is_some()))
    }

    fn declare_moving_mesh(&self, text: &mut TextBuffer, m: usize, object: &MeshObject, frame: &AssetFrame) {
        let a = self.index;
        if object.motion == MeshMotion::Still || !has_area_anywhere(mesh_at_frame(object, frame.mesh(m))) {
            return;
        }
        match (object.motion, frame.mesh(m)) {
            (_, MeshFrame::Whole { mesh, .. }) => self.declare_mesh(text, m, mesh),
            (MeshMotion::Varying, _) => self.declare_mesh(text, m, &object.mesh),
            (_, state) => {
                // The posed points are written in full, with the normals of the frame, of the pose, or of rest.
                let posed = mesh_points(self.asset, object, m, frame);
                let skinned;
                let normals = match (state, &object.skin, &self.asset.skeleton) {
                    (MeshFrame::Points { normals, .. }, _, _) => normals,
                    (_, Some(skin), Some(skeleton)) if object.motion == MeshMotion::Skinned => {
                        let matrices = skinning_matrices(skeleton, &frame.pose);
                        skinned = skinned_normals(&object.mesh.normals, skin, &matrices);
                        &skinned
                    }
                    _ => &object.mesh.normals,
                };
                text.put(&format!("#declare G_{a}_{m} = mesh2{{\n"));
                write_vectors(text, self.space, &posed, normals);
                text.put(&format!("R_{a}_{m}()}}\n"));
            }
        }
    }

    /// The joint of each instance if instances are attached to joints, else `None`.
    fn carrier_joints<'b>(&self, instancer: &'b Instancer) -> Option<&'b [u16]> {
        match &instancer.motion {
            InstancerMotion::Joints(joints) if self.asset.skeleton.is_some() => Some(joints),
            _ => None,
        }
    }

    /// Whether a frame moves the instances of an instancer by the unions of their joints. A separate state of the
    /// instances is then ignored, unless the joints would show them apart from the objects that touch them. One line
    /// per joint instead of one per leaf keeps the files of a clip small, but omits the flutter of leaves.
    fn follows_joints(&self, instancer: &Instancer, i: usize, frame: &AssetFrame) -> bool {
        let stated = matches!(frame.instancer(i), InstancerFrame::State(_));
        self.carrier_joints(instancer).is_some() && !(stated && (frame.pose.is_empty() || self.leaves_joints()))
    }

    /// Whether instances must be exactly where their states say: on bark whose points the frames contain, since joints
    /// only approximate it, and under drops, which lie on leaves as these flutter and nod.
    fn leaves_joints(&self) -> bool {
        let deforms = |m: &MeshObject| m.motion == MeshMotion::Deforming;
        self.asset.meshes.iter().any(deforms) || has_water(self.materials)
    }

    /// Declares a union of the instances on each joint that carries some. Returns the number of instances.
    fn declare_joint_unions(&self, text: &mut TextBuffer, i: usize, joints: &[u16]) -> usize {
        let instancer = &self.asset.instancers[i];
        let mut count = 0;
        for j in distinct_joints(joints) {
            let mine: Vec<usize> = (0..instancer.len()).filter(|k| joints.get(*k) == Some(&j)).collect();
            // The joint's instances at rest; a frame transforms their union by the joint's motion.
            let part = select_instances(instancer, &mine);
            text.put(&format!("#declare J_{}_{i}_{j} = ", self.index));
            let mut lines = TextBuffer::default();
            let uses = self.prototype_uses(instancer);
            let some = write_instances(&mut lines, self.space, (self.index, i), &part, &part.rest, &uses);
            write_union(text, some, &lines, "");
            count += some;
        }
        count
    }

    fn declare_instances(
        &self,
        text: &mut TextBuffer,
        i: usize,
        instancer: &Instancer,
        state: &InstanceState,
    ) -> usize {
        // As with coated meshes, a macro makes POV-Ray look up the texture of the frame at each call.
        let coated = self.has_coated_prototype(instancer);
        let declaration = if coated {
            format!("#macro L_{}_{i}() ", self.index)
        } else {
            format!("#declare L_{}_{i} = ", self.index)
        };
        text.put(&declaration);
        let mut lines = TextBuffer::default();
        // Formatted into a buffer first, because the form of the object depends on the number of instances.
        let count =
            write_instances(&mut lines, self.space, (self.index, i), instancer, state, &self.prototype_uses(instancer));
        write_union(text, count, &lines, "");
        text.put(if coated { "#end\n" } else { "" });
        count
    }

    fn declare_points(&self, text: &mut TextBuffer, frame: &AssetFrame, moving: bool, warnings: &mut Vec<Warning>) {
        for (i, points) in self.asset.points.iter().enumerate().filter(|(_, p)| p.moving == moving) {
            let at = CloudFrame { now: points.at(frame.points(i)), view: self.view };
            text.put(&format!("#declare D_{}_{i} = ", self.index));
            let dropped = write_points(text, self.space, points, self.materials, &at);
            if dropped > 0 {
                let message = format!(
                    "asset {}, points {}: {dropped} points over {MAX_SPHERES} spheres are left out",
                    self.asset.id, points.name
                );
                // One warning per count, not one per frame of the clip.
                if !warnings.iter().any(|w| w.message == message) {
                    warnings.push(Warning { code: "X013", message });
                }
            }
        }
    }

    fn declare_curves(&self, text: &mut TextBuffer, frame: &AssetFrame, moving: bool) {
        for (i, c) in self.asset.curves.iter().enumerate().filter(|(_, c)| c.moving == moving) {
            let points = match frame.curves(i) {
                CurvesFrame::Points(points) => points,
                CurvesFrame::Same => &c.points,
            };
            text.put(&format!("#declare H_{}_{i} = ", self.index));
            write_curves(text, self.space, c, points, self.materials);
        }
    }

    /// Declares the asset as a macro over its parts: POV-Ray copies a declared object at each use, a macro is expanded.
    fn declare_asset_macro(&self, text: &mut TextBuffer, frame: &AssetFrame) {
        let a = self.index;
        // One line for each mesh with faces at this frame, each joint or instancer, each cloud and each curves primitive.
        let mut parts = TextBuffer::default();
        let mut count = 0;
        for (m, object) in self.asset.meshes.iter().enumerate() {
            if has_area_anywhere(mesh_at_frame(object, frame.mesh(m))) {
                let call = if object.motion == MeshMotion::Still && self.is_coated(&object.mesh) { "()" } else { "" };
                parts.put(&format!("object{{G_{a}_{m}{call}}}\n"));
                count += 1;
            }
        }
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            match (self.carrier_joints(instancer), &self.asset.skeleton) {
                (Some(joints), Some(skeleton)) if self.follows_joints(instancer, i, frame) => {
                    // Instances are declared at rest; a joint moves them from its rest transform to that of the pose.
                    let motions = if frame.pose.is_empty() { Vec::new() } else { joint_motions(skeleton, &frame.pose) };
                    for j in distinct_joints(joints) {
                        parts.put(&format!("object{{J_{a}_{i}_{j} "));
                        let still = Trs::IDENTITY;
                        self.space.write_matrix(&mut parts, motions.get(usize::from(j)).unwrap_or(&still));
                        parts.put("}\n");
                        count += 1;
                    }
                }
                _ => {
                    let call = if self.has_coated_prototype(instancer) { "()" } else { "" };
                    parts.put(&format!("object{{L_{a}_{i}{call}}}\n"));
                    count += 1;
                }
            }
        }
        for i in 0..self.asset.points.len() {
            parts.put(&format!("object{{D_{a}_{i}}}\n"));
            count += 1;
        }
        for i in 0..self.asset.curves.len() {
            parts.put(&format!("object{{H_{a}_{i}}}\n"));
            count += 1;
        }
        text.put(&format!("#macro A_{a}() "));
        write_union(text, count, &parts, "");
        text.put("#end\n");
    }
}

/// Whether a scene of these materials has water: rain.
pub(super) fn has_water(materials: &[Material]) -> bool {
    materials.iter().any(|m| m.class == MaterialClass::Water)
}

/// The mesh that contains the triangles of an object at a frame.
fn mesh_at_frame<'a>(object: &'a MeshObject, frame: &'a MeshFrame) -> &'a Mesh {
    match frame {
        MeshFrame::Whole { mesh, .. } if object.motion != MeshMotion::Still => mesh,
        _ => &object.mesh,
    }
}

/// Indices of the joints that carry instances, increasing, each once.
fn distinct_joints(joints: &[u16]) -> std::collections::BTreeSet<u16> {
    joints.iter().copied().collect()
}

/// Copies selected instances of an instancer at rest, without prototypes and ids. `which`: their indices.
fn select_instances(instancer: &Instancer, which: &[usize]) -> Instancer {
    let rest = &instancer.rest;
    let state = InstanceState {
        positions: which.iter().filter_map(|k| rest.positions.get(*k).copied()).collect(),
        orientations: which.iter().filter_map(|k| rest.orientations.get(*k).copied()).collect(),
        alive: which.iter().map(|k| rest.is_alive(*k)).collect(),
        sizes: which.iter().filter_map(|k| rest.sizes.get(*k).copied()).collect(),
        ..InstanceState::default()
    };
    Instancer {
        name: instancer.name.clone(),
        prototypes: Vec::new(),
        ids: Vec::new(),
        protos: which.iter().filter_map(|k| instancer.protos.get(*k).copied()).collect(),
        scales: which.iter().filter_map(|k| instancer.scales.get(*k).copied()).collect(),
        rest: state,
        motion: InstancerMotion::Still,
        tracked: false,
    }
}
