//! Options of the EXR writer.

/// Choices of [`ExrExporter`](super::ExrExporter), the table `[output.exr]` of a scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExrOptions {
    /// Whether the maps of all sequences are also packed into atlases.
    pub atlas: bool,
}
