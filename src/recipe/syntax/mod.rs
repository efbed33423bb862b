//! The notation of scene files: the TOML tree with spans, declarations of keys, value types and the hash of values.

mod digest;
mod form;
mod key;
mod registry;
mod renamed;
mod tree;
mod value_types;

pub use digest::Digest;
pub use form::{ValueForm, ValueKind};
pub use key::{Fault, KeyInfo, KeyListing, KeyTable, RecipePart, TableInfo, TableReader, ValueType};
pub(super) use key::{choices, finite_number, is_basic, is_list, join, keys, outside, wrong};
pub use registry::Registry;
pub(super) use registry::{digest_field, list_table, recipe};
pub use tree::path_element;
pub(super) use tree::{TomlEntry, TomlNode, TomlTable, TomlValue, apply_override, parse};
pub(super) use value_types::*;
pub use value_types::{Choice, Reference, word_of};
