//! From heights and colours to samples of a picture.

use glam::Vec3;

use crate::units::{byte, srgb_from_linear};

/// A linear colour as three sRGB bytes.
pub(super) fn srgb(color: Vec3) -> [u8; 3] {
    color.to_array().map(|c| byte(srgb_from_linear(c)))
}

/// Unit normals of a square height field, row 0 at the top, wrapped at the borders: normalize(-dh/du, -dh/dv, 1) by
/// central differences. `slopes`: height unit over the size of a pixel, across and up.
fn normals(heights: &[f32], side: usize, slopes: [f32; 2]) -> impl Iterator<Item = Vec3> {
    (0..side * side).map(move |i| {
        let (x, y) = (i % side, i / side);
        let at = |x: usize, y: usize| heights[(y % side) * side + x % side];
        let dx = (at(x + 1, y) - at(x + side - 1, y)) * 0.5 * slopes[0];
        let dy = (at(x, y + side - 1) - at(x, y + 1)) * 0.5 * slopes[1];
        Vec3::new(-dx, -dy, 1.0).normalize()
    })
}

/// [`normals`] as RGB bytes, (n + 1) / 2.
pub(super) fn normals8(heights: &[f32], side: usize, slopes: [f32; 2]) -> Vec<u8> {
    normals(heights, side, slopes).flat_map(|n| ((n + Vec3::ONE) * 0.5).to_array().map(byte)).collect()
}

/// [`normals`] as 16-bit RGB, (n + 1) / 2.
pub(super) fn normals16(heights: &[f32], side: usize, slopes: [f32; 2]) -> Vec<u16> {
    normals(heights, side, slopes).flat_map(|n| ((n + Vec3::ONE) * 0.5).to_array().map(word)).collect()
}

/// A value in [0, 1] as 16 bits, rounded to nearest.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535 before the cast")]
pub(super) fn word(c: f32) -> u16 {
    (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16
}
