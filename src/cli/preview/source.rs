//! Loads the scene to preview from the name of a source.

use std::ops::RangeInclusive;
use std::path::Path;

use super::super::Context;
use super::super::args::Preview;
use crate::bake::BakeContext;
use crate::presets;
use crate::recipe::{Recipe, resolve};
use crate::scene_preview::PreviewScene;
use crate::source::find_scene;
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_preview::Quality;

/// Endings of mesh files, which are previewed without a scene.
const MESH_ENDINGS: [&str; 3] = ["glb", "gltf", "obj"];
/// Endings of outputs that osier writes but does not read.
const WRITE_ONLY_ENDINGS: [&str; 7] = ["usda", "usdc", "usdz", "ply", "pov", "pc2", "exr"];

/// Changes of the source for one cell of a contact sheet: another seed, other values of keys, another entry.
#[derive(Debug, Clone, Default)]
pub struct Variation {
    /// Source that replaces that of the command line, for entries of a file.
    pub source: Option<String>,
    pub seed: Option<u64>,
    /// Overrides `PATH=VALUE`, applied after those of the command line.
    pub set: Vec<String>,
}

/// Loads a mesh file or the folder of a bake, or assembles the scene of any other source. `with_motion`: whether frames of the
/// clip will be evaluated.
/// # Errors
/// `Input` with the faults of the source, `Io` if it cannot be read, `Limit`, `Cancelled`.
pub fn load(
    context: &Context,
    args: &Preview,
    name: &str,
    quality: Quality,
    with_motion: bool,
    variation: &Variation,
    work: &BakeContext<'_>,
) -> Result<PreviewScene> {
    let name = variation.source.as_deref().unwrap_or(name);
    let path = Path::new(name);
    let ending = ending(path);
    if is_bake(path) {
        return PreviewScene::of_bake(path, &context.common.search, &context.limits);
    }
    if is_mesh_file(path) {
        return PreviewScene::of_mesh_file(path, &context.common.search, &context.limits);
    }
    if WRITE_ONLY_ENDINGS.contains(&ending.as_str()) {
        let message = format!("\"{name}\" (.{ending}) is a file for other programs");
        let help = "preview its scene, or the .glb of the same bake (--formats glb)";
        return Err(Diagnostic::about("S001", message).help(help).into());
    }
    let mut request = find_scene(name, &context.sources)?;
    request.steps = args.steps;
    // The cell's overrides follow those of the command line, and its seed replaces theirs.
    request.sweep.extend(variation.set.iter().cloned());
    request.seed = variation.seed.or(request.seed);
    let (recipe, warnings) = resolve(&request)?;
    Ok(PreviewScene::of_recipe(recipe, quality, with_motion, work)?.with_warnings(warnings))
}

/// The frames of a source's clip, known before anything grows; `None` for meshes, bakes and files that are not read.
/// # Errors
/// As [`load`].
pub fn clip_of(context: &Context, args: &Preview, name: &str) -> Result<Option<RangeInclusive<u32>>> {
    if is_finished(name) || WRITE_ONLY_ENDINGS.contains(&ending(Path::new(name)).as_str()) {
        return Ok(None);
    }
    let mut request = find_scene(name, &context.sources)?;
    request.steps = args.steps;
    let (recipe, _) = resolve(&request)?;
    Ok(Some(recipe.clip.start..=recipe.clip.end))
}

/// The recipe of a source that is a picture of layers, which needs no scene in space; `None` for any other source.
/// # Errors
/// As [`load`].
pub fn layered_picture(context: &Context, args: &Preview) -> Result<Option<(Recipe, Report)>> {
    let path = Path::new(&args.source);
    // Meshes and folders are not scenes.
    if is_bake(path) || (args.source.contains('.') && ending(path) != "toml") {
        return Ok(None);
    }
    let request = find_scene(&args.source, &context.sources)?;
    // A text without the word has no layers, which saves resolving it twice.
    if !request.text.contains("layer") {
        return Ok(None);
    }
    Ok(Some(resolve(&request)?).filter(|(recipe, _)| !recipe.layers.is_empty()))
}

/// Whether a source is a mesh file or the folder of a bake, whose shapes depend on no seed and no key.
pub fn is_finished(name: &str) -> bool {
    let path = Path::new(name);
    is_bake(path) || is_mesh_file(path)
}

/// Whether a source is a mesh file by its ending, and not the name of a preset that has such an ending.
fn is_mesh_file(path: &Path) -> bool {
    let is_preset = || path.to_str().is_some_and(|name| presets::find(name).is_some());
    MESH_ENDINGS.contains(&ending(path).as_str()) && (path.exists() || !is_preset())
}

/// Whether a source is the folder of a bake. Any other folder may have the name of a preset.
fn is_bake(path: &Path) -> bool {
    path.is_dir() && path.join("manifest.json").exists()
}

/// Ending of a file name, in lower case, without its dot.
pub fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
