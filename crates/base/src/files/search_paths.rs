//! Resolves references inside files, refuses those that lead out of their folder, and opens the files without blocking.

use std::io;
use std::path::{Path, PathBuf};

use super::file_path::folder_of;
use super::file_system::{open_regular, read_limited};
use crate::{Error, Result};

/// Why a reference was not read. Readers report it at the reference, with a specific code or with [`ReadError::code`].
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The spelling is not that of a relative path: empty, absolute, with a drive or scheme, or with control characters.
    #[error("reference {reference:?} {reason}")]
    Spelling {
        /// Reference as written in the file; `%XX` of a URI is decoded.
        reference: String,
        /// Predicate of the message, such as "is absolute".
        reason: &'static str,
    },
    /// It leads out of all search paths, by `..` or through a link.
    #[error("reference {reference:?} leads out of the folder of the file that was opened")]
    Outside {
        /// Reference as written in the file; `%XX` of a URI is decoded.
        reference: String,
    },
    /// No search path holds the file.
    #[error("file {reference:?} is not found")]
    Missing {
        /// Reference as written in the file; `%XX` of a URI is decoded.
        reference: String,
    },
    /// The file is longer than the limit; it is not read.
    #[error("file {reference:?} is longer than {} bytes", crate::limits::grouped(*limit))]
    TooLong {
        /// Reference as written in the file; `%XX` of a URI is decoded.
        reference: String,
        /// Largest allowed length, bytes.
        limit: u64,
    },
    /// A system call failed, or the path is a folder, a pipe or a device.
    #[error("cannot read {reference:?}: {source}")]
    Io {
        /// Reference as written in the file; `%XX` of a URI is decoded.
        reference: String,
        /// Error of the system call; `InvalidInput` for what is no regular file.
        source: io::Error,
    },
}

impl ReadError {
    /// X009 for references that are misspelt or lead out of the search paths, X010 for the rest.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Spelling { .. } | Self::Outside { .. } => "X009",
            _ => "X010",
        }
    }

    /// What the user can do about it, as a sentence.
    pub fn help(&self) -> &'static str {
        match self {
            Self::Spelling { .. } => "write a path relative to this file, with '/'",
            Self::Outside { .. } | Self::Missing { .. } => {
                "put the file beside this one, or name its folder with --search DIR"
            }
            Self::TooLong { .. } => {
                "make the file smaller, or raise the limit with --max-mesh-bytes (meshes, pictures) or --max-text-bytes (texts)"
            }
            Self::Io { .. } => "only regular, readable files can be used",
        }
    }
}

/// A file that a reference named, read whole.
#[derive(Debug, Clone)]
pub struct ReferencedFile {
    /// Where it was found; references in it are resolved from here.
    pub path: PathBuf,
    /// Contents, not decoded; at most as many bytes as the limit of the call.
    pub bytes: Vec<u8>,
}

/// The folders from which references may be read; links that lead out of all of them are refused, except one that the user has opened.
#[derive(Debug, Clone, Default)]
pub struct SearchPaths {
    /// The folder of the opened file, then the search folders, all canonical.
    folders: Vec<PathBuf>,
    /// The opened file, canonical, if it is there. The scene around a lone grammar names it, and it may be a link that leads out.
    opened: Option<PathBuf>,
}

impl SearchPaths {
    /// The folder of a file named on the command line (the working folder for `-`), and `--search` folders.
    /// # Errors
    /// `Io` if one of them is not there.
    pub fn new(opened: &Path, search: &[PathBuf]) -> Result<Self> {
        let folder = folder_of(opened);
        let canonical = |p: &Path| p.canonicalize().map_err(|e| Error::io("open", p, e));
        let folders = std::iter::once(folder).chain(search.iter().map(PathBuf::as_path)).map(canonical);
        let opened_file = opened.canonicalize().ok().filter(|file| file.is_file());
        Ok(Self { folders: folders.collect::<Result<_>>()?, opened: opened_file })
    }

    /// Search paths without any folder, for texts that are not files, such as presets.
    pub fn none() -> Self {
        Self::default()
    }

    /// Reads the file that `reference` names in the file `from`, at most `limit` bytes: beside `from`, else in a search
    /// folder.
    /// # Errors
    /// [`ReadError`]: a spelling that is not a relative path, outside the search paths, missing, too long, or unreadable.
    pub fn read(&self, from: &Path, reference: &str, limit: u64) -> std::result::Result<ReferencedFile, ReadError> {
        let parts = spell(reference)?;
        let outside = || ReadError::Outside { reference: reference.into() };
        let missing = || ReadError::Missing { reference: reference.into() };
        let failed = |source| ReadError::Io { reference: reference.into(), source };
        let folder = folder_of(from);
        let beside = folder.canonicalize().ok().filter(|f| self.holds(f));
        let mut refusal = missing();
        // Search the folder of the referring file first. The first of `folders`, that of the opened file, is only an allowed
        // location and is not searched.
        for base in beside.iter().chain(self.folders.iter().skip(1)) {
            let Some(path) = below(base, &parts).filter(|p| self.holds(p)) else {
                refusal = outside();
                continue;
            };
            match path.canonicalize() {
                Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {}
                Err(e) => return Err(failed(e)),
                // The canonical path resolves links, so that a link inside a folder cannot lead out of it.
                Ok(real) if !self.holds(&real) && self.opened.as_ref() != Some(&real) => refusal = outside(),
                Ok(real) => {
                    let file = open_regular(&real, false).map_err(failed)?;
                    let too_long = || ReadError::TooLong { reference: reference.into(), limit };
                    // The declared length refuses a huge file without reading it; the limited read covers a file that
                    // grows meanwhile.
                    if file.metadata().map_err(failed)?.len() > limit {
                        return Err(too_long());
                    }
                    let bytes = read_limited(file, limit).map_err(failed)?.ok_or_else(too_long)?;
                    // References in an opened link are resolved beside the link.
                    return Ok(ReferencedFile { path: if self.holds(&real) { real } else { path }, bytes });
                }
            }
        }
        Err(refusal)
    }

    /// As [`SearchPaths::read`] for a glTF uri: decodes `%XX` once, before any check.
    /// # Errors
    /// [`ReadError::Spelling`] for a malformed `%` escape, else as [`SearchPaths::read`].
    pub fn read_uri(&self, from: &Path, uri: &str, limit: u64) -> std::result::Result<ReferencedFile, ReadError> {
        let decoded = percent_decode(uri)
            .ok_or(ReadError::Spelling { reference: uri.into(), reason: "has a malformed % escape" })?;
        self.read(from, &decoded, limit)
    }

    /// Sorted names of the regular files in the folder of `from` that end with `ending`, which is in lower case and matches
    /// either case. Empty if the folder is outside the search paths or has more than 10,000 entries.
    pub fn names_beside(&self, from: &Path, ending: &str) -> Vec<String> {
        const MOST: usize = 10_000;
        let folder = folder_of(from);
        let Some(entries) =
            folder.canonicalize().ok().filter(|f| self.holds(f)).and_then(|f| std::fs::read_dir(f).ok())
        else {
            return Vec::new();
        };
        let mut names = Vec::new();
        for (i, entry) in entries.flatten().enumerate() {
            if i >= MOST {
                return Vec::new();
            }
            let name = entry.file_name().to_string_lossy().into_owned();
            // Folders and pipes with such a name are left out.
            let is_file = || entry.path().metadata().is_ok_and(|m| m.is_file());
            if name.len() > ending.len() && name.to_ascii_lowercase().ends_with(ending) && is_file() {
                names.push(name);
            }
        }
        names.sort();
        names
    }

    fn holds(&self, path: &Path) -> bool {
        self.folders.iter().any(|f| path.starts_with(f))
    }
}

/// Components of a reference without empty ones and `.`; `..` is kept. An error for a spelling that is refused.
fn spell(reference: &str) -> std::result::Result<Vec<String>, ReadError> {
    let refuse = |reason| Err(ReadError::Spelling { reference: reference.into(), reason });
    // Exporters on Windows write backslashes.
    let path = reference.replace('\\', "/");
    if path.is_empty() {
        return refuse("is empty");
    }
    if path.chars().any(char::is_control) {
        return refuse("holds control characters");
    }
    if path.starts_with('/') {
        return refuse("is absolute");
    }
    if path.starts_with('~') {
        return refuse("starts with ~");
    }
    if has_scheme(&path) {
        return refuse("names a drive or a network address");
    }
    let parts: Vec<String> = path.split('/').filter(|c| !matches!(*c, "" | ".")).map(str::to_owned).collect();
    // Some systems drop dots and spaces at the end of a name.
    let blank = |c: &String| c != ".." && c.trim_end_matches(['.', ' ']).is_empty();
    if parts.is_empty() || parts.iter().any(blank) || path.ends_with('/') {
        return refuse("is not the name of a file");
    }
    Ok(parts)
}

/// True for `word:` at the start, which is a scheme, a drive or a stream.
fn has_scheme(path: &str) -> bool {
    let Some((word, _)) = path.split_once(':') else { return false };
    // A scheme after RFC 3986, section 3.1: a letter, then letters, digits, `+`, `-` and `.`.
    word.starts_with(|c: char| c.is_ascii_alphabetic())
        && word.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
}

/// `base` followed by the components, of which `..` removes the last component without regard to links; `None` if there is none
/// left to remove.
fn below(base: &Path, parts: &[String]) -> Option<PathBuf> {
    let mut path = base.to_owned();
    for part in parts {
        if part == ".." {
            if !path.pop() {
                return None;
            }
        } else {
            path.push(part);
        }
    }
    Some(path)
}

/// `%XX` replaced by its byte, once; `None` if an escape is malformed or the result is not UTF-8.
fn percent_decode(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes().iter();
    while let Some(&b) = rest.next() {
        if b == b'%' {
            let mut digit = || char::from(*rest.next()?).to_digit(16);
            let value = digit()? * 16 + digit()?;
            bytes.push(u8::try_from(value).ok()?);
        } else {
            bytes.push(b);
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_decoded_once() {
        assert_eq!(percent_decode("a%20b%252e").as_deref(), Some("a b%2e"));
        for bad in ["%", "%2", "%zz", "%ff", "%+1"] {
            assert_eq!(percent_decode(bad), None, "{bad}");
        }
    }
}
