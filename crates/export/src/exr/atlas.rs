//! The maps of all map sequences packed into atlases: `maps/atlas_00/<layer>.####.exr`, and `maps/atlas.json` with the place of
//! each sequence.

use super::sequences::{MapLabel, Stamped};
use crate::map_sequences::{EncodedMap, values};
use osier_base::files::Folder;
use osier_base::{Error, Result};
use osier_scene::{Frame, MapLayer, MapSequence, Scene};

/// Texels of a side of an atlas.
pub const ATLAS: usize = 4096;
/// Texels around a tile that repeat its edge, so that looking between texels finds nothing of its neighbours.
pub const BORDER: usize = 2;

/// Atlases being written.
#[derive(Debug, Default)]
pub(super) struct Atlas {
    /// Tiles in a row, and of how many texels with their borders.
    row: usize,
    pitch: usize,
    /// What was last encoded, by atlas and map.
    made: Vec<(usize, MapLayer, Stamped)>,
}

/// Where a tile lies: its atlas, and the texel of its upper left corner, without the border.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    atlas: usize,
    corner: [usize; 2],
}

impl Atlas {
    fn place(&self, sequence: usize) -> Place {
        let row = self.row.max(1);
        let (atlas, tile) = (sequence / (row * row), sequence % (row * row));
        Place { atlas, corner: [tile % row, tile / row].map(|k| k * self.pitch + BORDER) }
    }

    /// Gives each sequence a tile and writes `atlas.json`.
    /// # Errors
    /// X012 if the maps of a sequence are larger than an atlas.
    pub(super) fn begin(&mut self, folder: &Folder, scene: &Scene) -> Result<()> {
        let side = scene.map_sequences.iter().map(|s| s.side).max().unwrap_or(0);
        self.pitch = side + 2 * BORDER;
        self.row = ATLAS / self.pitch;
        if self.row == 0 {
            return Err(Error::export("X012", format!("a map of {side} texels a side is larger than an atlas")));
        }
        #[allow(clippy::cast_precision_loss, reason = "texels of an atlas")]
        let share = |texels: usize| texels as f64 / ATLAS as f64;
        let entry = |(i, sequence): (usize, &MapSequence)| {
            let Place { atlas, corner: [x, y] } = self.place(i);
            serde_json::json!({
                "leaf": sequence.name, "atlas": name(atlas), "scale": [share(sequence.side), share(sequence.side)],
                "offset": [share(x), share(ATLAS - y - sequence.side)],
            })
        };
        let sheets: Vec<serde_json::Value> = scene.map_sequences.iter().enumerate().map(entry).collect();
        let text = serde_json::json!({ "side": ATLAS, "border": BORDER, "sheets": sheets });
        folder.write("maps/atlas.json", "json", format!("{text:#}\n").as_bytes())
    }

    /// Writes a frame; `maps`: the files of the sequences' own maps.
    pub(super) fn frame(
        &mut self,
        folder: &Folder,
        scene: &Scene,
        number: u32,
        frame: Option<&Frame>,
        maps: &[EncodedMap<Stamped>],
    ) -> Result<()> {
        let mut wanted: Vec<(usize, MapLayer, bool)> = Vec::new();
        for k in maps {
            let atlas = self.place(k.sequence).atlas;
            match wanted.iter_mut().find(|(a, m, _)| (*a, *m) == (atlas, k.layer)) {
                Some((_, _, fresh)) => *fresh |= k.fresh,
                None => wanted.push((atlas, k.layer, k.fresh)),
            }
        }
        for (atlas, layer, fresh) in wanted {
            if fresh {
                let file = self.encode(scene, number, frame, atlas, layer)?;
                self.made.retain(|(a, m, _)| (*a, *m) != (atlas, layer));
                self.made.push((atlas, layer, file));
            }
            let Some((.., file)) = self.made.iter().find(|(a, m, _)| (*a, *m) == (atlas, layer)) else { continue };
            let path = format!("maps/{}/{}.{}.exr", name(atlas), layer.name, scene.clip.tag(number));
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
    ) -> Result<Stamped> {
        let channels = layer.encoding.channels();
        let mut all = vec![0.0; ATLAS * ATLAS * channels];
        for ((i, sequence), maps) in scene.map_sequences.iter().enumerate().zip(scene.maps_at(frame)) {
            let place = self.place(i);
            let maps = maps.filter(|_| place.atlas == atlas);
            if let Some((maps, layer)) = maps.zip(sequence.layer(layer.name)) {
                let own = values(sequence, layer, &maps, number)?.samples;
                tile(&mut all, place.corner, &own, sequence.side, channels);
            }
        }
        let range = scene.map_sequences.first().map_or(0.0, |s| s.height_range);
        Stamped::new(scene, MapLabel { name: &name(atlas), height_range: range }, layer, ATLAS, &all)
    }
}

/// Lays a tile and its border down.
fn tile(all: &mut [f32], corner: [usize; 2], own: &[f32], side: usize, channels: usize) {
    for y in 0..side + 2 * BORDER {
        let from = y.saturating_sub(BORDER).min(side - 1);
        let row = &own[from * side * channels..][..side * channels];
        let at = ((corner[1] + y - BORDER) * ATLAS + corner[0]) * channels;
        all[at..at + row.len()].copy_from_slice(row);
        for k in 0..BORDER * channels {
            all[at - BORDER * channels + k] = row[k % channels];
            all[at + row.len() + k] = row[row.len() - channels + k % channels];
        }
    }
}

fn name(atlas: usize) -> String {
    format!("atlas_{atlas:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_lie_apart_and_repeat_their_edges() {
        let atlas = Atlas { row: ATLAS / 516, pitch: 516, made: Vec::new() };
        assert_eq!(atlas.place(0), Place { atlas: 0, corner: [2, 2] });
        assert_eq!(atlas.place(8), Place { atlas: 0, corner: [518, 518] });
        assert_eq!(atlas.place(49), Place { atlas: 1, corner: [2, 2] });
        let mut all = vec![0.0; ATLAS * ATLAS];
        tile(&mut all, [518, 2], &[1.0, 2.0, 3.0, 4.0], 2, 1);
        let row = |y: usize| &all[y * ATLAS + 515..][..8];
        assert_eq!(row(0), [0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0]);
        assert_eq!(row(2), row(0));
        assert_eq!(row(5), [0.0, 3.0, 3.0, 3.0, 4.0, 4.0, 4.0, 0.0]);
        assert!(row(6).iter().all(|v| *v == 0.0));
    }
}
