//! A bake against its manifest.

use std::collections::BTreeMap;
use std::path::Path;

use super::{FileEntry, Manifest, bake_hash};
use osier_base::files::{MANIFEST, hash_file, list_files, read_below};
use osier_base::{Error, Result};

/// Differences between the files of a bake and its manifest, see [`verify`]; lists are in the order of paths.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Verification {
    /// Files that the manifest names and the folder lacks.
    pub missing: Vec<String>,
    /// Files in the folder that the manifest does not name; a bake with some is still complete.
    pub extra: Vec<String>,
    /// Files whose length or hash differs.
    pub changed: Vec<String>,
    /// Whether the manifest's `bake_hash` agrees with its list of files.
    pub sum_holds: bool,
}

impl Verification {
    /// Whether all files that the manifest names exist unchanged; extra files are allowed.
    pub fn is_complete(&self) -> bool {
        self.sum_holds && self.missing.is_empty() && self.changed.is_empty()
    }
}

/// Most digits of a frame number in a file's name.
const DIGITS: usize = 10;
/// Longest path of a file, bytes.
const LONGEST: usize = 1024;

/// Fails for a manifest that no bake writes (X010): expanded sequences could have paths of unbounded length.
fn plain(manifest: &Manifest) -> Result<()> {
    let digits = manifest.time.digits;
    if digits > DIGITS {
        let reason =
            format!("\"{MANIFEST}\" is damaged: frame numbers of {digits} digits, at most {DIGITS} are written");
        return Err(Error::export("X010", reason));
    }
    let path = |f: &FileEntry| match f {
        FileEntry::Single { path, .. } | FileEntry::Sequence { path, .. } => path.len(),
    };
    if let Some(bytes) = manifest.files.iter().map(path).find(|n| *n > LONGEST) {
        let reason = format!("\"{MANIFEST}\" is damaged: a path has {bytes} bytes, at most {LONGEST} are written");
        return Err(Error::export("X010", reason));
    }
    Ok(())
}

/// Recomputes the hashes of all files that the manifest in `dir` names; lists other files of the folder as extra.
/// `limit`: bytes that the manifest may have.
/// # Errors
/// `Io` if there is no manifest or the folder cannot be read, `Limit` if the manifest is longer, X010 if it is damaged, X009 if it names
/// a path outside the folder.
pub fn verify(dir: &Path, limit: u64) -> Result<(Manifest, Verification)> {
    let absent = || Error::io("open", dir.join(MANIFEST), std::io::ErrorKind::NotFound.into());
    let text = read_below(dir, MANIFEST, limit, "--max-json-bytes")?.ok_or_else(absent)?;
    let damaged = |e: serde_json::Error| {
        let path = dir.join(MANIFEST);
        Error::export("X010", format!("\"{}\" is damaged: {e}; bake the scene again", path.display()))
    };
    let manifest: Manifest = serde_json::from_slice(&text).map_err(damaged)?;
    plain(&manifest)?;
    let expanded = manifest.expanded();
    let mut found = Verification { sum_holds: bake_hash(&expanded) == manifest.bake_hash, ..Verification::default() };
    // Hashed in parallel; results come in the order of the list, so that the report does not depend on threads.
    let hashes = osier_base::par::par_map(&expanded, |(path, _, _)| hash_file(dir, path));
    let mut named = BTreeMap::new();
    for ((path, bytes, hex), hash) in expanded.iter().zip(hashes) {
        named.insert(path.as_str(), ());
        match hash? {
            None => found.missing.push(path.clone()),
            Some((length, blake3)) if length != *bytes || blake3 != *hex => found.changed.push(path.clone()),
            Some(_) => {}
        }
    }
    // The manifest cannot list itself, as it holds the hash of everything listed.
    let is_extra = |path: &String| path != MANIFEST && !named.contains_key(path.as_str());
    found.extra = list_files(dir)?.into_iter().filter(is_extra).collect();
    Ok((manifest, found))
}
