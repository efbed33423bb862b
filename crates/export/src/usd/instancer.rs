//! Instancers of an asset as `PointInstancer`, and as `Points` with primvars (the point twin).

use std::borrow::Cow;

use glam::{Quat, Vec3};
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use super::HAIRS;
use super::arrays::{as_float3, as_ints, points_extent, sequential_ids};
use super::context::UsdContext;
use super::instancer_extent::InstancerBounds;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder, canonical_quat, nearest_quat};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMetadata, VariantSet, variant_path};
use super::mesh::{MeshTarget, VelocitySamples, define_mesh};
use super::options::Tolerance;
use super::primvar::{self, AnimatedPrimvar};
use super::sample_reduction::{SampleReducer, SampleTolerance, TimeSample};
use super::value::UsdArray;
use crate::up_axis::UpAxis;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_scene::{InstanceState, Instancer, InstancerMotion, Prototype, instance_states};

/// Variant set of prototypes with several levels of detail.
const LOD_VARIANT_SET: &str = "LOD";

/// Orientations in the axes of the stage, with the sign of each quaternion that is nearest to that of the frame before.
pub(crate) fn continuous_stage_orientations(up: UpAxis, state: &InstanceState, before: &[Quat]) -> Vec<Quat> {
    // Instances that had an orientation at the last frame keep its sign; new ones get w >= 0.
    let (known, new) = state.orientations.split_at(before.len().min(state.orientations.len()));
    let known = known.iter().zip(before).map(|(q, b)| nearest_quat(up.stage_quat(*q), *b));
    known.chain(new.iter().map(|q| canonical_quat(up.stage_quat(*q)))).collect()
}

/// Quaternions rounded to half precision, as `quath` stores them.
pub(crate) fn to_quath(orientations: &[Quat]) -> Vec<[f16; 4]> {
    let mut out = vec![[f16::ZERO; 4]; orientations.len()];
    out.as_flattened_mut().convert_from_f32_slice(bytemuck::cast_slice(orientations));
    out
}

/// Scales of all instances in a state, in the axes of the stage.
fn scales_on_stage_axes(up: UpAxis, instancer: &Instancer, state: &InstanceState) -> Vec<Vec3> {
    instancer.scales.iter().enumerate().map(|(i, s)| up.stage_scale(*s * state.size(i))).collect()
}

/// Angular velocities, rad/s, in the unit and the axes of the stage: degrees per second.
fn degrees_per_second(up: UpAxis, v: &[Vec3]) -> Vec<[f32; 3]> {
    // An angular velocity is an axial vector; the change of axes is a rotation, so it transforms as any other vector.
    let factor = 180.0 / std::f32::consts::PI;
    v.iter().map(|w| (up.stage_vec(*w) * factor).to_array()).collect()
}

/// A `PointInstancer` that takes time samples.
pub(super) struct AnimatedInstancer {
    /// Index of the instancer in its asset.
    index: usize,
    path: String,
    positions: AttrHandle,
    orientations: AttrHandle,
    extent: AttrHandle,
    invisible: Option<AttrHandle>,
    scales: AttrHandle,
    velocities: VelocitySamples,
    angular: VelocitySamples,
    /// Primvars of the attributes seen so far; the primvars of tracked instances are on their point twin.
    primvars: Vec<AnimatedPrimvar>,
    /// Orientations of the frame before, in the axes of the stage.
    before: Vec<Quat>,
    boxes: InstancerBounds,
    /// Reducers that omit the samples that interpolation restores. `None` for instances that are tracked one by one, and from the
    /// first frame with velocities, as these belong to the positions of their frame.
    reducers: Option<InstanceReducers>,
    /// Box of the instances over all frames so far, in the axes of the stage.
    clip_bounds: Bounds,
}

/// Reduces the time samples of each attribute separately: their times may differ, and often one
/// attribute changes less than the others.
pub(super) struct InstanceReducers {
    positions: SampleReducer<Vec3>,
    orientations: SampleReducer<Quat>,
    /// Used only for instances whose size changes.
    scales: SampleReducer<Vec3>,
}

/// Samples that the reducers have returned for writing, at most one for each attribute.
#[derive(Default)]
pub(super) struct DueSamples {
    pub(super) positions: Option<TimeSample<Vec3>>,
    pub(super) orientations: Option<TimeSample<Quat>>,
    pub(super) scales: Option<TimeSample<Vec3>>,
}

/// Transforms of the instances at a frame, in the axes of the stage.
pub(super) struct InstanceSample<'a> {
    time: f64,
    positions: Cow<'a, [Vec3]>,
    orientations: Vec<Quat>,
    /// `None` if their size does not change.
    scales: Option<Vec<Vec3>>,
    alive: &'a [bool],
}

impl<'a> InstanceSample<'a> {
    /// `before`: orientations of the frame before, in the axes of the stage.
    pub(super) fn of(up: UpAxis, instancer: &Instancer, state: &'a InstanceState, before: &[Quat], time: f64) -> Self {
        Self {
            time,
            positions: up.stage_vecs(&state.positions),
            orientations: continuous_stage_orientations(up, state, before),
            scales: (!state.sizes.is_empty()).then(|| scales_on_stage_axes(up, instancer, state)),
            alive: &state.alive,
        }
    }

    /// The orientations, for the sample of the next frame.
    pub(super) fn into_orientations(self) -> Vec<Quat> {
        self.orientations
    }
}

impl InstanceReducers {
    /// Derives tolerances from the sizes of the prototypes. `pixel`: see [`InstancerInput::pixel`].
    pub(super) fn new(tolerance: &Tolerance, instancer: &Instancer, pixel: f32) -> Self {
        let seen = tolerance.pixels * pixel;
        // A rotation moves the far end of an instance: the corner of its prototype's box that is farthest from its origin.
        let far =
            |b: Bounds| if b.is_empty() { 0.0 } else { b.corners().map(Vec3::length).into_iter().fold(0.0, f32::max) };
        let reach: Vec<f32> = instancer.prototypes.iter().map(|p| far(p.bounds())).collect();
        let lever = |(s, p): (&Vec3, &u32)| reach.get(*p as usize).copied().unwrap_or(0.0) * s.abs().max_element();
        let levers = instancer.scales.iter().zip(&instancer.protos).map(lever).collect();
        let reaches: Vec<f32> =
            instancer.protos.iter().map(|p| reach.get(*p as usize).copied().unwrap_or(0.0)).collect();
        let longest = reach.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        Self {
            positions: SampleReducer::new(SampleTolerance { strict: tolerance.metres, seen, levers: Vec::new() }),
            orientations: SampleReducer::new(SampleTolerance { strict: tolerance.radians, seen, levers }),
            // A scale error of `metres` / (longest reach) moves the far end by `metres`.
            scales: SampleReducer::new(SampleTolerance { strict: tolerance.metres / longest, seen, levers: reaches }),
        }
    }

    /// Takes a frame; returns the samples that must be written now.
    pub(super) fn push(&mut self, sample: &InstanceSample<'_>) -> DueSamples {
        let time = sample.time;
        // Hidden instances may have any transform.
        let unseen: Vec<bool> = sample.alive.iter().map(|alive| !alive).collect();
        let scales = sample
            .scales
            .as_ref()
            .and_then(|scales| self.scales.push(TimeSample { time, values: scales.clone(), unseen: unseen.clone() }));
        let orientations = TimeSample { time, values: sample.orientations.clone(), unseen: unseen.clone() };
        DueSamples {
            positions: self.positions.push(TimeSample { time, values: sample.positions.to_vec(), unseen }),
            orientations: self.orientations.push(orientations),
            scales,
        }
    }

    /// The samples of the last frame, if they were not yet written.
    pub(super) fn finish(&mut self) -> DueSamples {
        DueSamples {
            positions: self.positions.finish(),
            orientations: self.orientations.finish(),
            scales: self.scales.finish(),
        }
    }
}

/// Input of [`define_instancer`]: an instancer and the visibility of errors in its place.
#[derive(Clone, Copy)]
pub(super) struct InstancerInput<'a> {
    /// Index in the instancers of its asset.
    pub(super) index: usize,
    pub(super) instancer: &'a Instancer,
    /// Pixel footprint at the asset, m; 0 if errors of any size are visible.
    pub(super) pixel: f32,
}

/// Defines an instancer in its rest state, with its prototypes. Returns the prim that takes its time samples, if it moves.
pub(super) fn define_instancer(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    source: InstancerInput<'_>,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    let InstancerInput { index, instancer, pixel } = source;
    // Orientations are half precision (`quath`), and the extent is computed from the rounded ones, as readers will.
    layer.define_plain_prim(path, "PointInstancer")?;
    let up = cx.up;
    let n = instancer.len();
    let boxes = InstancerBounds::of(instancer, up);
    let before = continuous_stage_orientations(up, &instancer.rest, &[]);
    let orientations = to_quath(&before);
    let protos = as_ints(&instancer.protos, "prototypes of an instancer")?;
    let scales = scales_on_stage_axes(up, instancer, &instancer.rest);
    let b = boxes.extent(&orientations, &up.stage_vecs(&instancer.rest.positions), &instancer.rest);
    let hidden = invisible_ids(instancer, &instancer.rest);
    let set = |layer: &mut LayerBuilder, name: &str, type_name, array: UsdArray| {
        layer.set_attr(&format!("{path}.{name}"), type_name, array.into())
    };
    let extent = set(layer, "extent", "float3[]", UsdArray::Float3(&b))?;
    set(layer, "ids", "int64[]", UsdArray::Int64(&sequential_ids(n)))?;
    // An instance keeps its index for the whole clip; instances that are not alive at a frame are listed as invisible.
    // Instances attached to joints always live: if none is hidden, the attribute is omitted.
    let may_hide = instancer.motion == InstancerMotion::Free || !hidden.is_empty();
    let invisible = may_hide.then(|| set(layer, "invisibleIds", "int64[]", UsdArray::Int64(&hidden))).transpose()?;
    let orientations = set(layer, "orientations", "quath[]", UsdArray::Quath(&orientations))?;
    let positions =
        set(layer, "positions", "point3f[]", UsdArray::Float3(as_float3(&up.stage_vecs(&instancer.rest.positions))))?;
    set(layer, "protoIndices", "int[]", UsdArray::Int(protos))?;
    let scales = set(layer, "scales", "float3[]", UsdArray::Float3(as_float3(&scales)))?;
    let primvars =
        if instancer.tracked { Vec::new() } else { primvar::define_all(layer, path, &instancer.rest.attributes, up)? };
    define_prototypes(cx, layer, root, path, instancer)?;
    if instancer.motion == InstancerMotion::Still {
        return Ok(None);
    }
    Ok(Some(Box::new(AnimatedInstancer {
        index,
        path: path.to_owned(),
        positions,
        orientations,
        extent,
        invisible,
        scales,
        velocities: VelocitySamples::default(),
        angular: VelocitySamples::default(),
        primvars,
        before,
        boxes,
        reducers: (!instancer.tracked).then(|| InstanceReducers::new(&cx.tolerance, instancer, pixel)),
        clip_bounds: Bounds::default(),
    })))
}

/// Defines the scope of prototypes and a prim for each: a mesh, a prim with mesh and curves, or one with levels of detail.
fn define_prototypes(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    instancer: &Instancer,
) -> Result<()> {
    let names: Vec<String> = (0..instancer.prototypes.len()).map(|i| format!("{path}/Prototypes/p{i:03}")).collect();
    layer.writer.create_relationship(&format!("{path}.prototypes"), &names)?;
    layer.define_plain_prim(&format!("{path}/Prototypes"), "Scope")?;
    for (name, proto) in names.iter().zip(&instancer.prototypes) {
        if !proto.others.is_empty() {
            define_lod_variants(cx, layer, root, name, proto)?;
            continue;
        }
        match &proto.fine {
            Some(_) => layer
                .define_plain_prim(name, "Xform")
                .and_then(|()| define_prototype_contents(cx, layer, root, name, proto))?,
            None => {
                let place = MeshTarget { root, path: name, skinned: false, varying: false };
                define_mesh(cx, layer, &place, &proto.mesh).map(|_| ())?;
            }
        }
    }
    Ok(())
}

/// Defines the levels of detail of a prototype as variants of one prim; the level of `proto` is selected.
fn define_lod_variants(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    proto: &Prototype,
) -> Result<()> {
    let mut all: Vec<&Prototype> = std::iter::once(proto).chain(&proto.others).collect();
    // Ordered by the name of the level, whichever of them is selected, so that the variants do not depend on the selection.
    all.sort_by(|a, b| a.level.cmp(&b.level));
    let names = all.iter().map(|p| p.level.clone()).collect();
    let variants = Some(VariantSet { set: LOD_VARIANT_SET, names, selection: proto.level.clone() });
    layer.writer.define_prim(path, "Xform", &PrimMetadata { variants, ..PrimMetadata::default() })?;
    all.into_iter()
        .try_for_each(|p| define_prototype_contents(cx, layer, root, &variant_path(path, LOD_VARIANT_SET, &p.level), p))
}

/// Defines the contents of a prototype below a prim: its mesh, or, if it has fine geometry, that mesh and the curves.
fn define_prototype_contents(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    proto: &Prototype,
) -> Result<()> {
    let mesh = proto.fine.as_ref().map_or(&proto.mesh, |fine| &fine.mesh);
    if !mesh.triangles.is_empty() {
        let path = format!("{path}/body");
        define_mesh(cx, layer, &MeshTarget { root, path: &path, skinned: false, varying: false }, mesh)?;
    }
    match &proto.fine {
        Some(fine) => {
            super::points::define_curves(cx, layer, 0, root, &format!("{path}/{HAIRS}"), &fine.curves).map(|_| ())
        }
        None => Ok(()),
    }
}

/// Ids of the instances that are not alive in a state.
fn invisible_ids(instancer: &Instancer, state: &InstanceState) -> Vec<i64> {
    // Ids are the indices of the instances, as `ids` of the instancer lists them.
    let ids = state.alive.iter().take(instancer.len()).zip(0..);
    ids.filter(|(alive, _)| !**alive).map(|(_, id)| id).collect()
}

impl AnimatedInstancer {
    fn write_reduced_samples(&self, layer: &mut LayerBuilder, due: DueSamples) -> Result<()> {
        if let Some(TimeSample { time, values, .. }) = due.orientations {
            layer.writer.set_time_sample(self.orientations, time, UsdArray::Quath(&to_quath(&values)).into())?;
        }
        let vectors = [(self.positions, due.positions), (self.scales, due.scales)];
        for (attr, TimeSample { time, values, .. }) in vectors.into_iter().filter_map(|(a, s)| Some((a, s?))) {
            layer.writer.set_time_sample(attr, time, UsdArray::Float3(as_float3(&values)).into())?;
        }
        Ok(())
    }
}

impl AnimatedPrim for AnimatedInstancer {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(instancer) = sample.asset.instancers.get(self.index) else { return Ok(()) };
        let (up, time) = (cx.up, sample.time);
        let state = instance_states(sample.asset, instancer, self.index, sample.state);
        let now = InstanceSample::of(up, instancer, &state, &self.before, time);
        let orientations = to_quath(&now.orientations);
        let b = self.boxes.extent(&orientations, &now.positions, &state);
        self.clip_bounds = self.clip_bounds.union(Bounds::of(b.map(Vec3::from_array)));
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.extent, UsdArray::Float3(&b))?;
        if let Some(invisible) = self.invisible {
            sample(invisible, UsdArray::Int64(&invisible_ids(instancer, &state)))?;
        }
        if !state.velocities.is_empty() {
            self.flush_samples(layer)?;
            self.reducers = None;
        }
        if let Some(reducers) = &mut self.reducers {
            let due = reducers.push(&now);
            self.write_reduced_samples(layer, due)?;
        } else {
            let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
            if let Some(scales) = &now.scales {
                sample(self.scales, UsdArray::Float3(as_float3(scales)))?;
            }
            sample(self.orientations, UsdArray::Quath(&orientations))?;
            sample(self.positions, UsdArray::Float3(as_float3(&now.positions)))?;
        }
        self.before = now.into_orientations();
        let count = instancer.len();
        let velocities = up.stage_vecs(&state.velocities);
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&velocities), count, time)?;
        let angular = degrees_per_second(up, &state.angular_velocities);
        self.angular.sample(layer, &format!("{}.angularVelocities", self.path), &angular, count, time)?;
        if instancer.tracked {
            return Ok(());
        }
        // A primvar is defined by the first frame that has values for it.
        for a in state.attributes.iter().filter(|a| !a.data.is_empty()) {
            if !self.primvars.iter().any(|p| p.name == a.name) {
                self.primvars.push(AnimatedPrimvar::define_without_default(layer, &self.path, a, up)?);
            }
        }
        let mut present = self.primvars.iter().filter(|p| p.has_values_in(&state.attributes));
        present.try_for_each(|p| p.sample(layer, time, &state.attributes))
    }

    fn flush_samples(&mut self, layer: &mut LayerBuilder) -> Result<()> {
        let Some(reducers) = &mut self.reducers else { return Ok(()) };
        let due = reducers.finish();
        self.write_reduced_samples(layer, due)
    }

    fn clip_bounds(&self) -> Bounds {
        self.clip_bounds
    }
}

/// The instances of an instancer as a `Points` prim with orientation, scale, prototype and other attributes as primvars. Blender
/// imports them, while its import of a `PointInstancer` loses them.
pub(super) struct PointTwin {
    /// Index of the instancer in its asset.
    index: usize,
    path: String,
    extent: AttrHandle,
    points: AttrHandle,
    widths: AttrHandle,
    orient: AttrHandle,
    velocities: VelocitySamples,
    before: Vec<Quat>,
    /// Primvars of the attributes of the instances.
    primvars: Vec<AnimatedPrimvar>,
    /// Diameter of each instance at size 1, m.
    diameters: Vec<f32>,
    scale: AttrHandle,
}

/// Diameter of each instance: the longest side of its prototype's box, scaled.
fn diameters(instancer: &Instancer) -> Vec<f32> {
    let sides: Vec<Vec3> = instancer.prototypes.iter().map(|p| p.bounds().size()).collect();
    let width = |(s, p): (&Vec3, &u32)| sides.get(*p as usize).map_or(0.0, |side| (*side * s.abs()).max_element());
    instancer.scales.iter().zip(&instancer.protos).map(width).collect()
}

/// Widths of the points: the instances' diameters, 0 for those not alive.
fn visible_widths(diameters: &[f32], state: &InstanceState) -> Vec<f32> {
    diameters.iter().enumerate().map(|(i, d)| if state.is_alive(i) { *d * state.size(i) } else { 0.0 }).collect()
}

/// Defines the point twin of an instancer in its rest state.
pub(super) fn define_instancer_points(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    path: &str,
    instancer: &Instancer,
) -> Result<Box<dyn AnimatedPrim>> {
    // A point is as wide as its prototype's box at the instance's scale; readers that show points as spheres show the size.
    layer.define_plain_prim(path, "Points")?;
    let up = cx.up;
    let diameters = diameters(instancer);
    let before = continuous_stage_orientations(up, &instancer.rest, &[]);
    let points = up.stage_vecs(&instancer.rest.positions);
    let visible = visible_widths(&diameters, &instancer.rest);
    let protos = as_ints(&instancer.protos, "prototypes of an instancer")?;
    let scales = scales_on_stage_axes(up, instancer, &instancer.rest);
    let b = points_extent(&points, &visible);
    let extent = layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    layer.set_attr(&format!("{path}.ids"), "int64[]", UsdArray::Int64(&sequential_ids(instancer.len())).into())?;
    let primvar = |layer: &mut LayerBuilder, name: &str, type_name, array: UsdArray| {
        let spec = AttrSpec::primvar(type_name, "vertex");
        layer.writer.create_attr(&format!("{path}.{name}"), &spec, Some(array.into()))
    };
    let orient = primvar(layer, "primvars:orient", "quatf[]", UsdArray::Quatf(bytemuck::cast_slice(&before)))?;
    primvar(layer, "primvars:proto", "int[]", UsdArray::Int(protos))?;
    let scale = primvar(layer, "primvars:scale", "float3[]", UsdArray::Float3(as_float3(&scales)))?;
    let primvars = primvar::define_all(layer, path, &instancer.rest.attributes, up)?;
    let widths = primvar(layer, "widths", "float[]", UsdArray::Float(&visible))?;
    let points = layer.set_attr(&format!("{path}.points"), "point3f[]", UsdArray::Float3(as_float3(&points)).into())?;
    let velocities = VelocitySamples::default();
    Ok(Box::new(PointTwin {
        index,
        path: path.to_owned(),
        extent,
        points,
        widths,
        orient,
        velocities,
        before,
        primvars,
        diameters,
        scale,
    }))
}

impl AnimatedPrim for PointTwin {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(instancer) = sample.asset.instancers.get(self.index) else { return Ok(()) };
        let (up, time) = (cx.up, sample.time);
        let state = instance_states(sample.asset, instancer, self.index, sample.state);
        self.before = continuous_stage_orientations(up, &state, &self.before);
        let points = up.stage_vecs(&state.positions);
        let visible = visible_widths(&self.diameters, &state);
        let b = points_extent(&points, &visible);
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.extent, UsdArray::Float3(&b))?;
        sample(self.orient, UsdArray::Quatf(bytemuck::cast_slice(&self.before)))?;
        if !state.sizes.is_empty() {
            sample(self.scale, UsdArray::Float3(as_float3(&scales_on_stage_axes(up, instancer, &state))))?;
        }
        sample(self.widths, UsdArray::Float(&visible))?;
        sample(self.points, UsdArray::Float3(as_float3(&points)))?;
        let mut present = self.primvars.iter().filter(|p| p.has_values_in(&state.attributes));
        present.try_for_each(|p| p.sample(layer, time, &state.attributes))?;
        let velocities = up.stage_vecs(&state.velocities);
        let count = instancer.len();
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&velocities), count, time)
    }
}
