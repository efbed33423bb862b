//! Moving pictures: GIF and APNG, frame after frame, so that memory does not grow with their length.

use std::io::Write;

use color_quant::NeuQuant;

use super::picture::Picture;
use osier_base::{Error, Result};
use osier_export::GENERATOR;

/// How a clip is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipFormat {
    /// 256 colours, opens everywhere.
    Gif,
    /// All colours and alpha, opens in browsers.
    Apng,
}

/// A clip being written.
pub struct ClipWriter<W: Write> {
    kind: ClipEncoder<W>,
    size: [u32; 2],
}

enum ClipEncoder<W: Write> {
    Gif { encoder: Box<gif::Encoder<W>>, palette: Option<Palette>, delay: u16 },
    Apng { writer: Box<png::Writer<W>>, opaque: bool },
}

/// The colours of a clip, taken from its first frame so that they do not flicker.
struct Palette {
    tree: NeuQuant,
    colors: Vec<u8>,
    clear: bool,
}

fn failed(e: impl std::fmt::Display) -> Error {
    Error::export("P003", format!("cannot encode the clip: {e}"))
}

/// Length and frame rate of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClipTiming {
    /// Number of frames.
    pub frames: u32,
    /// Frames per second as a fraction.
    pub fps: (u32, u32),
}

impl<W: Write> ClipWriter<W> {
    /// Begins a clip of `size` pixels that loops. The delay of a GIF is in hundredths of a second, at least two per frame. `opaque`: no frame has transparent pixels.
    /// # Errors
    /// `Export` P003 if the format cannot hold it or the sink fails.
    pub fn new(sink: W, format: ClipFormat, size: [u32; 2], timing: ClipTiming, opaque: bool) -> Result<Self> {
        let [width, height] = size;
        let ClipTiming { frames, fps } = timing;
        let (rate, base) = (fps.0.max(1), fps.1.max(1));
        let kind = match format {
            ClipFormat::Gif => {
                let side = |n: u32| u16::try_from(n).map_err(|_| failed("a side of a GIF has at most 65535 pixels"));
                let mut encoder = gif::Encoder::new(sink, side(width)?, side(height)?, &[]).map_err(failed)?;
                encoder.set_repeat(gif::Repeat::Infinite).map_err(failed)?;
                let delay =
                    u16::try_from((100 * u64::from(base) + u64::from(rate) / 2) / u64::from(rate)).unwrap_or(u16::MAX);
                encoder.write_raw_extension(gif::AnyExtension(0xFE), &[GENERATOR.as_bytes()]).map_err(failed)?;
                ClipEncoder::Gif { encoder: Box::new(encoder), palette: None, delay: delay.max(2) }
            }
            ClipFormat::Apng => {
                let mut encoder = png::Encoder::new(sink, width, height);
                encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
                encoder.set_depth(png::BitDepth::Eight);
                encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
                encoder.add_text_chunk("Software".into(), GENERATOR.into()).map_err(failed)?;
                encoder.set_animated(frames.max(1), 0).map_err(failed)?;
                let (rate, base) = if rate > 65_535 || base > 65_535 { (rate / base, 1) } else { (rate, base) };
                let short = |n: u32| u16::try_from(n).unwrap_or(u16::MAX);
                encoder.set_frame_delay(short(base), short(rate)).map_err(failed)?;
                ClipEncoder::Apng { writer: Box::new(encoder.write_header().map_err(failed)?), opaque }
            }
        };
        Ok(Self { kind, size: [width, height] })
    }

    /// Adds a frame.
    /// # Errors
    /// `Export` P003 if its size differs or the sink fails.
    pub fn frame(&mut self, picture: &Picture) -> Result<()> {
        if [picture.width, picture.height] != self.size {
            return Err(failed("a frame has another size than the first"));
        }
        match &mut self.kind {
            ClipEncoder::Apng { writer, opaque } => writer.write_image_data(&picture.samples(*opaque)).map_err(failed),
            ClipEncoder::Gif { encoder, palette, delay } => {
                let palette = palette.get_or_insert_with(|| Palette::of(picture));
                let frame = gif::Frame {
                    width: u16::try_from(picture.width).unwrap_or(0),
                    height: u16::try_from(picture.height).unwrap_or(0),
                    delay: *delay,
                    dispose: if palette.clear { gif::DisposalMethod::Background } else { gif::DisposalMethod::Keep },
                    transparent: palette.clear.then_some(0),
                    palette: Some(palette.colors.clone()),
                    buffer: palette.indices(picture).into(),
                    ..gif::Frame::default()
                };
                encoder.write_frame(&frame).map_err(failed)
            }
        }
    }

    /// Ends the file.
    /// # Errors
    /// `Export` P003 if frames are missing or the sink fails.
    pub fn finish(self) -> Result<()> {
        match self.kind {
            ClipEncoder::Apng { writer, .. } => writer.finish().map_err(failed),
            ClipEncoder::Gif { encoder, .. } => encoder.into_inner().map_err(failed)?.flush().map_err(failed),
        }
    }
}

impl Palette {
    /// 255 colours that suit a picture, and index 0 for what is transparent.
    fn of(picture: &Picture) -> Self {
        let opaque: Vec<u8> =
            picture.pixels.iter().filter(|p| p[3] >= 128).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let samples = if opaque.is_empty() { vec![0, 0, 0, 255] } else { opaque };
        let tree = NeuQuant::new(3, 255, &samples);
        let mut colors = vec![0, 0, 0];
        colors.extend(tree.color_map_rgb());
        Self { tree, colors, clear: !picture.is_opaque() }
    }

    /// The nearest colours, a little noise of fixed pattern spreading what lies between them.
    fn indices(&self, picture: &Picture) -> Vec<u8> {
        const PATTERN: [i16; 16] = [-8, 0, -6, 2, 4, -4, 6, -2, -5, 3, -7, 1, 7, -1, 5, -3];
        let width = picture.width.max(1) as usize;
        let index = |(i, p): (usize, &[u8; 4])| {
            if p[3] < 128 {
                return 0;
            }
            let shift = PATTERN[(i / width % 4) * 4 + i % width % 4] / 2;
            let moved = |c: u8| u8::try_from((i16::from(c) + shift).clamp(0, 255)).unwrap_or(c);
            let nearest = self.tree.index_of(&[moved(p[0]), moved(p[1]), moved(p[2]), 255]);
            u8::try_from(nearest + 1).unwrap_or(u8::MAX)
        };
        picture.pixels.iter().enumerate().map(index).collect()
    }
}
