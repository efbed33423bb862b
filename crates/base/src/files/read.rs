//! Bytes of files that a person named.

use std::fs::File;
use std::path::Path;

use super::file_system::{read_limited, retry};
use crate::{Error, Result};

/// Bytes of a file named by the user (a file, a pipe, a link; `-` is standard input), at most `limit` of them.
/// # Errors
/// `Io` if it cannot be read, `Limit` if it is longer.
pub fn read_input(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let bytes = if path == Path::new("-") {
        read_limited(std::io::stdin().lock(), limit)
    } else {
        #[allow(clippy::disallowed_methods, reason = "this is the place")]
        let file = retry(|| File::open(path)).map_err(|e| Error::io("open", path, e))?;
        read_limited(file, limit)
    };
    bytes.map_err(|e| Error::io("read", path, e))?.ok_or_else(|| too_long(path, limit))
}

pub(super) fn too_long(path: &Path, limit: u64) -> Error {
    Error::Limit {
        name: format!("size of \"{}\"", path.display()),
        wanted: "more".into(),
        limit: format!("{} bytes", crate::limits::grouped(limit)),
        flag: "--max-text-bytes or --max-mesh-bytes".into(),
    }
}
