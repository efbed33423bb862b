//! Plants that sway in the wind: joints, bark and fluttering leaves at any time of the clip.

use std::sync::Arc;

use glam::{Quat, Vec3};

use crate::bake::BakeContext;
use crate::bake::motion::{AssetMotion, FrameTime};
use crate::bake::wind::plant_wind::PlantWind;
use crate::recipe::scene::{BarkMotion, PlantKeys};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::math::narrow;
use osier_motion::sway::{
    BeamElements, BendTrack, ElementBudget, ElementLocation, JointRig, LeafFlutter, OrganBindings, PaperSimulation,
    PointBinding, PosedSkeleton, SwayParams,
};
use osier_scene::plant::{Organ, Plant};
use osier_scene::{Asset, AssetFrame, InstanceState, InstancerFrame, MeshFrame, MeshMotion, instance_states};
use osier_wind::Wind;

/// Most joints for engines.
const MAX_GAME_JOINTS: u32 = 64;

/// Moves one plant.
#[derive(Debug, Clone)]
pub struct SwayMotion {
    /// Its joints.
    pub rig: JointRig,
    elements: BeamElements,
    track: BendTrack,
    /// All of it, where every point is wanted.
    body: Option<PointBinding>,
    /// One per instancer, in the instancer's order of organs.
    leaves: Vec<LeafMotion>,
    wind: Arc<dyn Wind>,
    params: SwayParams,
}

/// Leaves of one instancer.
#[derive(Debug, Clone)]
struct LeafMotion {
    flutter: LeafFlutter,
    bindings: OrganBindings,
    locations: Vec<ElementLocation>,
}

/// The organs of one instancer, with what the recipe says of their flutter.
pub struct FlutterGroup<'a> {
    /// In the instancer's order.
    pub organs: &'a [&'a Organ],
    /// Factor on their flutter.
    pub flutter: f32,
}

impl<'a> FlutterGroup<'a> {
    /// Of an organ of the recipe.
    pub fn of(recipe: &PlantRecipe, organ: usize, organs: &'a [&'a Organ]) -> Self {
        // Twigs, which come after the organs of a table's tree, ride on their branch.
        let other = if matches!(recipe.growth, Growth::Ifs(..)) { 0.0 } else { 1.0 };
        let flutter = recipe.organs.get(organ).map_or(other, |o| narrow(o.keys.flutter));
        Self { organs, flutter }
    }
}

/// What is seen of a plant at rest.
pub struct SwaySurface<'a> {
    /// The bark's points, m.
    pub points: &'a [Vec3],
    /// Axis and arc length, m, of each.
    pub bindings: &'a [(u32, f32)],
    /// One per instancer.
    pub leaves: &'a [FlutterGroup<'a>],
}

/// The bends of all elements around one frame.
struct SwaySample {
    /// Half a frame before, at the frame, and half a frame after it.
    bends: [Vec<[f32; 2]>; 3],
    /// Rotation of each element's base half a frame before and after.
    base_rotations: [Vec<Quat>; 2],
    seconds: f64,
    step: f32,
}

impl SwayMotion {
    /// Measures a plant and lets the wind move it.
    /// # Errors
    /// `Limit`, `Cancelled`.
    pub fn new(
        plant: &Plant,
        keys: &PlantKeys,
        air: &PlantWind,
        params: SwayParams,
        surface: &SwaySurface<'_>,
        context: &BakeContext<'_>,
    ) -> Result<Self> {
        let (limits, cancel) = (context.limits, context.cancel);
        let cached = keys.motion == BarkMotion::Cache;
        let most = if keys.motion == BarkMotion::Game { MAX_GAME_JOINTS } else { u32::MAX };
        let joints = keys.max_joints.min(most) as usize;
        let budget = match keys.motion {
            BarkMotion::Cache => ElementBudget::Elements(keys.max_branches as usize),
            BarkMotion::Game => ElementBudget::Coarse(joints),
            BarkMotion::Skin | BarkMotion::Static | BarkMotion::Still => ElementBudget::Joints(joints),
        };
        let elements = BeamElements::build(plant, &params.wood, budget);
        osier_motion::sway::check_key_limit(&elements, air.take, limits)?;
        let take = if air.draft {
            osier_motion::sway::ClipOptions { frames: 1, repeats: false, from_rest: true, ..air.take }
        } else {
            air.take
        };
        let track = match air.paper {
            Some(paper) => {
                let simulation = PaperSimulation::new(plant, &elements, &*air.wind, params, paper);
                BendTrack::record_as_printed(simulation, take, limits, cancel)?
            }
            None => BendTrack::record(&elements, &*air.wind, params, take, limits, cancel)?,
        };
        let foliage = |l: &FlutterGroup<'_>| {
            let middle = l.organs.iter().map(|o| plant.organ_site(o).0.y).sum::<f32>() / l.organs.len().max(1) as f32;
            let speed = air.wind.mean_at(params.stand.apply(Vec3::Y * middle).y).length();
            let flutter = LeafFlutter::new(l.organs, speed, air.wind.period(), l.flutter);
            LeafMotion {
                flutter: if air.paper.is_some() { flutter.as_printed() } else { flutter },
                bindings: OrganBindings::new(plant, l.organs),
                locations: l.organs.iter().map(|o| elements.locate(o.axis, o.s)).collect(),
            }
        };
        Ok(Self {
            rig: JointRig::build(plant, &elements, joints),
            body: cached.then(|| PointBinding::new(plant, &elements, surface.points, surface.bindings)),
            leaves: surface.leaves.iter().map(foliage).collect(),
            wind: Arc::clone(&air.wind),
            elements,
            track,
            params,
        })
    }

    /// Angles that the paper's equations would take beyond a right one.
    pub fn clamped(&self) -> u64 {
        self.track.clamped()
    }

    /// The asset at `seconds`; `step`: seconds between frames, for velocities.
    fn evaluate(&self, asset: &Asset, seconds: f64, step: f64) -> AssetFrame {
        let (number, step) = (seconds / step, narrow(step));
        let bends = [-0.5, 0.0, 0.5].map(|d| self.track.at(number + d));
        let base_rotations = [&bends[0], &bends[2]].map(|b| self.elements.base_rotations(b));
        let sample = SwaySample { bends, base_rotations, seconds, step };
        let mut frame = AssetFrame { pose: self.rig.pose(&self.elements, &sample.bends[1]), ..AssetFrame::default() };
        let skeleton = self.body.as_ref().map(|body| body.pose(&self.elements, &sample.bends[1]));
        if let Some((body, skeleton)) = self.body.as_ref().zip(skeleton.as_ref()) {
            frame.meshes = self.meshes(asset, body, skeleton, &sample);
        }
        frame.instancers =
            (0..asset.instancers.len()).map(|i| self.instancer(asset, i, &frame, skeleton.as_ref(), &sample)).collect();
        frame
    }

    /// Points, normals and velocities of the meshes that deform.
    fn meshes(
        &self,
        asset: &Asset,
        body: &PointBinding,
        skeleton: &PosedSkeleton,
        sample: &SwaySample,
    ) -> Vec<MeshFrame> {
        let one = |m: &osier_scene::MeshObject| {
            if m.motion != MeshMotion::Deforming {
                return MeshFrame::Same;
            }
            let [before, after] = [0, 2].map(|k| body.bark(&body.pose(&self.elements, &sample.bends[k])));
            MeshFrame::Points {
                points: body.bark(skeleton),
                normals: body.normals(skeleton, &m.mesh.normals),
                velocities: before.iter().zip(&after).map(|(a, b)| (*b - *a) / sample.step).collect(),
            }
        };
        asset.meshes.iter().map(one).collect()
    }

    /// Places of one instancer's leaves, with their flutter.
    fn instancer(
        &self,
        asset: &Asset,
        i: usize,
        frame: &AssetFrame,
        skeleton: Option<&PosedSkeleton>,
        sample: &SwaySample,
    ) -> InstancerFrame {
        let (Some(instancer), Some(leaves)) = (asset.instancers.get(i), self.leaves.get(i)) else {
            return InstancerFrame::Same;
        };
        let mut state = match skeleton {
            Some(skeleton) => {
                let (positions, orientations) = leaves.bindings.at(skeleton);
                InstanceState { positions, orientations, ..InstanceState::default() }
            }
            None => instance_states(asset, instancer, i, frame).into_owned(),
        };
        self.flutter(leaves, &mut state, sample);
        InstancerFrame::State(state)
    }

    /// Lets leaves flutter about where their twigs hold them.
    fn flutter(&self, leaves: &LeafMotion, state: &mut InstanceState, sample: &SwaySample) {
        let stand = self.params.stand;
        let places: Vec<Vec3> = state.positions.iter().map(|p| stand.apply(*p)).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        self.wind.sample(&places, sample.seconds, &mut air);
        for (k, q) in state.orientations.iter_mut().enumerate() {
            let spot = leaves.locations[k];
            let wind = stand.r.conjugate() * air[k] * self.elements.wind_exposure(spot);
            let [before, after] =
                [0, 1].map(|n| self.elements.rotation_at(&sample.base_rotations[n], &sample.bends[2 * n], spot));
            // Angular velocity of the twig over the frame, for small turns: twice the vector part of the rotation from half a frame
            // before to half a frame after, divided by the frame's length.
            let turned = after * before.conjugate();
            let spin = turned.xyz() * (2.0 * turned.w.signum() / sample.step);
            *q = leaves
                .flutter
                .orientation(k, *q, sample.seconds, osier_motion::sway::LeafAir { wind, spin })
                .normalize();
        }
    }
}

impl AssetMotion for SwayMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        Ok(self.evaluate(asset, time.seconds, time.step))
    }

    fn supports_phases(&self) -> bool {
        true
    }
}

/// X020 where the paper's equations have no answer. `clamped`: angles that were clamped, over all plants and frames.
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
