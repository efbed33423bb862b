//! Pictures of a scene as PNG bytes, encoded once and shared by every exporter.

use std::sync::Arc;

use image::ImageEncoder as _;

use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Image, ImageKind, Pixels, Scene};

/// JPEG quality of colours, and of normals and roughness, in which blocks would show as facets.
const COLOR_QUALITY: u8 = 88;
const DATA_QUALITY: u8 = 92;

/// The scene's pictures as PNG files, in the order of [`Scene::images`].
#[derive(Debug, Clone, Default)]
pub struct Textures {
    png: Vec<Arc<[u8]>>,
}

impl Textures {
    /// Encodes all pictures, in parallel.
    /// # Errors
    /// X012 if a picture has the wrong number of samples.
    pub fn encode(scene: &Scene) -> Result<Self> {
        let png = osier_base::par::par_map(&scene.images, png).into_iter().collect::<Result<Vec<_>>>()?;
        Ok(Self { png })
    }

    /// PNG bytes of a picture.
    pub fn png(&self, image: u32) -> &Arc<[u8]> {
        &self.png[image as usize]
    }

    /// Writes the pictures as `<prefix><name>.png`; those that the folder already lists are left alone, so several
    /// exporters may ask for them.
    /// # Errors
    /// Whatever cannot be written.
    pub fn write(&self, scene: &Scene, folder: &Folder, prefix: &str) -> Result<()> {
        let done: std::collections::BTreeSet<String> = folder.files().into_iter().map(|f| f.path).collect();
        for (image, png) in scene.images.iter().zip(&self.png) {
            let path = format!("{prefix}{}.png", image.name);
            if !done.contains(&path) {
                folder.write(&path, "png", png)?;
            }
        }
        Ok(())
    }

    /// All of them, in order.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<[u8]>> {
        self.png.iter()
    }
}

/// One picture as a PNG file.
/// # Errors
/// X012 if it has the wrong number of samples.
pub fn png(image: &Image) -> Result<Arc<[u8]>> {
    let failed = |e: &dyn std::fmt::Display| Error::export("X012", format!("picture {}: {e}", image.name));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width, image.height);
    encoder.set_color(match image.channels {
        1 => png::ColorType::Grayscale,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    });
    // Sixteen bits of relief are mostly noise: more effort makes such files no smaller, only slower.
    let (effort, filter) = match image.pixels {
        Pixels::U8(_) => (2, png::Filter::Up),
        Pixels::U16(_) => (1, png::Filter::Paeth),
    };
    encoder.set_deflate_compression(png::DeflateCompression::Level(effort));
    encoder.set_filter(filter);
    if image.kind == ImageKind::Color {
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    }
    encoder.add_text_chunk("Software".into(), super::GENERATOR.into()).map_err(|e| failed(&e))?;
    let data;
    let samples: &[u8] = match &image.pixels {
        Pixels::U8(v) => v,
        Pixels::U16(v) => {
            encoder.set_depth(png::BitDepth::Sixteen);
            data = v.iter().map(|s| s.to_be()).collect::<Vec<u16>>();
            bytemuck::cast_slice(&data)
        }
    };
    let mut writer = encoder.write_header().map_err(|e| failed(&e))?;
    writer.write_image_data(samples).map_err(|e| failed(&e))?;
    writer.finish().map_err(|e| failed(&e))?;
    Ok(bytes.into())
}

/// One picture as a JPEG file, for readers that decode pictures to 8 bits anyway; `None` with an alpha channel, which JPEG lacks.
/// # Errors
/// X012 if it has the wrong number of samples.
pub fn jpeg(image: &Image) -> Result<Option<Vec<u8>>> {
    let color = match image.channels {
        1 => image::ExtendedColorType::L8,
        3 => image::ExtendedColorType::Rgb8,
        _ => return Ok(None),
    };
    let quality = if image.kind == ImageKind::Color { COLOR_QUALITY } else { DATA_QUALITY };
    let narrowed: Vec<u8>;
    let samples: &[u8] = match &image.pixels {
        Pixels::U8(v) => v,
        Pixels::U16(v) => {
            narrowed = v.iter().map(|s| osier_base::units::byte(f32::from(*s) / 65_535.0)).collect();
            &narrowed
        }
    };
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality);
    let written = encoder.write_image(samples, image.width, image.height, color);
    written.map_err(|e| Error::export("X012", format!("picture {}: {e}", image.name)))?;
    Ok(Some(bytes))
}

/// The samples of a square picture that [`png()`] has written; `None` for any other.
pub fn unpng(bytes: &[u8], side: u32, channels: u8) -> Option<Pixels> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().ok()?;
    let info = reader.info();
    let color = match channels {
        1 => png::ColorType::Grayscale,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    };
    if (info.width, info.height, info.color_type) != (side, side, color) {
        return None;
    }
    let deep = info.bit_depth == png::BitDepth::Sixteen;
    if !deep && info.bit_depth != png::BitDepth::Eight {
        return None;
    }
    let mut samples = vec![0; reader.output_buffer_size()?];
    reader.next_frame(&mut samples).ok()?;
    Some(if deep {
        Pixels::U16(samples.as_chunks().0.iter().map(|b| u16::from_be_bytes(*b)).collect())
    } else {
        Pixels::U8(samples)
    })
}
