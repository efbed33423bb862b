//! Map sequences: 16-bit grey pictures of weights and heights, and the texture that a frame gives a coated material.

use super::material::string_literal;
use crate::Warning;
use crate::map_sequences::{EncodedMap, MapEncoder, Values};
use crate::text::TextBuffer;
use crate::textures;
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{Frame, Image, ImageKind, MapEncoding, MapLayer, MapSequence, Material, Pixels, Scene};

/// Writes the maps of coats as pictures, and declares the textures of a frame that refer to them.
#[derive(Debug)]
pub(super) struct CoatWriter {
    encoder: MapEncoder<Arc>,
}

/// Bytes of an encoded picture, shared by the frames at which it is the same.
type Arc = std::sync::Arc<[u8]>;

impl CoatWriter {
    pub(super) fn new() -> Self {
        // Weights come first. POV-Ray uses neither normals, nor the thickness of a coat in addition to its height.
        let select = |sequence: &MapSequence| {
            let encoded = |wanted| (0..sequence.layers.len()).filter(move |i| sequence.layers[*i].encoding == wanted);
            encoded(MapEncoding::Unit).chain(encoded(MapEncoding::Height)).collect()
        };
        Self { encoder: MapEncoder::new(select) }
    }

    /// Writes a frame's pictures into `maps`, a folder with its `/`, and declares the textures of coated materials.
    pub(super) fn frame(
        &mut self,
        text: &mut TextBuffer,
        folder: &Folder,
        maps: &str,
        scene: &Scene,
        number: u32,
        frame: Option<&Frame>,
    ) -> Result<()> {
        let encoded = self.encoder.frame(&scene.map_sequences, number, scene.maps_at(frame), grey)?;
        for EncodedMap { sequence, layer, file, .. } in &encoded {
            let name = &scene.map_sequences[*sequence].name;
            let path = format!("{maps}{name}/{}.{}.png", layer.name, scene.clip.tag(number));
            if let Some(mut out) = folder.create(&path, "png", Some(number))? {
                out.put(file)?;
                out.commit()?;
            }
            // Each material whose weight this map is mixes its bare and its coated texture by the value of the map, 0 to 1.
            for (i, _) in (0_u32..).zip(&scene.materials).filter(|(_, m)| is_weight(m, *sequence, *layer)) {
                text.put("#declare M_")
                    .int(i)
                    .put(" = texture { uv_mapping image_pattern { png ")
                    .put(&string_literal(&path));
                text.put(" interpolate 2 } texture_map { [0 D_").int(i).put("] [1 W_").int(i).put("] } }\n");
            }
        }
        Ok(())
    }

    /// X007 if values were clamped.
    pub(super) fn warning(&self, scene: &Scene) -> Option<Warning> {
        self.encoder.warning(&scene.map_sequences, "png")
    }
}

/// Whether a layer is the weight of a material's coat.
fn is_weight(material: &Material, sequence: usize, layer: MapLayer) -> bool {
    material.coat.is_some_and(|c| c.sequence as usize == sequence && c.weight == layer.name)
}

/// A map as a 16-bit PNG: in memory POV-Ray takes 2 bytes a texel for it, and 20 for an EXR file.
fn grey(sequence: &MapSequence, layer: MapLayer, values: &Values) -> Result<Arc> {
    let side = osier_base::convert::index(sequence.side, "texels of a map's side")?;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..1")]
    // Quantized to round(65535 v); the casts cannot overflow, as the values are clamped to 0..1.
    let pixels = values.samples.iter().map(|v| (v * 65535.0 + 0.5) as u16).collect();
    let name = format!("{}, {}", sequence.name, layer.name);
    textures::png(&Image {
        name,
        kind: ImageKind::Data,
        width: side,
        height: side,
        channels: 1,
        pixels: Pixels::U16(pixels),
    })
}
