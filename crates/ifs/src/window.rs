//! The part of the plane that a picture shows.

use glam::DVec3;

use super::affine::AxisScaling;

/// A rectangle of table units seen as pixels; row 0 at the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureWindow {
    /// Width of the picture, pixels.
    pub width: usize,
    /// Height of the picture, pixels.
    pub height: usize,
    /// Middle of the picture, table units, y up.
    pub center: [f64; 2],
    /// Side of a square pixel, table units.
    pub pixel: f64,
}

impl PictureWindow {
    /// Scale and shift from table units, y up, to pixels, y down, whose origin is the upper left corner of the picture.
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    pub fn frame(&self) -> AxisScaling {
        let k = 1.0 / self.pixel;
        let (w, h) = (self.width as f64 * 0.5, self.height as f64 * 0.5);
        // The centre lies in the middle of the picture; y is flipped, as row 0 is at the top.
        let shift = DVec3::new(w - self.center[0] * k, h + self.center[1] * k, 0.0);
        AxisScaling { scale: DVec3::new(k, -k, k), shift }
    }

    /// Shows the box from `low` to `high`, table units, whole, with a margin of 3 % of its longer side.
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    pub fn fitted(low: DVec3, high: DVec3, width: usize, height: usize) -> Self {
        let size = high - low;
        let margin = 0.03 * size.x.max(size.y);
        let (w, h) = (size.x + 2.0 * margin, size.y + 2.0 * margin);
        // The box fits in both directions; the narrower one gets more margin.
        let pixel = (w / width.max(1) as f64).max(h / height.max(1) as f64);
        let middle = (low + high) * 0.5;
        let pixel = if pixel > 0.0 && pixel.is_finite() { pixel } else { 1.0 };
        Self { width, height, center: [middle.x, middle.y], pixel }
    }
}
