//! What the rest of the program knows of a format: its name, the files it writes, how large they become, how its writer is
//! opened. [`super::registry`] lists the formats.

use std::sync::Arc;

use osier_base::files::Folder;

use super::Exporter;
use super::estimate::EstimateInput;
use super::file_target::FileTarget;
use super::options::ExportOptions;
use super::textures::Textures;

/// What the rest of the program knows of a format.
#[derive(Debug, Clone, Copy)]
pub struct FormatInfo {
    /// Its name in `[output] formats` and `--formats`, `[a-z0-9]+`, unique.
    pub word: &'static str,
    /// One line for listings: lower case, no full stop.
    pub about: &'static str,
    /// Folder of a bake in which each file is named after the asset it holds, for the manifest's lists of files per asset.
    pub asset_folder: Option<&'static str>,
    /// Single files that it can write: endings without the dot, each with one line for listings.
    pub endings: &'static [(&'static str, &'static str)],
    /// Whether a single file has its pictures in files beside it (not inside it, and not none).
    pub pictures_beside: bool,
    /// Memory that the writer holds until the end, percent of the bytes it writes. Measured.
    pub memory_percent: u64,
    /// Bytes it will write, without pictures that are files of their own.
    pub estimate: fn(&EstimateInput) -> u64,
    /// Opens its writers for a job; several where it writes one set of files per profile.
    pub open: fn(&ExportJob) -> Vec<Box<dyn Exporter>>,
}

/// Where files go and what they are made with.
#[derive(Debug, Clone)]
pub struct ExportJob<'a> {
    /// The output folder.
    pub folder: Folder,
    /// Encoded pictures of the scene.
    pub textures: Arc<Textures>,
    /// Choices of all formats.
    pub options: &'a ExportOptions,
    /// Name of the one file that shows the whole scene, with an ending of [`FormatInfo::endings`]; none: the layout of a bake.
    pub file: Option<&'a str>,
}

impl ExportJob<'_> {
    /// The target of formats that name a single file by its stem.
    pub fn target(&self) -> FileTarget {
        match self.file {
            Some(name) => FileTarget::Single(name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned()),
            None => FileTarget::Bake,
        }
    }
}
