//! Growth: every source ends in a [`Plant`](osier_scene::plant::Plant) of axes, nodes and organs.
//!
//! [`turtle`] interprets the strings of an L-system, [`ifs`] builds trees from the words of an iterated function system,
//! [`particle_shapes`] lets particles wander and spawn others, [`mesh`] extracts the skeleton of an artist's mesh, and [`radii`]
//! sets radii by the pipe model or a taper.

pub mod ifs;
pub mod mesh;
pub mod particle_shapes;
mod polyline;
pub mod radii;
pub mod turtle;
pub mod years;
