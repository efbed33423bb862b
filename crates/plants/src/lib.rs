//! Plants: growth from grammars, tables and meshes, and the surfaces that they wear.

pub mod grow;
pub mod surface;
