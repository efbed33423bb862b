//! A frame of a moving scene as a scene that does not move.

use std::collections::BTreeMap;

use super::{
    Asset, AssetFrame, CurvesFrame, Frame, InstancerMotion, MeshFrame, MeshMotion, MeshObject, Scene, instance_states,
    mesh_points, skinned_normals, skinning_matrices,
};

/// The scene in the state of a frame, without motion. For each phase of a placement that the frame holds, an asset in the state
/// of that phase is added; placements of other phases get their assets in the state of the frame.
pub fn freeze(scene: &Scene, frame: &Frame) -> Scene {
    let mut out = scene.clone();
    let rest = AssetFrame::default();
    for (i, (asset, source)) in out.assets.iter_mut().zip(&scene.assets).enumerate() {
        freeze_asset(asset, source, frame.assets.get(i).unwrap_or(&rest));
    }
    for (sequence, maps) in out.map_sequences.iter_mut().zip(&frame.maps) {
        sequence.rest = Some(maps.clone());
    }
    let mut later: BTreeMap<(usize, u32), usize> = BTreeMap::new();
    for placement in out.placements.iter_mut().filter(|p| p.phase > 0) {
        let key = (placement.asset, std::mem::take(&mut placement.phase));
        let Some((source, state)) = scene.assets.get(key.0).zip(frame.shifted.get(&key)) else { continue };
        placement.asset = *later.entry(key).or_insert_with(|| {
            let mut asset = source.clone();
            freeze_asset(&mut asset, source, state);
            asset.id = format!("{}_later_{}", source.id, key.1);
            out.assets.push(asset);
            out.assets.len() - 1
        });
    }
    out
}

fn freeze_asset(asset: &mut Asset, source: &Asset, frame: &AssetFrame) {
    for (i, (object, before)) in asset.meshes.iter_mut().zip(&source.meshes).enumerate() {
        freeze_mesh(object, source, i, before, frame);
    }
    for (i, (instancer, before)) in asset.instancers.iter_mut().zip(&source.instancers).enumerate() {
        instancer.rest = instance_states(source, before, i, frame).into_owned();
        instancer.motion = InstancerMotion::Still;
    }
    for (i, (cloud, before)) in asset.points.iter_mut().zip(&source.points).enumerate() {
        let now = before.at(frame.points(i));
        (cloud.positions, cloud.widths) = (now.positions.to_vec(), now.widths.to_vec());
        cloud.colors = now.colors.to_vec();
        cloud.moving = false;
    }
    for (i, curves) in asset.curves.iter_mut().enumerate() {
        if let CurvesFrame::Points(points) = frame.curves(i) {
            curves.points.clone_from(points);
        }
        curves.moving = false;
    }
    asset.skeleton = None;
}

fn freeze_mesh(object: &mut MeshObject, asset: &Asset, i: usize, before: &MeshObject, frame: &AssetFrame) {
    match frame.mesh(i) {
        MeshFrame::Whole { mesh, .. } => object.mesh = mesh.clone(),
        MeshFrame::Points { points, normals, .. } => {
            object.mesh.points.clone_from(points);
            object.mesh.normals.clone_from(normals);
        }
        MeshFrame::Same => {
            object.mesh.points = mesh_points(asset, before, i, frame).into_owned();
            if let (Some(skeleton), Some(skin), MeshMotion::Skinned) = (&asset.skeleton, &before.skin, before.motion) {
                let matrices = skinning_matrices(skeleton, &frame.pose);
                object.mesh.normals = skinned_normals(&before.mesh.normals, skin, &matrices);
            }
        }
    }
    object.motion = MeshMotion::Still;
    object.skin = None;
}
