//! Motion: from a plant in the wind to joints, poses and points over time.
//!
//! [`Elements`] are the branches that bend, chosen and measured once; [`Track`] is what the wind did to them, frame by
//! frame. [`Rig`] shows that with a few joints, [`Body`] with every point, [`Flutter`] moves the leaves.

pub mod bend;
mod element;
mod flutter;
mod paper;
mod pieces;
mod posture;
mod rig;
mod simulate;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod track;
mod wood;

pub use element::{Budget, Element, Elements, Spot, Station};
pub use flutter::{Air, Flutter};
pub use paper::{Fixes, PaperManner};
pub use pieces::Load;
pub use posture::{Body, Hangers, Posture};
pub use rig::Rig;
pub use simulate::{Manner, Simulation, base_turns as turns_of};
pub use track::{Take, Track};
pub use wood::{AIR, FOLD, Wood};
