//! Point clouds and curves.

use glam::Vec3;

use super::axis::extent;
use super::instancer::{cloud_box, ids};
use super::mesh::Velocities;
use super::stage::{Attr, AttrSpec, PrimMeta};
use super::target::{Context, Part, Shot, Target};
use super::value::{Array, Value};
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_scene::{Curves, CurvesFrame, Points, PointsFrame};

fn triples(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

fn bound() -> PrimMeta {
    PrimMeta { api: vec!["MaterialBindingAPI"], ..PrimMeta::default() }
}

/// A moving cloud.
struct Cloud {
    index: usize,
    path: String,
    extent: Attr,
    points: Attr,
    widths: Attr,
    velocities: Velocities,
    colors: Option<Attr>,
}

/// Writes a cloud at rest.
pub(super) fn cloud(
    cx: &Context,
    target: &mut Target,
    index: usize,
    (root, path): (&str, &str),
    cloud: &Points,
) -> Result<Option<Box<dyn Part>>> {
    target.stage.prim(path, "Points", &bound())?;
    let points = cx.up.vecs(&cloud.positions);
    let b = cloud_box(&points, &cloud.widths);
    let extent = target.set(&format!("{path}.extent"), "float3[]", Array::Float3(&b).into())?;
    target.set(&format!("{path}.ids"), "int64[]", Array::Int64(&ids(points.len())).into())?;
    let points = target.set(&format!("{path}.points"), "point3f[]", Array::Float3(triples(&points)).into())?;
    let mut colors = None;
    if !cloud.colors.is_empty() {
        let spec = AttrSpec::primvar("color3f[]", "vertex");
        let values = Array::Float3(&cloud.colors);
        let attr = target.stage.attr(&format!("{path}.primvars:displayColor"), &spec, Some(values.into()))?;
        colors = Some(attr);
    }
    for a in &cloud.attributes {
        let values: Vec<i32> = a.values.iter().map(|v| i32::try_from(*v).unwrap_or(i32::MAX)).collect();
        let spec = AttrSpec::primvar("int[]", "vertex");
        target.stage.attr(&format!("{path}.primvars:{}", a.name), &spec, Some(Array::Int(&values).into()))?;
    }
    let spec = AttrSpec::primvar("float[]", "vertex");
    let widths = target.stage.attr(&format!("{path}.widths"), &spec, Some(Array::Float(&cloud.widths).into()))?;
    target.bind(cx, root, path, cloud.material)?;
    let velocities = Velocities::default();
    let part = Cloud { index, path: path.to_owned(), extent, points, widths, velocities, colors };
    Ok(cloud.moving.then(|| Box::new(part) as Box<dyn Part>))
}

impl Part for Cloud {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(cloud) = shot.asset.points.get(self.index) else { return Ok(()) };
        let state = shot.state.points(self.index);
        let now = cloud.at(state);
        let points = cx.up.vecs(now.positions);
        let b = cloud_box(&points, now.widths);
        let time = shot.time;
        let mut sample = |attr, array: Array| target.stage.sample(attr, time, array.into());
        sample(self.extent, Array::Float3(&b))?;
        sample(self.points, Array::Float3(triples(&points)))?;
        sample(self.widths, Array::Float(now.widths))?;
        if let (Some(attr), PointsFrame::State { colors, .. }) = (self.colors, state)
            && !colors.is_empty()
        {
            sample(attr, Array::Float3(colors))?;
        }
        let v = cx.up.vecs(now.velocities);
        self.velocities.sample(target, &format!("{}.velocities", self.path), triples(&v), (points.len(), time))
    }
}

/// Moving curves.
struct Hairs {
    index: usize,
    extent: Attr,
    points: Attr,
}

/// Box of curves: that of their points, grown by half the largest width.
fn curves_box(points: &[Vec3], widths: &[f32]) -> [[f32; 3]; 2] {
    let widest = widths.iter().fold(0.0_f32, |a, b| a.max(*b));
    extent(&Bounds::of(points.iter().copied()).grown(widest * 0.5))
}

/// Writes curves at rest.
pub(super) fn hairs(
    cx: &Context,
    target: &mut Target,
    index: usize,
    (root, path): (&str, &str),
    curves: &Curves,
) -> Result<Option<Box<dyn Part>>> {
    target.stage.prim(path, "BasisCurves", &bound())?;
    let points = cx.up.vecs(&curves.points);
    let b = curves_box(&points, &curves.widths);
    let counts: Vec<i32> = curves.counts.iter().map(|n| i32::try_from(*n).unwrap_or(i32::MAX)).collect();
    target.set(&format!("{path}.curveVertexCounts"), "int[]", Array::Int(&counts).into())?;
    let extent = target.set(&format!("{path}.extent"), "float3[]", Array::Float3(&b).into())?;
    let points = target.set(&format!("{path}.points"), "point3f[]", Array::Float3(triples(&points)).into())?;
    // One place on the map per curve: the curves side by side along u.
    #[allow(clippy::cast_precision_loss, reason = "a place on a map")]
    let st: Vec<[f32; 2]> = (0..counts.len()).map(|i| [(i as f32 + 0.5) / counts.len() as f32, 0.5]).collect();
    let spec = AttrSpec::primvar("texCoord2f[]", "uniform");
    target.stage.attr(&format!("{path}.primvars:st"), &spec, Some(Array::Float2(&st).into()))?;
    target.fix(&format!("{path}.type"), "token", Value::Token("linear"))?;
    let spec = AttrSpec::primvar("float[]", "vertex");
    target.stage.attr(&format!("{path}.widths"), &spec, Some(Array::Float(&curves.widths).into()))?;
    target.bind(cx, root, path, curves.material)?;
    Ok(curves.moving.then(|| Box::new(Hairs { index, extent, points }) as Box<dyn Part>))
}

impl Part for Hairs {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(curves) = shot.asset.curves.get(self.index) else { return Ok(()) };
        let points = match shot.state.curves(self.index) {
            CurvesFrame::Points(points) => points,
            CurvesFrame::Same => &curves.points,
        };
        let points = cx.up.vecs(points);
        let b = curves_box(&points, &curves.widths);
        target.stage.sample(self.extent, shot.time, Array::Float3(&b).into())?;
        target.stage.sample(self.points, shot.time, Array::Float3(triples(&points)).into())
    }
}
