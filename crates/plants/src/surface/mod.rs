//! Surfaces: lofted branches, leaf blades, bark, catkins, billboards, ground and terrain.

pub mod bark;
mod billboard;
pub mod catkin;
pub mod crossed_billboards;
pub mod ground;
pub mod leaf;
pub mod loft;
pub mod masonry;
mod material;
mod periodic_noise;
mod pixels;
pub mod rod_tube;
pub mod terrain;

pub use loft::{AxisBinding, PlantSkin, SkinOptions, TubeRange, UvMode, skin, skin_into};
pub use material::SurfaceMaterial;
