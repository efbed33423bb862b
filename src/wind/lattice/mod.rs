//! Wind on a lattice.

mod cells;
mod collide;
mod flow;
mod grid;
mod lane;
mod links;
#[cfg(test)]
mod reference;
mod stencil;
mod sweep;
#[cfg(test)]
mod validation;
