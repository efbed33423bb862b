//! How much of the world a pixel of the camera's picture covers.

use glam::Vec3;

use super::{AssetFrame, Camera, Scene, asset_bounds};
use osier_base::geometry::Bounds;
use osier_base::math;

/// Rows of the picture for which sizes are judged. Own: full HD, the resolution of most clips.
pub const PICTURE_ROWS: f32 = 1080.0;

/// Lengths that a pixel of a picture of [`PICTURE_ROWS`] rows covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFootprint {
    eye: Vec3,
    /// Length that a pixel covers at 1 m from the camera, m.
    at_one_metre: f32,
}

impl PixelFootprint {
    /// Footprint for a camera's vertical angle of view; pixels are square.
    pub fn new(camera: &Camera) -> Self {
        let half = camera.vfov * 0.5;
        Self { eye: camera.eye, at_one_metre: 2.0 * math::sin_f32(half) / math::cos_f32(half) / PICTURE_ROWS }
    }

    /// Length that a pixel covers at the point of a box nearest to the camera, m; 0 where the camera is inside.
    pub fn at_box(&self, world: &Bounds) -> f32 {
        let outside = self.eye - self.eye.clamp(world.min, world.max);
        outside.length() * self.at_one_metre
    }

    /// For each asset of a scene the length, in its own space, that a pixel covers at the nearest of its placements, m; 0 for an
    /// asset that is not placed, or that has no extent.
    pub fn of_assets(scene: &Scene) -> Vec<f32> {
        let scale = Self::new(&scene.camera);
        let rest = AssetFrame::default();
        let boxes: Vec<Bounds> = scene.assets.iter().map(|a| asset_bounds(a, &rest)).collect();
        let mut least = vec![f32::INFINITY; scene.assets.len()];
        // The nearest copy needs the finest detail; a scaled copy is judged in the unscaled space of its asset.
        for placement in &scene.placements {
            let Some((local, least)) = boxes.get(placement.asset).zip(least.get_mut(placement.asset)) else { continue };
            let size = placement.transform.s.abs().max_element();
            if local.is_empty() || size <= 0.0 {
                *least = 0.0;
                continue;
            }
            let world = Bounds::of(local.corners().map(|c| placement.transform.apply(c)));
            *least = least.min(scale.at_box(&world) / size);
        }
        least.into_iter().map(|l| if l.is_finite() { l } else { 0.0 }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_covers_more_with_distance_and_nothing_around_the_camera() {
        let camera = Camera { eye: Vec3::Z * 10.0, target: Vec3::ZERO, vfov: std::f32::consts::FRAC_PI_2, roll: 0.0 };
        let scale = PixelFootprint::new(&camera);
        let at = |z: f32| scale.at_box(&Bounds { min: Vec3::new(-1.0, -1.0, z - 1.0), max: Vec3::new(1.0, 1.0, z) });
        // A field of 90 degrees is as high as twice the distance.
        assert!((at(0.0) - 20.0 / PICTURE_ROWS).abs() < 1e-6, "{}", at(0.0));
        assert!((at(-10.0) / at(0.0) - 2.0).abs() < 1e-5);
        assert!(at(10.5) <= 0.0, "the camera is inside the box");
    }
}
