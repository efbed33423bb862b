//! Estimates the bytes of the time samples of growing plants. The share of omitted samples is measured in a few windows
//! of the clip.

use super::asset::{GROWTH_PIXELS, deforms_without_skeleton};
use super::instancer::{DueSamples, InstanceReducers, InstanceSample};
use super::mesh::point_reducer;
use super::options::UsdOptions;
use super::sample_reduction::{MAX_GAP, SampleReducer, TimeSample};
use crate::estimate::{EstimateInput, GrowthFrames, sample_place};
use glam::{Quat, Vec3};
use osier_base::par::par_map;
use osier_scene::{Asset, AssetFrame, MeshFrame, MeshMotion, PixelFootprint, instance_states};

/// Most windows of the clip that are evaluated per plant. Own: samples are denser while a plant is young and grows fast.
const WINDOWS: usize = 3;
/// Most windows that are evaluated for all plants together, though at least one per plant.
const WINDOWS_OF_ALL: usize = 24;
/// Frames of a window: an attribute without a second sample within these is at rest.
const WINDOW_FRAMES: u64 = MAX_GAP as u64 + 2;
/// Longest clip that is evaluated as a whole, frames. Own: about as many frames as several windows have.
const WHOLE_FRAMES: u64 = 32;
/// Bytes of a rotation in half precision.
const QUATH_BYTES: usize = 8;

/// For each asset the bytes of the time samples that a bake writes; `None` for an asset that does not grow.
pub(super) fn growth_sample_bytes(input: &EstimateInput) -> Vec<Option<u64>> {
    let (scene, frames) = (input.scene, input.frames);
    let mut bytes = vec![None; input.assets.len()];
    let growing: Vec<usize> = (0..scene.assets.len()).filter(|i| deforms_without_skeleton(&scene.assets[*i])).collect();
    let Some(source) = input.growth.filter(|_| frames > 1 && !growing.is_empty()) else { return bytes };
    let is_whole = frames <= WHOLE_FRAMES;
    let windows = if is_whole { 1 } else { (WINDOWS_OF_ALL / growing.len()).clamp(1, WINDOWS) };
    let pixels = PixelFootprint::of_assets(scene);
    let window_of = |job: usize| {
        let (plant, window) = (job / windows, job % windows);
        let first = whole(sample_place(plant, window, windows) * frames.saturating_sub(WINDOW_FRAMES) as f64);
        let [first, end] = if is_whole { [0, frames] } else { [first, frames.min(first + WINDOW_FRAMES)] };
        let asset = growing[plant];
        FrameWindow { asset, first, end, is_whole, pixel: GROWTH_PIXELS * pixels[asset] }
    };
    let jobs: Vec<FrameWindow> = (0..growing.len() * windows).map(window_of).collect();
    let found =
        par_map(&jobs, |window| window.bytes_per_frame(&scene.assets[window.asset], &input.options.usd, source));
    for (asset, of_asset) in growing.iter().zip(found.chunks(windows)) {
        let sum: Option<f64> = of_asset.iter().copied().sum();
        bytes[*asset] = sum.map(|sum| whole(sum / windows as f64 * frames as f64));
    }
    bytes
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bytes and frames, not negative")]
pub(super) fn whole(value: f64) -> u64 {
    value.round() as u64
}

/// Some successive frames of an asset.
struct FrameWindow {
    asset: usize,
    /// Index of the first frame, among the written frames.
    first: u64,
    /// Index of the frame after the last one, among the written frames.
    end: u64,
    /// Whether the window contains all frames of the clip.
    is_whole: bool,
    /// Length of a pixel at the asset, m, times the tolerance factor for growth.
    pixel: f32,
}

impl FrameWindow {
    /// Bytes of time samples for each frame; `None` if the asset has no frames.
    fn bytes_per_frame(&self, asset: &Asset, options: &UsdOptions, source: &dyn GrowthFrames) -> Option<f64> {
        let mut reduction = AssetReduction::new(asset, options, self.pixel);
        for nth in self.first..self.end {
            reduction.push(&source.frame(self.asset, nth)?, nth as f64);
        }
        if !self.is_whole {
            return Some(reduction.counts().map(|counts| counts.bytes_per_frame()).sum());
        }
        reduction.finish();
        let all: u64 = reduction.counts().map(|counts| counts.bytes * counts.count).sum();
        Some(all as f64 / (self.end - self.first) as f64)
    }
}

/// Samples of one attribute.
#[derive(Debug, Default, Clone, Copy)]
struct SampleCounts {
    /// Bytes of one sample.
    bytes: u64,
    /// Times of the first and the last sample, in frames.
    span: Option<[f64; 2]>,
    /// Number of samples that differ from the one before.
    count: u64,
}

impl SampleCounts {
    /// Mean bytes of samples per frame between the first and the last sample; 0 for an attribute at rest, which has one
    /// sample.
    fn bytes_per_frame(&self) -> f64 {
        let Some([first, last]) = self.span.filter(|span| span[1] > span[0]) else { return 0.0 };
        self.bytes as f64 * (self.count - 1) as f64 / (last - first)
    }
}

/// Samples of one attribute, and the values of the last one.
#[derive(Default)]
struct AttributeSamples<T> {
    counts: SampleCounts,
    last: Vec<T>,
}

impl<T: PartialEq> AttributeSamples<T> {
    /// Counts a sample that must be written. `element`: bytes of an element of the array.
    fn add(&mut self, due: Option<TimeSample<T>>, element: usize) {
        let Some(TimeSample { time, values, .. }) = due else { return };
        let counts = &mut self.counts;
        counts.bytes = (values.len() * element) as u64;
        counts.span = Some([counts.span.map_or(time, |span| span[0]), time]);
        // Crate files store equal arrays once.
        counts.count += u64::from(counts.count == 0 || values != self.last);
        self.last = values;
    }
}

/// The reducers of an asset's attributes, whose samples are counted and not written.
struct AssetReduction<'a> {
    asset: &'a Asset,
    options: &'a UsdOptions,
    meshes: Vec<MeshReduction>,
    instancers: Vec<InstancerReduction>,
}

/// A mesh whose points move.
struct MeshReduction {
    /// Index in the asset.
    index: usize,
    reducer: SampleReducer<Vec3>,
    samples: AttributeSamples<Vec3>,
}

/// The reducers of an instancer, and its samples so far.
struct InstancerReduction {
    reducers: InstanceReducers,
    /// Orientations of the frame before.
    before: Vec<Quat>,
    positions: AttributeSamples<Vec3>,
    orientations: AttributeSamples<Quat>,
    scales: AttributeSamples<Vec3>,
}

impl<'a> AssetReduction<'a> {
    /// `pixel`: see [`FrameWindow::pixel`].
    fn new(asset: &'a Asset, options: &'a UsdOptions, pixel: f32) -> Self {
        let moving = asset.meshes.iter().enumerate().filter(|(_, object)| object.motion == MeshMotion::Deforming);
        let mesh = |index| MeshReduction {
            index,
            reducer: point_reducer(&options.tolerance, pixel),
            samples: AttributeSamples::default(),
        };
        let instancer = |instancer| InstancerReduction {
            reducers: InstanceReducers::new(&options.tolerance, instancer, pixel),
            before: Vec::new(),
            positions: AttributeSamples::default(),
            orientations: AttributeSamples::default(),
            scales: AttributeSamples::default(),
        };
        Self {
            asset,
            options,
            meshes: moving.map(|(index, _)| mesh(index)).collect(),
            instancers: asset.instancers.iter().map(instancer).collect(),
        }
    }

    /// Takes a frame, as the prims of the asset do.
    fn push(&mut self, frame: &AssetFrame, time: f64) {
        let (asset, up) = (self.asset, self.options.up);
        for MeshReduction { index, reducer, samples } in &mut self.meshes {
            let mesh = &asset.meshes[*index].mesh;
            let points = match frame.mesh(*index) {
                MeshFrame::Points { points, .. } => points,
                _ => &mesh.points,
            };
            let values = up.stage_vecs(points).into_owned();
            let unseen = mesh.unseen_points(&values);
            samples.add(reducer.push(TimeSample { time, values, unseen }), size_of::<Vec3>());
        }
        for (i, (reduction, instancer)) in self.instancers.iter_mut().zip(&asset.instancers).enumerate() {
            let state = instance_states(asset, instancer, i, frame);
            let sample = InstanceSample::of(up, instancer, &state, &reduction.before, time);
            let due = reduction.reducers.push(&sample);
            reduction.before = sample.into_orientations();
            reduction.count_due_samples(due);
        }
    }

    /// Ends the clip.
    fn finish(&mut self) {
        for mesh in &mut self.meshes {
            mesh.samples.add(mesh.reducer.finish(), size_of::<Vec3>());
        }
        for instancer in &mut self.instancers {
            let due = instancer.reducers.finish();
            instancer.count_due_samples(due);
        }
    }

    fn counts(&self) -> impl Iterator<Item = SampleCounts> {
        let of_instancer = |i: &InstancerReduction| [i.positions.counts, i.orientations.counts, i.scales.counts];
        self.meshes.iter().map(|m| m.samples.counts).chain(self.instancers.iter().flat_map(of_instancer))
    }
}

impl InstancerReduction {
    fn count_due_samples(&mut self, due: DueSamples) {
        self.positions.add(due.positions, size_of::<Vec3>());
        self.orientations.add(due.orientations, QUATH_BYTES);
        self.scales.add(due.scales, size_of::<Vec3>());
    }
}
