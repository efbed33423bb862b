//! Writing of assembled scenes to files, and estimates of their sizes.

pub mod bake_estimate;
pub mod estimate;
pub mod exporters;
pub mod frame_loop;
pub(crate) mod memory;
pub mod single_file;
pub(crate) mod texture_bytes;
pub mod texture_size;
pub(crate) mod unselected;
