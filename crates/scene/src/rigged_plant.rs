//! Plants with joints for programs that simulate the wind themselves.

use super::{Instancer, MeshObject, Skeleton};

/// A plant at rest with joints on its branches, for programs that simulate the wind themselves. It does not depend on the motion
/// that the scene's frames have.
#[derive(Debug, Clone, Default)]
pub struct RiggedPlant {
    /// Joints in asset space; joint 0 is the fixed root.
    pub skeleton: Skeleton,
    /// The branch that each joint bends, parallel to the joints; none for the root.
    pub branches: Vec<Option<JointBranch>>,
    /// Bark and stalks at rest, each with its skin over [`Self::skeleton`].
    pub meshes: Vec<MeshObject>,
    /// Leaves at rest, each on a joint of [`Self::skeleton`], those of an axis in order along it.
    pub instancers: Vec<Instancer>,
    /// Changes of the plant over the clip other than sway; the rig is the plant at one time of the clip.
    pub change: ClipChange,
}

/// Changes of a plant over a clip that are not caused by wind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ClipChange {
    /// No change.
    #[default]
    None,
    /// The plant grows; its rig is grown up.
    Growth,
    /// Its leaves change with the season; its rig has those of the first frame.
    Season,
}

/// The part of a branch that a joint bends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointBranch {
    /// Index of its axis in the plant.
    pub axis: u32,
    /// Branching order of that axis: 0 for the trunk, equal for both halves of an apical fork.
    pub order: u8,
    /// Angle by which the joint turns under a dynamic pressure of 1 Pa on everything that it and the branches below it carry,
    /// rad/Pa: the slope of its beam plus the slopes of the beams that carry it, at the points where it is attached to them.
    pub compliance: f64,
}
