//! File access: the only module that opens and writes files.
//!
//! Reading: a reference inside a file is resolved within the [`SearchPaths`] and cannot leave them. Writing: a file of a
//! [`Folder`] appears whole under its name, by an atomic rename, or not at all; a journal in the output folder records which
//! files osier wrote and finished, so that an interrupted bake is resumed.
//!
//! # Examples
//! ```
//! use osier_base::files::Folder;
//!
//! let folder = Folder::memory();
//! folder.write("notes/a.txt", "text", b"two words")?;
//! assert_eq!(folder.files()[0].path, "notes/a.txt");
//! assert_eq!(folder.take("notes/a.txt").as_deref(), Some(&b"two words"[..]));
//! # Ok::<(), osier_base::Error>(())
//! ```

mod cache;
mod file_path;
mod file_system;
mod folder;
mod generator;
mod inspect;
mod journal;
mod number;
mod output;
mod part_file;
mod patchable_hash;
mod read;
mod search_paths;
mod text;
mod unique_names;

pub use cache::BakeCache;
pub use file_path::{folder_of, name_of};
pub use file_system::{Disk, SystemDisk};
pub use folder::{FileRecord, Folder, MANIFEST, WriteOptions};
pub use inspect::{check_writable, hash_file, list_files, read_below};
pub use journal::{has_finished_files, is_settled};
pub use number::{NumberError, number};
pub use output::Output;
pub use part_file::drop_parts;
pub use read::read_input;
pub use search_paths::{ReadError, ReferencedFile, SearchPaths};
pub use text::{DecodedText, Encoding, TextError, decode};
pub use unique_names::{Names, safe_name};
