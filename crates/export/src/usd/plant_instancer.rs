//! The placements of a scene: separate prims, or instances of one `PointInstancer` for each plant with copies.

use std::collections::{BTreeMap, BTreeSet};

use half::f16;

use super::arrays::sequential_ids;
use super::context::UsdContext;
use super::layer::{LayerBuilder, canonical_quat};
use super::layer_writer::{AttrSpec, PrimMetadata};
use super::value::UsdArray;
use crate::up_axis::{UpAxis, extent_corners};
use crate::vdb::volume_files;
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::files::{Names, safe_name};
use osier_base::geometry::Bounds;
use osier_scene::{Placement, Scene, Trs};

/// Names below the root of a scene that placements must not take, in addition to the names of its volumes.
const RESERVED: [&str; 5] = ["camera", "sun", "sky", "fog", "mtl"];

/// A prototype of a plant's instancer: an individual at a phase of the clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PhasedAsset {
    /// Index in the scene's assets.
    pub(super) asset: usize,
    /// Frames by which its motion is ahead of the clip.
    pub(super) phase: u32,
}

/// A prototype and the path of its prim, below the scope `Prototypes` of the instancer.
#[derive(Debug)]
pub(super) struct PrototypePrim {
    pub(super) prototype: PhasedAsset,
    pub(super) path: String,
}

/// A placement, and the index of its prototype in [`PlantInstancer::prototypes`].
#[derive(Debug)]
struct PlantInstance<'a> {
    placement: &'a Placement,
    prototype: usize,
}

/// The instancer with all placements of a plant that has copies.
#[derive(Debug)]
pub(super) struct PlantInstancer<'a> {
    /// Path of the `PointInstancer` prim in the layer.
    pub(super) path: String,
    pub(super) prototypes: Vec<PrototypePrim>,
    instances: Vec<PlantInstance<'a>>,
}

/// A placement with a separate prim, outside of all instancers.
#[derive(Debug)]
pub(super) struct SinglePlacement<'a> {
    /// Path of its prim in the layer.
    pub(super) path: String,
    pub(super) placement: &'a Placement,
}

/// Division of the placements of a scene into instancers and separate prims.
#[derive(Debug, Default)]
pub(super) struct PlacementPlan<'a> {
    /// One per plant with copies, in the order of their first placements.
    pub(super) instancers: Vec<PlantInstancer<'a>>,
    /// All other placements, in order.
    pub(super) singles: Vec<SinglePlacement<'a>>,
}

/// Divides the placements of a scene below `root` into instancers and separate prims. A plant has copies if one of its
/// individuals has several placements. `instancers`: if false, every placement has a separate prim.
pub(super) fn plan_placements<'a>(scene: &'a Scene, root: &str, instancers: bool) -> PlacementPlan<'a> {
    let copied: BTreeSet<&str> = if instancers { groups_with_copies(scene) } else { BTreeSet::new() };
    let mut names = Names::default();
    // Reserved names are taken first, so that a placement of that name gets a number.
    RESERVED.into_iter().chain(volume_files(scene)).for_each(|name| drop(names.unique(name)));
    let mut plan = PlacementPlan::default();
    let mut known: BTreeMap<&str, usize> = BTreeMap::new();
    for placement in &scene.placements {
        let group = scene.assets.get(placement.asset).map_or("", |a| a.group.as_str());
        if !copied.contains(group) {
            plan.singles.push(SinglePlacement { path: format!("{root}/{}", names.unique(&placement.name)), placement });
            continue;
        }
        let index = *known.entry(group).or_insert_with(|| {
            let path = format!("{root}/{}", names.unique(group));
            plan.instancers.push(PlantInstancer { path, prototypes: Vec::new(), instances: Vec::new() });
            plan.instancers.len() - 1
        });
        if let Some(instancer) = plan.instancers.get_mut(index) {
            instancer.instances.push(PlantInstance { placement, prototype: 0 });
        }
    }
    plan.instancers.iter_mut().for_each(|instancer| instancer.assign_prototypes(scene));
    plan
}

/// Names of the plants of which an individual has several placements.
fn groups_with_copies(scene: &Scene) -> BTreeSet<&str> {
    let mut seen = BTreeSet::new();
    // `insert` returns false for an asset that was seen before: these are the second and further placements.
    let repeated = scene.placements.iter().filter(|p| !seen.insert(p.asset));
    let groups = repeated.filter_map(|p| scene.assets.get(p.asset)).map(|a| a.group.as_str());
    groups.filter(|group| !group.is_empty()).collect()
}

impl PlantInstancer<'_> {
    /// Numbers the distinct prototypes, ordered by individual and phase, and names their prims.
    fn assign_prototypes(&mut self, scene: &Scene) {
        let prototype_of = |p: &Placement| PhasedAsset { asset: p.asset, phase: p.phase };
        let distinct: BTreeSet<PhasedAsset> = self.instances.iter().map(|i| prototype_of(i.placement)).collect();
        let index: BTreeMap<PhasedAsset, usize> = distinct.iter().enumerate().map(|(i, p)| (*p, i)).collect();
        for instance in &mut self.instances {
            instance.prototype = index.get(&prototype_of(instance.placement)).copied().unwrap_or_default();
        }
        // Phases are padded to the digits of the clip's length, so that names sort as phases do.
        let width = scene.clip.len().to_string().len().max(2);
        let path = |p: &PhasedAsset| {
            let id = scene.assets.get(p.asset).map_or("plant", |a| &a.id);
            format!("{}/Prototypes/{}_p{:0width$}", self.path, safe_name(id), p.phase)
        };
        self.prototypes = distinct.iter().map(|p| PrototypePrim { prototype: *p, path: path(p) }).collect();
    }

    /// Defines the instancer and the scope of its prototypes; the caller defines the prototypes in it.
    pub(super) fn define(&self, layer: &mut LayerBuilder) -> Result<()> {
        let meta = PrimMetadata { kind: Some("group"), ..PrimMetadata::default() };
        layer.writer.define_prim(&self.path, "PointInstancer", &meta)?;
        layer.define_plain_prim(&format!("{}/Prototypes", self.path), "Scope")
    }

    /// Writes the transforms and prototypes of the instances, and the extent. `clip_bounds`: the box of each asset over the whole
    /// clip, in the asset's space with the stage's axes.
    pub(super) fn write_instance_arrays(
        &self,
        cx: &UsdContext,
        layer: &mut LayerBuilder,
        clip_bounds: &[Bounds],
    ) -> Result<()> {
        let transforms: Vec<Trs> = self.instances.iter().map(|i| cx.up.stage_trs(&i.placement.transform)).collect();
        let mut around = Bounds::default();
        for (instance, transform) in self.instances.iter().zip(&transforms) {
            let local = clip_bounds.get(instance.placement.asset).copied().unwrap_or_default();
            if !local.is_empty() {
                // A rotated box is bounded by its eight transformed corners.
                around = around.union(Bounds::of(local.corners().map(|c| transform.apply(c))));
            }
        }
        let orientations: Vec<[f16; 4]> =
            transforms.iter().map(|m| canonical_quat(m.r).to_array().map(f16::from_f32)).collect();
        let positions: Vec<[f32; 3]> = transforms.iter().map(|m| m.t.to_array()).collect();
        let scales: Vec<[f32; 3]> = transforms.iter().map(|m| m.s.to_array()).collect();
        let protos: Vec<i32> =
            self.instances.iter().map(|i| narrow(i.prototype, "prototypes of an instancer")).collect::<Result<_>>()?;
        let mut set = |name: &str, type_name, array: UsdArray| {
            layer.set_attr(&format!("{}.{name}", self.path), type_name, array.into()).map(|_| ())
        };
        set("extent", "float3[]", UsdArray::Float3(&extent_corners(&around)))?;
        set("ids", "int64[]", UsdArray::Int64(&sequential_ids(self.instances.len())))?;
        set("orientations", "quath[]", UsdArray::Quath(&orientations))?;
        set("positions", "point3f[]", UsdArray::Float3(&positions))?;
        set("protoIndices", "int[]", UsdArray::Int(&protos))?;
        set("scales", "float3[]", UsdArray::Float3(&scales))?;
        // The phase of each instance, in seconds, for programs that shift the motion themselves.
        let fps = cx.scene.clip.fps();
        let phases: Vec<f32> =
            self.instances.iter().map(|i| osier_base::math::narrow(f64::from(i.placement.phase) / fps)).collect();
        let path = format!("{}.primvars:phase", self.path);
        layer.writer.create_attr(
            &path,
            &AttrSpec::primvar("float[]", "vertex"),
            Some(UsdArray::Float(&phases).into()),
        )?;
        let paths: Vec<String> = self.prototypes.iter().map(|p| p.path.clone()).collect();
        layer.writer.create_relationship(&format!("{}.prototypes", self.path), &paths)
    }
}

/// Converts a box from the axes of the scene to those of the stage; an empty box stays empty.
pub(super) fn stage_bounds(up: UpAxis, b: &Bounds) -> Bounds {
    if b.is_empty() { Bounds::default() } else { Bounds::of([up.stage_vec(b.min), up.stage_vec(b.max)]) }
}
