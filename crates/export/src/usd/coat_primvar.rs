//! Weight of a coat at the points of a mesh as a primvar, for programs that take no pictures that change.

use super::context::UsdContext;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder};
use super::primvar::AnimatedPrimvar;
use osier_base::Result;
use osier_scene::{Attribute, AttributeData, Coat, MapFrame, MapSequence, MaterialClass, Mesh, MeshObject, Subset};

/// Primvar of a mesh with a coated material, which follows the maps of the frames.
struct CoatWeight {
    /// Index of the mesh in its asset.
    index: usize,
    coat: Coat,
    primvar: AnimatedPrimvar,
}

/// Weight of the coat at each point of a mesh, from the nearest texel of the map; 0 without maps.
fn weight_at_points(mesh: &Mesh, coat: &Coat, sequence: &MapSequence, maps: Option<&MapFrame>) -> Attribute {
    let side = sequence.side;
    let texel = |x: f32| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
        let k = (x * side as f32) as usize;
        // The coordinate 1 belongs to the last texel; negative ones saturate to the first.
        k.min(side.saturating_sub(1))
    };
    let weights = maps.zip(sequence.layer(coat.weight)).and_then(|(maps, layer)| maps.scalars(layer));
    let one = |i: usize| {
        let uv = mesh.uvs.get(i)?;
        // Rows of a map run from the top, v from the bottom: row = texel(1 - v). The nearest texel, without interpolation.
        weights?.get(texel(1.0 - uv.y) * side + texel(uv.x)).copied()
    };
    let values = (0..mesh.points.len()).map(|i| one(i).unwrap_or(0.0)).collect();
    Attribute::vertex(coat.weight, AttributeData::Unit1(values))
}

/// Defines the primvar of the mesh at `path`, named as the layer of the coat's weight; nothing without a coated material. Maps of bark
/// repeat in spots that are smaller than its triangles: its points cannot hold them.
pub(super) fn define_coat_weight(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    path: &str,
    object: &MeshObject,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    let material = |s: &Subset| cx.scene.materials.get(s.material as usize).filter(|m| m.class != MaterialClass::Bark);
    let coat = object.mesh.subsets.iter().find_map(|s| material(s)?.coat);
    let Some((coat, sequence)) = coat.and_then(|c| Some((c, cx.scene.map_sequences.get(c.sequence as usize)?))) else {
        return Ok(None);
    };
    let rest = weight_at_points(&object.mesh, &coat, sequence, sequence.rest.as_ref());
    let primvar = AnimatedPrimvar::define(layer, path, &rest, cx.up)?;
    Ok(Some(Box::new(CoatWeight { index, coat, primvar })))
}

impl AnimatedPrim for CoatWeight {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let sequence = self.coat.sequence as usize;
        let both = sample.asset.meshes.get(self.index).zip(cx.scene.map_sequences.get(sequence));
        // A frame without maps gets no sample, so readers hold the last values.
        let (Some((object, of)), Some(maps)) = (both, sample.maps.get(sequence)) else { return Ok(()) };
        let values = weight_at_points(&object.mesh, &self.coat, of, Some(maps));
        self.primvar.sample(layer, sample.time, &[values])
    }
}
