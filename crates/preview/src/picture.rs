//! Pictures of bytes.

use osier_base::{Error, Result};

/// sRGB bytes with straight alpha, row 0 at the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Four bytes a pixel.
    pub pixels: Vec<[u8; 4]>,
}

impl Picture {
    /// Nothing but transparency.
    pub fn new(width: u32, height: u32) -> Self {
        Self::filled(width, height, [0; 4])
    }

    /// One colour.
    pub fn filled(width: u32, height: u32, color: [u8; 4]) -> Self {
        Self { width, height, pixels: vec![color; width as usize * height as usize] }
    }

    /// A pixel; transparent outside.
    pub fn at(&self, x: u32, y: u32) -> [u8; 4] {
        let inside = x < self.width && y < self.height;
        let i = y as usize * self.width as usize + x as usize;
        if inside { self.pixels.get(i).copied().unwrap_or_default() } else { [0; 4] }
    }

    /// Sets a pixel; nothing outside.
    pub fn set(&mut self, x: u32, y: u32, color: [u8; 4]) {
        let inside = x < self.width && y < self.height;
        let i = y as usize * self.width as usize + x as usize;
        if let Some(p) = self.pixels.get_mut(i).filter(|_| inside) {
            *p = color;
        }
    }

    /// Copies rows of `width` pixels to a place.
    pub(super) fn put_block(&mut self, [x, y]: [u32; 2], width: u32, block: &[[u8; 4]]) {
        for (row, pixels) in (y..).zip(block.chunks(width.max(1) as usize)) {
            let start = row as usize * self.width as usize + x as usize;
            if let Some(to) = self.pixels.get_mut(start..start + pixels.len()) {
                to.copy_from_slice(pixels);
            }
        }
    }

    /// Copies a whole picture to a place.
    pub fn paste(&mut self, other: &Self, x: u32, y: u32) {
        for v in 0..other.height {
            for u in 0..other.width {
                self.set(x + u, y + v, other.at(u, v));
            }
        }
    }

    /// True if every pixel is opaque.
    pub fn is_opaque(&self) -> bool {
        self.pixels.iter().all(|p| p[3] == 255)
    }

    /// As a PNG file. `notes`: text entries, keyword and text; `hurry`: a larger file, sooner.
    /// # Errors
    /// `Export` if it has no pixels.
    pub fn png(&self, notes: &[(&str, String)], hurry: bool) -> Result<Vec<u8>> {
        let opaque = self.is_opaque();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(if hurry { png::Compression::Fastest } else { png::Compression::Balanced });
        let failed = |e: png::EncodingError| Error::export("P003", format!("cannot encode a picture: {e}"));
        for (keyword, text) in notes {
            encoder.add_itxt_chunk((*keyword).to_owned(), text.clone()).map_err(failed)?;
        }
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&self.samples(opaque)).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }

    /// Bytes pixel by pixel, with alpha or without.
    pub(super) fn samples(&self, opaque: bool) -> Vec<u8> {
        if opaque { self.pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect() } else { self.pixels.concat() }
    }
}
