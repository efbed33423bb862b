//! The turtle's frame: heading, left and up.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3};

use osier_base::math;

/// The turtle's orientation: an orthonormal right-handed frame of heading H, left L and up U = H x L.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TurtleFrame {
    // Heading, left and up, as in the literature on L-systems.
    pub h: DVec3,
    pub l: DVec3,
    pub u: DVec3,
}

impl TurtleFrame {
    /// Start: the heading points up (+Y), left to -X, and up to the viewer (+Z).
    pub const START: Self = Self { h: DVec3::Y, l: DVec3::NEG_X, u: DVec3::Z };

    /// Turns left by the angle of cosine `c` and sine `s`.
    pub fn yaw(&mut self, c: f64, s: f64) {
        (self.h, self.l) = (self.h * c + self.l * s, self.l * c - self.h * s);
    }

    /// Pitches the heading down, away from up, by the angle of cosine `c` and sine `s`.
    pub fn pitch(&mut self, c: f64, s: f64) {
        (self.h, self.u) = (self.h * c - self.u * s, self.u * c + self.h * s);
    }

    /// Rolls about the heading by the angle of cosine `c` and sine `s`, in the sense of the command `\`.
    pub fn roll(&mut self, c: f64, s: f64) {
        (self.l, self.u) = (self.l * c + self.u * s, self.u * c - self.l * s);
    }

    /// Removes the rounding errors of many turns; the direction of the heading stays.
    pub fn orthonormalize(&mut self) {
        self.h = self.h.normalize_or(DVec3::Y);
        self.set_left(self.l);
    }

    /// Takes as left the part of `l` that is perpendicular to the heading (one Gram-Schmidt step), and up from both.
    fn set_left(&mut self, l: DVec3) {
        // If `l` has no perpendicular part, any direction perpendicular to the heading will do.
        let across = l - self.h * l.dot(self.h);
        self.l = across.try_normalize().unwrap_or_else(|| self.h.any_orthonormal_vector());
        self.u = self.h.cross(self.l);
    }

    /// The frame with another heading, reached by the rotation of least angle, which adds no roll.
    pub fn with_heading(&self, h: DVec3) -> Self {
        // Axis and angle of that rotation: H x h is its axis times the sine, H . h the cosine.
        let axis = self.h.cross(h);
        let (s, c) = (axis.length(), self.h.dot(h));
        let mut out = if s > 1e-12 {
            self.rotated(axis / s, c, s)
        } else if c < 0.0 {
            // The opposite heading: the axis is undefined, so turn by pi about L.
            self.rotated(self.l, -1.0, 0.0)
        } else {
            *self
        };
        out.h = h;
        out.orthonormalize();
        out
    }

    /// The frame turned about a unit axis by the angle of cosine `c` and sine `s` (Rodrigues' formula).
    pub fn rotated(&self, axis: DVec3, c: f64, s: f64) -> Self {
        let turn = |v: DVec3| v * c + axis.cross(v) * s + axis * (axis.dot(v) * (1.0 - c));
        Self { h: turn(self.h), l: turn(self.l), u: turn(self.u) }
    }

    /// Rolls until left is horizontal (ABOP: L = V x H / |V x H| with V upwards).
    /// Nothing happens if the heading is vertical.
    pub fn level(&mut self) {
        let l = DVec3::Y.cross(self.h);
        if l.length_squared() > 1e-18 {
            self.l = l.normalize();
            self.u = self.h.cross(self.l);
        }
    }

    /// Sets the heading and, if given, up; without it, left and up follow from `last` by the smallest rotation.
    pub fn set(&mut self, h: DVec3, up: Option<DVec3>, last: &Self) {
        let Some(h) = h.try_normalize() else { return };
        *self = last.with_heading(h);
        if let Some(up) = up.and_then(|u| (u - h * u.dot(h)).try_normalize()) {
            (self.h, self.u) = (h, up);
            self.l = up.cross(h);
        }
    }

    /// Rotation that takes X, Y, Z to -L, H, U.
    pub fn quat(&self) -> DQuat {
        DQuat::from_mat3(&DMat3::from_cols(-self.l, self.h, self.u)).normalize()
    }
}

/// The vector in single precision, each component rounded to nearest.
pub(super) fn narrow(v: DVec3) -> Vec3 {
    Vec3::new(math::narrow(v.x), math::narrow(v.y), math::narrow(v.z))
}

/// Position and orientation of the turtle, or of an organ that it places.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurtlePose {
    /// Position in plant space, m.
    pub p: DVec3,
    /// Rotation from prototype space: X to the right, Y ahead, Z up.
    pub q: DQuat,
}

/// A rotation in single precision, normalized again.
pub(super) fn narrow_quat(q: DQuat) -> Quat {
    Quat::from_xyzw(math::narrow(q.x), math::narrow(q.y), math::narrow(q.z), math::narrow(q.w)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::units::radians;

    fn near(a: DVec3, b: [f64; 3], tolerance: f64) {
        assert!((a - DVec3::from(b)).length() < tolerance, "{a} {b:?}");
    }

    fn sincos(a: f64) -> (f64, f64) {
        (math::cos(radians(a)), math::sin(radians(a)))
    }

    #[test]
    fn turns_agree_with_the_reference_program() {
        let mut f = TurtleFrame::START;
        let (c, s) = sincos(30.0);
        f.yaw(c, s);
        near(f.h, [-0.5, 0.866_025, 0.0], 1e-6);
        f.pitch(c, s);
        near(f.h, [-0.433_013, 0.75, -0.5], 1e-6);
        f.roll(c, -s);
        near(f.u, [-0.649_519, 0.125, 0.75], 1e-6);
        near(f.h.cross(f.l), f.u.to_array(), 1e-12);
    }

    #[test]
    fn frames_stay_orthonormal() {
        let mut f = TurtleFrame::START;
        for i in 0..1_000_000_u32 {
            let (c, s) = if i % 2 == 0 { (0.6, 0.8) } else { (0.8, 0.6) };
            match i % 3 {
                0 => f.yaw(c, s),
                1 => f.pitch(c, s),
                _ => f.roll(c, s),
            }
            if i % 64 == 0 {
                f.orthonormalize();
            }
        }
        f.orthonormalize();
        assert!((f.h.length() - 1.0).abs() < 1e-12 && (f.l.length() - 1.0).abs() < 1e-12);
        assert!(f.h.dot(f.l).abs() < 1e-12 && f.u.dot(f.h).abs() < 1e-12 && f.u.dot(f.l).abs() < 1e-12);
    }

    #[test]
    fn levelling_and_setting() {
        let mut f = TurtleFrame::START;
        f.level();
        assert_eq!(f, TurtleFrame::START);
        f.yaw(0.0, 1.0);
        f.roll(0.6, 0.8);
        f.level();
        near(f.u, [0.0, 1.0, 0.0], 1e-12);
        near(f.l, [0.0, 0.0, 1.0], 1e-12);
        f.set(DVec3::Z, Some(DVec3::new(0.0, -1.0, 5.0)), &TurtleFrame::START);
        near(f.u, [0.0, -1.0, 0.0], 1e-12);
        near(f.h.cross(f.l), f.u.to_array(), 1e-12);
        assert!((f.quat() * DVec3::Y - f.h).length() < 1e-12);
        assert!((f.quat() * DVec3::X + f.l).length() < 1e-12);
        let back = TurtleFrame::START.with_heading(DVec3::NEG_Y);
        near(back.h, [0.0, -1.0, 0.0], 1e-12);
    }
}
