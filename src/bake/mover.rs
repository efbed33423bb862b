//! From time to frames.

use glam::{Mat4, Vec3};

use crate::motion::{Rig, Sway};
use crate::scene::{
    Asset, AssetFrame, Frame, InstancerFrame, MeshFrame, MeshMotion, Scene, instance_states, skinned_normals,
    skinned_points, world_from_joint,
};

/// Moves one asset.
#[derive(Debug, Clone)]
pub struct Mover {
    /// Its joints.
    pub rig: Rig,
    /// Joints over time.
    pub sway: Sway,
    /// Leaves over time, one per instancer, in the instancer's order of organs.
    pub flutter: Vec<Sway>,
}

impl Mover {
    /// The asset at `seconds`; `step`: seconds between frames, for velocities.
    fn frame(&self, asset: &Asset, seconds: f32, step: f32) -> AssetFrame {
        let mut frame = AssetFrame { pose: self.sway.pose(&self.rig, seconds), ..AssetFrame::default() };
        if asset.meshes.iter().any(|m| m.motion == MeshMotion::Deforming) {
            frame.meshes = self.meshes(asset, &frame, seconds, step);
        }
        frame.instancers = (0..asset.instancers.len()).map(|i| self.instancer(asset, i, &frame, seconds)).collect();
        frame
    }

    fn meshes(&self, asset: &Asset, frame: &AssetFrame, seconds: f32, step: f32) -> Vec<MeshFrame> {
        let Some(skeleton) = &asset.skeleton else { return Vec::new() };
        let at = |t: f32| world_from_joint(skeleton, &self.sway.pose(&self.rig, t));
        let now = world_from_joint(skeleton, &frame.pose);
        let half = step * 0.5;
        let rates: Vec<Mat4> =
            at(seconds + half).iter().zip(at(seconds - half)).map(|(a, b)| (*a - b) * step.recip()).collect();
        let one = |m: &crate::scene::MeshObject| match (&m.skin, m.motion) {
            (Some(skin), MeshMotion::Deforming) => MeshFrame::Points {
                points: skinned_points(&m.mesh.points, skin, &now),
                normals: skinned_normals(&m.mesh.normals, skin, &now),
                velocities: velocities(&m.mesh.points, skin, &rates),
            },
            _ => MeshFrame::Same,
        };
        asset.meshes.iter().map(one).collect()
    }

    fn instancer(&self, asset: &Asset, i: usize, frame: &AssetFrame, seconds: f32) -> InstancerFrame {
        let (Some(instancer), Some(flutter)) = (asset.instancers.get(i), self.flutter.get(i)) else {
            return InstancerFrame::Same;
        };
        let mut state = instance_states(asset, instancer, i, frame).into_owned();
        flutter.flutter(&mut state, seconds);
        InstancerFrame::State(state)
    }
}

/// Speed of skinned points, m/s. `rates`: change of each joint's matrix per second.
fn velocities(points: &[Vec3], skin: &crate::scene::SkinWeights, rates: &[Mat4]) -> Vec<Vec3> {
    let blend = |(p, (joints, weights)): (&Vec3, (&[u16; 4], &[f32; 4]))| {
        let sum = |v: Vec3, (j, w): (&u16, &f32)| match rates.get(usize::from(*j)) {
            // The last row of a difference of rigid motions is zero, so the full product is the velocity.
            Some(m) if *w > 0.0 => v + (*m * p.extend(1.0)).truncate() * *w,
            _ => v,
        };
        joints.iter().zip(weights).fold(Vec3::ZERO, sum)
    };
    points.iter().zip(skin.joints.iter().zip(&skin.weights)).map(blend).collect()
}

/// A whole frame; `movers` runs parallel to the scene's assets.
pub fn frame(scene: &Scene, movers: &[Option<Mover>], number: u32) -> Frame {
    let seconds = crate::math::narrow(scene.clip.seconds(number));
    let step = crate::math::narrow(scene.clip.fps().recip());
    let pairs: Vec<(&Asset, Option<&Mover>)> =
        scene.assets.iter().zip(movers.iter().map(Option::as_ref).chain(std::iter::repeat(None))).collect();
    let assets = crate::par::par_map(&pairs, |(asset, mover)| {
        mover.map_or_else(AssetFrame::default, |m| m.frame(asset, seconds, step))
    });
    Frame { number, assets }
}
