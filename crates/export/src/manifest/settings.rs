//! Options of the exporters in the manifest.

/// Options of the exporters that the manifest records.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Hash of the scene and of the selection of its frames; `None`: that of the scene.
    pub hash: Option<String>,
    /// Up axis of the USD files, `Y` or `Z`.
    pub up_axis: String,
    /// Time samples from one frame to the next, >= 1.
    pub substeps: u32,
    /// Largest step that reaches all written frames from the first one, at least 1.
    pub step: u32,
    /// First and last frame that is written; `None`: the whole clip.
    pub written: Option<[u32; 2]>,
    /// Frames after which the motion repeats; `None` if it does not.
    pub loop_frames: Option<u32>,
    /// Width and height of the pictures that the camera is set up for, pixels.
    pub size: [u32; 2],
    /// Fraction of the frame interval for which the shutter is open, 0 to 1.
    pub shutter: f32,
    /// Units of the POV-Ray scene in one metre; at 100, a unit is a centimetre.
    pub pov_units_per_m: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            hash: None,
            up_axis: "Y".into(),
            substeps: 1,
            step: 1,
            written: None,
            loop_frames: None,
            size: [800, 600],
            shutter: 0.5,
            pov_units_per_m: 100.0,
        }
    }
}
