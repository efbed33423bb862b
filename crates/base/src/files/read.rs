//! Reads files that the user named on the command line.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::file_system::{read_limited, retry};
use crate::{Error, Result};

/// Bytes of a file named by the user (a file, a pipe, a link; `-` is standard input), at most `limit` of them. Standard input
/// gives the same bytes to every call. `flag`: the flag that raises the limit, for the message; empty for none.
/// # Errors
/// `Io` if it cannot be read, `Limit` if it is longer.
pub fn read_input(path: &Path, limit: u64, flag: &str) -> Result<Vec<u8>> {
    let bytes = if path == Path::new("-") {
        standard_input(limit)
    } else {
        #[allow(clippy::disallowed_methods, reason = "this is the place")]
        let file = retry(|| File::open(path)).map_err(|e| Error::io("open", path, e))?;
        read_limited(file, limit)
    };
    bytes.map_err(|e| Error::io("read", path, e))?.ok_or_else(|| too_long(path, limit, flag))
}

/// Bytes of standard input; `None` if it has more than `limit`. They are kept, since a sweep reads its scene once for every run
/// and a pipe can be read only once.
fn standard_input(limit: u64) -> io::Result<Option<Vec<u8>>> {
    // Whether standard input has been read, and its bytes, or `None` if there were too many. The failure is kept too: a second
    // read would return only the rest of the bytes.
    static KEPT: Mutex<(bool, Option<Vec<u8>>)> = Mutex::new((false, None));
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if !kept.0 {
        *kept = (true, read_limited(io::stdin().lock(), limit)?);
    }
    Ok(kept.1.clone().filter(|bytes| bytes.len() as u64 <= limit))
}

pub(super) fn too_long(path: &Path, limit: u64, flag: &str) -> Error {
    Error::Limit {
        name: format!("size of \"{}\"", path.display()),
        wanted: "more".into(),
        limit: format!("{} bytes", crate::limits::grouped(limit)),
        flag: flag.into(),
        help: String::new(),
    }
}
