//! Growth of a plant over the clip: bark that lengthens and thickens, leaves that unfold.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::assets::plant_mesh::group_organs;
use crate::bake::motion::{AssetMotion, CarriedPoints, FrameTime, PointOnAxis};
use osier_base::Result;
use osier_base::math::narrow;
use osier_motion::growth::{GrowingOrgan, GrowingPlant, GrowthClock};
use osier_motion::posed_skin::GrowthBinding;
use osier_scene::plant::Plant;
use osier_scene::{Asset, AssetFrame, InstanceState, InstancerFrame, InstancerMotion, MeshFrame, MeshMotion};

/// The part of a plant's growth that a clip shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrowthSpan {
    /// Shares of the growth time at the first and the last frame, 0..1.
    pub shares: [f64; 2],
    /// Length of the clip, s.
    pub seconds: f64,
}

/// Moves bark, leaves and segments of a plant to the share of its growth that belongs to a time of the clip.
#[derive(Debug)]
pub struct GrowthMotion {
    plant: Arc<Plant>,
    clock: GrowthClock,
    /// Axis and arc length of each point of the bark.
    bindings: Vec<GrowthBinding>,
    /// Indices into the plant's organs, for each of the asset's leaf instancers.
    organs: Vec<Vec<usize>>,
    /// Middles of the segments, in the order of their instancer, if the plant is displayed by its segments.
    segments: Vec<GrowthBinding>,
    clip: GrowthSpan,
}

impl GrowthMotion {
    /// The motion of a grown plant. `bindings`: axis and arc length, m, of each point of its bark; `by_segments`: whether the
    /// plant is displayed by its segments.
    pub fn new(
        plant: &Plant,
        materials: &PlantMaterials,
        bindings: &[(u32, f32)],
        by_segments: bool,
        clip: GrowthSpan,
    ) -> Self {
        Self {
            clock: GrowthClock::new(plant),
            bindings: bindings.iter().map(|(axis, s)| GrowthBinding { axis: *axis, s: *s }).collect(),
            organs: organs_by_instancer(plant, materials),
            segments: if by_segments { segment_middles(plant) } else { Vec::new() },
            plant: Arc::new(plant.clone()),
            clip,
        }
    }

    /// Marks the bark of an asset as deforming and its leaves as free, and removes skeleton and skin, as a growing plant
    /// requires.
    pub fn prepare(asset: &mut Asset) {
        for object in &mut asset.meshes {
            object.motion = MeshMotion::Deforming;
            // Joints cannot lengthen an axis: points are written frame by frame.
            object.skin = None;
        }
        asset.instancers.iter_mut().for_each(|i| i.motion = InstancerMotion::Free);
        asset.skeleton = None;
    }

    /// Share of the growth time, 0..1, at `seconds` after the first frame.
    fn share(&self, seconds: f64) -> f32 {
        let GrowthSpan { shares: [from, to], seconds: whole } = self.clip;
        // A clip of one frame shows the end of the growth.
        let t = if whole > 0.0 { (seconds / whole).clamp(0.0, 1.0) } else { 1.0 };
        narrow(from + (to - from) * t)
    }

    fn organ_state(&self, young: &GrowingPlant<'_>, organs: &[usize]) -> InstanceState {
        let now: Vec<GrowingOrgan> = organs.iter().map(|i| young.organ(*i)).collect();
        InstanceState {
            positions: now.iter().map(|o| o.position).collect(),
            orientations: now.iter().map(|o| o.orientation).collect(),
            alive: now.iter().map(|o| o.size > 0.0).collect(),
            sizes: now.iter().map(|o| o.size).collect(),
            ..InstanceState::default()
        }
    }

    fn segment_state(&self, young: &GrowingPlant<'_>, rest: &InstanceState) -> InstanceState {
        let sizes: Vec<f32> = self.segments.iter().map(|b| young.segment_size(b.axis, b.s)).collect();
        InstanceState { alive: sizes.iter().map(|s| *s > 0.0).collect(), sizes, ..rest.clone() }
    }
}

/// Indices into the plant's organs for each organ instancer of its asset, in the order of its instances.
pub(super) fn organs_by_instancer(plant: &Plant, materials: &PlantMaterials) -> Vec<Vec<usize>> {
    let mut numbers = std::collections::BTreeMap::new();
    plant.organs.iter().enumerate().for_each(|(i, o)| {
        // When organs are grouped by instancer, they keep their ids but not their indices.
        numbers.insert(o.id, i);
    });
    let index = |o: &&osier_scene::plant::Organ| numbers.get(&o.id).copied();
    let groups = group_organs(plant, materials);
    groups.values().map(|list| list.iter().filter_map(index).collect()).collect()
}

/// Axis and arc length of the middles of all segments, in the order of the instances of a plant shown by its segments.
pub(super) fn segment_middles(plant: &Plant) -> Vec<GrowthBinding> {
    let mut middles = Vec::new();
    for (axis, shape) in (0_u32..).zip(&plant.axes) {
        let s = &plant.nodes.s[plant.nodes_of(shape)];
        middles.extend(s.windows(2).map(|w| GrowthBinding { axis, s: 0.5 * (w[0] + w[1]) }));
    }
    middles
}

impl AssetMotion for GrowthMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        let young = GrowingPlant::new(&self.plant, &self.clock, self.share(time.seconds));
        let mesh_frame = |object: &osier_scene::MeshObject| MeshFrame::Points {
            points: young.points(&object.mesh.points, &self.bindings),
            normals: object.mesh.normals.clone(),
            // Growth is too slow to blur.
            velocities: Vec::<Vec3>::new(),
        };
        let state =
            |(i, instancer): (usize, &osier_scene::Instancer)| {
                // The instancer of segments, if there is one, comes after those of the organs.
                let organs = self.organs.get(i);
                InstancerFrame::State(organs.map_or_else(
                    || self.segment_state(&young, &instancer.rest),
                    |organs| self.organ_state(&young, organs),
                ))
            };
        Ok(AssetFrame {
            meshes: asset.meshes.iter().map(mesh_frame).collect(),
            instancers: asset.instancers.iter().enumerate().map(state).collect(),
            ..AssetFrame::default()
        })
    }

    fn is_growth(&self) -> bool {
        true
    }

    fn bind_points(self: Arc<Self>, _plant: &Plant, points: &[PointOnAxis]) -> Option<Arc<dyn CarriedPoints>> {
        let sites = points.iter().map(|point| GrowthBinding { axis: point.axis, s: point.arc_length }).collect();
        Some(Arc::new(PointsOnGrowth { motion: self, sites }))
    }
}

/// Points on the axes of a plant that grows. Points of axes that do not exist yet lie at the tip that has grown so far.
#[derive(Debug)]
struct PointsOnGrowth {
    motion: Arc<GrowthMotion>,
    sites: Vec<GrowthBinding>,
}

impl CarriedPoints for PointsOnGrowth {
    fn positions(&self, time: FrameTime) -> Result<Vec<Vec3>> {
        let GrowthMotion { plant, clock, .. } = &*self.motion;
        let young = GrowingPlant::new(plant, clock, self.motion.share(time.seconds));
        Ok(self.sites.iter().map(|site| young.center(site.axis, site.s)).collect())
    }
}
