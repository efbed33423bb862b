//! Wind on a lattice: a D3Q15 lattice Boltzmann solver with solids, rough ground and open boundaries.
//!
//! From the bottom up: `stencil` and `collide` are the arithmetic of one cell, `grid` its memory, `domain` the boundary
//! conditions, `cells` where the cells are in the world, and `cut_links` the links that surfaces cut. `exchange` moves
//! populations across boundaries, `plane_step` advances one plane, `stepper` all planes on all threads, `flow` holds
//! the state, and `solver` turns options and solids into a [`WindSnapshot`] per frame. `reference` (tests only) is the
//! same scheme without any of the memory layout; `validation` compares both with flows of known solution.

mod blockage;
mod cells;
mod checkpoint;
mod collide;
#[cfg(test)]
mod convergence;
mod cut_links;
mod diagnostics;
mod domain;
mod exchange;
mod exchange_builder;
mod flow;
mod grid;
mod ground;
mod inlet;
mod joined_sides;
mod memory_estimate;
mod open_boundary;
mod outlet_targets;
mod plane_step;
mod recorded;
#[cfg(test)]
mod reference;
mod report;
mod row_ends;
mod setup;
mod snapshot;
mod snapshot_layout;
mod solver;
#[cfg(test)]
mod solver_tests;
mod stencil;
mod step_tables;
mod stepper;
mod tuning;
#[cfg(test)]
mod validation;
mod voxelize;

pub use inlet::{InletOptions, InletWind, WindProfile};
pub use memory_estimate::LatticeMemory;
pub use recorded::{RecordedWind, RecordingOptions};
pub use report::{LatticeStats, LatticeWarning};
pub use setup::{GroundCondition, LatticeFault, LatticeOptions, SideCondition, lattice_fault};
pub use snapshot::{InterpolatedWind, WindSnapshot};
pub use solver::LatticeSolver;
