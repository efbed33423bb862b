//! Sway of branches: from a plant in a wind to the motion of joints, skeletons and points over time.
//!
//! [`BeamElements`] are the stretches of branches that bend, chosen and measured once; [`SwaySimulation`] advances
//! them, and [`BendTrack`] holds their bends frame by frame. [`JointRig`] poses a skeleton of few joints from them,
//! [`PointBinding`] every point of the bark, [`LeafFlutter`] adds the motion of leaves.

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
