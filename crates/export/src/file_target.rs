//! The choice between the files of a bake and a single file.

/// Which files a format writes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum FileTarget {
    /// Files per asset in the folders of a bake.
    #[default]
    Bake,
    /// One file of this stem for the whole scene, and what belongs to it in `<stem>_files/`.
    Single(String),
}
