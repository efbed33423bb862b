//! Plants: growth from grammars, iterated function systems and meshes ([`grow`]), and their meshes and materials
//! ([`surface`]).

pub mod grow;
pub mod surface;
