//! Resolution of references to files: beside the scene, in a `--search` folder, or among the presets.

use std::path::{Path, PathBuf};

use super::Bytes;
use crate::presets;
use osier_base::Result;
use osier_base::files::{ReadError, SearchPaths};

/// A file or preset that a reference of a scene or of another file has led to.
#[derive(Debug, Clone)]
pub struct ReferencedFile {
    /// Name for messages: the path, or `preset:oak.l`.
    pub shown: String,
    /// Content of the file, at most as many bytes as the limit allows.
    pub bytes: Bytes,
    /// Path of the file; for a preset its bare name, beside which there are no files.
    pub path: PathBuf,
}

/// The folders in which references are searched, and the file from which relative ones start.
#[derive(Debug, Clone, Default)]
pub struct Library {
    roots: SearchPaths,
    opened: PathBuf,
}

impl Library {
    /// Searches the folder of an opened file, then the search folders, then the presets.
    /// # Errors
    /// `Io` if a folder is not there.
    pub fn new(opened: &Path, search: &[PathBuf]) -> Result<Self> {
        Ok(Self { roots: SearchPaths::new(opened, search)?, opened: opened.into() })
    }

    /// Searches the search folders, then the presets: for a scene that is itself a preset.
    /// # Errors
    /// `Io` if a folder is not there.
    pub fn presets(search: &[PathBuf]) -> Result<Self> {
        match search {
            [] => Ok(Self::default()),
            [first, ..] => Self::new(&first.join("."), search),
        }
    }

    /// The folders below which files may be read, also by references inside of files.
    pub fn roots(&self) -> &SearchPaths {
        &self.roots
    }

    /// Sorted names of the files with an ending in the folder of the file `from`; empty if that folder may not be read.
    pub fn names_beside(&self, from: &Path, ending: &str) -> Vec<String> {
        self.roots.names_beside(from, ending)
    }

    /// Reads what a reference names: a bare name beside the scene, then among the presets; a path with `/` only beneath
    /// the scene's folder or a search folder. `limit`: most bytes.
    /// # Errors
    /// Why nothing could be read.
    pub fn find(&self, reference: &str, limit: u64) -> std::result::Result<ReferencedFile, ReadError> {
        self.find_beside(&self.opened, reference, limit)
    }

    /// As [`Library::find`] for a reference inside another file.
    /// # Errors
    /// Why nothing could be read.
    pub fn find_beside(
        &self,
        from: &Path,
        reference: &str,
        limit: u64,
    ) -> std::result::Result<ReferencedFile, ReadError> {
        match self.roots.read(from, reference, limit) {
            Ok(file) => {
                let beside = from.parent().unwrap_or(Path::new("")).join(reference);
                Ok(ReferencedFile { shown: beside.display().to_string(), bytes: file.bytes.into(), path: file.path })
            }
            // A link that leads out is refused: a preset of its name in its place would not be the file that is beside the scene.
            Err(refusal @ ReadError::Missing { .. }) => preset(reference).ok_or(refusal),
            Err(refusal) => Err(refusal),
        }
    }
}

fn preset(name: &str) -> Option<ReferencedFile> {
    let p = presets::find(name)?;
    Some(ReferencedFile { shown: format!("preset:{}", p.name), bytes: p.text.as_bytes().into(), path: p.name.into() })
}
