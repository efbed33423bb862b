//! Size, quality, camera, sun and background of previews.

use super::PreviewScene;
use osier_base::units::{linear_from_srgb, radians_f32};
use osier_preview::{Backdrop, CameraView, Light, Quality, RenderRequest, Subject};
use osier_scene::Camera;

/// Largest vertical field of view of fitted cameras, degrees: wider ones distort objects at the edge.
const MAX_FITTED_FOV: f32 = 60.0;

/// Depth, m, to which the foot of a plant of less than 10 m may reach into the ground: more than `skin.bury` of any preset.
const DEEPEST_FOOT: f32 = 0.5;

/// Size, quality, camera, sun and background of a preview.
#[derive(Debug, Clone, PartialEq)]
pub struct PreviewOptions {
    /// Width and height of a picture, pixels.
    pub size: [u32; 2],
    /// Trade-off between speed and noise.
    pub quality: Quality,
    /// Position of the camera; `None`: that of the scene if it places one, else [`CameraView::Portrait`].
    pub view: Option<PreviewView>,
    /// Elevation and direction of a sun that replaces the scene's, degrees; direction 0 is +X, 90 is -Z.
    pub sun: Option<[f32; 2]>,
    /// Background where the subject covers nothing.
    pub background: PreviewBackground,
}

impl Default for PreviewOptions {
    /// A picture of 800 x 800 pixels of normal quality.
    fn default() -> Self {
        Self { size: [800, 800], quality: Quality::Normal, view: None, sun: None, background: PreviewBackground::Auto }
    }
}

/// Camera of a preview: that of the scene, or one fitted to the subject.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PreviewView {
    /// The camera of the scene, which is fitted to its plants if its keys place none.
    Scene,
    /// A camera fitted to the subject, in the given direction.
    Fitted(CameraView),
}

/// Content of a preview behind the scene, and whether a floor receives shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PreviewBackground {
    /// The sky for scenes with a ground or with a colour below the horizon, the studio for all others.
    Auto,
    /// The sky of the scene, with its sun glow and haze.
    Sky,
    /// A bright paper sweep that receives shadows.
    Studio,
    /// Transparent, with the shadow on the floor.
    Clear,
    /// One sRGB colour, channels 0 to 1.
    Color([f32; 3]),
}

impl PreviewOptions {
    /// Ratio of the width and the height of a picture.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub fn aspect(&self) -> f32 {
        self.size[0] as f32 / self.size[1] as f32
    }

    /// The camera for a scene; a fitted one frames `subject`.
    pub fn camera(&self, scene: &PreviewScene, subject: &Subject) -> Camera {
        let own = scene.scene().camera;
        let vfov = own.vfov.min(radians_f32(MAX_FITTED_FOV));
        match self.view {
            Some(PreviewView::Scene) if scene.has_own_view() => own,
            Some(PreviewView::Fitted(view)) => subject.camera(view, self.aspect(), vfov),
            // Without `--view` the scene's camera has precedence over a fitted one.
            None if scene.has_camera() => own,
            Some(PreviewView::Scene) | None => subject.camera(CameraView::Portrait, self.aspect(), vfov),
        }
    }

    /// The request that renders a scene with a camera. `subject`: of this scene; its lowest point may carry the
    /// studio's floor.
    pub fn request(&self, scene: &PreviewScene, subject: &Subject, camera: Camera) -> RenderRequest {
        let scene = scene.scene();
        let mut sun = scene.sun;
        if let Some([elevation, direction]) = self.sun {
            // Directions count from +X towards -Z, azimuths from +Z towards +X.
            (sun.elevation, sun.azimuth) = (radians_f32(elevation), radians_f32(direction + 90.0));
        }
        // Trunks reach a little below the ground on which they stand: a subject whose lowest point is near 0 stands on the
        // plane y = 0; any other, such as a curve of many units, stands on its lowest point.
        let (low, height) = (subject.bounds.min.y, subject.bounds.size().y);
        // At most a quarter of the height; from 2 m on `DEEPEST_FOOT`, and from 10 m on a twentieth of the height.
        let deepest = (0.25 * height).min((0.05 * height).max(DEEPEST_FOOT));
        let floor_height = if low > -deepest && low < 0.1 * height { 0.0 } else { low };
        let floor = if subject.ground { None } else { Some(floor_height) };
        let backdrop = match self.background {
            PreviewBackground::Auto if subject.ground || scene.sky.below.is_some() => Backdrop::Sky,
            PreviewBackground::Sky => Backdrop::Sky,
            PreviewBackground::Auto | PreviewBackground::Studio => Backdrop::Studio { floor },
            PreviewBackground::Clear => Backdrop::Clear { floor },
            PreviewBackground::Color(c) => Backdrop::Plain { color: c.map(linear_from_srgb), floor },
        };
        RenderRequest { camera, size: self.size, light: Light::new(&sun, &scene.sky), backdrop, seed: 0 }
    }
}
