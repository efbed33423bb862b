//! Data that the writers of all prims share: the scene, the options, and the paths of files beside the layers.

use std::sync::Arc;

use super::Tolerance;
use super::layer_writer::AttrHandle;
use crate::up_axis::UpAxis;
use osier_scene::{Coat, Material, Scene};

/// The scene and the options that all layers of an export share.
#[derive(Debug, Clone)]
pub(crate) struct UsdContext {
    pub(crate) scene: Arc<Scene>,
    pub(crate) up: UpAxis,
    /// Folder of the textures, relative to the layer, with a slash at the end.
    pub(crate) pictures: String,
    /// Folder of the map sequences, relative to the layer, with a slash at the end; `None` if no maps are written.
    pub(crate) maps: Option<String>,
    /// Number of the first frame that is written.
    pub(crate) first: u32,
    /// Largest error of the leaves' interpolated transforms.
    pub(crate) tolerance: Tolerance,
    /// For each asset the pixel footprint of the picture in the asset's space, m.
    pub(crate) pixels: Arc<Vec<f32>>,
    /// For each material the height of its relief on its surface, m.
    pub(crate) reliefs: Arc<Vec<f32>>,
}

impl UsdContext {
    /// The coat of a material if the maps of its weight are written.
    pub(crate) fn mapped_coat(&self, material: &Material) -> Option<Coat> {
        let coat = material.coat.filter(|_| self.maps.is_some())?;
        self.scene.map_sequences.get(coat.sequence as usize).map(|_| coat)
    }

    /// Path of the file with a coat's weight at a frame, relative to the layer.
    pub(crate) fn coat_weight_file(&self, coat: &Coat, frame: u32) -> String {
        let name = self.scene.map_sequences.get(coat.sequence as usize).map_or("", |s| s.name.as_str());
        let folder = self.maps.as_deref().unwrap_or_default();
        format!("{folder}{name}/{}.{}.exr", coat.weight, self.scene.clip.tag(frame))
    }
}

/// A texture whose file differs from frame to frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MapTexture {
    /// The coat whose weight the texture holds.
    pub(crate) coat: Coat,
    /// The attribute `inputs:file`.
    pub(crate) attr: AttrHandle,
}
