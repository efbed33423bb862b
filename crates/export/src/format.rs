//! The registry of formats: what a format is called, which files it writes, how large they become, how its writer is opened.
//!
//! A new format is one file (or folder) with its [`Exporter`] and its `pub const FORMAT: FormatInfo`, and one line in
//! [`FORMATS`]. The words of `[output] formats` and `--formats`, `osier list formats`, the endings of `osier grow -o`, predicted
//! sizes and memory, the folders that the manifest assigns to assets and the table in docs/formats.md all read the registry.
//!
//! ```
//! use osier_export::format::{FORMATS, by_ending, by_word};
//!
//! assert_eq!(by_word("usd").map(|f| f.asset_folder), Some(Some("usd")));
//! assert_eq!(by_ending("glb").map(|f| f.word), Some("glb"));
//! assert!(FORMATS.iter().all(|f| !f.about.is_empty()));
//! ```

use std::sync::Arc;

use osier_base::files::Folder;

use super::estimate::EstimateInput;
use super::textures::Textures;
use super::{Exporter, exr, gltf, obj, pc2, ply, pov, stats, tracks, usd};

/// Every format of a bake, in the order in which they are listed.
pub const FORMATS: &[&FormatInfo] = &[
    &usd::FORMAT,
    &gltf::FORMAT,
    &pc2::FORMAT,
    &obj::FORMAT,
    &ply::FORMAT,
    &pov::FORMAT,
    &exr::FORMAT,
    &stats::FORMAT,
    &tracks::FORMAT,
];

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

/// Which files a format writes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum FileTarget {
    /// Files per asset in the folders of a bake.
    #[default]
    Bake,
    /// One file of this stem for the whole scene, and what belongs to it in `<stem>_files/`.
    Single(String),
}

/// Choices of all formats that have some.
#[derive(Debug, Clone, Default)]
pub struct ExportOptions {
    /// USD.
    pub usd: usd::UsdOptions,
    /// glTF; profile and target come from [`Self::gltf_profiles`] and the job.
    pub gltf: gltf::GltfOptions,
    /// Profiles of glTF, each with a set of files.
    pub gltf_profiles: Vec<gltf::Profile>,
    /// POV-Ray.
    pub pov: pov::PovOptions,
    /// Maps.
    pub exr: exr::ExrOptions,
}

/// The format of a word.
pub fn by_word(word: &str) -> Option<&'static FormatInfo> {
    FORMATS.iter().find(|f| f.word == word).copied()
}

/// The format that writes single files of an ending, without its dot, in lower case.
pub fn by_ending(ending: &str) -> Option<&'static FormatInfo> {
    FORMATS.iter().find(|f| f.endings.iter().any(|(e, _)| *e == ending)).copied()
}

/// Endings of single files with what they are, in the order of the registry.
pub fn endings() -> impl Iterator<Item = (&'static str, &'static str)> {
    FORMATS.iter().flat_map(|f| f.endings.iter().copied())
}

/// The words of all formats, separated by commas, for help texts.
pub fn words() -> String {
    FORMATS.iter().map(|f| f.word).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_endings_are_unique() {
        let unique = |mut all: Vec<&str>| {
            let n = all.len();
            all.sort_unstable();
            all.dedup();
            all.len() == n
        };
        assert!(unique(FORMATS.iter().map(|f| f.word).collect()));
        assert!(unique(endings().map(|(ending, _)| ending).collect()));
        assert!(unique(FORMATS.iter().filter_map(|f| f.asset_folder).collect()));
    }
}
