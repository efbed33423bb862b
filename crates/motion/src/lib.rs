//! Motion: from a plant in the wind to joints, poses and points over time.
//!
//! [`rod`]s are poles, twigs and stalks as springs; [`Elements`] are the branches that bend, chosen and measured once; [`Track`] is what the wind did to them, frame by
//! frame. [`Rig`] shows that with a few joints, [`Body`] with every point, [`Flutter`] moves the leaves.

mod attributes;
mod bend;
mod element;
pub mod flight;
mod flutter;
mod lanes;
mod paper;
mod pieces;
mod posture;
pub mod rain;
mod rig;
#[allow(clippy::needless_range_loop, reason = "indices over corners and columns, as in the formulas")]
pub mod rod;
mod simulate;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod track;
mod wood;

pub use attributes::Weights;
pub use element::{Element, Elements, Spot, Station};
pub use flutter::{Air, Flutter};
pub use paper::{Fixes, PaperManner};
pub use pieces::{Budget, Load};
pub use posture::{Body, Hangers, Posture};
pub use rig::Rig;
pub use simulate::{Manner, Simulation};
pub use track::{Take, Track, afford};
pub use wood::{AIR, FOLD, Wood};
