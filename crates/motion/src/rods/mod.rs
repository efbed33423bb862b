//! Elastic rods (branches, stalks, poles) as lattices of springs between triangular cross-sections.
//!
//! [`Rod`]s become [`Rods`], which hang together as a tree and are moved by one of four integrators. A base of a rod is
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

pub use layout::{Rod, Stuff};
pub use plant::{Between, Boughs, Grain};
pub use prism::Frame;
pub use record::{Act, Clip, Integrator, Keys, MOST_STEPS, Still};
pub use solver::{LIMP, Lost};
pub use system::{Body, Clamp, Hold, Rods};
