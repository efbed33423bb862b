//! What several test files share.

pub mod bare;
pub mod clients;
pub mod expect;
pub mod gltf_objects;
pub mod gltf_player;
pub mod grown;
pub mod picture;
pub mod pov;
pub mod program;
pub mod scene_text;
pub mod short_bakes;
pub mod synthetic;
pub mod track_records;
