//! What one asset puts into a file, made once and shown by each of its placements.

use std::collections::BTreeSet;

use glam::Vec3;

use super::Profile;
use super::document::{Document, Drive, Motion, finite};
use super::instances::{Group, members};
use super::json::{Index, NodeExtensions};
use super::keys;
use super::materials::Shown;
use super::meshes::{Drawn, Influences, Shape};
use super::rig::{JOINTS, Rig};
use super::tracks::{Moving, Shapes};
use osier_base::Result;
use osier_scene::{Asset, Instancer, InstancerMotion, Mesh, MeshMotion, MeshObject, Trs, ribbons};

/// Everything an asset shows.
#[derive(Debug, Default)]
pub(super) struct Parts {
    pub joints: Vec<Joint>,
    /// Inverse bind matrices, where a mesh is skinned.
    pub inverse_bind: Option<Index>,
    pub shown: Vec<Part>,
}

/// A joint node.
#[derive(Debug)]
pub(super) struct Joint {
    pub name: String,
    pub parent: Option<usize>,
    pub motion: Motion,
}

/// Where a part hangs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hold {
    /// On the placement's node.
    Placement,
    /// On a joint.
    Joint(usize),
    /// In the scene, moved by the skin.
    Skin,
}

/// A node to be made for every placement.
#[derive(Debug)]
pub(super) struct Part {
    pub name: String,
    pub kind: &'static str,
    /// Tail of the node's id, after the placement's name.
    pub id: String,
    pub mesh: Index,
    pub hold: Hold,
    pub motion: Motion,
    pub instancing: Option<NodeExtensions>,
    /// Instancer and instance of a moving instance: shown only where it was chosen.
    pub moving: Option<(usize, usize)>,
}

impl Part {
    fn new(name: &str, kind: &'static str, mesh: Index, hold: Hold) -> Self {
        let motion = Motion::default();
        Self { name: name.to_owned(), kind, id: name.to_owned(), mesh, hold, motion, instancing: None, moving: None }
    }
}

/// Moving instances of an asset that some placement shows: (instancer, instance).
pub(super) type Chosen = BTreeSet<(usize, usize)>;

impl Document<'_> {
    /// The joints of an asset that a file animates.
    pub(super) fn rig(&self, asset: usize) -> Option<Rig> {
        let from = self.from;
        let (source, tracks) = from.scene.assets.get(asset).zip(from.tracks.assets.get(asset))?;
        let mut rig = Rig::new(source, &tracks.poses, self.joints.min(JOINTS))?;
        let all = source.skeleton.as_ref().map_or(0, |s| s.joints.len());
        // Fewer joints than the format takes are the profile's choice, about which there is nothing to warn.
        rig.warning = rig.warning.filter(|_| all > JOINTS);
        Some(rig)
    }

    /// Makes the parts of an asset.
    pub(super) fn parts(&mut self, asset: usize, chosen: &Chosen) -> Result<Parts> {
        let from = self.from;
        let Some(source) = from.scene.assets.get(asset) else { return Ok(Parts::default()) };
        let Some(tracks) = from.tracks.assets.get(asset) else { return Ok(Parts::default()) };
        let mut parts = Parts::default();
        let rig = if from.tracks.is_still() { None } else { self.rig(asset) };
        for (object, shapes) in source.meshes.iter().zip(&tracks.meshes) {
            self.object(&mut parts, source, object, rig.as_ref(), shapes)?;
        }
        for (i, instancer) in source.instancers.iter().enumerate() {
            let what = format!("asset {}, instancer {}", source.id, instancer.name);
            match (&instancer.motion, &rig) {
                (InstancerMotion::Free, _) if !from.tracks.is_still() => {
                    let list: Vec<&Moving> = tracks
                        .moving
                        .iter()
                        .filter(|m| m.instancer == i && chosen.contains(&(i, m.instance)))
                        .collect();
                    self.moving(&mut parts, instancer, &list, &what)?;
                }
                (InstancerMotion::Joints(joints), Some(rig)) => {
                    self.riding(&mut parts, instancer, rig, joints, &what)?;
                }
                _ => self.standing(&mut parts, instancer, &what)?,
            }
        }
        for cloud in source.points.iter().filter(|c| !c.moving || from.tracks.is_still()) {
            if let Some(mesh) = self.cloud(cloud, &format!("asset {}, points {}", source.id, cloud.name))? {
                parts.shown.push(Part::new(&cloud.name, "points", mesh, Hold::Placement));
            }
        }
        for (curves, shapes) in source.curves.iter().zip(&tracks.curves) {
            let tile = from.scene.materials.get(curves.material as usize).map_or(1.0, |m| m.tile);
            let rest = ribbons(curves, &curves.points, tile);
            let bent = |list: &[Shape]| -> Vec<Shape> {
                let shape = |(points, _): &Shape| ribbons(curves, points, tile);
                list.iter().map(shape).map(|m| (m.points, m.normals)).collect()
            };
            let shapes = match shapes {
                Shapes::Frames(list) => bent(list),
                // X017 says that they are left out.
                Shapes::TooMany => continue,
                Shapes::Still => Vec::new(),
            };
            let what = format!("asset {}, curves {}", source.id, curves.name);
            let drawn =
                Drawn { name: &curves.name, what: &what, mesh: &rest, shown: Shown::Ribbon, skin: None, shapes: &[] };
            self.morphing(&mut parts, drawn, &shapes, "curves")?;
        }
        if parts.shown.iter().any(|p| p.hold != Hold::Placement)
            && let Some(rig) = &rig
        {
            self.warnings.extend(rig.warning.clone());
            parts.joints = self.joints(source, rig, &tracks.poses)?;
            if parts.shown.iter().any(|p| p.hold == Hold::Skin) {
                let what = format!("asset {}, skin", source.id);
                parts.inverse_bind = Some(self.buffer.matrices(&rig.inverse_bind(), &what)?);
            }
        }
        Ok(parts)
    }

    fn object(
        &mut self,
        parts: &mut Parts,
        asset: &Asset,
        object: &MeshObject,
        rig: Option<&Rig>,
        shapes: &Shapes,
    ) -> Result<()> {
        let what = format!("asset {}, mesh {}", asset.id, object.name);
        let (mesh, name) = (&object.mesh, object.name.as_str());
        let drawn = Drawn { name, what: &what, mesh, shown: Shown::Mesh, skin: None, shapes: &[] };
        let moves = matches!(object.motion, MeshMotion::Skinned | MeshMotion::Deforming);
        match (rig, &object.skin, shapes) {
            (Some(rig), Some(skin), _) if moves => {
                let (joints, weights) = rig.weights(skin);
                let skin = Influences { joints, weights, count: rig.kept.len() };
                if let Some(mesh) = self.mesh(Drawn { skin: Some(&skin), ..drawn })? {
                    parts.shown.push(Part::new(name, "mesh", mesh, Hold::Skin));
                }
                Ok(())
            }
            (_, _, Shapes::Frames(list)) => self.morphing(parts, drawn, list, "mesh"),
            _ => self.morphing(parts, drawn, &[], "mesh"),
        }
    }

    /// A mesh with a target for every frame whose shape differs from rest, and the weights that pick it.
    fn morphing(&mut self, parts: &mut Parts, drawn: Drawn<'_>, shapes: &[Shape], kind: &'static str) -> Result<()> {
        let same = |mesh: &Mesh, s: &Shape| s.0 == mesh.points && (s.1.is_empty() || s.1 == mesh.normals);
        let bent: Vec<usize> = (0..shapes.len()).filter(|&i| !same(drawn.mesh, &shapes[i])).collect();
        let tag = |i: usize| {
            let number = self.from.tracks.numbers.get(i).copied().unwrap_or_default();
            format!("frame_{}", self.from.scene.clip.tag(number))
        };
        let targets: Vec<(String, &Shape)> = bent.iter().map(|&i| (tag(i), &shapes[i])).collect();
        let Some(mesh) = self.mesh(Drawn { shapes: &targets, ..drawn })? else { return Ok(()) };
        let mut part = Part::new(drawn.name, kind, mesh, Hold::Placement);
        if !bent.is_empty() {
            let weights: Vec<f32> =
                (0..shapes.len()).flat_map(|i| bent.iter().map(move |&b| if i == b { 1.0 } else { 0.0 })).collect();
            let output = self.buffer.scalars(&weights, drawn.what)?;
            let frames: Vec<usize> = (0..shapes.len()).collect();
            part.motion.drives.push(Drive { sampler: self.sampler(&frames, output, false)?, path: "weights" });
        }
        parts.shown.push(part);
        Ok(())
    }

    /// Instances that do not move.
    fn standing(&mut self, parts: &mut Parts, instancer: &Instancer, what: &str) -> Result<()> {
        for (proto, members) in
            members(instancer, &instancer.rest).into_iter().enumerate().filter(|(_, m)| !m.is_empty())
        {
            let group = Group { instancer, state: &instancer.rest, proto, members, what };
            let name = format!("{}_{}", instancer.name, instancer.prototypes[proto].name);
            let (mesh, instancing) = match self.from.profile {
                Profile::Web => match self.prototype(instancer, proto, what)? {
                    Some(mesh) => (Some(mesh), Some(self.instancing(&group, &Trs::IDENTITY)?)),
                    None => (None, None),
                },
                Profile::Blender => (self.merged(name.clone(), &[group], &Trs::IDENTITY)?, None),
            };
            if let Some(mesh) = mesh {
                parts.shown.push(Part { instancing, ..Part::new(&name, "instancer", mesh, Hold::Placement) });
            }
        }
        Ok(())
    }

    /// Instances that ride on joints.
    fn riding(
        &mut self,
        parts: &mut Parts,
        instancer: &Instancer,
        rig: &Rig,
        joints: &[u16],
        what: &str,
    ) -> Result<()> {
        let carriers: Vec<u16> =
            joints.iter().map(|j| rig.carrier.get(usize::from(*j)).copied().unwrap_or(0)).collect();
        let state = &instancer.rest;
        // The groups on each joint: one for each prototype of which it carries some.
        let mut riders: Vec<Vec<Group<'_>>> = rig.kept.iter().map(|_| Vec::new()).collect();
        for (proto, members) in members(instancer, state).into_iter().enumerate() {
            let mut on: Vec<Vec<usize>> = vec![Vec::new(); rig.kept.len()];
            for i in members {
                if let Some(list) = carriers.get(i).and_then(|c| on.get_mut(usize::from(*c))) {
                    list.push(i);
                }
            }
            for (groups, members) in riders.iter_mut().zip(on).filter(|(_, m)| !m.is_empty()) {
                groups.push(Group { instancer, state, proto, members, what });
            }
        }
        if self.from.profile == Profile::Blender {
            // A mesh on each joint moves as one with a skin would, and importers need not weigh its vertices.
            for (k, groups) in riders.iter().enumerate() {
                let name = format!("{}_{k}", instancer.name);
                if let Some(mesh) = self.merged(name.clone(), groups, &rig.bind[rig.kept[k]])? {
                    parts.shown.push(Part::new(&name, "instancer", mesh, Hold::Joint(k)));
                }
            }
            return Ok(());
        }
        let is_used = |proto: &usize| riders.iter().flatten().any(|g| g.proto == *proto);
        for proto in (0..instancer.prototypes.len()).filter(is_used) {
            let name = format!("{}_{}", instancer.name, instancer.prototypes[proto].name);
            let Some(mesh) = self.prototype(instancer, proto, what)? else { continue };
            for (k, groups) in riders.iter().enumerate() {
                for group in groups.iter().filter(|g| g.proto == proto) {
                    let instancing = Some(self.instancing(group, &rig.bind[rig.kept[k]])?);
                    let name = format!("{name}_{k}");
                    parts.shown.push(Part { instancing, ..Part::new(&name, "instancer", mesh, Hold::Joint(k)) });
                }
            }
        }
        Ok(())
    }

    /// Instances that move on their own: a node each, shown while alive.
    fn moving(&mut self, parts: &mut Parts, instancer: &Instancer, list: &[&Moving], what: &str) -> Result<()> {
        let mut meshes: Vec<Option<Index>> = vec![None; instancer.prototypes.len()];
        let mut list = list.to_vec();
        list.sort_by_key(|m| m.instance);
        let times = &self.from.tracks.times;
        let thin = self.from.profile == Profile::Web;
        for m in list {
            let Some(proto) = instancer.protos.get(m.instance).map(|p| *p as usize) else { continue };
            let mesh = match meshes.get(proto).copied().flatten() {
                Some(mesh) => mesh,
                None => match self.prototype(instancer, proto, what)? {
                    Some(mesh) => mesh,
                    None => continue,
                },
            };
            meshes[proto] = Some(mesh);
            let scale = instancer.scales.get(m.instance).copied().unwrap_or(Vec3::ONE);
            let (positions, orientations) = m.held();
            let mut motion = Motion::default();
            motion.rest.t = positions.first().copied().unwrap_or_default();
            motion.rest.r = orientations.first().copied().unwrap_or_default();
            motion.rest.s = if m.alive.first().copied().unwrap_or(true) { scale } else { Vec3::ZERO };
            let Motion { rest, drives } = &mut motion;
            self.drive_vector(keys::positions(times, &positions, thin), "translation", false, &mut rest.t, drives)?;
            self.drive_rotation(keys::rotations(times, &orientations, thin), &mut rest.r, drives)?;
            self.drive_vector(keys::appearances(&m.alive, scale), "scale", true, &mut rest.s, drives)?;
            let name = format!("{}_{}", instancer.name, m.instance);
            let id = format!("{}/{}", instancer.name, instancer.ids.get(m.instance).copied().unwrap_or_default());
            let part = Part::new(&name, "instance", mesh, Hold::Placement);
            parts.shown.push(Part { id, motion, moving: Some((m.instancer, m.instance)), ..part });
        }
        Ok(())
    }

    /// The joints of an asset as they move so many frames later, the clip repeated.
    pub(super) fn joints_later(&mut self, asset: usize, phase: u32) -> Result<Vec<Joint>> {
        let from = self.from;
        let Some((source, tracks)) = from.scene.assets.get(asset).zip(from.tracks.assets.get(asset)) else {
            return Ok(Vec::new());
        };
        let Some(rig) = self.rig(asset).filter(|_| !tracks.poses.is_empty()) else {
            return Ok(Vec::new());
        };
        let mut poses = tracks.poses.clone();
        let count = poses.len();
        // Frames may have been left out: the phase is a share of the clip.
        let share = phase as usize * count / from.scene.clip.len().max(1);
        poses.rotate_left(share % count);
        self.joints(source, &rig, &poses)
    }

    fn joints(&mut self, asset: &Asset, rig: &Rig, poses: &[Vec<Trs>]) -> Result<Vec<Joint>> {
        let Some(skeleton) = &asset.skeleton else { return Ok(Vec::new()) };
        let mut joints = Vec::new();
        let times = &self.from.tracks.times;
        let thin = self.from.profile == Profile::Web;
        for (k, &i) in rig.kept.iter().enumerate() {
            let joint = &skeleton.joints[i];
            finite(&joint.rest, || format!("asset {}, joint {}", asset.id, joint.name))?;
            let mut motion = Motion { rest: joint.rest, ..Motion::default() };
            let Motion { rest, drives } = &mut motion;
            let of = |f: &dyn Fn(&Trs) -> Vec3| poses.iter().map(|p| f(&p[i])).collect::<Vec<Vec3>>();
            let turns: Vec<_> = poses.iter().map(|p| p[i].r).collect();
            self.drive_vector(keys::positions(times, &of(&|j| j.t), thin), "translation", false, &mut rest.t, drives)?;
            self.drive_rotation(keys::rotations(times, &turns, thin), &mut rest.r, drives)?;
            self.drive_vector(keys::positions(times, &of(&|j| j.s), thin), "scale", false, &mut rest.s, drives)?;
            let parent = rig.parent(skeleton, k);
            joints.push(Joint { name: joint.name.clone(), parent, motion });
        }
        Ok(joints)
    }
}
