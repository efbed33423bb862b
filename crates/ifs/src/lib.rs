//! Iterated function systems: coefficient files, attractors as points and pictures, words, leaves.
//!
//! A system is a list of affine maps with weights. [`read`] reads [`Ifs`]s from files, [`weights`] computes
//! probabilities, [`dynamics`] tests whether systems contract, [`game`] draws their attractors, [`words`] expands them
//! level by level.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::{dynamics::study, game::extent, read::read, weights::WeightRule};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, report) = read("sierpinski.ifs", text, &Limits::default())?;
//! assert!(!report.has_errors());
//! let analysis = study(&systems[0], WeightRule::File);
//! let (low, high) = extent(&systems[0], &analysis).expect("an attractor").bounds;
//! assert!(high.y - low.y > 0.99);
//! # Ok::<(), osier_base::Error>(())
//! ```

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

/// Largest magnitude of a number that readers accept in a file.
pub const MAX_COEFFICIENT: f64 = 1e12;

/// An iterated function system, with the colours and the picture window that its file states.
#[derive(Debug, Clone, PartialEq)]
pub struct Ifs {
    /// Name as written in the file.
    pub name: String,
    /// 2 or 3; a plane attractor lies in z = 0.
    pub dim: usize,
    /// The maps, in the order of the file; probabilities and letters of words count them in this order.
    pub maps: Vec<Map>,
    /// Factors on the weights of the next map (column) by the last one (row).
    pub chaos: Option<Vec<Vec<f64>>>,
    /// Final map: applied to the points when they are drawn, not fed back into the iteration.
    pub last: Option<Affine>,
    /// Condensation sets: K = C u w_1(K) u ... u w_m(K).
    pub condensation: Vec<Condensation>,
    /// Picture window and background, where the file states them.
    pub view: Option<PictureView>,
    /// Linear RGB at equal steps of the colour coordinate from 0 to 1; empty: two default greens.
    pub palette: Vec<[f32; 3]>,
    /// Where the probabilities come from, if the file says so.
    pub weights: Option<weights::WeightRule>,
    /// Location of the name in the file, for diagnostics.
    pub span: Span,
}

/// One map w(x) = A x + b, with its weight, its colours and its part in the branching of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Linear part and shift, table units.
    pub affine: Affine,
    /// Weight as written; `None` where the file gives none.
    pub weight: Option<f64>,
    /// Linear RGB of the points that the map makes; `None`: brown for a stem, otherwise one of the default greens.
    pub color: Option<[f32; 3]>,
    /// Place in the palette, 0..1.
    pub coord: f64,
    /// Share of the distance to `coord` that a point's colour coordinate moves per step, 0..1.
    pub speed: f64,
    /// Share of its points that are drawn, 0..1.
    pub opacity: f64,
    /// Factor on the radius of a branch; `None`: the map's scale.
    pub radius: Option<f64>,
    /// Branch parameters, where the table gives the map as a branch.
    pub branch: Option<Branch>,
    /// True if the map continues its parent's axis: it keeps the branching order.
    pub axis: bool,
    /// True if the map flattens the attractor to a stem and takes no part in branching.
    pub stem: bool,
    /// True if a leaf is placed where a word that ends in this map is cut.
    pub leaf: bool,
    /// Location of the map in the file, for diagnostics about it.
    pub span: Span,
}

impl Map {
    /// A map of default colour, speed 0.5 and opacity 1 that is no stem, continues no axis and bears leaves.
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

/// A condensation set: a fixed set whose images under all words belong to the attractor.
#[derive(Debug, Clone, PartialEq)]
pub struct Condensation {
    /// Form, place and size, table units.
    pub shape: CondensationShape,
    /// Probability of a jump into the set per step, 0..1.
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
        /// Half its thickness, table units.
        radius: f64,
    },
    /// A disc in the plane z = const.
    Disc {
        /// Centre, table units.
        center: [f64; 3],
        /// Radius, table units.
        radius: f64,
    },
    /// A polygon in the plane, at least three corners, of which the first sees all others: convex ones do.
    Polygon {
        /// Corners in order, table units.
        points: Vec<[f64; 2]>,
    },
    /// The triangles of a mesh file, in space.
    Mesh(faces::MeshReference),
}

/// Window and background of the picture that a flame file states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureView {
    /// Middle, table units, y up.
    pub center: [f64; 2],
    /// Width of the picture, table units.
    pub width: f64,
    /// Turn of the points about `center`, rad, clockwise with y up.
    pub rotate: f64,
    /// Width over height in pixels.
    pub aspect: f64,
    /// Linear RGB of the background.
    pub background: [f32; 3],
}

#[cfg(test)]
pub(crate) mod tests;
