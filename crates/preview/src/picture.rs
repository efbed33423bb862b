//! Pictures in memory, and their PNG files.

use osier_base::{Error, Result};

/// A picture of sRGB bytes with straight alpha, row 0 at the top.
/// # Examples
/// ```
/// use osier_preview::Picture;
///
/// # fn main() -> osier_base::Result<()> {
/// let mut picture = Picture::filled(4, 2, [255, 255, 255, 255]);
/// picture.set(3, 1, [200, 0, 0, 255]);
/// assert_eq!(picture.at(3, 1), [200, 0, 0, 255]);
/// assert!(picture.is_opaque() && picture.png(&[("Title", "a corner".into())], false)?.starts_with(b"\x89PNG"));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Number of pixels in a row.
    pub width: u32,
    /// Number of rows of pixels.
    pub height: u32,
    /// Row by row, `width * height` of them.
    pub pixels: Vec<[u8; 4]>,
}

impl Picture {
    /// A picture of transparent black pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self::filled(width, height, [0; 4])
    }

    /// A picture of one colour, sRGB with straight alpha.
    pub fn filled(width: u32, height: u32, color: [u8; 4]) -> Self {
        Self { width, height, pixels: vec![color; width as usize * height as usize] }
    }

    /// A pixel as sRGB and straight alpha; transparent outside of the picture.
    pub fn at(&self, x: u32, y: u32) -> [u8; 4] {
        let inside = x < self.width && y < self.height;
        let i = y as usize * self.width as usize + x as usize;
        if inside { self.pixels.get(i).copied().unwrap_or_default() } else { [0; 4] }
    }

    /// Sets a pixel, sRGB with straight alpha; without effect outside of the picture.
    pub fn set(&mut self, x: u32, y: u32, color: [u8; 4]) {
        let inside = x < self.width && y < self.height;
        let i = y as usize * self.width as usize + x as usize;
        if let Some(p) = self.pixels.get_mut(i).filter(|_| inside) {
            *p = color;
        }
    }

    /// Copies rows of `width` pixels to the block whose upper left pixel is given.
    pub(super) fn put_block(&mut self, [x, y]: [u32; 2], width: u32, block: &[[u8; 4]]) {
        for (row, pixels) in (y..).zip(block.chunks(width.max(1) as usize)) {
            let start = row as usize * self.width as usize + x as usize;
            if let Some(to) = self.pixels.get_mut(start..start + pixels.len()) {
                to.copy_from_slice(pixels);
            }
        }
    }

    /// True if every pixel has an alpha of 255, also if there is no pixel.
    pub fn is_opaque(&self) -> bool {
        self.pixels.iter().all(|p| p[3] == 255)
    }

    /// Encodes the picture as a PNG file, without alpha if it is opaque. `notes`: text chunks, keyword and text;
    /// `fast`: compress for speed rather than for size.
    /// # Errors
    /// P003 for a picture without pixels.
    pub fn png(&self, notes: &[(&str, String)], fast: bool) -> Result<Vec<u8>> {
        // The colour space is declared, so that viewers with colour management show the same
        // picture.
        let opaque = self.is_opaque();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(if fast { png::Compression::Fastest } else { png::Compression::Balanced });
        let failed = |e: png::EncodingError| Error::input("P003", format!("cannot encode a picture: {e}"));
        for (keyword, text) in notes {
            encoder.add_itxt_chunk((*keyword).to_owned(), text.clone()).map_err(failed)?;
        }
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&self.samples(opaque)).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }

    /// Bytes pixel by pixel, RGB if `opaque`, else RGBA.
    pub(super) fn samples(&self, opaque: bool) -> Vec<u8> {
        if opaque { self.pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect() } else { self.pixels.concat() }
    }
}
