//! Recognises files that osier wrote by the generator's name inside the file, for folders without a journal.

use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use super::file_system::open_regular;

/// Bytes searched at either end of a file.
const WINDOW: u64 = 1 << 16;

/// True if a regular file names osier as its maker near its beginning or end.
pub(super) fn names_osier(path: &Path) -> bool {
    let Ok(mut file) = open_regular(path, false) else { return false };
    let mut window = Vec::new();
    if file.by_ref().take(WINDOW).read_to_end(&mut window).is_err() {
        return false;
    }
    if names_osier_in(&window) {
        return true;
    }
    // Some formats end with their metadata. In a long file the window of the head does not reach it.
    let length = file.metadata().map_or(0, |m| m.len());
    let mut tail = Vec::new();
    let from = SeekFrom::Start(length.saturating_sub(WINDOW));
    file.seek(from).is_ok() && file.take(WINDOW).read_to_end(&mut tail).is_ok() && names_osier_in(&tail)
}

/// True if `osier` occurs in the bytes before a version or as the value of `generator`, or anywhere in a USD crate file, whose
/// texts are compressed.
fn names_osier_in(bytes: &[u8]) -> bool {
    const WORD: &[u8] = b"osier";
    let is_maker = |i: usize| {
        let after = &bytes[(i + WORD.len()).min(bytes.len())..];
        let versioned = after.first() == Some(&b' ') && after.get(1).is_some_and(u8::is_ascii_digit);
        versioned || bytes[..i].ends_with(b"\"generator\": \"") || bytes.starts_with(b"PXR-USDC")
    };
    bytes.windows(WORD.len()).enumerate().any(|(i, w)| w == WORD && is_maker(i))
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "tests look at the disk themselves")]
mod tests {
    use super::*;

    #[test]
    fn the_mark_is_a_maker_not_a_willow() {
        for ours in ["# osier 0.1.0\n", "tEXtSoftware\0osier 0.1.0", "{\"generator\": \"osier\"", "PXR-USDC..osier.."] {
            assert!(names_osier_in(ours.as_bytes()), "{ours}");
        }
        for other in ["", "osie", "an osier basket", "# model of an osier, 3 m", "osier"] {
            assert!(!names_osier_in(other.as_bytes()), "{other}");
        }
    }

    #[test]
    fn the_mark_may_stand_at_the_end() {
        let dir = tempfile::tempdir().expect("dir");
        let path = dir.path().join("a");
        let mut bytes = vec![0; 300_000];
        std::fs::write(&path, &bytes).expect("write");
        assert!(!names_osier(&path));
        bytes.extend_from_slice(b"osier 0.1.0");
        std::fs::write(&path, &bytes).expect("write");
        assert!(names_osier(&path));
    }
}
