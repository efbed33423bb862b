//! Runs a [`Recipe`]: grows, skins, steps through time, writes.

mod air;
pub mod blow;
pub mod boughs;
pub mod breeze;
mod cards;
pub mod catkin;
pub mod clouds;
mod counts;
mod course;
mod deposits;
mod draft;
pub mod dress;
pub mod exporters;
mod heroes;
pub mod kept;
mod land;
pub mod layers;
pub mod layout;
pub mod looks;
mod measures;
mod memory;
mod morphing;
pub mod mover;
pub mod plants;
pub mod rain;
mod rod_mesh;
pub mod rods;
pub mod run_up;
mod scatter;
pub mod single;
mod solids;
pub mod stage;
mod stream;
pub mod systems;
mod tables;
mod trails;
mod twigs;
mod view;
pub mod write;

pub use counts::{Counts, lattice};

use std::sync::Arc;

use osier_base::Result;
use osier_base::diagnostic::Report;
use osier_base::fence::{Folder, Shelf};
use osier_export::Warning;
use osier_export::manifest::{self, Manifest};
use osier_export::textures::Textures;

use crate::recipe::Recipe;
use osier_base::limits::Limits;
use osier_base::progress::{Cancel, Progress, Silent};

/// What all work heeds.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// Limits in force.
    pub limits: &'a Limits,
    /// Asks to stop.
    pub cancel: &'a Cancel,
    /// Listens.
    pub progress: &'a dyn Progress,
    /// Where the air of a lattice is kept, if it is.
    pub shelf: Option<&'a Shelf>,
}

impl<'a> Work<'a> {
    /// Work that tells nobody how far it has come and keeps no air of a lattice wind.
    pub fn quiet(limits: &'a Limits, cancel: &'a Cancel) -> Self {
        Self { limits, cancel, progress: &Silent, shelf: None }
    }
}

/// What a bake made.
#[derive(Debug)]
pub struct Baked {
    /// The manifest, as it is written: scene, materials, all files with their hashes.
    pub manifest: Manifest,
    /// Warnings of the scene: grammars, growth, wind.
    pub report: Report,
    /// Warnings of the exporters, by code.
    pub warnings: Vec<Warning>,
}

/// Bakes a recipe: builds its scene, simulates it and writes all of its files into a folder.
/// `frames`: numbers of the frames to write, in rising order; empty for a still scene.
/// # Errors
/// `Input` with the faults of grammars, `Limit` before memory is spent, `Export` and `Io` of what cannot be written, `Cancelled`.
pub fn bake(recipe: &Recipe, frames: &[u32], folder: &Folder, work: &Work<'_>) -> Result<Baked> {
    kept::recall(recipe, folder.root(), work.limits);
    let built = stage::build(recipe, stage::Parts::default(), work)?;
    single::refuse_bare(&built.stage.scene)?;
    let (manifest, warnings) = save(recipe, &built.stage, frames, folder, work)?;
    Ok(Baked { manifest, report: built.report, warnings })
}

/// Writes all files of a scene that was built, frame by frame, the manifest last.
/// # Errors
/// `Export` and `Io` of what cannot be written, `Cancelled`.
pub fn save(
    recipe: &Recipe,
    stage: &write::Stage,
    frames: &[u32],
    folder: &Folder,
    work: &Work<'_>,
) -> Result<(Manifest, Vec<Warning>)> {
    let textures = Arc::new(Textures::encode(&stage.scene)?);
    textures.write(&stage.scene, folder, "textures/")?;
    kept::keep(recipe, folder)?;
    let mut writers = exporters::of_bake(folder, &textures, recipe, frames);
    let warnings = write::write(stage, &mut writers, frames, work)?;
    let settings = exporters::settings(&recipe.output, frames);
    let manifest = manifest::build(&stage.scene, &folder.files(), &warnings, &settings);
    manifest::write(folder, &manifest)?;
    folder.finish()?;
    Ok((manifest, warnings))
}
