//! Assembly of a scene: placement of plants, assets with their motions, camera and light.

pub mod animated;
pub mod assembly;
pub(crate) mod builder;
pub mod camera_light;
pub mod layout;
pub mod plant_layout;
pub(crate) mod reduction;
pub(crate) mod scatter;

pub use animated::AnimatedScene;
pub use assembly::{AssembledScene, SceneOptions, assemble_for_estimate, assemble_observed_scene, assemble_scene};
