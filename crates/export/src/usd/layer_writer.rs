//! The interface through which layers are written, as text (.usda) or as crate files (.usdc), and the metadata it takes.

use super::axis::UpAxis;
use super::value::UsdValue;
use osier_base::Result;
use osier_scene::Scene;

/// Metadata of a layer.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerMeta {
    /// Name of the root prim.
    pub default_prim: String,
    /// Which way is up.
    pub up: UpAxis,
    /// Frames, and so time codes, per second.
    pub fps: f64,
    /// First frame.
    pub start: f64,
    /// Last frame.
    pub end: f64,
    /// Seed as a decimal string.
    pub seed: String,
    /// Hash of the scene.
    pub scene: String,
}

impl LayerMeta {
    /// Metadata of a layer of a scene.
    pub fn of(scene: &Scene, default_prim: &str, up: UpAxis) -> Self {
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
    pub(super) fn custom(&self) -> [(&'static str, &str); 3] {
        [("scene", &self.scene), ("seed", &self.seed), ("version", crate::VERSION)]
    }
}

/// A prim in another layer, or in this one if `asset` is empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompositionArc {
    /// Relative path of the layer.
    pub asset: String,
    /// Path of the prim.
    pub prim: String,
    /// Frames by which it is shown earlier: what the layer has at t + `ahead` is seen at t.
    pub ahead: u32,
}

/// Metadata of a prim.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PrimMeta {
    /// It and all below it are left out, though what it refers to defines them.
    pub inactive: bool,
    /// It only adds to a prim that a payload or a reference defines.
    pub over: bool,
    /// Model kind.
    pub kind: Option<&'static str>,
    /// Readers may hold what it refers to once for all prims that refer to the same.
    pub instanceable: bool,
    /// Applied schemas.
    pub api: Vec<&'static str>,
    /// Layer loaded on demand.
    pub payload: Option<CompositionArc>,
    /// Layer always loaded.
    pub reference: Option<CompositionArc>,
    /// Contents to choose from. Prims of a variant are children of `prim path{set=name}`.
    pub variants: Option<VariantSet>,
}

/// A variant set of a prim.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct VariantSet {
    /// Its name.
    pub set: &'static str,
    /// Names of its variants, in order.
    pub names: Vec<String>,
    /// The one that is seen unless a reader chooses.
    pub selection: String,
}

/// The path that prims of a variant are children of.
pub(super) fn variant_path(prim: &str, set: &str, name: &str) -> String {
    format!("{prim}{{{set}={name}}}")
}

/// What an attribute is, apart from its values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AttrSpec {
    /// Type name, `point3f[]`.
    pub type_name: &'static str,
    /// The same at all times.
    pub uniform: bool,
    /// Not part of any schema.
    pub custom: bool,
    /// Of a primvar.
    pub interpolation: Option<&'static str>,
    /// Numbers per element of a primvar.
    pub element_size: Option<i32>,
    /// The attribute that this one takes its value from.
    pub connection: Option<String>,
}

impl AttrSpec {
    /// A varying attribute.
    pub fn new(type_name: &'static str) -> Self {
        Self { type_name, ..Self::default() }
    }

    /// A uniform attribute.
    pub fn uniform(type_name: &'static str) -> Self {
        Self { type_name, uniform: true, ..Self::default() }
    }

    /// A primvar.
    pub fn primvar(type_name: &'static str, interpolation: &'static str) -> Self {
        Self { type_name, interpolation: Some(interpolation), ..Self::default() }
    }

    /// A connected attribute.
    pub fn connected(type_name: &'static str, source: String) -> Self {
        Self { type_name, connection: Some(source), ..Self::default() }
    }
}

/// An attribute of a stage being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttrHandle(pub(super) usize);

/// A layer being written: specs of prims, attributes and relationships. Prims come before their children and properties; samples of an attribute come in order of
/// time, and may come when other prims have been added.
pub trait LayerWriter: Send {
    /// Starts the layer.
    /// # Errors
    /// `Io`.
    fn begin(&mut self, meta: &LayerMeta) -> Result<()>;

    /// Defines a prim at an absolute path; an empty type is allowed.
    /// # Errors
    /// `Io`.
    fn define_prim(&mut self, path: &str, type_name: &'static str, meta: &PrimMeta) -> Result<()>;

    /// Adds an attribute at `prim path.name`.
    /// # Errors
    /// X001 for a number that is not finite, X004 if a text grows too large, `Io`.
    fn create_attr(&mut self, path: &str, spec: &AttrSpec, default: Option<UsdValue>) -> Result<AttrHandle>;

    /// Adds a value at a time.
    /// # Errors
    /// As [`LayerWriter::create_attr`].
    fn set_time_sample(&mut self, attr: AttrHandle, time: f64, value: UsdValue) -> Result<()>;

    /// Says every sample again `period` later: the same values.
    fn repeat_samples(&mut self, period: f64);

    /// Adds a relationship at `prim path.name`.
    /// # Errors
    /// `Io`.
    fn create_relationship(&mut self, path: &str, targets: &[String]) -> Result<()>;

    /// Completes and closes the file.
    /// # Errors
    /// X004 if a text is too large, `Io`.
    fn finish(&mut self) -> Result<()>;
}

/// Splits a property path into prim path and name.
pub(super) fn split_property_path(path: &str) -> (&str, &str) {
    path.rsplit_once('.').unwrap_or((path, ""))
}

/// Splits a prim path into parent path and name.
/// A path that ends in a variant has the prim that varies as its parent.
pub(super) fn split_prim_path(path: &str) -> (&str, &str) {
    if let Some(at) = path.rfind('{').filter(|_| path.ends_with('}')) {
        return path.split_at(at);
    }
    match path.rsplit_once('/') {
        Some(("", name)) => ("/", name),
        Some((parent, name)) => (parent, name),
        None => ("/", path),
    }
}
