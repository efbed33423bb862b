//! Plants as rain meets them: leaves and wood that drops strike, load and move.

use glam::{DQuat, DVec3};

use crate::rods::RodSystem;
use osier_base::Result;

/// Pose and motion of a leaf, whose blade is rigid, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafPose {
    /// Origin of leaf space (the end of the stalk), m.
    pub position: DVec3,
    /// Rotation from leaf space to the world.
    pub orientation: DQuat,
    /// Velocity of the origin in the world, m/s.
    pub velocity: DVec3,
    /// Angular velocity about the axes of the world, rad/s.
    pub angular_velocity: DVec3,
    /// Acceleration of the origin, averaged over the last step, m/s^2.
    pub acceleration: DVec3,
    /// Angular acceleration, averaged over the last step, rad/s^2.
    pub angular_acceleration: DVec3,
}

impl LeafPose {
    /// The pose of a leaf without velocities and accelerations.
    pub fn at_rest(position: DVec3, orientation: DQuat) -> Self {
        Self {
            position,
            orientation,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
            acceleration: DVec3::ZERO,
            angular_acceleration: DVec3::ZERO,
        }
    }

    /// World position, m, of a point of the unscaled leaf, m. `scale`: factor on the leaf's size.
    pub fn to_world(&self, local: DVec3, scale: f64) -> DVec3 {
        self.position + self.orientation * (local * scale)
    }

    /// Velocity of the leaf's material point at a world position, m/s.
    pub fn velocity_at(&self, point: DVec3) -> DVec3 {
        self.velocity + self.angular_velocity.cross(point - self.position)
    }

    /// Acceleration of the leaf's material point at a world position, m/s^2.
    pub fn acceleration_at(&self, point: DVec3) -> DVec3 {
        let arm = point - self.position;
        // Rigid body: linear + Euler (tangential) + centripetal acceleration.
        self.acceleration
            + self.angular_acceleration.cross(arm)
            + self.angular_velocity.cross(self.angular_velocity.cross(arm))
    }
}

/// A straight piece of a branch: a tapered capsule between two points of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WoodSegment {
    /// End points in the world, m.
    pub ends: [DVec3; 2],
    /// Radii at the end points, m; linear between them.
    pub radii: [f64; 2],
}

/// A plant that rain falls on: it takes impulses, forces and attached water, and moves. All in world space and SI units.
pub trait RainPlant: Send + std::fmt::Debug {
    /// Number of leaves; their order never changes.
    fn leaf_count(&self) -> usize;

    /// Pose and motion of a leaf in the world at the present time.
    fn leaf_pose(&self, leaf: usize) -> LeafPose;

    /// Inverse effective mass of a leaf at `point` along the unit vector `direction`, 1/kg: the change of that point's velocity
    /// along `direction` for an impulse of 1 N s, b^T M^-1 b. 0 for a leaf that does not move.
    fn inverse_effective_mass(&self, leaf: usize, point: DVec3, direction: DVec3) -> f64;

    /// Applies an impulse, N s, at a point of a leaf; it acts during the next step.
    fn apply_impulse(&mut self, leaf: usize, point: DVec3, impulse: DVec3);

    /// Applies a force, N, at a point of a leaf, constant over the next step.
    fn apply_force(&mut self, leaf: usize, point: DVec3, force: DVec3);

    /// Attaches water of `mass`, kg, with its center of mass at the world position `center`, to a leaf. The water has weight and
    /// inertia and follows the leaf until the next call; [`RainPlant::apply_force`] is for forces beyond its weight.
    fn set_attached_mass(&mut self, leaf: usize, mass: f64, center: DVec3);

    /// Replaces the content of `out` by the current wood segments; their number and order never change. By default there are none.
    fn wood_segments(&self, out: &mut Vec<WoodSegment>) {
        out.clear();
    }

    /// Inverse effective mass of a wood segment at `fraction` (0 to 1) of its length along a unit vector, 1/kg. By default wood does not
    /// move.
    fn wood_inverse_effective_mass(&self, _segment: usize, _fraction: f64, _direction: DVec3) -> f64 {
        0.0
    }

    /// Applies an impulse, N s, to a wood segment at `fraction` of its length; it acts during the next step. By
    /// default nothing happens.
    fn apply_wood_impulse(&mut self, _segment: usize, _fraction: f64, _impulse: DVec3) {}

    /// Velocity of a wood segment at `fraction` (0 to 1) of its length, m/s; by default 0.
    fn wood_velocity(&self, _segment: usize, _fraction: f64) -> DVec3 {
        DVec3::ZERO
    }

    /// Advances the plant from time `t` by `h`, s.
    /// # Errors
    /// `Simulation` if the plant's integration diverges.
    fn step(&mut self, t: f64, h: f64) -> Result<()>;

    /// Angles that drops add to each recorded bend of a plant of the sway model, rad; `None` for other plants.
    fn drop_bends(&self) -> Option<Vec<[f32; 2]>> {
        None
    }

    /// The rods that pose the plant's skeleton, for animating its mesh; `None` for other models and for a plant
    /// that does not move.
    fn posed_rods(&self) -> Option<&RodSystem> {
        None
    }
}

/// A plant whose leaves and wood stay where they are under all loads.
#[derive(Debug, Clone)]
pub struct StillRainPlant {
    poses: Vec<LeafPose>,
    wood: Vec<WoodSegment>,
}

impl StillRainPlant {
    /// Leaves at positions, m, and orientations in the world, and the wood that carries them.
    pub fn new(leaves: &[(DVec3, DQuat)], wood: Vec<WoodSegment>) -> Self {
        Self { poses: leaves.iter().map(|(p, q)| LeafPose::at_rest(*p, *q)).collect(), wood }
    }
}

impl RainPlant for StillRainPlant {
    fn leaf_count(&self) -> usize {
        self.poses.len()
    }

    fn leaf_pose(&self, leaf: usize) -> LeafPose {
        self.poses[leaf]
    }

    fn inverse_effective_mass(&self, _: usize, _: DVec3, _: DVec3) -> f64 {
        0.0
    }

    fn apply_impulse(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn apply_force(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn set_attached_mass(&mut self, _: usize, _: f64, _: DVec3) {}

    fn wood_segments(&self, out: &mut Vec<WoodSegment>) {
        out.clear();
        out.extend_from_slice(&self.wood);
    }

    fn step(&mut self, _: f64, _: f64) -> Result<()> {
        Ok(())
    }
}
