//! What grows ends in a [`Plant`](osier_scene::plant::Plant): the turtle that draws strings of modules, the words of a table, and
//! the laws of thickness. What an artist modelled does so, too: its skeleton is found.

pub mod ifs;
pub mod mesh;
mod polyline;
pub mod radii;
pub mod turtle;
