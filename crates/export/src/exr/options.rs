//! Options of the EXR writer.

/// What is written of map sequences beside their layers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExrOptions {
    /// All maps laid together.
    pub atlas: bool,
}
