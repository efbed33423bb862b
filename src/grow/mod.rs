//! What grows ends in a [`Plant`](crate::plant::Plant): the turtle that draws strings of modules, and the laws of thickness.

pub mod ifs;
pub mod radii;
pub mod turtle;
