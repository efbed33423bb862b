//! Tone mapping: a film-like curve that compresses highlights instead of clipping them.

use glam::Vec3;

use osier_base::units::{byte, srgb_byte};
use osier_scene::ToneCurve;

/// The displayed colour of a radiance, linear, each channel 0 to 1.
/// Own: [`ToneCurve`] with the luminance of the colour as x. If a channel exceeds 1, the colour is mixed with grey of the same
/// luminance, so that bright leaves become paler instead of turning yellow.
pub(super) fn tone_map(color: Vec3) -> Vec3 {
    let c = color.max(Vec3::ZERO) * ToneCurve::EXPOSURE;
    // The curve acts on luminance; scaling all channels alike keeps the hue.
    let x = c.dot(Vec3::new(0.2126, 0.7152, 0.0722)).max(1e-6);
    let luminance = ToneCurve::displayed(x);
    let scaled = c * (luminance / x);
    // Channels beyond 1 are desaturated towards grey of the same luminance; `excess / (excess +
    // 0.6)` rises smoothly from 0 to 1.
    let excess = (scaled.max_element() - 1.0).max(0.0);
    let desaturation = excess / (excess + 0.6);
    scaled.lerp(Vec3::splat(luminance), desaturation).clamp(Vec3::ZERO, Vec3::ONE)
}

/// A displayed colour and its coverage as sRGB bytes with straight alpha.
pub(super) fn encode_srgb(color: Vec3, alpha: f32) -> [u8; 4] {
    let [r, g, b] = color.to_array().map(srgb_byte);
    [r, g, b, byte(alpha)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_rises_from_black_to_white() {
        let values: Vec<f32> = (0..=600).map(|i| ToneCurve::displayed(i as f32 * 0.01)).collect();
        assert!(values.windows(2).all(|w| w[0] <= w[1]));
        assert!(values[0] < 1e-6 && values[600] > 0.95);
    }

    #[test]
    fn greys_stay_grey_and_hues_stay_where_there_is_room() {
        for x in [0.01, 0.18, 1.0, 5.0] {
            let c = tone_map(Vec3::splat(x));
            assert!((c.x - c.z).abs() < 1e-6);
        }
        let green = tone_map(Vec3::new(0.05, 0.2, 0.02));
        assert!((green.y / green.x - 4.0).abs() < 1e-3);
    }
}
