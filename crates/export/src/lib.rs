//! Writers of scenes as files of other programs: USD, glTF, POV-Ray, OBJ, PLY, OpenEXR, OpenVDB, point caches, tables,
//! plants for Unreal Engine.
//!
//! An exporter has three calls: [`Exporter::begin`] with the scene, [`Exporter::frame`] for each frame in order (none without
//! animation), [`Exporter::finish`]. Frames are streamed: only formats that require it keep more than one in memory.
//!
//! ```
//! use osier_export::registry::FORMATS;
//!
//! let words: Vec<&str> = FORMATS.iter().map(|format| format.word).collect();
//! assert!(words.contains(&"usd") && words.contains(&"pov"));
//! ```

use std::sync::Arc;

use osier_base::Result;
use osier_scene::{Frame, Scene};

pub mod air;
pub mod estimate;
pub mod file_target;
pub mod format;
pub mod manifest;
pub mod map_sequences;
mod merge;
pub mod options;
pub mod registry;
mod skin_remap;
pub mod text;
pub mod textures;
mod up_axis;
mod world_joints;

/// Declares the module of each format and lists their `FORMAT`s, so that a format is one line here. `cargo fmt` does not find
/// modules that a macro declares: `.ci/run` formats them by name.
macro_rules! formats {
    ($($module:ident,)+) => {
        $(pub mod $module;)+
        /// The formats of [`registry::FORMATS`].
        const FORMATS: &[&format::FormatInfo] = &[$(&$module::FORMAT,)+];
    };
}

// Formats in the order of listings.
formats! {
    usd,
    gltf,
    pc2,
    obj,
    ply,
    pov,
    exr,
    stats,
    tracks,
    points,
    vdb,
    unreal,
}

/// A warning of something that the format cannot represent and how it was written instead (X002, X003, X007 ...).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// Code that does not change between versions; docs/codes.md lists them.
    pub code: &'static str,
    /// What the exporter found and what it wrote instead, without the code.
    pub message: String,
}

/// The result of an exporter. The files are recorded by the output folder.
#[derive(Debug, Clone, Default)]
pub struct Summary {
    /// Warnings in the order of the scene's assets.
    pub warnings: Vec<Warning>,
}

/// Writes a scene in one format: `begin`, then `frame` in the order of frames, then `finish`.
pub trait Exporter: Send {
    /// Takes the scene, opens files, writes what does not change with the frames.
    /// # Errors
    /// `Io`, and X codes for what the format cannot represent.
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()>;

    /// Whether the exporter needs frame `number` with the states of assets at the phases of their
    /// placements, not only at phase 0.
    fn wants_phases(&self, number: u32) -> bool {
        let _ = number;
        false
    }

    /// Takes the next frame; most formats write it at once, others keep what [`Self::finish`] needs.
    /// # Errors
    /// As [`Self::begin`].
    fn frame(&mut self, frame: &Frame) -> Result<()>;

    /// Completes and closes the files; returns warnings about the whole clip.
    /// # Errors
    /// As [`Self::begin`].
    fn finish(&mut self) -> Result<Summary>;
}

/// Name and version of the program, as files name their generator: `osier 0.1.0`.
pub const GENERATOR: &str = concat!("osier ", env!("CARGO_PKG_VERSION"));

/// Version of the program without its name, which manifests and layers record.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
