//! Runs a [`Recipe`](crate::recipe::Recipe): grows, skins, steps through time, writes.

mod air;
pub mod blow;
pub mod boughs;
pub mod breeze;
mod cards;
pub mod catkin;
pub mod clouds;
mod counts;
mod course;
mod deposits;
mod draft;
pub mod dress;
pub mod exporters;
mod heroes;
pub mod kept;
mod land;
pub mod layers;
pub mod layout;
pub mod looks;
mod measures;
mod memory;
mod morphing;
pub mod mover;
pub mod plants;
pub mod rain;
mod rod_mesh;
pub mod rods;
pub mod run_up;
mod scatter;
pub mod single;
mod solids;
pub mod stage;
mod stream;
pub mod systems;
mod tables;
mod trails;
mod twigs;
mod view;
pub mod write;

pub use counts::{Counts, lattice};

use osier_base::fence::Shelf;
use osier_base::limits::Limits;
use osier_base::progress::{Cancel, Progress};

/// What all work heeds.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// Limits in force.
    pub limits: &'a Limits,
    /// Asks to stop.
    pub cancel: &'a Cancel,
    /// Listens.
    pub progress: &'a dyn Progress,
    /// Where the air of a lattice is kept, if it is.
    pub shelf: Option<&'a Shelf>,
}
