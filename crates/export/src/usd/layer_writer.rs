//! The trait [`LayerWriter`], through which a layer is written as text (`.usda`) or as a crate file (`.usdc`), and the metadata
//! of layers, prims and attributes. It has the vocabulary of Sdf: specs with fields, no composition.

use super::value::UsdValue;
use crate::up_axis::UpAxis;
use osier_base::Result;
use osier_scene::Scene;

/// Metadata in the header of a layer: default prim, axes, frame range, and seed and hash of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerMetadata {
    /// Name of the root prim, without `/`, to which a reference without a prim path refers.
    pub default_prim: String,
    pub up: UpAxis,
    /// Time codes per second; a time code is a frame.
    pub fps: f64,
    /// Time code of the first frame of the clip.
    pub start: f64,
    /// Time code of the last frame of the clip.
    pub end: f64,
    /// Seed of the scene as a decimal string.
    pub seed: String,
    /// Hash of the resolved scene, hexadecimal.
    pub scene: String,
}

impl LayerMetadata {
    pub fn for_scene(scene: &Scene, default_prim: &str, up: UpAxis) -> Self {
        Self {
            default_prim: default_prim.to_owned(),
            up,
            fps: scene.clip.fps(),
            start: f64::from(scene.clip.start),
            end: f64::from(scene.clip.end),
            seed: scene.seed.to_string(),
            scene: scene.hash.clone(),
        }
    }

    /// The strings in `customLayerData["osier"]`, sorted by key.
    pub(super) fn custom_layer_data(&self) -> [(&'static str, &str); 3] {
        [("scene", &self.scene), ("seed", &self.seed), ("version", crate::VERSION)]
    }
}

/// The target of a payload or reference: a prim of another layer, or of this one if `asset` is empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompositionArc {
    /// Path of the layer, relative to this one; empty for this one.
    pub asset: String,
    /// Absolute path of the prim in that layer.
    pub prim: String,
    /// Frames by which the target is ahead of the clip: at time t it shows its time t + `phase` (a layer offset of -`phase`).
    pub phase: u32,
}

/// Metadata of a prim; the default is a `def` without any.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PrimMetadata {
    /// `active = false`: the prim and its descendants are not composed, though a payload or reference defines them.
    pub inactive: bool,
    /// Specifier `over`, for a prim that a payload or reference defines; otherwise `def`.
    pub over: bool,
    /// Model kind: `component`, `assembly` or `group`.
    pub kind: Option<&'static str>,
    /// Readers may compose the target of the reference once and share it between the prims that refer to it.
    pub instanceable: bool,
    /// Names of applied API schemas.
    pub api: Vec<&'static str>,
    pub payload: Option<CompositionArc>,
    pub reference: Option<CompositionArc>,
    /// Prims of a variant are children of [`variant_path`].
    pub variants: Option<VariantSet>,
}

/// A variant set of a prim and its default selection.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct VariantSet {
    pub set: &'static str,
    /// Names of the variants, in order.
    pub names: Vec<String>,
    /// The variant that is selected unless a stronger layer selects another.
    pub selection: String,
}

/// The path below which the prims of a variant are defined: `/prim{set=name}`.
pub(super) fn variant_path(prim: &str, set: &str, name: &str) -> String {
    format!("{prim}{{{set}={name}}}")
}

/// Type and metadata of an attribute, without its values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AttrSpec {
    /// Value type with its role, as in text: `point3f[]`.
    pub type_name: &'static str,
    /// Variability `uniform`: the attribute has no time samples.
    pub uniform: bool,
    /// Keyword `custom`: the attribute belongs to no schema.
    pub custom: bool,
    /// Interpolation of a primvar: `vertex`, `faceVarying`, `uniform`.
    pub interpolation: Option<&'static str>,
    /// Array elements that make one value of a primvar.
    pub element_size: Option<i32>,
    /// Path of the attribute that this one takes its value from.
    pub connection: Option<String>,
}

impl AttrSpec {
    /// An attribute that may have time samples, with no other metadata.
    pub fn new(type_name: &'static str) -> Self {
        Self { type_name, ..Self::default() }
    }

    pub fn uniform(type_name: &'static str) -> Self {
        Self { type_name, uniform: true, ..Self::default() }
    }

    pub fn primvar(type_name: &'static str, interpolation: &'static str) -> Self {
        Self { type_name, interpolation: Some(interpolation), ..Self::default() }
    }

    /// An attribute connected to the one at the path `source`.
    pub fn connected(type_name: &'static str, source: String) -> Self {
        Self { type_name, connection: Some(source), ..Self::default() }
    }
}

/// An attribute of the layer being written, for adding time samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttrHandle(pub(super) usize);

/// Writes the specs of a layer: prims, attributes, relationships. A prim is defined before its children and properties. Time
/// samples of an attribute arrive in order of time, and may arrive after other prims have been defined.
pub trait LayerWriter: Send {
    /// Writes the layer metadata; called once, first.
    /// # Errors
    /// `Io`.
    fn begin(&mut self, meta: &LayerMetadata) -> Result<()>;

    /// Defines a prim at an absolute path. `type_name`: its schema; empty for a typeless prim.
    /// # Errors
    /// `Io`.
    fn define_prim(&mut self, path: &str, type_name: &'static str, meta: &PrimMetadata) -> Result<()>;

    /// Creates the attribute at `path`, `/prim.name`, with a default value.
    /// # Errors
    /// X001 for a number that is not finite, X004 if a text layer grows too large, `Io`.
    fn create_attr(&mut self, path: &str, spec: &AttrSpec, default: Option<UsdValue>) -> Result<AttrHandle>;

    /// Replaces the default value of an attribute that was created with one.
    /// # Errors
    /// As [`LayerWriter::create_attr`].
    fn set_default(&mut self, attr: AttrHandle, value: UsdValue) -> Result<()>;

    /// Adds a time sample. `time`: time code.
    /// # Errors
    /// As [`LayerWriter::create_attr`].
    fn set_time_sample(&mut self, attr: AttrHandle, time: f64, value: UsdValue) -> Result<()>;

    /// Repeats all samples of all attributes once, `period` time codes later, so that a layer offset into the clip finds values
    /// to its end.
    fn repeat_clip_once(&mut self, period: f64);

    /// Creates the relationship at `path`, `/prim.name`. `targets`: paths.
    /// # Errors
    /// `Io`.
    fn create_relationship(&mut self, path: &str, targets: &[String]) -> Result<()>;

    /// Writes the remaining data, such as tables, and closes the file.
    /// # Errors
    /// X004 if a text layer is too large, `Io`.
    fn finish(&mut self) -> Result<()>;
}

/// Splits a property path into the path of its prim and its name.
pub(super) fn split_property_path(path: &str) -> (&str, &str) {
    path.rsplit_once('.').unwrap_or((path, ""))
}

/// Splits a prim path into the path of its parent and its name. The parent of `/prim{set=name}` is `/prim`.
pub(super) fn split_prim_path(path: &str) -> (&str, &str) {
    if let Some(brace) = path.rfind('{').filter(|_| path.ends_with('}')) {
        return path.split_at(brace);
    }
    match path.rsplit_once('/') {
        Some(("", name)) => ("/", name),
        Some((parent, name)) => (parent, name),
        None => ("/", path),
    }
}
