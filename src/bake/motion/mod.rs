//! What moves the assets of a scene, frame by frame.

pub mod attractor_morph;
pub mod flight;
pub mod rain;
pub mod rod;
pub mod rod_mesh;
pub mod rod_plant;
pub mod sway;

pub use sway::{frame, rows};
