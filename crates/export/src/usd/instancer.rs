//! Repeated meshes as PointInstancer, and their twin as Points.

use glam::{Quat, Vec3};
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use super::axis::{UpAxis, extent};
use super::instancer_extent::PrototypeBoxes;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder, UsdContext, canonical_quat, nearest_quat};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMeta, VariantSet, variant_path};
use super::mesh::{MeshPrim, VelocityAttr, define_mesh};
use super::sample_reduction::{SampleReducer, TimeSample};
use super::value::UsdArray;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_scene::{InstanceState, Instancer, InstancerMotion, Prototype, instance_states};

/// Variant set of prototypes with several levels of detail.
const LOD_VARIANT_SET: &str = "LOD";

fn as_float3(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

/// 0..n.
pub(super) fn sequential_ids(n: usize) -> Vec<i64> {
    (0..n).map(|i| i64::try_from(i).unwrap_or(i64::MAX)).collect()
}

/// Rotations in stage space, on the side of those of the frame before.
fn stage_orientations(up: UpAxis, state: &InstanceState, before: &[Quat]) -> Vec<Quat> {
    let (again, first) = state.orientations.split_at(before.len().min(state.orientations.len()));
    let again = again.iter().zip(before).map(|(q, b)| nearest_quat(up.quat(*q), *b));
    again.chain(first.iter().map(|q| canonical_quat(up.quat(*q)))).collect()
}

/// Quaternions rounded to half precision.
fn to_quath(turns: &[Quat]) -> Vec<[f16; 4]> {
    let mut out = vec![[f16::ZERO; 4]; turns.len()];
    out.as_flattened_mut().convert_from_f32_slice(bytemuck::cast_slice(turns));
    out
}

/// Angular velocities as degrees per second about an axis.
fn degrees_per_second(up: UpAxis, v: &[Vec3]) -> Vec<[f32; 3]> {
    let factor = 180.0 / std::f32::consts::PI;
    v.iter().map(|w| (up.vec(*w) * factor).to_array()).collect()
}

/// An instancer of an asset.
pub(super) struct InstancerSamples {
    index: usize,
    path: String,
    positions: AttrHandle,
    orientations: AttrHandle,
    extent: AttrHandle,
    invisible: Option<AttrHandle>,
    velocities: VelocityAttr,
    angular: VelocityAttr,
    /// Written from the first frame that tells how wet instances are.
    wetness: Option<AttrHandle>,
    before: Vec<Quat>,
    shapes: PrototypeBoxes,
    /// What waits to be left out, where instances neither come and go nor have velocities.
    thinned: Option<InstanceReducers>,
    /// Box of all frames so far.
    reach: Bounds,
}

/// Places and rotations of frames that interpolation may restore.
struct InstanceReducers {
    positions: SampleReducer<Vec3>,
    orientations: SampleReducer<Quat>,
}

/// Writes an instancer at rest.
pub(super) fn define_instancer(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    root: &str,
    path: &str,
    instancer: &Instancer,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    layer.define_prim(path, "PointInstancer")?;
    let up = cx.up;
    let n = instancer.len();
    let shapes = PrototypeBoxes::of(instancer, up);
    let before = stage_orientations(up, &instancer.rest, &[]);
    let orientations = to_quath(&before);
    let protos: Vec<i32> = instancer.protos.iter().map(|p| i32::try_from(*p).unwrap_or(i32::MAX)).collect();
    let scales: Vec<Vec3> = instancer.scales.iter().map(|s| up.scale(*s)).collect();
    let b = shapes.extent(&orientations, &up.vecs(&instancer.rest.positions), &instancer.rest.alive);
    let hidden = invisible_ids(instancer, &instancer.rest);
    let set = |layer: &mut LayerBuilder, name: &str, type_name, array: UsdArray| {
        layer.set_attr(&format!("{path}.{name}"), type_name, array.into())
    };
    let extent = set(layer, "extent", "float3[]", UsdArray::Float3(&b))?;
    set(layer, "ids", "int64[]", UsdArray::Int64(&sequential_ids(n)))?;
    let dies = instancer.motion == InstancerMotion::Free || !hidden.is_empty();
    let invisible = dies.then(|| set(layer, "invisibleIds", "int64[]", UsdArray::Int64(&hidden))).transpose()?;
    let orientations = set(layer, "orientations", "quath[]", UsdArray::Quath(&orientations))?;
    let positions =
        set(layer, "positions", "point3f[]", UsdArray::Float3(as_float3(&up.vecs(&instancer.rest.positions))))?;
    set(layer, "protoIndices", "int[]", UsdArray::Int(&protos))?;
    set(layer, "scales", "float3[]", UsdArray::Float3(as_float3(&scales)))?;
    define_prototypes(cx, layer, root, path, instancer)?;
    if instancer.motion == InstancerMotion::Still {
        return Ok(None);
    }
    Ok(Some(Box::new(InstancerSamples {
        index,
        path: path.to_owned(),
        positions,
        orientations,
        extent,
        invisible,
        velocities: VelocityAttr::default(),
        angular: VelocityAttr::default(),
        wetness: None,
        before,
        shapes,
        thinned: matches!(instancer.motion, InstancerMotion::Joints(_)).then(|| InstanceReducers {
            positions: SampleReducer::new(cx.tolerance.metres),
            orientations: SampleReducer::new(cx.tolerance.radians),
        }),
        reach: Bounds::default(),
    })))
}

fn define_prototypes(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    instancer: &Instancer,
) -> Result<()> {
    let names: Vec<String> = (0..instancer.prototypes.len()).map(|i| format!("{path}/Prototypes/p{i:03}")).collect();
    layer.writer.create_relationship(&format!("{path}.prototypes"), &names)?;
    layer.define_prim(&format!("{path}/Prototypes"), "Scope")?;
    for (name, proto) in names.iter().zip(&instancer.prototypes) {
        if !proto.others.is_empty() {
            define_lod_variants(cx, layer, root, name, proto)?;
            continue;
        }
        match &proto.fine {
            Some(_) => {
                layer.define_prim(name, "Xform").and_then(|()| define_prototype(cx, layer, root, name, proto))?
            }
            None => {
                let place = MeshPrim { root, path: name, skinned: false, varying: false };
                define_mesh(cx, layer, &place, &proto.mesh).map(|_| ())?;
            }
        }
    }
    Ok(())
}

/// Levels of detail as variants of one prim, which shows the prototype's own unless a reader chooses.
fn define_lod_variants(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    proto: &Prototype,
) -> Result<()> {
    let mut all: Vec<&Prototype> = std::iter::once(proto).chain(&proto.others).collect();
    all.sort_by(|a, b| a.level.cmp(&b.level));
    let names = all.iter().map(|p| p.level.clone()).collect();
    let variants = Some(VariantSet { set: LOD_VARIANT_SET, names, selection: proto.level.clone() });
    layer.writer.define_prim(path, "Xform", &PrimMeta { variants, ..PrimMeta::default() })?;
    all.into_iter()
        .try_for_each(|p| define_prototype(cx, layer, root, &variant_path(path, LOD_VARIANT_SET, &p.level), p))
}

/// Contents of a prototype beneath a prim: its mesh, or curves and what is not curves.
fn define_prototype(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    proto: &Prototype,
) -> Result<()> {
    let mesh = proto.fine.as_ref().map_or(&proto.mesh, |fine| &fine.mesh);
    if !mesh.triangles.is_empty() {
        let path = format!("{path}/body");
        define_mesh(cx, layer, &MeshPrim { root, path: &path, skinned: false, varying: false }, mesh)?;
    }
    match &proto.fine {
        Some(fine) => {
            super::points::define_curves(cx, layer, 0, root, &format!("{path}/hairs"), &fine.curves).map(|_| ())
        }
        None => Ok(()),
    }
}

/// Slots without a live instance.
fn invisible_ids(instancer: &Instancer, state: &InstanceState) -> Vec<i64> {
    let slots = state.alive.iter().take(instancer.len()).zip(0..);
    slots.filter(|(alive, _)| !**alive).map(|(_, slot)| slot).collect()
}

impl InstancerSamples {
    /// Takes places and the rotations of a frame, and writes those that later frames cannot restore.
    fn push_reduced(&mut self, layer: &mut LayerBuilder, time: f64, positions: Vec<Vec3>) -> Result<()> {
        let Some(waiting) = &mut self.thinned else { return Ok(()) };
        let turns = waiting.orientations.push(time, self.before.clone());
        let places = waiting.positions.push(time, positions);
        self.write_samples(layer, turns, places)
    }

    fn write_samples(
        &self,
        layer: &mut LayerBuilder,
        turns: Option<TimeSample<Quat>>,
        places: Option<TimeSample<Vec3>>,
    ) -> Result<()> {
        if let Some(TimeSample { time, values: turns }) = turns {
            layer.writer.set_time_sample(self.orientations, time, UsdArray::Quath(&to_quath(&turns)).into())?;
        }
        if let Some(TimeSample { time, values: places }) = places {
            layer.writer.set_time_sample(self.positions, time, UsdArray::Float3(as_float3(&places)).into())?;
        }
        Ok(())
    }
}

impl AnimatedPrim for InstancerSamples {
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(instancer) = sample.asset.instancers.get(self.index) else { return Ok(()) };
        let (up, time) = (cx.up, sample.time);
        let state = instance_states(sample.asset, instancer, self.index, sample.state);
        self.before = stage_orientations(up, &state, &self.before);
        let orientations = to_quath(&self.before);
        let positions = up.vecs(&state.positions);
        let b = self.shapes.extent(&orientations, &positions, &state.alive);
        self.reach = self.reach.union(Bounds::of(b.map(Vec3::from_array)));
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.extent, UsdArray::Float3(&b))?;
        if let Some(invisible) = self.invisible {
            sample(invisible, UsdArray::Int64(&invisible_ids(instancer, &state)))?;
        }
        if self.thinned.is_some() && state.velocities.is_empty() {
            self.push_reduced(layer, time, positions.into_owned())?;
        } else {
            sample(self.orientations, UsdArray::Quath(&orientations))?;
            sample(self.positions, UsdArray::Float3(as_float3(&positions)))?;
        }
        let count = instancer.len();
        let velocities = up.vecs(&state.velocities);
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&velocities), count, time)?;
        let angular = degrees_per_second(up, &state.angular_velocities);
        self.angular.sample(layer, &format!("{}.angularVelocities", self.path), &angular, count, time)?;
        if state.wetness.is_empty() {
            return Ok(());
        }
        let attr = match self.wetness {
            Some(attr) => attr,
            None => {
                let spec = AttrSpec::primvar("float[]", "vertex");
                layer.writer.create_attr(&format!("{}.primvars:wetness", self.path), &spec, None)?
            }
        };
        self.wetness = Some(attr);
        layer.writer.set_time_sample(attr, time, UsdArray::Float(&state.wetness).into())
    }

    fn finish(&mut self, layer: &mut LayerBuilder) -> Result<()> {
        let Some(waiting) = &mut self.thinned else { return Ok(()) };
        let (turns, places) = (waiting.orientations.finish(), waiting.positions.finish());
        self.write_samples(layer, turns, places)
    }

    fn reach(&self) -> Bounds {
        self.reach
    }
}

/// The instances as plain points with everything that instancers lose on the way into Blender.
pub(super) struct PointTwin {
    index: usize,
    path: String,
    extent: AttrHandle,
    points: AttrHandle,
    widths: AttrHandle,
    orient: AttrHandle,
    velocities: VelocityAttr,
    before: Vec<Quat>,
    /// One per mark of the instancer.
    marks: Vec<AttrHandle>,
    /// Diameters of the living, m.
    diameters: Vec<f32>,
}

/// Diameter of each instance: the longest side of its prototype's box, scaled.
fn diameters(instancer: &Instancer) -> Vec<f32> {
    let sides: Vec<Vec3> = instancer.prototypes.iter().map(|p| p.bounds().size()).collect();
    let width = |(s, p): (&Vec3, &u32)| sides.get(*p as usize).map_or(0.0, |side| (*side * s.abs()).max_element());
    instancer.scales.iter().zip(&instancer.protos).map(width).collect()
}

/// Diameters, 0 for those not alive.
fn widths(diameters: &[f32], state: &InstanceState) -> Vec<f32> {
    diameters.iter().enumerate().map(|(i, d)| if state.is_alive(i) { *d } else { 0.0 }).collect()
}

/// Box of points with widths.
pub(super) fn points_extent(points: &[Vec3], widths: &[f32]) -> [[f32; 3]; 2] {
    let grown = points.iter().zip(widths).map(|(p, w)| Bounds::of([*p]).grown(w * 0.5));
    extent(&grown.fold(Bounds::default(), Bounds::union))
}

/// Writes a twin at rest.
pub(super) fn define_point_twin(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    path: &str,
    instancer: &Instancer,
) -> Result<Box<dyn AnimatedPrim>> {
    layer.define_prim(path, "Points")?;
    let up = cx.up;
    let diameters = diameters(instancer);
    let before = stage_orientations(up, &instancer.rest, &[]);
    let points = up.vecs(&instancer.rest.positions);
    let shown = widths(&diameters, &instancer.rest);
    let protos: Vec<i32> = instancer.protos.iter().map(|p| i32::try_from(*p).unwrap_or(i32::MAX)).collect();
    let scales: Vec<Vec3> = instancer.scales.iter().map(|s| up.scale(*s)).collect();
    let b = points_extent(&points, &shown);
    let extent = layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    layer.set_attr(&format!("{path}.ids"), "int64[]", UsdArray::Int64(&sequential_ids(instancer.len())).into())?;
    let mut primvar = |name: &str, type_name, array: UsdArray| {
        let spec = AttrSpec::primvar(type_name, "vertex");
        layer.writer.create_attr(&format!("{path}.{name}"), &spec, Some(array.into()))
    };
    let orient = primvar("primvars:orient", "quatf[]", UsdArray::Quatf(bytemuck::cast_slice(&before)))?;
    primvar("primvars:proto", "int[]", UsdArray::Int(&protos))?;
    primvar("primvars:scale", "float3[]", UsdArray::Float3(as_float3(&scales)))?;
    let none = vec![0; instancer.len()];
    let mut marks = Vec::with_capacity(instancer.marks.len());
    for (i, name) in instancer.marks.iter().enumerate() {
        let values = instancer.rest.marks.get(i).unwrap_or(&none);
        marks.push(primvar(&format!("primvars:{name}"), "int[]", UsdArray::Int(values))?);
    }
    let widths = primvar("widths", "float[]", UsdArray::Float(&shown))?;
    let points = layer.set_attr(&format!("{path}.points"), "point3f[]", UsdArray::Float3(as_float3(&points)).into())?;
    let velocities = VelocityAttr::default();
    Ok(Box::new(PointTwin {
        index,
        path: path.to_owned(),
        extent,
        points,
        widths,
        orient,
        velocities,
        before,
        marks,
        diameters,
    }))
}

impl AnimatedPrim for PointTwin {
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(instancer) = sample.asset.instancers.get(self.index) else { return Ok(()) };
        let (up, time) = (cx.up, sample.time);
        let state = instance_states(sample.asset, instancer, self.index, sample.state);
        self.before = stage_orientations(up, &state, &self.before);
        let points = up.vecs(&state.positions);
        let shown = widths(&self.diameters, &state);
        let b = points_extent(&points, &shown);
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.extent, UsdArray::Float3(&b))?;
        sample(self.orient, UsdArray::Quatf(bytemuck::cast_slice(&self.before)))?;
        sample(self.widths, UsdArray::Float(&shown))?;
        sample(self.points, UsdArray::Float3(as_float3(&points)))?;
        for (mark, values) in self.marks.iter().zip(&state.marks) {
            sample(*mark, UsdArray::Int(values))?;
        }
        let velocities = up.vecs(&state.velocities);
        let count = instancer.len();
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&velocities), count, time)
    }
}
