//! The animation of a clip, gathered frame by frame and held until the end: a sampler's keys are contiguous in the buffer.

use glam::{Quat, Vec3};

use osier_base::rng::mix64;
use osier_scene::{
    Asset, AssetFrame, CurvesFrame, Frame, InstancerMotion, MeshFrame, MeshMotion, Scene, Trs, instance_states,
};

/// Morph targets that every mesh may have. Own: each target is a copy of its positions and normals, and importers hold all of them.
const MORPH_TARGETS: usize = 32;
/// A mesh may have more, up to the second number, while all of its targets take less than the first, bytes. Own: small meshes that
/// move irregularly, as trees that grow year by year, keep every frame of a clip of five seconds.
const MORPH_BUDGET: [usize; 2] = [64 << 20, 256];
/// Bytes of a point in a target: position and normal.
const MORPH_POINT_BYTES: usize = 24;
/// Where a clip has more frames than targets, most that a point may lie off its place between two of them, as a share of the
/// diagonal of the mesh's box. Own: a vine that grows over 120 frames stays below 0.013, at its tips; a tree of which each frame adds
/// a fortieth of its height needs 0.05, which would show, as swaying would.
const MORPH_TOLERANCE: f32 = 0.02;

/// The animation of all assets.
#[derive(Debug, Default)]
pub(super) struct ClipTracks {
    /// Time of each frame, s, from the start of the clip.
    pub times: Vec<f32>,
    /// Number of each frame.
    pub numbers: Vec<u32>,
    /// In the order of the scene's assets.
    pub assets: Vec<AssetTracks>,
    /// Most moving instances in a file.
    pub max_moving: usize,
}

/// The animation of one asset.
#[derive(Debug, Default)]
pub(super) struct AssetTracks {
    /// For each frame the transform of each joint to its parent's space.
    pub poses: Vec<Vec<Trs>>,
    /// Moving instances, sorted by (key, instancer, index).
    pub moving: Vec<InstanceTrack>,
    /// For each mesh of the asset.
    pub meshes: Vec<MorphFrames>,
    /// For each curves primitive of the asset; points only.
    pub curves: Vec<MorphFrames>,
}

/// The states of one moving instance at all frames.
#[derive(Debug)]
pub(super) struct InstanceTrack {
    /// hash(seed, id): those of the smallest keys are written if there are too many.
    pub key: u64,
    /// Index of the instancer in the asset.
    pub instancer: usize,
    /// Index of the instance in the instancer.
    pub instance: usize,
    pub positions: Vec<Vec3>,
    pub orientations: Vec<Quat>,
    pub alive: Vec<bool>,
    /// Factors on the instance's scale.
    pub sizes: Vec<f32>,
}

/// Points and normals of a mesh at a frame; normals may be missing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MorphShape {
    pub points: Vec<Vec3>,
    pub normals: Vec<Vec3>,
}

impl MorphShape {
    /// Whether all points lie within `tolerance`, m, of those at `share` of the way between two shapes.
    fn lies_between(&self, from: &Self, to: &Self, share: f32, tolerance: f32) -> bool {
        let mut ways = self.points.iter().zip(&from.points).zip(&to.points);
        ways.all(|((p, a), b)| p.distance(a.lerp(*b, share)) <= tolerance)
    }
}

/// The shapes of one mesh at all frames.
#[derive(Debug, Default)]
pub(super) enum MorphFrames {
    /// It does not deform.
    #[default]
    Still,
    Frames(MorphKeys),
    /// More shapes are needed than [`MorphKeys::most`]; none is kept.
    TooMany,
}

/// Shapes of a mesh at evenly spaced frames and at the last one: of all frames while these are at most [`MORPH_TARGETS`], else of every
/// second, fourth and so on where that suffices. Readers interpolate between them; each halving moves a point by [`MORPH_TOLERANCE`] at most.
#[derive(Debug)]
pub(super) struct MorphKeys {
    /// Indices of the frames that are kept, rising.
    pub frames: Vec<usize>,
    /// Shapes of the mesh at these frames.
    pub shapes: Vec<MorphShape>,
    /// Every n-th frame is kept.
    stride: usize,
    /// Number of frames so far.
    seen: usize,
    /// Shapes since the last one kept.
    skipped: Vec<MorphShape>,
    /// Most that a skipped shape may lie off the interpolated one, m.
    tolerance: f32,
    /// Most shapes of a mesh of its size.
    most: usize,
}

/// Morph targets of a mesh: the shapes of some frames.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MorphTrack<'a> {
    /// Indices of the frames, rising.
    pub frames: &'a [usize],
    /// Shapes of the mesh at these frames.
    pub shapes: &'a [MorphShape],
}

impl MorphKeys {
    /// All shapes that are kept.
    pub fn track(&self) -> MorphTrack<'_> {
        MorphTrack { frames: &self.frames, shapes: &self.shapes }
    }

    /// `rest`: points of the mesh at rest.
    fn new(rest: &[Vec3]) -> Self {
        let diagonal = osier_base::geometry::Bounds::of(rest.iter().copied()).size().length();
        Self {
            frames: Vec::new(),
            shapes: Vec::new(),
            stride: 1,
            seen: 0,
            skipped: Vec::new(),
            tolerance: MORPH_TOLERANCE * diagonal,
            most: (MORPH_BUDGET[0] / (MORPH_POINT_BYTES * rest.len().max(1))).clamp(MORPH_TARGETS, MORPH_BUDGET[1]),
        }
    }

    /// Takes the shape of the next frame; false if the kept shapes do not suffice.
    fn push(&mut self, shape: MorphShape) -> bool {
        // Kept frames are the multiples of the stride; those between are held until the next one shows whether they can be dropped.
        let frame = self.seen;
        self.seen += 1;
        if frame.is_multiple_of(self.stride) {
            return self.keep(frame, shape);
        }
        self.skipped.push(shape);
        true
    }

    /// Keeps a shape if those skipped before it lie on the way to it. One shape too many halves their number.
    fn keep(&mut self, frame: usize, shape: MorphShape) -> bool {
        let skipped = std::mem::take(&mut self.skipped);
        let on_the_way = self.frames.last().zip(self.shapes.last()).is_none_or(|(first, from)| {
            let share = |i: usize| (i + 1) as f32 / (frame - first) as f32;
            skipped.iter().enumerate().all(|(i, s)| s.lies_between(from, &shape, share(i), self.tolerance))
        });
        self.frames.push(frame);
        self.shapes.push(shape);
        // Up to MORPH_TARGETS shapes always fit. Beyond, every second one is dropped if the motion allows it, else small meshes may have more.
        on_the_way && (self.shapes.len() <= MORPH_TARGETS || self.thin_out() || self.shapes.len() <= self.most)
    }

    /// Drops every second of an odd number of shapes if they lie between their neighbours.
    fn thin_out(&mut self) -> bool {
        if self.shapes.len().is_multiple_of(2) {
            return false;
        }
        let between = |i: usize| {
            let [a, b, c] = [i - 1, i, i + 1].map(|k| self.frames[k]);
            let share = (b - a) as f32 / (c - a) as f32;
            self.shapes[i].lies_between(&self.shapes[i - 1], &self.shapes[i + 1], share, self.tolerance)
        };
        if !(1..self.shapes.len() - 1).step_by(2).all(between) {
            return false;
        }
        let mut index = 0..;
        self.shapes.retain(|_| index.next().is_some_and(|i: usize| i.is_multiple_of(2)));
        let mut index = 0..;
        self.frames.retain(|_| index.next().is_some_and(|i: usize| i.is_multiple_of(2)));
        self.stride *= 2;
        true
    }

    /// Keeps the last frame; false as for [`MorphKeys::push`].
    fn close(&mut self) -> bool {
        // The clip must end with its last shape, even where that is no multiple of the stride.
        let Some(last) = self.skipped.pop() else { return true };
        self.keep(self.seen - 1, last)
    }
}

impl ClipTracks {
    /// No frames yet. `max_moving`: most moving instances in a file.
    pub(super) fn new(scene: &Scene, max_moving: usize) -> Self {
        let assets = scene.assets.iter().map(|a| AssetTracks::new(a, scene.seed, max_moving)).collect();
        Self { assets, max_moving, ..Self::default() }
    }

    /// Whether no frame was added, so that the file has no animation.
    pub(super) fn is_still(&self) -> bool {
        self.times.is_empty()
    }

    /// Ends the clip with the frame that was added last.
    pub(super) fn close(&mut self) {
        self.assets.iter_mut().flat_map(|a| a.meshes.iter_mut().chain(&mut a.curves)).for_each(MorphFrames::close);
    }

    /// Adds the states of all assets at a frame.
    pub(super) fn push(&mut self, scene: &Scene, frame: &Frame) {
        // Seconds in double precision, rounded once: accumulating 1 / fps in f32 would drift over a long clip.
        self.times.push(osier_base::math::narrow(scene.clip.seconds(frame.number)));
        self.numbers.push(frame.number);
        let rest = AssetFrame::default();
        for (i, (tracks, asset)) in self.assets.iter_mut().zip(&scene.assets).enumerate() {
            tracks.push(asset, frame.assets.get(i).unwrap_or(&rest));
        }
    }
}

impl AssetTracks {
    fn new(asset: &Asset, seed: u64, max_moving: usize) -> Self {
        let mut moving = Vec::new();
        for (instancer, source) in asset.instancers.iter().enumerate() {
            if source.motion == InstancerMotion::Free {
                moving.extend(source.ids.iter().enumerate().map(|(instance, id)| InstanceTrack {
                    key: mix64(&[seed, *id]),
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
        moving.truncate(max_moving);
        let shapes = |deforms, rest: &[Vec3]| {
            if deforms { MorphFrames::Frames(MorphKeys::new(rest)) } else { MorphFrames::Still }
        };
        let skinned = asset.skeleton.is_some();
        Self {
            poses: Vec::new(),
            moving,
            meshes: asset
                .meshes
                .iter()
                // A mesh that has a skin is animated by its joints and needs no morph targets.
                .map(|o| shapes(o.motion == MeshMotion::Deforming && !(skinned && o.skin.is_some()), &o.mesh.points))
                .collect(),
            curves: asset.curves.iter().map(|c| shapes(c.moving, &c.points)).collect(),
        }
    }

    fn push(&mut self, asset: &Asset, frame: &AssetFrame) {
        if let Some(skeleton) = &asset.skeleton {
            // A frame without a pose shows the skeleton at rest; the track needs an entry all the same, one for each key time.
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
            shapes.push(|| match frame.mesh(i) {
                MeshFrame::Points { points, normals, .. } => {
                    MorphShape { points: points.clone(), normals: normals.clone() }
                }
                _ => MorphShape { points: object.mesh.points.clone(), normals: object.mesh.normals.clone() },
            });
        }
        for (i, (shapes, curves)) in self.curves.iter_mut().zip(&asset.curves).enumerate() {
            shapes.push(|| {
                let points = match frame.curves(i) {
                    CurvesFrame::Points(points) => points.clone(),
                    CurvesFrame::Same => curves.points.clone(),
                };
                MorphShape { points, normals: Vec::new() }
            });
        }
    }
}

impl MorphFrames {
    fn push(&mut self, shape: impl FnOnce() -> MorphShape) {
        // The shapes gathered so far are released as soon as they do not suffice.
        if let Self::Frames(keys) = self
            && !keys.push(shape())
        {
            *self = Self::TooMany;
        }
    }

    fn close(&mut self) {
        if let Self::Frames(keys) = self
            && !keys.close()
        {
            *self = Self::TooMany;
        }
    }
}

impl InstanceTrack {
    /// Whether the size of the instance changes while it is alive.
    pub(super) fn changes_size(&self) -> bool {
        self.sizes.windows(2).any(|w| w[0].to_bits() != w[1].to_bits())
    }

    /// Positions and orientations in which an instance holds its first state before it is alive, and its last one afterwards: no
    /// keys are spent on motion that is not visible.
    pub(super) fn hold_while_dead(&self) -> (Vec<Vec3>, Vec<Quat>) {
        let frames = self.held_frames();
        let positions = frames.iter().map(|&i| self.positions[i]).collect();
        (positions, frames.iter().map(|&i| self.orientations[i]).collect())
    }

    /// Factors on the scale, held as the positions of [`InstanceTrack::hold_while_dead`] are.
    pub(super) fn sizes_while_dead(&self) -> Vec<f32> {
        self.held_frames().into_iter().map(|i| self.sizes[i]).collect()
    }

    /// For each frame the one whose state is written.
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

    #[test]
    fn smooth_motion_of_many_frames_is_kept_at_some_and_swaying_is_not() {
        // A mesh of so many points that its targets fill the budget.
        let rest = vec![Vec3::Y * 4.0; 200_000].into_iter().chain([Vec3::ZERO]).collect::<Vec<_>>();
        let shapes = |rest: &[Vec3], frames: usize, place: fn(f32) -> f32| {
            let at = |i: usize| place(i as f32 / (frames - 1) as f32);
            let mut morph = MorphFrames::Frames(MorphKeys::new(rest));
            for i in 0..frames {
                morph.push(|| MorphShape { points: vec![Vec3::ZERO, Vec3::Y * at(i)], normals: Vec::new() });
            }
            morph.close();
            match morph {
                MorphFrames::Frames(keys) => Some(keys.frames),
                _ => None,
            }
        };
        let growth = |t: f32| 4.0 * t * t;
        assert_eq!(shapes(&rest, 20, growth).expect("kept"), (0..20).collect::<Vec<_>>());
        let kept = shapes(&rest, 120, growth).expect("kept");
        assert!(kept.len() <= MORPH_TARGETS && kept.first() == Some(&0) && kept.last() == Some(&119), "{kept:?}");
        let sway = |t: f32| 3.0 + osier_base::math::sin_f32(90.0 * t);
        assert!(shapes(&rest, 120, sway).is_none());
        // A small mesh keeps every frame.
        assert_eq!(shapes(&[Vec3::ZERO, Vec3::Y * 4.0], 120, sway).expect("kept").len(), 120);
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
