//! Branches that sway: from a plant in a wind to joints, poses and points over time.
//!
//! [`Elements`] are the stretches of branches that bend, chosen and measured once; [`Track`] holds what the wind does to
//! them, frame by frame. [`Rig`] shows that with a few joints, [`Body`] with every point, [`Flutter`] moves the leaves.

mod beam;
mod elements;
mod flutter;
mod pose;
mod rig;
mod segments;
mod simulation;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod track;
mod wind_weights;
mod wood;
mod zhao_zhang;

pub use elements::{Element, Elements, Spot, Station};
pub use flutter::{Air, Flutter};
pub use pose::{Body, Hangers, Posture};
pub use rig::Rig;
pub use segments::{Budget, Load};
pub use simulation::{Manner, Simulation};
pub use track::{Take, Track, afford};
pub use wind_weights::Weights;
pub(crate) use wood::damping_of;
pub use wood::{AIR, FOLD, Wood};
pub use zhao_zhang::{Fixes, PaperManner};
