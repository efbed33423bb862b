//! Assembly, estimate and writing of a still scene as one file.

use std::sync::Arc;

use crate::bake::output::single_file::{estimate_file, refuse_empty};
use crate::bake::output::{exporters, frame_loop};
use crate::bake::scene::{AssembledScene, SceneOptions, assemble_for_estimate, assemble_scene};
use crate::bake::{BakeContext, BakeEstimate};
use crate::recipe::Recipe;
use osier_base::diagnostic::Report;
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_export::Warning;
use osier_export::format::FormatInfo;
use osier_export::gltf::Profile;
use osier_export::textures::Textures;

/// The scene of a recipe without its ground, assembled for one file.
#[derive(Debug)]
pub struct StillScene<'r> {
    recipe: &'r Recipe,
    assembled: AssembledScene,
}

impl<'r> StillScene<'r> {
    /// Grows and skins everything that the recipe names, except the ground.
    /// # Errors
    /// `Input` with the faults of grammars, `Limit`, `Cancelled`.
    pub fn assemble(recipe: &'r Recipe, context: &BakeContext<'_>) -> Result<Self> {
        Ok(Self { recipe, assembled: assemble_scene(recipe, SceneOptions::WITHOUT_GROUND, context)? })
    }

    /// As [`StillScene::assemble`] with the least work that [`StillScene::estimate`] needs; the scene cannot be
    /// written.
    /// # Errors
    /// As [`StillScene::assemble`].
    pub fn assemble_for_estimate(recipe: &'r Recipe, context: &BakeContext<'_>) -> Result<Self> {
        Ok(Self { recipe, assembled: assemble_for_estimate(recipe, SceneOptions::WITHOUT_GROUND, context)? })
    }

    /// Warnings from building the scene, without those of the recipe.
    pub fn report(&self) -> &Report {
        &self.assembled.report
    }

    /// Drops the scene and keeps its warnings.
    pub fn into_report(self) -> Report {
        self.assembled.report
    }

    /// Predicts the contents of a file of a format, its size, and the memory for writing it.
    /// # Errors
    /// X030 if the file would hold nothing.
    pub fn estimate(&self, format: &'static FormatInfo, profile: Profile) -> Result<BakeEstimate> {
        refuse_empty(&self.assembled.animated, format.word)?;
        Ok(estimate_file(&self.assembled, self.recipe, format, of_single_file(profile)))
    }

    /// Writes the scene into a folder; the ending of `name` chooses the format.
    /// # Errors
    /// X030 for an ending that no exporter writes, `Foreign` for a file of another origin, `Export` and `Io` of what cannot
    /// be written, `Cancelled`.
    pub fn write(
        &self,
        name: &str,
        folder: &Folder,
        profile: Profile,
        context: &BakeContext<'_>,
    ) -> Result<Vec<Warning>> {
        folder.check_name(name)?;
        let textures = Arc::new(Textures::encode(&self.assembled.animated.scene)?);
        let exporter = exporters::file_exporter(folder.clone(), name, &textures, self.recipe, of_single_file(profile))
            .ok_or_else(|| Error::export("X030", format!("no exporter writes \"{name}\"")))?;
        frame_loop::write_frames(&self.assembled.animated, &mut [exporter], &[], context)
    }
}

/// The profile of a single file, which has no levels of detail: that of Blender in place of that of engines.
fn of_single_file(profile: Profile) -> Profile {
    match profile {
        Profile::Blender | Profile::Engine => Profile::Blender,
        Profile::Web => Profile::Web,
    }
}
