//! Measured fields: numbers over a rectangle of land.

/// Heights of the terrain as generated or read, on a grid that may be finer than its mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    /// Material of the land; names the file.
    pub name: String,
    /// Number of heights along x and along z.
    pub counts: [usize; 2],
    /// Lengths along x and along z, m.
    pub size: [f32; 2],
    /// Centre in the world: x and z, m.
    pub center: [f32; 2],
    /// `counts[0] * counts[1]` heights, m: rows from -z to +z, in each from -x to +x.
    pub heights: Vec<f32>,
}
