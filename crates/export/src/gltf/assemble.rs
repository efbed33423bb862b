//! Placements, joints, camera: the nodes of one file.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use glam::{Mat3, Quat, Vec3};

use super::super::Warning;
use super::buffer::last;
use super::document::{Document, finite, marked, placed};
use super::json::{Camera, Index, Node, Perspective, Skin};
use super::parts::{Chosen, Hold, Joint, Part, Parts};
use osier_base::Result;
use osier_scene::{InstancerMotion, Placement, Trs};

/// What a file shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shows {
    /// One asset at the origin.
    Asset(usize),
    /// All placements, with or without the camera.
    Scene { camera: bool },
}

/// Moving instances of each placement, by its position in the list.
type ChosenAt = BTreeMap<usize, Chosen>;

impl Document<'_> {
    /// Fills the document; false if there is nothing to see in it.
    pub(super) fn assemble(&mut self, shows: Shows) -> Result<bool> {
        let scene = self.from.scene;
        let own;
        let (placements, name): (&[Placement], &str) = match shows {
            Shows::Asset(asset) => {
                let Some(id) = scene.assets.get(asset).map(|a| a.id.clone()) else { return Ok(false) };
                own = [Placement { name: id, asset, transform: Trs::IDENTITY, phase: 0 }];
                (&own, &own[0].name)
            }
            Shows::Scene { .. } => (&scene.placements, &scene.name),
        };
        let prefixed = matches!(shows, Shows::Scene { .. });
        let copies = if prefixed { self.share(placements) } else { BTreeSet::new() };
        let chosen = self.choose(placements, name);
        let mut parts: BTreeMap<usize, Parts> = BTreeMap::new();
        let mut later: BTreeMap<(usize, u32), Vec<Joint>> = BTreeMap::new();
        for (i, placement) in placements.iter().enumerate().filter(|(i, _)| !copies.contains(i)) {
            let asset = placement.asset;
            let made = match parts.entry(asset) {
                Entry::Occupied(made) => made.into_mut(),
                Entry::Vacant(place) => {
                    let all = shown_anywhere(placements, asset, &chosen);
                    place.insert(self.parts(asset, &all)?)
                }
            };
            if made.shown.is_empty() {
                continue;
            }
            if placement.phase > 0 && !later.contains_key(&(asset, placement.phase)) {
                later.insert((asset, placement.phase), self.joints_later(asset, placement.phase)?);
            }
            let joints = later.get(&(asset, placement.phase)).unwrap_or(&made.joints);
            self.place(placement, prefixed, made, joints, chosen.get(&i))?;
        }
        // Copies come last: Blender's importer takes longer over each skeleton the more objects there are before it.
        self.copies(placements, &copies)?;
        let filled = !self.root.nodes.is_empty();
        if shows == (Shows::Scene { camera: true }) {
            self.camera()?;
        }
        self.close(name);
        Ok(filled)
    }

    /// Chooses the moving instances: all, or those of the smallest keys if there are too many for one file.
    fn choose(&mut self, placements: &[Placement], name: &str) -> ChosenAt {
        let from = self.from;
        let mut list = Vec::new();
        let mut total = 0_usize;
        for (k, placement) in placements.iter().enumerate() {
            let Some(tracks) = from.tracks.assets.get(placement.asset) else { continue };
            list.extend(
                tracks.moving.iter().filter(|m| m.alive.contains(&true)).map(|m| (m.key, k, m.instancer, m.instance)),
            );
            let free = |i: &&osier_scene::Instancer| i.motion == InstancerMotion::Free;
            total += from.scene.assets[placement.asset].instancers.iter().filter(free).map(|i| i.len()).sum::<usize>();
        }
        let most = from.tracks.most;
        if total > most && !from.tracks.is_still() {
            let message = format!(
                "{name}: {total} moving instances, {most} written: those of the smallest hash(seed, id); \
                 output.gltf.nodes = {total} writes all, output.gltf.frame = N all of one frame"
            );
            self.warnings.push(Warning { code: "X003", message });
        }
        list.sort_unstable();
        list.truncate(most);
        let mut chosen = ChosenAt::new();
        for (_, k, instancer, instance) in list {
            chosen.entry(k).or_default().insert((instancer, instance));
        }
        chosen
    }

    fn place(
        &mut self,
        placement: &Placement,
        prefixed: bool,
        parts: &Parts,
        joints_of_parts: &[Joint],
        chosen: Option<&Chosen>,
    ) -> Result<()> {
        let asset = &self.from.scene.assets[placement.asset];
        finite(&placement.transform, || format!("placement {}", placement.name))?;
        let named = |name: &str| if prefixed { format!("{}_{name}", placement.name) } else { name.to_owned() };
        let top = marked(placement.name.clone(), &placement.transform, asset.id.clone(), asset.kind.word());
        let top = self.node(top)?;
        self.attach(None, top);
        let mut root = top;
        if placement.transform.s != Vec3::ONE && !joints_of_parts.is_empty() {
            // Blender's importer puts what hangs on a bone in the wrong place if the node above the joints is scaled.
            root = self.node(placed(named("skeleton"), &Trs::IDENTITY))?;
            self.attach(Some(top), root);
        }
        let mut joints: Vec<Index> = Vec::with_capacity(joints_of_parts.len());
        for joint in joints_of_parts {
            let node = self.node(placed(named(&joint.name), &joint.motion.rest))?;
            let parent = joint.parent.and_then(|p| joints.get(p)).copied().unwrap_or(root);
            self.attach(Some(parent), node);
            self.animate(node, &joint.motion.drives);
            joints.push(node);
        }
        let skin = match (parts.inverse_bind, joints.first()) {
            (Some(inverse_bind_matrices), Some(&skeleton)) => {
                let name = named("skin");
                self.root.skins.push(Skin { name, inverse_bind_matrices, skeleton, joints: joints.clone() });
                Some(last(self.root.skins.len())?)
            }
            _ => None,
        };
        let shown = |part: &&Part| part.moving.is_none_or(|m| chosen.is_some_and(|c| c.contains(&m)));
        for part in parts.shown.iter().filter(shown) {
            let id = format!("{}/{}", placement.name, part.id);
            let node = Node {
                mesh: Some(part.mesh),
                skin: skin.filter(|_| part.hold == Hold::Skin),
                extensions: part.instancing.clone(),
                ..marked(named(&part.name), &part.motion.rest, id, part.kind)
            };
            let node = self.node(node)?;
            let parent = match part.hold {
                Hold::Placement => Some(top),
                Hold::Joint(k) => joints.get(k).copied(),
                Hold::Skin => None,
            };
            self.attach(parent, node);
            self.animate(node, &part.motion.drives);
        }
        Ok(())
    }

    fn camera(&mut self) -> Result<()> {
        let view = self.from.scene.camera;
        let [right, up, back] = view.axes();
        let r = Quat::from_mat3(&Mat3::from_cols(right, up, back)).normalize();
        // Far enough for any ground around the subject, near enough to keep depth exact in viewports.
        let zfar = (10.0 * (view.eye - view.target).length()).max(1000.0);
        let perspective = Perspective { yfov: view.vfov, znear: 0.01, zfar };
        self.root.cameras.push(Camera { name: "camera".into(), kind: "perspective", perspective });
        let rest = Trs { t: view.eye, r, ..Trs::IDENTITY };
        finite(&rest, || "camera".to_owned())?;
        let node = Node { camera: Some(0), ..marked("camera".into(), &rest, "camera".into(), "camera") };
        let node = self.node(node)?;
        self.attach(None, node);
        Ok(())
    }
}

/// Moving instances that any placement of an asset shows.
fn shown_anywhere(placements: &[Placement], asset: usize, chosen: &ChosenAt) -> Chosen {
    let here = placements.iter().enumerate().filter(|(_, p)| p.asset == asset);
    here.flat_map(|(k, _)| chosen.get(&k).into_iter().flatten().copied()).collect()
}
