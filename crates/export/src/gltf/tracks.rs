//! The animation of a clip, gathered frame by frame and held until the end, because the keys of a sampler are
//! contiguous in the buffer.

use glam::{Quat, Vec3};

use super::leaf_shapes::LeafShapes;
use super::morph_shape::MorphShape;
use super::options::{GltfOptions, INDEX_BYTES, Profile, VECTOR_BYTES};
use osier_base::convert::limit;
use osier_base::rng::mix64;
use osier_scene::{
    Asset, AssetFrame, Clip, CurvesFrame, Frame, InstancerMotion, MeshFrame, MeshMotion, Scene, Trs, instance_states,
};

/// Number of shapes of a mesh before any frame is left out, if all points are visible in each; if some are hidden, the
/// same bytes hold more shapes. Own: each target holds positions and normals, and importers keep all of them.
const MORPH_TARGETS: usize = 32;
/// Most bytes of the targets of a mesh whose error would be visible with fewer. Own: small meshes that move
/// irregularly, such as trees that grow year by year, keep every frame of a clip of five seconds.
const MORPH_BYTES: usize = 60 << 20;
/// Most targets of a mesh.
const MOST_TARGETS: usize = 256;
/// Most bytes of the targets in a program's memory, where each has all vertices, divided by those of the visible
/// vertices. Own: of the wood of an oak that grows from 2 to 20 years a third is visible on average.
const MOST_UNSEEN: usize = 3;
/// Bytes of targets that a mesh may have before any frame is left out. Own: less than the textures of a plant.
const MORPH_FREE: usize = 4 << 20;
/// Least number of targets, even for the largest meshes. Own: with fewer, a growing tree would jump from shape to
/// shape.
const LEAST_TARGETS: usize = 16;
/// Largest invisible deviation of a point at an omitted frame from the interpolated shape, as a share of the diagonal
/// of the mesh's box. Own: four pixels for a tree that fills a picture of 1080 rows, the same as USD's tolerance for
/// growing plants.
const MORPH_TOLERANCE: f32 = 0.004;
/// Largest deviation of curves, as a share of the same diagonal; coarser curves are dropped. Own: beyond it catkins
/// would follow visibly other paths.
const CURVE_TOLERANCE: f32 = 0.02;
/// The smallest tolerance with which frames are omitted, as a share of that diagonal. Own: 5 mm for a tree of 10 m.
const LEAST_TOLERANCE: f32 = 0.0005;
/// Most shapes that wait for the next key; limits memory and the comparisons per frame.
const MOST_WAITING: usize = 8;

/// The states of all assets at the frames of the clip, held until the file is written.
#[derive(Debug, Default)]
pub(super) struct ClipTracks {
    /// Time of each frame, s, from the start of the clip; with `repeats` also that of the frame after the last.
    pub times: Vec<f32>,
    /// Whether `times` ends with a time at which all joints have the poses of the first frame again.
    pub repeats: bool,
    /// Number of each frame in the clip.
    pub numbers: Vec<u32>,
    /// States of each asset, in the order of the scene.
    pub assets: Vec<AssetTracks>,
    /// Most moving instances in a file; if there are more, those with the smallest [`InstanceTrack::key`] are written.
    pub max_moving: usize,
}

/// The changes of one asset over the clip; poses and tracks have an entry for each frame.
#[derive(Debug, Default)]
pub(super) struct AssetTracks {
    /// For each frame the transform of each joint to its parent's space.
    pub poses: Vec<Vec<Trs>>,
    /// Moving instances, sorted by (key, instancer, index).
    pub moving: Vec<InstanceTrack>,
    /// The leaves of a growing plant, if they are too many for a node each.
    pub leaves: Option<LeafShapes>,
    /// For each mesh of the asset in its order; [`MorphFrames::Still`] where it does not deform.
    pub meshes: Vec<MorphFrames>,
    /// Shapes of each curves primitive of the asset; without normals.
    pub curves: Vec<MorphFrames>,
}

/// The states of one moving instance; each list has an entry for every frame.
#[derive(Debug)]
pub(super) struct InstanceTrack {
    /// hash(seed, id): the instances with the smallest keys are written if there are too many.
    pub key: u64,
    /// Index of the instancer in the asset.
    pub instancer: usize,
    /// Index of the instance in the instancer.
    pub instance: usize,
    pub positions: Vec<Vec3>,
    pub orientations: Vec<Quat>,
    pub alive: Vec<bool>,
    /// Factors on the instance's scale, such as the growth of a leaf.
    pub sizes: Vec<f32>,
}

/// Shapes of a mesh, or of a set of curves, over the clip.
#[derive(Debug, Default)]
pub(super) enum MorphFrames {
    /// No shapes: the mesh does not deform, or joints move it.
    #[default]
    Still,
    Frames(MorphKeys),
    /// The curves would need more shapes than [`MorphKeys::most`]; none is kept.
    TooMany,
}

/// Shapes at selected frames, including the first and the last one; readers interpolate between them. All frames are kept while
/// they are few, else those that interpolation does not restore within a tolerance, which is raised until few enough remain.
#[derive(Debug)]
pub(super) struct MorphKeys {
    /// Indices of the kept frames, increasing.
    pub frames: Vec<usize>,
    /// One shape for each of `frames`, in their order.
    pub shapes: Vec<MorphShape>,
    /// Largest distance of a point at an omitted frame from the interpolated shape, m; 0 if all frames are kept.
    pub error: f32,
    /// Numbers in the clip of the frames taken so far, kept or not. If frames were skipped, their distances may differ.
    numbers: Vec<u32>,
    /// Interval of the kept frames of meshes so large that few targets fit; 1: the motion determines which frames are
    /// kept.
    stride: usize,
    /// Shapes of the frames after the last kept one.
    waiting: Vec<MorphShape>,
    /// Largest distance of a point of a waiting shape from the interpolated shape, m; 0: all frames are kept.
    tolerance: f32,
    /// Diagonal of the mesh's box at rest, m.
    diagonal: f32,
    /// Bytes of targets above which shapes are thinned out; raised to [`MORPH_BYTES`] before the error becomes visible.
    limit: usize,
    /// Bytes of the targets of the kept shapes.
    bytes: usize,
    /// Limits for a mesh of this number of points.
    budget: TargetBudget,
    /// Number of points of the mesh.
    points: usize,
}

/// Kept shapes as input of morph targets.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MorphTrack<'a> {
    /// Indices of the frames, increasing.
    pub frames: &'a [usize],
    /// One shape for each of `frames`, in their order.
    pub shapes: &'a [MorphShape],
}

/// Estimated bytes of the morph targets of `meshes` deforming meshes with `vertices` points in total over `frames`
/// frames, if all points are visible in each.
pub(super) fn estimate(vertices: u64, meshes: u64, frames: u64, options: &GltfOptions) -> u64 {
    if vertices == 0 {
        return 0;
    }
    // The meshes of a plant differ in size, but only the sums are known: assume equal meshes, each with a budget of its
    // own.
    let meshes = meshes.max(1);
    let each = TargetBudget::new(limit(vertices.div_ceil(meshes)), options);
    let least = vertices * each.point as u64 * frames.min(LEAST_TARGETS as u64);
    (frames.min(each.most as u64) * vertices * each.point as u64)
        .min((MORPH_BYTES as u64).saturating_mul(meshes))
        .max(least)
}

/// Limits to the targets of a mesh, which depend on its number of points.
#[derive(Debug, Clone, Copy)]
struct TargetBudget {
    /// Whether targets have normals. Those of large meshes have none, so that twice as many fit: growing wood hardly
    /// turns. Targets for Blender have none either, since Blender computes normals itself.
    with_normals: bool,
    /// Bytes per point of a target.
    point: usize,
    /// Most targets.
    most: usize,
}

impl TargetBudget {
    fn new(points: usize, options: &GltfOptions) -> Self {
        let (points, position) = (points.max(1), options.target_position_bytes());
        let with_normals = options.has_target_normals()
            && (position + VECTOR_BYTES).saturating_mul(points).saturating_mul(MORPH_TARGETS) <= MORPH_BYTES;
        let point = if with_normals { position + VECTOR_BYTES } else { position };
        let held = MOST_UNSEEN * MORPH_BYTES / point.saturating_mul(points);
        Self { with_normals, point, most: held.clamp(LEAST_TARGETS, MOST_TARGETS) }
    }
}

impl MorphKeys {
    /// The kept shapes with their frames, borrowed.
    pub fn track(&self) -> MorphTrack<'_> {
        MorphTrack { frames: &self.frames, shapes: &self.shapes }
    }

    /// `rest`: points of the mesh at rest; `frames`: number of frames to be written.
    fn new(rest: &[Vec3], frames: usize, options: &GltfOptions) -> Self {
        let budget = TargetBudget::new(rest.len(), options);
        let TargetBudget { point, most, .. } = budget;
        let of_all = point.saturating_mul(rest.len().max(1)).saturating_mul(MORPH_TARGETS);
        Self {
            frames: Vec::new(),
            shapes: Vec::new(),
            error: 0.0,
            numbers: Vec::new(),
            stride: if most < MORPH_TARGETS { frames.saturating_sub(1).div_ceil(most - 1).max(1) } else { 1 },
            waiting: Vec::new(),
            tolerance: 0.0,
            diagonal: osier_base::geometry::Bounds::of(rest.iter().copied()).size().length(),
            limit: MORPH_FREE.max(of_all).min(MORPH_BYTES),
            bytes: 0,
            budget,
            points: rest.len(),
        }
    }

    /// Bytes of the target of a shape: the smaller of a list of all points and of the visible points with their
    /// indices.
    fn target_bytes(&self, shape: &MorphShape) -> usize {
        let unseen = shape.unseen.iter().filter(|unseen| **unseen).count();
        let seen = self.points.saturating_sub(unseen);
        (seen * (self.budget.point + INDEX_BYTES)).min(self.points * self.budget.point)
    }

    /// Whether omitted frames deviate visibly from the interpolated shapes: by more than [`MORPH_TOLERANCE`].
    pub(super) fn is_coarse(&self) -> bool {
        self.error > MORPH_TOLERANCE * self.diagonal
    }

    /// Share of the time from frame `from` to frame `to` that has passed at frame `at`; all three are indices.
    fn share(&self, from: usize, at: usize, to: usize) -> f32 {
        let [from, at, to] = [from, at, to].map(|i| self.numbers[i]);
        (at - from) as f32 / (to - from) as f32
    }

    /// Takes the shape of the next frame, of this number in the clip: keeps it, or lets it wait until a later frame decides whether
    /// it is needed.
    fn push(&mut self, number: u32, mut shape: MorphShape) {
        if !self.budget.with_normals {
            shape.normals = Vec::new();
        }
        let frame = self.numbers.len();
        self.numbers.push(number);
        if self.stride > 1 {
            if frame.is_multiple_of(self.stride) {
                self.keep_after_waiting(frame, shape);
            } else {
                self.waiting.push(shape);
            }
            return;
        }
        if self.tolerance <= 0.0 {
            self.keep(frame, shape);
            return;
        }
        // All waiting shapes must lie within the tolerance of the interpolation from the last kept shape to the new
        // one.
        let restored = self.frames.last().zip(self.shapes.last()).is_some_and(|(first, from)| {
            let mut waiting = self.waiting.iter().zip(*first + 1..);
            waiting.all(|(s, at)| s.lies_between(from, &shape, self.share(*first, at, frame), self.tolerance))
        });
        if (self.waiting.len() >= MOST_WAITING || !restored)
            && let Some(last) = self.waiting.pop()
        {
            self.waiting.clear();
            self.keep(frame - 1, last);
        }
        self.waiting.push(shape);
    }

    /// Keeps the last frame, so that the animation has the length of the clip.
    fn close(&mut self) {
        let Some(last) = self.waiting.pop() else { return };
        if self.stride > 1 {
            self.keep_after_waiting(self.numbers.len() - 1, last);
        } else {
            self.waiting.clear();
            self.keep(self.numbers.len() - 1, last);
        }
    }

    /// Keeps a shape, and records in `error` how far the waiting shapes deviate from the interpolation towards it.
    fn keep_after_waiting(&mut self, frame: usize, shape: MorphShape) {
        if let Some((first, from)) = self.frames.last().zip(self.shapes.last()) {
            let waiting = self.waiting.iter().zip(*first + 1..);
            let distances = waiting.map(|(s, at)| s.distance_between(from, &shape, self.share(*first, at, frame)));
            let most = distances.fold(0.0, f32::max);
            self.error = self.error.max(most);
        }
        self.waiting.clear();
        self.frames.push(frame);
        self.shapes.push(shape);
    }

    /// Keeps a shape; beyond `limit` bytes, raises the tolerance and drops the shapes that are no longer needed.
    fn keep(&mut self, frame: usize, shape: MorphShape) {
        self.bytes += self.target_bytes(&shape);
        self.frames.push(frame);
        self.shapes.push(shape);
        let most = self.budget.most;
        if self.bytes <= self.limit && self.shapes.len() <= most {
            return;
        }
        // Find the smallest tolerance that leaves few enough shapes. Before the error becomes visible, raise the limit
        // of a small mesh instead.
        let mut tolerance = self.tolerance.max(LEAST_TOLERANCE * self.diagonal);
        loop {
            if self.error + tolerance > MORPH_TOLERANCE * self.diagonal
                && self.limit < MORPH_BYTES
                && self.shapes.len() <= most
            {
                self.limit = MORPH_BYTES;
                if self.bytes <= self.limit {
                    return;
                }
            }
            let kept = self.needed(tolerance);
            let bytes: usize = kept.iter().map(|i| self.target_bytes(&self.shapes[*i])).sum();
            // Keep an eighth of the limits free, so that the next frame does not cause another thinning at once.
            let fits = bytes <= self.limit - self.limit / 8 && kept.len() <= most - most / 8;
            if fits || kept.len() < LEAST_TARGETS {
                self.bytes = bytes;
                self.thin_out(&kept, tolerance);
                return;
            }
            // The minimum ends the loop for a mesh without extent, whose points do not move.
            tolerance = (tolerance * 1.5).max(f32::MIN_POSITIVE);
        }
    }

    /// Indices of the shapes that are needed to restore the others within a tolerance, m: both ends, and greedily those between.
    fn needed(&self, tolerance: f32) -> Vec<usize> {
        let end = self.shapes.len() - 1;
        let mut kept = vec![0];
        let mut from = 0;
        for to in 2..=end {
            let restored = (from + 1..to).all(|i| {
                let share = self.share(self.frames[from], self.frames[i], self.frames[to]);
                self.shapes[i].lies_between(&self.shapes[from], &self.shapes[to], share, tolerance)
            });
            if !restored {
                from = to - 1;
                kept.push(from);
            }
        }
        kept.push(end);
        kept
    }

    /// Drops all shapes except those at the increasing indices `kept`, and adds `tolerance` to the error.
    fn thin_out(&mut self, kept: &[usize], tolerance: f32) {
        let mut index = 0..;
        self.shapes.retain(|_| index.next().is_some_and(|i: usize| kept.binary_search(&i).is_ok()));
        let mut index = 0..;
        self.frames.retain(|_| index.next().is_some_and(|i: usize| kept.binary_search(&i).is_ok()));
        // Frames dropped earlier were compared with shapes that are dropped now, so the errors add up.
        self.error += tolerance;
        self.tolerance = tolerance;
    }
}

impl ClipTracks {
    /// Tracks before the first frame.
    pub(super) fn new(scene: &Scene, options: &GltfOptions) -> Self {
        let assets = scene.assets.iter().map(|a| AssetTracks::new(a, scene, options)).collect();
        Self { assets, max_moving: options.nodes, ..Self::default() }
    }

    /// Whether no frame was added, so that the file has no animation.
    pub(super) fn is_still(&self) -> bool {
        self.times.is_empty()
    }

    /// Ends the clip with the frame that was added last, or, if it repeats, with the beginning of its next round.
    pub(super) fn close(&mut self, clip: Clip, options: &GltfOptions) {
        if let Some(end) = self.end_of_round(clip, options) {
            self.times.push(end);
            self.repeats = true;
        }
        self.assets.iter_mut().flat_map(|a| a.meshes.iter_mut().chain(&mut a.curves)).for_each(MorphFrames::close);
        self.assets.iter_mut().filter_map(|a| a.leaves.as_mut()).for_each(LeafShapes::close);
        // Curves are the paths of catkins. Interpolated coarsely they would be other paths, so coarse ones are dropped; an
        // interpolated tree remains plausible.
        self.assets.iter_mut().flat_map(|a| &mut a.curves).for_each(MorphFrames::drop_if_coarse);
    }

    /// Time of the frame after the last, s, if the motion repeats there and all frames of the clip were added, at equal
    /// intervals. A player that repeats an animation shows its last and its first key at the same moment: without a key
    /// there the motion would skip a frame in every round, and the round would be shorter than the clip. Blender
    /// repeats a range of frames instead.
    fn end_of_round(&self, clip: Clip, options: &GltfOptions) -> Option<f32> {
        let period = options.loop_frames.filter(|_| options.profile != Profile::Blender)? as usize;
        let [first, second, ..] = *self.numbers.as_slice() else { return None };
        let step = second.checked_sub(first)?;
        let even = self.numbers.windows(2).all(|w| w[0].checked_add(step) == Some(w[1]));
        let after = self.numbers.last()?.checked_add(step)?;
        let whole = first == clip.start && after == clip.end.saturating_add(1) && clip.len().is_multiple_of(period);
        (even && whole).then(|| osier_base::math::narrow(clip.seconds(after)))
    }

    /// Records the states of all assets at the next frame, and the time of that frame.
    pub(super) fn push(&mut self, scene: &Scene, frame: &Frame) {
        // Seconds in double precision, rounded once: accumulating 1 / fps in f32 would drift over a long clip.
        self.times.push(osier_base::math::narrow(scene.clip.seconds(frame.number)));
        self.numbers.push(frame.number);
        let rest = AssetFrame::default();
        for (i, (tracks, asset)) in self.assets.iter_mut().zip(&scene.assets).enumerate() {
            tracks.push(asset, frame.number, frame.assets.get(i).unwrap_or(&rest));
        }
    }
}

impl AssetTracks {
    fn new(asset: &Asset, scene: &Scene, options: &GltfOptions) -> Self {
        let mut moving = Vec::new();
        let leaves = LeafShapes::new(asset, scene, options);
        for (instancer, source) in asset.instancers.iter().enumerate() {
            let is_shape = leaves.as_ref().is_some_and(|leaves| leaves.holds(instancer));
            if source.motion == InstancerMotion::Free && !is_shape {
                moving.extend(source.ids.iter().enumerate().map(|(instance, id)| InstanceTrack {
                    key: mix64(&[scene.seed, *id]),
                    instancer,
                    instance,
                    positions: Vec::new(),
                    orientations: Vec::new(),
                    alive: Vec::new(),
                    sizes: Vec::new(),
                }));
            }
        }
        // The key is a hash of the instance's id: the same instances are written whatever the order in which they were emitted.
        moving.sort_by_key(|m| (m.key, m.instancer, m.instance));
        // Instances beyond the limit get no track, which bounds the memory: frames times instances would be held until the end.
        moving.truncate(options.nodes);
        let shapes = |deforms, rest: &[Vec3]| {
            let keys = || MorphKeys::new(rest, options.written_frames(scene.clip), options);
            if deforms { MorphFrames::Frames(keys()) } else { MorphFrames::Still }
        };
        let skinned = asset.skeleton.is_some();
        Self {
            poses: Vec::new(),
            moving,
            leaves,
            meshes: asset
                .meshes
                .iter()
                // A mesh that has a skin is animated by its joints and needs no morph targets.
                .map(|o| shapes(o.motion == MeshMotion::Deforming && !(skinned && o.skin.is_some()), &o.mesh.points))
                .collect(),
            curves: asset.curves.iter().map(|c| shapes(c.moving, &c.points)).collect(),
        }
    }

    /// Records the state of the asset at a frame. `number`: number of the frame in the clip.
    fn push(&mut self, asset: &Asset, number: u32, frame: &AssetFrame) {
        if let Some(leaves) = &mut self.leaves {
            leaves.push(asset, frame);
        }
        if let Some(skeleton) = &asset.skeleton {
            // A frame without a pose shows the skeleton at rest; the track still needs one entry for each key time.
            let posed = frame.pose.len() == skeleton.joints.len();
            self.poses.push(if posed { frame.pose.clone() } else { skeleton.rest_pose() });
        }
        let free = |i: &osier_scene::Instancer| i.motion == InstancerMotion::Free;
        for (i, instancer) in asset.instancers.iter().enumerate().filter(|(_, i)| free(i)) {
            let state = instance_states(asset, instancer, i, frame);
            for m in self.moving.iter_mut().filter(|m| m.instancer == i) {
                m.positions.push(state.positions[m.instance]);
                m.orientations.push(state.orientations[m.instance]);
                m.alive.push(state.is_alive(m.instance));
                m.sizes.push(state.size(m.instance));
            }
        }
        for (i, (shapes, object)) in self.meshes.iter_mut().zip(&asset.meshes).enumerate() {
            shapes.push(number, || match frame.mesh(i) {
                MeshFrame::Points { points, normals, .. } => MorphShape {
                    points: points.clone(),
                    normals: normals.clone(),
                    unseen: object.mesh.unseen_points(points),
                },
                _ => MorphShape {
                    points: object.mesh.points.clone(),
                    normals: object.mesh.normals.clone(),
                    unseen: Vec::new(),
                },
            });
        }
        for (i, (shapes, curves)) in self.curves.iter_mut().zip(&asset.curves).enumerate() {
            shapes.push(number, || {
                let points = match frame.curves(i) {
                    CurvesFrame::Points(points) => points.clone(),
                    CurvesFrame::Same => curves.points.clone(),
                };
                MorphShape { points, normals: Vec::new(), unseen: Vec::new() }
            });
        }
    }
}

impl MorphFrames {
    fn push(&mut self, number: u32, shape: impl FnOnce() -> MorphShape) {
        if let Self::Frames(keys) = self {
            keys.push(number, shape());
        }
    }

    fn close(&mut self) {
        if let Self::Frames(keys) = self {
            keys.close();
        }
    }

    /// Replaces shapes that are too coarse by [`Self::TooMany`], which holds none.
    fn drop_if_coarse(&mut self) {
        if matches!(self, Self::Frames(keys) if keys.error > CURVE_TOLERANCE * keys.diagonal) {
            *self = Self::TooMany;
        }
    }
}

impl InstanceTrack {
    /// Whether the factor on the scale differs between two frames of the clip, whether alive or not.
    pub(super) fn changes_size(&self) -> bool {
        self.sizes.windows(2).any(|w| w[0].to_bits() != w[1].to_bits())
    }

    /// Positions and orientations, with the first live state held before the instance is alive and the last one
    /// afterwards: no keys are spent on invisible motion.
    pub(super) fn hold_while_dead(&self) -> (Vec<Vec3>, Vec<Quat>) {
        let frames = self.held_frames();
        let positions = frames.iter().map(|&i| self.positions[i]).collect();
        (positions, frames.iter().map(|&i| self.orientations[i]).collect())
    }

    /// Factors on the scale, held as in [`InstanceTrack::hold_while_dead`].
    pub(super) fn sizes_while_dead(&self) -> Vec<f32> {
        self.held_frames().into_iter().map(|i| self.sizes[i]).collect()
    }

    /// For each frame the index of the frame whose state is written: the last live frame so far, or the first live one to come.
    fn held_frames(&self) -> Vec<usize> {
        let first = self.alive.iter().position(|a| *a).unwrap_or(0);
        // Before the first live frame the index stays at that frame; after the last one it stays at the last live frame.
        let mut source = first;
        let mut frames = Vec::with_capacity(self.alive.len());
        for (i, alive) in self.alive.iter().enumerate() {
            if *alive {
                source = i;
            }
            frames.push(source);
        }
        frames
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Options with floats and normals in targets.
    fn with_normals() -> GltfOptions {
        GltfOptions { profile: Profile::Engine, ..GltfOptions::default() }
    }

    #[test]
    fn frames_are_kept_where_interpolation_does_not_restore_them() {
        // A mesh with enough points for its targets to fill the budget.
        let rest = vec![Vec3::Y * 4.0; 80_000].into_iter().chain([Vec3::ZERO]).collect::<Vec<_>>();
        let keys = |rest: &[Vec3], frames: usize, place: fn(f32) -> f32| {
            let at = |i: usize| place(i as f32 / (frames - 1) as f32);
            let mut morph = MorphKeys::new(rest, frames, &with_normals());
            for (number, i) in (1..).zip(0..frames) {
                let points = vec![Vec3::ZERO, Vec3::Y * at(i)];
                morph.push(number, MorphShape { normals: vec![Vec3::Y; 2], points, unseen: Vec::new() });
            }
            morph.close();
            // The stated error holds at every frame.
            for i in 0..frames {
                let b = morph.frames.iter().position(|f| *f >= i).expect("the last frame is kept").max(1);
                let [from, to] = [morph.frames[b - 1], morph.frames[b]];
                let share = (i - from) as f32 / (to - from) as f32;
                let shown = morph.shapes[b - 1].points[1].lerp(morph.shapes[b].points[1], share).y;
                assert!(
                    (shown - at(i)).abs() <= morph.error + 1e-5,
                    "frame {i}: {shown}, not {}, {}",
                    at(i),
                    morph.error
                );
            }
            assert_eq!((morph.frames.first(), morph.frames.last()), (Some(&0), Some(&(frames - 1))));
            morph
        };
        let growth = |t: f32| 4.0 * t * t;
        assert_eq!(keys(&rest, 20, growth).frames, (0..20).collect::<Vec<_>>());
        let kept = keys(&rest, 120, growth);
        assert!(
            kept.frames.len() <= MORPH_TARGETS && kept.error < 0.04 && !kept.is_coarse(),
            "{} {}",
            kept.frames.len(),
            kept.error
        );
        // Growth in a few straight steps needs no more shapes than these, wherever they lie.
        let steps = |t: f32| (t * 7.3).min(1.0) + (t * 3.1 - 1.0).clamp(0.0, 2.0);
        let kept = keys(&rest, 240, steps);
        assert!(kept.frames.len() < 32 && kept.error < 0.02, "{:?} {}", kept.frames, kept.error);
        // Motion that is too irregular for the budget is written anyway, and its error is stated as coarse.
        let sway = |t: f32| 3.0 + osier_base::math::sin_f32(90.0 * t);
        let kept = keys(&rest, 120, sway);
        assert!(kept.is_coarse() && (8..=MORPH_TARGETS + 1).contains(&kept.frames.len()), "{:?}", kept.frames);
        // A small mesh keeps every frame, and one of more points than the budget holds has shapes without normals.
        assert_eq!(keys(&[Vec3::ZERO, Vec3::Y * 4.0], 120, sway).frames.len(), 120);
        let large = vec![Vec3::Y * 4.0; 200_000].into_iter().chain([Vec3::ZERO]).collect::<Vec<_>>();
        let kept = keys(&large, 120, growth);
        assert!(kept.shapes.iter().all(|s| s.normals.is_empty()) && kept.frames.len() >= 8, "{}", kept.frames.len());
        // One of very many points has evenly spaced shapes, and the error is that of the worst frame.
        let huge = vec![Vec3::Y * 4.0; 600_000].into_iter().chain([Vec3::ZERO]).collect::<Vec<_>>();
        let kept = keys(&huge, 120, growth);
        assert_eq!(kept.frames, (0..120).step_by(5).chain([119]).collect::<Vec<_>>());
        assert!(kept.error > 0.001 && kept.error < 0.02, "{}", kept.error);
    }

    #[test]
    fn shapes_are_interpolated_by_time_where_frames_are_selected_unevenly() {
        // Frames 1, 2, 11, 12, 21, 22 ... of a clip, and so many points that few frames are kept.
        let numbers: Vec<u32> = (0..60).flat_map(|pair| [1 + 10 * pair, 2 + 10 * pair]).collect();
        let morph = |points: usize, height: &dyn Fn(usize) -> f32| {
            let rest = vec![Vec3::Y * 4.0; points].into_iter().chain([Vec3::ZERO]).collect::<Vec<_>>();
            let mut morph = MorphKeys::new(&rest, numbers.len(), &with_normals());
            for (i, number) in numbers.iter().enumerate() {
                let points = vec![Vec3::ZERO, Vec3::Y * height(i)];
                morph.push(*number, MorphShape { normals: Vec::new(), points, unseen: Vec::new() });
            }
            morph.close();
            morph
        };
        // A mesh whose frames are kept where they are needed, and one whose frames are kept at equal distances.
        for points in [80_000, 600_000] {
            // Interpolation restores a motion of constant speed.
            let even = morph(points, &|i: usize| 4.0 * numbers[i] as f32 / 600.0);
            assert!(even.frames.len() < numbers.len() && even.error < 0.0022, "{:?} {}", even.frames, even.error);
            // A motion of equal steps from frame to frame is not restored where frames are missing: the stated error is that
            // of readers, which interpolate in time.
            let by_frame = |i: usize| 4.0 * i as f32 / numbers.len() as f32;
            let kept = morph(points, &by_frame);
            assert!(kept.frames.len() < numbers.len(), "{:?}", kept.frames);
            for i in 0..numbers.len() {
                let b = kept.frames.iter().position(|f| *f >= i).expect("the last frame is kept").max(1);
                let [from, to] = [kept.frames[b - 1], kept.frames[b]];
                let share = (numbers[i] - numbers[from]) as f32 / (numbers[to] - numbers[from]) as f32;
                let shown = kept.shapes[b - 1].points[1].lerp(kept.shapes[b].points[1], share).y;
                let off = (shown - by_frame(i)).abs();
                assert!(off <= kept.error + 1e-5, "{points} points, frame {i}: {off} m, not {} m", kept.error);
            }
        }
    }

    #[test]
    fn the_estimate_counts_normals_where_targets_have_them() {
        let options = with_normals();
        for (points, frames) in [(1000, 120), (100_000, 40)] {
            let rest: Vec<Vec3> = (0..points).map(|i| Vec3::Y * (i as f32 / points as f32)).collect();
            let mut morph = MorphKeys::new(&rest, frames, &options);
            for (number, frame) in (1..).zip(0..frames) {
                let sway = Vec3::X * osier_base::math::sin_f32(frame as f32);
                let points = rest.iter().map(|p| *p + sway).collect();
                morph.push(number, MorphShape { points, normals: vec![Vec3::Y; rest.len()], unseen: Vec::new() });
            }
            morph.close();
            let written: usize = morph.shapes.iter().map(|s| (s.points.len() + s.normals.len()) * 12).sum();
            let estimated = estimate(points as u64, 1, frames as u64, &options);
            let near = (written as f64 / estimated as f64 - 1.0).abs() < 0.05;
            assert!(near, "{points} points, {} shapes: {written} bytes, estimated {estimated}", morph.shapes.len());
            assert_eq!(points < 80_000, morph.shapes.iter().all(|s| !s.normals.is_empty()));
            // Two meshes of half as many points each have the budget of both.
            assert!(estimate(points as u64, 2, frames as u64, &options) >= estimated);
        }
    }

    #[test]
    fn the_dead_hold_their_last_state_and_the_unborn_their_first() {
        let p = |x: f32| Vec3::new(x, 0.0, 0.0);
        let m = InstanceTrack {
            key: 0,
            instancer: 0,
            instance: 0,
            positions: [9.0, 1.0, 2.0, 8.0, 7.0].map(p).to_vec(),
            orientations: vec![Quat::IDENTITY; 5],
            alive: vec![false, true, true, false, false],
            sizes: vec![1.0; 5],
        };
        assert_eq!(m.hold_while_dead().0, [1.0, 1.0, 2.0, 2.0, 2.0].map(p));
    }
}
