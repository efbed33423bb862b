//! Conversion from the scene's axes (+Y up, right-handed, metres) to those of the stage.

use std::borrow::Cow;

use glam::{Mat4, Quat, Vec3};

use osier_base::geometry::Bounds;
use osier_scene::Trs;

/// The axis of the written file that points up; the scene itself has +Y up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// The axes of the scene, which are also those of glTF: nothing is converted.
    #[default]
    Y,
    /// Blender's axes: (x, y, z) of the scene becomes (x, -z, y).
    Z,
}

impl UpAxis {
    /// The value of `upAxis` in the layer metadata.
    pub(super) fn token(self) -> &'static str {
        match self {
            Self::Y => "Y",
            Self::Z => "Z",
        }
    }

    /// A point or direction of the scene in the axes of the stage.
    pub(crate) fn stage_vec(self, v: Vec3) -> Vec3 {
        match self {
            Self::Y => v,
            Self::Z => Vec3::new(v.x, -v.z, v.y),
        }
    }

    /// Points or directions in the axes of the stage; borrowed if the axes are the same.
    pub(super) fn stage_vecs(self, v: &[Vec3]) -> Cow<'_, [Vec3]> {
        match self {
            Self::Y => Cow::Borrowed(v),
            Self::Z => Cow::Owned(v.iter().map(|p| self.stage_vec(*p)).collect()),
        }
    }

    /// A rotation between two spaces whose axes are both converted: C q C^-1, C the rotation [`Self::world_to_stage`].
    pub(super) fn stage_quat(self, q: Quat) -> Quat {
        match self {
            Self::Y => q,
            // C is a rotation: conjugation by it rotates the quaternion's vector part and keeps its scalar part.
            Self::Z => Quat::from_xyzw(q.x, -q.z, q.y, q.w),
        }
    }

    /// Converts scale factors along the scene's axes to factors along those of the stage: permuted, without a sign.
    pub(super) fn stage_scale(self, s: Vec3) -> Vec3 {
        match self {
            Self::Y => s,
            Self::Z => Vec3::new(s.x, s.z, s.y),
        }
    }

    /// A transform between two spaces whose axes are both converted.
    pub(super) fn stage_trs(self, m: &Trs) -> Trs {
        Trs { t: self.stage_vec(m.t), r: self.stage_quat(m.r), s: self.stage_scale(m.s) }
    }

    /// The rotation from the scene's axes to those of the stage, for prims whose local axes USD fixes: cameras and lights look
    /// along their -Z, so they are rotated as a whole instead of being converted.
    pub(super) fn world_to_stage(self) -> Quat {
        match self {
            Self::Y => Quat::IDENTITY,
            // 90 degrees about x: (sin 45, 0, 0, cos 45) takes +Y to +Z.
            Self::Z => Quat::from_xyzw(std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2),
        }
    }
}

/// A box as the two corners of an `extent`; two zero vectors for an empty one.
pub(super) fn extent_corners(b: &Bounds) -> [[f32; 3]; 2] {
    if b.is_empty() { [[0.0; 3]; 2] } else { [b.min.to_array(), b.max.to_array()] }
}

/// A transform as `matrix4d`: row-major for row vectors, the translation in the last row.
pub(super) fn matrix4d(m: &Trs) -> [f64; 16] {
    // Columns of the column-vector form, one after the other, are the rows of the row-vector form.
    Mat4::to_cols_array(&m.matrix()).map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_of_turning_agree() {
        let m = Trs {
            t: Vec3::new(1.0, 2.0, 3.0),
            r: Quat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.7),
            s: Vec3::new(1.0, 2.0, 0.5),
        };
        let p = Vec3::new(-0.4, 0.9, 2.0);
        let z = UpAxis::Z;
        assert!((z.stage_trs(&m).apply(z.stage_vec(p)) - z.stage_vec(m.apply(p))).length() < 1e-5);
        assert!((z.world_to_stage() * p - z.stage_vec(p)).length() < 1e-6);
    }
}
