//! Options of the USD writer.

use super::axis::UpAxis;

/// What may be chosen about USD files.
#[derive(Debug, Clone, PartialEq)]
pub struct UsdOptions {
    /// Which way is up.
    pub up: UpAxis,
    /// Write everything into one file of this name (`.usda`, `.usdc`, `.usdz`) instead of a wrapper and payloads.
    pub file: Option<String>,
    /// Write camera and lights.
    pub look: bool,
    /// Wet leaves show the maps that the exporter of EXR writes beside; without, they are dry.
    pub maps: bool,
    /// First frame that is written; without, the clip's.
    pub first: Option<u32>,
    /// How copies of a plant are shown.
    pub copies: CopyStyle,
    /// How far leaves between two samples may be from where they were simulated.
    pub tolerance: Tolerance,
}

/// Errors that tracks are thinned to. 0 keeps the samples of every frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tolerance {
    /// Of places, m.
    pub metres: f32,
    /// Of rotations, rad.
    pub radians: f32,
}

/// How several placements of a plant are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CopyStyle {
    /// One point instancer for each plant, its prototypes whole plants.
    #[default]
    Instancer,
    /// A prim for each placement, which refers to its individual.
    References,
}

impl Default for UsdOptions {
    fn default() -> Self {
        Self {
            up: UpAxis::Y,
            file: None,
            look: true,
            maps: false,
            first: None,
            copies: CopyStyle::default(),
            tolerance: Tolerance::default(),
        }
    }
}
