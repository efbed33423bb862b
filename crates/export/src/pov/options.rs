//! Options of the POV-Ray writer.

use crate::file_target::FileTarget;

/// Options of a [`PovExporter`](super::PovExporter): frames, units, photons, motion blur and files.
#[derive(Debug, Clone, PartialEq)]
pub struct PovOptions {
    /// Interval of written frames, >= 1; 1 writes all.
    pub step: u32,
    /// POV-Ray units per metre. At 100, POV-Ray's fixed tolerances do not damage drops of a millimetre.
    pub units_per_m: f32,
    /// Smallest radius of drops that are targets of photons, m; `None` traces no photons.
    pub photons: Option<f32>,
    /// Share of the frame interval for which the shutter is open, 0 to 1.
    pub shutter: f32,
    /// Width and height of the rendered image, pixels.
    pub size: (u32, u32),
    /// The files of a bake in `pov/`, or a single file with further files in `<stem>_files/`.
    pub target: FileTarget,
}

impl Default for PovOptions {
    fn default() -> Self {
        let size = (800, 600);
        Self { step: 1, units_per_m: 100.0, photons: None, shutter: 0.5, size, target: FileTarget::Bake }
    }
}
