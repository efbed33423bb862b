//! What lies in a folder, for checking a bake against its manifest.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::file_system::{hash, open_regular, read_limited};
use super::journal::JOURNAL;
use super::read::too_long;
use super::unique_names::is_plain_path;
use crate::{Error, Result};

/// Largest depth of a folder below the root whose entries are listed.
const DEPTH: usize = 32;

/// Paths of everything but folders below `root`, relative with `/`, sorted; without the journal and parts of files.
/// Links are named, never followed.
/// # Errors
/// `Io` if a folder cannot be read.
pub fn list_files(root: &Path) -> Result<Vec<String>> {
    let mut found = Vec::new();
    let mut todo = vec![(String::new(), 0)];
    while let Some((folder, depth)) = todo.pop() {
        let path = root.join(&folder);
        let failed = |e| Error::io("read", &path, e);
        for entry in fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let relative = if folder.is_empty() { name.clone() } else { format!("{folder}/{name}") };
            if entry.file_type().map_err(failed)?.is_dir() {
                if depth < DEPTH {
                    todo.push((relative, depth + 1));
                }
            } else if relative != JOURNAL && !(name.starts_with('.') && name.ends_with(".part")) {
                found.push(relative);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Succeeds if a folder can be made or written at `root`, of which nothing need exist; makes nothing. It is for work that takes long
/// before it writes, which may still fail then.
/// # Errors
/// `Io` if a part of the path is a file, or if the system forbids this process to write there.
/// # Examples
/// ```
/// let here = std::env::temp_dir();
/// assert!(osier_base::files::check_writable(&here.join("not/yet/made")).is_ok());
/// ```
pub fn check_writable(root: &Path) -> Result<()> {
    // The parent of a bare name is the current folder, which `ancestors` spells as an empty path.
    let named = |path: &Path| -> PathBuf { if path.as_os_str().is_empty() { ".".into() } else { path.into() } };
    let Some(nearest) = root.ancestors().map(named).find(|path| path.exists()) else { return Ok(()) };
    if !nearest.is_dir() {
        return Err(Error::io("create", root, io::ErrorKind::NotADirectory.into()));
    }
    #[cfg(unix)]
    {
        use rustix::fs::{Access, access};
        use rustix::io::Errno;
        // Other errors are left to the write itself, which may succeed where the question has no answer.
        if let Err(denied @ (Errno::ACCESS | Errno::ROFS)) =
            access(nearest.as_path(), Access::WRITE_OK | Access::EXEC_OK)
        {
            return Err(Error::io("create", root, denied.into()));
        }
    }
    Ok(())
}

/// Length and BLAKE3 (64 hex digits) of a regular file below `root`; `None` if there is none.
/// # Errors
/// X009 for a path that leaves the folder, `Io` if the file cannot be read.
pub fn hash_file(root: &Path, relative: &str) -> Result<Option<(u64, String)>> {
    let Some(file) = open_below(root, relative)? else { return Ok(None) };
    let (hash, length) = hash(file).map_err(|e| Error::io("read", root.join(relative), e))?;
    Ok(Some((length, hash.to_hex().to_string())))
}

/// Bytes of a regular file below `root`, at most `limit`; `None` if there is none. `flag`: the flag that raises the limit, for the
/// message; empty for none.
/// # Errors
/// X009 for a path that leaves the folder, `Io`, `Limit` if it is longer.
pub fn read_below(root: &Path, relative: &str, limit: u64, flag: &str) -> Result<Option<Vec<u8>>> {
    let Some(file) = open_below(root, relative)? else { return Ok(None) };
    let path = root.join(relative);
    let bytes = read_limited(file, limit).map_err(|e| Error::io("read", &path, e))?;
    bytes.ok_or_else(|| too_long(&path, limit, flag)).map(Some)
}

fn open_below(root: &Path, relative: &str) -> Result<Option<fs::File>> {
    if !is_plain_path(relative) {
        return Err(Error::export("X009", format!("{relative:?} leaves the folder")));
    }
    let path = root.join(relative);
    match open_regular(&path, false) {
        Ok(file) => Ok(Some(file)),
        // A link, a folder or a device in its place counts as an absent file.
        Err(_) if !fs::symlink_metadata(&path).is_ok_and(|m| m.is_file()) => Ok(None),
        Err(e) => Err(Error::io("open", path, e)),
    }
}
