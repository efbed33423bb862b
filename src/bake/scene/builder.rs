//! Collects the parts of a scene while it is assembled.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::bake::assets::material_set::{MaterialSet, PlantMaterials, image_indices_mut};
use crate::bake::motion::AssetMotion;
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::files::{Names, safe_name};
use osier_scene::{Asset, Image, Material, Placement, Trs};

/// Ids of the assets that a scene adds to those that its tables name.
pub(crate) const GROUND_ID: &str = "ground";
pub(crate) const RAIN_ID: &str = "rain";
pub(crate) const CATKINS_ID: &str = "catkins";

/// Materials, images, assets with their motions, and placements, in the order in which they are added.
#[derive(Default)]
pub(crate) struct SceneBuilder {
    pub(crate) images: Vec<Image>,
    pub(crate) materials: Vec<Material>,
    pub(crate) assets: Vec<Asset>,
    /// Parallel to `assets`; `None` for an asset that stands still.
    pub(crate) motions: Vec<Option<Arc<dyn AssetMotion>>>,
    pub(crate) placements: Vec<Placement>,
    /// Ids that no cloud, rod or solid gets: those of assets that the scene adds before or after them.
    pub(crate) reserved: Vec<&'static str>,
}

impl SceneBuilder {
    /// Adds an asset without a placement; returns its index.
    pub(crate) fn add_asset(&mut self, asset: Asset, motion: Option<Arc<dyn AssetMotion>>) -> usize {
        self.assets.push(asset);
        self.motions.push(motion);
        self.assets.len() - 1
    }

    /// Adds an asset with one placement, which is named after the asset's id.
    pub(crate) fn add_placed(&mut self, asset: Asset, transform: Trs, motion: Option<Arc<dyn AssetMotion>>) {
        let name = asset.id.clone();
        let asset = self.add_asset(asset, motion);
        self.placements.push(Placement { name, asset, transform, phase: 0 });
    }

    /// Appends `suffix` to an id until no asset of the scene has it and it is not reserved.
    pub(crate) fn make_id_unique(&self, id: &mut String, suffix: &str) {
        while self.assets.iter().any(|a| a.id == *id) || self.reserved.contains(&id.as_str()) {
            id.push_str(suffix);
        }
    }

    /// Numbers materials whose names are equal as files spell them: a cloud may have the name of the drops' water, and a layer of USD
    /// defines one material for each name.
    pub(crate) fn make_material_names_unique(&mut self) {
        let mut names = Names::default();
        for material in &mut self.materials {
            let unique = names.unique(&material.name);
            if unique != safe_name(&material.name) {
                material.name = unique;
            }
        }
    }

    /// Numbers images whose names are equal and whose pixels differ, as of two files with a material of the same name: textures are
    /// files of these names. Of equal images under one name the first is kept, which the materials of the others then share.
    /// # Errors
    /// `TooMany` beyond 2^32 images.
    pub(crate) fn make_image_names_unique(&mut self) -> Result<()> {
        let mut names = Names::default();
        let mut kept: Vec<Image> = Vec::new();
        // `kept_by_name`: for each original image name, indices into `kept`; `new_indices`: for each image, its index in `kept`.
        let mut kept_by_name: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        let mut new_indices = Vec::with_capacity(self.images.len());
        for mut image in std::mem::take(&mut self.images) {
            let alike = kept_by_name.entry(image.name.clone()).or_default();
            let known = alike.iter().copied().find(|i| kept[*i].has_same_pixels(&image));
            new_indices.push(index(known.unwrap_or(kept.len()), "images of a scene")?);
            if known.is_none() {
                alike.push(kept.len());
                let unique = names.unique(&image.name);
                if unique != safe_name(&image.name) {
                    image.name = unique;
                }
                kept.push(image);
            }
        }
        self.images = kept;
        for material in &mut self.materials {
            for slot in image_indices_mut(&mut material.maps) {
                *slot = slot.map(|i| new_indices.get(to_usize(i)).copied().unwrap_or(i));
            }
        }
        Ok(())
    }

    /// Appends materials and images, and adapts the materials' image indices; returns where the materials lie.
    /// # Errors
    /// `TooMany` beyond 2^32 materials or images.
    pub(crate) fn add_materials(&mut self, set: MaterialSet) -> Result<PlantMaterials> {
        let tiles = set.bark_tiles();
        let (organ_names, paints) = (set.names, set.paints);
        let first_material = index(self.materials.len(), "materials of a scene")?;
        let first_image = index(self.images.len(), "images of a scene")?;
        self.images.extend(set.images);
        self.materials.extend(set.materials.into_iter().map(|mut material| {
            image_indices_mut(&mut material.maps).into_iter().for_each(|slot| *slot = slot.map(|i| i + first_image));
            material
        }));
        Ok(PlantMaterials { first_material, tiles, organ_names, paints, shader_wind: false })
    }
}
