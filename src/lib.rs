//! osier turns small text files into plants and bakes them for other programs.
//!
//! ```text
//! grammar, scene, artist mesh ─ parse ─► resolve ─► grow ─► Plant ─► surface ─► Scene ─► motion ─► Frame ─► exporters
//! ```
//!
//! A source is a scene, a grammar, a coefficient table or a preset. [`source::find_scene`] finds it,
//! [`recipe::resolve`] reads it into a [`recipe::Recipe`], and four calls do what the commands of the program do:
//!
//! | call | command | result |
//! |---|---|---|
//! | [`bake()`] | `osier bake` | a folder with every frame in every format of the scene |
//! | [`grow()`] | `osier grow` | one still plant or scene as one file |
//! | [`preview()`] | `osier preview` | a picture |
//! | [`check()`] | `osier check` | all faults of a scene, and an estimate of its bake |
//!
//! ```
//! use osier::bake::BakeContext;
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
//! let baked = osier::bake(&recipe, &[], &folder, &BakeContext::quiet(&Limits::default(), &Cancel::default()))?;
//! assert!(baked.manifest.expanded().iter().any(|(path, ..)| path == "gltf/tuft.web.glb"));
//! # std::fs::remove_dir_all(folder.root()).ok();
//! # Ok(())
//! # }
//! ```
//!
//! [`grow()`], [`preview()`] and [`check()`] have examples of their own.
//!
//! Each layer is a crate of its own, shown here under the name of its module (see `ARCHITECTURE.md`).

pub mod bake;
pub mod check;
#[cfg(feature = "cli")]
pub mod cli;
pub mod presets;
pub mod recipe;
pub mod scene_preview;
pub mod single_file;
pub mod source;

pub use bake::bake;
pub use check::check;
pub use scene_preview::preview;
pub use single_file::grow;

pub use osier_base::{
    Error, Result, diagnostic, files, geometry, limits, math, neighbours, noise, par, progress, rng, units,
};
pub use osier_export as export;
pub use osier_grammar as grammar;
pub use osier_ifs as ifs;
pub use osier_import as import;
pub use osier_motion as motion;
pub use osier_plants::{grow, surface};
pub use osier_preview as preview;
pub use osier_scene::{self as scene, plant, solid};
pub use osier_wind as wind;
