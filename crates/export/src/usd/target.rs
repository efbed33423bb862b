//! What the parts of a stage share while they are written.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::Tolerance;
use super::axis::UpAxis;
use super::stage::{Attr, AttrSpec, PrimMeta, Stage};
use super::value::Value;
use crate::sheets::Map;
use osier_base::Result;
use osier_base::fence::safe_name;
use osier_base::geometry::Bounds;
use osier_scene::{Asset, AssetFrame, Material, MaterialId, Scene, Trs, WetMaps};

/// The scene and the choices that hold for all files.
#[derive(Debug, Clone)]
pub(super) struct Context {
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

impl Context {
    /// The sheet of a material whose maps are there.
    pub(super) fn sheet(&self, material: &Material) -> Option<usize> {
        let sheet = material.wet.filter(|_| self.maps.is_some())? as usize;
        self.scene.wet.get(sheet).map(|_| sheet)
    }

    /// The file of a sheet's map at a frame.
    pub(super) fn map(&self, sheet: usize, map: Map, frame: u32) -> String {
        let name = self.scene.wet.get(sheet).map_or("", |w| w.name.as_str());
        let folder = self.maps.as_deref().unwrap_or_default();
        format!("{folder}{name}/{}.{}.exr", map.word(), self.scene.clip.tag(frame))
    }
}

/// A picture that is another one at every frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheet {
    /// Index of the sheet.
    pub(super) sheet: usize,
    pub(super) map: Map,
    /// The attribute that names the file.
    pub(super) attr: Attr,
}

/// A layer being written, and which shared prims it already has.
pub(super) struct Target {
    pub(super) stage: Box<dyn Stage>,
    made: BTreeSet<String>,
    sheets: Vec<Sheet>,
    /// Prims that are bound to a material, in order.
    bound: Vec<Binding>,
}

/// A prim and its material.
#[derive(Debug, Clone)]
pub(super) struct Binding {
    /// Path of a mesh, a subset or curves.
    pub(super) prim: String,
    pub(super) material: MaterialId,
}

/// One frame of one asset.
pub(super) struct Shot<'a> {
    pub(super) asset: &'a Asset,
    pub(super) state: &'a AssetFrame,
    pub(super) time: f64,
    /// Maps of the scene's wet sheets, or empty.
    pub(super) wet: &'a [Arc<WetMaps>],
}

/// Something in a layer that may change with every frame.
pub(super) trait Part: Send {
    /// Adds the samples of a frame.
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()>;

    /// Adds what waited for later frames; called once, after the last one.
    fn finish(&mut self, _target: &mut Target) -> Result<()> {
        Ok(())
    }

    /// The box of what its frames so far showed, in the asset's space of the stage; empty for what has no points of its own.
    fn reach(&self) -> Bounds {
        Bounds::default()
    }
}

impl Target {
    pub(super) fn new(stage: Box<dyn Stage>) -> Self {
        Self { stage, made: BTreeSet::new(), sheets: Vec::new(), bound: Vec::new() }
    }

    /// A prim with nothing but a type.
    pub(super) fn plain(&mut self, path: &str, type_name: &'static str) -> Result<()> {
        self.stage.prim(path, type_name, &PrimMeta::default())
    }

    /// An attribute with one value.
    pub(super) fn set(&mut self, path: &str, type_name: &'static str, value: Value) -> Result<Attr> {
        self.stage.attr(path, &AttrSpec::new(type_name), Some(value))
    }

    /// Names the files of wet sheets at a frame.
    pub(super) fn sheets(&mut self, cx: &Context, frame: u32) -> Result<()> {
        for s in &self.sheets {
            self.stage.sample(s.attr, f64::from(frame), Value::Asset(&cx.map(s.sheet, s.map, frame)))?;
        }
        Ok(())
    }

    /// A uniform attribute.
    pub(super) fn fix(&mut self, path: &str, type_name: &'static str, value: Value) -> Result<Attr> {
        self.stage.attr(path, &AttrSpec::uniform(type_name), Some(value))
    }

    /// Binds a prim beneath `root` to a material of that root's own scope, which is made when first used.
    pub(super) fn bind(&mut self, cx: &Context, root: &str, prim: &str, material: MaterialId) -> Result<()> {
        let scope = format!("{root}/mtl");
        let Some(own) = cx.scene.materials.get(material as usize) else { return Ok(()) };
        let path = format!("{scope}/{}", safe_name(&own.name));
        if self.made.insert(scope.clone()) {
            self.plain(&scope, "Scope")?;
        }
        if self.made.insert(path.clone()) {
            // Blender's preview surfaces do not read colours at vertices.
            let m = Material { base_color: cx.scene.flat_color(material), ..own.clone() };
            self.sheets.extend(super::material::define(cx, self.stage.as_mut(), &path, &m)?);
        }
        self.bound.push(Binding { prim: prim.to_owned(), material });
        self.stage.rel(&format!("{prim}.material:binding"), &[path])
    }

    /// Which prims of the layer are bound to which materials.
    pub(super) fn bindings(&self) -> &[Binding] {
        &self.bound
    }

    /// Translation, rotation and scale of a prim.
    pub(super) fn transform(&mut self, path: &str, m: &Trs) -> Result<()> {
        let t = m.t.to_array().map(f64::from);
        self.set(&format!("{path}.xformOp:translate"), "double3", Value::Double3(t))?;
        self.set(&format!("{path}.xformOp:orient"), "quatf", Value::Quatf(unit(m.r).to_array()))?;
        self.set(&format!("{path}.xformOp:scale"), "float3", Value::Float3(m.s.to_array()))?;
        let order = ["xformOp:translate", "xformOp:orient", "xformOp:scale"].map(String::from);
        self.fix(&format!("{path}.xformOpOrder"), "token[]", super::value::Array::Token(&order).into())?;
        Ok(())
    }
}

/// A unit quaternion with w >= 0.
pub(super) fn unit(q: glam::Quat) -> glam::Quat {
    let q = q.normalize();
    if q.w < 0.0 { -q } else { q }
}

/// A unit quaternion on the same side as the one before, so that blending goes the short way.
pub(super) fn near(q: glam::Quat, before: glam::Quat) -> glam::Quat {
    let q = q.normalize();
    if q.dot(before) < 0.0 { -q } else { q }
}
