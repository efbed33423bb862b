//! Foundation of the osier crates: diagnostics, errors, atomic file output, limits, random numbers, noise, SIMD, parallel
//! loops, geometry, neighbour search, disjoint sets and physical constants.

pub mod convert;
pub mod diagnostic;
pub mod disjoint_sets;
mod error;
pub mod files;
pub mod geometry;
pub mod keyframes;
pub mod limits;
pub mod math;
pub mod neighbours;
pub mod noise;
pub mod par;
pub mod physics;
pub mod progress;
pub mod rng;
pub mod simd;
pub mod units;

pub use error::{Error, Result};
