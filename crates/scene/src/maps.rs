//! Map sequences: maps over the texture coordinates of a surface that change from frame to frame, such as the height of water on
//! a leaf. The simulation that fills a sequence names its layers, exporters write whatever they find.

use std::sync::Arc;

/// Meaning and range of the numbers of a map, and how files store them as numbers from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MapEncoding {
    /// Height over the surface, m; stored as height / [`MapSequence::height_range`], 0 for a negative height.
    Height,
    /// Thickness of a coat, m, not negative; stored as thickness / [`MapSequence::height_range`].
    Thickness,
    /// A share or weight from 0 to 1; stored unchanged.
    Unit,
    /// Unit normals in tangent space: along u, along v, out of the surface; stored as 0.5 n + 0.5.
    Normal,
}

/// One kind of map of a sequence: its name in files and what its numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MapLayer {
    /// File stem, `[a-z0-9_]+`, unique in the sequence.
    pub name: &'static str,
    /// Kind of its files in the manifest, `exr.NAME`.
    pub file_kind: &'static str,
    /// What its numbers are; normals come as [`MapTexels::Vector`], all others as [`MapTexels::Scalar`].
    pub encoding: MapEncoding,
}

/// Maps of one surface at all frames.
#[derive(Debug, Clone)]
pub struct MapSequence {
    /// Folder in `maps/`, `[a-z0-9_]+`, unique in the scene: `twig_l0012`.
    pub name: String,
    /// Texels along each side of the square maps.
    pub side: usize,
    /// Height that 1 in a map of heights stands for, m.
    pub height_range: f32,
    /// Its maps, in the order in which files are written.
    pub layers: Vec<MapLayer>,
    /// The maps of a scene that does not move; `None` if frames hold them.
    pub rest: Option<MapFrame>,
}

/// Texels of a map, row 0 at v = 1. Frames share the memory of maps that stay the same.
#[derive(Debug, Clone, PartialEq)]
pub enum MapTexels {
    /// One number per texel.
    Scalar(Arc<Vec<f32>>),
    /// Three numbers per texel.
    Vector(Arc<Vec<[f32; 3]>>),
}

/// Maps of one surface at one frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapFrame {
    /// `side * side` texels for each layer of the sequence.
    pub layers: Vec<MapTexels>,
}

impl MapEncoding {
    /// Numbers per texel: 3 for normals, else 1.
    pub fn channels(self) -> usize {
        if self == Self::Normal { 3 } else { 1 }
    }
}

impl MapSequence {
    /// Index in `layers` of the layer of this name; none if there is none.
    pub fn layer(&self, name: &str) -> Option<usize> {
        self.layers.iter().position(|l| l.name == name)
    }

    /// Number of texels of one map: `side` squared.
    pub fn texels(&self) -> usize {
        self.side.saturating_mul(self.side)
    }
}

impl MapTexels {
    /// All numbers, texel after texel.
    pub fn as_flat(&self) -> &[f32] {
        match self {
            Self::Scalar(v) => v,
            Self::Vector(v) => v.as_flattened(),
        }
    }

    /// True if both are the same memory, and hence equal.
    pub fn is_shared_with(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Scalar(a), Self::Scalar(b)) => Arc::ptr_eq(a, b),
            (Self::Vector(a), Self::Vector(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

impl MapFrame {
    /// The texels of the layer of this index; none if there is no such layer or it holds vectors.
    pub fn scalars(&self, layer: usize) -> Option<&Arc<Vec<f32>>> {
        if let MapTexels::Scalar(v) = self.layers.get(layer)? { Some(v) } else { None }
    }

    /// The texels of the layer of this index; none if there is no such layer or it holds single numbers.
    pub fn vectors(&self, layer: usize) -> Option<&Arc<Vec<[f32; 3]>>> {
        if let MapTexels::Vector(v) = self.layers.get(layer)? { Some(v) } else { None }
    }
}
