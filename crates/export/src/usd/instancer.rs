//! Repeated meshes as PointInstancer, and their twin as Points.

use glam::{Quat, Vec3};
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use super::axis::{UpAxis, extent};
use super::boxes::Shapes;
use super::mesh::{Place, Velocities, define};
use super::stage::{Attr, AttrSpec, PrimMeta, Variants, variant};
use super::target::{Context, Part, Shot, Target, near, unit};
use super::thin::{Due, Thinned};
use super::value::Array;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_scene::{InstanceState, Instancer, InstancerMotion, Prototype, instance_states};

/// Variant set of prototypes with several levels of detail.
const LEVELS: &str = "LOD";

fn triples(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

/// 0..n.
pub(super) fn ids(n: usize) -> Vec<i64> {
    (0..n).map(|i| i64::try_from(i).unwrap_or(i64::MAX)).collect()
}

/// Rotations in stage space, on the side of those of the frame before.
fn turns(up: UpAxis, state: &InstanceState, before: &[Quat]) -> Vec<Quat> {
    let (again, first) = state.orientations.split_at(before.len().min(state.orientations.len()));
    let again = again.iter().zip(before).map(|(q, b)| near(up.quat(*q), *b));
    again.chain(first.iter().map(|q| unit(up.quat(*q)))).collect()
}

/// Quaternions rounded to half precision.
fn halves(turns: &[Quat]) -> Vec<[f16; 4]> {
    let mut out = vec![[f16::ZERO; 4]; turns.len()];
    out.as_flattened_mut().convert_from_f32_slice(bytemuck::cast_slice(turns));
    out
}

/// Angular velocities as degrees per second about an axis.
fn degrees(up: UpAxis, v: &[Vec3]) -> Vec<[f32; 3]> {
    let factor = 180.0 / std::f32::consts::PI;
    v.iter().map(|w| (up.vec(*w) * factor).to_array()).collect()
}

/// An instancer of an asset.
pub(super) struct Instances {
    index: usize,
    path: String,
    positions: Attr,
    orientations: Attr,
    extent: Attr,
    invisible: Option<Attr>,
    velocities: Velocities,
    angular: Velocities,
    /// Written from the first frame that tells how wet instances are.
    wetness: Option<Attr>,
    before: Vec<Quat>,
    shapes: Shapes,
    /// What waits to be left out, where instances neither come and go nor have velocities.
    thinned: Option<Waiting>,
    /// Box of all frames so far.
    reach: Bounds,
}

/// Places and rotations of frames that interpolation may restore.
struct Waiting {
    positions: Thinned<Vec3>,
    orientations: Thinned<Quat>,
}

/// Writes an instancer at rest.
pub(super) fn part(
    cx: &Context,
    target: &mut Target,
    index: usize,
    (root, path): (&str, &str),
    instancer: &Instancer,
) -> Result<Option<Box<dyn Part>>> {
    target.plain(path, "PointInstancer")?;
    let up = cx.up;
    let n = instancer.len();
    let shapes = Shapes::of(instancer, up);
    let before = turns(up, &instancer.rest, &[]);
    let orientations = halves(&before);
    let protos: Vec<i32> = instancer.protos.iter().map(|p| i32::try_from(*p).unwrap_or(i32::MAX)).collect();
    let scales: Vec<Vec3> = instancer.scales.iter().map(|s| up.scale(*s)).collect();
    let b = shapes.extent(&orientations, &up.vecs(&instancer.rest.positions), &instancer.rest.alive);
    let hidden = hidden(instancer, &instancer.rest);
    let set = |target: &mut Target, name: &str, type_name, array: Array| {
        target.set(&format!("{path}.{name}"), type_name, array.into())
    };
    let extent = set(target, "extent", "float3[]", Array::Float3(&b))?;
    set(target, "ids", "int64[]", Array::Int64(&ids(n)))?;
    let dies = instancer.motion == InstancerMotion::Free || !hidden.is_empty();
    let invisible = dies.then(|| set(target, "invisibleIds", "int64[]", Array::Int64(&hidden))).transpose()?;
    let orientations = set(target, "orientations", "quath[]", Array::Quath(&orientations))?;
    let positions = set(target, "positions", "point3f[]", Array::Float3(triples(&up.vecs(&instancer.rest.positions))))?;
    set(target, "protoIndices", "int[]", Array::Int(&protos))?;
    set(target, "scales", "float3[]", Array::Float3(triples(&scales)))?;
    prototypes(cx, target, (root, path), instancer)?;
    if instancer.motion == InstancerMotion::Still {
        return Ok(None);
    }
    Ok(Some(Box::new(Instances {
        index,
        path: path.to_owned(),
        positions,
        orientations,
        extent,
        invisible,
        velocities: Velocities::default(),
        angular: Velocities::default(),
        wetness: None,
        before,
        shapes,
        thinned: matches!(instancer.motion, InstancerMotion::Joints(_)).then(|| Waiting {
            positions: Thinned::new(cx.tolerance.metres),
            orientations: Thinned::new(cx.tolerance.radians),
        }),
        reach: Bounds::default(),
    })))
}

fn prototypes(cx: &Context, target: &mut Target, (root, path): (&str, &str), instancer: &Instancer) -> Result<()> {
    let names: Vec<String> = (0..instancer.prototypes.len()).map(|i| format!("{path}/Prototypes/p{i:03}")).collect();
    target.stage.rel(&format!("{path}.prototypes"), &names)?;
    target.plain(&format!("{path}/Prototypes"), "Scope")?;
    for (name, proto) in names.iter().zip(&instancer.prototypes) {
        if !proto.others.is_empty() {
            levels(cx, target, (root, name), proto)?;
            continue;
        }
        match &proto.fine {
            Some(_) => target.plain(name, "Xform").and_then(|()| shown(cx, target, (root, name), proto))?,
            None => {
                let place = Place { root, path: name, skinned: false, varying: false };
                define(cx, target, &place, &proto.mesh).map(|_| ())?;
            }
        }
    }
    Ok(())
}

/// Levels of detail as variants of one prim, which shows the prototype's own unless a reader chooses.
fn levels(cx: &Context, target: &mut Target, (root, path): (&str, &str), proto: &Prototype) -> Result<()> {
    let mut all: Vec<&Prototype> = std::iter::once(proto).chain(&proto.others).collect();
    all.sort_by(|a, b| a.level.cmp(&b.level));
    let names = all.iter().map(|p| p.level.clone()).collect();
    let variants = Some(Variants { set: LEVELS, names, chosen: proto.level.clone() });
    target.stage.prim(path, "Xform", &PrimMeta { variants, ..PrimMeta::default() })?;
    all.into_iter().try_for_each(|p| shown(cx, target, (root, &variant(path, LEVELS, &p.level)), p))
}

/// Contents of a prototype beneath a prim: its mesh, or curves and what is not curves.
fn shown(cx: &Context, target: &mut Target, (root, path): (&str, &str), proto: &Prototype) -> Result<()> {
    let mesh = proto.fine.as_ref().map_or(&proto.mesh, |fine| &fine.mesh);
    if !mesh.triangles.is_empty() {
        let path = format!("{path}/body");
        define(cx, target, &Place { root, path: &path, skinned: false, varying: false }, mesh)?;
    }
    match &proto.fine {
        Some(fine) => super::points::hairs(cx, target, 0, (root, &format!("{path}/hairs")), &fine.curves).map(|_| ()),
        None => Ok(()),
    }
}

/// Slots without a live instance.
fn hidden(instancer: &Instancer, state: &InstanceState) -> Vec<i64> {
    let slots = state.alive.iter().take(instancer.len()).zip(0..);
    slots.filter(|(alive, _)| !**alive).map(|(_, slot)| slot).collect()
}

impl Instances {
    /// Takes places and the rotations of a frame, and writes those that later frames cannot restore.
    fn thin(&mut self, target: &mut Target, time: f64, positions: Vec<Vec3>) -> Result<()> {
        let Some(waiting) = &mut self.thinned else { return Ok(()) };
        let turns = waiting.orientations.push(time, self.before.clone());
        let places = waiting.positions.push(time, positions);
        self.write(target, turns, places)
    }

    fn write(&self, target: &mut Target, turns: Option<Due<Quat>>, places: Option<Due<Vec3>>) -> Result<()> {
        if let Some((time, turns)) = turns {
            target.stage.sample(self.orientations, time, Array::Quath(&halves(&turns)).into())?;
        }
        if let Some((time, places)) = places {
            target.stage.sample(self.positions, time, Array::Float3(triples(&places)).into())?;
        }
        Ok(())
    }
}

impl Part for Instances {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(instancer) = shot.asset.instancers.get(self.index) else { return Ok(()) };
        let (up, time) = (cx.up, shot.time);
        let state = instance_states(shot.asset, instancer, self.index, shot.state);
        self.before = turns(up, &state, &self.before);
        let orientations = halves(&self.before);
        let positions = up.vecs(&state.positions);
        let b = self.shapes.extent(&orientations, &positions, &state.alive);
        self.reach = self.reach.union(Bounds::of(b.map(Vec3::from_array)));
        let mut sample = |attr, array: Array| target.stage.sample(attr, time, array.into());
        sample(self.extent, Array::Float3(&b))?;
        if let Some(invisible) = self.invisible {
            sample(invisible, Array::Int64(&hidden(instancer, &state)))?;
        }
        if self.thinned.is_some() && state.velocities.is_empty() {
            self.thin(target, time, positions.into_owned())?;
        } else {
            sample(self.orientations, Array::Quath(&orientations))?;
            sample(self.positions, Array::Float3(triples(&positions)))?;
        }
        let at = (instancer.len(), time);
        let velocities = up.vecs(&state.velocities);
        self.velocities.sample(target, &format!("{}.velocities", self.path), triples(&velocities), at)?;
        let angular = degrees(up, &state.angular_velocities);
        self.angular.sample(target, &format!("{}.angularVelocities", self.path), &angular, at)?;
        if state.wetness.is_empty() {
            return Ok(());
        }
        let attr = match self.wetness {
            Some(attr) => attr,
            None => {
                let spec = AttrSpec::primvar("float[]", "vertex");
                target.stage.attr(&format!("{}.primvars:wetness", self.path), &spec, None)?
            }
        };
        self.wetness = Some(attr);
        target.stage.sample(attr, time, Array::Float(&state.wetness).into())
    }

    fn finish(&mut self, target: &mut Target) -> Result<()> {
        let Some(waiting) = &mut self.thinned else { return Ok(()) };
        let (turns, places) = (waiting.orientations.finish(), waiting.positions.finish());
        self.write(target, turns, places)
    }

    fn reach(&self) -> Bounds {
        self.reach
    }
}

/// The instances as plain points with everything that instancers lose on the way into Blender.
pub(super) struct Twin {
    index: usize,
    path: String,
    extent: Attr,
    points: Attr,
    widths: Attr,
    orient: Attr,
    velocities: Velocities,
    before: Vec<Quat>,
    /// One per mark of the instancer.
    marks: Vec<Attr>,
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
pub(super) fn cloud_box(points: &[Vec3], widths: &[f32]) -> [[f32; 3]; 2] {
    let grown = points.iter().zip(widths).map(|(p, w)| Bounds::of([*p]).grown(w * 0.5));
    extent(&grown.fold(Bounds::default(), Bounds::union))
}

/// Writes a twin at rest.
pub(super) fn twin(
    cx: &Context,
    target: &mut Target,
    index: usize,
    path: &str,
    instancer: &Instancer,
) -> Result<Box<dyn Part>> {
    target.plain(path, "Points")?;
    let up = cx.up;
    let diameters = diameters(instancer);
    let before = turns(up, &instancer.rest, &[]);
    let points = up.vecs(&instancer.rest.positions);
    let shown = widths(&diameters, &instancer.rest);
    let protos: Vec<i32> = instancer.protos.iter().map(|p| i32::try_from(*p).unwrap_or(i32::MAX)).collect();
    let scales: Vec<Vec3> = instancer.scales.iter().map(|s| up.scale(*s)).collect();
    let b = cloud_box(&points, &shown);
    let extent = target.set(&format!("{path}.extent"), "float3[]", Array::Float3(&b).into())?;
    target.set(&format!("{path}.ids"), "int64[]", Array::Int64(&ids(instancer.len())).into())?;
    let mut primvar = |name: &str, type_name, array: Array| {
        let spec = AttrSpec::primvar(type_name, "vertex");
        target.stage.attr(&format!("{path}.{name}"), &spec, Some(array.into()))
    };
    let orient = primvar("primvars:orient", "quatf[]", Array::Quatf(bytemuck::cast_slice(&before)))?;
    primvar("primvars:proto", "int[]", Array::Int(&protos))?;
    primvar("primvars:scale", "float3[]", Array::Float3(triples(&scales)))?;
    let none = vec![0; instancer.len()];
    let mut marks = Vec::with_capacity(instancer.marks.len());
    for (i, name) in instancer.marks.iter().enumerate() {
        let values = instancer.rest.marks.get(i).unwrap_or(&none);
        marks.push(primvar(&format!("primvars:{name}"), "int[]", Array::Int(values))?);
    }
    let widths = primvar("widths", "float[]", Array::Float(&shown))?;
    let points = target.set(&format!("{path}.points"), "point3f[]", Array::Float3(triples(&points)).into())?;
    let velocities = Velocities::default();
    Ok(Box::new(Twin {
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

impl Part for Twin {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(instancer) = shot.asset.instancers.get(self.index) else { return Ok(()) };
        let (up, time) = (cx.up, shot.time);
        let state = instance_states(shot.asset, instancer, self.index, shot.state);
        self.before = turns(up, &state, &self.before);
        let points = up.vecs(&state.positions);
        let shown = widths(&self.diameters, &state);
        let b = cloud_box(&points, &shown);
        let mut sample = |attr, array: Array| target.stage.sample(attr, time, array.into());
        sample(self.extent, Array::Float3(&b))?;
        sample(self.orient, Array::Quatf(bytemuck::cast_slice(&self.before)))?;
        sample(self.widths, Array::Float(&shown))?;
        sample(self.points, Array::Float3(triples(&points)))?;
        for (mark, values) in self.marks.iter().zip(&state.marks) {
            sample(*mark, Array::Int(values))?;
        }
        let velocities = up.vecs(&state.velocities);
        let at = (instancer.len(), time);
        self.velocities.sample(target, &format!("{}.velocities", self.path), triples(&velocities), at)
    }
}
