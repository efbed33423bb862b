//! Iterated function systems: coefficient files, attractors as points and pictures, words, leaves.
//!
//! A system is a list of affine maps with weights. [`read`] makes [`Ifs`]s of files, [`weights`] and [`dynamics`] judge
//! them, [`game`] draws their attractors, [`words`] expands them level by level.

#![allow(clippy::needless_range_loop, reason = "steps, lanes and pixels index several arrays at once")]

pub mod affine;
pub mod cloud;
pub mod color;
mod cylinders;
pub mod dynamics;
pub mod faces;
pub mod game;
pub mod histogram;
pub mod leaf;
pub mod morph;
pub mod picture;
mod polar;
pub mod read;
mod splat;
pub mod stems;
pub mod tile;
pub mod weights;
mod window;
pub mod words;
pub mod write;

use affine::Affine;
pub use affine::Branch;
use osier_base::diagnostic::Span;

/// Largest magnitude of a coefficient.
pub const MAX_COEFFICIENT: f64 = 1e12;

/// One system of affine maps.
#[derive(Debug, Clone, PartialEq)]
pub struct Ifs {
    /// As written in its file.
    pub name: String,
    /// 2 or 3; a plane attractor lies in z = 0.
    pub dim: usize,
    /// The maps, in the order of the file.
    pub maps: Vec<Map>,
    /// Factors on the weights of the next map (column) by the last one (row).
    pub chaos: Option<Vec<Vec<f64>>>,
    /// Applied to what is shown, never fed back.
    pub last: Option<Affine>,
    /// Sets that every map's images are added to.
    pub condensation: Vec<Condensation>,
    /// What the file says about the picture.
    pub view: Option<PictureView>,
    /// Linear RGB by colour coordinate, or empty.
    pub palette: Vec<[f32; 3]>,
    /// Where the probabilities come from, if the file says so.
    pub weights: Option<weights::WeightRule>,
    /// Its name in the file.
    pub span: Span,
}

/// One map w(x) = A x + b with what belongs to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// The affine map itself.
    pub affine: Affine,
    /// Weight as written; `None` where the file gives none.
    pub weight: Option<f64>,
    /// Linear RGB of the map's points.
    pub color: Option<[f32; 3]>,
    /// Place in the palette, 0..1.
    pub coord: f64,
    /// Share of the way to `coord` per step, 0..1.
    pub speed: f64,
    /// Share of its points that are shown, 0..1.
    pub opacity: f64,
    /// Factor on radii; `None`: the scale.
    pub radius: Option<f64>,
    /// How it was written, for maps of trees.
    pub branch: Option<Branch>,
    /// Continues its parent's axis.
    pub axis: bool,
    /// Squashes the whole into a stem and never branches.
    pub stem: bool,
    /// Bears a leaf where its word is cut.
    pub leaf: bool,
    /// Its place in the file.
    pub span: Span,
}

impl Map {
    /// A map without colour, tree or palette data.
    pub fn new(affine: Affine, weight: Option<f64>, span: Span) -> Self {
        Self {
            affine,
            weight,
            color: None,
            coord: 0.0,
            speed: 0.5,
            opacity: 1.0,
            radius: None,
            branch: None,
            axis: false,
            stem: false,
            leaf: true,
            span,
        }
    }
}

/// A set that belongs to the attractor as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Condensation {
    /// Geometry of the set.
    pub shape: CondensationShape,
    /// Share of the points that jump into it.
    pub weight: f64,
}

/// Form of a condensation set.
#[derive(Debug, Clone, PartialEq)]
pub enum CondensationShape {
    /// A capsule in space, a thick line in the plane.
    Segment {
        /// First end, table units.
        from: [f64; 3],
        /// Second end, table units.
        to: [f64; 3],
        /// Half its thickness.
        radius: f64,
    },
    /// A disc in the plane z = const.
    Disc {
        /// Centre, table units.
        center: [f64; 3],
        /// Radius, table units.
        radius: f64,
    },
    /// A convex polygon in the plane, at least three corners.
    Polygon {
        /// Corners in order, table units.
        points: Vec<[f64; 2]>,
    },
    /// The triangles of a mesh file, in space.
    Mesh(faces::MeshReference),
}

/// What a file says about its picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureView {
    /// Middle, table units, y up.
    pub center: [f64; 2],
    /// Width of the picture, table units.
    pub width: f64,
    /// Turn of the picture, rad.
    pub rotate: f64,
    /// Width over height in pixels.
    pub aspect: f64,
    /// Linear RGB of the background.
    pub background: [f32; 3],
}

#[cfg(test)]
pub(crate) mod tests;
