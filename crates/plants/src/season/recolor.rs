//! Pictures of leaves in the colours of other seasons, for leaves that are not painted from parameters.

use glam::Vec3;

use osier_base::units::{linear_from_srgb, srgb_byte};
use osier_scene::{Image, Pixels};

/// Range of a pixel's luminance divided by the mean within which it keeps its contrast; much brighter veins would turn
/// white.
const CONTRAST: [f32; 2] = [0.25, 2.2];
/// Least alpha, of 255, of a pixel that counts as part of the leaf.
const SHOWN: u8 = 128;

/// Luminance of a linear colour (Rec. 709).
fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Linear value of each byte of an sRGB channel.
fn linear_table() -> [f32; 256] {
    std::array::from_fn(|k| linear_from_srgb(k as f32 / 255.0))
}

/// Mean linear colour of the pixels with an alpha of at least 128; `None` without such pixels, and for an image that is not of
/// 8-bit RGB or RGBA.
pub fn mean_color(image: &Image) -> Option<[f32; 3]> {
    let (Pixels::U8(bytes), 3 | 4) = (&image.pixels, image.channels) else { return None };
    let table = linear_table();
    let (mut sum, mut count) = ([0.0_f64; 3], 0_u32);
    let shown = |p: &&[u8]| p.get(3).is_none_or(|a| *a >= SHOWN);
    for pixel in bytes.chunks_exact(usize::from(image.channels)).filter(shown) {
        (0..3).for_each(|k| sum[k] += f64::from(table[usize::from(pixel[k])]));
        count += 1;
    }
    (count > 0).then(|| sum.map(|s| osier_base::math::narrow(s / f64::from(count))))
}

/// The image with its colours mixed by a share with `to`, linear, which is scaled by the luminance of each pixel
/// divided by that of `mean`, the mean of the image: veins and spots keep their contrast. An image that is not of 8-bit
/// RGB or RGBA is only renamed.
pub fn recolored(image: &Image, name: String, mean: [f32; 3], to: [f32; 3], share: f32) -> Image {
    let mut out = Image { name, ..image.clone() };
    let (Pixels::U8(bytes), 3 | 4) = (&mut out.pixels, image.channels) else { return out };
    let table = linear_table();
    let (to, middle) = (Vec3::from_array(to), luminance(Vec3::from_array(mean)).max(1e-4));
    for pixel in bytes.chunks_exact_mut(usize::from(image.channels)) {
        let own = Vec3::new(table[usize::from(pixel[0])], table[usize::from(pixel[1])], table[usize::from(pixel[2])]);
        let tone = (luminance(own) / middle).clamp(CONTRAST[0], CONTRAST[1]);
        let color = own.lerp((to * tone).min(Vec3::ONE), share);
        pixel.iter_mut().zip(color.to_array()).for_each(|(byte, c)| *byte = srgb_byte(c));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::ImageKind;

    #[test]
    fn light_and_dark_stay_and_what_is_cut_out_does_not_count() {
        let pixels = Pixels::U8(vec![60, 120, 40, 255, 90, 160, 70, 255, 255, 255, 255, 0]);
        let image = Image { name: "a".into(), kind: ImageKind::Color, width: 3, height: 1, channels: 4, pixels };
        let mean = mean_color(&image).expect("a mean");
        assert!(mean[1] > 0.2 && mean[1] < 0.35, "{mean:?}");
        let red = recolored(&image, "b".into(), mean, [0.6, 0.1, 0.02], 1.0);
        let Pixels::U8(bytes) = &red.pixels else { panic!("bytes") };
        assert!(bytes[0] > bytes[1] && bytes[4] > bytes[0] && bytes[3] == 255 && bytes[11] == 0);
        let now = mean_color(&red).expect("a mean");
        assert!(now[0] > 2.0 * now[1], "{now:?}");
        let same = recolored(&image, "c".into(), mean, [0.6, 0.1, 0.02], 0.0);
        let (Pixels::U8(a), Pixels::U8(b)) = (&same.pixels, &image.pixels) else { panic!("bytes") };
        assert_eq!(a, b);
    }
}
