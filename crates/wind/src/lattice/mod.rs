//! Wind on a lattice.

mod cells;
mod collide;
mod doors;
mod ends;
mod flow;
mod grid;
mod ground;
mod inlet;
mod links;
mod list;
mod marks;
mod memory;
mod open;
mod plan;
mod plane;
mod recorded;
#[cfg(test)]
mod reference;
mod run;
mod snapshot;
mod state;
mod stencil;
mod sweep;
#[cfg(test)]
mod validation;
#[cfg(test)]
mod weather;

pub use inlet::{Inlet, InletOptions, WindProfile};
pub use memory::LatticeMemory;
pub use plan::{Ground, LatticeOptions, Sides};
pub use recorded::{Recorded, Take as LatticeTake};
pub use run::{Health, Lattice, Note};
pub use snapshot::{Between, Snapshot};
