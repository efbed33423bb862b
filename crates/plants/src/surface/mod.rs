//! What a plant looks like: tubes around its axes, leaf blades, bark, and the ground it stands on.

pub mod bark;
pub mod cards;
pub mod catkin;
pub mod ground;
mod lattice;
pub mod leaf;
pub mod loft;
pub mod masonry;
mod material;
mod pictured;
mod pixels;
pub mod terrain;

pub use loft::{AxisBinding, Skin, SkinOptions, TubeRange, UvMode, skin, skin_into};
pub use material::SurfaceMaterial;
