//! Files for other programs. An exporter knows one format and nothing of parsing, growth, threads or clocks.
//!
//! Every exporter is three calls: [`Exporter::begin`], [`Exporter::frame`] once per frame in order (none for a still
//! asset), [`Exporter::finish`]. Frames stream: only formats that demand it keep more than one.

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
pub mod pov;
pub mod registry;
pub mod stats;
pub mod text;
pub mod textures;
pub mod tracks;
pub mod usd;

/// A warning about something that was repaired on the way out (X002, X003, X007 ...).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// Stable code.
    pub code: &'static str,
    /// Subject, fact, what was done.
    pub message: String,
}

/// What an exporter has to say at the end. The files themselves are recorded by the output folder.
#[derive(Debug, Clone, Default)]
pub struct Summary {
    /// In asset order.
    pub warnings: Vec<Warning>,
}

/// One format. `begin`, then `frame` in frame order, then `finish`.
pub trait Exporter: Send {
    /// Takes the scene, opens files, writes what never changes.
    /// # Errors
    /// Whatever cannot be written; X codes.
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()>;

    /// True if it wants to know what placements show at phases of their own at this frame.
    fn wants_phases(&self, number: u32) -> bool {
        let _ = number;
        false
    }

    /// Writes one frame.
    /// # Errors
    /// Whatever cannot be written; X codes.
    fn frame(&mut self, frame: &Frame) -> Result<()>;

    /// Completes and closes the files.
    /// # Errors
    /// Whatever cannot be written; X codes.
    fn finish(&mut self) -> Result<Summary>;
}

/// Who made a file: `osier 0.1.0`.
pub const GENERATOR: &str = concat!("osier ", env!("CARGO_PKG_VERSION"));

/// Version alone.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
