//! The USD file of a plant: a Nanite assembly whose base is the skinned bark and whose parts are leaves on joints.
//!
//! The names of the schemas and properties beyond UsdSkel are those of the engine's importer; usd-core passes them on.

use super::joints::WindJoints;
use super::leaves::LeafParts;
use super::wind::Wind;
use crate::skin_remap::remap_influences;
use crate::up_axis::{UpAxis, extent_corners};
use crate::usd::arrays::{as_float3, as_ints, sequential_ids};
use crate::usd::context::UsdContext;
use crate::usd::instancer::{continuous_stage_orientations, to_quath};
use crate::usd::instancer_extent::InstancerBounds;
use crate::usd::layer::LayerBuilder;
use crate::usd::layer_writer::{AttrHandle, AttrSpec, LayerMetadata, PrimMetadata};
use crate::usd::mesh::{MeshTarget, define_mesh};
use crate::usd::skel::{PointInfluences, bind_points, bind_skin, define_animation, define_skeleton, joint_paths};
use crate::usd::usdc::UsdcWriter;
use crate::usd::value::{UsdArray, UsdValue};
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::files::{Names, Output};
use osier_base::geometry::Bounds;
use osier_scene::{Joint, Mesh, RiggedPlant, Skeleton, SkinWeights, Trs};

/// Prefix of the properties of an assembly.
const ASSEMBLY: &str = "unreal:naniteAssembly";
/// Prefix of the properties of a skeleton's wind.
const WIND: &str = "unreal:dynamicWind";

/// Parts of a plant from which its USD file is written.
pub(super) struct AssemblyInput<'a> {
    /// Meshes, joints and influences of the plant in its rest pose.
    pub(super) rig: &'a RiggedPlant,
    /// The joints that are written, with their groups.
    pub(super) joints: &'a WindJoints,
    /// Groups of the joints and their influences, the same as in the JSON file.
    pub(super) wind: &'a Wind,
    /// The leaves of each instancer as parts of the assembly.
    pub(super) parts: &'a [LeafParts],
}

/// Writes the file of a plant. `name`: name of the root prim.
/// # Errors
/// X001 for a number that is not finite, `TooMany`, `Io`.
pub(super) fn write_stage(cx: &UsdContext, out: Output, name: &str, plant: &AssemblyInput) -> Result<()> {
    let mut layer = LayerBuilder::new(Box::new(UsdcWriter::new(Box::new(out))));
    layer.writer.begin(&LayerMetadata::for_scene(&cx.scene, name, UpAxis::Y))?;
    let root = format!("/{name}");
    let api = vec!["NaniteAssemblyRootAPI"];
    layer.writer.define_prim(
        &root,
        "Xform",
        &PrimMetadata { kind: Some("component"), api, ..PrimMetadata::default() },
    )?;
    let mesh_type = UsdValue::Token("skeletalMesh");
    layer.set_uniform(&format!("{root}.{ASSEMBLY}:meshType"), "token", mesh_type)?;
    let skeleton = format!("{root}/stem/skel");
    layer.writer.create_relationship(&format!("{root}.{ASSEMBLY}:skeleton"), std::slice::from_ref(&skeleton))?;
    define_stem(cx, &mut layer, &root, plant)?;
    // Names of prims below the root must differ from the names of the scope of materials and of the stem.
    let mut names = Names::default();
    for taken in ["mtl", "stem"] {
        names.unique(taken);
    }
    for parts in plant.parts.iter().filter(|p| !p.joints.is_empty()) {
        let path = format!("{root}/{}", names.unique(&parts.instancer.name));
        define_parts(cx, &mut layer, &root, &path, parts, plant.joints)?;
    }
    layer.writer.finish()
}

/// Defines the `SkelRoot` with skeleton, pose at rest and skinned meshes, which are the base of the assembly.
fn define_stem(cx: &UsdContext, layer: &mut LayerBuilder, root: &str, plant: &AssemblyInput) -> Result<()> {
    let (path, skeleton) = (format!("{root}/stem"), &plant.joints.skeleton);
    let skel = format!("{path}/skel");
    let paths = joint_paths(skeleton);
    let meshes = || plant.rig.meshes.iter().filter(|m| !m.mesh.points.is_empty());
    let bounds = meshes().fold(Bounds::default(), |b, m| b.union(m.mesh.bounds()));
    let extent = define_skel_root(layer, &path, bounds)?;
    let animation = format!("{path}/rest");
    define_skeleton(cx, layer, &skel, &["DynamicWindSkeletonAPI"], skeleton, &paths)?;
    let names: Vec<String> = skeleton.joints.iter().map(|j| j.name.clone()).collect();
    layer.set_uniform(&format!("{skel}.jointNames"), "token[]", UsdArray::Token(&names).into())?;
    layer.writer.create_relationship(&format!("{skel}.skel:animationSource"), std::slice::from_ref(&animation))?;
    define_wind(layer, &skel, &names, plant.wind)?;
    // One pose: the animation gets no time samples.
    define_animation(cx, layer, &animation, skeleton, &paths, extent)?;
    let mut inner = Names::default();
    for taken in ["skel", "rest"] {
        inner.unique(taken);
    }
    for object in meshes() {
        let mesh = format!("{path}/{}", inner.unique(&object.name));
        define_mesh(cx, layer, &MeshTarget { root, path: &mesh, skinned: true, varying: false }, &object.mesh)?;
        let rigid = || SkinWeights {
            joints: vec![[0; 4]; object.mesh.points.len()],
            weights: vec![[1.0, 0.0, 0.0, 0.0]; object.mesh.points.len()],
        };
        let skin = object.skin.as_ref().map_or_else(rigid, |s| remap_influences(s, &plant.joints.carrier));
        bind_skin(layer, &skel, &mesh, &skin)?;
        set_linear_skinning(layer, &mesh)?;
    }
    Ok(())
}

/// Defines a `SkelRoot` with the extent of `bounds`; returns the attribute of the extent, which `define_animation` takes.
fn define_skel_root(layer: &mut LayerBuilder, path: &str, bounds: Bounds) -> Result<AttrHandle> {
    layer.define_plain_prim(path, "SkelRoot")?;
    let corners = extent_corners(&bounds);
    layer.set_attr(&format!("{path}.extent"), "float3[]", UsdArray::Float3(&corners).into())
}

/// Sets the wind of the skeleton at `skel`. `names`: of its joints, in order.
fn define_wind(layer: &mut LayerBuilder, skel: &str, names: &[String], wind: &Wind) -> Result<()> {
    let groups: Vec<i32> =
        wind.joints.iter().map(|j| narrow::<i32, usize>(j.group, "simulation groups")).collect::<Result<_>>()?;
    // A group has one influence, or two: at the beginning of its chains and at their ends. The array joins the
    // influences of all groups.
    let influences: Vec<f32> =
        wind.groups.iter().flat_map(|g| if g.dual { vec![g.least, g.most] } else { vec![g.influence] }).collect();
    let counts: Vec<i32> = wind.groups.iter().map(|g| if g.dual { 2 } else { 1 }).collect();
    let shift_tops: Vec<f32> = wind.groups.iter().map(|g| g.shift_top).collect();
    let trunks = (0_i32..).zip(&wind.groups).filter(|(_, g)| g.is_trunk).map(|(i, _)| i);
    let trunks: Vec<i32> = trunks.collect();
    let mut set = |name: &str, type_name, value: UsdValue| {
        layer.set_uniform(&format!("{skel}.{WIND}:{name}"), type_name, value).map(|_| ())
    };
    set("gustAttenuation", "float", UsdValue::Float(wind.gust_attenuation))?;
    set("isGroundCover", "bool", UsdValue::Bool(wind.is_ground_cover))?;
    set("jointNames", "token[]", UsdArray::Token(names).into())?;
    set("jointSimulationGroups", "int[]", UsdArray::Int(&groups).into())?;
    set("simulationGroupInfluences", "float[]", UsdArray::Float(&influences).into())?;
    set("simulationGroupNumInfluences", "int[]", UsdArray::Int(&counts).into())?;
    set("simulationGroupShiftTops", "float[]", UsdArray::Float(&shift_tops).into())?;
    set("trunkSimulationGroups", "int[]", UsdArray::Int(&trunks).into())
}

/// Declares that the skin of a mesh is a linear blend of the matrices of its joints.
fn set_linear_skinning(layer: &mut LayerBuilder, mesh: &str) -> Result<()> {
    let value = UsdValue::Token("classicLinear");
    layer.set_uniform(&format!("{mesh}.primvars:skel:skinningMethod"), "token", value).map(|_| ())
}

/// Defines the `PointInstancer` of the parts of one organ, with its prototypes.
fn define_parts(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    path: &str,
    parts: &LeafParts,
    joints: &WindJoints,
) -> Result<()> {
    let instancer = &parts.instancer;
    let api = vec!["NaniteAssemblySkelBindingAPI"];
    let meta = PrimMetadata { kind: Some("group"), api, ..PrimMetadata::default() };
    layer.writer.define_prim(path, "PointInstancer", &meta)?;
    let orientations = to_quath(&continuous_stage_orientations(UpAxis::Y, &instancer.rest, &[]));
    let extent =
        InstancerBounds::of(instancer, UpAxis::Y).extent(&orientations, &instancer.rest.positions, &instancer.rest);
    let protos = as_ints(&instancer.protos, "prototypes of an instancer")?;
    let mut set = |name: &str, type_name, array: UsdArray| {
        layer.set_attr(&format!("{path}.{name}"), type_name, array.into()).map(|_| ())
    };
    set("extent", "float3[]", UsdArray::Float3(&extent))?;
    set("ids", "int64[]", UsdArray::Int64(&sequential_ids(instancer.len())))?;
    set("orientations", "quath[]", UsdArray::Quath(&orientations))?;
    set("positions", "point3f[]", UsdArray::Float3(as_float3(&instancer.rest.positions)))?;
    set("protoIndices", "int[]", UsdArray::Int(protos))?;
    set("scales", "float3[]", UsdArray::Float3(as_float3(&instancer.scales)))?;
    // Each instance is bound to one joint, by the joint's unique name.
    let name =
        |j: &u16| joints.skeleton.joints.get(usize::from(*j)).map_or_else(String::new, |joint| joint.name.clone());
    let names: Vec<String> = parts.joints.iter().map(name).collect();
    let weights = vec![1.0; names.len()];
    let spec = |type_name| AttrSpec { element_size: Some(1), ..AttrSpec::primvar(type_name, "vertex") };
    let bound = format!("{path}.primvars:{ASSEMBLY}:bindJoint");
    layer.writer.create_attr(&format!("{bound}s"), &spec("token[]"), Some(UsdArray::Token(&names).into()))?;
    layer.writer.create_attr(&format!("{bound}Weights"), &spec("float[]"), Some(UsdArray::Float(&weights).into()))?;
    let prototypes: Vec<String> =
        (0..instancer.prototypes.len()).map(|i| format!("{path}/Prototypes/p{i:03}")).collect();
    layer.writer.create_relationship(&format!("{path}.prototypes"), &prototypes)?;
    layer.define_plain_prim(&format!("{path}/Prototypes"), "Scope")?;
    for (prototype, path) in instancer.prototypes.iter().zip(&prototypes) {
        layer.define_plain_prim(path, "Xform")?;
        define_part(cx, layer, root, &format!("{path}/part"), &prototype.mesh)?;
    }
    Ok(())
}

/// Defines a part: a `SkelRoot` with a skeleton of one joint at its origin, which moves its mesh rigidly.
fn define_part(cx: &UsdContext, layer: &mut LayerBuilder, root: &str, path: &str, mesh: &Mesh) -> Result<()> {
    let joint = Joint { name: "part".into(), parent: None, rest: Trs::IDENTITY, radius: 0.0 };
    let skeleton = Skeleton { joints: vec![joint] };
    let paths = joint_paths(&skeleton);
    let (skel, body) = (format!("{path}/skel"), format!("{path}/mesh"));
    define_skel_root(layer, path, mesh.bounds())?;
    define_skeleton(cx, layer, &skel, &[], &skeleton, &paths)?;
    layer.set_uniform(&format!("{skel}.jointNames"), "token[]", UsdArray::Token(&paths).into())?;
    define_mesh(cx, layer, &MeshTarget { root, path: &body, skinned: true, varying: false }, mesh)?;
    bind_rigidly(layer, &skel, &body, mesh.points.len())
}

/// Binds all points of a mesh to the only joint of a skeleton.
fn bind_rigidly(layer: &mut LayerBuilder, skel: &str, mesh: &str, points: usize) -> Result<()> {
    let (joints, weights) = (vec![0; points], vec![1.0; points]);
    bind_points(layer, skel, mesh, &PointInfluences { size: 1, joints: &joints, weights: &weights })?;
    set_linear_skinning(layer, mesh)
}
