//! Branches that sway: from a plant in a wind to joints, poses and points over time.
//!
//! [`BeamElements`] are the stretches of branches that bend, chosen and measured once; [`BendTrack`] holds what the wind does to
//! them, frame by frame. [`JointRig`] shows that with a few joints, [`PointBinding`] with every point, [`LeafFlutter`] moves the leaves.

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

pub use elements::{BeamElement, BeamElements, ElementLocation, LoadStation};
pub use flutter::{LeafAir, LeafFlutter};
pub use pose::{OrganBindings, PointBinding, PosedSkeleton};
pub use rig::JointRig;
pub use segments::{BranchLoad, ElementBudget};
pub use simulation::{SwayParams, SwaySimulation};
pub use track::{BendTrack, ClipOptions, check_key_limit};
pub use wind_weights::WindWeights;
pub(crate) use wood::damping_ratio;
pub use wood::{AIR_DENSITY, LEAF_FOLD_SPEED, WoodParams};
pub use zhao_zhang::{PaperCorrections, PaperParams, PaperSimulation};
