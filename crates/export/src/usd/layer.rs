//! A layer under construction, and what the writers of its prims share.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::Tolerance;
use super::axis::UpAxis;
use super::layer_writer::{AttrHandle, AttrSpec, LayerWriter, PrimMeta};
use super::value::UsdValue;
use crate::sheets::Map;
use osier_base::Result;
use osier_base::files::safe_name;
use osier_base::geometry::Bounds;
use osier_scene::{Asset, AssetFrame, Material, MaterialId, Scene, Trs, WetMaps};

/// The scene and the choices that hold for all files.
#[derive(Debug, Clone)]
pub(super) struct UsdContext {
    pub(super) scene: Arc<Scene>,
    pub(super) up: UpAxis,
    /// Where pictures lie, seen from the layer, with a slash at the end.
    pub(super) pictures: String,
    /// Where maps of wet sheets lie, likewise, if there are any.
    pub(super) maps: Option<String>,
    /// First frame that is written.
    pub(super) first: u32,
    /// How far leaves between two samples may be from where they were simulated.
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

/// A picture that is another one at every frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapTexture {
    /// Index of the sheet.
    pub(super) sheet: usize,
    pub(super) map: Map,
    /// The attribute that names the file.
    pub(super) attr: AttrHandle,
}

/// A layer being written, and which shared prims it already has.
pub(super) struct LayerBuilder {
    pub(super) writer: Box<dyn LayerWriter>,
    defined_materials: BTreeSet<String>,
    map_textures: Vec<MapTexture>,
    /// Prims that are bindings to a material, in order.
    bindings: Vec<MaterialBinding>,
}

/// A prim and its material.
#[derive(Debug, Clone)]
pub(super) struct MaterialBinding {
    /// Path of a mesh, a subset or curves.
    pub(super) prim: String,
    pub(super) material: MaterialId,
}

/// One frame of one asset.
pub(super) struct AssetSample<'a> {
    pub(super) asset: &'a Asset,
    pub(super) state: &'a AssetFrame,
    pub(super) time: f64,
    /// Maps of the scene's wet sheets, or empty.
    pub(super) wet: &'a [Arc<WetMaps>],
}

/// Something in a layer that may change with every frame.
pub(super) trait AnimatedPrim: Send {
    /// Adds the samples of a frame.
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()>;

    /// Adds what waited for later frames; called once, after the last one.
    fn finish(&mut self, _target: &mut LayerBuilder) -> Result<()> {
        Ok(())
    }

    /// The box of what its frames so far showed, in the asset's space of the stage; empty for what has no points of its own.
    fn reach(&self) -> Bounds {
        Bounds::default()
    }
}

impl LayerBuilder {
    pub(super) fn new(writer: Box<dyn LayerWriter>) -> Self {
        Self { writer, defined_materials: BTreeSet::new(), map_textures: Vec::new(), bindings: Vec::new() }
    }

    /// A prim with nothing but a type.
    pub(super) fn define_prim(&mut self, path: &str, type_name: &'static str) -> Result<()> {
        self.writer.define_prim(path, type_name, &PrimMeta::default())
    }

    /// An attribute with one value.
    pub(super) fn set_attr(&mut self, path: &str, type_name: &'static str, value: UsdValue) -> Result<AttrHandle> {
        self.writer.create_attr(path, &AttrSpec::new(type_name), Some(value))
    }

    /// Names the files of wet sheets at a frame.
    pub(super) fn sample_map_textures(&mut self, cx: &UsdContext, frame: u32) -> Result<()> {
        for s in &self.map_textures {
            self.writer.set_time_sample(
                s.attr,
                f64::from(frame),
                UsdValue::Asset(&cx.map_file(s.sheet, s.map, frame)),
            )?;
        }
        Ok(())
    }

    /// A uniform attribute.
    pub(super) fn set_uniform(&mut self, path: &str, type_name: &'static str, value: UsdValue) -> Result<AttrHandle> {
        self.writer.create_attr(path, &AttrSpec::uniform(type_name), Some(value))
    }

    /// Binds a prim beneath `root` to a material of that root's own scope, which is defined_materials when first used.
    pub(super) fn bind_material(
        &mut self,
        cx: &UsdContext,
        root: &str,
        prim: &str,
        material: MaterialId,
    ) -> Result<()> {
        let scope = format!("{root}/mtl");
        let Some(own) = cx.scene.materials.get(material as usize) else { return Ok(()) };
        let path = format!("{scope}/{}", safe_name(&own.name));
        if self.defined_materials.insert(scope.clone()) {
            self.define_prim(&scope, "Scope")?;
        }
        if self.defined_materials.insert(path.clone()) {
            // Blender's preview surfaces do not read colours at vertices.
            let m = Material { base_color: cx.scene.flat_color(material), ..own.clone() };
            self.map_textures.extend(super::material::define_material(cx, self.writer.as_mut(), &path, &m)?);
        }
        self.bindings.push(MaterialBinding { prim: prim.to_owned(), material });
        self.writer.create_relationship(&format!("{prim}.material:binding"), &[path])
    }

    /// Which prims of the layer are bound to which materials.
    pub(super) fn bindings(&self) -> &[MaterialBinding] {
        &self.bindings
    }

    /// Translation, rotation and scale of a prim.
    pub(super) fn set_xform_ops(&mut self, path: &str, m: &Trs) -> Result<()> {
        let t = m.t.to_array().map(f64::from);
        self.set_attr(&format!("{path}.xformOp:translate"), "double3", UsdValue::Double3(t))?;
        self.set_attr(&format!("{path}.xformOp:orient"), "quatf", UsdValue::Quatf(canonical_quat(m.r).to_array()))?;
        self.set_attr(&format!("{path}.xformOp:scale"), "float3", UsdValue::Float3(m.s.to_array()))?;
        let order = ["xformOp:translate", "xformOp:orient", "xformOp:scale"].map(String::from);
        self.set_uniform(&format!("{path}.xformOpOrder"), "token[]", super::value::UsdArray::Token(&order).into())?;
        Ok(())
    }
}

/// A unit quaternion with w >= 0.
pub(super) fn canonical_quat(q: glam::Quat) -> glam::Quat {
    let q = q.normalize();
    if q.w < 0.0 { -q } else { q }
}

/// A unit quaternion on the same side as the one before, so that blending goes the short way.
pub(super) fn nearest_quat(q: glam::Quat, before: glam::Quat) -> glam::Quat {
    let q = q.normalize();
    if q.dot(before) < 0.0 { -q } else { q }
}
