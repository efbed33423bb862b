//! Elastic rods (branches, stalks, poles) as lattices of springs between triangular cross-sections.
//!
//! [`RodDescription`]s become [`RodSystem`], which hang together as a tree and are moved by one of four integrators. A base of a rod is
//! fixed in a section of another one; blades and weights are rigid with sections.
//! Source: the extended triangular prism spring model of [yang-wu]; docs/rods.md says what is ours.

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
