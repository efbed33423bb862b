//! Joints and transforms.

use glam::{Mat4, Quat, Vec3};

/// Translation, rotation, scale: p' = t + r * (s * p).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trs {
    /// Translation, applied last, m.
    pub t: Vec3,
    /// Rotation, a unit quaternion.
    pub r: Quat,
    /// Scale along the axes, applied first.
    pub s: Vec3,
}

impl Default for Trs {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Trs {
    /// The identity, neutral in [`Trs::then_inner`] on either side.
    pub const IDENTITY: Self = Self { t: Vec3::ZERO, r: Quat::IDENTITY, s: Vec3::ONE };

    /// A translation without rotation or scale.
    #[inline]
    pub fn translation(t: Vec3) -> Self {
        Self { t, ..Self::IDENTITY }
    }

    /// The transform as a matrix for column vectors: translation times rotation times scale.
    #[inline]
    pub fn matrix(&self) -> Mat4 {
        Mat4::from_scale_rotation_translation(self.s, self.r, self.t)
    }

    /// The point t + r * (s * p).
    #[inline]
    pub fn apply(&self, p: Vec3) -> Vec3 {
        self.t + self.r * (self.s * p)
    }

    /// `self` after `inner`; exact if `self` scales uniformly.
    #[must_use]
    #[inline]
    pub fn then_inner(&self, inner: &Self) -> Self {
        Self { t: self.apply(inner.t), r: (self.r * inner.r).normalize(), s: self.s * inner.s }
    }
}

/// A frame that moves the points skinned to it and its child joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// `[a-z0-9_]+`, unique in the skeleton.
    pub name: String,
    /// Index of the parent, below the joint's own; `None` only for joint 0.
    pub parent: Option<u32>,
    /// Parent from joint at rest. Scale is 1.
    pub rest: Trs,
    /// Radius of the branch or stalk at the pivot, m; 0 for a root without one.
    pub radius: f32,
}

/// Joints, parents first, depth first, joint 0 the only root.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skeleton {
    /// The joints; skins name them by index.
    pub joints: Vec<Joint>,
}

impl Skeleton {
    /// Asset from joint for one pose (parent-from-joint transforms, one per joint); only the first joints for a shorter pose.
    #[inline]
    pub fn asset_from_joint(&self, pose: &[Trs]) -> Vec<Trs> {
        let mut world: Vec<Trs> = Vec::with_capacity(self.joints.len());
        for (joint, local) in self.joints.iter().zip(pose) {
            let parent = joint.parent.and_then(|p| world.get(p as usize)).copied().unwrap_or_default();
            world.push(parent.then_inner(local));
        }
        world
    }

    /// Parent-from-joint transforms at rest, one per joint.
    #[inline]
    pub fn rest_pose(&self) -> Vec<Trs> {
        self.joints.iter().map(|j| j.rest).collect()
    }

    /// Asset from joint at rest: the bind transforms.
    #[inline]
    pub fn bind(&self) -> Vec<Trs> {
        self.asset_from_joint(&self.rest_pose())
    }
}
