//! Wetness of meshes as a primvar, for programs that take no pictures that change.

use std::sync::Arc;

use super::context::UsdContext;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder};
use super::layer_writer::{AttrHandle, AttrSpec};
use super::value::UsdArray;
use osier_base::Result;
use osier_scene::{Mesh, MeshObject, WetMaps};

/// A mesh that wears a wet sheet.
struct WetnessPrimvar {
    /// Of the mesh in its asset.
    index: usize,
    sheet: usize,
    attr: AttrHandle,
}

/// Wetness at each point of a mesh, 0 to 1: that of the texel it is on.
fn sample_at_points(mesh: &Mesh, side: usize, maps: Option<&Arc<WetMaps>>) -> Vec<f32> {
    let texel = |x: f32| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
        let k = (x * side as f32) as usize;
        k.min(side.saturating_sub(1))
    };
    let one = |i: usize| {
        let uv = mesh.uvs.get(i)?;
        maps?.wetness.get(texel(1.0 - uv.y) * side + texel(uv.x)).copied()
    };
    (0..mesh.points.len()).map(|i| one(i).unwrap_or(0.0)).collect()
}

/// Writes `primvars:wetness` of the mesh at `path`, one number per point; nothing if it wears no wet sheet.
pub(super) fn define_wetness(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    path: &str,
    object: &MeshObject,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    let worn = object.mesh.subsets.iter().find_map(|s| cx.scene.materials.get(s.material as usize)?.wet);
    let Some((sheet, wet)) = worn.and_then(|w| Some((w as usize, cx.scene.wet.get(w as usize)?))) else {
        return Ok(None);
    };
    let values = sample_at_points(&object.mesh, wet.side, wet.rest.as_ref());
    let spec = AttrSpec::primvar("float[]", "vertex");
    let attr =
        layer.writer.create_attr(&format!("{path}.primvars:wetness"), &spec, Some(UsdArray::Float(&values).into()))?;
    Ok(Some(Box::new(WetnessPrimvar { index, sheet, attr })))
}

impl AnimatedPrim for WetnessPrimvar {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let both = sample.asset.meshes.get(self.index).zip(cx.scene.wet.get(self.sheet));
        let (Some((object, wet)), Some(maps)) = (both, sample.wet.get(self.sheet)) else { return Ok(()) };
        let values = sample_at_points(&object.mesh, wet.side, Some(maps));
        layer.writer.set_time_sample(self.attr, sample.time, UsdArray::Float(&values).into())
    }
}
