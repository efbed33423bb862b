//! Plants: growth from grammars, iterated function systems and meshes ([`grow`]), and their meshes and materials
//! ([`surface`]).

pub mod grow;
pub mod surface;

// Tests share the reader of tables with the examples, which know this crate by its name.
#[cfg(test)]
extern crate self as osier_plants;
