//! Camera and light.

use glam::Vec3;

/// A perspective camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Where it stands, m.
    pub eye: Vec3,
    /// What it looks at, m.
    pub target: Vec3,
    /// Vertical field of view, rad.
    pub vfov: f32,
    /// Turn about the viewing axis, rad; positive leans the camera to its right.
    pub roll: f32,
}

impl Camera {
    /// Unit vectors of camera space in the world: right, up, back (the camera looks along -back).
    pub fn axes(&self) -> [Vec3; 3] {
        let back = crate::math::normalize_or(self.eye - self.target, Vec3::Z);
        let level = crate::math::normalize_or(Vec3::Y.cross(back), Vec3::X);
        let right = glam::Quat::from_axis_angle(back, -self.roll) * level;
        [right, back.cross(right), back]
    }

    /// Fits a box into the picture: three-quarter view, the camera looking about 10 degrees down.
    /// `bounds`: world box, m; `aspect`: width / height; `vfov`: rad.
    pub fn framing(bounds: crate::geometry::Bounds, aspect: f32, vfov: f32) -> Self {
        let radius = (bounds.size().length() * 0.5).max(1e-3);
        let half = (vfov * 0.5).min(crate::math::atan_f32(crate::math::tan_f32(vfov * 0.5) * aspect));
        let distance = radius / crate::math::sin_f32(half);
        let pitch = crate::units::radians_f32(10.0);
        let (s, c) = (crate::math::sin_f32(pitch), crate::math::cos_f32(pitch));
        let azimuth = crate::units::radians_f32(25.0);
        let out = Vec3::new(c * crate::math::sin_f32(azimuth), s, c * crate::math::cos_f32(azimuth));
        Self { eye: bounds.center() + out * distance, target: bounds.center(), vfov, roll: 0.0 }
    }
}

/// Parallel light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Height over the horizon, rad.
    pub elevation: f32,
    /// Compass turn from +Z towards +X, rad.
    pub azimuth: f32,
    /// Linear colour.
    pub color: [f32; 3],
    /// Irradiance on a surface facing the sun, W/m^2 in Blender's sense (3 is a bright day).
    pub strength: f32,
    /// Angular diameter, rad; softens shadows.
    pub angle: f32,
}

impl Sun {
    /// Unit vector from the ground towards the sun.
    pub fn direction(&self) -> Vec3 {
        let (se, ce) = (crate::math::sin_f32(self.elevation), crate::math::cos_f32(self.elevation));
        Vec3::new(ce * crate::math::sin_f32(self.azimuth), se, ce * crate::math::cos_f32(self.azimuth))
    }
}

/// A vertical gradient of linear colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sky {
    /// At the horizon.
    pub horizon: [f32; 3],
    /// Overhead.
    pub zenith: [f32; 3],
    /// Factor on both.
    pub strength: f32,
}

impl Default for Sun {
    fn default() -> Self {
        let deg = crate::units::radians_f32;
        Self { elevation: deg(40.0), azimuth: deg(75.0), color: [1.0, 0.95, 0.85], strength: 3.0, angle: deg(0.53) }
    }
}

impl Default for Sky {
    fn default() -> Self {
        Self { horizon: [0.85, 0.9, 0.95], zenith: [0.25, 0.45, 0.8], strength: 1.0 }
    }
}
