//! Skinned meshes as UsdSkel.

use glam::Quat;
use half::f16;

use super::axis::{extent, matrix};
use super::mesh::{Place, define};
use super::stage::{Attr, AttrSpec, PrimMeta};
use super::target::{Context, Part, Shot, Target, near, unit};
use super::value::{Array, Value};
use osier_base::Result;
use osier_base::fence::{Names, safe_name};
use osier_base::geometry::Bounds;
use osier_scene::{Asset, AssetFrame, MeshMotion, MeshObject, Skeleton, SkinWeights, Trs, mesh_points};

/// Names of joints as paths: `a`, `a/b`.
fn tokens(skeleton: &Skeleton) -> Vec<String> {
    let mut out: Vec<String> = Vec::with_capacity(skeleton.joints.len());
    for joint in &skeleton.joints {
        let name = safe_name(&joint.name);
        let parent = joint.parent.and_then(|p| out.get(p as usize));
        out.push(parent.map_or_else(|| name.clone(), |p| format!("{p}/{name}")));
    }
    out
}

/// The joints of an asset, and the box of what hangs on them.
pub(super) struct Skinned {
    translations: Attr,
    rotations: Attr,
    scales: Attr,
    extent: Attr,
    /// Rotations of the frame before.
    before: Vec<Quat>,
    /// Box of all frames so far.
    reach: Bounds,
}

/// True if a mesh follows the skeleton in this format.
pub(super) fn follows(asset: &Asset, object: &MeshObject) -> bool {
    asset.skeleton.is_some() && object.skin.is_some() && object.motion == MeshMotion::Skinned
}

/// Writes skeleton, animation and skinned meshes of an asset under `root`, and returns what changes; nothing if it has none.
pub(super) fn part(
    cx: &Context,
    target: &mut Target,
    root: &str,
    asset: &Asset,
    names: &mut Names,
) -> Result<Vec<Box<dyn Part>>> {
    let Some(skeleton) = asset.skeleton.as_ref().filter(|_| asset.meshes.iter().any(|m| follows(asset, m))) else {
        return Ok(Vec::new());
    };
    let path = format!("{root}/{}", names.unique("skel"));
    target.stage.prim(&path, "SkelRoot", &PrimMeta { api: vec!["SkelBindingAPI"], ..PrimMeta::default() })?;
    let b = extent(&bounds(cx, asset, &AssetFrame::default()));
    let extent = target.set(&format!("{path}.extent"), "float3[]", Array::Float3(&b).into())?;
    target.stage.rel(&format!("{path}.skel:animationSource"), &[format!("{path}/anim")])?;
    target.stage.rel(&format!("{path}.skel:skeleton"), &[format!("{path}/skeleton")])?;
    let joints = tokens(skeleton);
    define_skeleton(cx, target, &format!("{path}/skeleton"), skeleton, &joints)?;
    let animation = define_animation(cx, target, &format!("{path}/anim"), (skeleton, &joints), extent)?;
    let mut parts: Vec<Box<dyn Part>> = vec![Box::new(animation)];
    let mut inner = Names::default();
    for name in ["skeleton", "anim"] {
        inner.unique(name);
    }
    for (i, object) in asset.meshes.iter().enumerate().filter(|(_, m)| follows(asset, m)) {
        let mesh = format!("{path}/{}", inner.unique(&object.name));
        let place = Place { root, path: &mesh, skinned: true, varying: false };
        define(cx, target, &place, &object.mesh)?;
        if let Some(skin) = &object.skin {
            bind(target, &path, &mesh, skin)?;
        }
        parts.extend(super::wet::part(cx, target, i, &mesh, object)?);
    }
    Ok(parts)
}

/// Box of all skinned meshes.
fn bounds(cx: &Context, asset: &Asset, state: &AssetFrame) -> Bounds {
    let mut b = Bounds::default();
    for (i, object) in asset.meshes.iter().enumerate().filter(|(_, m)| follows(asset, m)) {
        let points = mesh_points(asset, object, i, state);
        b = b.union(Bounds::of(points.iter().map(|p| cx.up.vec(*p))));
    }
    b
}

fn define_skeleton(
    cx: &Context,
    target: &mut Target,
    path: &str,
    skeleton: &Skeleton,
    joints: &[String],
) -> Result<()> {
    target.stage.prim(path, "Skeleton", &PrimMeta { api: vec!["SkelBindingAPI"], ..PrimMeta::default() })?;
    let matrices = |poses: &[Trs]| -> Vec<[f64; 16]> { poses.iter().map(|m| matrix(&cx.up.trs(m))).collect() };
    let bind = matrices(&skeleton.bind());
    let rest = matrices(&skeleton.rest_pose());
    target.fix(&format!("{path}.bindTransforms"), "matrix4d[]", Array::Matrix4d(&bind).into())?;
    target.fix(&format!("{path}.joints"), "token[]", Array::Token(joints).into())?;
    target.fix(&format!("{path}.restTransforms"), "matrix4d[]", Array::Matrix4d(&rest).into())?;
    // Joints have no thickness, so the skeleton's own box is that of the joints' places.
    let places = skeleton.bind();
    let b = extent(&Bounds::of(places.iter().map(|m| cx.up.vec(m.t))));
    target.set(&format!("{path}.extent"), "float3[]", Array::Float3(&b).into())?;
    Ok(())
}

/// A pose as the three arrays of an animation.
fn channels(cx: &Context, pose: &[Trs]) -> (Vec<[f32; 3]>, Vec<Quat>, Vec<[f16; 3]>) {
    let pose: Vec<Trs> = pose.iter().map(|m| cx.up.trs(m)).collect();
    let translations = pose.iter().map(|m| m.t.to_array()).collect();
    let rotations = pose.iter().map(|m| unit(m.r)).collect();
    let scales = pose.iter().map(|m| m.s.to_array().map(f16::from_f32)).collect();
    (translations, rotations, scales)
}

fn define_animation(
    cx: &Context,
    target: &mut Target,
    path: &str,
    (skeleton, joints): (&Skeleton, &[String]),
    extent: Attr,
) -> Result<Skinned> {
    target.plain(path, "SkelAnimation")?;
    let (t, r, s) = channels(cx, &skeleton.rest_pose());
    target.fix(&format!("{path}.joints"), "token[]", Array::Token(joints).into())?;
    let rotations = Array::Quatf(bytemuck::cast_slice(&r));
    Ok(Skinned {
        rotations: target.set(&format!("{path}.rotations"), "quatf[]", rotations.into())?,
        scales: target.set(&format!("{path}.scales"), "half3[]", Array::Half3(&s).into())?,
        translations: target.set(&format!("{path}.translations"), "float3[]", Array::Float3(&t).into())?,
        extent,
        before: Vec::new(),
        reach: Bounds::default(),
    })
}

/// Ties a mesh to the skeleton.
fn bind(target: &mut Target, skel: &str, mesh: &str, skin: &SkinWeights) -> Result<()> {
    let indices: Vec<i32> = skin.joints.as_flattened().iter().map(|j| i32::from(*j)).collect();
    let spec = |type_name| AttrSpec { element_size: Some(4), ..AttrSpec::primvar(type_name, "vertex") };
    target.stage.attr(
        &format!("{mesh}.primvars:skel:geomBindTransform"),
        &AttrSpec::new("matrix4d"),
        Some(Value::Matrix4d(matrix(&Trs::IDENTITY))),
    )?;
    target.stage.attr(
        &format!("{mesh}.primvars:skel:jointIndices"),
        &spec("int[]"),
        Some(Array::Int(&indices).into()),
    )?;
    target.stage.attr(
        &format!("{mesh}.primvars:skel:jointWeights"),
        &spec("float[]"),
        Some(Array::Float(skin.weights.as_flattened()).into()),
    )?;
    target.stage.rel(&format!("{mesh}.skel:skeleton"), &[format!("{skel}/skeleton")])
}

impl Part for Skinned {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(skeleton) = &shot.asset.skeleton else { return Ok(()) };
        let rest;
        let pose = if shot.state.pose.len() == skeleton.joints.len() {
            &shot.state.pose
        } else {
            rest = skeleton.rest_pose();
            &rest
        };
        let (t, mut r, s) = channels(cx, pose);
        for (q, before) in r.iter_mut().zip(&self.before) {
            *q = near(*q, *before);
        }
        let b = bounds(cx, shot.asset, shot.state);
        self.reach = self.reach.union(b);
        let b = extent(&b);
        let time = shot.time;
        let mut sample = |attr, array: Array| target.stage.sample(attr, time, array.into());
        sample(self.translations, Array::Float3(&t))?;
        sample(self.rotations, Array::Quatf(bytemuck::cast_slice(&r)))?;
        sample(self.scales, Array::Half3(&s))?;
        sample(self.extent, Array::Float3(&b))?;
        self.before = r;
        Ok(())
    }

    fn reach(&self) -> Bounds {
        self.reach
    }
}

/// Number of joints that readers take without trouble.
pub(super) const MAX_JOINTS: usize = 300;
