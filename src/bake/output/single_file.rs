//! Estimates and checks of still scenes written into a single file.

use crate::bake::output::bake_estimate::BakeEstimate;
use crate::bake::output::estimate::{EstimateJob, estimate_formats};
use crate::bake::output::exporters::export_options;
use crate::bake::scene::animated::AnimatedScene;
use crate::bake::scene::assembly::AssembledScene;
use crate::recipe::Recipe;
use osier_base::{Error, Result};
use osier_export::estimate::MergedSize;
use osier_export::format::FormatInfo;
use osier_export::gltf::Profile;
use osier_scene::{Asset, AssetKind, Scene};

/// Estimates the file that `osier grow` will write in a format; `profile`: of a glTF.
pub fn estimate_file(
    built: &AssembledScene,
    recipe: &Recipe,
    format: &'static FormatInfo,
    profile: Profile,
) -> BakeEstimate {
    let mut options = export_options(recipe);
    options.gltf_profiles = vec![profile];
    let job = EstimateJob {
        formats: &[format],
        frames: 0,
        weights: &built.weights,
        rained_leaves: built.rained_leaves,
        single: true,
    };
    BakeEstimate { modules: built.modules, ..estimate_formats(&built.animated, recipe, &options, &job) }
}

/// Refuses a scene without triangles and, unless the file is OBJ, without points and curves.
/// # Errors
/// X030.
pub fn refuse_empty(stage: &AnimatedScene, ending: &str) -> Result<()> {
    if stage.scene.assets.is_empty() {
        let name = &stage.scene.name;
        let reason = format!("\"{name}\" shows nothing but its ground, which only `osier bake` writes");
        return Err(Error::export("X030", reason));
    }
    let merged = MergedSize::of(&stage.scene);
    let lines = stage.scene.assets.iter().any(|a| !a.curves.is_empty());
    let (shown, what) = match ending {
        "obj" => (merged.triangles > 0, "no triangle; points and lines are not part of an OBJ file"),
        _ => (merged.triangles > 0 || merged.points > 0 || lines, "no triangle and no point"),
    };
    if shown {
        return Ok(());
    }
    let reason = format!("\"{}\" makes {what}: nothing is written", stage.scene.name);
    Err(Error::export("X030", reason))
}

/// Refuses a scene with plants in which no asset except a terrain has triangles, points or curves.
/// # Errors
/// X030.
pub fn refuse_without_visible_plants(scene: &Scene) -> Result<()> {
    let is_plant = |a: &&Asset| a.kind == AssetKind::Plant;
    let is_bare = |a: &Asset| {
        let one = MergedSize::of_asset(a);
        one.triangles == 0 && one.points == 0 && a.curves.is_empty()
    };
    let grown = scene.assets.iter().filter(|a| a.kind != AssetKind::Terrain);
    if scene.assets.iter().any(|a| is_plant(&a)) && grown.clone().all(is_bare) {
        let reason = format!(
            "\"{}\" grows nothing that can be seen: no segment, leaf or polygon is drawn at the end of the derivation",
            scene.name
        );
        return Err(Error::export("X030", reason));
    }
    Ok(())
}
