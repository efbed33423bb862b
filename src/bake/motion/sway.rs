//! Plants that sway in the wind: joints, bark and fluttering leaves at any time of the clip.

use std::sync::Arc;

use glam::{Quat, Vec3};

use crate::bake::motion::{AssetMotion, FrameTime};
use crate::bake::wind::plant_wind::PlantWind;
use crate::recipe::scene::{BarkMotion, PlantKeys};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::progress::Cancel;
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
    manner: SwayParams,
}

/// Leaves of one instancer.
#[derive(Debug, Clone)]
struct LeafMotion {
    flutter: LeafFlutter,
    hangers: OrganBindings,
    spots: Vec<ElementLocation>,
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

/// Bends half a frame before, now, and half a frame later.
struct SwaySample {
    bends: [Vec<[f32; 2]>; 3],
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
        (air, manner): (&PlantWind, SwayParams),
        shown: &SwaySurface<'_>,
        (limits, cancel): (&Limits, &Cancel),
    ) -> Result<Self> {
        let cached = keys.motion == BarkMotion::Cache;
        let most = if keys.motion == BarkMotion::Game { MAX_GAME_JOINTS } else { u32::MAX };
        let joints = keys.max_joints.min(most) as usize;
        let budget = match keys.motion {
            BarkMotion::Cache => ElementBudget::Elements(keys.max_branches as usize),
            BarkMotion::Game => ElementBudget::Coarse(joints),
            BarkMotion::Skin | BarkMotion::Static | BarkMotion::Still => ElementBudget::Joints(joints),
        };
        let elements = BeamElements::build(plant, &manner.wood, budget);
        osier_motion::sway::check_key_limit(&elements, air.take, limits)?;
        let take = if air.draft {
            osier_motion::sway::ClipOptions { frames: 1, repeats: false, from_rest: true, ..air.take }
        } else {
            air.take
        };
        let track = match air.paper {
            Some(paper) => {
                let simulation = PaperSimulation::new(plant, &elements, &*air.wind, manner, paper);
                BendTrack::record_as_printed(simulation, take, limits, cancel)?
            }
            None => BendTrack::record(&elements, &*air.wind, manner, take, limits, cancel)?,
        };
        let foliage = |l: &FlutterGroup<'_>| {
            let middle = l.organs.iter().map(|o| plant.organ_site(o).0.y).sum::<f32>() / l.organs.len().max(1) as f32;
            let speed = air.wind.mean_at(manner.stand.apply(Vec3::Y * middle).y).length();
            let flutter = LeafFlutter::new(l.organs, speed, air.wind.period(), l.flutter);
            LeafMotion {
                flutter: if air.paper.is_some() { flutter.as_printed() } else { flutter },
                hangers: OrganBindings::new(plant, l.organs),
                spots: l.organs.iter().map(|o| elements.locate(o.axis, o.s)).collect(),
            }
        };
        Ok(Self {
            rig: JointRig::build(plant, &elements, joints),
            body: cached.then(|| PointBinding::new(plant, &elements, shown.points, shown.bindings)),
            leaves: shown.leaves.iter().map(foliage).collect(),
            wind: Arc::clone(&air.wind),
            elements,
            track,
            manner,
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
        let moment = SwaySample { bends, seconds, step };
        let mut frame = AssetFrame { pose: self.rig.pose(&self.elements, &moment.bends[1]), ..AssetFrame::default() };
        let posture = self.body.as_ref().map(|body| body.pose(&self.elements, &moment.bends[1]));
        if let Some((body, posture)) = self.body.as_ref().zip(posture.as_ref()) {
            frame.meshes = self.meshes(asset, (body, posture), &moment);
        }
        let around = [&moment.bends[0], &moment.bends[2]].map(|b| self.elements.base_rotations(b));
        frame.instancers = (0..asset.instancers.len())
            .map(|i| self.instancer(asset, i, (&frame, posture.as_ref()), (&moment, &around)))
            .collect();
        frame
    }

    fn meshes(
        &self,
        asset: &Asset,
        (body, posture): (&PointBinding, &PosedSkeleton),
        moment: &SwaySample,
    ) -> Vec<MeshFrame> {
        let one = |m: &osier_scene::MeshObject| {
            if m.motion != MeshMotion::Deforming {
                return MeshFrame::Same;
            }
            let [before, after] = [0, 2].map(|k| body.bark(&body.pose(&self.elements, &moment.bends[k])));
            MeshFrame::Points {
                points: body.bark(posture),
                normals: body.normals(posture, &m.mesh.normals),
                velocities: before.iter().zip(&after).map(|(a, b)| (*b - *a) / moment.step).collect(),
            }
        };
        asset.meshes.iter().map(one).collect()
    }

    fn instancer(
        &self,
        asset: &Asset,
        i: usize,
        (frame, posture): (&AssetFrame, Option<&PosedSkeleton>),
        (moment, around): (&SwaySample, &[Vec<Quat>; 2]),
    ) -> InstancerFrame {
        let (Some(instancer), Some(leaves)) = (asset.instancers.get(i), self.leaves.get(i)) else {
            return InstancerFrame::Same;
        };
        let mut state = match posture {
            Some(posture) => {
                let (positions, orientations) = leaves.hangers.at(posture);
                InstanceState { positions, orientations, ..InstanceState::default() }
            }
            None => instance_states(asset, instancer, i, frame).into_owned(),
        };
        self.flutter(leaves, &mut state, (moment, around));
        InstancerFrame::State(state)
    }

    /// Lets leaves flutter about where their twigs hold them.
    fn flutter(
        &self,
        leaves: &LeafMotion,
        state: &mut InstanceState,
        (moment, around): (&SwaySample, &[Vec<Quat>; 2]),
    ) {
        let stand = self.manner.stand;
        let places: Vec<Vec3> = state.positions.iter().map(|p| stand.apply(*p)).collect();
        let mut air = vec![Vec3::ZERO; places.len()];
        self.wind.sample(&places, moment.seconds, &mut air);
        for (k, q) in state.orientations.iter_mut().enumerate() {
            let spot = leaves.spots[k];
            let wind = stand.r.conjugate() * air[k] * self.elements.wind_exposure(spot);
            let [before, after] = [0, 1].map(|n| self.elements.rotation_at(&around[n], &moment.bends[2 * n], spot));
            let turned = after * before.conjugate();
            let spin = turned.xyz() * (2.0 * turned.w.signum() / moment.step);
            *q = leaves.flutter.turned(k, *q, moment.seconds, osier_motion::sway::LeafAir { wind, spin }).normalize();
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
