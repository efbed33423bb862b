//! An asset in a stage: everything under one prim.

use super::target::{Context, Part, Target};
use super::{instancer, mesh, points, skel, wet};
use osier_base::Result;
use osier_base::fence::Names;
use osier_scene::Asset;

/// Writes an asset at rest under `root`, a prim that exists. Returns what changes with the frames.
pub(super) fn define(cx: &Context, target: &mut Target, root: &str, asset: &Asset) -> Result<Vec<Box<dyn Part>>> {
    let mut names = Names::default();
    // The materials' scope.
    names.unique("mtl");
    let mut parts = Vec::new();
    parts.extend(skel::part(cx, target, root, asset, &mut names)?);
    for (i, object) in asset.meshes.iter().enumerate().filter(|(_, m)| !skel::follows(asset, m)) {
        let path = format!("{root}/{}", names.unique(&object.name));
        let varying = object.motion == osier_scene::MeshMotion::Varying;
        let place = mesh::Place { root, path: &path, skinned: false, varying };
        parts.extend(mesh::part(cx, target, i, &place, object)?);
        parts.extend(wet::part(cx, target, i, &path, object)?);
    }
    for (i, instances) in asset.instancers.iter().enumerate() {
        let path = format!("{root}/{}", names.unique(&instances.name));
        parts.extend(instancer::part(cx, target, i, (root, &path), instances)?);
    }
    for (i, cloud) in asset.points.iter().enumerate() {
        let path = format!("{root}/{}", names.unique(&cloud.name));
        parts.extend(points::cloud(cx, target, i, (root, &path), cloud)?);
    }
    for (i, curves) in asset.curves.iter().enumerate() {
        let path = format!("{root}/{}", names.unique(&curves.name));
        parts.extend(points::hairs(cx, target, i, (root, &path), curves)?);
    }
    Ok(parts)
}

/// Writes the twins of an asset's tracked instancers under `root`.
pub(super) fn define_twins(cx: &Context, target: &mut Target, root: &str, asset: &Asset) -> Result<Vec<Box<dyn Part>>> {
    let mut names = Names::default();
    let mut parts = Vec::new();
    for (i, instances) in asset.instancers.iter().enumerate().filter(|(_, x)| x.tracked) {
        let path = format!("{root}/{}", names.unique(&instances.name));
        parts.push(instancer::twin(cx, target, i, &path, instances)?);
    }
    Ok(parts)
}
