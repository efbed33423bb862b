//! A film of water that earlier rain has left on all leaves: their materials are darker and smoother in every format.

use std::collections::BTreeSet;

use osier_base::convert::to_usize;
use osier_base::units::{byte, linear_from_srgb, srgb_byte};
use osier_scene::{Coat, Image, Material, MaterialClass, Pixels};

/// Roughness of a closed film of water on a leaf. Own: by eye; smaller values make leaves mirrors, larger ones make them look dry.
const FILM_ROUGHNESS: f32 = 0.12;

/// Wets the materials of all leaves. `film`: fraction of the leaves that it covers, 0 to 1. `images`: textures of the scene; empty in
/// an estimate, which reads none.
pub(super) fn wet_leaf_materials(film: f32, materials: &mut [Material], images: &mut [Image]) {
    let darkening = 1.0 + film * (Coat::WET_ALBEDO - 1.0);
    // Leaves may share textures, each of which is changed once.
    let (mut colors, mut roughnesses) = (BTreeSet::new(), BTreeSet::new());
    for material in materials.iter_mut().filter(|m| m.class == MaterialClass::Leaf) {
        material.base_color = material.base_color.map(|c| c * darkening);
        material.roughness = under_film(material.roughness, film);
        colors.extend(material.maps.color);
        roughnesses.extend(material.maps.roughness);
    }
    for i in colors {
        images.get_mut(to_usize(i)).into_iter().for_each(|image| darken_colors(image, darkening));
    }
    for i in roughnesses {
        images.get_mut(to_usize(i)).into_iter().for_each(|image| smooth_roughness_map(image, film));
    }
}

/// A roughness under a film that covers the fraction `film` of the surface.
fn under_film(roughness: f32, film: f32) -> f32 {
    roughness + (FILM_ROUGHNESS - roughness).min(0.0) * film
}

/// Multiplies the colours of an sRGB picture in linear light; alpha stays.
fn darken_colors(image: &mut Image, factor: f32) {
    let table: Vec<u8> = (0..=u8::MAX).map(|c| srgb_byte(linear_from_srgb(f32::from(c) / 255.0) * factor)).collect();
    if let Pixels::U8(samples) = &mut image.pixels {
        for pixel in samples.chunks_mut(usize::from(image.channels.max(1))) {
            pixel.iter_mut().take(3).for_each(|c| *c = table[usize::from(*c)]);
        }
    }
}

/// Replaces the values of a roughness map by those under a film.
fn smooth_roughness_map(image: &mut Image, film: f32) {
    match &mut image.pixels {
        Pixels::U8(samples) => samples.iter_mut().for_each(|r| *r = byte(under_film(f32::from(*r) / 255.0, film))),
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the old value")]
        Pixels::U16(samples) => {
            samples.iter_mut().for_each(|r| *r = (under_film(f32::from(*r) / 65535.0, film) * 65535.0).round() as u16)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::{ImageKind, Maps};

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
        // Two leaves with one texture change it once.
        let mut materials = [leaf.clone(), leaf, Material::plain("bark".into(), MaterialClass::Bark, [0.5; 3], 0.6)];
        wet_leaf_materials(1.0, &mut materials, &mut images);
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
