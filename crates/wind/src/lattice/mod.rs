//! Wind on a lattice.

mod checkpoint;
mod collide;
mod diagnostics;
mod domain;
mod exchange;
mod exchange_builder;
mod flow;
mod grid;
mod ground;
mod inlet;
mod memory_estimate;
mod open_boundary;
mod outlet_targets;
mod plane_step;
mod recorded;
#[cfg(test)]
mod reference;
mod report;
mod row_halo;
mod setup;
mod snapshot;
mod snapshot_grid;
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
pub use setup::{GroundCondition, LatticeOptions, SideCondition};
pub use snapshot::{InterpolatedWind, WindSnapshot};
pub use solver::LatticeSolver;
