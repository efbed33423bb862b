//! Measured fields: numbers over a rectangle of land.

/// Heights of land as they were made, finer than a mesh may show them.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    /// Material of the land; names the file.
    pub name: String,
    /// Number of heights along x and along z.
    pub counts: [usize; 2],
    /// Lengths along x and along z, m.
    pub size: [f32; 2],
    /// Middle, x and z, m.
    pub center: [f32; 2],
    /// Heights, m: rows from -z to +z, in each from -x to +x.
    pub heights: Vec<f32>,
}
