//! A film of water left by earlier rain on surfaces: their materials are darker and smoother in every format.

use std::collections::{BTreeMap, BTreeSet};

use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::units::{byte, linear_from_srgb, srgb_byte};
use osier_scene::{Coat, Image, Maps, Material, MaterialClass, MaterialId, Pixels};

/// Roughness of a closed film of water on a leaf. Own: by eye; with smaller values leaves look like mirrors, with larger ones
/// dry.
const FILM_ROUGHNESS: f32 = 0.12;

/// A film of water on the materials of a class, which changes their albedo and roughness.
#[derive(Debug, Clone, Copy)]
struct Film {
    /// Fraction of the surface that the film covers, 0 to 1.
    cover: f32,
    /// Roughness of the surface where the film covers it.
    roughness: f32,
}

/// Albedo under a film that covers the fraction `cover` of a surface, as a share of that of the dry surface.
pub(super) fn film_albedo(cover: f32) -> f32 {
    1.0 + cover * (Coat::WET_ALBEDO - 1.0)
}

impl Film {
    fn covering(class: MaterialClass, cover: f32) -> Self {
        let porous = matches!(class, MaterialClass::Bark | MaterialClass::Ground);
        Self { cover, roughness: if porous { Coat::POROUS_WET_ROUGHNESS } else { FILM_ROUGHNESS } }
    }

    /// Factor on the linear albedo: the mean of 1 and [`Coat::WET_ALBEDO`] weighted by the cover.
    fn darkening(self) -> f32 {
        film_albedo(self.cover)
    }

    /// Roughness of a surface of roughness `roughness` with the film, weighted by the cover.
    fn roughness_below(self, roughness: f32) -> f32 {
        // A film never makes a surface rougher.
        roughness + (self.roughness - roughness).min(0.0) * self.cover
    }

    fn wet_values(self, material: &mut Material) {
        material.base_color = material.base_color.map(|c| c * self.darkening());
        material.roughness = self.roughness_below(material.roughness);
    }
}

/// Changes colour and roughness of the materials of all leaves, and their textures. `cover`: fraction of the leaves that the
/// film covers, 0 to 1. `images`: textures of the scene; empty in an estimate, which reads none.
pub(super) fn apply_film_to_leaf_materials(cover: f32, materials: &mut [Material], images: &mut [Image]) {
    let film = Film::covering(MaterialClass::Leaf, cover);
    // Leaves may share textures, each of which is changed once.
    let (mut colors, mut roughnesses) = (BTreeSet::new(), BTreeSet::new());
    for material in materials.iter_mut().filter(|m| m.class == MaterialClass::Leaf) {
        film.wet_values(material);
        colors.extend(material.maps.color);
        roughnesses.extend(material.maps.roughness);
    }
    for i in colors {
        images.get_mut(to_usize(i)).into_iter().for_each(|image| darken_image(image, film));
    }
    for i in roughnesses {
        images.get_mut(to_usize(i)).into_iter().for_each(|image| smooth_roughness_map(image, film));
    }
}

/// Whether a material has wet faces, dry faces or both.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WetDryFaces {
    /// Whether it has faces that rain reaches.
    pub(super) wet: bool,
    /// Whether it has faces that rain does not reach.
    pub(super) dry: bool,
}

/// Images that keep their pixels, and the wet images that replace others.
struct WetImages {
    /// Indices of images that a dry material uses, which keep their pixels.
    dry: BTreeSet<u32>,
    /// Index of the wet image of each image that has one: a copy, or the image itself.
    wet: BTreeMap<u32, u32>,
}

impl WetImages {
    /// Index of the wet image of image `dry`, which the function `wet` changes if no earlier call has done so.
    fn add(&mut self, dry: u32, film: Film, wet: fn(&mut Image, Film), images: &mut Vec<Image>) -> Result<u32> {
        if let Some(known) = self.wet.get(&dry) {
            return Ok(*known);
        }
        let mut new = dry;
        // Only an image that a dry material also uses needs a copy.
        if let Some(image) = images.get(to_usize(dry)).filter(|_| self.dry.contains(&dry)) {
            new = index(images.len(), "images of a scene")?;
            images.push(Image { name: format!("{}_wet", image.name), ..image.clone() });
        }
        images.get_mut(to_usize(new)).into_iter().for_each(|image| wet(image, film));
        self.wet.insert(dry, new);
        Ok(new)
    }
}

/// Adds a wet variant of each material that has wet faces; returns, for each such material, the material of its wet faces. A
/// material without dry faces becomes wet itself, and so do images that only such materials use. `uses`: parallel to `materials`.
/// # Errors
/// `TooMany` beyond 2^32 materials or images.
pub(super) fn add_wet_materials(
    cover: f32,
    uses: &[WetDryFaces],
    materials: &mut Vec<Material>,
    images: &mut Vec<Image>,
) -> Result<BTreeMap<MaterialId, MaterialId>> {
    let all_uses = || uses.iter().copied().chain(std::iter::repeat(WetDryFaces::default()));
    // Find the images that keep their pixels because a material that stays dry uses them.
    let dry = materials
        .iter()
        .zip(all_uses())
        .filter(|(_, u)| u.dry || !u.wet)
        .flat_map(|(m, _)| [m.maps.color, m.maps.roughness].into_iter().flatten());
    let mut wet_images = WetImages { dry: dry.collect(), wet: BTreeMap::new() };
    let mut wet_materials = BTreeMap::new();
    for (i, of) in uses.iter().enumerate().filter(|(_, of)| of.wet) {
        let mut material = materials[i].clone();
        let film = Film::covering(material.class, cover);
        film.wet_values(&mut material);
        let Maps { color, roughness, .. } = material.maps;
        material.maps.color = color.map(|dry| wet_images.add(dry, film, darken_image, images)).transpose()?;
        material.maps.roughness =
            roughness.map(|dry| wet_images.add(dry, film, smooth_roughness_map, images)).transpose()?;
        // For a material with dry and wet faces the variant is a new material; otherwise it replaces the dry one.
        let own = index(i, "materials of a scene")?;
        if of.dry {
            material.name.push_str("_wet");
            wet_materials.insert(own, index(materials.len(), "materials of a scene")?);
            materials.push(material);
        } else {
            wet_materials.insert(own, own);
            materials[i] = material;
        }
    }
    Ok(wet_materials)
}

/// Multiplies the colours of an 8-bit sRGB image in linear light by the darkening of the film; alpha does not change.
fn darken_image(image: &mut Image, film: Film) {
    let factor = film.darkening();
    // A table with one entry per byte value saves the conversion of every pixel.
    let table: Vec<u8> = (0..=u8::MAX).map(|c| srgb_byte(linear_from_srgb(f32::from(c) / 255.0) * factor)).collect();
    if let Pixels::U8(samples) = &mut image.pixels {
        for pixel in samples.chunks_mut(usize::from(image.channels.max(1))) {
            pixel.iter_mut().take(3).for_each(|c| *c = table[usize::from(*c)]);
        }
    }
}

/// Replaces the values of a roughness map by those with a film.
fn smooth_roughness_map(image: &mut Image, film: Film) {
    match &mut image.pixels {
        Pixels::U8(samples) => samples.iter_mut().for_each(|r| *r = byte(film.roughness_below(f32::from(*r) / 255.0))),
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the old value")]
        Pixels::U16(samples) => samples
            .iter_mut()
            .for_each(|r| *r = (film.roughness_below(f32::from(*r) / 65535.0) * 65535.0).round() as u16),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::ImageKind;

    #[test]
    fn a_film_darkens_and_smooths_leaves_and_nothing_else() {
        let picture = |kind, channels, samples: &[u8]| Image {
            name: "p".into(),
            kind,
            width: 1,
            height: 1,
            channels,
            pixels: Pixels::U8(samples.to_vec()),
        };
        let mut images = [picture(ImageKind::Color, 4, &[200, 100, 0, 90]), picture(ImageKind::Data, 1, &[153])];
        let maps = Maps { color: Some(0), roughness: Some(1), ..Maps::default() };
        let leaf = Material { maps, ..Material::plain("leaf".into(), MaterialClass::Leaf, [0.5; 3], 0.6) };
        // Two leaves that share a texture change it only once.
        let mut materials = [leaf.clone(), leaf, Material::plain("bark".into(), MaterialClass::Bark, [0.5; 3], 0.6)];
        apply_film_to_leaf_materials(1.0, &mut materials, &mut images);
        let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert!(near(materials[1].roughness, FILM_ROUGHNESS) && near(materials[2].roughness, 0.6));
        assert!(near(materials[0].base_color[0], 0.5 * Coat::WET_ALBEDO) && near(materials[2].base_color[0], 0.5));
        let Pixels::U8(color) = &images[0].pixels else { panic!("bytes") };
        let linear = |c: u8| linear_from_srgb(f32::from(c) / 255.0);
        assert!((linear(color[0]) / linear(200) - Coat::WET_ALBEDO).abs() < 0.01 && color[3] == 90, "{color:?}");
        let Pixels::U8(rough) = &images[1].pixels else { panic!("bytes") };
        assert_eq!(rough[0], byte(FILM_ROUGHNESS));
    }
}
