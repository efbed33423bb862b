//! From the foreground of a pixel to its bytes; tiles.

use glam::Vec3;

use super::perspective::PerspectiveCamera;
use super::request::RenderRequest;
use super::tone::encode_srgb;

/// Pixels along the side of a tile, the unit of parallel work and of progress.
pub(super) const TILE: u32 = 16;

/// A pixel before it is composited over its background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ForegroundPixel {
    /// Tone-mapped colour of the objects in it.
    pub color: Vec3,
    /// Fraction of the pixel that objects cover, 0 to 1.
    pub coverage: f32,
    /// Light on the visible part of the floor relative to a floor without shadow, 0 to 1.
    pub floor_light: f32,
}

/// Number of tiles of a picture: the steps of progress that rendering it takes.
pub fn tile_count([width, height]: [u32; 2]) -> u64 {
    u64::from(width.div_ceil(TILE)) * u64::from(height.div_ceil(TILE))
}

/// Composites a pixel over its background and encodes it as sRGB and straight alpha.
pub(super) fn composite(
    request: &RenderRequest,
    camera: &PerspectiveCamera,
    pixel: [u32; 2],
    foreground: ForegroundPixel,
) -> [u8; 4] {
    let ForegroundPixel { color, coverage, floor_light } = foreground;
    let background_share = 1.0 - coverage;
    if background_share <= 0.0 {
        return encode_srgb(color, 1.0);
    }
    let direction = camera.direction(pixel, [0.5, 0.5]);
    // An opaque backdrop is darkened by the shadow on its floor.
    if let Some(backdrop) = request.backdrop.color(direction, camera.picture_position(pixel), &request.light) {
        return encode_srgb(color * coverage + backdrop * floor_light.min(1.0) * background_share, 1.0);
    }
    // On a transparent one the shadow is black with the alpha of the light that it takes away.
    // Straight alpha: the colour is divided by the alpha that it will be multiplied with.
    let shadow = (1.0 - floor_light).clamp(0.0, 1.0) * background_share;
    let alpha = coverage + shadow;
    encode_srgb(if alpha > 0.0 { color * (coverage / alpha) } else { Vec3::ZERO }, alpha)
}
