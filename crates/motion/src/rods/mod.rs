//! Elastic rods (branches, stalks, poles) as lattices of springs between triangular cross-sections.
//!
//! [`RodDescription`]s are discretized into a [`RodSystem`], a tree of rods: the base of a rod is rigid with a section
//! of its parent. Four integrators advance it; leaf blades and weights are rigid bodies attached to sections.
//! Source: the extended triangular prism spring model of [yang-wu]; docs/rods.md lists the differences.
//! ```
//! use glam::DVec3;
//! use osier_motion::rods::{SupportKind, RodDescription, RodMaterial, RodSystem};
//!
//! // A twig of 40 cm, clamped at its base, sags under its weight.
//! let material = RodMaterial {
//!     young: 5e9,
//!     shear: 1.0 / 15.0,
//!     density: 900.0,
//!     damping_ratio: 0.05,
//!     recovery: 0.0,
//!     spread_for_torsion: false,
//! };
//! let (points, radii) = (vec![DVec3::ZERO, DVec3::X * 0.4], vec![0.003; 2]);
//! let twig = RodDescription { points, radii, material, sections: Some(9), parent: None };
//! let mut rods = RodSystem::new(&[twig], &[(0, 0.0, SupportKind::Fixed)]);
//! assert!(rods.solve_equilibrium());
//! assert!(rods.section_frame(8).p.y < -1e-4);
//! ```

mod layout;
mod modes;
pub(crate) mod plant;
mod prism;
mod record;
mod solver;
mod springs;
mod system;
#[cfg(test)]
mod tests;
mod tuning;

pub use layout::{RodDescription, RodMaterial};
pub(crate) use plant::RigidBlade;
pub use plant::{RodPlant, RodPlantParams, SectionBlend};
pub use prism::SectionFrame;
pub use record::{Actuation, Integrator, MAX_SUBSTEPS, RecordingParams, RodSystemPose};
pub use solver::{MAX_GAUSS_SEIDEL_STIFFNESS, StepFailed};
pub use system::{AttachedBody, RodSystem, SectionSupport, SupportKind};
pub use tuning::PLANT_SPIN_UP_SECONDS;
