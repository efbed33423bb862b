//! What an asset puts into prototypes.inc, static.inc and the frame files.
//!
//! Identifiers carry indices: `P_a_i_p` prototype, `G_a_m` mesh, `R_a_m` the unchanging part of a moving mesh,
//! (still ones with a coat are macros, as their texture comes with the frame), `L_a_i` instances, `J_a_i_j` the instances that ride on joint j, `D_a_p` points, `H_a_c` curves, `A_a` the asset.

use super::mesh::{Faces, mesh2, shows, topology, unhaired, vectors};
use super::objects::{Cloud, SPHERES, View, cloud, curves, group, instances};
use super::photons;
use super::space::Space;
use crate::Warning;
use crate::text::Text;
use osier_scene::{
    Asset, AssetFrame, CurvesFrame, InstanceState, Instancer, InstancerFrame, InstancerMotion, Material, Mesh,
    MeshFrame, MeshMotion, MeshObject, Trs, instance_states, joint_motions, mesh_points, skinned_normals,
    world_from_joint,
};

/// What aims photons at an object.
const TARGET: &str = "photons { target reflection on refraction on collect off }";

/// One asset on its way out, with what all its parts need.
pub(super) struct Part<'a> {
    /// Index in the scene.
    pub index: usize,
    /// The asset.
    pub asset: &'a Asset,
    /// Units.
    pub space: Space,
    /// The scene's materials.
    pub materials: &'a [Material],
    /// How what falls is seen.
    pub view: View,
    /// Radius of the smallest drop that photons aim at, m, if any.
    pub photons: Option<f32>,
}

impl Part<'_> {
    /// Whether each prototype of an instancer has anything to show.
    fn shown(instancer: &Instancer) -> Vec<bool> {
        instancer.prototypes.iter().map(|p| shows(&p.mesh)).collect()
    }

    /// Prototypes of the asset's instancers.
    pub fn prototypes(&self, text: &mut Text) {
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            for (p, proto) in instancer.prototypes.iter().enumerate() {
                if !shows(&proto.mesh) {
                    continue;
                }
                text.put(&format!("// {} {} {}\n", self.asset.id, instancer.name, proto.name));
                if let Some((hairs, rest)) = unhaired(&proto.mesh, self.materials) {
                    self.tuft(text, i, p, &hairs, &rest);
                    continue;
                }
                let faces = Faces::of(&proto.mesh, self.materials);
                text.put(&format!("#declare P_{}_{i}_{p} = object {{ ", self.index));
                mesh2(text, self.space, &proto.mesh, &faces);
                if self.is_target(instancer, p, &faces) {
                    text.put(TARGET);
                }
                text.put("}\n");
            }
        }
    }

    /// A prototype with hairs, ribbons of a mesh whose memory all instances share. They throw no shadow: wider than life as
    /// they are, they would darken each other.
    fn tuft(&self, text: &mut Text, instancer: usize, prototype: usize, hairs: &Mesh, rest: &Mesh) {
        text.put(&format!("#declare P_{}_{instancer}_{prototype} = union {{\nobject {{ ", self.index));
        mesh2(text, self.space, hairs, &Faces::of(hairs, self.materials));
        text.put("no_shadow }\n");
        if shows(rest) {
            text.put("object { ");
            mesh2(text, self.space, rest, &Faces::of(rest, self.materials));
            text.put("}\n");
        }
        text.put("}\n");
    }

    /// True if photons aim at the drops that show prototype `p`.
    fn is_target(&self, instancer: &Instancer, p: usize, faces: &Faces) -> bool {
        let mine = |(i, _): &(usize, _)| instancer.protos.get(*i).is_some_and(|q| *q as usize == p);
        let scales = instancer.scales.iter().enumerate().filter(mine).map(|(_, s)| s.abs().max_element());
        let radius = instancer.prototypes[p].mesh.bounds().size().max_element() * 0.5 * scales.fold(0.0, f32::max);
        faces.water().is_some() && photons::aims(self.photons, radius)
    }

    /// True if any photon may have an aim in this asset.
    pub fn has_target(&self) -> bool {
        let rains = |m: &MeshObject| m.motion == MeshMotion::Varying || photons::is_water(&m.mesh, self.materials);
        if self.photons.is_some() && self.asset.meshes.iter().any(rains) {
            return true;
        }
        self.asset.instancers.iter().any(|i| {
            (0..i.prototypes.len()).any(|p| self.is_target(i, p, &Faces::of(&i.prototypes[p].mesh, self.materials)))
        })
    }

    /// Declares what never changes; for a still asset also the asset itself. Returns the number of instances.
    pub fn still(&self, text: &mut Text, warnings: &mut Vec<Warning>) -> usize {
        let a = self.index;
        text.put(&format!("\n// {}\n", self.asset.id));
        for (m, object) in self.asset.meshes.iter().enumerate() {
            if !shows(&object.mesh) {
                continue;
            }
            match object.motion {
                MeshMotion::Still if self.is_coated(&object.mesh) => self.macro_mesh(text, m, &object.mesh),
                MeshMotion::Still => self.declare_mesh(text, m, &object.mesh),
                MeshMotion::Skinned | MeshMotion::Deforming => {
                    text.put(&format!("#macro R_{a}_{m}()\n"));
                    topology(text, &object.mesh, &Faces::of(&object.mesh, self.materials));
                    text.put("#end\n");
                }
                MeshMotion::Varying => {}
            }
        }
        let mut count = 0;
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            count += match self.joints(instancer) {
                Some(joints) => self.joint_unions(text, i, joints),
                None if instancer.motion == InstancerMotion::Still => {
                    self.instance_union(text, i, instancer, &instancer.rest)
                }
                None => 0,
            };
        }
        self.points(text, &AssetFrame::default(), false, warnings);
        self.curves(text, &AssetFrame::default(), false);
        if !self.asset.moves() {
            self.whole(text, &AssetFrame::default());
        }
        count
    }

    /// Declares what a frame changes, and the asset. Returns the number of instances.
    pub fn frame(&self, text: &mut Text, frame: &AssetFrame, warnings: &mut Vec<Warning>) -> usize {
        text.put(&format!("\n// {}\n", self.asset.id));
        for (m, object) in self.asset.meshes.iter().enumerate() {
            self.moving_mesh(text, m, object, frame);
        }
        let mut count = 0;
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            if instancer.motion != InstancerMotion::Still && !self.rides(instancer, i, frame) {
                let state = instance_states(self.asset, instancer, i, frame);
                count += self.instance_union(text, i, instancer, &state);
            }
        }
        self.points(text, frame, true, warnings);
        self.curves(text, frame, true);
        self.whole(text, frame);
        count
    }

    fn declare_mesh(&self, text: &mut Text, m: usize, mesh: &Mesh) {
        text.put(&format!("#declare G_{}_{m} = ", self.index));
        if self.photons.is_some() && photons::is_water(mesh, self.materials) {
            return self.drops(text, mesh);
        }
        mesh2(text, self.space, mesh, &Faces::of(mesh, self.materials));
    }

    /// Drops in a mesh: those that photons aim at for themselves.
    fn drops(&self, text: &mut Text, mesh: &Mesh) {
        let (large, small) = photons::split(mesh, self.photons);
        let both = shows(&large) && shows(&small);
        text.put(if both { "union {\n" } else { "" });
        for (part, target) in [(&large, TARGET), (&small, "")] {
            if shows(part) {
                text.put("object { ");
                mesh2(text, self.space, part, &Faces::of(part, self.materials));
                text.put(target).put("}\n");
            }
        }
        text.put(if both { "}\n" } else { "" });
    }

    /// A mesh that stands still in a texture that does not.
    fn macro_mesh(&self, text: &mut Text, m: usize, mesh: &Mesh) {
        text.put(&format!("#macro G_{}_{m}() ", self.index));
        mesh2(text, self.space, mesh, &Faces::of(mesh, self.materials));
        text.put("#end\n");
    }

    /// True if maps of the frame lie on a mesh.
    fn is_coated(&self, mesh: &Mesh) -> bool {
        mesh.subsets.iter().any(|s| self.materials.get(s.material as usize).is_some_and(|m| m.coat.is_some()))
    }

    fn moving_mesh(&self, text: &mut Text, m: usize, object: &MeshObject, frame: &AssetFrame) {
        let a = self.index;
        if object.motion == MeshMotion::Still || !shows(shape(object, frame.mesh(m))) {
            return;
        }
        match (object.motion, frame.mesh(m)) {
            (_, MeshFrame::Whole { mesh, .. }) => self.declare_mesh(text, m, mesh),
            (MeshMotion::Varying, _) => self.declare_mesh(text, m, &object.mesh),
            (_, state) => {
                let posed = mesh_points(self.asset, object, m, frame);
                let skinned;
                let normals = match (state, &object.skin, &self.asset.skeleton) {
                    (MeshFrame::Points { normals, .. }, _, _) => normals,
                    (_, Some(skin), Some(skeleton)) if object.motion == MeshMotion::Skinned => {
                        let matrices = world_from_joint(skeleton, &frame.pose);
                        skinned = skinned_normals(&object.mesh.normals, skin, &matrices);
                        &skinned
                    }
                    _ => &object.mesh.normals,
                };
                text.put(&format!("#declare G_{a}_{m} = mesh2{{\n"));
                vectors(text, self.space, &posed, normals);
                text.put(&format!("R_{a}_{m}()}}\n"));
            }
        }
    }

    /// The joints that instances ride on, if they do.
    fn joints<'b>(&self, instancer: &'b Instancer) -> Option<&'b [u16]> {
        match &instancer.motion {
            InstancerMotion::Joints(joints) if self.asset.skeleton.is_some() => Some(joints),
            _ => None,
        }
    }

    /// True if a frame shows an instancer by moving its joints' unions. A finer state beside a pose is passed over: one
    /// line per joint instead of one per leaf keeps a clip's files small.
    fn rides(&self, instancer: &Instancer, i: usize, frame: &AssetFrame) -> bool {
        let stated = matches!(frame.instancer(i), InstancerFrame::State(_));
        self.joints(instancer).is_some() && !(stated && frame.pose.is_empty())
    }

    /// One union per joint that carries instances.
    fn joint_unions(&self, text: &mut Text, i: usize, joints: &[u16]) -> usize {
        let instancer = &self.asset.instancers[i];
        let mut count = 0;
        for j in used(joints) {
            let mine: Vec<usize> = (0..instancer.len()).filter(|k| joints.get(*k) == Some(&j)).collect();
            let part = pick(instancer, &mine);
            text.put(&format!("#declare J_{}_{i}_{j} = ", self.index));
            let mut lines = Text::default();
            let shown = Self::shown(instancer);
            let some = instances(&mut lines, self.space, (self.index, i), &part, &part.rest, &shown);
            group(text, some, &lines, "");
            count += some;
        }
        count
    }

    fn instance_union(&self, text: &mut Text, i: usize, instancer: &Instancer, state: &InstanceState) -> usize {
        text.put(&format!("#declare L_{}_{i} = ", self.index));
        let mut lines = Text::default();
        let count = instances(&mut lines, self.space, (self.index, i), instancer, state, &Self::shown(instancer));
        group(text, count, &lines, "");
        count
    }

    fn points(&self, text: &mut Text, frame: &AssetFrame, moving: bool, warnings: &mut Vec<Warning>) {
        for (i, points) in self.asset.points.iter().enumerate().filter(|(_, p)| p.moving == moving) {
            let at = Cloud { now: points.at(frame.points(i)), view: self.view };
            text.put(&format!("#declare D_{}_{i} = ", self.index));
            let dropped = cloud(text, self.space, points, self.materials, &at);
            if dropped > 0 {
                let message = format!(
                    "asset {}, points {}: {dropped} points over {SPHERES} spheres are left out",
                    self.asset.id, points.name
                );
                if !warnings.iter().any(|w| w.message == message) {
                    warnings.push(Warning { code: "X013", message });
                }
            }
        }
    }

    fn curves(&self, text: &mut Text, frame: &AssetFrame, moving: bool) {
        for (i, c) in self.asset.curves.iter().enumerate().filter(|(_, c)| c.moving == moving) {
            let points = match frame.curves(i) {
                CurvesFrame::Points(points) => points,
                CurvesFrame::Same => &c.points,
            };
            text.put(&format!("#declare H_{}_{i} = ", self.index));
            curves(text, self.space, c, points, self.materials);
        }
    }

    /// The asset as a macro over its parts, so that nothing is held twice before it is placed.
    fn whole(&self, text: &mut Text, frame: &AssetFrame) {
        let a = self.index;
        let mut parts = Text::default();
        let mut count = 0;
        for (m, object) in self.asset.meshes.iter().enumerate() {
            if shows(shape(object, frame.mesh(m))) {
                let call = if object.motion == MeshMotion::Still && self.is_coated(&object.mesh) { "()" } else { "" };
                parts.put(&format!("object{{G_{a}_{m}{call}}}\n"));
                count += 1;
            }
        }
        for (i, instancer) in self.asset.instancers.iter().enumerate() {
            match (self.joints(instancer), &self.asset.skeleton) {
                (Some(joints), Some(skeleton)) if self.rides(instancer, i, frame) => {
                    let motions = if frame.pose.is_empty() { Vec::new() } else { joint_motions(skeleton, &frame.pose) };
                    for j in used(joints) {
                        parts.put(&format!("object{{J_{a}_{i}_{j} "));
                        let still = Trs::IDENTITY;
                        self.space.matrix(&mut parts, motions.get(usize::from(j)).unwrap_or(&still));
                        parts.put("}\n");
                        count += 1;
                    }
                }
                _ => {
                    parts.put(&format!("object{{L_{a}_{i}}}\n"));
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
        group(text, count, &parts, "");
        text.put("#end\n");
    }
}

/// The mesh that holds an object's triangles at a frame.
fn shape<'a>(object: &'a MeshObject, frame: &'a MeshFrame) -> &'a Mesh {
    match frame {
        MeshFrame::Whole { mesh, .. } if object.motion != MeshMotion::Still => mesh,
        _ => &object.mesh,
    }
}

/// Joints that carry something, in order.
fn used(joints: &[u16]) -> std::collections::BTreeSet<u16> {
    joints.iter().copied().collect()
}

/// Some of an instancer's instances at rest.
fn pick(instancer: &Instancer, which: &[usize]) -> Instancer {
    let rest = &instancer.rest;
    let state = InstanceState {
        positions: which.iter().filter_map(|k| rest.positions.get(*k).copied()).collect(),
        orientations: which.iter().filter_map(|k| rest.orientations.get(*k).copied()).collect(),
        alive: which.iter().map(|k| rest.is_alive(*k)).collect(),
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
