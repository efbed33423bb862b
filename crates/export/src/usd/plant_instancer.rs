//! PlantInstancer of a plant as one point instancer whose prototypes are whole plants, skeleton, bark and nested instancers of leaves
//! included: one prototype for each individual and phase of its motion.
//!
//! A phase is a layer offset of the individual's one payload, so that it costs a prim and no samples.

use std::collections::{BTreeMap, BTreeSet};

use half::f16;

use super::axis::{UpAxis, extent};
use super::instancer::sequential_ids;
use super::layer::{LayerBuilder, UsdContext, canonical_quat};
use super::layer_writer::{AttrSpec, PrimMeta};
use super::value::UsdArray;
use osier_base::Result;
use osier_base::files::{Names, safe_name};
use osier_base::geometry::Bounds;
use osier_scene::{Placement, Scene, Trs};

/// Names under the root of a scene that are not those of placements.
const RESERVED: [&str; 5] = ["camera", "sun", "sky", "fog", "mtl"];

/// What an instancer of copies shows: an individual at a phase of the clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PlantPrototype {
    /// Index of the asset.
    pub(super) asset: usize,
    /// Frames by which it is ahead of the clip.
    pub(super) phase: u32,
}

/// All placements of a plant that has copies.
#[derive(Debug)]
pub(super) struct PlantInstancer<'a> {
    /// Path of the instancer.
    pub(super) path: String,
    /// What is shown, with the path of its prim.
    pub(super) prototypes: Vec<(PlantPrototype, String)>,
    /// The copies, each with the index of its prototype.
    members: Vec<(&'a Placement, usize)>,
}

/// A placement that is a prim of its own.
#[derive(Debug)]
pub(super) struct SinglePlacement<'a> {
    /// Path of its prim.
    pub(super) path: String,
    /// What stands there.
    pub(super) placement: &'a Placement,
}

/// How the placements of a scene are written.
#[derive(Debug, Default)]
pub(super) struct PlacementPlan<'a> {
    /// One per plant with copies, in the order of their first placements.
    pub(super) instancers: Vec<PlantInstancer<'a>>,
    /// All other placements, in order.
    pub(super) singles: Vec<SinglePlacement<'a>>,
}

/// Sorts the placements of a scene under `root` into instancers of copies and prims of their own. A plant has copies if one of
/// its individuals stands in several places. `instancers`: false makes every placement a prim of its own.
pub(super) fn plan_placements<'a>(scene: &'a Scene, root: &str, instancers: bool) -> PlacementPlan<'a> {
    let copied: BTreeSet<&str> = if instancers { groups_with_copies(scene) } else { BTreeSet::new() };
    let mut names = Names::default();
    RESERVED.iter().for_each(|name| drop(names.unique(name)));
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
            plan.instancers.push(PlantInstancer { path, prototypes: Vec::new(), members: Vec::new() });
            plan.instancers.len() - 1
        });
        if let Some(copies) = plan.instancers.get_mut(index) {
            copies.members.push((placement, 0));
        }
    }
    plan.instancers.iter_mut().for_each(|copies| copies.assign_prototypes(scene));
    plan
}

/// Names of the plants of which an individual stands in several places.
fn groups_with_copies(scene: &Scene) -> BTreeSet<&str> {
    let mut seen = BTreeSet::new();
    let again = scene.placements.iter().filter(|p| !seen.insert(p.asset));
    let groups = again.filter_map(|p| scene.assets.get(p.asset)).map(|a| a.group.as_str());
    groups.filter(|group| !group.is_empty()).collect()
}

impl PlantInstancer<'_> {
    /// Numbers the prototypes, ordered by individual and phase, and names their prims.
    fn assign_prototypes(&mut self, scene: &Scene) {
        let of = |p: &Placement| PlantPrototype { asset: p.asset, phase: p.phase };
        let shown: BTreeSet<PlantPrototype> = self.members.iter().map(|(p, _)| of(p)).collect();
        let index: BTreeMap<PlantPrototype, usize> = shown.iter().enumerate().map(|(i, s)| (*s, i)).collect();
        for (placement, prototype) in &mut self.members {
            *prototype = index.get(&of(placement)).copied().unwrap_or_default();
        }
        let width = scene.clip.len().to_string().len().max(2);
        let name = |s: &PlantPrototype| {
            let id = scene.assets.get(s.asset).map_or("plant", |a| &a.id);
            format!("{}/Prototypes/{}_p{:0width$}", self.path, safe_name(id), s.phase)
        };
        self.prototypes = shown.iter().map(|s| (*s, name(s))).collect();
    }

    /// Makes the instancer and the scope of its prototypes; the prototypes are the caller's.
    pub(super) fn define(&self, layer: &mut LayerBuilder) -> Result<()> {
        let meta = PrimMeta { kind: Some("group"), ..PrimMeta::default() };
        layer.writer.define_prim(&self.path, "PointInstancer", &meta)?;
        layer.define_prim(&format!("{}/Prototypes", self.path), "Scope")
    }

    /// Writes where the copies stand. `reach`: the box of each asset over the whole clip, in its own space of the stage.
    pub(super) fn write_instances(&self, cx: &UsdContext, layer: &mut LayerBuilder, reach: &[Bounds]) -> Result<()> {
        let stands: Vec<Trs> = self.members.iter().map(|(p, _)| cx.up.trs(&p.transform)).collect();
        let box_of = |((placement, _), stand): (&(&Placement, usize), &Trs)| {
            let local = reach.get(placement.asset).copied().unwrap_or_default();
            let corners = (!local.is_empty()).then(|| Bounds::of(local.corners().map(|c| stand.apply(c))));
            corners.unwrap_or_default()
        };
        let around = self.members.iter().zip(&stands).map(box_of).fold(Bounds::default(), Bounds::union);
        let orientations: Vec<[f16; 4]> =
            stands.iter().map(|s| canonical_quat(s.r).to_array().map(f16::from_f32)).collect();
        let positions: Vec<[f32; 3]> = stands.iter().map(|s| s.t.to_array()).collect();
        let scales: Vec<[f32; 3]> = stands.iter().map(|s| s.s.to_array()).collect();
        let protos: Vec<i32> = self.members.iter().map(|(_, k)| i32::try_from(*k).unwrap_or(i32::MAX)).collect();
        let mut set = |name: &str, type_name, array: UsdArray| {
            layer.set_attr(&format!("{}.{name}", self.path), type_name, array.into()).map(|_| ())
        };
        set("extent", "float3[]", UsdArray::Float3(&extent(&around)))?;
        set("ids", "int64[]", UsdArray::Int64(&sequential_ids(self.members.len())))?;
        set("orientations", "quath[]", UsdArray::Quath(&orientations))?;
        set("positions", "point3f[]", UsdArray::Float3(&positions))?;
        set("protoIndices", "int[]", UsdArray::Int(&protos))?;
        set("scales", "float3[]", UsdArray::Float3(&scales))?;
        let fps = cx.scene.clip.fps();
        let phases: Vec<f32> =
            self.members.iter().map(|(p, _)| osier_base::math::narrow(f64::from(p.phase) / fps)).collect();
        let path = format!("{}.primvars:phase", self.path);
        layer.writer.create_attr(
            &path,
            &AttrSpec::primvar("float[]", "vertex"),
            Some(UsdArray::Float(&phases).into()),
        )?;
        let paths: Vec<String> = self.prototypes.iter().map(|(_, path)| path.clone()).collect();
        layer.writer.create_relationship(&format!("{}.prototypes", self.path), &paths)
    }
}

/// A box in the space of the stage.
pub(super) fn stage_bounds(up: UpAxis, b: &Bounds) -> Bounds {
    if b.is_empty() { Bounds::default() } else { Bounds::of([up.vec(b.min), up.vec(b.max)]) }
}
