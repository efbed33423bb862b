//! Options of the USD writer.

use crate::up_axis::UpAxis;

/// Options of the USD writer; the default is the full bake without map sequences.
#[derive(Debug, Clone, PartialEq)]
pub struct UsdOptions {
    /// Up axis of the stage, into which all geometry is converted.
    pub up: UpAxis,
    /// Write everything into one file of this name (`.usda`, `.usdc`, `.usdz`) instead of a wrapper and payloads.
    pub file: Option<String>,
    /// Whether camera and lights are written.
    pub look: bool,
    /// Width over height of the camera's picture, > 0.
    pub aspect: f32,
    /// Whether coated materials refer to the maps that the EXR writer writes; otherwise they look bare.
    pub maps: bool,
    /// Whether the wrapper refers to the volumes that the OpenVDB writer writes.
    pub volumes: bool,
    /// First frame that is written; `None`: that of the clip.
    pub first: Option<u32>,
    /// Instancers or separate prims for several placements of a plant.
    pub copies: CopyStyle,
    /// Largest error of the leaves' interpolated transforms; see [`Tolerance`].
    pub tolerance: Tolerance,
}

/// Error up to which time samples of the leaves' transforms are omitted. 0 m and 0 rad keep the samples of every frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tolerance {
    /// Distance from the simulated position, m, >= 0.
    pub metres: f32,
    /// Angle from the simulated orientation, rad, >= 0.
    pub radians: f32,
    /// Distance in the camera's picture by which 99 of 100 leaves may be off, pixels of a picture of
    /// [`osier_scene::PICTURE_ROWS`] rows, >= 0; the others by four times as much. 0: only the two errors above apply.
    pub pixels: f32,
}

/// Instancers or separate prims for several placements of a plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CopyStyle {
    /// One `PointInstancer` for each plant; its prototypes are whole plants.
    #[default]
    Instancer,
    /// A prim for each placement, with a payload of, or a reference to, the individual it shows.
    References,
}

impl Default for UsdOptions {
    fn default() -> Self {
        Self {
            up: UpAxis::Y,
            file: None,
            look: true,
            aspect: 16.0 / 9.0,
            maps: false,
            volumes: false,
            first: None,
            copies: CopyStyle::default(),
            tolerance: Tolerance::default(),
        }
    }
}
