//! The wind of a recipe: analytic or from a lattice, for plants, flights and files.
//!
//! ```text
//!  [wind] model            source                        read by
//!  gust, perlin, uniform   plant_wind: analytic          sway, rods, rain, flights, output
//!  lattice                 lattice: run over the clip,
//!                          recorded in half precision    sway, rain
//!                          playback: two snapshots at a
//!                          time while the run goes on    flights, output
//!  calm                    none
//! ```

pub mod lattice;
pub mod output;
pub mod plant_wind;
pub mod playback;
