//! Perspective projection: from pixels to directions.

use glam::Vec3;

use osier_base::math;
use osier_scene::Camera;

/// A camera prepared for the resolution of its picture: the picture plane at unit depth, in the axes of the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct PerspectiveCamera {
    pub(super) eye: Vec3,
    /// Vector from the eye to the upper left corner of the picture plane at unit depth. `right` and `down`: steps
    /// from pixel to pixel on that plane.
    pub(super) corner: Vec3,
    pub(super) right: Vec3,
    pub(super) down: Vec3,
    /// Width of a pixel at unit depth.
    pub(super) spread: f32,
    /// Width and height of the picture, pixels.
    size: [f32; 2],
}

/// A ray from the eye of the camera through a point of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrimaryRay {
    /// Unit vector from the camera into the scene.
    pub(super) direction: Vec3,
    /// Distance to the floor, m; `None` if the ray does not meet its upper side.
    pub(super) floor_distance: Option<f32>,
}

impl PerspectiveCamera {
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let [right, up, back] = camera.axes();
        let (w, h) = (width as f32, height as f32);
        // Half the height of the picture plane at unit depth; pixels are square, so one width
        // serves both axes.
        let half = math::tan_f32(camera.vfov * 0.5);
        let pixel = 2.0 * half / h;
        let corner = up * half - right * (half * w / h) - back;
        Self { eye: camera.eye, corner, right: right * pixel, down: -up * pixel, spread: pixel, size: [w, h] }
    }

    /// Whether position and axes are finite; a render refuses other cameras (P002).
    pub(super) fn is_finite(&self) -> bool {
        [self.eye, self.corner, self.right, self.down].iter().all(|v| v.is_finite())
    }

    /// Unit vector through a pixel. `inside`: position in the pixel, 0 to 1 from its upper left corner.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn direction(&self, [x, y]: [u32; 2], inside: [f32; 2]) -> Vec3 {
        let d = self.corner + self.right * (x as f32 + inside[0]) + self.down * (y as f32 + inside[1]);
        math::normalize_or(d, -Vec3::Z)
    }

    /// Vector through the middle of a pixel whose length spans one metre of depth.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn unit_depth_vector(&self, [x, y]: [u32; 2]) -> Vec3 {
        self.corner + self.right * (x as f32 + 0.5) + self.down * (y as f32 + 0.5)
    }

    /// Position of the middle of a pixel in the picture, 0 to 1 from its upper left corner.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn picture_position(&self, [x, y]: [u32; 2]) -> [f32; 2] {
        [(x as f32 + 0.5) / self.size[0], (y as f32 + 0.5) / self.size[1]]
    }

    /// The ray through a pixel. `floor`: height of the floor, m; `inside`: position in the pixel.
    pub(super) fn primary_ray(&self, floor: Option<f32>, pixel: [u32; 2], inside: [f32; 2]) -> PrimaryRay {
        let direction = self.direction(pixel, inside);
        // Only a camera above the floor sees it: one below looks through it at the subject.
        let floor_below = floor.filter(|y| self.eye.y > *y);
        let floor_distance = floor_below.map(|y| (y - self.eye.y) / direction.y).filter(|t| *t > 0.0 && t.is_finite());
        PrimaryRay { direction, floor_distance }
    }
}
