//! Sway of branches: from a plant in a wind to the motion of joints, skeletons and points over time.
//!
//! [`BeamElements`] are the stretches of branches that bend, chosen and measured once; [`SwaySimulation`] advances
//! them, and [`BendTrack`] holds their bends frame by frame. [`JointRig`] poses a skeleton of few joints from them,
//! [`PointBinding`] every point of the bark, [`LeafFlutter`] adds the motion of leaves.
//! ```
//! use glam::{Quat, Vec3};
//! use osier_motion::sway::{BeamElements, SwayParams, SwaySimulation, WoodParams};
//! use osier_scene::Trs;
//! use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Nodes, Plant};
//! use osier_wind::UniformWind;
//!
//! // A pole of 2 m that tapers from 2 cm to 1 cm radius.
//! let nodes = Nodes {
//!     p: vec![Vec3::ZERO, Vec3::Y * 2.0],
//!     q: vec![Quat::IDENTITY; 2],
//!     r: vec![0.02, 0.01],
//!     s: vec![0.0, 2.0],
//!     birth: vec![0.0; 2],
//!     color: vec![0; 2],
//! };
//! let trunk = Axis {
//!     id: 1,
//!     parent: NONE,
//!     parent_s: 0.0,
//!     order: 0,
//!     kind: AxisKind::Stem,
//!     first: 0,
//!     count: 2,
//!     length: 2.0,
//!     s_exposed: 0.0,
//!     material: 0,
//!     fork: NONE,
//!     end: AxisEnd::Tip,
//!     birth: 0.0,
//! };
//! let plant = Plant { axes: vec![trunk], nodes, ..Plant::default() };
//! let wood = WoodParams::default();
//! let elements = BeamElements::build(&plant, &wood, 10);
//!
//! // Its static bend in a steady wind of 10 m/s.
//! let wind = UniformWind(Vec3::X * 10.0);
//! let params = SwayParams { wood, flicker: 0.0, whip: 1.0, stand: Trs::IDENTITY, gravity: None, fps: 24.0 };
//! let mut simulation = SwaySimulation::new(&elements, &wind, params);
//! simulation.relax_to_mean_wind();
//! assert!(simulation.bends()[0].iter().any(|angle| angle.abs() > 1e-3));
//! ```

mod beam;
mod elements;
mod flutter;
mod pose;
mod rig;
mod segments;
mod simulation;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod track;
mod tuning;
mod wind_weights;
mod wood;
mod zhao_zhang;

pub(crate) use beam::OscillatorStep;
pub use elements::{BeamElement, BeamElements, BoundLocation, ElementLocation, LoadStation};
pub use flutter::{LeafAir, LeafFlutter};
pub use pose::{OrganBindings, PointBinding, PosedSkeleton};
pub use rig::{JointBudget, JointRig};
pub use segments::BranchLoad;
pub use simulation::{SwayParams, SwaySimulation};
pub use track::{BendTrack, ClipOptions, check_key_limit};
pub use tuning::SPIN_UP_SECONDS;
pub use wind_weights::WindWeights;
pub(crate) use wood::damping_ratio;
pub use wood::{AIR_DENSITY, LEAF_FOLD_SPEED, WoodParams};
pub use zhao_zhang::{PaperCorrections, PaperParams, PaperSimulation};
