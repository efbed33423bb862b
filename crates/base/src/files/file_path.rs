//! The two parts of the path of a file.

use std::path::Path;

/// Folder of a file; `.` for a name alone.
/// # Examples
/// ```
/// use osier_base::files::folder_of;
/// use std::path::Path;
///
/// assert_eq!(folder_of(Path::new("out/oak.glb")), Path::new("out"));
/// assert_eq!(folder_of(Path::new("oak.glb")), Path::new("."));
/// ```
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Name of a file without its folder; characters that are not Unicode are replaced. Empty for a path without a name, as `..` and `/`.
pub fn name_of(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}
