//! Rods: branches, stalks, poles as lattices of springs between three-cornered sections.
//!
//! [`Rod`]s become [`Rods`], which hang together as a tree and are moved by one of four integrators. A base of a rod is
//! fixed in a section of another one; blades and weights are rigid with sections.
//! Source: the extended triangular prism spring model of [yang-wu]; docs/rods.md says what is ours.

mod assemble;
mod blade;
mod block;
mod boughs;
#[cfg(test)]
mod boughs_tests;
mod build;
mod explicit;
mod grown;
mod implicit;
mod measure;
mod prism;
mod rods;
mod run;
mod springs;
mod statics;
#[cfg(test)]
mod tests;

pub use boughs::{Between, Boughs};
pub use build::{Rod, Stuff};
pub use explicit::LIMP;
pub use grown::Grain;
pub use implicit::Lost;
pub use prism::Frame;
pub use rods::{Body, Clamp, Hold, Rods};
pub use run::{Act, Clip, Integrator, Keys, MOST_STEPS, Still};
