//! What a clip changes, gathered frame by frame: a glTF file holds each track in one piece.

use glam::{Quat, Vec3};

use osier_base::rng::mix64;
use osier_scene::{
    Asset, AssetFrame, CurvesFrame, Frame, InstancerMotion, MeshFrame, MeshMotion, Scene, Trs, instance_states,
};

/// Most targets that a morphing mesh gets.
pub(super) const MORPH_TARGETS: usize = 32;
/// All tracks of a clip.
#[derive(Debug, Default)]
pub(super) struct Tracks {
    /// Time of each frame, s, from the start of the clip.
    pub times: Vec<f32>,
    /// Number of each frame.
    pub numbers: Vec<u32>,
    /// One per asset.
    pub assets: Vec<AssetTracks>,
    /// Most moving instances in a file.
    pub most: usize,
}

/// Tracks of one asset; inner lists run over frames.
#[derive(Debug, Default)]
pub(super) struct AssetTracks {
    /// Parent from joint, one list per frame.
    pub poses: Vec<Vec<Trs>>,
    /// Moving instances, sorted by (key, instancer, index).
    pub moving: Vec<Moving>,
    /// Shapes of deforming meshes, one entry per mesh of the asset.
    pub meshes: Vec<Shapes>,
    /// Shapes of moving curves (points only), one entry per curves of the asset.
    pub curves: Vec<Shapes>,
}

/// One instance through the clip.
#[derive(Debug)]
pub(super) struct Moving {
    /// hash(seed, id): the smallest are kept where there are too many.
    pub key: u64,
    /// Index into the asset's instancers.
    pub instancer: usize,
    /// Index into its instances.
    pub instance: usize,
    /// Per frame.
    pub positions: Vec<Vec3>,
    /// Per frame.
    pub orientations: Vec<Quat>,
    /// Per frame.
    pub alive: Vec<bool>,
}

/// Shapes of one mesh through the clip.
#[derive(Debug, Default)]
pub(super) enum Shapes {
    /// It does not deform.
    #[default]
    Still,
    /// Points and normals per frame.
    Frames(Vec<(Vec<Vec3>, Vec<Vec3>)>),
    /// More frames than targets are allowed.
    TooMany,
}

impl Tracks {
    /// Empty tracks for a scene, of at most so many moving instances.
    pub(super) fn new(scene: &Scene, most: usize) -> Self {
        let assets = scene.assets.iter().map(|a| AssetTracks::new(a, scene.seed, most)).collect();
        Self { assets, most, ..Self::default() }
    }

    /// True without frames.
    pub(super) fn is_still(&self) -> bool {
        self.times.is_empty()
    }

    /// Adds a frame.
    pub(super) fn push(&mut self, scene: &Scene, frame: &Frame) {
        self.times.push(osier_base::math::narrow(scene.clip.seconds(frame.number)));
        self.numbers.push(frame.number);
        let rest = AssetFrame::default();
        for (i, (tracks, asset)) in self.assets.iter_mut().zip(&scene.assets).enumerate() {
            tracks.push(asset, frame.assets.get(i).unwrap_or(&rest));
        }
    }
}

impl AssetTracks {
    fn new(asset: &Asset, seed: u64, most: usize) -> Self {
        let mut moving = Vec::new();
        for (instancer, source) in asset.instancers.iter().enumerate() {
            if source.motion == InstancerMotion::Free {
                moving.extend(source.ids.iter().enumerate().map(|(instance, id)| Moving {
                    key: mix64(&[seed, *id]),
                    instancer,
                    instance,
                    positions: Vec::new(),
                    orientations: Vec::new(),
                    alive: Vec::new(),
                }));
            }
        }
        moving.sort_by_key(|m| (m.key, m.instancer, m.instance));
        moving.truncate(most);
        let shapes = |deforms| if deforms { Shapes::Frames(Vec::new()) } else { Shapes::Still };
        let skinned = asset.skeleton.is_some();
        Self {
            poses: Vec::new(),
            moving,
            meshes: asset
                .meshes
                .iter()
                .map(|o| shapes(o.motion == MeshMotion::Deforming && !(skinned && o.skin.is_some())))
                .collect(),
            curves: asset.curves.iter().map(|c| shapes(c.moving)).collect(),
        }
    }

    fn push(&mut self, asset: &Asset, frame: &AssetFrame) {
        if let Some(skeleton) = &asset.skeleton {
            let posed = frame.pose.len() == skeleton.joints.len();
            self.poses.push(if posed { frame.pose.clone() } else { skeleton.rest_pose() });
        }
        let free = |i: &osier_scene::Instancer| i.motion == InstancerMotion::Free;
        for (i, instancer) in asset.instancers.iter().enumerate().filter(|(_, i)| free(i)) {
            let state = instance_states(asset, instancer, i, frame);
            for m in self.moving.iter_mut().filter(|m| m.instancer == i) {
                m.positions.push(state.positions[m.instance]);
                m.orientations.push(state.orientations[m.instance]);
                m.alive.push(state.is_alive(m.instance));
            }
        }
        for (i, (shapes, object)) in self.meshes.iter_mut().zip(&asset.meshes).enumerate() {
            shapes.push(|| match frame.mesh(i) {
                MeshFrame::Points { points, normals, .. } => (points.clone(), normals.clone()),
                _ => (object.mesh.points.clone(), object.mesh.normals.clone()),
            });
        }
        for (i, (shapes, curves)) in self.curves.iter_mut().zip(&asset.curves).enumerate() {
            shapes.push(|| match frame.curves(i) {
                CurvesFrame::Points(points) => (points.clone(), Vec::new()),
                CurvesFrame::Same => (curves.points.clone(), Vec::new()),
            });
        }
    }
}

impl Shapes {
    fn push(&mut self, shape: impl FnOnce() -> (Vec<Vec3>, Vec<Vec3>)) {
        match self {
            Self::Frames(list) if list.len() < MORPH_TARGETS => list.push(shape()),
            Self::Frames(_) => *self = Self::TooMany,
            Self::Still | Self::TooMany => {}
        }
    }
}

impl Moving {
    /// Positions and orientations where a dead instance holds its state at birth or death.
    pub(super) fn held(&self) -> (Vec<Vec3>, Vec<Quat>) {
        let first = self.alive.iter().position(|a| *a).unwrap_or(0);
        let mut source = first;
        let mut at = Vec::with_capacity(self.alive.len());
        for (i, alive) in self.alive.iter().enumerate() {
            if *alive {
                source = i;
            }
            at.push(source);
        }
        (at.iter().map(|&i| self.positions[i]).collect(), at.iter().map(|&i| self.orientations[i]).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dead_hold_their_last_state_and_the_unborn_their_first() {
        let p = |x: f32| Vec3::new(x, 0.0, 0.0);
        let m = Moving {
            key: 0,
            instancer: 0,
            instance: 0,
            positions: [9.0, 1.0, 2.0, 8.0, 7.0].map(p).to_vec(),
            orientations: vec![Quat::IDENTITY; 5],
            alive: vec![false, true, true, false, false],
        };
        assert_eq!(m.held().0, [1.0, 1.0, 2.0, 2.0, 2.0].map(p));
    }
}
