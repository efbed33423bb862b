//! What lies behind and below.

use glam::Vec3;

use super::light::{Light, SampleContext};
use super::tone::film;
use super::world::World;

/// What is seen where nothing stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Backdrop {
    /// The scene's sky, down to and below the horizon.
    Sky,
    /// A bright sweep of paper that takes shadows.
    Studio {
        /// Height of the paper, m; none where nothing stands on it.
        floor: Option<f32>,
    },
    /// One linear colour, with the shadows on a floor if there is one.
    Plain {
        /// As it is shown.
        color: [f32; 3],
        /// Height of the floor, m.
        floor: Option<f32>,
    },
    /// Nothing: alpha is what things cover, and the shadow on the floor if there is one.
    Clear {
        /// Height of the floor, m.
        floor: Option<f32>,
    },
}

impl Backdrop {
    /// Height of the floor, if the picture shows one.
    pub(super) fn floor(&self, world: &World<'_>) -> Option<f32> {
        let floor = match *self {
            Self::Sky => None,
            Self::Studio { floor } | Self::Plain { floor, .. } | Self::Clear { floor } => floor,
        };
        floor.filter(|y| y.is_finite() && !world.bounds.is_empty())
    }

    /// The shown colour, and whether there is any. `direction`: of the look; `place`: in the picture, 0..1 from the
    /// upper left corner.
    pub(super) fn behind(&self, direction: Vec3, place: [f32; 2], light: &Light) -> (Vec3, bool) {
        match *self {
            Self::Sky => (film(light.sky(direction)), true),
            Self::Studio { .. } => (studio(place), true),
            Self::Plain { color, .. } => (Vec3::from_array(color), true),
            Self::Clear { .. } => (Vec3::ZERO, false),
        }
    }
}

/// Paper: brightest a little above the middle, a touch warmer below.
fn studio([x, y]: [f32; 2]) -> Vec3 {
    let (dx, dy) = (x - 0.5, y - 0.42);
    let fall = (dx * dx + dy * dy).min(0.6);
    let base = Vec3::new(0.86, 0.87, 0.86).lerp(Vec3::new(0.80, 0.78, 0.74), (y * 1.4 - 0.5).clamp(0.0, 1.0));
    base * (1.0 - 0.5 * fall)
}

impl World<'_> {
    /// Light on a place just above the floor over the light there if nothing stood around.
    pub(super) fn floor_light(&self, light: &Light, p: Vec3, draw: &SampleContext<'_>) -> f32 {
        let grey = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let (sun, sky) = self.open_light(light, p, draw);
        let full = grey(light.open_sun() + light.mean_sky());
        if full > 0.0 { grey(sun + sky) / full } else { 1.0 }
    }
}
