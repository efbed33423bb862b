//! Plants: growth from grammars, iterated function systems and meshes ([`grow`]), their meshes and materials ([`surface`]), the
//! light in their crowns ([`crown`]), and their leaves through the year ([`season`]).

pub mod crown;
pub mod grow;
pub mod season;
pub mod surface;

// Tests and examples share the reader of tables; examples refer to this crate by its name.
#[cfg(test)]
extern crate self as osier_plants;
