//! Camera and light.

use glam::Vec3;

/// A perspective camera without depth of field; its horizon is level unless it is rolled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position in the world, m.
    pub eye: Vec3,
    /// Point of the world that projects to the centre of the picture, m.
    pub target: Vec3,
    /// Full angle between the upper and the lower edge of the picture, rad.
    pub vfov: f32,
    /// Rotation about the viewing axis, rad; positive leans the camera to its right.
    pub roll: f32,
}

impl Camera {
    /// Unit vectors of camera space in the world: right, up, back (the camera looks along -back).
    pub fn axes(&self) -> [Vec3; 3] {
        let back = osier_base::math::normalize_or(self.eye - self.target, Vec3::Z);
        let level = osier_base::math::normalize_or(Vec3::Y.cross(back), Vec3::X);
        let right = glam::Quat::from_axis_angle(back, -self.roll) * level;
        [right, back.cross(right), back]
    }

    /// World from camera space: columns right, up, back and position.
    pub fn matrix(&self) -> glam::Mat4 {
        let [right, up, back] = self.axes();
        glam::Mat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), self.eye.extend(1.0))
    }

    /// Distances of the near and the far clipping plane, m. The far one is 1000 m plus a hundred times the distances of camera
    /// and target from the origin, so that no ground is clipped.
    pub fn clipping_range(&self) -> [f32; 2] {
        [0.01, (self.eye.length() + self.target.length()) * 100.0 + 1000.0]
    }

    /// Fits a box into the picture: three-quarter view, the camera looking about 10 degrees down. The corner of the box that
    /// projects farthest from the middle of the picture lies `FILL` of the way to the edge.
    /// `bounds`: world box, m; `aspect`: width / height; `vfov`, `roll`: rad.
    pub fn framing(bounds: osier_base::geometry::Bounds, aspect: f32, vfov: f32, roll: f32) -> Self {
        let pitch = osier_base::units::radians_f32(10.0);
        let (s, c) = (osier_base::math::sin_f32(pitch), osier_base::math::cos_f32(pitch));
        let azimuth = osier_base::units::radians_f32(25.0);
        let out = Vec3::new(c * osier_base::math::sin_f32(azimuth), s, c * osier_base::math::cos_f32(azimuth));
        let target = bounds.center();
        // The directions of the picture's edges do not depend on the distance.
        let unfitted = Self { eye: target + out, target, vfov, roll };
        let [right, up, back] = unfitted.axes();
        let half_height = osier_base::math::tan_f32(vfov * 0.5);
        let half_width = half_height * aspect;
        // A corner at (x, y, z) from the target is seen at x / (d - z): the least distance d that keeps it in the picture.
        let least_distance = |corner: Vec3| {
            let from = corner - target;
            let across = (from.dot(right).abs() / half_width).max(from.dot(up).abs() / half_height);
            from.dot(back) + across / Self::FILL
        };
        let corners = if bounds.is_empty() { Vec::new() } else { bounds.corners().to_vec() };
        let distance = corners.into_iter().map(least_distance).fold(Self::LEAST_DISTANCE, f32::max);
        Self { eye: target + out * distance, ..unfitted }
    }

    /// Share of the half width and half height of the picture that a framed box fills; the rest is margin. Own: as that of pictures
    /// of the preview.
    const FILL: f32 = 0.9;
    /// Least distance of a framing camera from its target, m: even a point is seen from in front. Own.
    const LEAST_DISTANCE: f32 = 1e-3;
}

/// How the radiance of a picture becomes displayed light. Own: a toe that deepens shade and a shoulder towards white,
/// f(x) = x (1.2 x + 0.05) / (x (1.15 x + 0.62) + 0.14), where x is the luminance times [`Self::EXPOSURE`].
#[derive(Debug, Clone, Copy)]
pub struct ToneCurve;

impl ToneCurve {
    /// Factor on all radiance: a meadow in full sun lies a little above middle grey. A larger one brightens every picture.
    pub const EXPOSURE: f32 = 1.25;
    /// Coefficients of x^2, x and 1 above the fraction line.
    pub const NUMERATOR: [f32; 3] = [1.2, 0.05, 0.0];
    /// Coefficients of x^2, x and 1 below the fraction line.
    pub const DENOMINATOR: [f32; 3] = [1.15, 0.62, 0.14];

    /// Displayed luminance, 0 to 1, of an exposed luminance, 0 or more.
    pub fn displayed(x: f32) -> f32 {
        // The numerator has no constant part, which is left out: x (a x + b).
        let [a, b, _] = Self::NUMERATOR;
        let [c, d, e] = Self::DENOMINATOR;
        (x * (a * x + b) / (x * (c * x + d) + e)).min(1.0)
    }
}

/// Sunlight: parallel light with a disc of finite size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Height over the horizon, rad.
    pub elevation: f32,
    /// Direction of the sun seen from above, rad: 0 along +Z, pi/2 along +X.
    pub azimuth: f32,
    /// Linear RGB; its brightness multiplies `strength`.
    pub color: [f32; 3],
    /// Irradiance on a surface facing the sun, W/m^2 in Blender's sense (3 is a bright day).
    pub strength: f32,
    /// Angular diameter, rad; softens shadows.
    pub angle: f32,
}

impl Sun {
    /// Unit vector from the ground towards the sun.
    pub fn direction(&self) -> Vec3 {
        let (se, ce) = (osier_base::math::sin_f32(self.elevation), osier_base::math::cos_f32(self.elevation));
        Vec3::new(ce * osier_base::math::sin_f32(self.azimuth), se, ce * osier_base::math::cos_f32(self.azimuth))
    }
}

/// A vertical gradient of linear colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sky {
    /// Linear RGB at the horizon.
    pub horizon: [f32; 3],
    /// Linear RGB straight up.
    pub zenith: [f32; 3],
    /// Linear RGB below the horizon, as of distant trees; `None`: the colour of the horizon.
    pub below: Option<[f32; 3]>,
    /// Strength of patches of shade and light all around, 0..1, as of leaves far out of focus. They are seen directly, reflected
    /// and refracted, and light nothing.
    pub dapple: f32,
    /// Brightness of the glow around the sun, as a factor on the sun's colour; 0: no glow.
    pub glow: f32,
    /// Factor on both colours; radiance = colour times strength.
    pub strength: f32,
    /// Haze between the camera and what it sees; none for clear air.
    pub fog: Option<Fog>,
}

/// Haze: of one density up to y = 0, thinner above.
/// Source: Koschmieder, extinction = 3.912 / visibility; the share left at height y is 1 / (1 + y / height)^2, as in
/// POV-Ray's ground fog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fog {
    /// Distance at which 2 % of a contrast is left, m, > 0.
    pub visibility: f32,
    /// Linear colour, with the strength of the sky in it.
    pub color: [f32; 3],
    /// Height at which a quarter of the density at y = 0 is left, m; 0: the same density at all heights.
    pub height: f32,
}

impl Fog {
    /// Optical depth of `visibility` metres of haze, after which 2 % of a contrast is left: -ln 0.02.
    pub const CONTRAST: f32 = 3.912;

    /// Transmittance, 0 to 1, of `length` m of haze from the world point `from` along the unit vector `along`.
    pub fn clear(&self, from: Vec3, along: Vec3, length: f32) -> f32 {
        let rate = Self::CONTRAST / self.visibility;
        if self.height <= 0.0 {
            return osier_base::math::exp_f32(-rate * length);
        }
        // Integral of the relative density from y = 0 to a height: the length of haze of full density that attenuates as much.
        let below = |y: f32| match y {
            y if y <= 0.0 => y,
            y if y.is_finite() => self.height * y / (self.height + y),
            _ => self.height,
        };
        let share = |y: f32| if y <= 0.0 { 1.0 } else { 1.0 / ((1.0 + y / self.height) * (1.0 + y / self.height)) };
        // The density along the ray integrates to a difference of `below` divided by the slope of the ray, which would be 0 / 0
        // for a level ray.
        let rise = along.y * length;
        let amount = if rise.abs() < 1e-3 * self.height {
            share(from.y) * length
        } else {
            (below(from.y + rise) - below(from.y)) / along.y
        };
        osier_base::math::exp_f32(-rate * amount)
    }
}

impl Default for Sun {
    fn default() -> Self {
        let deg = osier_base::units::radians_f32;
        Self { elevation: deg(40.0), azimuth: deg(75.0), color: [1.0, 0.95, 0.85], strength: 3.0, angle: deg(0.53) }
    }
}

impl Sky {
    /// Positions between straight down, 0, and straight up, 1, where the colour below the horizon ends and that of the horizon
    /// begins: a soft edge, as of trees far out of focus.
    pub const BAND: [f32; 2] = [0.38, 0.55];
    /// Brightness straight down as a share of that at the lower end of [`Self::BAND`].
    pub const DEEP: f32 = 0.4;
    /// Share of the glow around the sun at cosines of the angle to it. Own: chosen by eye, after hazy mornings.
    pub const GLOW: [(f32, f32); 6] = [(0.82, 0.0), (0.9, 0.04), (0.95, 0.13), (0.98, 0.34), (0.994, 0.7), (1.0, 1.0)];

    /// Radiance in a unit direction, with what stands below the horizon and the glow around the sun, without the sun's disc,
    /// [`Self::dapple`] and haze. Source: [`Self::stops`] and [`Self::GLOW`].
    pub fn radiance(&self, sun: &Sun, direction: Vec3) -> Vec3 {
        self.toward(direction, sun.direction(), Vec3::from_array(sun.color) * self.glow)
    }

    /// As [`Self::radiance`], with what does not depend on the direction computed once. `sun`: unit vector to it; `glow`: linear
    /// colour of the glow around it.
    pub fn toward(&self, direction: Vec3, sun: Vec3, glow: Vec3) -> Vec3 {
        let [horizon, zenith] = [self.horizon, self.zenith].map(|c| Vec3::from_array(c) * self.strength);
        let y = direction.y.clamp(-1.0, 1.0);
        let at = 0.5 + 0.5 * y;
        let [edge, open] = Self::BAND;
        let plain = match self.below.map(|c| Vec3::from_array(c) * self.strength) {
            None => horizon.lerp(zenith, y.max(0.0)),
            Some(below) if at < edge => (below * Self::DEEP).lerp(below, at / edge),
            Some(below) if at < open => below.lerp(horizon, (at - edge) / (open - edge)),
            Some(_) => horizon.lerp(zenith, (at - open) / (1.0 - open)),
        };
        if glow == Vec3::ZERO {
            return plain;
        }
        // The glow is interpolated between the two entries of the table that enclose the cosine; below the first there is none.
        let cos = direction.dot(sun);
        let inner = Self::GLOW.iter().position(|(c, _)| cos < *c).unwrap_or(Self::GLOW.len() - 1);
        let Some(outer) = inner.checked_sub(1) else { return plain };
        let [(c0, s0), (c1, s1)] = [Self::GLOW[outer], Self::GLOW[inner]];
        plain.lerp(glow, osier_base::math::lerp(s0, s1, ((cos - c0) / (c1 - c0)).clamp(0.0, 1.0)))
    }

    /// Stops of the gradient: position from straight down, 0, to straight up, 1, and linear colour times strength; without glow.
    pub fn stops(&self) -> Vec<(f32, [f32; 3])> {
        let [horizon, zenith] = [self.horizon, self.zenith].map(|c| c.map(|c| c * self.strength));
        match self.below.map(|c| c.map(|c| c * self.strength)) {
            Some(below) => {
                let deep = below.map(|c| c * Self::DEEP);
                vec![(0.0, deep), (Self::BAND[0], below), (Self::BAND[1], horizon), (1.0, zenith)]
            }
            None => vec![(0.0, horizon), (0.5, horizon), (1.0, zenith)],
        }
    }
}

impl Default for Sky {
    fn default() -> Self {
        Self {
            horizon: [0.85, 0.9, 0.95],
            zenith: [0.25, 0.45, 0.8],
            below: None,
            dapple: 0.0,
            glow: 0.0,
            strength: 1.0,
            fog: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::geometry::Bounds;

    /// A slender tree, a wide meadow and a rolled view: the outermost corner lies at nine tenths of the half picture.
    #[test]
    fn a_framed_box_fills_nine_tenths_of_the_picture() {
        let boxes = [
            (Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 9.0, 1.0)),
            (Vec3::new(-20.0, 0.0, -20.0), Vec3::new(20.0, 0.4, 20.0)),
            (Vec3::new(3.0, 2.0, 1.0), Vec3::new(3.5, 2.5, 9.0)),
        ];
        for (min, max) in boxes {
            for (aspect, vfov, roll) in [(4.0 / 3.0, 0.6, 0.0), (0.5, 1.2, 0.0), (1.8, 0.3, 0.7)] {
                let bounds = Bounds { min, max };
                let camera = Camera::framing(bounds, aspect, vfov, roll);
                let [right, up, back] = camera.axes();
                let half = osier_base::math::tan_f32(vfov * 0.5);
                let seen = |corner: Vec3| {
                    let from = corner - camera.eye;
                    let depth = -from.dot(back);
                    assert!(depth > 0.0, "{corner} lies behind the camera");
                    (from.dot(right) / depth / half / aspect).abs().max((from.dot(up) / depth / half).abs())
                };
                let outermost = bounds.corners().map(seen).into_iter().fold(0.0, f32::max);
                assert!((outermost - 0.9).abs() < 1e-3, "{outermost} of {bounds:?}");
            }
        }
    }

    #[test]
    fn haze_leaves_two_percent_at_the_visibility_and_thins_out_above() {
        let fog = Fog { visibility: 400.0, color: [1.0; 3], height: 0.0 };
        assert!((fog.clear(Vec3::ZERO, Vec3::X, 400.0) - 0.02).abs() < 1e-4);
        let low = Fog { height: 30.0, ..fog };
        assert!((low.clear(Vec3::new(0.0, -5.0, 0.0), Vec3::X, 400.0) - 0.02).abs() < 1e-4);
        // Straight up from the ground there is as much haze as in 30 m along it.
        let up = low.clear(Vec3::ZERO, Vec3::Y, f32::INFINITY);
        assert!((up - low.clear(Vec3::ZERO, Vec3::X, 30.0)).abs() < 1e-5);
        // A slant through many thin layers agrees with their sum.
        let d = Vec3::new(0.8, 0.6, 0.0);
        let step = 0.01;
        let sum = (0..10_000_u16).fold(0.0_f32, |s, i| {
            let y = 2.0 + d.y * (f32::from(i) + 0.5) * step;
            s + step / ((1.0 + y / 30.0) * (1.0 + y / 30.0))
        });
        let wanted = osier_base::math::exp_f32(-Fog::CONTRAST / 400.0 * sum);
        assert!((low.clear(Vec3::new(0.0, 2.0, 0.0), d, 100.0) - wanted).abs() < 1e-3);
    }
}
