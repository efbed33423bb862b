//! Options of the POV-Ray writer.

use crate::file_target::FileTarget;

/// What can be chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct PovOptions {
    /// Every how many frames one is written, >= 1; the others show the nearest written one.
    pub step: u32,
    /// POV-Ray units per metre. At 100 POV-Ray's fixed tolerances leave millimetre drops whole.
    pub units_per_m: f32,
    /// Shoot photons through drops of at least this radius, m.
    pub photons: Option<f32>,
    /// Share of the time between two frames for which the shutter is open, 0..1.
    pub shutter: f32,
    /// Width and height of the picture in pixels.
    pub size: (u32, u32),
    /// Where the files go.
    pub target: FileTarget,
}

impl Default for PovOptions {
    fn default() -> Self {
        let size = (800, 600);
        Self { step: 1, units_per_m: 100.0, photons: None, shutter: 0.5, size, target: FileTarget::Bake }
    }
}
