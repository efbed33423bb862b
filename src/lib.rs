//! osier turns small text files into plants and bakes them for other programs.
//!
//! ```text
//! grammar, scene, artist mesh ─ parse ─► resolve ─► grow ─► Plant ─► surface ─► Scene ─► motion ─► Frame ─► exporters
//! ```
//!
//! A scene is text, or a preset by name. [`recipe::resolve`] reads it, [`bake::bake`] makes all of its files:
//!
//! ```
//! use osier::bake::{BakeContext, bake};
//! use osier::files::Folder;
//! use osier::limits::Limits;
//! use osier::progress::Cancel;
//! use osier::recipe::{Request, resolve};
//!
//! # fn main() -> osier::Result<()> {
//! let text = "[plants.tuft]\ngrammar = \"grass.l\"\n[output]\nformats = [\"glb\"]\n".to_owned();
//! let request = Request { name: "tuft".into(), text, ..Request::default() };
//! let (recipe, _warnings) = resolve(&request)?;
//! let folder = Folder::open(std::env::temp_dir().join("osier-tuft"))?;
//! let baked = bake(&recipe, &[], &folder, &BakeContext::quiet(&Limits::default(), &Cancel::default()))?;
//! assert!(baked.manifest.expanded().iter().any(|(path, ..)| path == "gltf/tuft.web.glb"));
//! # std::fs::remove_dir_all(folder.root()).ok();
//! # Ok(())
//! # }
//! ```
//!
//! Each layer is a crate of its own, shown here under the name of its module (see `ARCHITECTURE.md`).

pub mod bake;
#[cfg(feature = "cli")]
pub mod cli;
pub mod presets;
pub mod recipe;

pub use osier_base::{Error, Result, diagnostic, files, geometry, limits, math, noise, par, progress, rng, units};
pub use osier_export as export;
pub use osier_grammar as grammar;
pub use osier_ifs as ifs;
pub use osier_import as import;
pub use osier_motion as motion;
pub use osier_plants::{grow, surface};
pub use osier_preview as preview;
pub use osier_scene::{self as scene, plant, solid};
pub use osier_wind as wind;
