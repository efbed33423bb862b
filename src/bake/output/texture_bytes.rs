//! Bytes of a scene's textures and height maps as files, predicted without encoding them.

use crate::bake::output::memory::decoded_bytes;
use osier_base::convert::to_usize;
use osier_base::math;
use osier_export::textures;
use osier_scene::{Image, Material, MaterialClass, Pixels, Scene};

/// Rows of an image that are encoded to predict the bytes of all of them, and the number of equal bands they are taken from.
/// Own: an eighth of a usual texture; more bands follow its content better, but have more first rows, which no filter shrinks.
const SAMPLED_ROWS: u32 = 64;
const BANDS: u32 = 4;

/// Shares of the bytes of the samples that the PNG of a drawn map has, at both ends of the range of its texels: bark and leaves at
/// sides of 64 and 1024 texels, ground at texels of 0.4 and 3 mm. Measured on the presets, whose textures they predict within a sixth.
struct FileShares {
    /// Colour and roughness.
    color: [f64; 2],
    normal: [f64; 2],
    height: [f64; 2],
}

/// Bark drawn at more texels is smoother from one to the next.
const BARK: FileShares = FileShares { color: [0.42, 0.15], normal: [0.22, 0.33], height: [0.95, 0.74] };
/// Bark of ridges or thick plates.
const DEEP_BARK: FileShares = FileShares { color: [0.57, 0.22], normal: [0.74, 0.60], height: [1.0, 0.80] };
/// Depth from which on bark is deep, m: between that of smooth kinds, at most 3 mm, and that of ridges, 6 mm and more.
const DEEP_BARK_DEPTH: f32 = 0.0045;
const LEAF: FileShares = FileShares { color: [0.56, 0.38], normal: [0.47, 0.52], height: [0.95, 0.81] };
const GROUND: FileShares = FileShares { color: [0.09, 0.60], normal: [0.24, 0.70], height: [0.62, 0.93] };

/// Bytes of a texel of height maps as half floats, which keep less of the noise of 16 bits than PNG does, at the same ends.
const BARK_HALF_FLOATS: [f64; 2] = [1.75, 1.11];
const GROUND_HALF_FLOATS: [f64; 2] = [0.38, 1.39];
/// Bytes of other height maps as half floats per byte as PNG, measured on bark.
const HALF_FLOATS_PER_PNG: f64 = 0.75;

/// A map of a material.
#[derive(Debug, Clone, Copy)]
enum MapKind {
    Color,
    Normal,
    Roughness,
    Height,
}

/// Predicts the bytes of the image at each index of [`Scene::images`] as PNG, after the `halvings` of it.
pub(crate) fn png_bytes(scene: &Scene, halvings: &[u32]) -> Vec<u64> {
    let mut uses: Vec<Option<(MapKind, &Material)>> = vec![None; scene.images.len()];
    for material in &scene.materials {
        let maps = material.maps;
        let slots = [
            (maps.color, MapKind::Color),
            (maps.normal, MapKind::Normal),
            (maps.roughness, MapKind::Roughness),
            (maps.height, MapKind::Height),
        ];
        for (image, kind) in slots {
            if let Some(place) = image.and_then(|i| uses.get_mut(to_usize(i))) {
                place.get_or_insert((kind, material));
            }
        }
    }
    let each = scene.images.iter().zip(uses).zip(halvings);
    each.map(|((image, of), n)| {
        let samples = decoded_bytes(image) >> (2 * n);
        let drawn = || of.and_then(|(kind, material)| drawn_share(kind, material, image.width >> n));
        sampled_share(image)
            .or_else(drawn)
            .map_or_else(|| default_bytes(image, samples), |share| bytes_share(samples, share))
    })
    .collect()
}

/// Predicts the bytes of the height maps of all materials as half floats, each material with a file of its own. `png`: of
/// [`png_bytes`] for the same `halvings`.
pub(crate) fn half_float_heights(scene: &Scene, halvings: &[u32], png: &[u64]) -> u64 {
    let bytes = |material: &Material| {
        let index = to_usize(material.maps.height?);
        let (image, n) = scene.images.get(index).zip(halvings.get(index))?;
        let [width, height] = [image.width, image.height].map(|side| u64::from(side >> n));
        let per_texel = match material.class {
            MaterialClass::Bark => Some(lerp_clamped(BARK_HALF_FLOATS, side_fraction(image.width >> n))),
            MaterialClass::Ground => Some(lerp_clamped(GROUND_HALF_FLOATS, texel_fraction(material, image.width >> n))),
            _ => None,
        };
        Some(match per_texel {
            Some(bytes) => bytes_share(width * height, bytes),
            None => bytes_share(*png.get(index)?, HALF_FLOATS_PER_PNG),
        })
    };
    scene.materials.iter().filter_map(bytes).sum()
}

/// Share of the bytes of the samples that some rows of the image have as PNG; `None` for an image without its pixels, as most are in
/// an estimate.
fn sampled_share(image: &Image) -> Option<f64> {
    let row = to_usize(image.width) * usize::from(image.channels);
    let is_whole = |samples: usize| row > 0 && samples == row * to_usize(image.height);
    let height = image.height.min(SAMPLED_ROWS);
    let bands = if image.height > SAMPLED_ROWS { BANDS } else { 1 };
    let rows = height / bands;
    // Evenly spaced, the first at the top and the last at the bottom.
    let first = |band: u32| to_usize((image.height - rows) / bands.saturating_sub(1).max(1) * band) * row;
    let ranges = (0..bands).map(|band| first(band)..first(band) + to_usize(rows) * row);
    let pixels = match &image.pixels {
        Pixels::U8(all) if is_whole(all.len()) => {
            Pixels::U8(ranges.filter_map(|range| all.get(range)).flatten().copied().collect())
        }
        Pixels::U16(all) if is_whole(all.len()) => {
            Pixels::U16(ranges.filter_map(|range| all.get(range)).flatten().copied().collect())
        }
        _ => return None,
    };
    let part = Image { name: image.name.clone(), height: rows * bands, pixels, ..*image };
    let png = textures::png(&part).ok()?;
    Some(png.len() as f64 / decoded_bytes(&part).max(1) as f64)
}

/// Share of the bytes of the samples that the PNG of a drawn map of `side` texels has; `None` for materials that are not drawn.
fn drawn_share(kind: MapKind, material: &Material, side: u32) -> Option<f64> {
    let (shares, place) = match material.class {
        MaterialClass::Bark if material.height_range > DEEP_BARK_DEPTH => (DEEP_BARK, side_fraction(side)),
        MaterialClass::Bark => (BARK, side_fraction(side)),
        MaterialClass::Leaf => (LEAF, side_fraction(side)),
        MaterialClass::Ground => (GROUND, texel_fraction(material, side)),
        MaterialClass::Catkin | MaterialClass::Water => return None,
    };
    let ends = match kind {
        MapKind::Color | MapKind::Roughness => shares.color,
        MapKind::Normal => shares.normal,
        MapKind::Height => shares.height,
    };
    Some(lerp_clamped(ends, place))
}

/// Position of a side between 64 and 1024 texels, 0 to 1 on a logarithmic scale.
fn side_fraction(side: u32) -> f64 {
    (f64::from(side.max(1).ilog2()) - 6.0) / 4.0
}

/// Position of the texel size of a ground of `side` texels between 0.4 and 3 mm, 0 to 1 on a logarithmic scale.
fn texel_fraction(material: &Material, side: u32) -> f64 {
    const FINE: f64 = 0.0004;
    const COARSE: f64 = 0.003;
    let texel = f64::from(material.tile) / f64::from(side.max(1));
    math::ln(texel / FINE) / math::ln(COARSE / FINE)
}

/// Linear interpolation between two values at `place`, which is clamped to 0 to 1.
fn lerp_clamped([first, last]: [f64; 2], place: f64) -> f64 {
    first + (last - first) * place.clamp(0.0, 1.0)
}

/// Bytes of an image of which nothing is known. Own: PNG halves noise-like pictures of 8 bits about; of heights in 16 bits the lower
/// half is noise, and 90 % is left.
fn default_bytes(image: &Image, samples: u64) -> u64 {
    match image.pixels {
        Pixels::U8(_) => samples / 2,
        Pixels::U16(_) => samples * 9 / 10,
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bytes of a file, a share of at most a few")]
fn bytes_share(bytes: u64, share: f64) -> u64 {
    (bytes as f64 * share) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::ImageKind;

    fn image(width: u32, height: u32, pixels: Vec<u8>) -> Image {
        Image { name: "a".into(), kind: ImageKind::Color, width, height, channels: 3, pixels: Pixels::U8(pixels) }
    }

    /// An image of a half without noise: bands meet both halves.
    #[test]
    fn pixels_that_are_there_are_sampled() {
        let mut rng = osier_base::rng::Rng::at(3, &["noise".into()]);
        let noisy = (0..256 * 256 * 3).map(|i| if i < 256 * 128 * 3 { 7 } else { rng.next_u64().to_le_bytes()[2] });
        let half = image(256, 256, noisy.collect());
        let written = textures::png(&half).expect("png").len() as f64;
        let share = sampled_share(&half).expect("pixels");
        let predicted = share * decoded_bytes(&half) as f64;
        assert!((predicted / written - 1.0).abs() < 0.1, "{predicted} of {written}");
        assert!(sampled_share(&image(256, 256, Vec::new())).is_none(), "no pixels");
        assert!(sampled_share(&image(3, 5, vec![9; 45])).is_some(), "fewer rows than are sampled");
    }

    #[test]
    fn shares_are_linear_between_their_ends() {
        let at = |place: f64| lerp_clamped([1.0, 3.0], place);
        assert!([at(-1.0), at(0.25), at(9.0)].iter().zip([1.0, 1.5, 3.0]).all(|(a, b)| (a - b).abs() < 1e-12));
        let sides = [side_fraction(64), side_fraction(256), side_fraction(4096)];
        assert!(sides.iter().zip([0.0, 0.5, 1.5]).all(|(a, b): (&f64, f64)| (a - b).abs() < 1e-12));
    }
}
