//! The input of one picture beside the scene.

use super::backdrop::Backdrop;
use super::light::Light;
use osier_scene::Camera;

/// Camera, resolution, light, backdrop and seed of one picture.
#[derive(Debug, Clone, Copy)]
pub struct RenderRequest {
    /// Position and direction of view, vertical field of view in radians.
    pub camera: Camera,
    /// Width and height of the picture, pixels; neither may be 0.
    pub size: [u32; 2],
    /// Sun, sky and haze, usually those of the scene.
    pub light: Light,
    /// Appearance of pixels that no object covers, with the height of the floor that receives shadows.
    pub backdrop: Backdrop,
    /// Seed of the sample pattern: it changes the noise of the picture.
    pub seed: u32,
}
