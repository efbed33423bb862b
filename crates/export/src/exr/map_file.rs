//! The file of a map: encoded once, and written for every frame at which the map is the same.

use half::f16;

use super::encode_f16;
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{MapEncoding, MapLayer, Scene};

/// Name and height range for the header of a map.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapLabel<'a> {
    /// Name of the map sequence or atlas.
    pub(super) name: &'a str,
    /// Height for the value 1 of a height map, m.
    pub(super) height_range: f32,
}

/// An encoded map whose header names the frame: the comment is replaced for each frame, the rest stays.
#[derive(Debug)]
pub(super) struct FrameMapFile {
    bytes: Vec<u8>,
    /// Where the header's comment begins in `bytes`; its length is the same at all frames.
    comment_offset: usize,
    /// Name of the map sequence or atlas.
    name: String,
    /// Height for the value 1 of a height map, m.
    height_range: f32,
}

impl FrameMapFile {
    /// Encodes a square map of `side` texels a side. `samples`: 0 to 1, texel after texel.
    /// # Errors
    /// X012 for a wrong number of samples.
    pub(super) fn new(
        scene: &Scene,
        label: MapLabel<'_>,
        layer: MapLayer,
        side: usize,
        samples: &[f32],
    ) -> Result<Self> {
        let halves = samples.iter().map(|v| f16::from_f32(*v)).collect();
        let comment = comment(scene, label, layer, scene.clip.start);
        let bytes = encode_f16(side, side, layer.encoding.channels(), halves, scene.clip.fps, &comment)?;
        // The comment is an attribute of the header, which the file begins with, so the search ends early.
        let found = bytes.windows(comment.len()).position(|w| w == comment.as_bytes());
        let comment_offset = found.ok_or_else(|| Error::export("X012", "a map has lost its comment"))?;
        Ok(Self { bytes, comment_offset, name: label.name.to_owned(), height_range: label.height_range })
    }

    /// Writes the map to `path` with frame `number` in the header; does nothing if the journal lists the file as finished.
    pub(super) fn write(&self, folder: &Folder, scene: &Scene, path: &str, layer: MapLayer, number: u32) -> Result<()> {
        let Some(mut out) = folder.create(path, layer.file_kind, Some(number))? else { return Ok(()) };
        let label = MapLabel { name: &self.name, height_range: self.height_range };
        let comment = comment(scene, label, layer, number);
        // The new comment has the length of the old one, so that all offsets in the file stay valid.
        let (head, tail) = self.bytes.split_at(self.comment_offset);
        out.put(head)?;
        out.put(comment.as_bytes())?;
        out.put(tail.get(comment.len()..).unwrap_or_default())?;
        out.commit()
    }
}

/// The comment of a map's header as JSON, padded with spaces to the same length at all frames, so that it can be replaced.
fn comment(scene: &Scene, label: MapLabel<'_>, layer: MapLayer, number: u32) -> String {
    let (unit, range) = match layer.encoding {
        MapEncoding::Height | MapEncoding::Thickness => ("m", serde_json::json!(label.height_range)),
        MapEncoding::Unit => ("0..1", serde_json::Value::Null),
        MapEncoding::Normal => ("0.5 n + 0.5", serde_json::Value::Null),
    };
    let text = |number: u32| {
        serde_json::json!({
            "map": layer.name, "leaf": label.name, "frame": number, "seed": scene.seed.to_string(), "scene": scene.hash,
            "unit": unit, "range": range,
        })
        .to_string()
    };
    // The last frame's number has the most digits.
    let longest = text(scene.clip.end).len();
    format!("{:longest$}", text(number))
}
