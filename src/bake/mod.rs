//! Bakes a [`Recipe`]: assembles its scene, simulates its frames and writes them.
//!
//! ```text
//!  Recipe
//!    │  cache::ifs_leaves      load leaves of tables kept by an earlier bake
//!    ▼
//!  scene::assembly            SceneBuilder: assets + one AssetMotion for each moving asset
//!    │    ├─ assets/           plants, leaves, terrain, obstacles, attractors, catkins
//!    │    ├─ wind/             analytic wind, or spin-up and run of the lattice
//!    │    └─ motion/           sway, rods, flight, rain, attractor morph
//!    ▼
//!  AnimatedScene              Scene (what exists) + motions (what changes)
//!    │  output::exporters      Exporter::begin(&Scene): textures, static data
//!    ▼
//!  output::frame_loop         for each frame: AssetMotion::frame -> Frame -> Exporter::frame
//!    │
//!    ▼
//!  manifest                   Exporter::finish, then the hash of every file
//! ```

pub mod assets;
pub mod cache;
mod context;
pub mod motion;
pub mod output;
pub mod scene;
pub mod wind;

pub use context::BakeContext;
pub use output::bake_estimate::BakeEstimate;
pub use wind::lattice::{SolidSizeInCells, lattice_memory, solids_in_cells};

use std::sync::Arc;

use osier_base::diagnostic::Report;
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_export::Warning;
use osier_export::format::TextureUse;
use osier_export::manifest::{self, Manifest};
use osier_export::textures::Textures;

use crate::recipe::Recipe;
use output::exporters;
use output::frame_loop::write_frames;
use output::single_file::refuse_without_visible_plants;
use output::texture_size::limit_texture_sizes;
use output::unselected::warn_of_unselected_grids;
use scene::animated::AnimatedScene;
use scene::assembly::{AssembledScene, SceneOptions};

/// Manifest and warnings of a bake whose files have all been written.
#[derive(Debug)]
pub struct Baked {
    /// The manifest as written: scene, materials, all files with their hashes.
    pub manifest: Manifest,
    /// Warnings of the selection of frames, and from building the scene: layout, grammars, growth, wind, rain, flight and rods.
    pub report: Report,
    /// Warnings of the exporters, by code.
    pub warnings: Vec<Warning>,
}

/// Bakes a recipe: builds its scene, simulates it and writes all of its files into a folder.
/// `frames`: numbers of the frames to write, in rising order, each once; empty for a still scene. `folder`: opened with a
/// [key](osier_base::files::WriteOptions::key), an interrupted bake continues where it stopped.
/// # Errors
/// `Range` for a frame outside of the clip; `Input` with the faults of grammars, for `frames` in another order, or if they lack those
/// that copies with a phase need; `Limit` if the predicted bytes or the predicted memory exceed the limits in force; `Export` and `Io`
/// of what cannot be written; `Cancelled`.
pub fn bake(recipe: &Recipe, frames: &[u32], folder: &Folder, context: &BakeContext<'_>) -> Result<Baked> {
    let clip = recipe.clip;
    if let Some(number) = frames.iter().find(|number| !(clip.start..=clip.end).contains(*number)) {
        let [value, min, max] = [*number, clip.start, clip.end].map(f64::from);
        return Err(Error::Range { name: "frame".into(), value, min, max, unit: "" });
    }
    if frames.windows(2).any(|pair| pair[0] >= pair[1]) {
        let why = "the frames to write are not in rising order, each once; sort them and leave out repetitions";
        return Err(Error::input("S004", why));
    }
    let mut report = warn_of_unselected_grids(recipe, frames);
    cache::ifs_leaves::load(recipe, folder.root(), context.limits);
    let mut built = scene::assembly::assemble_scene(recipe, SceneOptions::BAKE, context)?;
    if let Some(why) = missing_frames(recipe, &built.animated, frames) {
        return Err(Error::input("S004", why));
    }
    refuse_without_visible_plants(&built.animated.scene)?;
    built.estimate(recipe, frames).check_limits(context.limits)?;
    let (manifest, warnings) = write_files(recipe, &mut built, frames, folder, context)?;
    report.extend(built.report);
    Ok(Baked { manifest, report, warnings })
}

/// Why the selected frames cannot be written: placements with a phase offset, or the still glTF file, need frames
/// that are not selected.
pub(crate) fn missing_frames(recipe: &Recipe, stage: &AnimatedScene, frames: &[u32]) -> Option<String> {
    // A still glTF file has one frame of the clip, which must be among the written ones.
    let wanted = recipe.output.gltf.frame.filter(|_| recipe.output.writes(&osier_export::gltf::FORMAT));
    if let Some(frame) = wanted.filter(|f| !frames.is_empty() && !frames.contains(f)) {
        return Some(format!("frame {frame} of output.gltf.frame is not selected"));
    }
    let part = !frames.is_empty() && frames.len() < recipe.clip.len();
    // A copy with a phase uses another frame of its plant, which must be written too. Tables of joints have each copy's own
    // frame, and the other formats have plants at rest or at the frame itself.
    let shifting = [&osier_export::usd::FORMAT, &osier_export::gltf::FORMAT, &osier_export::pov::FORMAT];
    let shifts = shifting.into_iter().any(|format| recipe.output.writes(format));
    let phased = stage.scene.placements.iter().filter(|p| p.phase > 0).count();
    (part && shifts && phased > 0).then(|| {
        format!(
            "{phased} copies are animated with a phase offset and need frames that are not selected; bake the whole \
             clip, or animate all copies in phase: sway.phases=1"
        )
    })
}

/// Writes all files of an assembled scene, frame by frame, the manifest last; textures only where a format refers to them, reduced to
/// the sizes that the camera needs. The manifest repeats the warnings of the assembly; those that are returned are of the exporters.
/// # Errors
/// `Export` and `Io` of what cannot be written, `Cancelled`.
pub fn write_files(
    recipe: &Recipe,
    built: &mut AssembledScene,
    frames: &[u32],
    folder: &Folder,
    context: &BakeContext<'_>,
) -> Result<(Manifest, Vec<Warning>)> {
    let animated = &mut built.animated;
    // Previews and single files have the textures at their full size; a bake is made for its camera.
    limit_texture_sizes(recipe, Arc::make_mut(&mut animated.scene));
    let mut textures = Arc::default();
    if recipe.output.texture_use() == TextureUse::Written {
        textures = Arc::new(Textures::encode(&animated.scene)?);
        textures.write(&animated.scene, folder, "textures/")?;
        cache::ifs_leaves::store(recipe, folder)?;
    }
    let mut writers = exporters::bake_exporters(folder, &textures, recipe, animated, frames);
    let warnings = write_frames(animated, &mut writers, frames, context)?;
    manifest::write_places(folder, &animated.scene)?;
    if recipe.output.writes(&osier_export::usd::FORMAT) {
        manifest::write_leaves(folder, &animated.scene)?;
    }
    let settings = exporters::manifest_settings(recipe, animated, frames);
    let of_assembly = built.report.diagnostics.iter().map(|d| Warning { code: d.code, message: d.message.clone() });
    let all: Vec<Warning> = of_assembly.chain(warnings.iter().cloned()).collect();
    let manifest = manifest::build(&animated.scene, &folder.files(), &all, &settings);
    manifest::write(folder, &manifest)?;
    folder.finish()?;
    Ok((manifest, warnings))
}
