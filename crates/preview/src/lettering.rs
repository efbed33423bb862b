//! Captions: Noto Sans Mono, drawn beforehand at two heights.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::picture::Picture;
use osier_base::convert::saturating_byte;

/// A height of letters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Letters {
    /// 16 pixels.
    Small,
    /// 24 pixels.
    Large,
}

impl Letters {
    fn raster(self) -> RasterHeight {
        match self {
            Self::Small => RasterHeight::Size16,
            Self::Large => RasterHeight::Size24,
        }
    }

    /// Height of a line, pixels.
    pub fn height(self) -> u32 {
        match self {
            Self::Small => 16,
            Self::Large => 24,
        }
    }

    /// Width of a letter, pixels; all are equally wide.
    pub fn width(self) -> u32 {
        u32::try_from(get_raster_width(FontWeight::Regular, self.raster())).unwrap_or(0)
    }

    /// The text, cut with `…` in the form of two dots where it is wider than `room` pixels.
    pub fn fit(self, text: &str, room: u32) -> String {
        let most = (room / self.width().max(1)) as usize;
        if text.chars().count() <= most {
            return text.to_owned();
        }
        text.chars().take(most.saturating_sub(2)).chain("..".chars()).collect()
    }
}

impl Picture {
    /// Writes a line of text with its upper left corner at `x`, `y`. Letters that the face lacks become `?`.
    pub fn write(&mut self, text: &str, [x, y]: [u32; 2], letters: Letters, ink: [u8; 3]) {
        let mut left = x;
        for c in text.chars() {
            let raster = |c| get_raster(c, FontWeight::Regular, letters.raster());
            if let Some(glyph) = raster(c).or_else(|| raster('?')) {
                for (v, row) in (y..).zip(glyph.rows()) {
                    for (u, strength) in (left..).zip(row.iter()) {
                        self.blend(u, v, ink, *strength);
                    }
                }
            }
            left += letters.width();
        }
    }

    fn blend(&mut self, x: u32, y: u32, ink: [u8; 3], strength: u8) {
        let old = self.at(x, y);
        let s = u32::from(strength);
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
        p.write("Il", [4, 2], Letters::Small, [0, 0, 0]);
        let dark = |x0: u32, x1: u32| {
            (x0..x1).flat_map(|x| (0..20).map(move |y| (x, y))).filter(|(x, y)| p.at(*x, *y)[0] < 128).count()
        };
        let w = Letters::Small.width();
        assert!(dark(4, 4 + w) > 8 && dark(4 + w, 4 + 2 * w) > 8 && dark(4 + 2 * w, 64) == 0);
    }

    #[test]
    fn long_texts_are_cut() {
        let w = Letters::Small.width();
        assert_eq!(Letters::Small.fit("branch_angle = 38", w * 8), "branch..");
        assert_eq!(Letters::Small.fit("seed 7", w * 8), "seed 7");
    }
}
