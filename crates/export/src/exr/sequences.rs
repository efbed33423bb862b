//! Maps of map sequences: `maps/<sequence>/<layer>.####.exr`, half floats; `Y`, or `R`, `G`, `B` for normals.

use super::ExrOptions;
use super::atlas::AtlasWriter;
use super::map_file::{FrameMapFile, MapLabel};
use crate::map_sequences::{EncodedMap, MapEncoder, Values};
use crate::{Summary, Warning};
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{Frame, MapLayer, MapSequence, Scene};

/// Writes one file per layer of each map sequence and frame, and the atlases if they were requested.
#[derive(Debug)]
pub(super) struct SequenceWriter {
    encoder: MapEncoder<FrameMapFile>,
    atlas: Option<AtlasWriter>,
    /// Number of frames written so far; if it is 0 at the end, the maps at rest are written.
    frames: usize,
}

impl SequenceWriter {
    pub(super) fn new(options: ExrOptions) -> Self {
        let all = |sequence: &MapSequence| (0..sequence.layers.len()).collect();
        Self { encoder: MapEncoder::new(all), atlas: options.atlas.then(AtlasWriter::default), frames: 0 }
    }

    /// Writes `atlas.json` if atlases were requested and the scene has map sequences.
    pub(super) fn begin(&mut self, folder: &Folder, scene: &Scene) -> Result<()> {
        match &mut self.atlas {
            Some(atlas) if !scene.map_sequences.is_empty() => atlas.begin(folder, scene),
            _ => Ok(()),
        }
    }

    /// Writes the maps as frame `number`; without `frame`, the maps at rest.
    pub(super) fn frame(&mut self, folder: &Folder, scene: &Scene, number: u32, frame: Option<&Frame>) -> Result<()> {
        if scene.map_sequences.is_empty() {
            return Ok(());
        }
        self.frames += 1;
        let encode = |sequence: &MapSequence, layer: MapLayer, values: &Values| {
            let label = MapLabel { name: &sequence.name, height_range: sequence.height_range };
            FrameMapFile::new(scene, label, layer, sequence.side, &values.samples)
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

    /// Writes the maps at rest if there was no frame; returns the warnings of the encoder.
    pub(super) fn finish(&mut self, folder: &Folder, scene: &Scene) -> Result<Summary> {
        if self.frames == 0 {
            self.frame(folder, scene, scene.clip.start, None)?;
        }
        let warnings: Vec<Warning> = self.encoder.warning(&scene.map_sequences, "exr").into_iter().collect();
        Ok(Summary { warnings })
    }
}
