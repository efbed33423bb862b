//! Measured fields: numbers over a square of land.

/// Heights of land as they were made, finer than a mesh may show them.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    /// Material of the land; names the file.
    pub name: String,
    /// Heights along a side.
    pub side: usize,
    /// Length of a side, m.
    pub size: f32,
    /// Heights, m: `side * side`, rows from -z to +z, in each from -x to +x.
    pub heights: Vec<f32>,
}
