//! A small ray tracer that renders a [`Scene`](osier_scene::Scene) at any frame.
//!
//! [`Looks`] holds materials and their pictures, [`World`] the shapes of one frame with a tree of boxes over them,
//! [`render`] turns both into a [`Picture`]. Light comes from the sun, whose size softens shadows, and from the sky, what
//! occludes it seen in its mean colour; leaves glow where light comes through, water bends it.

mod backdrop;
mod clip;
mod cone;
mod draft;
mod film;
mod framing;
mod grain;
mod lens;
mod lettering;
mod light;
mod looks;
mod picture;
mod quality;
mod sampler;
mod sheet;
mod solid;
mod surface;
#[cfg(test)]
mod testing;
mod texture;
mod tone;
mod wet;
mod world;

pub use backdrop::Backdrop;
pub use clip::{ClipFormat, ClipTiming, ClipWriter};
pub use film::{RenderRequest, render, tiles};
pub use framing::{CameraView, Subject};
pub use lettering::Letters;
pub use light::Light;
pub use looks::Looks;
pub use picture::Picture;
pub use quality::Quality;
pub use sheet::{ContactSheetCell, columns, sheet, size as sheet_size};
pub use world::World;
