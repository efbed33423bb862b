//! Maps as OpenEXR.
//!
//! - Height maps of materials, `maps/<material>/height.exr`: half floats, channel `Y`, height / range in [0, 1].
//! - Terrain, `maps/<name>/height.exr`: 32-bit floats, channel `Y`, metres.
//! - Fields of frames (deposition and the like), `maps/<what>/<field>.exr` with the values of the last frame, and
//!   `<field>.####.exr` if the scene asks for more.
//! - Map sequences, `maps/<sequence>/<layer>.####.exr` (`sequences.rs`), also packed into atlases on request (`atlas.rs`).
//! - The sky, `maps/sky.exr` (`sky.rs`).
//!
//! Files have scan lines in increasing order and ZIP16 compression: their bytes do not depend on the number of threads.
//!
//! ```
//! let bytes = osier_export::exr::floats(2, 1, 1, &[0.0, 1.0], "{}")?;
//! assert_eq!(bytes[..4], [0x76, 0x2f, 0x31, 0x01], "the magic number of OpenEXR");
//! # Ok::<(), osier_base::Error>(())
//! ```

mod atlas;
mod map_file;
pub(crate) mod options;
mod sequences;
mod sky;

use std::sync::Arc;

use exr::prelude::*;
use half::f16;

use self::sequences::SequenceWriter;
use super::estimate::EstimateInput;
use super::format::{FormatInfo, TextureUse};
use super::{Exporter, GENERATOR, Summary};
use osier_base::Error;
use osier_base::files::Folder;
use osier_scene::{Field, Frame, HeightField, MapSequence, Material, Pixels, Scene};

pub use atlas::{ATLAS, BORDER};
pub use options::ExrOptions;
pub use sky::{FILE as SKY_FILE, write as write_sky};

/// Kind of the file of a terrain's heights in the manifest.
pub(crate) const TERRAIN_KIND: &str = "exr.terrain";
/// Kind of the files of fields of frames in the manifest.
pub(crate) const FIELD_KIND: &str = "exr.field";

/// Registry entry of the maps as OpenEXR: images only, no geometry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "exr",
    about: "height maps of bark, leaves, ground and terrain, deposition maps, maps of wet leaves",
    folder: "maps",
    names_assets: false,
    notes_missing_files: true,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Read,
    memory_percent: 0,
    estimate,
    open: |job| vec![Box::new(ExrExporter::new(job.folder.clone(), job.options.exr))],
};

/// Estimate from bytes that were measured on leaves in rain, with one file per map and frame.
fn estimate(input: &EstimateInput) -> u64 {
    let options = input.options.exr;
    // Height and normal of a relief take 3.1 bytes per texel; atlases contain all maps a second time.
    let files = if options.atlas { 2 } else { 1 };
    let drops: u64 = input.scene.map_sequences.iter().map(estimate_drops).sum();
    let sequences = (drops + input.relief_texels() * 31 / 10) * input.frames.max(1) * files;
    // The floats of a terrain are hardly compressed: measured.
    let land = input.scene.land.as_ref().map_or(0, |land| land.heights.len() as u64);
    let catkins = input.assets.iter().map(|a| a.weight * a.free_instances).sum();
    let fields: u64 = input.scene.fields.iter().map(|field| estimate_field(field, catkins, input.frames)).sum();
    sequences + input.heights + land * 4 + fields
}

/// Bytes of the drops in the maps of one frame, measured on maps with sides of 128 to 1024 texels. Per channel, the
/// drops' margins take 12 bytes per texel of the side, their insides a hundredth of a byte per texel of the map.
fn estimate_drops(sequence: &MapSequence) -> u64 {
    let channels: u64 = sequence.layers.iter().map(|layer| layer.encoding.channels() as u64).sum();
    channels * (12 * sequence.side as u64 + sequence.texels() as u64 / 100)
}

/// Bytes of the files of a field. Own: measured on flights, a header of 700 bytes and two bytes for each texel with a
/// deposit; steep faces have few of these. `most`: largest number of objects that can be deposited in it.
fn estimate_field(field: &Field, most: u64, frames: u64) -> u64 {
    let texels = (field.width as u64).saturating_mul(field.height as u64);
    let is_steep = field.along.y.abs().max(field.down.y.abs()) > 0.5 * field.along.length().min(field.down.length());
    let filled = texels.min(most);
    let files = field.every.map_or(0, |every| frames.div_ceil(u64::from(every.max(1)))) + 1;
    files.saturating_mul(700 + if is_steep { filled / 2 } else { 2 * filled })
}

/// Writes height maps, terrain, fields and map sequences as EXR; [`write_sky`] writes the sky.
#[derive(Debug)]
pub struct ExrExporter {
    folder: Folder,
    scene: Option<Arc<Scene>>,
    /// Values of each field of the scene at the last frame that had some.
    last: Vec<Vec<f32>>,
    sequences: SequenceWriter,
}

impl ExrExporter {
    /// An exporter that writes into `maps/` and its subfolders below `folder`.
    pub fn new(folder: Folder, options: ExrOptions) -> Self {
        Self { folder, scene: None, last: Vec::new(), sequences: SequenceWriter::new(options) }
    }

    fn write_height_map(&self, scene: &Scene, material: &Material, image: u32) -> osier_base::Result<()> {
        let missing = || Error::export("X012", format!("material {}: picture {image} is missing", material.name));
        let picture = scene.images.get(image as usize).ok_or_else(missing)?;
        let path = format!("maps/{}/height.exr", material.name);
        let Some(mut out) = self.folder.create(&path, "exr.height", None)? else { return Ok(()) };
        // The first channel is the height; the others of a picture are skipped.
        let step = usize::from(picture.channels.max(1));
        let samples: Vec<f16> = match &picture.pixels {
            Pixels::U8(v) => v.iter().step_by(step).map(|s| f16::from_f32(f32::from(*s) / 255.0)).collect(),
            Pixels::U16(v) => v.iter().step_by(step).map(|s| f16::from_f32(f32::from(*s) / 65535.0)).collect(),
        };
        let comment = serde_json::json!({
            "map": "height", "leaf": material.name, "frame": scene.clip.start, "seed": scene.seed.to_string(),
            "scene": scene.hash, "unit": "m", "range": material.height_range,
        });
        let (width, height) = (picture.width as usize, picture.height as usize);
        out.put(&encode_f16(width, height, 1, samples, scene.clip.fps, &comment.to_string())?)?;
        out.commit()
    }

    /// Writes the heights of the terrain, m; row 0 is the edge at -z.
    fn write_terrain(&self, scene: &Scene, land: &HeightField) -> osier_base::Result<()> {
        let path = format!("maps/{}/height.exr", land.name);
        let Some(mut out) = self.folder.create(&path, TERRAIN_KIND, None)? else { return Ok(()) };
        let [min, max] = land.heights.iter().fold([f32::MAX, f32::MIN], |[lo, hi], h| [lo.min(*h), hi.max(*h)]);
        let comment = serde_json::json!({
            "map": "terrain", "seed": scene.seed.to_string(), "scene": scene.hash, "unit": "m",
            "size": land.size, "at": land.center, "min": min, "max": max,
        });
        let [width, height] = land.counts;
        out.put(&floats(width, height, 1, &land.heights, &comment.to_string())?)?;
        out.commit()
    }
}

impl Exporter for ExrExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> osier_base::Result<()> {
        for material in &scene.materials {
            if let Some(image) = material.maps.height {
                self.write_height_map(scene, material, image)?;
            }
        }
        if let Some(land) = &scene.land {
            self.write_terrain(scene, land)?;
        }
        self.sequences.begin(&self.folder, scene)?;
        self.scene = Some(Arc::clone(scene));
        self.last = vec![Vec::new(); scene.fields.len()];
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> osier_base::Result<()> {
        let Some(scene) = &self.scene else { return Ok(()) };
        for ((field, values), last) in scene.fields.iter().zip(&frame.fields).zip(&mut self.last) {
            let since = frame.number.saturating_sub(scene.clip.start);
            if field.every.is_some_and(|k| since.is_multiple_of(k.max(1))) {
                write_field(&self.folder, scene, field, values, Some(frame.number))?;
            }
            last.clone_from(values);
        }
        self.sequences.frame(&self.folder, scene, frame.number, Some(frame))
    }

    fn finish(&mut self) -> osier_base::Result<Summary> {
        let Some(scene) = &self.scene else { return Ok(Summary::default()) };
        for (field, values) in scene.fields.iter().zip(&self.last).filter(|(_, v)| !v.is_empty()) {
            write_field(&self.folder, scene, field, values, None)?;
        }
        self.sequences.finish(&self.folder, scene)
    }
}

/// Writes the values of a field at a frame; without a frame number, the last values, into a file without number.
fn write_field(
    folder: &Folder,
    scene: &Scene,
    field: &Field,
    values: &[f32],
    frame: Option<u32>,
) -> osier_base::Result<()> {
    let tag = frame.map_or_else(String::new, |n| format!(".{}", scene.clip.tag(n)));
    let path = format!("maps/{}/{}{tag}.exr", field.what, field.name);
    let Some(mut out) = folder.create(&path, FIELD_KIND, frame)? else { return Ok(()) };
    let comment = serde_json::json!({
        "map": field.what, "name": field.name, "seed": scene.seed.to_string(), "scene": scene.hash, "unit": field.unit,
        "texel_area_m2": field.texel_area(), "corner_m": field.corner.to_array(), "along_m": field.along.to_array(),
        "down_m": field.down.to_array(), "frame": frame,
    });
    out.put(&floats(field.width, field.height, 1, values, &comment.to_string())?)?;
    out.commit()
}

/// An EXR file of 32-bit floats: channel `Y`, or `R`, `G`, `B` for three values per pixel; rows from the top. `comment`: JSON for
/// the header.
/// # Errors
/// X012 if the number of samples does not fit.
pub fn floats(
    width: usize,
    height: usize,
    channels: usize,
    samples: &[f32],
    comment: &str,
) -> osier_base::Result<Vec<u8>> {
    let bad = |e: &dyn std::fmt::Display| Error::export("X012", format!("the picture cannot be encoded: {e}"));
    if samples.len() != width.saturating_mul(height).saturating_mul(channels) {
        return Err(bad(&"wrong number of samples"));
    }
    let names: &[&str] = if channels == 1 { &["Y"] } else { &["R", "G", "B"] };
    let plane = |c: usize| samples.iter().skip(c).step_by(channels.max(1)).copied().collect::<Vec<f32>>();
    let list = names.iter().enumerate().map(|(c, n)| AnyChannel::new(*n, FlatSamples::F32(plane(c)))).collect();
    let attributes = LayerAttributes {
        software_name: Some(GENERATOR.into()),
        comments: Text::new_or_none(comment),
        ..LayerAttributes::default()
    };
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((width, height), attributes, encoding, AnyChannels::sort(list));
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).map_err(|e| bad(&e))?;
    Ok(bytes.into_inner())
}

/// An EXR file of half floats: channel `Y`, or `R`, `G`, `B` for three values per pixel; rows from the top. `fps`: numerator and
/// denominator; `comment`: JSON for the header. There are no custom attributes: the crate writes those in no fixed order.
fn encode_f16(
    width: usize,
    height: usize,
    channels: usize,
    samples: Vec<f16>,
    fps: (u32, u32),
    comment: &str,
) -> osier_base::Result<Vec<u8>> {
    if samples.len() != width.saturating_mul(height).saturating_mul(channels) {
        return Err(Error::export("X012", "a map has the wrong number of samples"));
    }
    let list = if channels == 1 {
        std::iter::once(AnyChannel::new("Y", FlatSamples::F16(samples))).collect()
    } else {
        let plane = |c: usize| samples.iter().skip(c).step_by(channels).copied().collect::<Vec<f16>>();
        ["R", "G", "B"].iter().enumerate().map(|(c, n)| AnyChannel::new(*n, FlatSamples::F16(plane(c)))).collect()
    };
    let mut attributes = LayerAttributes {
        software_name: Some(GENERATOR.into()),
        comments: Text::new_or_none(comment),
        ..LayerAttributes::default()
    };
    attributes.frames_per_second = i32::try_from(fps.0).ok().map(|n| (n, fps.1));
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((width, height), attributes, encoding, AnyChannels::sort(list));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = Image::from_layer(layer).write().to_buffered(&mut bytes);
    written.map_err(|e| Error::export("X012", format!("a map cannot be encoded: {e}")))?;
    Ok(bytes.into_inner())
}
