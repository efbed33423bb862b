//! The maps of all map sequences packed into atlases: `maps/atlas_00/<layer>.####.exr`, and `maps/atlas.json` with the place of
//! each sequence.

use super::map_file::{FrameMapFile, MapLabel};
use crate::map_sequences::{EncodedMap, values};
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Frame, MapLayer, MapSequence, Scene};

/// Side of an atlas, texels: small enough for the textures of current GPUs (at least 16384) and one file per frame of moderate
/// size.
pub const ATLAS: usize = 4096;
/// Width, texels, of the border around a tile that repeats its edge, so that bilinear filtering does not mix in the
/// neighbours.
pub const BORDER: usize = 2;

/// Packs the maps of all map sequences into square images of [`ATLAS`] texels a side, one per layer.
#[derive(Debug, Default)]
pub(super) struct AtlasWriter {
    /// Tiles in a row of an atlas.
    row: usize,
    /// Side of a tile with its borders, texels.
    pitch: usize,
    /// The latest file of each layer of each atlas, written again for frames at which none of its maps has changed.
    encoded: Vec<(usize, MapLayer, FrameMapFile)>,
}

/// The position of a tile: its atlas, and the texel of its upper left corner, without the border.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct TilePosition {
    atlas: usize,
    corner: [usize; 2],
}

impl AtlasWriter {
    fn tile_position(&self, sequence: usize) -> TilePosition {
        let row = self.row.max(1);
        // row^2 tiles to an atlas, filled row by row from the top.
        let (atlas, tile) = (sequence / (row * row), sequence % (row * row));
        TilePosition { atlas, corner: [tile % row, tile / row].map(|k| k * self.pitch + BORDER) }
    }

    /// Computes the size of the tiles from the largest map, and writes `atlas.json`.
    /// # Errors
    /// X012 if the maps of a sequence are larger than an atlas.
    pub(super) fn begin(&mut self, folder: &Folder, scene: &Scene) -> Result<()> {
        let side = scene.map_sequences.iter().map(|s| s.side).max().unwrap_or(0);
        // All tiles have the size of the largest map, so that the position of a tile follows from the number of its sequence.
        self.pitch = side + 2 * BORDER;
        self.row = ATLAS / self.pitch;
        if self.row == 0 {
            return Err(Error::export("X012", format!("a map of {side} texels a side is larger than an atlas")));
        }
        #[allow(clippy::cast_precision_loss, reason = "texels of an atlas")]
        let share = |texels: usize| texels as f64 / ATLAS as f64;
        let entry = |(i, sequence): (usize, &MapSequence)| {
            let TilePosition { atlas, corner: [x, y] } = self.tile_position(i);
            serde_json::json!({
                "leaf": sequence.name, "atlas": atlas_name(atlas), "scale": [share(sequence.side), share(sequence.side)],
                // Offsets count from the lower left corner, as texture coordinates do; rows of the atlas count from the
                // top.
                "offset": [share(x), share(ATLAS - y - sequence.side)],
            })
        };
        let sheets: Vec<serde_json::Value> = scene.map_sequences.iter().enumerate().map(entry).collect();
        let text = serde_json::json!({ "side": ATLAS, "border": BORDER, "sheets": sheets });
        folder.write("maps/atlas.json", "json", format!("{text:#}\n").as_bytes())
    }

    /// Writes the atlases of a frame. `maps`: the maps of all sequences at this frame, and whether each has changed.
    pub(super) fn frame(
        &mut self,
        folder: &Folder,
        scene: &Scene,
        number: u32,
        frame: Option<&Frame>,
        maps: &[EncodedMap<FrameMapFile>],
    ) -> Result<()> {
        // A map of an atlas is encoded again if the map of one of its sequences has changed.
        let mut files: Vec<(usize, MapLayer, bool)> = Vec::new();
        for k in maps {
            let atlas = self.tile_position(k.sequence).atlas;
            match files.iter_mut().find(|(a, m, _)| (*a, *m) == (atlas, k.layer)) {
                Some((_, _, fresh)) => *fresh |= k.fresh,
                None => files.push((atlas, k.layer, k.fresh)),
            }
        }
        for (atlas, layer, fresh) in files {
            if fresh {
                let file = self.encode(scene, number, frame, atlas, layer)?;
                self.encoded.retain(|(a, m, _)| (*a, *m) != (atlas, layer));
                self.encoded.push((atlas, layer, file));
            }
            let Some((.., file)) = self.encoded.iter().find(|(a, m, _)| (*a, *m) == (atlas, layer)) else { continue };
            let path = format!("maps/{}/{}.{}.exr", atlas_name(atlas), layer.name, scene.clip.tag(number));
            file.write(folder, scene, &path, layer, number)?;
        }
        Ok(())
    }

    fn encode(
        &self,
        scene: &Scene,
        number: u32,
        frame: Option<&Frame>,
        atlas: usize,
        layer: MapLayer,
    ) -> Result<FrameMapFile> {
        let channels = layer.encoding.channels();
        // Texels that belong to no tile stay 0.
        let mut all = vec![0.0; ATLAS * ATLAS * channels];
        for ((i, sequence), maps) in scene.map_sequences.iter().enumerate().zip(scene.maps_at(frame)) {
            let position = self.tile_position(i);
            let maps = maps.filter(|_| position.atlas == atlas);
            if let Some((maps, layer)) = maps.zip(sequence.layer(layer.name)) {
                let samples = values(sequence, layer, &maps, number)?.samples;
                copy_tile(&mut all, position.corner, &samples, sequence.side, channels);
            }
        }
        let range = scene.map_sequences.first().map_or(0.0, |s| s.height_range);
        FrameMapFile::new(scene, MapLabel { name: &atlas_name(atlas), height_range: range }, layer, ATLAS, &all)
    }
}

/// Copies a tile into an atlas, with a border that repeats its first and last rows and columns.
fn copy_tile(all: &mut [f32], corner: [usize; 2], samples: &[f32], side: usize, channels: usize) {
    for y in 0..side + 2 * BORDER {
        // Row of the tile that is repeated: the first one above it, the last one below.
        let from = y.saturating_sub(BORDER).min(side - 1);
        let row = &samples[from * side * channels..][..side * channels];
        let at = ((corner[1] + y - BORDER) * ATLAS + corner[0]) * channels;
        all[at..at + row.len()].copy_from_slice(row);
        // To the left the first texel of the row, to the right the last, channel by channel.
        for k in 0..BORDER * channels {
            all[at - BORDER * channels + k] = row[k % channels];
            all[at + row.len() + k] = row[row.len() - channels + k % channels];
        }
    }
}

fn atlas_name(atlas: usize) -> String {
    format!("atlas_{atlas:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_lie_apart_and_repeat_their_edges() {
        let atlas = AtlasWriter { row: ATLAS / 516, pitch: 516, encoded: Vec::new() };
        assert_eq!(atlas.tile_position(0), TilePosition { atlas: 0, corner: [2, 2] });
        assert_eq!(atlas.tile_position(8), TilePosition { atlas: 0, corner: [518, 518] });
        assert_eq!(atlas.tile_position(49), TilePosition { atlas: 1, corner: [2, 2] });
        let mut all = vec![0.0; ATLAS * ATLAS];
        copy_tile(&mut all, [518, 2], &[1.0, 2.0, 3.0, 4.0], 2, 1);
        let row = |y: usize| &all[y * ATLAS + 515..][..8];
        assert_eq!(row(0), [0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0]);
        assert_eq!(row(2), row(0));
        assert_eq!(row(5), [0.0, 3.0, 3.0, 3.0, 4.0, 4.0, 4.0, 0.0]);
        assert!(row(6).iter().all(|v| *v == 0.0));
    }
}
