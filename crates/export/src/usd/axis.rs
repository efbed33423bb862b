//! Which way is up in the files.

use std::borrow::Cow;

use glam::{Mat4, Quat, Vec3};

use osier_base::geometry::Bounds;
use osier_scene::Trs;

/// The up axis of the written stages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// As inside: numbers equal those of glTF.
    #[default]
    Y,
    /// (x, y, z) becomes (x, -z, y) everywhere, as in Blender.
    Z,
}

impl UpAxis {
    /// The token of the layer metadata.
    pub fn token(self) -> &'static str {
        match self {
            Self::Y => "Y",
            Self::Z => "Z",
        }
    }

    /// A point or direction.
    pub fn vec(self, v: Vec3) -> Vec3 {
        match self {
            Self::Y => v,
            Self::Z => Vec3::new(v.x, -v.z, v.y),
        }
    }

    /// Points or directions; nothing is copied when nothing changes.
    pub fn vecs(self, v: &[Vec3]) -> Cow<'_, [Vec3]> {
        match self {
            Self::Y => Cow::Borrowed(v),
            Self::Z => Cow::Owned(v.iter().map(|p| self.vec(*p)).collect()),
        }
    }

    /// A rotation between two spaces that both turn.
    pub fn quat(self, q: Quat) -> Quat {
        match self {
            Self::Y => q,
            Self::Z => Quat::from_xyzw(q.x, -q.z, q.y, q.w),
        }
    }

    /// A scale.
    pub fn scale(self, s: Vec3) -> Vec3 {
        match self {
            Self::Y => s,
            Self::Z => Vec3::new(s.x, s.z, s.y),
        }
    }

    /// A transform between two spaces that both turn.
    pub fn trs(self, m: &Trs) -> Trs {
        Trs { t: self.vec(m.t), r: self.quat(m.r), s: self.scale(m.s) }
    }

    /// Stage from osier's world: for things whose own axes the format fixes (cameras and lights look along -Z).
    pub fn stage_from_world(self) -> Quat {
        match self {
            Self::Y => Quat::IDENTITY,
            Self::Z => Quat::from_xyzw(std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2),
        }
    }
}

/// A box as the two vectors of an `extent`; two zero vectors for an empty one.
pub(super) fn extent(b: &Bounds) -> [[f32; 3]; 2] {
    if b.is_empty() { [[0.0; 3]; 2] } else { [b.min.to_array(), b.max.to_array()] }
}

/// A transform as a row-major matrix with the translation in the last row.
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
        assert!((z.trs(&m).apply(z.vec(p)) - z.vec(m.apply(p))).length() < 1e-5);
        assert!((z.stage_from_world() * p - z.vec(p)).length() < 1e-6);
    }
}
