//! Converts heights and colours to the images of a material: sRGB, normal map, roughness, displacement.

use glam::Vec3;

use super::material::square_map;
use osier_base::par::par_map;
use osier_base::units::{byte, srgb_byte};
use osier_scene::{Image, ImageKind, Mesh, Pixels};

/// A texel of a procedural surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaterialTexel {
    /// Linear base colour, 0..1 per channel.
    pub color: Vec3,
    /// Height, 0..1 of the material's height range.
    pub height: f32,
    /// Perceptual roughness, 0..1.
    pub rough: f32,
}

/// The images `<name>_color` (sRGB), `_normal`, `_rough` and, with `height`, `_height` (16 bit) of a square of texels, `side`
/// along an edge, rows from the top. `slopes`: height range divided by the size of a texel, across and up.
pub(super) fn surface_images(
    name: &str,
    side: u32,
    texels: &[MaterialTexel],
    slopes: [f32; 2],
    height: bool,
) -> Vec<Image> {
    // Normals come from the heights, so that colour, relief and shading agree.
    let heights: Vec<f32> = texels.iter().map(|t| t.height).collect();
    let image = |kind, what, pixels| square_map(name, what, kind, side, pixels);
    let mut images = vec![
        image(ImageKind::Color, "color", Pixels::U8(srgb_image(texels.iter().map(|t| t.color)))),
        image(ImageKind::Data, "normal", Pixels::U8(normal_map(&heights, side as usize, slopes))),
        image(ImageKind::Data, "rough", Pixels::U8(texels.iter().map(|t| byte(t.rough)).collect())),
    ];
    if height {
        images.push(image(ImageKind::Data, "height", Pixels::U16(heights.iter().map(|h| unorm16(*h)).collect())));
    }
    images
}

/// A linear colour as three sRGB bytes.
pub(super) fn srgb_bytes(color: Vec3) -> [u8; 3] {
    color.to_array().map(srgb_byte)
}

/// Linear colours as sRGB bytes, three a pixel, in the order of the iterator.
pub(super) fn srgb_image(colors: impl Iterator<Item = Vec3>) -> Vec<u8> {
    let mut out = Vec::with_capacity(colors.size_hint().0 * 3);
    for color in colors {
        out.extend(srgb_bytes(color));
    }
    out
}

/// Unit normals of a square height field, row 0 at the top, wrapped at the borders: normalize(-dh/du, -dh/dv, 1) by
/// central differences, stored as (n + 1) / 2 in RGB bytes. `slopes`: height unit divided by the size of a pixel,
/// across and up.
pub(super) fn normal_map(heights: &[f32], side: usize, slopes: [f32; 2]) -> Vec<u8> {
    let rows: Vec<usize> = (0..side).collect();
    let row = |&y: &usize| {
        let row = |y: usize| &heights[y % side * side..][..side];
        let (above, row_here, below) = (row(y + side - 1), row(y), row(y + 1));
        let mut out = Vec::with_capacity(side * 3);
        for x in 0..side {
            // Central differences with wrapped neighbours, so that the normal map tiles as the heights do.
            let left = if x == 0 { side - 1 } else { x - 1 };
            let right = if x + 1 == side { 0 } else { x + 1 };
            let dx = (row_here[right] - row_here[left]) * 0.5 * slopes[0];
            let dy = (above[x] - below[x]) * 0.5 * slopes[1];
            // Normal of the graph of h, mapped from [-1, 1] to [0, 255].
            let n = (Vec3::new(-dx, -dy, 1.0).normalize() + Vec3::ONE) * 0.5;
            out.extend(n.to_array().map(byte));
        }
        out
    };
    concatenated(par_map(&rows, row))
}

/// Concatenates rows that were computed in parallel, with one allocation.
pub(super) fn concatenated<T>(rows: Vec<Vec<T>>) -> Vec<T> {
    let mut out = Vec::with_capacity(rows.iter().map(Vec::len).sum());
    for mut row in rows {
        out.append(&mut row);
    }
    out
}

/// A value in [0, 1] as an unsigned normalized 16-bit integer, rounded to nearest.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535 before the cast")]
pub(super) fn unorm16(c: f32) -> u16 {
    (c.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16
}

/// Index of the point that is added next. The cast is exact: leaves, quads, rods and walls have far fewer than 2^32 points.
#[allow(clippy::cast_possible_truncation, reason = "single leaves, quads, rods and walls")]
pub(super) fn next_index(mesh: &Mesh) -> u32 {
    mesh.points.len() as u32
}

/// Index of the last of some points, at least one; exact as in [`next_index`].
#[allow(clippy::cast_possible_truncation, reason = "leaves have at most some thousand points")]
pub(super) fn index_of_last<T>(points: &[T]) -> u32 {
    (points.len() - 1) as u32
}
