//! Maps of map sequences: `maps/<sequence>/<layer>.####.exr`, half floats; `Y`, or `R`, `G`, `B` for normals.

use half::f16;

use super::atlas::Atlas;
use super::{ExrOptions, encode};
use crate::map_sequences::{EncodedMap, MapEncoder, Values};
use crate::{Summary, Warning};
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Frame, MapEncoding, MapLayer, MapSequence, Scene};

/// Writes the maps of a scene's map sequences.
#[derive(Debug)]
pub(super) struct SequenceWriter {
    encoder: MapEncoder<Stamped>,
    atlas: Option<Atlas>,
    /// Frames so far.
    frames: usize,
}

impl SequenceWriter {
    pub(super) fn new(options: ExrOptions) -> Self {
        let all = |sequence: &MapSequence| (0..sequence.layers.len()).collect();
        Self { encoder: MapEncoder::new(all), atlas: options.atlas.then(Atlas::default), frames: 0 }
    }

    /// Writes where each sequence lies on the atlases, if there are any.
    pub(super) fn begin(&mut self, folder: &Folder, scene: &Scene) -> Result<()> {
        match &mut self.atlas {
            Some(atlas) if !scene.map_sequences.is_empty() => atlas.begin(folder, scene),
            _ => Ok(()),
        }
    }

    /// Writes a frame's maps; `frame`: none for those at rest.
    pub(super) fn frame(&mut self, folder: &Folder, scene: &Scene, number: u32, frame: Option<&Frame>) -> Result<()> {
        if scene.map_sequences.is_empty() {
            return Ok(());
        }
        self.frames += 1;
        let encode = |sequence: &MapSequence, layer: MapLayer, values: &Values| {
            let label = MapLabel { name: &sequence.name, height_range: sequence.height_range };
            Stamped::new(scene, label, layer, sequence.side, &values.samples)
        };
        let maps = self.encoder.frame(&scene.map_sequences, number, scene.maps_at(frame), encode)?;
        for EncodedMap { sequence, layer, file, .. } in &maps {
            let name = &scene.map_sequences[*sequence].name;
            let path = format!("maps/{name}/{}.{}.exr", layer.name, scene.clip.tag(number));
            file.write(folder, scene, &path, *layer, number)?;
        }
        match &mut self.atlas {
            Some(atlas) => atlas.frame(folder, scene, number, frame, &maps),
            None => Ok(()),
        }
    }

    /// Writes the maps at rest if no frame came.
    pub(super) fn finish(&mut self, folder: &Folder, scene: &Scene) -> Result<Summary> {
        if self.frames == 0 {
            self.frame(folder, scene, scene.clip.start, None)?;
        }
        let warnings: Vec<Warning> = self.encoder.warning(&scene.map_sequences, "exr").into_iter().collect();
        Ok(Summary { warnings })
    }
}

/// What the header of a map says of the sequence or atlas that it shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapLabel<'a> {
    /// Name of the sequence or atlas.
    pub(super) name: &'a str,
    /// Height that the value 1 stands for, m.
    pub(super) height_range: f32,
}

/// A file in which the number of its frame can be changed: the rest is encoded once for all frames that show it.
#[derive(Debug)]
pub(super) struct Stamped {
    bytes: Vec<u8>,
    /// Where its comment stands.
    at: usize,
    /// Name of the sequence or atlas.
    name: String,
    /// Height that the value 1 stands for, m.
    height_range: f32,
}

impl Stamped {
    /// Encodes a square map of `side` texels a side. `samples`: 0..1.
    pub(super) fn new(
        scene: &Scene,
        label: MapLabel<'_>,
        layer: MapLayer,
        side: usize,
        samples: &[f32],
    ) -> Result<Self> {
        let halves = samples.iter().map(|v| f16::from_f32(*v)).collect();
        let comment = comment(scene, label, layer, scene.clip.start);
        let bytes = encode((side, side), layer.encoding.channels(), halves, (scene.clip.fps, &comment))?;
        // The header comes first, so this finds it at once.
        let found = bytes.windows(comment.len()).position(|w| w == comment.as_bytes());
        let at = found.ok_or_else(|| Error::export("X012", "a map has lost its comment"))?;
        Ok(Self { bytes, at, name: label.name.to_owned(), height_range: label.height_range })
    }

    /// Writes it as the file of a frame.
    pub(super) fn write(&self, folder: &Folder, scene: &Scene, path: &str, layer: MapLayer, number: u32) -> Result<()> {
        let Some(mut out) = folder.create(path, layer.file_kind, Some(number))? else { return Ok(()) };
        let label = MapLabel { name: &self.name, height_range: self.height_range };
        let comment = comment(scene, label, layer, number);
        let (head, tail) = self.bytes.split_at(self.at);
        out.put(head)?;
        out.put(comment.as_bytes())?;
        out.put(tail.get(comment.len()..).unwrap_or_default())?;
        out.commit()
    }
}

/// What a map's header says: of one length at all frames.
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
    let longest = text(scene.clip.end).len();
    format!("{:longest$}", text(number))
}
