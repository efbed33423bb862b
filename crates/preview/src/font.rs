//! Text on pictures in Noto Sans Mono, rasterised beforehand in two sizes.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::picture::Picture;
use osier_base::convert::saturating_byte;

/// Size of the font: letters of 16 or of 24 pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FontSize {
    Small,
    Large,
}

impl FontSize {
    fn raster(self) -> RasterHeight {
        match self {
            Self::Small => RasterHeight::Size16,
            Self::Large => RasterHeight::Size24,
        }
    }

    /// Height of a line of text, pixels.
    pub(super) fn height(self) -> u32 {
        match self {
            Self::Small => 16,
            Self::Large => 24,
        }
    }

    /// Width of a letter, pixels; all are equally wide.
    fn width(self) -> u32 {
        #[allow(clippy::cast_possible_truncation, reason = "7 or 11 pixels, fixed by the font")]
        let width = get_raster_width(FontWeight::Regular, self.raster()) as u32;
        width
    }

    /// Width of a line of text, pixels.
    pub(super) fn text_width(self, text: &str) -> u32 {
        text.chars().fold(0_u32, |width, _| width.saturating_add(self.width()))
    }

    /// The text, shortened to end in two dots if it is wider than `max_width` pixels.
    pub(super) fn cut(self, text: &str, max_width: u32) -> String {
        let max_letters = (max_width / self.width().max(1)) as usize;
        if text.chars().count() <= max_letters {
            return text.to_owned();
        }
        text.chars().take(max_letters.saturating_sub(2)).chain("..".chars()).collect()
    }
}

impl Picture {
    /// Draws a line of text with its upper left corner at `x`, `y`. Characters that the font lacks become `?`.
    pub(super) fn draw_text(&mut self, text: &str, [x, y]: [u32; 2], size: FontSize, ink: [u8; 3]) {
        let mut left = x;
        for c in text.chars() {
            let raster = |c| get_raster(c, FontWeight::Regular, size.raster());
            if let Some(glyph) = raster(c).or_else(|| raster('?')) {
                for (v, row) in (y..).zip(glyph.rows()) {
                    for (u, opacity) in (left..).zip(row.iter()) {
                        self.blend(u, v, ink, *opacity);
                    }
                }
            }
            left += size.width();
        }
    }

    /// Blends one pixel towards the ink, `opacity` of 255.
    fn blend(&mut self, x: u32, y: u32, ink: [u8; 3], opacity: u8) {
        let old = self.at(x, y);
        let s = u32::from(opacity);
        // Rounded linear interpolation in sRGB: the coverage of glyphs is antialiased for it.
        let mix = |a: u8, b: u8| saturating_byte((u32::from(a) * (255 - s) + u32::from(b) * s + 127) / 255);
        let alpha = mix(old[3], 255);
        self.set(x, y, [mix(old[0], ink[0]), mix(old[1], ink[1]), mix(old[2], ink[2]), alpha]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_leave_ink_where_they_stand() {
        let mut p = Picture::filled(64, 20, [255; 4]);
        p.draw_text("Il", [4, 2], FontSize::Small, [0, 0, 0]);
        let dark = |x0: u32, x1: u32| {
            (x0..x1).flat_map(|x| (0..20).map(move |y| (x, y))).filter(|(x, y)| p.at(*x, *y)[0] < 128).count()
        };
        let w = FontSize::Small.width();
        assert!(dark(4, 4 + w) > 8 && dark(4 + w, 4 + 2 * w) > 8 && dark(4 + 2 * w, 64) == 0);
    }

    #[test]
    fn long_texts_are_cut() {
        let w = FontSize::Small.width();
        assert_eq!(FontSize::Small.cut("branch_angle = 38", w * 8), "branch..");
        assert_eq!(FontSize::Small.cut("seed 7", w * 8), "seed 7");
    }
}
