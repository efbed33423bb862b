//! A material with its images, before it is registered in a scene.

use osier_scene::{Image, ImageKind, Material, MaterialId, Pixels};

/// A material and its images, not yet part of a scene.
#[derive(Debug, Clone)]
pub struct SurfaceMaterial {
    /// The material; its maps are indices into `images`, not into those of a scene.
    pub material: Material,
    /// The images of its maps, which [`Self::register`] moves to the scene.
    pub images: Vec<Image>,
}

impl SurfaceMaterial {
    /// Appends the images and the material to a scene's lists; returns the material's id there.
    pub fn register(mut self, images: &mut Vec<Image>, materials: &mut Vec<Material>) -> MaterialId {
        // Map indices are local to the material; shift them by the number of images already registered.
        let first = count(images);
        let maps = &mut self.material.maps;
        for map in [&mut maps.color, &mut maps.normal, &mut maps.roughness, &mut maps.height] {
            *map = map.map(|i| i + first);
        }
        images.append(&mut self.images);
        materials.push(self.material);
        count(materials) - 1
    }
}

/// Length of a scene's list of images or materials; memory limits it far below 2^32.
#[allow(clippy::cast_possible_truncation, reason = "each entry is an image or a material")]
fn count<T>(list: &[T]) -> u32 {
    list.len() as u32
}

/// A square map named `<name>_<what>`, `side` pixels, as many channels as the samples allow.
pub(super) fn square_map(name: &str, what: &str, kind: ImageKind, side: u32, pixels: Pixels) -> Image {
    let samples = match &pixels {
        Pixels::U8(v) => v.len(),
        Pixels::U16(v) => v.len(),
    };
    let channels = if samples >= 3 * (side as usize).pow(2) { 3 } else { 1 };
    Image { name: format!("{name}_{what}"), kind, width: side, height: side, channels, pixels }
}
