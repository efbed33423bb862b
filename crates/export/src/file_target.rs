//! The choice between the files of a bake and a single file.

/// Whether a format writes the files of a bake or a single file; determines the paths of its files.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum FileTarget {
    /// Files per asset in the folders of a bake.
    #[default]
    Bake,
    /// One file of this name for the whole scene; further files that it refers to are in `<stem>_files/`.
    Single(String),
}

/// A file name without its ending.
pub(crate) fn file_stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}
