//! The registry of formats: every format of the crate, found by its name or by the ending of a file.
//!
//! A new format is one file (or folder) with its [`Exporter`](super::Exporter) and its `pub const FORMAT: FormatInfo`, and one
//! line in the list `formats!` of this crate. The words of `[output] formats` and `--formats`, `osier list formats`, the
//! endings of `osier grow -o`, predicted sizes and memory, the folders that the manifest assigns to assets and the table in
//! docs/formats.md all read the registry.
//!
//! ```
//! use osier_export::registry::{FORMATS, by_ending, by_word};
//!
//! assert_eq!(by_word("usd").map(|f| f.folder), Some("usd"));
//! assert_eq!(by_ending("glb").map(|f| f.word), Some("glb"));
//! assert!(FORMATS.iter().all(|f| !f.about.is_empty()));
//! ```

use super::format::FormatInfo;

/// Every format of a bake, in the order in which they are listed.
pub const FORMATS: &[&FormatInfo] = super::FORMATS;

/// The format whose [`FormatInfo::word`] is this one, in lower case; `None` if there is none.
pub fn by_word(word: &str) -> Option<&'static FormatInfo> {
    FORMATS.iter().find(|f| f.word == word).copied()
}

/// The format that writes single files of an ending, without its dot, in lower case.
pub fn by_ending(ending: &str) -> Option<&'static FormatInfo> {
    FORMATS.iter().find(|f| f.endings.iter().any(|(e, _)| *e == ending)).copied()
}

/// Endings of single files without the dot, each with one line for listings, in the order of the registry.
pub fn endings() -> impl Iterator<Item = (&'static str, &'static str)> {
    FORMATS.iter().flat_map(|f| f.endings.iter().copied())
}

/// The words of all formats, separated by commas, for help texts.
pub fn words() -> String {
    FORMATS.iter().map(|f| f.word).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_endings_are_unique() {
        let unique = |mut all: Vec<&str>| {
            let n = all.len();
            all.sort_unstable();
            all.dedup();
            all.len() == n
        };
        assert!(unique(FORMATS.iter().map(|f| f.word).collect()));
        assert!(unique(endings().map(|(ending, _)| ending).collect()));
        assert!(unique(FORMATS.iter().map(|f| f.folder).collect()));
    }
}
