//! The wind of a recipe: one field for all parts of a scene.
//!
//! ```text
//!  [wind] model            made by                                handed out by SceneWind to
//!  gust, perlin, uniform   analytic: formulas, over the land   ┐
//!  lattice "analytic"      lattice: the inlet's formula        ├─ field:        sway, rods, rain
//!  lattice "lbm"           lattice: recorded for the clip,     │
//!                          or stepped along with the frames    ┘─ wind_until_next_frame: flights, output
//!  calm                    none
//! ```

pub mod analytic;
pub mod lattice;
pub mod needs;
pub mod output;
pub mod plant_wind;
pub mod scene_wind;
