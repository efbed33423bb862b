//! Estimates of a run: counts, sizes of files and memory, from an assembled scene without writing it.

use std::sync::Arc;

use crate::bake::motion::{AssetMotion, FrameTime};
use crate::bake::output::bake_estimate::BakeEstimate;
use crate::bake::output::exporters::export_options;
use crate::bake::output::memory::{AnimatedCounts, predict_memory};
use crate::bake::output::texture_bytes::{half_float_heights, png_bytes};
use crate::bake::output::texture_size::texture_halvings;
use crate::bake::scene::animated::AnimatedScene;
use crate::recipe::Recipe;
use osier_base::convert::{limit, saturating_index};
use osier_export::estimate::{AssetSize, EstimateInput, GrowthFrames};
use osier_export::format::{FormatInfo, TextureUse};
use osier_export::options::ExportOptions;
use osier_scene::{AssetFrame, Scene};

/// Estimates a bake that writes `frames` frames of the scene `stage` in all formats of the recipe.
/// `weights`: number of assets that each of the first assets represents, itself included; 1 for assets beyond its end.
/// `rained_leaves`: number of leaves of all plants that drops of rain can strike.
pub fn estimate(
    stage: &AnimatedScene,
    recipe: &Recipe,
    frames: u64,
    weights: &[u64],
    rained_leaves: u64,
) -> BakeEstimate {
    let formats: Vec<&FormatInfo> = recipe.output.keys.formats.iter().map(|f| f.0).collect();
    estimate_formats(
        stage,
        recipe,
        &export_options(recipe),
        &EstimateJob { formats: &formats, frames, weights, rained_leaves, single: false },
    )
}

/// Formats, frames and weights of an estimate.
pub(crate) struct EstimateJob<'a> {
    /// Formats to predict sizes for, in the order of [`BakeEstimate::sizes`].
    pub(crate) formats: &'a [&'static FormatInfo],
    /// Frames that are written; 0 for a still scene.
    pub(crate) frames: u64,
    /// Number of assets that each of the first assets represents, itself included.
    pub(crate) weights: &'a [u64],
    /// Leaves of all plants that drops of rain can strike.
    pub(crate) rained_leaves: u64,
    /// Whether one file holds the whole scene, as `osier grow` writes it, instead of a bake's folder.
    pub(crate) single: bool,
}

/// Estimates the scene `stage` written in the formats of `job`.
pub(crate) fn estimate_formats(
    stage: &AnimatedScene,
    recipe: &Recipe,
    options: &ExportOptions,
    job: &EstimateJob,
) -> BakeEstimate {
    let scene = &stage.scene;
    let assets = AssetSize::of_scene(scene, job.frames, job.weights);
    let halvings = if job.single { vec![0; scene.images.len()] } else { texture_halvings(recipe, scene) };
    let png = png_bytes(scene, &halvings);
    let pictures = png.iter().sum();
    let heights = half_float_heights(scene, &halvings, &png);
    let growth = ClipOfGrowth { stage, frames: job.frames };
    let input = EstimateInput {
        scene,
        assets: &assets,
        frames: job.frames,
        wind_speed: leaf_wind_speed(recipe),
        pictures,
        heights,
        options,
        single: job.single,
        growth: Some(&growth),
    };
    let mut c = BakeEstimate {
        assets: assets.iter().map(|a| a.weight).sum(),
        placements: scene.placements.len() as u64,
        vertices: input.per_asset(|a| a.vertices + a.prototype_vertices),
        triangles: input.per_asset(|a| a.triangles + a.prototype_triangles),
        instances: input.per_asset(|a| a.instances),
        points: input.per_asset(|a| a.points),
        joints: input.per_asset(|a| a.joints),
        frames: job.frames,
        ..BakeEstimate::default()
    };
    c.sizes = job.formats.iter().map(|f| (f.word, (f.estimate)(&input))).collect();
    // A bake has one copy of the pictures for all formats; some formats embed them or have none.
    let has_files = |f: &&FormatInfo| {
        if job.single { pictures > 0 && f.pictures_beside } else { f.textures == TextureUse::Written }
    };
    if job.formats.iter().any(has_files) {
        c.sizes.push(("pictures", pictures));
    }
    let wind = estimate_wind_bytes(scene, job.frames);
    c.sizes.extend((wind > 0).then_some(("wind", wind)));
    c.bytes = c.sizes.iter().map(|s| s.1).sum();
    // Frames of growing plants are made one by one from their skeletons.
    let is_posed = |motion: &Option<Arc<dyn AssetMotion>>| motion.as_ref().is_some_and(|motion| !motion.is_growth());
    let posed = assets.iter().zip(&stage.motions).filter(|(_, motion)| is_posed(motion));
    let keeps_year_record =
        |motion: &Option<Arc<dyn AssetMotion>>| motion.as_ref().is_some_and(|motion| motion.keeps_year_record());
    let years =
        || assets.iter().zip(&stage.motions).filter(|(_, motion)| keeps_year_record(motion)).map(|(asset, _)| asset);
    let carried = AnimatedCounts {
        posed_vertices: posed.map(|(asset, _)| asset.weight * asset.deforming_vertices).sum(),
        growing_elements: years().map(|asset| asset.weight * (asset.vertices + asset.triangles)).sum(),
        growing_leaves: years().map(|asset| asset.weight * asset.instances).sum(),
        rained_leaves: job.rained_leaves,
    };
    c.memory = predict_memory(scene, job.formats, recipe, &c, carried);
    c
}

/// The written frames of a scene, as estimates evaluate those of growth.
#[derive(Debug)]
struct ClipOfGrowth<'a> {
    stage: &'a AnimatedScene,
    /// Number of written frames, evenly spaced over the clip.
    frames: u64,
}

impl GrowthFrames for ClipOfGrowth<'_> {
    fn frame(&self, asset: usize, nth: u64) -> Option<AssetFrame> {
        let scene = &self.stage.scene;
        let motion = self.stage.motions.get(asset)?.as_ref().filter(|motion| motion.is_growth())?;
        let frame = nth.saturating_mul(scene.clip.len() as u64) / self.frames.max(1);
        let number = scene.clip.start.saturating_add(saturating_index(limit(frame)));
        motion.frame(scene.assets.get(asset)?, FrameTime::of_frame(scene, number)).ok()
    }
}

/// Wind in which leaves move as much as under drops, m/s. Own: half of their samples are then written.
const SHAKEN_LEAF_SPEED: f64 = 5.0;

/// Mean speed of all winds of a scene, m/s; in rain at least [`SHAKEN_LEAF_SPEED`].
fn leaf_wind_speed(recipe: &Recipe) -> f64 {
    let winds = std::iter::once(&recipe.wind).chain(&recipe.added).filter(|wind| wind.blows());
    let speed: f64 = winds.map(|wind| wind.speed * wind.scale).sum();
    if recipe.rain.is_some() { speed.max(SHAKEN_LEAF_SPEED) } else { speed }
}

/// Bytes of the exported planes and boxes of wind: three floats per sample.
fn estimate_wind_bytes(scene: &Scene, frames: u64) -> u64 {
    scene.air.iter().map(|g| frames.div_ceil(u64::from(g.every.max(1))).saturating_mul(12 * g.count())).sum()
}
