//! Decodes PNG and JPEG: the size in the header is checked against the limits before memory is spent.

use std::io::Cursor;

use image::{ColorType, DynamicImage, ImageDecoder as _, ImageError, ImageFormat, ImageReader};

use crate::{ImportContext, ImportResult};
use osier_base::units;
use osier_scene::{Image, ImageKind, Pixels};

/// A decoded image of 8 bits a channel, rows from the top.
#[derive(Debug, Clone)]
pub(crate) struct DecodedImage {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Interleaved channels per pixel: 1, 3 or 4.
    pub(crate) channels: u8,
    pub(crate) samples: Vec<u8>,
}

impl DecodedImage {
    /// One channel as a grey image; channels that are absent read as `fallback`.
    pub(crate) fn channel(&self, channel: usize, fallback: u8) -> Self {
        let n = usize::from(self.channels);
        let pick = |p: &[u8]| p.get(if n == 1 { 0 } else { channel }).copied().unwrap_or(fallback);
        Self { channels: 1, samples: self.samples.chunks_exact(n).map(pick).collect(), ..*self }
    }

    /// True if some pixel is not fully opaque.
    pub(crate) fn has_transparency(&self) -> bool {
        self.channels == 4 && self.samples.chunks_exact(4).any(|p| p.last() != Some(&255))
    }

    /// RGBA with the grey image `mask`, of equal size, as alpha; `None` if the sizes differ.
    pub(crate) fn with_alpha(&self, mask: &Self) -> Option<Self> {
        if (mask.width, mask.height) != (self.width, self.height) {
            return None;
        }
        let rgb = |p: &[u8]| match p {
            [r, g, b, ..] => [*r, *g, *b],
            p => [p.first().copied().unwrap_or(0); 3],
        };
        let pixels = self.samples.chunks_exact(usize::from(self.channels)).zip(&mask.samples);
        let samples = pixels.flat_map(|(p, a)| rgb(p).into_iter().chain([*a])).collect();
        Some(Self { channels: 4, samples, ..*self })
    }

    /// The image without its alpha; one without alpha stays as it is.
    pub(crate) fn without_alpha(self) -> Self {
        if self.channels != 4 {
            return self;
        }
        let samples = self.samples.chunks_exact(4).flat_map(|p| p.iter().take(3).copied()).collect();
        Self { channels: 3, samples, ..self }
    }

    /// sRGB colours multiplied by a linear factor, as glTF asks where a material has both image and colour.
    /// A grey image becomes RGB.
    pub(crate) fn tinted(mut self, factor: [f32; 4]) -> Self {
        if self.channels == 1 {
            self.samples = self.samples.iter().flat_map(|v| [*v; 3]).collect();
            self.channels = 3;
        }
        let table = |f: f32| -> Vec<u8> {
            let tint = |v: u8| units::srgb_from_linear(units::linear_from_srgb(f32::from(v) / 255.0) * f);
            (0..=255_u8).map(|v| units::byte(tint(v))).collect()
        };
        // A channel has 256 values, so the conversion to linear and back is tabulated once per channel.
        let colors: Vec<Vec<u8>> = factor.iter().take(3).map(|f| table(*f)).collect();
        let alpha: Vec<u8> = (0..=255_u8).map(|v| units::byte(f32::from(v) / 255.0 * factor[3])).collect();
        let tables: Vec<&Vec<u8>> = colors.iter().chain([&alpha]).collect();
        for pixel in self.samples.chunks_exact_mut(usize::from(self.channels)) {
            for (sample, table) in pixel.iter_mut().zip(&tables) {
                *sample = table.get(usize::from(*sample)).copied().unwrap_or(*sample);
            }
        }
        self
    }

    /// Samples times a factor in [0, 1].
    pub(crate) fn scaled(mut self, factor: f32) -> Self {
        self.samples.iter_mut().for_each(|s| *s = units::byte(f32::from(*s) / 255.0 * factor));
        self
    }

    /// An image of the scene with these samples, not converted to linear.
    pub(crate) fn into_image(self, name: String, kind: ImageKind) -> Image {
        let Self { width, height, channels, samples } = self;
        Image { name, kind, width, height, channels, pixels: Pixels::U8(samples) }
    }
}

/// Decodes a PNG or JPEG to 8 bits a channel. `place`: what it is in the file; `spent`: bytes decoded so far for this file.
/// # Errors
/// X010 if it is damaged, of another format, or over a limit.
pub(crate) fn decode(
    context: &ImportContext<'_>,
    place: &str,
    bytes: &[u8],
    spent: &mut u64,
) -> ImportResult<DecodedImage> {
    let picture = decode_deep(context, place, bytes, spent)?;
    let (width, height) = (picture.width(), picture.height());
    // 16-bit and float samples are reduced to 8 bits; grey with alpha becomes RGBA.
    let (channels, samples) = match picture.color() {
        ColorType::L8 | ColorType::L16 => (1, picture.into_luma8().into_raw()),
        ColorType::Rgb8 | ColorType::Rgb16 | ColorType::Rgb32F => (3, picture.into_rgb8().into_raw()),
        _ => (4, picture.into_rgba8().into_raw()),
    };
    Ok(DecodedImage { width, height, channels, samples })
}

/// Decodes a PNG or JPEG at the depth that it has. Parameters and errors as [`decode`].
pub(crate) fn decode_deep(
    context: &ImportContext<'_>,
    place: &str,
    bytes: &[u8],
    spent: &mut u64,
) -> ImportResult<DynamicImage> {
    let side = context.options.limits.get("image-side");
    let budget = context.options.limits.get("image-bytes");
    let failed = |e: &dyn std::fmt::Display| {
        let message = format_args!("{place}: image is damaged: {e}");
        Box::new(context.error_in_file("X010", message).help("save the picture again"))
    };
    // A whole image may need more memory than the decoder is allowed below.
    let refused = |e: ImageError| match e {
        ImageError::Limits(_) => {
            let message = format_args!("{place}: image takes more memory to read than the limit of {budget} bytes");
            Box::new(context.error_in_file("X010", message).help("make it smaller, or use --max-image-bytes"))
        }
        damage => failed(&damage),
    };
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| failed(&e))?;
    // The library recognises more formats than it can decode here; such a file is not damaged.
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg)) {
        return Err(Box::new(
            context
                .error_in_file("X010", format_args!("{place}: image is neither PNG nor JPEG"))
                .help("convert it to PNG"),
        ));
    }
    // The decoders replace missing rows by grey without an error, so truncated files are found here.
    let is_complete = match reader.format() {
        Some(ImageFormat::Png) => is_complete_png(bytes),
        Some(ImageFormat::Jpeg) => is_complete_jpeg(bytes),
        _ => true,
    };
    if !is_complete {
        return Err(failed(&"its end is missing"));
    }
    // The decoder may not allocate more than the budget, whatever the file declares.
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(budget);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(refused)?;
    // Dimensions come from the header: nothing is decoded before they are within the limits.
    let (width, height) = decoder.dimensions();
    if u64::from(width.max(height)) > side {
        let message = format_args!("{place}: image of {width} x {height} pixels, the limit is {side} a side");
        return Err(Box::new(context.error_in_file("X010", message).help("make it smaller, or use --max-image-side")));
    }
    spend(context, place, decoder.total_bytes(), spent)?;
    DynamicImage::from_decoder(decoder).map_err(refused)
}

/// Adds `bytes` to the sum over the images decoded so far for this file.
/// # Errors
/// X010 over the limit.
pub(crate) fn spend(context: &ImportContext<'_>, place: &str, bytes: u64, spent: &mut u64) -> ImportResult<()> {
    let budget = context.options.limits.get("image-bytes");
    *spent = spent.saturating_add(bytes);
    if *spent > budget {
        let message = format_args!("{place}: images take {spent} bytes decoded, the limit is {budget}");
        return Err(Box::new(
            context.error_in_file("X010", message).help("make them smaller, or use --max-image-bytes"),
        ));
    }
    Ok(())
}

/// True if the chunks of a PNG follow each other up to IEND.
fn is_complete_png(bytes: &[u8]) -> bool {
    let mut at = 8_usize;
    loop {
        let head = |k: usize| bytes.get(at + k..at + k + 4);
        let (Some(length), Some(kind)) = (head(0).and_then(|b| b.try_into().ok()), head(4)) else { return false };
        // A chunk is its length, type, data and checksum: 12 bytes besides the data.
        let next = at.saturating_add(12).saturating_add(u32::from_be_bytes(length) as usize);
        if next > bytes.len() {
            return false;
        }
        if kind == b"IEND" {
            return true;
        }
        at = next;
    }
}

/// True if an end-of-image marker (FFD9) follows the last start-of-scan marker (FFDA).
fn is_complete_jpeg(bytes: &[u8]) -> bool {
    // The last of each marker counts: an embedded thumbnail lies before the scans of the picture.
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|w| w == marker);
    last([0xff, 0xd9]).is_some_and(|end| last([0xff, 0xda]).is_some_and(|scan| end > scan))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grey_picture_takes_the_tint() {
        let grey = DecodedImage { width: 2, height: 1, channels: 1, samples: vec![255, 0] };
        let tinted = grey.tinted([1.0, 0.0, 0.5, 1.0]);
        // Linear 0.5 is 1.055 * 0.5^(1 / 2.4) - 0.055 = 0.7354 in sRGB, 188 of 255.
        assert_eq!((tinted.channels, tinted.samples), (3, vec![255, 0, 188, 0, 0, 0]));
    }
}
