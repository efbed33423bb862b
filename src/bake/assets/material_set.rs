//! The materials, pictures and organs of one asset, which its builders fill.

use std::collections::BTreeMap;
use std::sync::Arc;

use osier_plants::grow::ifs::SubtreeBillboards;
use osier_plants::grow::mesh::MeshPlant;
use osier_plants::grow::turtle::OrganSpec;
use osier_scene::{Image, Maps, Material};

/// Materials, pictures and organs of one plant. Maps index `images`, prototypes' subsets index `materials`.
#[derive(Debug, Clone, Default)]
pub struct MaterialSet {
    /// Bark, shoot, then those of the organs.
    pub materials: Vec<Material>,
    /// Pictures.
    pub images: Vec<Image>,
    /// Organs by letter.
    pub organs: BTreeMap<char, OrganSpec>,
    /// Their names, parallel to the recipe's organs.
    pub names: Vec<String>,
    /// Billboards for the small branches of a tree seen from afar.
    pub cards: Option<SubtreeBillboards>,
    /// What was found in the mesh of a whole plant.
    pub tree: Option<Arc<MeshPlant>>,
}

impl MaterialSet {
    pub(crate) fn add(&mut self, mut material: Material, images: Vec<Image>) -> u32 {
        let first = index(self.images.len());
        for map in maps(&mut material.maps) {
            *map = map.map(|i| i + first);
        }
        self.images.extend(images);
        self.materials.push(material);
        index(self.materials.len() - 1)
    }
}

/// The slots of a material.
pub fn maps(maps: &mut Maps) -> [&mut Option<u32>; 4] {
    [&mut maps.color, &mut maps.normal, &mut maps.roughness, &mut maps.height]
}

pub(crate) fn index(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
