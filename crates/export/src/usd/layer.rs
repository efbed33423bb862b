//! A layer being written, and the interface of the prims in it that have time samples.

use std::collections::BTreeSet;

use super::context::{MapTexture, UsdContext};
use super::layer_writer::{AttrHandle, AttrSpec, LayerWriter, PrimMetadata};
use super::value::UsdValue;
use osier_base::Result;
use osier_base::files::safe_name;
use osier_base::geometry::Bounds;
use osier_scene::{Asset, AssetFrame, MapFrame, Material, MaterialId, Trs};

/// A layer being written, with its materials, which are defined when a prim is first bound to them.
pub(crate) struct LayerBuilder {
    pub(crate) writer: Box<dyn LayerWriter>,
    /// Paths of the materials, and of the scopes around them, that are defined.
    defined_materials: BTreeSet<String>,
    map_textures: Vec<MapTexture>,
    /// Bindings in the order of the calls of [`Self::bind_material`].
    bindings: Vec<MaterialBinding>,
}

/// A prim and the material that it is bound to.
#[derive(Debug, Clone)]
pub(crate) struct MaterialBinding {
    /// Path of a mesh, a subset or curves.
    pub(crate) prim: String,
    pub(crate) material: MaterialId,
}

/// The state of an asset at a frame, from which prims take their samples.
pub(crate) struct AssetSample<'a> {
    pub(crate) asset: &'a Asset,
    pub(crate) state: &'a AssetFrame,
    /// Time code: the number of the frame.
    pub(crate) time: f64,
    /// Maps of the scene's map sequences at this frame; empty without any.
    pub(crate) maps: &'a [MapFrame],
}

/// A prim that takes time samples frame by frame after it was defined at rest.
pub(crate) trait AnimatedPrim: Send {
    /// Adds the time samples of the prim at the frame of `sample`.
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()>;

    /// Adds the samples that waited for later frames; called once, after the last one.
    fn flush_samples(&mut self, _layer: &mut LayerBuilder) -> Result<()> {
        Ok(())
    }

    /// The box around the prim over all frames so far, in the asset's space with the stage's axes; empty for prims whose extent
    /// an instancer of the asset does not need.
    fn clip_bounds(&self) -> Bounds {
        Bounds::default()
    }
}

impl LayerBuilder {
    pub(crate) fn new(writer: Box<dyn LayerWriter>) -> Self {
        Self { writer, defined_materials: BTreeSet::new(), map_textures: Vec::new(), bindings: Vec::new() }
    }

    /// Defines a prim without metadata.
    pub(crate) fn define_plain_prim(&mut self, path: &str, type_name: &'static str) -> Result<()> {
        self.writer.define_prim(path, type_name, &PrimMetadata::default())
    }

    /// Creates an attribute with a default value; time samples may follow.
    pub(crate) fn set_attr(&mut self, path: &str, type_name: &'static str, value: UsdValue) -> Result<AttrHandle> {
        self.writer.create_attr(path, &AttrSpec::new(type_name), Some(value))
    }

    /// Adds a time sample at `frame` with the file name of each texture that changes with the frames.
    pub(crate) fn sample_map_textures(&mut self, cx: &UsdContext, frame: u32) -> Result<()> {
        for s in &self.map_textures {
            self.writer.set_time_sample(
                s.attr,
                f64::from(frame),
                UsdValue::Asset(&cx.coat_weight_file(&s.coat, frame)),
            )?;
        }
        Ok(())
    }

    /// Creates an attribute of variability `uniform`, which cannot have time samples.
    pub(crate) fn set_uniform(&mut self, path: &str, type_name: &'static str, value: UsdValue) -> Result<AttrHandle> {
        self.writer.create_attr(path, &AttrSpec::uniform(type_name), Some(value))
    }

    /// Binds a prim below `root` to a material in the scope `root/mtl`; scope and material are defined on first use.
    pub(crate) fn bind_material(
        &mut self,
        cx: &UsdContext,
        root: &str,
        prim: &str,
        material: MaterialId,
    ) -> Result<()> {
        let scope = format!("{root}/mtl");
        let Some(source) = cx.scene.materials.get(material as usize) else { return Ok(()) };
        let path = format!("{scope}/{}", safe_name(&source.name));
        // Scope and materials share one set of paths: their paths differ, and each is defined once.
        if self.defined_materials.insert(scope.clone()) {
            self.define_plain_prim(&scope, "Scope")?;
        }
        if self.defined_materials.insert(path.clone()) {
            // Blender's preview surfaces do not read vertex colours, so the material has their mean.
            let height_range = cx.reliefs.get(material as usize).copied().unwrap_or(source.height_range);
            let m = Material { base_color: cx.scene.flat_color(material), height_range, ..source.clone() };
            let defined = super::material::define_material(cx, self.writer.as_mut(), &path, &m, material)?;
            self.map_textures.extend(defined);
        }
        self.bindings.push(MaterialBinding { prim: prim.to_owned(), material });
        self.writer.create_relationship(&format!("{prim}.material:binding"), &[path])
    }

    /// The material bindings of the layer so far, in the order in which they were made.
    pub(crate) fn bindings(&self) -> &[MaterialBinding] {
        &self.bindings
    }

    /// Sets the transform of a prim: translate, orient, scale, in `xformOpOrder`. `m`: in the axes of the stage.
    pub(crate) fn set_xform_ops(&mut self, path: &str, m: &Trs) -> Result<()> {
        let t = m.t.to_array().map(f64::from);
        self.set_attr(&format!("{path}.xformOp:translate"), "double3", UsdValue::Double3(t))?;
        self.set_attr(&format!("{path}.xformOp:orient"), "quatf", UsdValue::Quatf(canonical_quat(m.r).to_array()))?;
        self.set_attr(&format!("{path}.xformOp:scale"), "float3", UsdValue::Float3(m.s.to_array()))?;
        let order = ["xformOp:translate", "xformOp:orient", "xformOp:scale"].map(String::from);
        self.set_uniform(&format!("{path}.xformOpOrder"), "token[]", super::value::UsdArray::Token(&order).into())?;
        Ok(())
    }
}

/// The unit quaternion with w >= 0 of the same rotation as `q`.
pub(crate) fn canonical_quat(q: glam::Quat) -> glam::Quat {
    let q = q.normalize();
    if q.w < 0.0 { -q } else { q }
}

/// The unit quaternion of the same rotation whose dot product with `before` is not negative, so that interpolation between the
/// two samples takes the short way.
pub(crate) fn nearest_quat(q: glam::Quat, before: glam::Quat) -> glam::Quat {
    let q = q.normalize();
    if q.dot(before) < 0.0 { -q } else { q }
}
