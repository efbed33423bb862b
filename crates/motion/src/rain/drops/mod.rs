//! Drops on leaves: their shape, and how they rest, run, draw tails, merge, hang and detach.

mod merge;
mod pendant_drop;
pub(crate) mod pendant_profile;
pub(crate) mod rain_leaf;
mod retention;
mod sessile_drop;
pub(crate) mod spherical_cap;
mod step;
pub(crate) mod surface_drop;
