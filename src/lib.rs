//! osier turns small text files into plants and bakes them for other programs.
//!
//! ```text
//! grammar, scene, artist mesh ─ parse ─► resolve ─► grow ─► Plant ─► surface ─► Scene ─► motion ─► Frame ─► exporters
//! ```
//!
//! Modules stand in layers; each imports only from those below it (see `ARCHITECTURE.md`).

pub mod bake;
pub mod cli;
pub mod presets;
pub mod recipe;

pub use osier_base::{Error, Result, diagnostic, fence, geometry, limits, math, noise, par, progress, rng, units};
pub use osier_export as export;
pub use osier_grammar as grammar;
pub use osier_ifs as ifs;
pub use osier_import as import;
pub use osier_motion as motion;
pub use osier_plants::{grow, surface};
pub use osier_preview as preview;
pub use osier_scene::{self as scene, plant, solid};
pub use osier_wind as wind;
