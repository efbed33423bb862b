//! An asset as a prim with everything beneath it.

use super::context::UsdContext;
use super::layer::{AnimatedPrim, LayerBuilder};
use super::{coat_primvar, instancer, mesh, points, skel};
use osier_base::Result;
use osier_base::files::Names;
use osier_scene::{Asset, MeshMotion};

/// Factor on the tolerance in pixels for a growing plant. Own: between two samples a shoot is too long or too short by
/// a part of its length, an error without a rhythm that the eye could follow.
pub(super) const GROWTH_PIXELS: f32 = 3.0;

/// Whether an asset grows: its points move without a skeleton. Time samples with velocities, such as those of plants on
/// rods, are never omitted.
pub(super) fn deforms_without_skeleton(asset: &Asset) -> bool {
    asset.skeleton.is_none() && asset.meshes.iter().any(|m| m.motion == MeshMotion::Deforming)
}

/// Writes the asset at an index at rest under `root`, a prim that exists. Returns what changes with the frames.
pub(super) fn define_asset(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    index: usize,
) -> Result<Vec<Box<dyn AnimatedPrim>>> {
    let Some(asset) = cx.scene.assets.get(index) else { return Ok(Vec::new()) };
    let pixel = cx.pixels.get(index).copied().unwrap_or(0.0)
        * if deforms_without_skeleton(asset) { GROWTH_PIXELS } else { 1.0 };
    let mut names = Names::default();
    // Reserves the name of the scope of materials.
    names.unique("mtl");
    let mut parts = Vec::new();
    parts.extend(skel::define_skel_root(cx, layer, root, asset, &mut names)?);
    for (i, object) in asset.meshes.iter().enumerate().filter(|(_, m)| !skel::is_skinned(asset, m)) {
        let path = format!("{root}/{}", names.unique(&object.name));
        let varying = object.motion == MeshMotion::Varying;
        let place = mesh::MeshTarget { root, path: &path, skinned: false, varying };
        let source = mesh::MeshInput { index: i, object, pixel };
        parts.extend(mesh::define_unskinned(cx, layer, &place, source)?);
        parts.extend(coat_primvar::define_coat_weight(cx, layer, i, &path, object)?);
    }
    for (i, instances) in asset.instancers.iter().enumerate() {
        let path = format!("{root}/{}", names.unique(&instances.name));
        let source = instancer::InstancerInput { index: i, instancer: instances, pixel };
        parts.extend(instancer::define_instancer(cx, layer, root, &path, source)?);
    }
    for (i, cloud) in asset.points.iter().enumerate() {
        let path = format!("{root}/{}", names.unique(&cloud.name));
        parts.extend(points::define_points(cx, layer, i, root, &path, cloud)?);
    }
    for (i, curves) in asset.curves.iter().enumerate() {
        let path = format!("{root}/{}", names.unique(&curves.name));
        parts.extend(points::define_curves(cx, layer, i, root, &path, curves)?);
    }
    Ok(parts)
}

/// Defines the point twins of an asset's tracked instancers under `root`. Returns the prims that take their time samples.
pub(super) fn define_point_twins(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    asset: &Asset,
) -> Result<Vec<Box<dyn AnimatedPrim>>> {
    let mut names = Names::default();
    let mut parts = Vec::new();
    for (i, instances) in asset.instancers.iter().enumerate().filter(|(_, x)| x.tracked) {
        let path = format!("{root}/{}", names.unique(&instances.name));
        parts.push(instancer::define_instancer_points(cx, layer, i, &path, instances)?);
    }
    Ok(parts)
}
