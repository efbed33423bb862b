//! Images of a scene as PNG, encoded once and shared by all exporters; and as JPEG.
//!
//! ```
//! use osier_export::textures::{png, unpng};
//! use osier_scene::{Image, ImageKind, Pixels};
//!
//! let pixels = Pixels::U8(vec![0, 64, 128, 255]);
//! let image = Image { name: "grey".into(), kind: ImageKind::Data, width: 2, height: 2, channels: 1, pixels };
//! assert!(matches!(unpng(&png(&image)?, 2, 1), Some(Pixels::U8(v)) if v == [0, 64, 128, 255]));
//! # Ok::<(), osier_base::Error>(())
//! ```

use std::sync::Arc;

use image::ImageEncoder as _;

use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Image, ImageKind, Pixels, Scene};

/// JPEG quality of colours, 1 to 100. Own: higher makes files larger without a visible difference.
const COLOR_QUALITY: u8 = 88;
/// JPEG quality of normals and roughness, in which compression blocks would show as facets.
const DATA_QUALITY: u8 = 92;

/// The scene's images as PNG files, in the order of [`Scene::images`].
#[derive(Debug, Clone, Default)]
pub struct Textures {
    png: Vec<Arc<[u8]>>,
}

impl Textures {
    /// Encodes all images of a scene as PNG, in parallel.
    /// # Errors
    /// X012 if an image has the wrong number of samples.
    pub fn encode(scene: &Scene) -> Result<Self> {
        let png = osier_base::par::par_map(&scene.images, png).into_iter().collect::<Result<Vec<_>>>()?;
        Ok(Self { png })
    }

    /// PNG file of the image at this index of [`Scene::images`]; panics at an index beyond them.
    pub fn png(&self, image: u32) -> &Arc<[u8]> {
        &self.png[image as usize]
    }

    /// Writes the images as `<prefix><name>.png`. Those that the folder has already are skipped, so that several exporters can
    /// call this.
    /// # Errors
    /// `Io`.
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

    /// PNG files of all images, in the order of [`Scene::images`].
    pub fn iter(&self) -> impl Iterator<Item = &Arc<[u8]>> {
        self.png.iter()
    }
}

/// Encodes an image as PNG with its channels and bit depth; colours are marked as sRGB, data are not.
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
    // The low bytes of 16-bit heights are mostly noise: a higher compression level is slower and makes files no smaller.
    let (effort, filter) = match image.pixels {
        Pixels::U8(_) => (2, png::Filter::Up),
        Pixels::U16(_) => (1, png::Filter::Paeth),
    };
    encoder.set_deflate_compression(png::DeflateCompression::Level(effort));
    encoder.set_filter(filter);
    // Only colours are encoded in sRGB; heights, normals and roughness are numbers, which readers must not decode.
    if image.kind == ImageKind::Color {
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    }
    encoder.add_text_chunk("Software".into(), super::GENERATOR.into()).map_err(|e| failed(&e))?;
    let data;
    let samples: &[u8] = match &image.pixels {
        Pixels::U8(v) => v,
        Pixels::U16(v) => {
            encoder.set_depth(png::BitDepth::Sixteen);
            // PNG stores 16-bit samples big endian.
            data = v.iter().map(|s| s.to_be()).collect::<Vec<u16>>();
            bytemuck::cast_slice(&data)
        }
    };
    let mut writer = encoder.write_header().map_err(|e| failed(&e))?;
    writer.write_image_data(samples).map_err(|e| failed(&e))?;
    writer.finish().map_err(|e| failed(&e))?;
    Ok(bytes.into())
}

/// An image as a JPEG file of 8 bits; `None` if it has an alpha channel, which JPEG lacks.
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

/// The samples of a PNG of `side` x `side` pixels: grey for 1 channel, RGB for 3, RGBA for others, as [`png()`] encodes them. `None`
/// if `bytes` are no PNG or one of another size, colour type or depth.
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
    // Only the two depths that `png` writes are accepted.
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
