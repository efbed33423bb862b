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
    Gif { encoder: Box<gif::Encoder<W>>, palette: Option<Box<Palette>>, delay: u16 },
    Apng { writer: Box<png::Writer<W>>, opaque: bool },
}

/// Largest difference of a channel between a pixel and its colour of the palette; a palette lacks colours that are farther off.
/// Own: chosen by eye; three times the noise of dithering.
const FAR: u8 = 24;
/// Pixels of a frame of which one may lack its colour. Own: chosen on clips of growth and of autumn; those that sway keep their
/// palette.
const PIXELS_PER_LACK: usize = 500;

/// The colours of a GIF. They stay from frame to frame, since a palette for each frame would flicker, until a frame has colours
/// that they lack: leaves that unfold or turn.
struct Palette {
    quantizer: NeuQuant,
    /// RGB bytes; colour 0 is that of transparent pixels.
    colors: Vec<u8>,
    has_transparency: bool,
    /// RGBA bytes of the pixels that the colours were fitted to.
    samples: Vec<u8>,
    /// Most pixels of a frame that may lack their colour; unknown until the first frame is looked up.
    allowed: Option<usize>,
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

/// Delay between frames of an APNG, `base / rate` seconds, as the nearest fraction whose numbers have 16 bits and are 1 or more: a
/// denominator of 0 would stand for 100. `rate` and `base`: 1 or more.
/// # Errors
/// P003 if a number has more than 16 bits, which is excluded: slower and faster clips have the longest and the shortest delay.
fn apng_delay(rate: u32, base: u32) -> Result<(u16, u16)> {
    let most = u64::from(u16::MAX);
    let (num, den) = (u64::from(base), u64::from(rate));
    // Scale the larger number to about the largest of 16 bits, so that the other keeps as many digits as possible.
    let (num, den) = if num.max(den) <= most {
        (num, den)
    } else if num >= den {
        let short = (most * den / num).max(1);
        ((num * short + den / 2) / den, short)
    } else {
        let short = (most * num / den).max(1);
        (short, (den * short + num / 2) / num)
    };
    let short = |n: u64| u16::try_from(n.min(most)).map_err(encoding_error);
    Ok((short(num)?, short(den)?))
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
                let (seconds, parts) = apng_delay(rate, base)?;
                encoder.set_frame_delay(seconds, parts).map_err(encoding_error)?;
                ClipEncoder::Apng { writer: Box::new(encoder.write_header().map_err(encoding_error)?), opaque }
            }
        };
        Ok(Self { encoder, size: [width, height] })
    }

    /// Encodes the next frame and writes it to the sink. A GIF keeps the palette of the frame before while its colours suffice.
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
                let palette = palette.get_or_insert_with(|| Box::new(Palette::of(picture)));
                let buffer = palette.indices(picture);
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
                    buffer: buffer.into(),
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
    /// The palette of a picture.
    fn of(picture: &Picture) -> Self {
        Self::fitted(opaque_pixels(picture).collect(), !picture.is_opaque())
    }

    /// The palette of a picture and of those before it.
    fn extended(&self, picture: &Picture) -> Self {
        // Half of the earlier pixels: what was seen keeps its colours, and memory does not grow with the clip.
        let earlier = self.samples.chunks_exact(4).step_by(2).flatten().copied();
        let samples = earlier.chain(opaque_pixels(picture)).collect();
        Self::fitted(samples, self.has_transparency || !picture.is_opaque())
    }

    /// 255 colours fitted to pixels, after colour 0 for the transparent ones.
    fn fitted(opaque: Vec<u8>, has_transparency: bool) -> Self {
        let samples = if opaque.is_empty() { vec![0, 0, 0, 255] } else { opaque };
        let quantizer = NeuQuant::new(3, 255, &samples);
        let mut colors = vec![0, 0, 0];
        colors.extend(quantizer.color_map_rgb());
        Self { quantizer, colors, has_transparency, samples, allowed: None }
    }

    /// Index of the nearest colour of each pixel. Fits the palette anew if the picture has colours that it lacks.
    fn indices(&mut self, picture: &Picture) -> Vec<u8> {
        let (indices, lacks) = self.nearest(picture);
        match self.allowed {
            None => {
                // Colours that the fitted palette lacks even in its own picture must not cause a new palette: allow three times
                // their number.
                self.allowed = Some(3 * lacks + picture.pixels.len() / PIXELS_PER_LACK);
                indices
            }
            Some(allowed) if lacks > allowed || (!self.has_transparency && !picture.is_opaque()) => {
                *self = self.extended(picture);
                self.indices(picture)
            }
            Some(_) => indices,
        }
    }

    /// Index of the nearest colour of each pixel, with ordered dithering against banding, and the number of pixels that lie far
    /// from it.
    fn nearest(&self, picture: &Picture) -> (Vec<u8>, usize) {
        /// Threshold matrix of 4 x 4 pixels, in half steps of 8-bit sRGB. A fixed pattern does not crawl from frame
        /// to frame.
        const DITHER: [i8; 16] = [-8, 0, -6, 2, 4, -4, 6, -2, -5, 3, -7, 1, 7, -1, 5, -3];
        let width = picture.width.max(1) as usize;
        let mut lacks = 0;
        let index = |(i, p): (usize, &[u8; 4])| {
            if p[3] < 128 {
                return 0;
            }
            let shift = DITHER[(i / width % 4) * 4 + i % width % 4] / 2;
            let dithered = |c: u8| c.saturating_add_signed(shift);
            let wanted = [dithered(p[0]), dithered(p[1]), dithered(p[2])];
            let nearest = self.quantizer.index_of(&[wanted[0], wanted[1], wanted[2], 255]);
            let found = self.colors.get(3 * (nearest + 1)..).unwrap_or_default();
            lacks += usize::from(wanted.iter().zip(found).any(|(a, b)| a.abs_diff(*b) > FAR));
            #[allow(clippy::cast_possible_truncation, reason = "the palette has 256 colours")]
            let index = (nearest + 1).min(255) as u8;
            index
        };
        let indices = picture.pixels.iter().enumerate().map(index).collect();
        (indices, lacks)
    }
}

/// RGBA bytes of the opaque pixels of a picture.
fn opaque_pixels(picture: &Picture) -> impl Iterator<Item = u8> + '_ {
    // Half-transparent pixels count as opaque from alpha 128 on: GIF knows no partial transparency.
    picture.pixels.iter().filter(|p| p[3] >= 128).flat_map(|p| [p[0], p[1], p[2], 255])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RGBA bytes of the frames of a GIF of these pictures.
    fn shown(pictures: &[Picture]) -> Vec<Vec<u8>> {
        let mut file = Vec::new();
        let size = [pictures[0].width, pictures[0].height];
        let timing = ClipTiming { frames: 3, fps: (24, 1) };
        let mut clip = ClipWriter::new(&mut file, ClipFormat::Gif, size, timing, true).expect("a GIF");
        pictures.iter().for_each(|p| clip.frame(p).expect("a frame"));
        clip.finish().expect("an end");
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut reader = options.read_info(&file[..]).expect("a GIF");
        let mut frames = Vec::new();
        while let Some(frame) = reader.read_next_frame().expect("a frame") {
            frames.push(frame.buffer.to_vec());
        }
        frames
    }

    #[test]
    fn delays_of_apng_fit_into_16_bits() {
        let apng_delay = |rate, base| super::apng_delay(rate, base).expect("16 bits");
        assert_eq!((apng_delay(24, 1), apng_delay(24_000, 1001)), ((1, 24), (1001, 24_000)));
        // Every seventieth frame of 24000/1001 a second, and a rate beyond 16 bits.
        for (rate, base) in [(24_000, 70_070), (100_000, 3_003), (90_000, 89_999)] {
            let (seconds, parts) = apng_delay(rate, base);
            let (found, wanted) = (f64::from(seconds) / f64::from(parts), f64::from(base) / f64::from(rate));
            assert!((found - wanted).abs() < 1e-3 * wanted, "{rate} {base}: {found}");
        }
        assert_eq!((apng_delay(1, u32::MAX), apng_delay(u32::MAX, 1)), ((u16::MAX, 1), (1, u16::MAX)));
    }

    #[test]
    fn colors_that_appear_later_are_shown_and_earlier_ones_stay() {
        // A grey gradient; then green covers 1/16 of it, then orange another sixteenth.
        let grey = |i: usize| {
            let v = u8::try_from(60 + i / 8 % 128).expect("a byte");
            [v, v, v, 255]
        };
        let mut pictures = vec![Picture { width: 64, height: 64, pixels: (0..4096).map(grey).collect() }; 3];
        let (green, orange) = ([30, 140, 40, 255], [220, 110, 20, 255]);
        pictures[1].pixels[..256].fill(green);
        pictures[2].pixels[..256].fill(green);
        pictures[2].pixels[1024..1280].fill(orange);
        let frames = shown(&pictures);
        assert_eq!(frames.len(), 3);
        // Within the limit of a missing colour plus the dithering, which is 4 at most.
        for (frame, picture) in frames.iter().zip(&pictures) {
            let far = frame
                .chunks_exact(4)
                .zip(&picture.pixels)
                .filter(|(a, b)| a.iter().zip(b.iter()).any(|(x, y)| x.abs_diff(*y) > FAR + 4));
            assert!(far.count() <= 2, "colours are missing");
        }
    }

    #[test]
    fn a_palette_that_suffices_is_kept() {
        let picture = |v: u8| Picture::filled(16, 16, [v, 100, 50, 255]);
        let mut palette = Palette::of(&picture(90));
        palette.indices(&picture(90));
        let before = palette.colors.clone();
        palette.indices(&picture(94));
        assert_eq!(palette.colors, before);
        palette.indices(&picture(190));
        assert_ne!(palette.colors, before);
    }
}
