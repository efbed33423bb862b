//! Options of OpenVDB files.

use crate::up_axis::UpAxis;

/// How voxel grids are stored.
#[derive(Debug, Clone, Copy)]
pub struct VdbOptions {
    /// Values in half precision, unless one exceeds its range.
    pub half: bool,
    /// Values compressed with zlib.
    pub zip: bool,
    /// Axis that points up in the files: that of the USD stage that shows them.
    pub up: UpAxis,
}

impl Default for VdbOptions {
    fn default() -> Self {
        Self { half: true, zip: true, up: UpAxis::Y }
    }
}
