//! The description of a format: its name, the files it writes, an estimate of their size, and how its exporter is opened.
//! [`super::registry`] lists the formats.

use std::sync::Arc;

use osier_base::files::Folder;

use super::Exporter;
use super::estimate::EstimateInput;
use super::file_target::FileTarget;
use super::options::ExportOptions;
use super::textures::Textures;

/// What the files of a bake in a format need of the textures of its scene, in rising order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TextureUse {
    /// Nothing: they need not be drawn.
    Unused,
    /// Files of the format contain their texels; the files in `textures/` are not needed.
    Read,
    /// Files of the format, or the materials that the manifest lists for their importers, refer to the files in `textures/`.
    Written,
}

/// Properties of a format: its word, the files that it can write, their estimated size, and how its exporters are opened.
/// Each format has one as `FORMAT`.
#[derive(Debug, Clone, Copy)]
pub struct FormatInfo {
    /// Its name in `[output] formats` and `--formats`, `[a-z0-9]+`, unique.
    pub word: &'static str,
    /// One line for listings: lower case, no full stop.
    pub about: &'static str,
    /// Folder of a bake that holds its files, unique; a file that a program opens first may stand beside it.
    pub folder: &'static str,
    /// Whether each file in the folder is named after the asset that it contains; the manifest then lists the files per
    /// asset.
    pub names_assets: bool,
    /// Whether a bake reports that the folder has no file. Set for formats that store only a part of a scene, which some
    /// scenes lack, and whose exporter has no such warning of its own.
    pub notes_missing_files: bool,
    /// Single files that it can write: endings without the dot, each with one line for listings.
    pub endings: &'static [(&'static str, &'static str)],
    /// Whether a single file of the format refers to its textures as separate files beside it.
    pub pictures_beside: bool,
    /// What a bake in the format needs of the textures of its scene.
    pub textures: TextureUse,
    /// Memory that the exporter uses until the end of the bake, as a percentage of the bytes that it writes; measured.
    pub memory_percent: u64,
    /// Estimates the bytes that the format will write, excluding textures in separate files.
    pub estimate: fn(&EstimateInput) -> u64,
    /// Opens its exporters for a job; several if it writes a set of files for each profile.
    pub open: fn(&ExportJob) -> Vec<Box<dyn Exporter>>,
}

/// The output folder, and the options that exporters are opened with.
#[derive(Debug, Clone)]
pub struct ExportJob<'a> {
    /// Folder that all paths are relative to.
    pub folder: Folder,
    /// PNG files of the scene's images, which all exporters share.
    pub textures: Arc<Textures>,
    /// Options of all formats; an exporter copies only those of its format.
    pub options: &'a ExportOptions,
    /// Name of a single file with the whole scene, with an ending of [`FormatInfo::endings`]; none for the files of a bake.
    pub file: Option<&'a str>,
}

impl ExportJob<'_> {
    /// The target for formats whose additional files stand beside a single file: `file`, or a bake if there is none.
    pub fn target(&self) -> FileTarget {
        match self.file {
            Some(name) => FileTarget::Single(name.to_owned()),
            None => FileTarget::Bake,
        }
    }
}
