//! Wet sheets: 16-bit grey pictures of wetness and height beside the EXR maps, and the texture that a frame gives a leaf.

use super::material::quoted;
use crate::Warning;
use crate::sheets::{Keeper, Kept, Map, Values};
use crate::text::Text;
use crate::textures;
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{Frame, Image, ImageKind, Pixels, Scene, Wet};

/// Writes the pictures.
#[derive(Debug)]
pub(super) struct Sheets {
    keeper: Keeper<Arc>,
}

/// Bytes of a picture.
type Arc = std::sync::Arc<[u8]>;

impl Sheets {
    pub(super) fn new() -> Self {
        Self { keeper: Keeper::new(vec![Map::Wetness, Map::Height]) }
    }

    /// Writes a frame's pictures into `maps`, a folder with its `/`, and declares the textures of the leaves that are wet.
    pub(super) fn frame(
        &mut self,
        text: &mut Text,
        folder: &Folder,
        maps: &str,
        scene: &Scene,
        number: u32,
        frame: Option<&Frame>,
    ) -> Result<()> {
        let kept = self.keeper.frame(&scene.wet, number, scene.wet_now(frame), grey)?;
        for Kept { sheet, map, file, .. } in &kept {
            let path = format!("{maps}{}/{}.{}.png", scene.wet[*sheet].name, map.word(), scene.clip.tag(number));
            if let Some(mut out) = folder.create(&path, "png", Some(number))? {
                out.put(file)?;
                out.commit()?;
            }
            for (i, _) in (0_u32..).zip(&scene.materials).filter(|(_, m)| *map == Map::Wetness && wears(m, *sheet)) {
                text.put("#declare M_").int(i).put(" = texture { uv_mapping image_pattern { png ").put(&quoted(&path));
                text.put(" interpolate 2 } texture_map { [0 D_").int(i).put("] [1 W_").int(i).put("] } }\n");
            }
        }
        Ok(())
    }

    /// What was cut.
    pub(super) fn warning(&self, scene: &Scene) -> Option<Warning> {
        self.keeper.warning(&scene.wet, "png")
    }
}

fn wears(material: &osier_scene::Material, sheet: usize) -> bool {
    material.wet.is_some_and(|w| w as usize == sheet)
}

/// A map as a picture of 16 bits: POV-Ray takes 2 bytes a texel for it, and 20 for an EXR file.
fn grey(sheet: &Wet, map: Map, values: &Values) -> Result<Arc> {
    let side = u32::try_from(sheet.side).unwrap_or(u32::MAX);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..1")]
    let pixels = values.samples.iter().map(|v| (v * 65535.0 + 0.5) as u16).collect();
    let name = format!("{}, {}", sheet.name, map.word());
    textures::png(&Image {
        name,
        kind: ImageKind::Data,
        width: side,
        height: side,
        channels: 1,
        pixels: Pixels::U16(pixels),
    })
}
