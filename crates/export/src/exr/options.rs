//! Options of the EXR writer.

/// What is written of wet sheets beside height, wetness and normals.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExrOptions {
    /// Heights of water alone.
    pub water: bool,
    /// All maps laid together.
    pub atlas: bool,
}
