//! Estimates the numbers of drops that a bake of rain writes. An estimate simulates one frame without spin-up and needs them
//! for sizes.

use glam::Vec3;

use super::scene_leaf::SceneLeaf;
use crate::bake::scene::camera_light::ScreenScale;
use crate::recipe::Recipe;
use osier_base::convert::to_usize;
use osier_base::math;
use osier_base::physics::GRAVITY;
use osier_motion::rain::{DropDetail, RainEmitter};
use osier_scene::{Asset, Mesh};

/// Constants of the estimate, measured on the tutorial's sapling in 5 to 60 mm/h and on a storm over an oak.
mod tuning {
    /// Effective speed of falling drops on Earth, m/s: fall height divided by the mean time in the air. It lies above the mean speed of
    /// drops, because leaves intercept drops early. Smaller values expect more drops in the air.
    pub(super) const FALL_SPEED: f64 = 5.5;
    /// Height of the emitter above the plants, m.
    pub(super) const EMITTER_HEIGHT: f64 = 1.0;
    /// Share of the leaf area that rain meets: leaves are tilted, and upper ones shelter lower ones.
    pub(super) const EXPOSED_SHARE: f64 = 0.3;
    /// Longest time that a drop stays on its leaf before it runs off or joins another, s.
    pub(super) const MAX_RESIDENCE_TIME: f64 = 4.0;
    /// Radius of a typical drop on a leaf, m.
    pub(super) const DROP_RADIUS: f64 = 1e-3;
}

/// Expected contents of a frame, averaged over the clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ExpectedDrops {
    /// Drops between the emitter and the ground, or a leaf.
    airborne: usize,
    /// Vertices of the meshes of drops on leaves.
    vertices: usize,
}

impl ExpectedDrops {
    /// Expects drops from the flux of the emitter, the height of the plants and the area of their leaves.
    /// `height`: of the plants' bounds, m.
    pub(super) fn new(
        emitter: &RainEmitter,
        height: f64,
        leaves: &[SceneLeaf],
        recipe: &Recipe,
        picture: &ScreenScale,
    ) -> Self {
        // Terminal speeds grow with the square root of gravity.
        let speed = tuning::FALL_SPEED * math::sqrt(recipe.gravity() / GRAVITY);
        let fall_time = (height + tuning::EMITTER_HEIGHT) / speed;
        let airborne = emitter.mean_drop_rate() * fall_time;
        let area: f64 = leaves.iter().map(|f| f.surface.area() * f.scale * f.scale).sum();
        // The mean over the clip of a number that grows until drops run off as fast as new ones come.
        let clip = recipe.clip.len() as f64 / recipe.clip.fps();
        let keys = recipe.rain.as_ref().map(|rain| &rain.keys);
        let spin_up = keys.map_or(0.0, |k| k.spin_up);
        let time = (spin_up + clip * 0.5).min(tuning::MAX_RESIDENCE_TIME);
        let lying = emitter.drop_flux() * emitter.mean_factor() * area * tuning::EXPOSED_SHARE * time;
        let meshed = lying.min(keys.map_or(0.0, |k| f64::from(k.max_drop_meshes)));
        let n = leaves.len().max(1) as f64;
        let distance = leaves.iter().map(|f| picture.distance(f.position)).sum::<f64>() / n;
        let of_one = DropDetail::at_distance(tuning::DROP_RADIUS, distance).typical_vertices();
        Self { airborne: count(airborne), vertices: count(meshed * f64::from(of_one)) }
    }

    /// Extends the asset of drops of an estimate to as many points and vertices, all at the origin: only their number counts.
    pub(super) fn fill(self, asset: &mut Asset) {
        for cloud in &mut asset.points {
            cloud.positions.resize(self.airborne.max(cloud.positions.len()), Vec3::ZERO);
            cloud.widths.resize(cloud.positions.len(), 0.0);
        }
        for object in &mut asset.meshes {
            let mesh = &mut object.mesh;
            if mesh.points.len() < self.vertices {
                *mesh = Mesh { points: vec![Vec3::ZERO; self.vertices], ..Mesh::default() };
            }
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating, never negative")]
fn count(x: f64) -> usize {
    to_usize(x as u32)
}
