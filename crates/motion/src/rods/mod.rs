//! Elastic rods (branches, stalks, poles) as lattices of springs between triangular cross-sections.
//!
//! [`RodDescription`]s are discretized into a [`RodSystem`], a tree of rods: the base of a rod is rigid with a section
//! of its parent. Four integrators advance it; leaf blades and weights are rigid bodies attached to sections.
//! Source: the extended triangular prism spring model of [yang-wu]; docs/rods.md lists the differences.

mod layout;
mod modes;
mod plant;
mod prism;
mod record;
mod solver;
mod springs;
mod system;
#[cfg(test)]
mod tests;

pub use layout::{RodDescription, RodMaterial};
pub use plant::{RodPlant, RodPlantParams, SectionBlend};
pub use prism::SectionFrame;
pub use record::{Actuation, Integrator, MAX_SUBSTEPS, RodClip, RodPose};
pub use solver::{MAX_GAUSS_SEIDEL_STIFFNESS, StepFailure};
pub use system::{AttachedBody, ClampKind, RodClamp, RodSystem};
