//! osier turns small text files into plants and bakes them for other programs.
//!
//! ```text
//! grammar, scene, artist mesh ─ parse ─► resolve ─► grow ─► Plant ─► surface ─► Scene ─► motion ─► Frame ─► exporters
//! ```
//!
//! Modules stand in layers; each imports only from those below it (see `ARCHITECTURE.md`).

pub mod bake;
pub mod cli;
pub mod diagnostic;
mod error;
pub mod export;
pub mod fence;
pub mod geometry;
pub mod grammar;
pub mod grow;
pub mod ifs;
pub mod import;
pub mod limits;
pub mod math;
pub mod motion;
pub mod noise;
pub mod par;
pub mod plant;
pub mod presets;
pub mod preview;
pub mod progress;
pub mod recipe;
pub mod rng;
pub mod scene;
pub mod solid;
pub mod surface;
pub mod units;
pub mod wind;

pub use error::{Error, Result};
