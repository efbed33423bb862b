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

/// Checks that the folder `root` can be written, or made if it does not exist; makes nothing. For work that computes long before
/// it writes; writing may still fail after a successful check.
/// # Errors
/// `Io` if a part of the path is a file, or if the system forbids this process to write there; its message names that file or folder.
/// # Examples
/// ```
/// let here = std::env::temp_dir();
/// assert!(osier_base::files::check_writable(&here.join("not/yet/made")).is_ok());
/// ```
pub fn check_writable(root: &Path) -> Result<()> {
    // The parent of a bare name is the current folder, which `ancestors` spells as an empty path.
    let named = |path: &Path| -> PathBuf { if path.as_os_str().is_empty() { ".".into() } else { path.into() } };
    let Some(nearest) = root.ancestors().map(named).find(|path| path.exists()) else { return Ok(()) };
    // The message names the part of the path that is in the way, which may be far above `root`.
    let failed = |kind: io::ErrorKind, why: &str| {
        if nearest == named(root) && nearest.is_dir() {
            return Error::io("write to", nearest.as_path(), kind.into());
        }
        Error::io("create", root, io::Error::new(kind, format!("{why} \"{}\"", nearest.display())))
    };
    if !nearest.is_dir() {
        return Err(failed(io::ErrorKind::NotADirectory, "not a directory:"));
    }
    #[cfg(unix)]
    {
        use rustix::fs::{Access, access};
        use rustix::io::Errno;
        // Other errors of `access` are ignored: writing may succeed nevertheless, and reports its own errors.
        match access(nearest.as_path(), Access::WRITE_OK | Access::EXEC_OK) {
            Err(Errno::ACCESS) => {
                return Err(failed(io::ErrorKind::PermissionDenied, "you have no permission to write in"));
            }
            Err(Errno::ROFS) => return Err(failed(io::ErrorKind::ReadOnlyFilesystem, "read-only disk:")),
            _ => {}
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

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "tests look at the disk themselves")]
mod tests {
    use super::*;

    #[test]
    fn the_part_of_a_path_that_is_in_the_way_is_named() {
        let dir = tempfile::tempdir().expect("dir");
        let wall = dir.path().join("wall");
        fs::write(&wall, "a file").expect("write");
        let said = check_writable(&wall.join("a/b")).expect_err("a file").to_string();
        let ending = format!(": not a directory: \"{}\"; choose another folder with -o", wall.display());
        assert!(said.starts_with("cannot create ") && said.ends_with(&ending), "{said}");
    }

    #[cfg(unix)]
    #[test]
    fn folders_that_may_not_be_written_are_told_with_what_to_do() {
        use std::os::unix::fs::PermissionsExt as _;
        let dir = tempfile::tempdir().expect("dir");
        let closed = dir.path().join("closed");
        fs::create_dir(&closed).expect("folder");
        fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).expect("permissions");
        // The superuser may write everywhere, so that nothing can be tested.
        let Err(denied) = check_writable(&closed) else { return };
        let (closed, below) = (closed.display(), check_writable(&closed.join("a")).expect_err("denied").to_string());
        let remedy = "allow yourself to write there, or choose another folder with -o";
        assert_eq!(denied.to_string(), format!("cannot write to \"{closed}\": permission denied; {remedy}"));
        let why = format!("you have no permission to write in \"{closed}\"; {remedy}");
        assert!(below.starts_with("cannot create ") && below.ends_with(&why), "{below}");
    }
}
