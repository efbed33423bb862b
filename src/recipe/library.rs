//! Where references lead: beside the scene, into a `--search` folder, or to the presets.

use std::path::{Path, PathBuf};

use super::Bytes;
use crate::{fence, presets};

/// A file that a reference led to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Name for messages: the path, or `preset:oak.l`.
    pub shown: String,
    /// What it holds.
    pub bytes: Bytes,
    /// Its folder; none for presets.
    pub folder: Option<PathBuf>,
}

/// Where to look.
#[derive(Debug, Clone, Default)]
pub struct Library {
    /// The scene's folder.
    pub folder: Option<PathBuf>,
    /// Further folders, by `--search`.
    pub search: Vec<PathBuf>,
}

impl Library {
    /// Reads what a reference names: a bare name beside the scene, then among the presets; a path with `/` only beneath
    /// the scene's folder or a search folder. `limit`: most bytes.
    /// # Errors
    /// Why nothing could be read, as text for a diagnostic.
    pub fn find(&self, reference: &str, limit: u64) -> Result<Found, String> {
        let reference = reference.replace('\\', "/");
        refuse(&reference)?;
        let folders = self.folder.iter().chain(&self.search);
        let mut denied = None;
        for folder in folders {
            let path = folder.join(&reference);
            match fence::read_input(&path, limit) {
                Ok(bytes) => return Ok(found_at(&path, bytes)),
                Err(crate::Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {}
                Err(e) => denied = Some(e.to_string()),
            }
        }
        if let Some(why) = denied {
            return Err(why);
        }
        preset(&reference).ok_or_else(|| "no such file beside the scene, and no such preset".to_owned())
    }
}

fn found_at(path: &Path, bytes: Vec<u8>) -> Found {
    Found { shown: path.display().to_string(), bytes: bytes.into(), folder: path.parent().map(Path::to_path_buf) }
}

fn preset(name: &str) -> Option<Found> {
    let p = presets::find(name)?;
    Some(Found { shown: format!("preset:{}", p.name), bytes: p.text.as_bytes().into(), folder: None })
}

/// Spellings that could lead out of the folder.
fn refuse(reference: &str) -> Result<(), String> {
    let bad = |why: &str| Err(why.to_owned());
    if reference.is_empty() || reference.chars().any(char::is_control) {
        return bad("the name is empty or holds control characters");
    }
    if reference.starts_with(['/', '~']) || reference.contains(':') {
        return bad("only paths relative to the scene are allowed");
    }
    if reference.split('/').any(|part| part == ".." || part.is_empty()) {
        return bad("the path leaves the scene's folder; name its folder with --search");
    }
    Ok(())
}
