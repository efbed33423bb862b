//! A plant over the times of a clip, the years of a tree or the steps of a derivation: wood that lengthens, thickens, bends and goes,
//! leaves that come and go.

use std::ops::Range;
use std::sync::Arc;

use glam::Vec3;

use crate::bake::assets::material_set::PlantMaterials;
use crate::bake::motion::growth::{GrowthMotion, organs_by_instancer, segment_middles};
use crate::bake::motion::{AssetMotion, CarriedPoints, FrameTime, PointOnAxis};
use osier_base::Result;
use osier_base::math::narrow;
use osier_motion::posed_skin::{GrowthBinding, PosedNodes, pose_skin};
use osier_plants::grow::clip::{ClipTimes, PosedGrowth};
use osier_plants::grow::years::PoseNow;
use osier_scene::plant::Plant;
use osier_scene::{Asset, AssetFrame, InstanceState, Instancer, InstancerFrame, MeshFrame};

/// Number of instancers among which the leaves of an organ are divided, and the least number of leaves of one. Own: an instancer
/// whose leaves do not exist yet takes no samples; more instancers save little and fill lists of objects.
const LEAF_PARTS: usize = 8;
const LEAST_LEAVES: usize = 500;

/// Motion of a recorded plant through its ages in a clip.
#[derive(Debug)]
pub struct YearsMotion {
    clip: Arc<dyn PosedGrowth>,
    /// Axis and arc length of each point of the bark.
    bindings: Vec<GrowthBinding>,
    /// Indices into the plant's organs, for each of the asset's leaf instancers.
    organs: Vec<Vec<usize>>,
    /// Middles of the segments of a tree that is displayed by them, in the order of their instancer.
    segments: Vec<GrowthBinding>,
    /// Length of the clip, s.
    seconds: f64,
}

impl YearsMotion {
    /// Gives an asset the motions that its growth needs, and divides its leaves by the time of their appearance.
    pub fn prepare(asset: &mut Asset, materials: &PlantMaterials, clip: &dyn PosedGrowth) {
        GrowthMotion::prepare(asset);
        // An instancer of segments may follow the instancers of organs.
        let organs = organs_by_instancer(clip.plant(), materials).len().min(asset.instancers.len());
        let segments = asset.instancers.split_off(organs);
        let divided = |leaves: &Instancer| -> Vec<Instancer> {
            let part = |(k, range): (usize, Range<usize>)| {
                let mut part = leaves.clone();
                let keep: Vec<bool> = (0..leaves.len()).map(|i| range.contains(&i)).collect();
                part.retain(&keep);
                if k > 0 {
                    part.name = format!("{}_{}", leaves.name, k + 1);
                }
                part
            };
            leaf_parts(leaves.len()).into_iter().enumerate().map(part).collect()
        };
        asset.instancers = asset.instancers.iter().flat_map(divided).chain(segments).collect();
    }

    /// The motion of a recorded tree. `bindings`: axis and arc length, m, of each point of its bark; `by_segments`: whether it
    /// is displayed by its segments; `seconds`: length of the clip.
    pub fn new(
        clip: Arc<dyn PosedGrowth>,
        materials: &PlantMaterials,
        bindings: &[(u32, f32)],
        by_segments: bool,
        seconds: f64,
    ) -> Self {
        Self {
            bindings: bindings.iter().map(|(axis, s)| GrowthBinding { axis: *axis, s: *s }).collect(),
            organs: organs_by_instancer(clip.plant(), materials)
                .iter()
                .flat_map(|list| split_by_appearance(list))
                .collect(),
            segments: if by_segments { segment_middles(clip.plant()) } else { Vec::new() },
            clip,
            seconds,
        }
    }

    /// Age of the plant, years or steps, at `seconds` after the first frame.
    fn age(&self, seconds: f64) -> f32 {
        let ClipTimes { from, to } = self.clip.times();
        let t = if self.seconds > 0.0 { (seconds / self.seconds).clamp(0.0, 1.0) } else { 1.0 };
        narrow(from + (to - from) * t)
    }

    /// State of the segments' instancer in a pose: each segment moves with its two nodes and is scaled by the ratio of radii.
    fn segment_state(&self, pose: &PoseNow, rest: &InstanceState) -> InstanceState {
        let plant = self.clip.plant();
        let mut state = InstanceState { sizes: Vec::with_capacity(self.segments.len()), ..rest.clone() };
        for (k, bound) in self.segments.iter().enumerate() {
            let axis = &plant.axes[bound.axis as usize];
            let (i, _) = plant.segment(axis, bound.s);
            let (low, high) = (pose.p[i], pose.p[i + 1]);
            let at_rest = plant.nodes.p[i + 1] - plant.nodes.p[i];
            // The segment rotates from its direction at rest to the direction between its nodes in the pose.
            let turn = osier_base::math::rotation_between(
                osier_base::math::normalize_or(at_rest, Vec3::Y),
                osier_base::math::normalize_or(high - low, at_rest.normalize_or(Vec3::Y)),
            );
            let rest_middle = 0.5 * (plant.nodes.p[i] + plant.nodes.p[i + 1]);
            state.positions[k] = 0.5 * (low + high) + turn * (rest.positions[k] - rest_middle);
            state.orientations[k] = (turn * rest.orientations[k]).normalize();
            let radius = 0.5 * (pose.r[i] + pose.r[i + 1]);
            let rest_radius = 0.5 * (plant.nodes.r[i] + plant.nodes.r[i + 1]);
            // A segment without length in the pose is hidden by size 0.
            state.sizes.push(if high.distance(low) > 0.0 { radius / rest_radius.max(f32::MIN_POSITIVE) } else { 0.0 });
        }
        state.alive = state.sizes.iter().map(|size| *size > 0.0).collect();
        state
    }
}

/// Divides `leaves` leaves, in the order of their appearance, into ranges.
fn leaf_parts(leaves: usize) -> Vec<Range<usize>> {
    let parts = (leaves / LEAST_LEAVES).clamp(1, LEAF_PARTS);
    (0..parts).map(|k| leaves * k / parts..leaves * (k + 1) / parts).collect()
}

/// The leaves of each range of [`leaf_parts`].
fn split_by_appearance(leaves: &[usize]) -> Vec<Vec<usize>> {
    leaf_parts(leaves.len()).into_iter().map(|range| leaves[range].to_vec()).collect()
}

impl AssetMotion for YearsMotion {
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame> {
        let pose = self.clip.pose(self.age(time.seconds))?;
        let nodes = PosedNodes { p: &pose.p, q: &pose.q, r: &pose.r };
        let mesh_frame = |object: &osier_scene::MeshObject| {
            let mesh = &object.mesh;
            let skin = pose_skin(self.clip.plant(), nodes, &mesh.points, &mesh.normals, &self.bindings);
            MeshFrame::Points { points: skin.points, normals: skin.normals, velocities: Vec::new() }
        };
        let organ_state = |organs: &[usize]| {
            let now = || organs.iter().map(|i| &pose.leaves[*i]);
            InstanceState {
                positions: now().map(|o| o.position).collect(),
                orientations: now().map(|o| o.orientation).collect(),
                alive: now().map(|o| o.size > 0.0).collect(),
                sizes: now().map(|o| o.size).collect(),
                ..InstanceState::default()
            }
        };
        // The instancer of segments, if there is one, comes after those of the organs.
        let state = |(i, instancer): (usize, &osier_scene::Instancer)| {
            let organs = self.organs.get(i);
            let segments = || self.segment_state(&pose, &instancer.rest);
            InstancerFrame::State(organs.map_or_else(segments, |organs| organ_state(organs)))
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

    fn keeps_year_record(&self) -> bool {
        true
    }

    fn bind_points(self: Arc<Self>, _plant: &Plant, points: &[PointOnAxis]) -> Option<Arc<dyn CarriedPoints>> {
        let sites = points.iter().map(|point| GrowthBinding { axis: point.axis, s: point.arc_length }).collect();
        Some(Arc::new(PointsOnYears { motion: self, sites }))
    }
}

/// Points on the axes of a tree that grows through its years. Points of wood that does not exist yet lie at the tip that has
/// grown so far.
#[derive(Debug)]
struct PointsOnYears {
    motion: Arc<YearsMotion>,
    sites: Vec<GrowthBinding>,
}

impl CarriedPoints for PointsOnYears {
    fn positions(&self, time: FrameTime) -> Result<Vec<Vec3>> {
        let YearsMotion { clip, .. } = &*self.motion;
        let nodes = clip.node_positions(self.motion.age(time.seconds))?;
        let at = |site: &GrowthBinding| {
            let plant = clip.plant();
            let (i, t) = plant.segment(&plant.axes[site.axis as usize], site.s);
            nodes[i].lerp(nodes[i + 1], t)
        };
        Ok(self.sites.iter().map(at).collect())
    }
}
