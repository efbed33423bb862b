//! A material with its pictures, before it has a place in a scene.

use crate::scene::{Image, Material, MaterialId};

/// A surface: the material's maps are indices into `images`.
#[derive(Debug, Clone)]
pub struct SurfaceMaterial {
    /// What it looks like.
    pub material: Material,
    /// Its own pictures.
    pub images: Vec<Image>,
}

impl SurfaceMaterial {
    /// Appends pictures and material to a scene's lists; returns the material's id there.
    pub fn register(mut self, images: &mut Vec<Image>, materials: &mut Vec<Material>) -> MaterialId {
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let first = small(images.len());
        let maps = &mut self.material.maps;
        for map in [&mut maps.color, &mut maps.normal, &mut maps.roughness, &mut maps.height] {
            *map = map.map(|i| i + first);
        }
        images.append(&mut self.images);
        materials.push(self.material);
        small(materials.len() - 1)
    }
}
