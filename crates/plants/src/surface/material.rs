//! A material with its pictures, before it has a place in a scene.

use osier_scene::{Image, ImageKind, Material, MaterialId, Pixels};

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

/// A square map named `<name>_<what>`, `side` pixels, as many channels as the samples allow.
pub(super) fn map(name: &str, what: &str, kind: ImageKind, side: u32, pixels: Pixels) -> Image {
    let samples = match &pixels {
        Pixels::U8(v) => v.len(),
        Pixels::U16(v) => v.len(),
    };
    let channels = u8::try_from(samples / (side as usize).pow(2).max(1)).unwrap_or(u8::MAX);
    Image { name: format!("{name}_{what}"), kind, width: side, height: side, channels, pixels }
}
