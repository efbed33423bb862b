//! Options of OpenVDB files.

use crate::up_axis::UpAxis;

/// Precision, compression and axes of voxel grids in files.
#[derive(Debug, Clone, Copy)]
pub struct VdbOptions {
    /// Whether values have half precision, unless one exceeds its range.
    pub half: bool,
    /// Whether values are compressed with zlib.
    pub zip: bool,
    /// Axis that points up in the files, the same as in a USD stage beside them.
    pub up: UpAxis,
}

impl Default for VdbOptions {
    fn default() -> Self {
        Self { half: true, zip: true, up: UpAxis::Y }
    }
}
