//! Motion: from a plant to joints, and from time to poses.
//!
//! [`rig`] chooses the joints and binds bark and leaves to them; [`sway`] turns time into poses and leaf flutter.

pub mod rig;
pub mod sway;

pub use rig::Rig;
pub use sway::{Sway, SwayOptions};
