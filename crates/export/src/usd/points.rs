//! Point clouds as `Points`, curves as `BasisCurves`.

use glam::Vec3;

use super::arrays::{as_float3, as_ints, points_extent, sequential_ids};
use crate::up_axis::extent_corners;

use super::context::UsdContext;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMetadata};
use super::mesh::VelocitySamples;
use super::primvar;
use super::value::{UsdArray, UsdValue};
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_scene::{Curves, CurvesFrame, Points, PointsFrame};

fn binding_api_metadata() -> PrimMetadata {
    PrimMetadata { api: vec!["MaterialBindingAPI"], ..PrimMetadata::default() }
}

/// A moving point cloud, which samples positions, widths, velocities and, if it has them, colours.
struct AnimatedPoints {
    /// Index of the cloud in its asset.
    index: usize,
    path: String,
    extent: AttrHandle,
    points: AttrHandle,
    widths: AttrHandle,
    velocities: VelocitySamples,
    colors: Option<AttrHandle>,
}

/// Defines a point cloud in its rest state. Returns the prim that takes its time samples, if it moves.
pub(super) fn define_points(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    root: &str,
    path: &str,
    cloud: &Points,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    layer.writer.define_prim(path, "Points", &binding_api_metadata())?;
    let points = cx.up.stage_vecs(&cloud.positions);
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
    primvar::define_all(layer, path, &cloud.attributes, cx.up)?;
    let spec = AttrSpec::primvar("float[]", "vertex");
    let widths =
        layer.writer.create_attr(&format!("{path}.widths"), &spec, Some(UsdArray::Float(&cloud.widths).into()))?;
    layer.bind_material(cx, root, path, cloud.material)?;
    let velocities = VelocitySamples::default();
    let part = AnimatedPoints { index, path: path.to_owned(), extent, points, widths, velocities, colors };
    Ok(cloud.moving.then(|| Box::new(part) as Box<dyn AnimatedPrim>))
}

impl AnimatedPrim for AnimatedPoints {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(cloud) = sample.asset.points.get(self.index) else { return Ok(()) };
        let state = sample.state.points(self.index);
        let now = cloud.at(state);
        let points = cx.up.stage_vecs(now.positions);
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
        let v = cx.up.stage_vecs(now.velocities);
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&v), points.len(), time)
    }
}

/// Moving curves, which sample points and extent.
struct AnimatedCurves {
    /// Index of the curves in their asset.
    index: usize,
    extent: AttrHandle,
    points: AttrHandle,
}

/// Extent of curves: the box of their points, grown by half the largest width.
fn curves_extent(points: &[Vec3], widths: &[f32]) -> [[f32; 3]; 2] {
    // A box around the points by the largest radius is conservative: every curve lies inside, thin ones not tightly.
    let widest = widths.iter().fold(0.0_f32, |a, b| a.max(*b));
    extent_corners(&Bounds::of(points.iter().copied()).expanded(widest * 0.5))
}

/// Defines curves in their rest state. Returns the prim that takes their time samples, if they move.
pub(super) fn define_curves(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    root: &str,
    path: &str,
    curves: &Curves,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    layer.writer.define_prim(path, "BasisCurves", &binding_api_metadata())?;
    let points = cx.up.stage_vecs(&curves.points);
    let b = curves_extent(&points, &curves.widths);
    let counts = as_ints(&curves.counts, "points of a curve")?;
    layer.set_attr(&format!("{path}.curveVertexCounts"), "int[]", UsdArray::Int(counts).into())?;
    let extent = layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    let points = layer.set_attr(&format!("{path}.points"), "point3f[]", UsdArray::Float3(as_float3(&points)).into())?;
    // One texture coordinate per curve, in the middle of its share of the u axis.
    #[allow(clippy::cast_precision_loss, reason = "a texture coordinate")]
    let st: Vec<[f32; 2]> = (0..counts.len()).map(|i| [(i as f32 + 0.5) / counts.len() as f32, 0.5]).collect();
    let spec = AttrSpec::primvar("texCoord2f[]", "uniform");
    layer.writer.create_attr(&format!("{path}.primvars:st"), &spec, Some(UsdArray::Float2(&st).into()))?;
    layer.set_uniform(&format!("{path}.type"), "token", UsdValue::Token("linear"))?;
    let spec = AttrSpec::primvar("float[]", "vertex");
    layer.writer.create_attr(&format!("{path}.widths"), &spec, Some(UsdArray::Float(&curves.widths).into()))?;
    layer.bind_material(cx, root, path, curves.material)?;
    Ok(curves.moving.then(|| Box::new(AnimatedCurves { index, extent, points }) as Box<dyn AnimatedPrim>))
}

impl AnimatedPrim for AnimatedCurves {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(curves) = sample.asset.curves.get(self.index) else { return Ok(()) };
        let points = match sample.state.curves(self.index) {
            CurvesFrame::Points(points) => points,
            CurvesFrame::Same => &curves.points,
        };
        let points = cx.up.stage_vecs(points);
        let b = curves_extent(&points, &curves.widths);
        layer.writer.set_time_sample(self.extent, sample.time, UsdArray::Float3(&b).into())?;
        layer.writer.set_time_sample(self.points, sample.time, UsdArray::Float3(as_float3(&points)).into())
    }
}
