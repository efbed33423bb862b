//! The only place where files are opened and written.
//!
//! Reading: references inside files stay inside their folder. Writing: a file appears whole or not at all, and a journal
//! in the output folder says which files are ours and finished.

mod disk;
mod folder;
mod inspect;
mod journal;
mod late_hash;
mod mark;
mod names;
mod number;
mod output;
mod parts;
mod read;
mod roots;
mod shelf;
mod text;

pub use disk::{Disk, System};
pub use folder::{FileRecord, Folder, MANIFEST, WriteOptions};
pub use inspect::{hash_file, list_files, read_below};
pub use journal::is_settled;
pub use names::{Names, safe_name};
pub use number::{BadNumber, number};
pub use output::Output;
pub use parts::drop_parts;
pub use read::read_input;
pub use roots::{Referred, Refusal, Roots};
pub use shelf::Shelf;
pub use text::{BadText, Encoding, Text, decode};
