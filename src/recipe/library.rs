//! Where references lead: beside the scene, into a `--search` folder, or to the presets.

use std::path::{Path, PathBuf};

use super::Bytes;
use crate::presets;
use osier_base::Result;
use osier_base::files::{ReadError, SearchPaths};

/// Bytes of a file or of a preset, found by the reference of a scene or of another file.
#[derive(Debug, Clone)]
pub struct ReferencedFile {
    /// Name for messages: the path, or `preset:oak.l`.
    pub shown: String,
    /// Its bytes, at most as many as the limit allows.
    pub bytes: Bytes,
    /// Where it is; for a preset its bare name, beside which there is nothing.
    pub path: PathBuf,
}

/// Folders that references are searched in.
#[derive(Debug, Clone, Default)]
pub struct Library {
    roots: SearchPaths,
    opened: PathBuf,
}

impl Library {
    /// The folder of an opened file, then the search folders, then the presets.
    /// # Errors
    /// `Io` if a folder is not there.
    pub fn new(opened: &Path, search: &[PathBuf]) -> Result<Self> {
        Ok(Self { roots: SearchPaths::new(opened, search)?, opened: opened.into() })
    }

    /// The search folders, then the presets: for a scene that is itself a preset.
    /// # Errors
    /// `Io` if a folder is not there.
    pub fn presets(search: &[PathBuf]) -> Result<Self> {
        match search {
            [] => Ok(Self::default()),
            [first, ..] => Self::new(&first.join("."), search),
        }
    }

    /// The folders that files may name files in.
    pub fn roots(&self) -> &SearchPaths {
        &self.roots
    }

    /// Names of the files with an ending in the folder of a file that may be read, sorted.
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
            Err(refusal @ (ReadError::Missing { .. } | ReadError::Outside { .. })) => preset(reference).ok_or(refusal),
            Err(refusal) => Err(refusal),
        }
    }
}

fn preset(name: &str) -> Option<ReferencedFile> {
    let p = presets::find(name)?;
    Some(ReferencedFile { shown: format!("preset:{}", p.name), bytes: p.text.as_bytes().into(), path: p.name.into() })
}
