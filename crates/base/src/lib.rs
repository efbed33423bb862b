//! What all of osier stands on: diagnostics, errors, files that appear whole, numbers, random draws, parallel loops.

pub mod convert;
pub mod diagnostic;
mod error;
pub mod fence;
pub mod geometry;
pub mod limits;
pub mod math;
pub mod noise;
pub mod par;
pub mod progress;
pub mod rng;
pub mod simd;
pub mod units;

pub use error::{Error, Result};
