//! A camera with a picture's shape: from pixels to directions.

use glam::Vec3;

use osier_base::math;
use osier_scene::Camera;

/// A camera with a picture's shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    pub(super) eye: Vec3,
    /// Picture plane at unit distance: its upper left corner, and steps of a pixel to the right and down.
    pub(super) corner: Vec3,
    pub(super) right: Vec3,
    pub(super) down: Vec3,
    /// Width of a pixel at unit distance.
    pub(super) spread: f32,
    size: [f32; 2],
}

impl Lens {
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let [right, up, back] = camera.axes();
        let (w, h) = (width as f32, height as f32);
        let half = math::tan_f32(camera.vfov * 0.5);
        let pixel = 2.0 * half / h;
        let corner = up * half - right * (half * w / h) - back;
        Self { eye: camera.eye, corner, right: right * pixel, down: -up * pixel, spread: pixel, size: [w, h] }
    }

    pub(super) fn is_finite(&self) -> bool {
        [self.eye, self.corner, self.right, self.down].iter().all(|v| v.is_finite())
    }

    /// Unit direction through a pixel. `inside`: place in the pixel, 0..1 from its upper left corner.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn direction(&self, [x, y]: [u32; 2], inside: [f32; 2]) -> Vec3 {
        let d = self.corner + self.right * (x as f32 + inside[0]) + self.down * (y as f32 + inside[1]);
        math::normalize_or(d, -Vec3::Z)
    }

    /// Direction through the middle of a pixel, as long as it takes to go one metre deep.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn span(&self, [x, y]: [u32; 2]) -> Vec3 {
        self.corner + self.right * (x as f32 + 0.5) + self.down * (y as f32 + 0.5)
    }

    /// Place in the picture, 0..1 from its upper left corner.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn place(&self, [x, y]: [u32; 2]) -> [f32; 2] {
        [(x as f32 + 0.5) / self.size[0], (y as f32 + 0.5) / self.size[1]]
    }

    /// Where a look goes, and how far it is to the floor. `inside`: place in the pixel.
    pub(super) fn aim(&self, floor: Option<f32>, place: [u32; 2], inside: [f32; 2]) -> (Vec3, Option<f32>) {
        let direction = self.direction(place, inside);
        (direction, floor.map(|y| (y - self.eye.y) / direction.y).filter(|t| *t > 0.0 && t.is_finite()))
    }
}
