//! Plants of the sway model in the rain: the wind moves them as recorded, drops shake their branches and leaves.
//!
//! ```text
//! WindPoses       leaves and nodes at each frame, in the wind alone ┐
//! BranchResponse  bends that drops and water add to the elements    ├─ SwayingRainPlant ─► LeafPose, WoodSegment
//! PetioleNod      nodding of each leaf that is struck or wet        ┘
//! ```
//!
//! The motions add up: those that drops cause are small, and the wind's are taken from its record. Elements and leaves that nothing has
//! struck cost one comparison each per step.

mod branch_response;
mod petiole_nod;
mod tuning;
mod wind_poses;

use glam::{DQuat, DVec3};

use self::branch_response::{BendLever, BranchResponse, RigidMotion, bend_lever};
use self::petiole_nod::PetioleNod;
pub use self::wind_poses::{LeafPlace, WindPose, WindPoses};
use self::wind_poses::{MovingPlace, WindMotion};
use crate::rain::{LeafPose, RainPlant, WoodSegment};
use crate::rods::RigidBlade;
use crate::sway::{BeamElements, SwayParams, damping_ratio};
use osier_base::Result;
use osier_base::par::par_map;
use osier_scene::plant::{AxisKind, Plant};
use osier_scene::{Mesh, Trs};

/// A leaf of a plant that sways in the rain, in the rest pose of the plant.
#[derive(Debug, Clone, Copy)]
pub struct SwayingLeaf<'a> {
    /// Index of the axis that carries it, into the plant's axes.
    pub axis: u32,
    /// Arc length of its foot on that axis, m.
    pub s: f32,
    /// Pivot at rest, m, in plant space.
    pub rest: DVec3,
    /// Factor on the size of the blade.
    pub scale: f64,
    /// Mesh of the leaf at scale 1, from which the mass and inertia of its blade are computed.
    pub blade: &'a Mesh,
}

/// Inputs of a [`SwayingRainPlant`]: a plant, its bending elements and leaves, and its motion in the wind.
pub struct SwayInRain<'a> {
    /// The plant, whose axes give the wood that drops strike.
    pub plant: &'a Plant,
    /// Bending elements of the plant, the same as in the simulation of its sway.
    pub elements: &'a BeamElements,
    /// Parameters of its sway; placement, wood and frame rate are used.
    pub params: SwayParams,
    /// Leaves in the order of [`WindPose::leaves`].
    pub leaves: &'a [SwayingLeaf<'a>],
    /// Poses of the plant in the wind, to which the motion by drops is added.
    pub poses: Box<dyn WindPoses>,
    /// Time before the clip for which it rains, s.
    pub lead: f64,
    /// Gravitational acceleration along -Y, m/s^2, which acts on the water on leaves.
    pub gravity: f64,
}

#[derive(Debug)]
struct RainedLeaf {
    /// Where it is attached to the elements; `None` on wood that does not bend.
    lever: Option<BendLever>,
    /// Pivot at rest, m, in plant space.
    rest: DVec3,
    nod: PetioleNod,
    /// Mass of the water on it, kg, and its center in leaf space, m.
    water: f64,
    water_center: DVec3,
}

/// A piece of wood between two successive nodes of an axis.
#[derive(Debug, Clone, Copy)]
struct WoodPiece {
    nodes: [usize; 2],
    /// Radii at the nodes in the world, m.
    radii: [f64; 2],
    /// Attachment of its middle to the elements; `None` on wood that does not bend.
    lever: Option<BendLever>,
}

/// A plant that sways in the wind and that raindrops strike, load and shake. Positions are in the world, SI units.
#[derive(Debug)]
pub struct SwayingRainPlant {
    motion: WindMotion,
    branches: BranchResponse,
    leaves: Vec<RainedLeaf>,
    wood: Vec<WoodPiece>,
    poses: Vec<LeafPose>,
    /// World from plant space.
    stand: Trs,
    lead: f64,
    gravity: f64,
}

impl SwayingRainPlant {
    /// The plant before the first drop, at the time `lead` before the clip.
    pub fn new(inputs: SwayInRain<'_>) -> Self {
        let SwayInRain { plant, elements, params, leaves, poses, lead, gravity } = inputs;
        let stand = params.stand;
        let (petiole_damping, leaf_mass) =
            (params.wood.damping * damping_ratio(0, true), params.wood.moving_leaf_mass());
        // Leaves of one shape share a mesh: compute its integrals once.
        let mut blades: Vec<(*const Mesh, RigidBlade)> = Vec::new();
        let mut blade_of = |mesh: &Mesh| {
            let key = std::ptr::from_ref(mesh);
            let known = blades.iter().find(|(k, _)| *k == key).map(|(_, blade)| *blade);
            known.unwrap_or_else(|| {
                let blade = RigidBlade::from_mesh(mesh);
                blades.push((key, blade));
                blade
            })
        };
        let scale = f64::from(stand.s.x);
        let leaves: Vec<RainedLeaf> = leaves
            .iter()
            .map(|leaf| RainedLeaf {
                lever: bend_lever(elements, elements.locate(leaf.axis, leaf.s)),
                rest: leaf.rest,
                nod: PetioleNod::new(&blade_of(leaf.blade), leaf_mass, leaf.scale * scale, petiole_damping),
                water: 0.0,
                water_center: DVec3::ZERO,
            })
            .collect();
        let mut wood = Vec::new();
        for (index, axis) in (0_u32..).zip(&plant.axes).filter(|(_, a)| a.kind != AxisKind::Root) {
            let range = plant.nodes_of(axis);
            for k in range.start..range.end.saturating_sub(1) {
                // A piece is short compared with the element that bends it: one lever serves both of its ends.
                let middle = 0.5 * (plant.nodes.s[k] + plant.nodes.s[k + 1]);
                wood.push(WoodPiece {
                    nodes: [k, k + 1],
                    radii: [k, k + 1].map(|k| f64::from(plant.nodes.r[k]) * scale),
                    lever: bend_lever(elements, elements.locate(index, middle)),
                });
            }
        }
        let branches = BranchResponse::new(elements, scale);
        let motion = WindMotion::new(poses, params.fps, -lead);
        let mut plant = Self { motion, branches, leaves, wood, poses: Vec::new(), stand, lead, gravity };
        plant.poses = plant.leaf_poses_after(None);
        plant
    }

    /// Rotation from plant space to the world.
    fn turn(&self) -> DQuat {
        self.stand.r.as_dquat().normalize()
    }

    fn scale(&self) -> f64 {
        f64::from(self.stand.s.x)
    }

    /// A point of the world in plant space, m.
    fn to_plant(&self, p: DVec3) -> DVec3 {
        self.turn().conjugate() * (p - self.stand.t.as_dvec3()) / self.scale()
    }

    /// Poses of all leaves at the present time. `h`: the step, s, over which accelerations are averaged; `None` before the first.
    fn leaf_poses_after(&self, h: Option<f64>) -> Vec<LeafPose> {
        let places = self.motion.leaves();
        let jobs: Vec<(usize, MovingPlace)> = places.into_iter().enumerate().collect();
        par_map(&jobs, |(i, place)| self.leaf_pose_in(*i, place, h))
    }

    /// Pose of leaf `i` from its place in the wind: displaced and rotated with its twig, then rotated about its petiole.
    fn leaf_pose_in(&self, i: usize, moving: &MovingPlace, h: Option<f64>) -> LeafPose {
        let leaf = &self.leaves[i];
        let (turn, scale) = (self.turn(), self.scale());
        let [moved, moving_twig] = leaf.lever.map_or([RigidMotion::default(); 2], |lever| self.branches.motion(&lever));
        // From the outside in: the wind's pose, the bend of the branches, the nod of the petiole.
        let twig = DQuat::from_scaled_axis(turn * moved.turn) * moving.place.orientation;
        let orientation = (twig * DQuat::from_scaled_axis(leaf.nod.angle)).normalize();
        let velocity = moving.velocity + turn * moving_twig.at(leaf.rest) * scale;
        let angular_velocity = moving.angular_velocity + turn * moving_twig.turn + twig * leaf.nod.rate;
        let before = self.poses.get(i).zip(h);
        let rate = |now: DVec3, was: fn(&LeafPose) -> DVec3| before.map_or(DVec3::ZERO, |(p, h)| (now - was(p)) / h);
        LeafPose {
            position: moving.place.position + turn * moved.at(leaf.rest) * scale,
            orientation,
            velocity,
            angular_velocity,
            acceleration: rate(velocity, |p| p.velocity),
            angular_acceleration: rate(angular_velocity, |p| p.angular_velocity),
        }
    }

    /// Applies a force, N, or an impulse, N s, at a point of a leaf to its petiole and its twig.
    fn load_leaf(&mut self, i: usize, point: DVec3, vector: DVec3, is_impulse: bool) {
        let (pose, back) = (self.poses[i], self.turn().conjugate());
        let local = pose.orientation.conjugate();
        let (p, in_plant) = (self.to_plant(point), back * vector);
        // The degrees of freedom of the petiole are in leaf space, those of the branches in plant space.
        let moment = (local * (point - pose.position)).cross(local * vector);
        let Self { leaves, branches, .. } = self;
        let leaf = &mut leaves[i];
        if is_impulse {
            leaf.nod.add_impulse(moment);
            leaf.lever.iter().for_each(|lever| branches.add_impulse(lever, p, in_plant));
        } else {
            leaf.nod.add_torque(moment);
            leaf.lever.iter().for_each(|lever| branches.add_force(lever, p, in_plant));
        }
    }

    /// Point of a wood piece at a fraction of its length, m, and its velocity in the wind, m/s.
    fn wood_point(&self, segment: usize, fraction: f64) -> [DVec3; 2] {
        let [a, b] = self.wood[segment].nodes.map(|k| self.motion.node(k));
        [0, 1].map(|i| a[i].lerp(b[i], fraction))
    }
}

impl RainPlant for SwayingRainPlant {
    fn leaf_count(&self) -> usize {
        self.leaves.len()
    }

    fn leaf_pose(&self, leaf: usize) -> LeafPose {
        self.poses[leaf]
    }

    fn inverse_effective_mass(&self, leaf: usize, point: DVec3, direction: DVec3) -> f64 {
        let (pose, own) = (&self.poses[leaf], &self.leaves[leaf]);
        let local = pose.orientation.conjugate();
        let nod = own.nod.inverse_effective_mass(local * (point - pose.position), local * direction);
        let (p, n) = (self.to_plant(point), self.turn().conjugate() * direction);
        // A velocity of plant space is multiplied by `scale` in the world.
        let twig = own.lever.map_or(0.0, |lever| self.branches.inverse_effective_mass(&lever, p, n) * self.scale());
        nod + twig
    }

    fn apply_impulse(&mut self, leaf: usize, point: DVec3, impulse: DVec3) {
        self.load_leaf(leaf, point, impulse, true);
    }

    fn apply_force(&mut self, leaf: usize, point: DVec3, force: DVec3) {
        self.load_leaf(leaf, point, force, false);
    }

    fn set_attached_mass(&mut self, leaf: usize, mass: f64, center: DVec3) {
        let own = &mut self.leaves[leaf];
        // Most leaves are dry before and after.
        if mass <= 0.0 && own.water <= 0.0 {
            return;
        }
        let pose = &self.poses[leaf];
        own.water = mass.max(0.0);
        own.water_center = pose.orientation.conjugate() * (center - pose.position);
        own.nod.set_water(own.water, own.water_center);
    }

    fn wood_segments(&self, out: &mut Vec<WoodSegment>) {
        out.clear();
        out.extend(
            self.wood
                .iter()
                .map(|piece| WoodSegment { ends: piece.nodes.map(|k| self.motion.node(k)[0]), radii: piece.radii }),
        );
    }

    fn wood_inverse_effective_mass(&self, segment: usize, fraction: f64, direction: DVec3) -> f64 {
        let p = self.to_plant(self.wood_point(segment, fraction)[0]);
        let n = self.turn().conjugate() * direction;
        let lever = self.wood[segment].lever;
        lever.map_or(0.0, |lever| self.branches.inverse_effective_mass(&lever, p, n) * self.scale())
    }

    fn apply_wood_impulse(&mut self, segment: usize, fraction: f64, impulse: DVec3) {
        let p = self.to_plant(self.wood_point(segment, fraction)[0]);
        let impulse = self.turn().conjugate() * impulse;
        if let Some(lever) = self.wood[segment].lever {
            self.branches.add_impulse(&lever, p, impulse);
        }
    }

    fn wood_velocity(&self, segment: usize, fraction: f64) -> DVec3 {
        let [point, velocity] = self.wood_point(segment, fraction);
        let shaken = self.wood[segment]
            .lever
            .map_or(DVec3::ZERO, |lever| self.branches.motion(&lever)[1].at(self.to_plant(point)));
        velocity + self.turn() * shaken * self.scale()
    }

    fn step(&mut self, t: f64, h: f64) -> Result<()> {
        // Weight of the water, at the points where the leaves held it after the last step.
        for i in 0..self.leaves.len() {
            let RainedLeaf { water, water_center, .. } = self.leaves[i];
            if water > 0.0 {
                let pose = &self.poses[i];
                let point = pose.position + pose.orientation * water_center;
                self.load_leaf(i, point, DVec3::NEG_Y * (water * self.gravity), false);
            }
        }
        self.branches.advance(h);
        self.leaves.iter_mut().for_each(|leaf| leaf.nod.advance(h));
        self.motion.advance_to(t + h - self.lead);
        self.poses = self.leaf_poses_after(Some(h));
        Ok(())
    }

    fn drop_bends(&self) -> Option<Vec<[f32; 2]>> {
        Some(self.branches.bends())
    }
}
