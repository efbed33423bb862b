//! Estimates the numbers of drops that a bake of rain writes. An estimate simulates only one frame without spin-up, and needs the
//! numbers to predict file sizes.

use glam::Vec3;

use super::scene_leaf::SceneLeaf;
use crate::bake::scene::camera_light::ScreenScale;
use crate::recipe::Recipe;
use crate::recipe::scene::RainSize;
use osier_base::convert::to_usize;
use osier_base::math;
use osier_base::physics::GRAVITY;
use osier_motion::rain::{DropDetail, RainEmitter};
use osier_scene::{Asset, Mesh, MeshMotion, MeshObject};

/// Constants of the estimate, measured on the sapling of the tutorial in 5 to 60 mm/h and on a storm over an oak.
mod tuning {
    /// Effective speed of falling drops on Earth, m/s: fall height divided by the mean time in the air. It exceeds the mean speed
    /// of drops, because leaves intercept drops early. With smaller values more drops are expected in the air.
    pub(super) const FALL_SPEED: f64 = 5.5;
    /// Height of the emitter above the plants, m.
    pub(super) const EMITTER_HEIGHT: f64 = 1.0;
    /// Share of the leaf area that rain meets: leaves are tilted, and upper ones shelter lower ones.
    pub(super) const EXPOSED_SHARE: f64 = 0.3;
    /// Longest time that a drop stays on its leaf before it runs off or joins another, s.
    pub(super) const MAX_RESIDENCE_TIME: f64 = 4.0;
    /// Radius of a typical drop on a leaf in natural rain, m.
    pub(super) const DROP_RADIUS: f64 = 1e-3;
    /// Radius of a typical drop on a leaf divided by the diameter of falling drops, in rain of drops of one size: a half sphere
    /// of the same volume.
    pub(super) const RADIUS_PER_DIAMETER: f64 = 0.63;
}

/// Expected contents of a frame, averaged over the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ExpectedDrops {
    /// Drops between the emitter and the ground, or a leaf.
    airborne: usize,
    /// Vertices of the meshes of drops on leaves.
    vertices: usize,
    /// Triangles of these meshes.
    triangles: usize,
    /// World position of a leaf, m.
    leaf_position: Vec3,
}

impl ExpectedDrops {
    /// Estimates the numbers from the flux of the emitter, the height of the plants and the area of their leaves. `height`:
    /// height of the plants' bounds, m.
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
        // The number of drops on leaves grows until as many run off as arrive; take its mean over the clip.
        let clip = recipe.clip.len() as f64 / recipe.clip.fps();
        let keys = recipe.rain.as_ref().map(|rain| &rain.keys);
        let spin_up = keys.map_or(0.0, |k| k.spin_up);
        let time = (spin_up + clip * 0.5).min(tuning::MAX_RESIDENCE_TIME);
        let lying = emitter.drop_flux() * emitter.mean_factor() * area * tuning::EXPOSED_SHARE * time;
        let meshed = lying.min(keys.map_or(0.0, |k| f64::from(k.max_drop_meshes)));
        let n = leaves.len().max(1) as f64;
        let distance = leaves.iter().map(|f| picture.distance(f.position)).sum::<f64>() / n;
        let radius = match keys {
            Some(keys) if keys.size != RainSize::Natural => tuning::RADIUS_PER_DIAMETER * keys.diameter,
            _ => tuning::DROP_RADIUS,
        };
        let size = DropDetail::at_distance(radius, distance).typical_size(radius);
        let leaf_position = leaves.first().map_or(Vec3::ZERO, |leaf| leaf.position.as_vec3());
        Self {
            airborne: to_count(airborne),
            vertices: to_count(meshed * size.vertices),
            triangles: to_count(meshed * size.triangles),
            leaf_position,
        }
    }

    /// Extends the asset of drops of an estimate to these numbers of points and vertices, all at one position, because only their
    /// number matters.
    pub(super) fn fill(self, asset: &mut Asset) {
        for cloud in &mut asset.points {
            cloud.positions.resize(self.airborne.max(cloud.positions.len()), Vec3::ZERO);
            cloud.widths.resize(cloud.positions.len(), 0.0);
        }
        // The simulated frame may have no drop on a leaf; a still scene then has no mesh.
        if asset.meshes.is_empty() && self.vertices > 0 {
            let (name, mesh) = ("drops".into(), Mesh::default());
            asset.meshes.push(MeshObject { name, mesh, motion: MeshMotion::Still, skin: None });
        }
        for object in &mut asset.meshes {
            let mesh = &mut object.mesh;
            if mesh.points.len() < self.vertices {
                let points = vec![self.leaf_position; self.vertices];
                *mesh = Mesh { points, triangles: vec![[0; 3]; self.triangles], ..Mesh::default() };
            }
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating, never negative")]
fn to_count(x: f64) -> usize {
    to_usize(x as u32)
}
