//! Clips as GIF or APNG, encoded frame by frame, so that memory does not grow with their length.

use std::io::Write;

use color_quant::NeuQuant;

use super::picture::Picture;
use osier_base::convert::narrow;
use osier_base::{Error, Result};
use osier_export::GENERATOR;

/// File format of a clip; both loop forever.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipFormat {
    /// 256 colours of one palette, one of them transparent; opens everywhere.
    Gif,
    /// 24-bit colours and alpha; opens in browsers.
    Apng,
}

/// Encodes a clip frame by frame into a sink.
/// # Examples
/// ```
/// use osier_preview::{ClipFormat, ClipTiming, ClipWriter, Picture};
///
/// # fn main() -> osier_base::Result<()> {
/// let mut gif = Vec::new();
/// let timing = ClipTiming { frames: 2, fps: (24, 1) };
/// let mut clip = ClipWriter::new(&mut gif, ClipFormat::Gif, [8, 8], timing, true)?;
/// clip.frame(&Picture::filled(8, 8, [20, 90, 30, 255]))?;
/// clip.frame(&Picture::filled(8, 8, [30, 99, 40, 255]))?;
/// clip.finish()?;
/// assert!(gif.starts_with(b"GIF89a"));
/// # Ok(())
/// # }
/// ```
pub struct ClipWriter<W: Write> {
    encoder: ClipEncoder<W>,
    size: [u32; 2],
}

enum ClipEncoder<W: Write> {
    Gif { encoder: Box<gif::Encoder<W>>, palette: Option<Palette>, delay: u16 },
    Apng { writer: Box<png::Writer<W>>, opaque: bool },
}

/// The colours of a GIF. They are those of its first frame: a palette for each frame would flicker.
struct Palette {
    quantizer: NeuQuant,
    /// RGB bytes; colour 0 is that of transparent pixels.
    colors: Vec<u8>,
    has_transparency: bool,
}

/// P003 with the reason of an encoder.
fn encoding_error(e: impl std::fmt::Display) -> Error {
    Error::input("P003", format!("cannot encode the clip: {e}"))
}

/// Length and frame rate of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClipTiming {
    /// Number of frames that will be written; APNG stores it first.
    pub frames: u32,
    /// Frames per second as a fraction, numerator and denominator.
    pub fps: (u32, u32),
}

impl<W: Write> ClipWriter<W> {
    /// Begins a clip of `size` pixels that loops forever. A GIF stores the delay of a frame in hundredths of a
    /// second, at least 2: players slow down shorter ones. `opaque`: no frame has transparent pixels.
    /// # Errors
    /// `Export` P003 if the format cannot hold it or the sink fails.
    pub fn new(sink: W, format: ClipFormat, size: [u32; 2], timing: ClipTiming, opaque: bool) -> Result<Self> {
        let [width, height] = size;
        let ClipTiming { frames, fps } = timing;
        let (rate, base) = (fps.0.max(1), fps.1.max(1));
        let encoder = match format {
            ClipFormat::Gif => {
                let side =
                    |n: u32| u16::try_from(n).map_err(|_| encoding_error("a side of a GIF has at most 65535 pixels"));
                let mut encoder = gif::Encoder::new(sink, side(width)?, side(height)?, &[]).map_err(encoding_error)?;
                encoder.set_repeat(gif::Repeat::Infinite).map_err(encoding_error)?;
                // Delay between frames in hundredths of a second, rounded and limited to the 655 s that the format holds.
                let delay = (100 * u64::from(base) + u64::from(rate) / 2) / u64::from(rate);
                #[allow(clippy::cast_possible_truncation, reason = "limited to 16 bits")]
                let delay = delay.min(u64::from(u16::MAX)) as u16;
                encoder
                    .write_raw_extension(gif::AnyExtension(0xFE), &[GENERATOR.as_bytes()])
                    .map_err(encoding_error)?;
                ClipEncoder::Gif { encoder: Box::new(encoder), palette: None, delay: delay.max(2) }
            }
            ClipFormat::Apng => {
                let mut encoder = png::Encoder::new(sink, width, height);
                encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
                encoder.set_depth(png::BitDepth::Eight);
                encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
                encoder.add_text_chunk("Software".into(), GENERATOR.into()).map_err(encoding_error)?;
                encoder.set_animated(frames.max(1), 0).map_err(encoding_error)?;
                // Both numbers of the delay have 16 bits.
                let (rate, base) = if rate > 65_535 || base > 65_535 { (rate / base, 1) } else { (rate, base) };
                #[allow(clippy::cast_possible_truncation, reason = "limited to 16 bits")]
                let limited = |n: u32| n.min(u32::from(u16::MAX)) as u16;
                encoder.set_frame_delay(limited(base), limited(rate)).map_err(encoding_error)?;
                ClipEncoder::Apng { writer: Box::new(encoder.write_header().map_err(encoding_error)?), opaque }
            }
        };
        Ok(Self { encoder, size: [width, height] })
    }

    /// Encodes the next frame and writes it to the sink. The first frame determines the palette of a GIF.
    /// # Errors
    /// `Export` P003 if its size differs or the sink fails.
    pub fn frame(&mut self, picture: &Picture) -> Result<()> {
        if [picture.width, picture.height] != self.size {
            return Err(encoding_error("a frame has another size than the first"));
        }
        match &mut self.encoder {
            ClipEncoder::Apng { writer, opaque } => {
                writer.write_image_data(&picture.samples(*opaque)).map_err(encoding_error)
            }
            ClipEncoder::Gif { encoder, palette, delay } => {
                let palette = palette.get_or_insert_with(|| Palette::of(picture));
                let frame = gif::Frame {
                    width: narrow(picture.width, "columns of a GIF")?,
                    height: narrow(picture.height, "rows of a GIF")?,
                    delay: *delay,
                    // Without disposal the transparent pixels of a frame would keep those of the
                    // frame before.
                    dispose: if palette.has_transparency {
                        gif::DisposalMethod::Background
                    } else {
                        gif::DisposalMethod::Keep
                    },
                    transparent: palette.has_transparency.then_some(0),
                    palette: Some(palette.colors.clone()),
                    buffer: palette.indices(picture).into(),
                    ..gif::Frame::default()
                };
                encoder.write_frame(&frame).map_err(encoding_error)
            }
        }
    }

    /// Writes the end of the file to the sink.
    /// # Errors
    /// `Export` P003 if frames are missing or the sink fails.
    pub fn finish(self) -> Result<()> {
        match self.encoder {
            ClipEncoder::Apng { writer, .. } => writer.finish().map_err(encoding_error),
            ClipEncoder::Gif { encoder, .. } => {
                encoder.into_inner().map_err(encoding_error)?.flush().map_err(encoding_error)
            }
        }
    }
}

impl Palette {
    /// 255 colours fitted to the opaque pixels of a picture, after colour 0 for the transparent ones.
    fn of(picture: &Picture) -> Self {
        // Half-transparent pixels count as opaque from alpha 128 on: GIF knows no partial
        // transparency.
        let opaque: Vec<u8> =
            picture.pixels.iter().filter(|p| p[3] >= 128).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let samples = if opaque.is_empty() { vec![0, 0, 0, 255] } else { opaque };
        let quantizer = NeuQuant::new(3, 255, &samples);
        let mut colors = vec![0, 0, 0];
        colors.extend(quantizer.color_map_rgb());
        Self { quantizer, colors, has_transparency: !picture.is_opaque() }
    }

    /// Index of the nearest colour of each pixel, with ordered dithering against banding.
    fn indices(&self, picture: &Picture) -> Vec<u8> {
        /// Threshold matrix of 4 x 4 pixels, in half steps of 8-bit sRGB. A fixed pattern does not crawl from frame
        /// to frame.
        const DITHER: [i8; 16] = [-8, 0, -6, 2, 4, -4, 6, -2, -5, 3, -7, 1, 7, -1, 5, -3];
        let width = picture.width.max(1) as usize;
        let index = |(i, p): (usize, &[u8; 4])| {
            if p[3] < 128 {
                return 0;
            }
            let shift = DITHER[(i / width % 4) * 4 + i % width % 4] / 2;
            let dithered = |c: u8| c.saturating_add_signed(shift);
            let nearest = self.quantizer.index_of(&[dithered(p[0]), dithered(p[1]), dithered(p[2]), 255]);
            #[allow(clippy::cast_possible_truncation, reason = "the palette has 256 colours")]
            let index = (nearest + 1).min(255) as u8;
            index
        };
        picture.pixels.iter().enumerate().map(index).collect()
    }
}
