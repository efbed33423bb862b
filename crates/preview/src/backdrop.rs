//! Backdrops: appearance of pixels that no object covers, and the floor that receives shadows.

use glam::Vec3;

use super::light::Light;
use super::tone::tone_map;
use osier_base::geometry::Bounds;

/// Appearance of pixels that no object covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Backdrop {
    /// The scene's sky, down to and below the horizon.
    Sky,
    /// A bright paper sweep that receives shadows.
    Studio {
        /// Height of the paper, m; `None` if nothing stands on it.
        floor: Option<f32>,
    },
    /// One linear colour, with the shadows on a floor if there is one.
    Plain {
        /// Linear RGB as displayed: it is not tone-mapped.
        color: [f32; 3],
        /// Height of the floor that receives shadows, m; `None`: there is no floor.
        floor: Option<f32>,
    },
    /// Transparent: alpha is the coverage of objects, and the shadow on the floor if there is one.
    Clear {
        /// Height of the floor that receives shadows, m; `None`: there is no floor.
        floor: Option<f32>,
    },
}

impl Backdrop {
    /// Height of the floor in m, if the picture shows one. `bounds`: of the scene; an empty scene has no floor.
    pub(super) fn floor(&self, bounds: &Bounds) -> Option<f32> {
        let floor = match *self {
            Self::Sky => None,
            Self::Studio { floor } | Self::Plain { floor, .. } | Self::Clear { floor } => floor,
        };
        floor.filter(|y| y.is_finite() && !bounds.is_empty())
    }

    /// Displayed linear colour, `None` where the backdrop is transparent. `direction`: unit vector from the camera;
    /// `position`: in the picture, 0 to 1 from its upper left corner.
    pub(super) fn color(&self, direction: Vec3, position: [f32; 2], light: &Light) -> Option<Vec3> {
        match *self {
            Self::Sky => Some(tone_map(light.sky(direction))),
            Self::Studio { .. } => Some(studio_paper(position)),
            Self::Plain { color, .. } => Some(Vec3::from_array(color)),
            Self::Clear { .. } => None,
        }
    }
}

/// Displayed colour of the studio's paper: brightest a little above the middle of the picture and warmer towards its
/// bottom.
/// Own: chosen by eye to set off green without tinting it.
fn studio_paper([x, y]: [f32; 2]) -> Vec3 {
    // Vignette: darker with the squared distance from a point above the middle, by at most 30 %.
    let (dx, dy) = (x - 0.5, y - 0.42);
    let falloff = (dx * dx + dy * dy).min(0.6);
    // From a neutral grey above to a warm one below, as if the paper reflected the ground.
    let base = Vec3::new(0.86, 0.87, 0.86).lerp(Vec3::new(0.80, 0.78, 0.74), (y * 1.4 - 0.5).clamp(0.0, 1.0));
    base * (1.0 - 0.5 * falloff)
}
