//! Drops on leaves: their shape, and how they rest, run, draw tails, merge, hang and fall.

pub(crate) mod drop;
pub(crate) mod merge;
pub(crate) mod pendant;
pub(crate) mod rain_leaf;
pub(crate) mod shape;
