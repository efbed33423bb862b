//! Skinned meshes as UsdSkel.

use glam::Quat;
use half::f16;

use super::context::UsdContext;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder, canonical_quat, nearest_quat};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMetadata};
use super::mesh::{MeshTarget, define_mesh};
use super::value::{UsdArray, UsdValue};
use crate::skin_remap::integer_weights;
use crate::up_axis::{extent_corners, matrix4d};
use osier_base::Result;
use osier_base::files::{Names, safe_name};
use osier_base::geometry::Bounds;
use osier_scene::{Asset, AssetFrame, MeshMotion, MeshObject, Skeleton, SkinWeights, Trs, mesh_points};

/// The joints as UsdSkel names them, by their paths: `a`, `a/b`.
pub(crate) fn joint_paths(skeleton: &Skeleton) -> Vec<String> {
    let mut out: Vec<String> = Vec::with_capacity(skeleton.joints.len());
    for joint in &skeleton.joints {
        let name = safe_name(&joint.name);
        // Parents come before their children in the skeleton, so the parent's path is complete already.
        let parent = joint.parent.and_then(|p| out.get(p as usize));
        out.push(parent.map_or_else(|| name.clone(), |p| format!("{p}/{name}")));
    }
    out
}

/// The `SkelAnimation` of an asset, and the extent of its `SkelRoot`.
pub(crate) struct SkelAnimation {
    translations: AttrHandle,
    rotations: AttrHandle,
    scales: AttrHandle,
    extent: AttrHandle,
    /// Rotations of the frame before, whose signs the next frame continues.
    before: Vec<Quat>,
    /// Box of the posed points over all frames so far, in the axes of the stage.
    clip_bounds: Bounds,
}

/// Whether the skeleton deforms a mesh when the file is read; other meshes get the points of each frame.
pub(super) fn is_skinned(asset: &Asset, object: &MeshObject) -> bool {
    asset.skeleton.is_some() && object.skin.is_some() && object.motion == MeshMotion::Skinned
}

/// Defines a `SkelRoot` below `root` with skeleton, animation and skinned meshes of an asset; nothing if it has none. Returns the
/// prims with time samples.
pub(super) fn define_skel_root(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    asset: &Asset,
    names: &mut Names,
) -> Result<Vec<Box<dyn AnimatedPrim>>> {
    let Some(skeleton) = asset.skeleton.as_ref().filter(|_| asset.meshes.iter().any(|m| is_skinned(asset, m))) else {
        return Ok(Vec::new());
    };
    let path = format!("{root}/{}", names.unique("skel"));
    layer.writer.define_prim(
        &path,
        "SkelRoot",
        &PrimMetadata { api: vec!["SkelBindingAPI"], ..PrimMetadata::default() },
    )?;
    let b = extent_corners(&skinned_bounds_at_frame(cx, asset, &AssetFrame::default()));
    let extent = layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    layer.writer.create_relationship(&format!("{path}.skel:animationSource"), &[format!("{path}/anim")])?;
    layer.writer.create_relationship(&format!("{path}.skel:skeleton"), &[format!("{path}/skeleton")])?;
    let joints = joint_paths(skeleton);
    define_skeleton(cx, layer, &format!("{path}/skeleton"), &[], skeleton, &joints)?;
    let animation = define_animation(cx, layer, &format!("{path}/anim"), skeleton, &joints, extent)?;
    let mut parts: Vec<Box<dyn AnimatedPrim>> = vec![Box::new(animation)];
    let mut inner = Names::default();
    // The skeleton and the animation take their names first, so that a mesh of the same name gets another.
    for name in ["skeleton", "anim"] {
        inner.unique(name);
    }
    for (i, object) in asset.meshes.iter().enumerate().filter(|(_, m)| is_skinned(asset, m)) {
        let mesh = format!("{path}/{}", inner.unique(&object.name));
        let place = MeshTarget { root, path: &mesh, skinned: true, varying: false };
        define_mesh(cx, layer, &place, &object.mesh)?;
        if let Some(skin) = &object.skin {
            bind_skin(layer, &format!("{path}/skeleton"), &mesh, skin)?;
        }
        parts.extend(super::coat_primvar::define_coat_weight(cx, layer, i, &mesh, object)?);
    }
    Ok(parts)
}

/// Box of all skinned meshes of an asset at a frame, in the axes of the stage.
fn skinned_bounds_at_frame(cx: &UsdContext, asset: &Asset, state: &AssetFrame) -> Bounds {
    let mut b = Bounds::default();
    for (i, object) in asset.meshes.iter().enumerate().filter(|(_, m)| is_skinned(asset, m)) {
        let points = mesh_points(asset, object, i, state);
        b = b.union(Bounds::of(points.iter().map(|p| cx.up.stage_vec(*p))));
    }
    b
}

/// Defines a `Skeleton` at rest. `schemas`: names of applied schemas beyond those of UsdSkel; `joints`: from [`joint_paths`].
pub(crate) fn define_skeleton(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    path: &str,
    schemas: &[&'static str],
    skeleton: &Skeleton,
    joints: &[String],
) -> Result<()> {
    let api = ["SkelBindingAPI"].iter().chain(schemas).copied().collect();
    layer.writer.define_prim(path, "Skeleton", &PrimMetadata { api, ..PrimMetadata::default() })?;
    let matrices = |poses: &[Trs]| -> Vec<[f64; 16]> { poses.iter().map(|m| matrix4d(&cx.up.stage_trs(m))).collect() };
    // Both are matrices at rest: bindTransforms map from a joint to the asset's space, restTransforms to its parent's.
    let bind = matrices(&skeleton.bind());
    let rest = matrices(&skeleton.rest_pose());
    layer.set_uniform(&format!("{path}.bindTransforms"), "matrix4d[]", UsdArray::Matrix4d(&bind).into())?;
    layer.set_uniform(&format!("{path}.joints"), "token[]", UsdArray::Token(joints).into())?;
    layer.set_uniform(&format!("{path}.restTransforms"), "matrix4d[]", UsdArray::Matrix4d(&rest).into())?;
    // Joints have no thickness: the extent of the skeleton is the box of their positions.
    let places = skeleton.bind();
    let b = extent_corners(&Bounds::of(places.iter().map(|m| cx.up.stage_vec(m.t))));
    layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&b).into())?;
    Ok(())
}

/// A pose as the arrays of a `SkelAnimation`: translations, unit rotations, scales in half precision.
fn animation_channels(cx: &UsdContext, pose: &[Trs]) -> (Vec<[f32; 3]>, Vec<Quat>, Vec<[f16; 3]>) {
    let pose: Vec<Trs> = pose.iter().map(|m| cx.up.stage_trs(m)).collect();
    let translations = pose.iter().map(|m| m.t.to_array()).collect();
    let rotations = pose.iter().map(|m| canonical_quat(m.r)).collect();
    let scales = pose.iter().map(|m| m.s.to_array().map(f16::from_f32)).collect();
    (translations, rotations, scales)
}

/// Defines a `SkelAnimation` at rest. `extent`: the attribute of the `SkelRoot`, which gets samples with the animation.
pub(crate) fn define_animation(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    path: &str,
    skeleton: &Skeleton,
    joints: &[String],
    extent: AttrHandle,
) -> Result<SkelAnimation> {
    layer.define_plain_prim(path, "SkelAnimation")?;
    let (t, r, s) = animation_channels(cx, &skeleton.rest_pose());
    layer.set_uniform(&format!("{path}.joints"), "token[]", UsdArray::Token(joints).into())?;
    let rotations = UsdArray::Quatf(bytemuck::cast_slice(&r));
    Ok(SkelAnimation {
        rotations: layer.set_attr(&format!("{path}.rotations"), "quatf[]", rotations.into())?,
        scales: layer.set_attr(&format!("{path}.scales"), "half3[]", UsdArray::Half3(&s).into())?,
        translations: layer.set_attr(&format!("{path}.translations"), "float3[]", UsdArray::Float3(&t).into())?,
        extent,
        before: Vec::new(),
        clip_bounds: Bounds::default(),
    })
}

/// Joints and weights of the points of a mesh, `size` of each for every point.
pub(crate) struct PointInfluences<'a> {
    /// Number of influences of each point.
    pub size: i32,
    /// Indices into the joints of the skeleton, point after point.
    pub joints: &'a [i32],
    /// Weights of the joints, in the same order.
    pub weights: &'a [f32],
}

/// Sets the properties of `SkelBindingAPI` of a mesh that is bound in the space of the `SkelRoot`. `skeleton`: its path.
pub(crate) fn bind_points(
    layer: &mut LayerBuilder,
    skeleton: &str,
    mesh: &str,
    influences: &PointInfluences<'_>,
) -> Result<()> {
    let spec = |type_name| AttrSpec { element_size: Some(influences.size), ..AttrSpec::primvar(type_name, "vertex") };
    layer.writer.create_attr(
        &format!("{mesh}.primvars:skel:geomBindTransform"),
        &AttrSpec::new("matrix4d"),
        // The meshes are modelled in the space of the skeleton: binding transforms nothing.
        Some(UsdValue::Matrix4d(matrix4d(&Trs::IDENTITY))),
    )?;
    layer.writer.create_attr(
        &format!("{mesh}.primvars:skel:jointIndices"),
        &spec("int[]"),
        Some(UsdArray::Int(influences.joints).into()),
    )?;
    layer.writer.create_attr(
        &format!("{mesh}.primvars:skel:jointWeights"),
        &spec("float[]"),
        Some(UsdArray::Float(influences.weights).into()),
    )?;
    layer.writer.create_relationship(&format!("{mesh}.skel:skeleton"), &[skeleton.to_owned()])
}

/// Binds a mesh to a skeleton with the four influences of each point. `skeleton`: its path.
///
/// Weights are multiples of 1/1023 that sum to 1: a crate file holds such an array as a table of at most 1024 values, in less
/// than half of the bytes. A point is off by at most 1/1023 of the distance between its positions under two of its joints.
pub(crate) fn bind_skin(layer: &mut LayerBuilder, skeleton: &str, mesh: &str, skin: &SkinWeights) -> Result<()> {
    // Flat lists with four entries for each point; `elementSize` is 4.
    let joints: Vec<i32> = skin.joints.as_flattened().iter().map(|j| i32::from(*j)).collect();
    let weights: Vec<f32> = skin.weights.iter().flat_map(rounded_weights).collect();
    let influences = PointInfluences { size: 4, joints: &joints, weights: &weights };
    bind_points(layer, skeleton, mesh, &influences)
}

/// Four weights as multiples of 1/1023 that sum to 1.
fn rounded_weights(weights: &[f32; 4]) -> [f32; 4] {
    integer_weights(weights, 1023).map(|w| f32::from(w) / 1023.0)
}

impl AnimatedPrim for SkelAnimation {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(skeleton) = &sample.asset.skeleton else { return Ok(()) };
        let rest;
        let pose = if sample.state.pose.len() == skeleton.joints.len() {
            &sample.state.pose
        } else {
            rest = skeleton.rest_pose();
            &rest
        };
        // Quaternions keep the sign of the frame before, so that readers interpolate along the shorter arc.
        let (t, mut r, s) = animation_channels(cx, pose);
        for (q, before) in r.iter_mut().zip(&self.before) {
            *q = nearest_quat(*q, *before);
        }
        // UsdSkel deforms when it is read, so the extent of the root is computed here from the posed points.
        let b = skinned_bounds_at_frame(cx, sample.asset, sample.state);
        self.clip_bounds = self.clip_bounds.union(b);
        let b = extent_corners(&b);
        let time = sample.time;
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.translations, UsdArray::Float3(&t))?;
        sample(self.rotations, UsdArray::Quatf(bytemuck::cast_slice(&r)))?;
        sample(self.scales, UsdArray::Half3(&s))?;
        sample(self.extent, UsdArray::Float3(&b))?;
        self.before = r;
        Ok(())
    }

    fn clip_bounds(&self) -> Bounds {
        self.clip_bounds
    }
}

/// Joints of a skeleton beyond which the exporter warns (X002).
pub(super) const MAX_JOINTS: usize = 300;
