//! Options of the EXR writer.

/// Options of the EXR writer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExrOptions {
    /// Write the maps of all sequences packed into atlases, too.
    pub atlas: bool,
}
