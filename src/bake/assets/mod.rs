//! Builders of assets, with one module per kind of asset or step of building it.

pub mod attractor;
pub(crate) mod attractor_color;
pub(crate) mod billboards;
pub(crate) mod branchlets;
pub mod catkin;
pub(crate) mod ground;
pub mod growth_site;
pub(crate) mod ifs_leaf;
pub(crate) mod ifs_tree;
pub mod layered_picture;
pub mod material_set;
pub(crate) mod obstacles;
pub mod plant_growth;
pub mod plant_materials;
pub mod plant_mesh;
pub(crate) mod plants;
pub(crate) mod rigged_plant;
pub mod season_materials;
pub mod seasons;
pub(crate) mod segments;
pub mod shape_growth;
pub mod skin_options;
pub mod species_growth;
pub(crate) mod terrain;
pub(crate) mod turtle_colors;
