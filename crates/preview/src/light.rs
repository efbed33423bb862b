//! Light sources: a sun with an angular radius, a sky with a horizon and a zenith colour, and haze.

use glam::Vec3;

use osier_base::math;
use osier_scene::{Fog, Sky, Sun};

/// Distance that the sky is seen through haze, m: far enough for any haze to become opaque along it.
const SKY_DISTANCE: f32 = 1e6;

/// Sun, sky and haze of a scene. Colours are linear and multiplied by their strengths.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    /// Unit vector in the world to the middle of the sun.
    to_sun: Vec3,
    /// Linear irradiance on a surface that faces the sun.
    sun: Vec3,
    /// Cosine of the sun's angular radius.
    cos_radius: f32,
    horizon: Vec3,
    zenith: Vec3,
    /// The sky, its strength already in its colours.
    sky: Sky,
    /// Colour of the bright air around the sun.
    glow: Vec3,
    fog: Option<Fog>,
}

/// Effect of haze on light along a ray: it arrives as `radiance * transmittance + in_scattered`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Haze {
    pub(super) transmittance: f32,
    pub(super) in_scattered: Vec3,
}

impl Light {
    /// The light of a scene's sun and sky, in the scene's linear units of radiance.
    pub fn new(sun: &Sun, sky: &Sky) -> Self {
        Self {
            to_sun: sun.direction(),
            sun: Vec3::from_array(sun.color) * sun.strength,
            // Kept below 1, else the solid angle of the disc would vanish in f32.
            cos_radius: math::cos_f32(sun.angle * 0.5).min(1.0 - 1e-7),
            horizon: Vec3::from_array(sky.horizon) * sky.strength,
            zenith: Vec3::from_array(sky.zenith) * sky.strength,
            sky: Sky {
                horizon: sky.horizon.map(|c| c * sky.strength),
                zenith: sky.zenith.map(|c| c * sky.strength),
                below: sky.below.map(|b| b.map(|c| c * sky.strength)),
                strength: 1.0,
                ..*sky
            },
            glow: Vec3::from_array(sun.color) * sky.glow,
            fog: sky.fog,
        }
    }

    /// Unit vector in the world to the middle of the sun.
    pub(super) fn sun_direction(&self) -> Vec3 {
        self.to_sun
    }

    /// Irradiance on a surface that faces the sun; zero without a sun.
    pub(super) fn sun_irradiance(&self) -> Vec3 {
        self.sun
    }

    /// Radiance of the sky in a unit direction, seen from the ground through the haze.
    pub(super) fn sky(&self, direction: Vec3) -> Vec3 {
        let clear = self.sky.toward(direction, self.to_sun, self.glow);
        let haze = self.haze(Vec3::ZERO, direction, SKY_DISTANCE);
        clear * haze.transmittance + haze.in_scattered
    }

    /// Effect of haze between `eye` and the point `length` m from it along the unit vector `direction`.
    pub(super) fn haze(&self, eye: Vec3, direction: Vec3, length: f32) -> Haze {
        self.fog.map_or(Haze { transmittance: 1.0, in_scattered: Vec3::ZERO }, |fog| {
            let transmittance = fog.clear(eye, direction, length);
            Haze { transmittance, in_scattered: Vec3::from_array(fog.color) * (1.0 - transmittance) }
        })
    }

    /// Mean radiance of the sky, weighted by the cosine on a level surface: the integral over sin(elevation) of a
    /// colour that is linear in it puts a third of the weight on the horizon and two thirds on the zenith.
    pub(super) fn mean_sky(&self) -> Vec3 {
        self.horizon.lerp(self.zenith, 2.0 / 3.0)
    }

    /// Radiance of a white, level, unoccluded floor due to the sun: E sin(elevation) / pi.
    pub(super) fn open_sun(&self) -> Vec3 {
        self.sun * (self.to_sun.y.max(0.0) * std::f32::consts::FRAC_1_PI)
    }

    /// A direction uniformly distributed over the sun's disc. `u`: in the unit square.
    pub(super) fn sample_sun(&self, u: [f32; 2]) -> Vec3 {
        // Equal areas of a spherical cap have equal ranges of the cosine.
        let cos = 1.0 - u[0] * (1.0 - self.cos_radius);
        direction_about(self.to_sun, cos, u[1])
    }
}

/// The unit vector at an angle of cosine `cos` from the unit vector `axis`, `turn` of a full turn about it.
fn direction_about(axis: Vec3, cos: f32, turn: f32) -> Vec3 {
    // An orthonormal frame about the axis; which one is irrelevant, as `turn` is uniform.
    let x = math::perpendicular(axis);
    let y = axis.cross(x);
    let sin = math::sqrt_f32((1.0 - cos * cos).max(0.0));
    let angle = turn * std::f32::consts::TAU;
    axis * cos + (x * math::cos_f32(angle) + y * math::sin_f32(angle)) * sin
}

/// A direction in the hemisphere about `n` with the density cos / pi of a diffuse surface. `u`: in the unit square.
pub(super) fn sample_cosine(n: Vec3, u: [f32; 2]) -> Vec3 {
    // Malley: a uniform point of the unit disc, projected up to the hemisphere, has cos^2 = 1 - u.
    direction_about(n, math::sqrt_f32(1.0 - u[0]), u[1])
}
