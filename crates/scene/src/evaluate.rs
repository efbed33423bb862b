//! Evaluates a scene at one frame: points, normals, instances and boxes. Exporters and tests use the same functions.

use std::borrow::Cow;

use glam::{Mat4, Vec3};

use super::{
    Asset, AssetFrame, CurvesFrame, Frame, InstanceState, Instancer, InstancerFrame, InstancerMotion, MapFrame,
    MapSequence, MeshFrame, MeshMotion, MeshObject, Scene, Skeleton, SkinWeights, Trs,
};
use osier_base::geometry::Bounds;

/// Matrices that move rest points to posed points, one per joint: asset-from-joint times joint-from-asset at rest.
/// An empty pose means rest.
pub fn skinning_matrices(skeleton: &Skeleton, pose: &[Trs]) -> Vec<Mat4> {
    let bind = skeleton.bind();
    let rest;
    let pose = if pose.len() == skeleton.joints.len() {
        pose
    } else {
        rest = skeleton.rest_pose();
        &rest
    };
    let posed = skeleton.asset_from_joint(pose);
    posed.iter().zip(&bind).map(|(p, b)| p.matrix() * b.matrix().inverse()).collect()
}

/// Points of a mesh at a frame, in asset space. For [`MeshMotion::Varying`] the frame's mesh has them.
pub fn mesh_points<'a>(asset: &Asset, object: &'a MeshObject, i: usize, frame: &'a AssetFrame) -> Cow<'a, [Vec3]> {
    match frame.mesh(i) {
        MeshFrame::Points { points, .. } => Cow::Borrowed(points),
        MeshFrame::Whole { mesh, .. } => Cow::Borrowed(&mesh.points),
        MeshFrame::Same => match (&asset.skeleton, &object.skin, object.motion) {
            (Some(skeleton), Some(skin), MeshMotion::Skinned) => {
                Cow::Owned(skinned_points(&object.mesh.points, skin, &skinning_matrices(skeleton, &frame.pose)))
            }
            _ => Cow::Borrowed(&object.mesh.points),
        },
    }
}

/// Linear blend skinning of points. `matrices`: one per joint, from [`skinning_matrices`].
pub fn skinned_points(points: &[Vec3], skin: &SkinWeights, matrices: &[Mat4]) -> Vec<Vec3> {
    let blend = |(p, (joints, weights)): (&Vec3, (&[u16; 4], &[f32; 4]))| {
        let mut sum = Vec3::ZERO;
        for (j, w) in joints.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
            sum += matrices[usize::from(*j)].transform_point3(*p) * *w;
        }
        sum
    };
    points.iter().zip(skin.joints.iter().zip(&skin.weights)).map(blend).collect()
}

/// Normals of a mesh moved by its skin, by the blended rotations of the joints; unit length.
pub fn skinned_normals(normals: &[Vec3], skin: &SkinWeights, matrices: &[Mat4]) -> Vec<Vec3> {
    let blend = |(n, (joints, weights)): (&Vec3, (&[u16; 4], &[f32; 4]))| {
        let mut sum = Vec3::ZERO;
        for (j, w) in joints.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
            // Joints rotate and move without scale, so that normals need no inverse transpose.
            sum += matrices[usize::from(*j)].transform_vector3(*n) * *w;
        }
        osier_base::math::normalize_or(sum, *n)
    };
    normals.iter().zip(skin.joints.iter().zip(&skin.weights)).map(blend).collect()
}

/// Positions and rotations of all instances at a frame, in asset space: the frame's own, or else the rest state, moved by the
/// joints of the pose if the instancer is bound to joints.
pub fn instance_states<'a>(
    asset: &Asset,
    instancer: &'a Instancer,
    i: usize,
    frame: &'a AssetFrame,
) -> Cow<'a, InstanceState> {
    match (frame.instancer(i), &instancer.motion, &asset.skeleton) {
        (InstancerFrame::State(state), _, _) => Cow::Borrowed(state),
        (InstancerFrame::Same, InstancerMotion::Joints(joints), Some(skeleton)) if !frame.pose.is_empty() => {
            Cow::Owned(ride(instancer, joints, skeleton, &frame.pose))
        }
        _ => Cow::Borrowed(&instancer.rest),
    }
}

/// Rigid motions from the rest pose to `pose`, one per joint, in asset space; they move what is bound to one joint.
pub fn joint_motions(skeleton: &Skeleton, pose: &[Trs]) -> Vec<Trs> {
    let bind = skeleton.bind();
    let posed = skeleton.asset_from_joint(pose);
    let motion = |(p, b): (&Trs, &Trs)| {
        // posed after the inverse of bind: x -> p.t + r (x - b.t).
        let r = (p.r * b.r.conjugate()).normalize();
        Trs { t: p.t - r * b.t, r, s: Vec3::ONE }
    };
    posed.iter().zip(&bind).map(motion).collect()
}

/// The rest state with each instance moved by its joint, without velocities and attributes.
fn ride(instancer: &Instancer, joints: &[u16], skeleton: &Skeleton, pose: &[Trs]) -> InstanceState {
    let moved = joint_motions(skeleton, pose);
    let rest = &instancer.rest;
    let mut state = InstanceState { alive: rest.alive.clone(), sizes: rest.sizes.clone(), ..InstanceState::default() };
    for (k, j) in joints.iter().enumerate() {
        let m = &moved[usize::from(*j)];
        state.positions.push(m.apply(instancer.rest.positions[k]));
        state.orientations.push((m.r * instancer.rest.orientations[k]).normalize());
    }
    state
}

/// Box of an asset at a frame (at rest for a default frame), in asset space; instances count with their prototypes'
/// boxes, points and curves with their widths.
pub fn asset_bounds(asset: &Asset, frame: &AssetFrame) -> Bounds {
    let mut b = Bounds::default();
    for (i, object) in asset.meshes.iter().enumerate() {
        b = b.union(Bounds::of(mesh_points(asset, object, i, frame).iter().copied()));
    }
    for (i, instancer) in asset.instancers.iter().enumerate() {
        b = b.union(instancer_bounds(instancer, &instance_states(asset, instancer, i, frame)));
    }
    for (i, cloud) in asset.points.iter().enumerate() {
        let now = cloud.at(frame.points(i));
        for (p, w) in now.positions.iter().zip(now.widths).filter(|(_, w)| **w > 0.0) {
            b = b.union(Bounds::of([*p]).expanded(w * 0.5));
        }
    }
    for (i, curves) in asset.curves.iter().enumerate() {
        let points = match frame.curves(i) {
            CurvesFrame::Points(points) => points,
            CurvesFrame::Same => &curves.points,
        };
        for (p, w) in points.iter().zip(&curves.widths) {
            b = b.union(Bounds::of([*p]).expanded(w * 0.5));
        }
    }
    b
}

/// Box of the live instances in asset space, from the corners of their prototypes' boxes.
fn instancer_bounds(instancer: &Instancer, state: &InstanceState) -> Bounds {
    let boxes: Vec<Bounds> = instancer.prototypes.iter().map(super::Prototype::bounds).collect();
    let mut b = Bounds::default();
    for i in (0..instancer.len()).filter(|&i| state.is_alive(i)) {
        let proto = boxes[instancer.protos[i] as usize];
        if !proto.is_empty() {
            let trs = instancer.transform(state, i);
            b = b.union(Bounds::of(proto.corners().map(|c| trs.apply(c))));
        }
    }
    b
}

impl Scene {
    /// The maps of each sequence at a frame: the frame's own, or else the maps at rest; `None` if there are neither.
    pub fn maps_at(&self, frame: Option<&Frame>) -> Vec<Option<MapFrame>> {
        let one = |(i, sequence): (usize, &MapSequence)| {
            frame.and_then(|f| f.maps.get(i)).or(sequence.rest.as_ref()).cloned()
        };
        self.map_sequences.iter().enumerate().map(one).collect()
    }
}

/// Box of all placed assets at a frame, in world space; pass `None` for rest.
pub fn scene_bounds(scene: &Scene, frame: Option<&Frame>) -> Bounds {
    let rest = AssetFrame::default();
    let mut b = Bounds::default();
    for placement in &scene.placements {
        let state = frame.and_then(|f| f.shown(placement)).unwrap_or(&rest);
        let local = asset_bounds(&scene.assets[placement.asset], state);
        if !local.is_empty() {
            b = b.union(Bounds::of(local.corners().map(|c| placement.transform.apply(c))));
        }
    }
    b
}
