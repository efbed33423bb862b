//! Attributes of the scene as primvars: `primvars:NAME` of a mesh, of points, or of an instancer.

use std::borrow::Cow;

use super::arrays::as_ints;
use super::layer::LayerBuilder;
use super::layer_writer::{AttrHandle, AttrSpec};
use super::value::UsdArray;
use crate::up_axis::UpAxis;
use glam::Vec3;
use osier_base::Result;
use osier_scene::{Attribute, AttributeData, AttributeDomain};

/// A primvar whose values change with the frames.
#[derive(Debug, Clone)]
pub(super) struct AnimatedPrimvar {
    /// Name of the scene's attribute; the primvar has the same.
    pub(super) name: &'static str,
    attr: AttrHandle,
    /// Empty values of the attribute's type, for frames that lack it.
    empty: AttributeData,
    /// Axes of the stage, to which vectors are rotated.
    up: UpAxis,
}

impl AnimatedPrimvar {
    /// Defines the primvar of an attribute of the prim at `path`, without a default value: only frames give it values.
    pub(super) fn define_without_default(
        layer: &mut LayerBuilder,
        path: &str,
        attribute: &Attribute,
        up: UpAxis,
    ) -> Result<Self> {
        let attr = layer.writer.create_attr(&primvar_path(path, attribute), &spec(attribute), None)?;
        Ok(Self { name: attribute.name, attr, empty: attribute.data.gather(&[]), up })
    }

    /// Defines the primvar of an attribute of the prim at `path`, with the attribute's values as default value.
    pub(super) fn define(layer: &mut LayerBuilder, path: &str, attribute: &Attribute, up: UpAxis) -> Result<Self> {
        let spec = spec(attribute);
        let data = on_stage_axes(&attribute.data, up);
        let value = usd_array(&data)?.into();
        let attr = layer.writer.create_attr(&primvar_path(path, attribute), &spec, Some(value))?;
        Ok(Self { name: attribute.name, attr, empty: attribute.data.gather(&[]), up })
    }

    /// Adds a sample: the values of the attribute with its name in `attributes`, or an empty array.
    pub(super) fn sample(&self, layer: &mut LayerBuilder, time: f64, attributes: &[Attribute]) -> Result<()> {
        // An attribute that a frame lacks is written as empty: without a sample, the values of the frame before would be held.
        let data = attributes.iter().find(|a| a.name == self.name).map_or(&self.empty, |a| &a.data);
        layer.writer.set_time_sample(self.attr, time, usd_array(&on_stage_axes(data, self.up))?.into())
    }

    /// Whether `attributes` contain values for the primvar.
    pub(super) fn has_values_in(&self, attributes: &[Attribute]) -> bool {
        attributes.iter().any(|a| a.name == self.name && !a.data.is_empty())
    }
}

/// Defines the primvars of all attributes that have values.
pub(super) fn define_all(
    layer: &mut LayerBuilder,
    path: &str,
    attributes: &[Attribute],
    up: UpAxis,
) -> Result<Vec<AnimatedPrimvar>> {
    let with_values = attributes.iter().filter(|a| !a.data.is_empty());
    with_values.map(|a| AnimatedPrimvar::define(layer, path, a, up)).collect()
}

/// The values with vectors rotated from the axes of the scene to those of the stage.
fn on_stage_axes(data: &AttributeData, up: UpAxis) -> Cow<'_, AttributeData> {
    match data {
        AttributeData::Vector(list) => {
            let rotate = |v: &[f32; 3]| up.stage_vec(Vec3::from_array(*v)).to_array();
            Cow::Owned(AttributeData::Vector(list.iter().map(rotate).collect()))
        }
        _ => Cow::Borrowed(data),
    }
}

fn primvar_path(path: &str, attribute: &Attribute) -> String {
    format!("{path}.primvars:{}", attribute.name)
}

fn spec(attribute: &Attribute) -> AttrSpec {
    let type_name = match attribute.data {
        AttributeData::U32(_) | AttributeData::I32(_) => "int[]",
        AttributeData::F32(_) | AttributeData::Unit1(_) => "float[]",
        AttributeData::Unit2(_) => "float2[]",
        AttributeData::Vector(_) => "vector3f[]",
        AttributeData::Unit4(_) => "color4f[]",
    };
    let interpolation = if attribute.domain == AttributeDomain::Mesh { "constant" } else { "vertex" };
    AttrSpec::primvar(type_name, interpolation)
}

/// The values in element types of USD, in which all integers are signed.
fn usd_array(data: &AttributeData) -> Result<UsdArray<'_>> {
    Ok(match data {
        AttributeData::U32(v) => UsdArray::Int(as_ints(v, "values of an attribute")?),
        AttributeData::I32(v) => UsdArray::Int(v),
        AttributeData::F32(v) | AttributeData::Unit1(v) => UsdArray::Float(v),
        AttributeData::Unit2(v) => UsdArray::Float2(v),
        AttributeData::Vector(v) => UsdArray::Float3(v),
        AttributeData::Unit4(v) => UsdArray::Float4(v),
    })
}
