//! Point clouds and curves.

use glam::Vec3;

use super::axis::extent;
use super::instancer::{points_extent, sequential_ids};
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder, UsdContext};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMeta};
use super::mesh::VelocityAttr;
use super::value::{UsdArray, UsdValue};
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_scene::{Curves, CurvesFrame, Points, PointsFrame};

fn as_float3(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

fn material_binding_api() -> PrimMeta {
    PrimMeta { api: vec!["MaterialBindingAPI"], ..PrimMeta::default() }
}

/// A moving cloud.
struct PointsSamples {
    index: usize,
    path: String,
    extent: AttrHandle,
    points: AttrHandle,
    widths: AttrHandle,
    velocities: VelocityAttr,
    colors: Option<AttrHandle>,
}

/// Writes a cloud at rest.
pub(super) fn define_points(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    root: &str,
    path: &str,
    cloud: &Points,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    layer.writer.define_prim(path, "Points", &material_binding_api())?;
    let points = cx.up.vecs(&cloud.positions);
    let b = points_extent(&points, &cloud.widths);
    let extent = layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    layer.set_attr(&format!("{path}.ids"), "int64[]", UsdArray::Int64(&sequential_ids(points.len())).into())?;
    let points = layer.set_attr(&format!("{path}.points"), "point3f[]", UsdArray::Float3(as_float3(&points)).into())?;
    let mut colors = None;
    if !cloud.colors.is_empty() {
        let spec = AttrSpec::primvar("color3f[]", "vertex");
        let values = UsdArray::Float3(&cloud.colors);
        let attr = layer.writer.create_attr(&format!("{path}.primvars:displayColor"), &spec, Some(values.into()))?;
        colors = Some(attr);
    }
    for a in &cloud.attributes {
        let values: Vec<i32> = a.values.iter().map(|v| i32::try_from(*v).unwrap_or(i32::MAX)).collect();
        let spec = AttrSpec::primvar("int[]", "vertex");
        layer.writer.create_attr(&format!("{path}.primvars:{}", a.name), &spec, Some(UsdArray::Int(&values).into()))?;
    }
    let spec = AttrSpec::primvar("float[]", "vertex");
    let widths =
        layer.writer.create_attr(&format!("{path}.widths"), &spec, Some(UsdArray::Float(&cloud.widths).into()))?;
    layer.bind_material(cx, root, path, cloud.material)?;
    let velocities = VelocityAttr::default();
    let part = PointsSamples { index, path: path.to_owned(), extent, points, widths, velocities, colors };
    Ok(cloud.moving.then(|| Box::new(part) as Box<dyn AnimatedPrim>))
}

impl AnimatedPrim for PointsSamples {
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(cloud) = sample.asset.points.get(self.index) else { return Ok(()) };
        let state = sample.state.points(self.index);
        let now = cloud.at(state);
        let points = cx.up.vecs(now.positions);
        let b = points_extent(&points, now.widths);
        let time = sample.time;
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.extent, UsdArray::Float3(&b))?;
        sample(self.points, UsdArray::Float3(as_float3(&points)))?;
        sample(self.widths, UsdArray::Float(now.widths))?;
        if let (Some(attr), PointsFrame::State { colors, .. }) = (self.colors, state)
            && !colors.is_empty()
        {
            sample(attr, UsdArray::Float3(colors))?;
        }
        let v = cx.up.vecs(now.velocities);
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&v), points.len(), time)
    }
}

/// Moving curves.
struct CurvesSamples {
    index: usize,
    extent: AttrHandle,
    points: AttrHandle,
}

/// Box of curves: that of their points, grown by half the largest width.
fn curves_extent(points: &[Vec3], widths: &[f32]) -> [[f32; 3]; 2] {
    let widest = widths.iter().fold(0.0_f32, |a, b| a.max(*b));
    extent(&Bounds::of(points.iter().copied()).grown(widest * 0.5))
}

/// Writes curves at rest.
pub(super) fn define_curves(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    root: &str,
    path: &str,
    curves: &Curves,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    layer.writer.define_prim(path, "BasisCurves", &material_binding_api())?;
    let points = cx.up.vecs(&curves.points);
    let b = curves_extent(&points, &curves.widths);
    let counts: Vec<i32> = curves.counts.iter().map(|n| i32::try_from(*n).unwrap_or(i32::MAX)).collect();
    layer.set_attr(&format!("{path}.curveVertexCounts"), "int[]", UsdArray::Int(&counts).into())?;
    let extent = layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    let points = layer.set_attr(&format!("{path}.points"), "point3f[]", UsdArray::Float3(as_float3(&points)).into())?;
    // One place on the map per curve: the curves side by side along u.
    #[allow(clippy::cast_precision_loss, reason = "a place on a map")]
    let st: Vec<[f32; 2]> = (0..counts.len()).map(|i| [(i as f32 + 0.5) / counts.len() as f32, 0.5]).collect();
    let spec = AttrSpec::primvar("texCoord2f[]", "uniform");
    layer.writer.create_attr(&format!("{path}.primvars:st"), &spec, Some(UsdArray::Float2(&st).into()))?;
    layer.set_uniform(&format!("{path}.type"), "token", UsdValue::Token("linear"))?;
    let spec = AttrSpec::primvar("float[]", "vertex");
    layer.writer.create_attr(&format!("{path}.widths"), &spec, Some(UsdArray::Float(&curves.widths).into()))?;
    layer.bind_material(cx, root, path, curves.material)?;
    Ok(curves.moving.then(|| Box::new(CurvesSamples { index, extent, points }) as Box<dyn AnimatedPrim>))
}

impl AnimatedPrim for CurvesSamples {
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(curves) = sample.asset.curves.get(self.index) else { return Ok(()) };
        let points = match sample.state.curves(self.index) {
            CurvesFrame::Points(points) => points,
            CurvesFrame::Same => &curves.points,
        };
        let points = cx.up.vecs(points);
        let b = curves_extent(&points, &curves.widths);
        layer.writer.set_time_sample(self.extent, sample.time, UsdArray::Float3(&b).into())?;
        layer.writer.set_time_sample(self.points, sample.time, UsdArray::Float3(as_float3(&points)).into())
    }
}
