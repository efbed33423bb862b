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
pub mod exr;
pub mod file_target;
pub mod format;
pub mod gltf;
pub mod manifest;
pub mod map_sequences;
mod merge;
pub mod obj;
pub mod options;
pub mod pc2;
pub mod ply;
pub mod points;
pub mod pov;
pub mod registry;
mod skin_remap;
pub mod stats;
pub mod text;
pub mod textures;
pub mod tracks;
pub mod unreal;
mod up_axis;
pub mod usd;
pub mod vdb;
mod world_joints;

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
    /// In the order of the scene's assets.
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
