//! The materials, images and organs of one asset, which its builders add to step by step.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::bake::assets::season_materials::SeasonMaterials;
use crate::bake::assets::skin_options::{BARK, BarkTiles, SHOOT};
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_plants::grow::ifs::SubtreeBillboards;
use osier_plants::grow::mesh::MeshPlant;
use osier_plants::grow::turtle::OrganSpec;
use osier_scene::{Image, Maps, Material};

/// Materials, images and organs of one plant, indexed among themselves: maps index `images`, subsets of organ prototypes index
/// `materials`.
#[derive(Debug, Clone, Default)]
pub struct MaterialSet {
    /// Bark, shoot, then those of the organs.
    pub materials: Vec<Material>,
    /// Images that the maps of the materials refer to by index.
    pub images: Vec<Image>,
    /// Organs by the letter of the grammar or table that places them.
    pub organs: BTreeMap<char, OrganSpec>,
    /// Names of the organs, parallel to the recipe's organs.
    pub names: Vec<String>,
    /// Billboards for the small branches of a tree seen from afar.
    pub cards: Option<SubtreeBillboards>,
    /// Index of the material of dead wood; `None` for plants without any.
    pub dead: Option<u16>,
    /// Materials of leaves in the colours of a season; `None` for plants without the key `season`.
    pub season: Option<SeasonMaterials>,
    /// Materials by the colour indices that the turtle has given axes, filled after growth.
    pub paints: BTreeMap<u8, u16>,
    /// Indices in `materials` of the textures of a view file, by their number there.
    pub textures: BTreeMap<u32, u32>,
    /// Skeleton, wood and leaves extracted from an imported mesh of a whole plant; `None` for plants of other sources.
    pub tree: Option<Arc<MeshPlant>>,
}

impl MaterialSet {
    /// Adds a material whose maps index `images` from 0; returns the material's index.
    /// # Errors
    /// `TooMany` beyond 2^32 materials or images.
    pub(crate) fn add(&mut self, mut material: Material, images: Vec<Image>) -> Result<u32> {
        let first = index(self.images.len(), "images of a plant")?;
        for map in image_indices_mut(&mut material.maps) {
            *map = map.map(|i| i + first);
        }
        self.images.extend(images);
        self.materials.push(material);
        index(self.materials.len() - 1, "materials of a plant")
    }

    /// Size of one repeat of the maps of bark and shoots.
    pub fn bark_tiles(&self) -> BarkTiles {
        let [bark, shoot] = [BARK, SHOOT].map(|i| {
            let Some(material) = self.materials.get(usize::from(i)) else { return [0.5; 2] };
            // Painted maps are square; pictures of the user need not be.
            let picture = material.maps.color.and_then(|i| self.images.get(to_usize(i)));
            let proportion = picture.map_or(1.0, |picture| picture.height as f32 / picture.width as f32);
            [material.tile, material.tile * proportion]
        });
        BarkTiles { bark, shoot }
    }
}

/// Position of one plant's materials in the scene, and the properties of materials that all individuals of the plant share.
#[derive(Debug, Clone, Default)]
pub struct PlantMaterials {
    /// Index in the scene of the plant's material 0.
    pub first_material: u32,
    /// Size of one repeat of the maps of bark and of shoots.
    pub tiles: BarkTiles,
    /// Names of the organs, parallel to the recipe's; prototypes are called `NAME` or `NAME_0`, `NAME_1`, ...
    pub organ_names: Vec<String>,
    /// Materials of the plant by the colour indices that the turtle has given its axes.
    pub paints: BTreeMap<u8, u16>,
    /// Whether the bark carries the attributes by which shaders sway it, for copies that a format shows without a skeleton.
    pub shader_wind: bool,
}

/// Image indices of the colour, normal, roughness and height map, in this order; `None` for a map that the material lacks.
pub(crate) fn image_indices_mut(maps: &mut Maps) -> [&mut Option<u32>; 4] {
    [&mut maps.color, &mut maps.normal, &mut maps.roughness, &mut maps.height]
}
