//! Plants that sway in the wind: joints, bark and fluttering leaves at any time of the clip.

use std::sync::Arc;

use glam::{Quat, Vec3};

use crate::bake::BakeContext;
use crate::bake::motion::{AssetMotion, CarriedPoints, FrameTime, PointOnAxis};
use crate::bake::wind::plant_wind::PlantWind;
use crate::recipe::scene::{BarkMotion, PlantKeys};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::math::narrow;
use osier_motion::sway::{
    BeamElements, BendTrack, BoundLocation, ClipOptions, ElementLocation, JointBudget, JointRig, LeafAir, LeafFlutter,
    OrganBindings, PaperSimulation, PointBinding, PosedSkeleton, SwayParams, check_key_limit,
};
use osier_scene::plant::{Organ, Plant};
use osier_scene::{Asset, AssetFrame, InstanceState, InstancerFrame, MeshFrame, MeshMotion, instance_states};
use osier_wind::Wind;

/// Largest number of joints with `motion = "game"`, for the skinning limits of game engines.
pub(super) const MAX_GAME_JOINTS: u32 = 64;

/// Recorded sway of one plant in the wind, evaluated at any time by interpolation.
#[derive(Debug, Clone)]
pub struct SwayMotion {
    /// Joints of the skeleton, and the elements that each of them follows.
    pub rig: JointRig,
    elements: BeamElements,
    track: BendTrack,
    /// Binding of nodes to elements and, if frames carry points, of the bark's points.
    body: PointBinding,
    /// Whether frames carry points (`motion = "cache"`).
    cached: bool,
    /// Leaves of each instancer, in the order of its instances.
    leaves: Vec<InstancerLeafMotion>,
    wind: Arc<dyn Wind>,
    params: SwayParams,
}

/// Flutter and attachment of the leaves of one instancer.
#[derive(Debug, Clone)]
struct InstancerLeafMotion {
    flutter: LeafFlutter,
    bindings: OrganBindings,
    /// Per leaf: the place on its twig.
    twigs: Vec<TwigLocation>,
}

/// A position on a twig, with the quantities that determine the flutter of its leaf.
#[derive(Debug, Clone, Copy)]
struct TwigLocation {
    location: BoundLocation,
    /// Share of the undisturbed wind there, 0 to 1.
    wind_exposure: f32,
}

impl TwigLocation {
    fn new(elements: &BeamElements, location: ElementLocation) -> Self {
        Self { location: elements.bind(location), wind_exposure: elements.wind_exposure(location) }
    }
}

/// The organs of one instancer, with the strength of their flutter.
pub struct FlutterGroup<'a> {
    /// Organs in the order of the instancer.
    pub organs: &'a [&'a Organ],
    /// Factor on the amplitude of the flutter; 0 for organs that do not flutter.
    pub flutter: f32,
}

impl<'a> FlutterGroup<'a> {
    /// The group of an organ of the recipe, with the key `flutter` of that organ. `organ`: index into the recipe's organs.
    pub fn from_recipe(recipe: &PlantRecipe, organ: usize, organs: &'a [&'a Organ]) -> Self {
        // Prototypes beyond the recipe's organs are the instanced branchlets of an IFS tree or the buds of a season, which are
        // rigid with their branch.
        let rigid = matches!(recipe.growth, Growth::Ifs(..)) || recipe.keys.season.is_some();
        let other = if rigid { 0.0 } else { 1.0 };
        let flutter = recipe.organs.get(organ).map_or(other, |o| narrow(o.keys.flutter));
        Self { organs, flutter }
    }
}

/// The bark's points and the leaves of a plant at rest, which the sway moves.
pub struct SwaySurface<'a> {
    /// Points of the bark, plant space, m.
    pub points: &'a [Vec3],
    /// Axis and arc length on it, m, of each point, parallel to `points`.
    pub bindings: &'a [(u32, f32)],
    /// Leaves of each instancer, in the order of the asset's instancers.
    pub leaves: &'a [FlutterGroup<'a>],
}

/// Leaves and nodes of a plant that sways in the wind without drops, in plant space.
pub struct PosedPlant {
    /// States of the instancers of the plant's asset, parallel to these.
    pub instances: Vec<InstanceState>,
    /// Positions of the plant's nodes, m.
    pub nodes: Vec<Vec3>,
}

/// Contribution of drops to a swaying plant in a frame.
pub struct RainedSway {
    /// Angles that drops add to the bends of each element, rad.
    pub drop_bends: Vec<[f32; 2]>,
    /// State of each instancer, drops and wind together.
    pub instances: Vec<InstanceState>,
}

/// The bends of all elements at and around one frame.
struct SwaySample {
    /// Half a frame before the frame, at it, and half a frame after it; at the ends of a clip that does not loop, the bends
    /// beyond the clip are those of its end.
    bends: [Vec<[f32; 2]>; 3],
    /// Rotation of each element's base half a frame before and after.
    base_rotations: [Vec<Quat>; 2],
    seconds: f64,
    /// Time from the first to the last of the bends, s.
    span: f32,
}

impl SwayMotion {
    /// Divides a plant into beam elements and records their bends in the wind over the clip.
    /// # Errors
    /// `Limit` for the number of motion keys, `Cancelled`.
    pub fn new(
        plant: &Plant,
        keys: &PlantKeys,
        wind: &PlantWind,
        params: SwayParams,
        surface: &SwaySurface<'_>,
        context: &BakeContext<'_>,
    ) -> Result<Self> {
        let (limits, cancel) = (context.limits, context.cancel);
        let cached = keys.motion == BarkMotion::Cache;
        let max_joints = if keys.motion == BarkMotion::Game { MAX_GAME_JOINTS } else { u32::MAX };
        let joints =
            JointBudget { joints: to_usize(keys.max_joints.min(max_joints)), coarse: keys.motion == BarkMotion::Game };
        // All branches are simulated, including those without joints: a limb sways by the wind on its twigs, and leaves follow
        // twigs that have no joints.
        let elements = BeamElements::build(plant, &params.wood, to_usize(keys.max_branches));
        // An estimate checks the limit for the whole clip, but records one frame.
        check_key_limit(&elements, wind.clip, limits)?;
        let clip = if wind.estimate_only {
            ClipOptions { frames: 1, repeats: false, from_rest: true, ..wind.clip }
        } else {
            wind.clip
        };
        let track = match wind.paper {
            Some(paper) => {
                let simulation = PaperSimulation::new(plant, &elements, &*wind.wind, params, paper);
                BendTrack::record_as_printed(simulation, clip, limits, cancel)?
            }
            None => BendTrack::record(&elements, &*wind.wind, params, clip, limits, cancel)?,
        };
        // The rate of flutter follows from the mean wind at the mean height of the leaves. Flutter repeats with the clip even in
        // a steady wind, which has no period.
        let period = wind.clip.repeats.then(|| wind.clip.frames as f64 / params.fps);
        let leaf_motion = |l: &FlutterGroup<'_>| {
            let mean_height =
                l.organs.iter().map(|o| plant.organ_site(o).0.y).sum::<f32>() / l.organs.len().max(1) as f32;
            let speed = wind.wind.mean_at(params.stand.apply(Vec3::Y * mean_height)).length();
            let flutter = LeafFlutter::new(l.organs, speed, period, l.flutter);
            InstancerLeafMotion {
                flutter: if wind.paper.is_some() { flutter.as_printed() } else { flutter },
                bindings: OrganBindings::new(plant, l.organs),
                twigs: l.organs.iter().map(|o| TwigLocation::new(&elements, elements.locate(o.axis, o.s))).collect(),
            }
        };
        Ok(Self {
            rig: JointRig::build(plant, &elements, joints),
            body: match cached {
                true => PointBinding::new(plant, &elements, surface.points, surface.bindings),
                false => PointBinding::new(plant, &elements, &[], &[]),
            },
            cached,
            leaves: surface.leaves.iter().map(leaf_motion).collect(),
            wind: Arc::clone(&wind.wind),
            elements,
            track,
            params,
        })
    }

    /// Number of angles, over all frames, that were limited because the paper's equations would have exceeded 90 degrees.
    pub fn clamp_count(&self) -> u64 {
        self.track.clamped()
    }

    /// Whether the motion repeats after the clip, or after a loop within it.
    pub fn repeats(&self) -> bool {
        self.track.repeats()
    }

    /// Number of recorded frames, those of the clip or of one loop.
    pub fn frame_count(&self) -> usize {
        self.track.frame_count()
    }

    /// The bends of all elements at a time of the clip, and half a frame before and after it.
    fn sample(&self, time: FrameTime) -> SwaySample {
        // The difference of the interpolated bends half a frame before and after is the motion over one frame, for motion blur.
        let number = time.seconds / time.step;
        let bends = [-0.5, 0.0, 0.5].map(|d| self.track.at(number + d));
        let base_rotations = [&bends[0], &bends[2]].map(|b| self.elements.base_rotations(b));
        // At either end of a clip that does not loop there are bends on one side only: the motion over half a frame.
        let last = self.track.frame_count().saturating_sub(1) as f64;
        let at_an_end = !self.repeats() && (number < 0.25 || number > last - 0.25);
        let span = if at_an_end { 0.5 } else { 1.0 };
        SwaySample { bends, base_rotations, seconds: time.seconds, span: narrow(time.step) * span }
    }

    /// Leaves and nodes at a time of the clip, in the wind without drops. The meshes of `asset` are not read.
    pub fn pose_in_wind(&self, asset: &Asset, time: FrameTime) -> PosedPlant {
        let sample = self.sample(time);
        let frame = AssetFrame { pose: self.rig.pose(&self.elements, &sample.bends[1]), ..AssetFrame::default() };
        let skeleton = self.body.pose(&self.elements, &sample.bends[1]);
        let states =
            (0..asset.instancers.len()).map(|i| match self.instancer_frame(asset, i, &frame, &skeleton, &sample) {
                InstancerFrame::State(state) => state,
                InstancerFrame::Same => asset.instancers[i].rest.clone(),
            });
        PosedPlant { instances: states.collect(), nodes: skeleton.positions().to_vec() }
    }

    /// Frame of the asset at a time of the clip, with the bends and leaf states that `rained` gives.
    pub fn frame_in_rain(&self, asset: &Asset, time: FrameTime, rained: RainedSway) -> AssetFrame {
        let mut sample = self.sample(time);
        // Drops add the same angles to the bends at all three times, so that velocities of the bark are those in the wind.
        for (bend, added) in sample.bends.iter_mut().flat_map(|bends| bends.iter_mut().zip(&rained.drop_bends)) {
            *bend = [bend[0] + added[0], bend[1] + added[1]];
        }
        let mut frame = AssetFrame { pose: self.rig.pose(&self.elements, &sample.bends[1]), ..AssetFrame::default() };
        if self.cached {
            let skeleton = self.body.pose(&self.elements, &sample.bends[1]);
            frame.meshes = self.mesh_frames(asset, &skeleton, &sample);
        }
        frame.instancers = rained.instances.into_iter().map(InstancerFrame::State).collect();
        frame
    }

    /// Beam elements of the plant's stems, whose bends the motion records.
    pub fn elements(&self) -> &BeamElements {
        &self.elements
    }

    /// Parameters of the sway, with the world transform of the plant's first copy as `stand`.
    pub fn params(&self) -> SwayParams {
        self.params
    }

    fn evaluate(&self, asset: &Asset, time: FrameTime) -> AssetFrame {
        let sample = self.sample(time);
        let mut frame = AssetFrame { pose: self.rig.pose(&self.elements, &sample.bends[1]), ..AssetFrame::default() };
        if !self.cached && asset.instancers.is_empty() {
            return frame;
        }
        let skeleton = self.body.pose(&self.elements, &sample.bends[1]);
        if self.cached {
            frame.meshes = self.mesh_frames(asset, &skeleton, &sample);
        }
        frame.instancers =
            (0..asset.instancers.len()).map(|i| self.instancer_frame(asset, i, &frame, &skeleton, &sample)).collect();
        frame
    }

    /// Points, normals and velocities of the meshes that deform.
    fn mesh_frames(&self, asset: &Asset, skeleton: &PosedSkeleton, sample: &SwaySample) -> Vec<MeshFrame> {
        let bark = &self.body;
        let mesh_frame = |m: &osier_scene::MeshObject| {
            if m.motion != MeshMotion::Deforming {
                return MeshFrame::Same;
            }
            let [before, after] = [0, 2].map(|k| bark.bark(&bark.pose(&self.elements, &sample.bends[k])));
            MeshFrame::Points {
                points: bark.bark(skeleton),
                normals: bark.normals(skeleton, &m.mesh.normals),
                velocities: before.iter().zip(&after).map(|(a, b)| (*b - *a) / sample.span).collect(),
            }
        };
        asset.meshes.iter().map(mesh_frame).collect()
    }

    /// Positions and rotations of one instancer's leaves with flutter. They follow the posed elements; where joints carry the
    /// bark, a leaf stays near its position on the joints.
    fn instancer_frame(
        &self,
        asset: &Asset,
        i: usize,
        frame: &AssetFrame,
        skeleton: &PosedSkeleton,
        sample: &SwaySample,
    ) -> InstancerFrame {
        let (Some(instancer), Some(leaves)) = (asset.instancers.get(i), self.leaves.get(i)) else {
            return InstancerFrame::Same;
        };
        let mut state = if self.cached {
            let (positions, orientations) = leaves.bindings.at(skeleton);
            InstanceState { positions, orientations, ..InstanceState::default() }
        } else {
            let mut state = instance_states(asset, instancer, i, frame).into_owned();
            state.orientations = leaves.bindings.approach(skeleton, &mut state.positions);
            state
        };
        self.add_flutter(leaves, &mut state, sample);
        InstancerFrame::State(state)
    }

    /// Rotates each leaf about its attachment by its flutter in the wind at its position.
    fn add_flutter(&self, leaves: &InstancerLeafMotion, state: &mut InstanceState, sample: &SwaySample) {
        let stand = self.params.stand;
        let places: Vec<Vec3> = state.positions.iter().map(|p| stand.apply(*p)).collect();
        let mut velocities = vec![Vec3::ZERO; places.len()];
        self.wind.sample(&places, sample.seconds, &mut velocities);
        for (k, q) in state.orientations.iter_mut().enumerate() {
            let twig = &leaves.twigs[k];
            // Wind in the plant's space, reduced by the shelter of the crown.
            let wind = stand.r.conjugate() * velocities[k] * twig.wind_exposure;
            let [before, after] = [0, 1]
                .map(|n| self.elements.rotation_at(&sample.base_rotations[n], &sample.bends[2 * n], twig.location));
            // Angular velocity of the twig over the frame, for small turns: twice the vector part of the rotation from half a frame
            // before to half a frame after, divided by the time between.
            let turned = after * before.conjugate();
            let spin = turned.xyz() * (2.0 * turned.w.signum() / sample.span);
            *q = leaves.flutter.orientation(k, *q, sample.seconds, LeafAir { wind, spin }).normalize();
        }
    }
}

impl AssetMotion for SwayMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.evaluate(asset, time))
    }

    fn bind_points(self: Arc<Self>, plant: &Plant, points: &[PointOnAxis]) -> Option<Arc<dyn CarriedPoints>> {
        let positions: Vec<Vec3> = points.iter().map(|point| point.position).collect();
        let sites: Vec<(u32, f32)> = points.iter().map(|point| (point.axis, point.arc_length)).collect();
        let binding = PointBinding::new(plant, &self.elements, &positions, &sites);
        Some(Arc::new(SwayingPoints { motion: self, binding }))
    }

    fn supports_phases(&self) -> bool {
        true
    }

    fn is_loop(&self) -> bool {
        self.repeats()
    }
}

#[derive(Debug)]
struct SwayingPoints {
    motion: Arc<SwayMotion>,
    binding: PointBinding,
}

impl CarriedPoints for SwayingPoints {
    fn positions(&self, time: FrameTime) -> Result<Vec<Vec3>> {
        let SwayMotion { track, elements, .. } = &*self.motion;
        Ok(self.binding.bark(&self.binding.pose(elements, &track.at(time.seconds / time.step))))
    }
}

/// Warning X020 if the paper's equations had no solution. `clamped`: number of clamped angles, over all plants and frames.
pub fn report_clamped_angles(clamped: u64, report: &mut Report) {
    if clamped > 0 {
        let text = format!(
            "{clamped} times an internode would be deflected by more than its length; its angle is taken as 90 degrees"
        );
        report.push(
            Diagnostic::about("X020", text).help("raise plants.NAME.wood.stiffness, or take sway.model = \"beam\""),
        );
    }
}
