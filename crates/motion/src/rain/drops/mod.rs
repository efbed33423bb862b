//! Drops on leaves: their shape, and how they rest, run, draw tails, merge, hang and detach.

pub(crate) mod drop;
mod hang;
mod merge;
pub(crate) mod pendant;
pub(crate) mod rain_leaf;
mod retention;
mod run;
pub(crate) mod shape;
mod step;
