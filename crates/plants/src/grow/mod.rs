//! Growth: every source ends in a [`Plant`](osier_scene::plant::Plant) of axes, nodes and organs.
//!
//! [`turtle`] interprets the strings of an L-system, [`ifs`] builds trees from the words of an iterated function system,
//! [`particle_shapes`] lets particles wander and spawn others, [`mesh`] extracts the skeleton of an artist's mesh, and [`radii`]
//! sets radii by the pipe model or a taper. [`clip`] is what all growth over a clip has in common.

pub mod clip;
pub mod ifs;
pub mod mesh;
pub mod particle_shapes;
mod polyline;
pub mod radii;
pub mod turtle;
pub mod years;

use osier_base::rng::{child, word};

/// Index, below `count`, of the prototype for an organ: a hash of its id, so that no other organ changes the choice.
#[allow(clippy::cast_possible_truncation, reason = "a remainder by a number of prototypes, which 16 bits hold")]
fn pick_prototype(id: u64, count: usize) -> u16 {
    (child(id, word("proto")) % (count as u64).max(1)) as u16
}
