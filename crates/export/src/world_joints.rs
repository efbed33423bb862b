//! The joints of all placements in world space, for formats that write them as numbers.

use osier_scene::{Frame, Scene, Trs};

/// A joint of one placement at one frame, in world space.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WorldJoint {
    /// Index in the scene's placements.
    pub placement: u32,
    /// Index in the skeleton of the placement's asset.
    pub joint: u32,
    /// Index of its parent in the skeleton; `None` for a root.
    pub parent: Option<u32>,
    /// Transform from joint space to world space.
    pub world: Trs,
    /// Radius of its geometry at the pivot in world space, m: scaled with the placement.
    pub radius: f32,
}

/// Joints of all placements, in the order of the placements; `None` if no asset has a skeleton.
pub(super) fn world_joints(scene: &Scene, frame: &Frame) -> Option<Vec<WorldJoint>> {
    let mut joints = Vec::new();
    let mut any = false;
    for (placement, shown) in (0_u32..).zip(&scene.placements) {
        let both = scene.assets.get(shown.asset).zip(frame.shown(shown));
        let Some((skeleton, state)) = both.and_then(|(asset, state)| Some((asset.skeleton.as_ref()?, state))) else {
            continue;
        };
        // Even a skeleton without joints makes the table exist, with no rows at this frame.
        any = true;
        let rest = skeleton.rest_pose();
        let pose = if state.pose.len() == rest.len() { &state.pose } else { &rest };
        let asset_from_joint = (0_u32..).zip(&skeleton.joints).zip(skeleton.asset_from_joint(pose));
        joints.extend(asset_from_joint.map(|((joint, known), trs)| WorldJoint {
            placement,
            joint,
            parent: known.parent,
            world: shown.transform.then_inner(&trs),
            radius: known.radius * shown.transform.s.x,
        }));
    }
    any.then_some(joints)
}
