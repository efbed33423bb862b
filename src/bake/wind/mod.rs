//! The wind of a recipe: analytic or from a lattice, for plants, flights and files.

pub mod lattice;
pub mod output;
pub mod plant_wind;
pub mod playback;
