//! Plants in the rain: on rods, which the simulation of the rain steps, on the elements of the sway model, or still.

use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};

use super::scene_leaf::{LeafInstanceIndex, SceneLeaf};
use crate::bake::motion::FrameTime;
use crate::bake::motion::rod_plant::RodBinding;
use crate::bake::motion::sway::{RainedSway, SwayMotion};
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_base::geometry::Bounds;
use osier_motion::rain::RainPlant;
use osier_motion::rods::RodPlant;
use osier_motion::sway_in_rain::{LeafPlace, SwayInRain, SwayingLeaf, SwayingRainPlant, WindPose, WindPoses};
use osier_scene::plant::Plant;
use osier_scene::{Asset, AssetFrame, InstanceState, Trs};
use osier_wind::Wind;

/// The model by which wind and drops move a plant.
pub(crate) enum PlantInRain {
    /// No model: the plant does not move, and impulses of drops have no effect on it.
    Still,
    /// Rods, which wind and drops bend.
    Rods {
        /// The rods at rest, in world space.
        rods: Box<RodPlant>,
        /// Binding of the plant's meshes and leaves to the rods.
        binding: RodBinding,
    },
    /// The recorded sway in the wind, to whose bends drops add.
    Sway(Arc<SwayMotion>),
}

impl PlantInRain {
    /// Rods and their binding; `None` for a plant that does not move on rods.
    pub(crate) fn rods(&self) -> Option<(&RodPlant, &RodBinding)> {
        match self {
            Self::Rods { rods, binding } => Some((rods, binding)),
            _ => None,
        }
    }

    /// The motion of points of the plant over the clip.
    pub(super) fn point_carrier(&self) -> PointCarrier {
        match self {
            Self::Still => PointCarrier::Still,
            Self::Rods { rods, binding } => PointCarrier::Rods { rods: rods.clone(), binding: binding.clone() },
            Self::Sway(motion) => PointCarrier::Sway(Arc::clone(motion)),
        }
    }

    /// Whether the sway model moves the plant; false for a plant on rods and for a still one.
    pub(crate) fn moves_by_sway_model(&self) -> bool {
        matches!(self, Self::Sway(_))
    }
}

/// Motion of points of a plant in the rain, such as the ends of twigs.
#[derive(Debug)]
pub(super) enum PointCarrier {
    /// The plant does not move.
    Still,
    /// The joints of the recorded rods.
    Rods {
        /// The rods at rest, in world space.
        rods: Box<RodPlant>,
        /// Binding of the rods' sections to joints.
        binding: RodBinding,
    },
    /// The sway in the wind; the bends that drops add are neglected, because they are small compared with it.
    Sway(Arc<SwayMotion>),
}

/// A plant of the scene with its asset and the leaves that drops can strike.
pub(super) struct RainedPlant<'a> {
    pub(super) plant: &'a Plant,
    pub(super) asset: &'a Asset,
    /// World from plant space, of the first copy.
    pub(super) transform: Trs,
    /// Leaves of this plant that drops can strike, in their order on the plant.
    pub(super) leaves: Vec<&'a SceneLeaf>,
}

/// Frame rate, time step, lead times and gravity that the models of all plants in the rain share.
#[derive(Clone, Copy)]
pub(super) struct PlantStepParams {
    /// Frames per second of the clip, above 0.
    pub(super) fps: f64,
    /// Duration of the rain before the clip, s.
    pub(super) lead: f64,
    /// Time step of rain and rods, s.
    pub(super) step: f64,
    /// Number of steps that plants on rods spin up in the wind before the rain begins; 0 in an estimate.
    pub(super) rod_spin_up_steps: u32,
    /// Whether plants on rods begin at rest. The spin-up steps then only repeat the first steps of the rain, to measure how far
    /// the wind bends the plants.
    pub(super) rods_start_at_rest: bool,
    /// Gravitational acceleration, m/s^2.
    pub(super) gravity: f64,
}

/// Converts the simulated state of one plant to frames of its asset.
pub(super) enum RainedPlantRecorder {
    Still,
    Rods {
        binding: RodBinding,
        /// Motion of leaves and wood in the wind of the spin-up.
        motion: SweptBounds,
    },
    Sway(SwayRecorder),
}

/// Bounds of points of a plant that the wind moves, world space, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweptBounds {
    /// Bounds at rest.
    rest: Bounds,
    /// Bounds over the motion.
    swept: Bounds,
}

impl SweptBounds {
    /// Bounds of the whole plant at rest, extended by the distance that the points move beyond their own bounds.
    fn extend(&self, at_rest: Bounds) -> Bounds {
        let Self { rest, swept } = self;
        if rest.is_empty() || swept.is_empty() {
            return at_rest;
        }
        // Blades extend beyond their pivots as far in the wind as at rest: extend the bounds at rest by the motion of the pivots.
        Bounds {
            min: at_rest.min - (rest.min - swept.min).max(Vec3::ZERO),
            max: at_rest.max + (swept.max - rest.max).max(Vec3::ZERO),
        }
    }
}

/// Recorder of a swaying plant, whose leaves wind and drops have moved.
pub(super) struct SwayRecorder {
    wind: RecordedWindPoses,
    /// Bounds of leaf pivots and nodes at rest, world space, m.
    rest_bounds: Bounds,
}

impl RainedPlantRecorder {
    /// World bounds of the plant in the wind, m: those at rest, extended by the distance that leaf pivots and wood move beyond
    /// their own bounds, during the clip with the sway model, during the spin-up on rods.
    pub(super) fn bounds_in_wind(&self, at_rest: Bounds) -> Bounds {
        let recorder = match self {
            Self::Still => return at_rest,
            Self::Rods { motion, .. } => return motion.extend(at_rest),
            Self::Sway(recorder) => recorder,
        };
        let frames = recorder.wind.motion.frame_count();
        let swept =
            (0..frames).step_by(frames.div_ceil(SAMPLED_FRAMES).max(1)).fold(Bounds::default(), |swept, frame| {
                let WindPose { leaves, nodes } = recorder.wind.at_frame(frame.cast_signed() as i64);
                swept.union(Bounds::of(leaves.iter().map(|leaf| leaf.position).chain(nodes).map(|p| p.as_vec3())))
            });
        SweptBounds { rest: recorder.rest_bounds, swept }.extend(at_rest)
    }

    /// Frame of the plant's asset in the present state of the simulation; `None` for a plant that does not move.
    pub(super) fn frame(&self, asset: &Asset, plant: &dyn RainPlant, time: FrameTime) -> Option<AssetFrame> {
        match self {
            Self::Still => None,
            Self::Rods { binding, .. } => plant.posed_rods().map(|rods| binding.pose_asset(asset, rods, plant)),
            Self::Sway(recorder) => plant.drop_bends().map(|bends| recorder.frame(asset, plant, bends, time)),
        }
    }
}

/// Number of frames of the wind sampled to bound a plant's sway. Own: a gust lasts longer than a sixteenth of a clip.
const SAMPLED_FRAMES: usize = 16;

/// Steps of the spin-up of rods between two measurements of their bounds. Own: a step is 1/192 s or less, and a branch takes more
/// than eight steps to cross its path.
const STEPS_PER_BOUNDS: u32 = 8;

/// Bounds of the leaf pivots and wood of a plant, world space, m.
fn leaf_and_wood_bounds(plant: &RodPlant) -> Bounds {
    let mut wood = Vec::new();
    plant.wood_segments(&mut wood);
    let pivots = (0..plant.leaf_count()).map(|leaf| plant.leaf_pose(leaf).position);
    Bounds::of(pivots.chain(wood.iter().flat_map(|segment| segment.ends)).map(|p| p.as_vec3()))
}

/// The collision target of a plant for drops, and the recorder of its frames. `still` makes the target of a plant that does not
/// move.
/// # Errors
/// `Simulation` for rods that diverge as they spin up.
pub(super) fn target_and_recorder(
    motion: PlantInRain,
    of: &RainedPlant<'_>,
    clock: PlantStepParams,
    wind: Option<Arc<dyn Wind>>,
    still: impl FnOnce() -> Box<dyn RainPlant>,
) -> Result<(Box<dyn RainPlant>, RainedPlantRecorder)> {
    let target_and_recorder: (Box<dyn RainPlant>, RainedPlantRecorder) = match motion {
        PlantInRain::Still => (still(), RainedPlantRecorder::Still),
        PlantInRain::Rods { rods, binding } => {
            // Without wind the rods stay in their initial equilibrium.
            let steps = if wind.is_some() { clock.rod_spin_up_steps } else { 0 };
            let rods = rods.with_clip_start(clock.lead);
            let mut rods = if wind.is_some() { rods.with_wind(wind) } else { rods };
            let at_rest = clock.rods_start_at_rest.then(|| rods.clone());
            let rest = leaf_and_wood_bounds(&rods);
            let mut motion = SweptBounds { rest, swept: rest };
            for left in (1..=steps).rev() {
                let number = if clock.rods_start_at_rest { f64::from(steps - left) } else { -f64::from(left) };
                rods.step(number * clock.step, clock.step)?;
                if (left - 1).is_multiple_of(STEPS_PER_BOUNDS) {
                    motion.swept = motion.swept.union(leaf_and_wood_bounds(&rods));
                }
            }
            (Box::new(at_rest.unwrap_or(rods)), RainedPlantRecorder::Rods { binding, motion })
        }
        PlantInRain::Sway(motion) => {
            let pivot = |of_leaf: &&SceneLeaf| of_leaf.position.as_vec3();
            let nodes = of.plant.nodes.p.iter().map(|p| of.transform.apply(*p));
            let recorder = SwayRecorder {
                wind: RecordedWindPoses {
                    motion,
                    leafage: Arc::new(Asset { meshes: Vec::new(), ..of.asset.clone() }),
                    transform: of.transform,
                    instances: of.leaves.iter().map(|leaf| leaf.instance).collect(),
                    step: clock.fps.recip(),
                },
                rest_bounds: Bounds::of(of.leaves.iter().map(pivot).chain(nodes)),
            };
            (Box::new(recorder.rain_plant(of, clock)), RainedPlantRecorder::Sway(recorder))
        }
    };
    Ok(target_and_recorder)
}

impl SwayRecorder {
    /// The collision target of a swaying plant before the first drop: leaves with axis, arc length and blade.
    fn rain_plant(&self, of: &RainedPlant<'_>, clock: PlantStepParams) -> SwayingRainPlant {
        // Instances have the ids of the organs that they show; find the organs by id.
        let organs: std::collections::BTreeMap<u64, usize> =
            of.plant.organs.iter().enumerate().map(|(i, organ)| (organ.id, i)).collect();
        let swaying = |leaf: &&SceneLeaf| {
            let LeafInstanceIndex { instancer, instance, .. } = leaf.instance;
            let instancer = &of.asset.instancers[instancer];
            let organ = organs.get(&instancer.ids[instance]).map(|i| &of.plant.organs[*i]);
            SwayingLeaf {
                axis: organ.map_or(0, |organ| organ.axis),
                s: organ.map_or(0.0, |organ| organ.s),
                rest: instancer.rest.positions[instance].as_dvec3(),
                scale: f64::from(instancer.scales[instance].x),
                blade: &instancer.prototypes[to_usize(instancer.protos[instance])].mesh,
            }
        };
        let leaves: Vec<SwayingLeaf<'_>> = of.leaves.iter().map(swaying).collect();
        SwayingRainPlant::new(SwayInRain {
            plant: of.plant,
            elements: self.wind.motion.elements(),
            params: self.wind.motion.params(),
            leaves: &leaves,
            poses: Box::new(self.wind.clone()),
            lead: clock.lead,
            gravity: clock.gravity,
        })
    }

    /// Frame of the asset with the leaf poses of the simulation; leaves without a surface for drops keep their poses in the wind.
    fn frame(&self, asset: &Asset, plant: &dyn RainPlant, drop_bends: Vec<[f32; 2]>, time: FrameTime) -> AssetFrame {
        let RecordedWindPoses { motion, leafage, transform, instances: of_leaves, .. } = &self.wind;
        let mut instances = motion.pose_in_wind(leafage, time).instances;
        let back = transform.r.as_dquat().normalize().conjugate();
        let scale = f64::from(transform.s.x);
        for state in &mut instances {
            // Leaves without a blade for drops have no pose in the simulation: their velocities stay 0.
            let count = state.positions.len();
            (state.velocities, state.angular_velocities) = (vec![Vec3::ZERO; count], vec![Vec3::ZERO; count]);
        }
        // Poses of the simulation are in world space, instances in plant space.
        for (k, of) in of_leaves.iter().enumerate() {
            let InstanceState { positions, orientations, velocities, angular_velocities, .. } =
                &mut instances[of.instancer];
            let (pose, i) = (plant.leaf_pose(k), of.instance);
            positions[i] = (back * (pose.position - transform.t.as_dvec3()) / scale).as_vec3();
            orientations[i] = (back * pose.orientation).as_quat().normalize();
            velocities[i] = (back * pose.velocity / scale).as_vec3();
            angular_velocities[i] = (back * pose.angular_velocity).as_vec3();
        }
        motion.frame_in_rain(asset, time, RainedSway { drop_bends, instances })
    }
}

/// Poses of a plant's leaves and nodes in the wind, from its recorded sway.
#[derive(Debug, Clone)]
struct RecordedWindPoses {
    motion: Arc<SwayMotion>,
    /// The plant's instancers and skeleton, without meshes.
    leafage: Arc<Asset>,
    /// World from plant space.
    transform: Trs,
    /// Instance of each leaf that drops can strike, in the order of the simulation's leaves.
    instances: Vec<LeafInstanceIndex>,
    /// Time between two frames, s.
    step: f64,
}

impl WindPoses for RecordedWindPoses {
    fn at_frame(&self, frame: i64) -> WindPose {
        let frame = if self.motion.repeats() { frame } else { played_back_before(frame, self.motion.frame_count()) };
        let time = FrameTime { seconds: frame as f64 * self.step, step: self.step };
        let pose = self.motion.pose_in_wind(&self.leafage, time);
        let turn = self.transform.r.as_dquat().normalize();
        let place = |of: &LeafInstanceIndex| {
            let state = &pose.instances[of.instancer];
            let orientation: DQuat = state.orientations[of.instance].as_dquat();
            LeafPlace {
                position: self.transform.apply(state.positions[of.instance]).as_dvec3(),
                orientation: (turn * orientation).normalize(),
            }
        };
        let node = |p: &Vec3| -> DVec3 { self.transform.apply(*p).as_dvec3() };
        WindPose { leaves: self.instances.iter().map(place).collect(), nodes: pose.nodes.iter().map(node).collect() }
    }
}

/// For a clip of `count` frames that does not repeat, the frame that is shown at `frame`, which may be negative: the spin-up
/// plays the clip backwards, and alternately backwards and forwards if it is longer than the clip, so that the plant is in motion
/// when the clip begins.
fn played_back_before(frame: i64, count: usize) -> i64 {
    let last = count as i64 - 1;
    match frame {
        0.. => frame,
        _ if last < 1 => 0,
        _ => last - (frame.rem_euclid(last.saturating_mul(2)) - last).abs(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spin_up_plays_a_clip_backwards_and_to_and_fro() {
        let before = |count: usize| (-9..3).map(|frame| played_back_before(frame, count)).collect::<Vec<_>>();
        assert_eq!(before(4), [3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!(before(20), [9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 1, 2]);
        assert_eq!(before(1), [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2]);
    }
}
