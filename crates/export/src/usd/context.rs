//! What the writers of all prims share: the scene, the options, and the paths of files beside the layers.

use std::sync::Arc;

use super::Tolerance;
use super::axis::UpAxis;
use super::layer_writer::AttrHandle;
use crate::sheets::Map;
use osier_scene::{Material, Scene};

/// The scene and the options that hold for all layers.
#[derive(Debug, Clone)]
pub(super) struct UsdContext {
    pub(super) scene: Arc<Scene>,
    pub(super) up: UpAxis,
    /// Folder of the textures, relative to the layer, with a slash at the end.
    pub(super) pictures: String,
    /// Folder of the wet maps, relative to the layer, with a slash at the end; none if no maps are written.
    pub(super) maps: Option<String>,
    /// First frame that is written.
    pub(super) first: u32,
    /// Largest error of the leaves' interpolated transforms.
    pub(super) tolerance: Tolerance,
}

impl UsdContext {
    /// The sheet of a material whose maps are there.
    pub(super) fn map_sequence(&self, material: &Material) -> Option<usize> {
        let sheet = material.wet.filter(|_| self.maps.is_some())? as usize;
        self.scene.wet.get(sheet).map(|_| sheet)
    }

    /// The file of a sheet's map at a frame.
    pub(super) fn map_file(&self, sheet: usize, map: Map, frame: u32) -> String {
        let name = self.scene.wet.get(sheet).map_or("", |w| w.name.as_str());
        let folder = self.maps.as_deref().unwrap_or_default();
        format!("{folder}{name}/{}.{}.exr", map.word(), self.scene.clip.tag(frame))
    }
}

/// A texture whose file is another one at every frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapTexture {
    /// Index of the sheet.
    pub(super) sheet: usize,
    pub(super) map: Map,
    /// The attribute `inputs:file`.
    pub(super) attr: AttrHandle,
}
