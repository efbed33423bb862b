//! Flattens the node hierarchy to the world transforms of each mesh.

use glam::{Mat4, Quat, Vec3};
use gltf::json::accessor::Type;

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::document::{GltfDocument, InstanceAccessors};
use crate::{ImportContext, ImportResult};

/// Deepest nesting of nodes; exporters stay below some dozens.
const MAX_NODE_DEPTH: usize = 256;

/// A mesh with the world transforms of its instances.
#[derive(Debug)]
pub(super) struct MeshInstances {
    pub(super) mesh: usize,
    /// Name of the node and of the mesh, separated by a space.
    pub(super) name: String,
    pub(super) world_from_mesh: Vec<Mat4>,
}

/// All meshes that nodes of the default scene place, parents before children. Roots: see [`root_nodes`].
/// # Errors
/// X010 for cycles, nodes with two parents, nesting beyond 256, damaged instances.
pub(super) fn flatten(
    context: &mut ImportContext<'_>,
    document: &GltfDocument,
    buffers: &Buffers<'_>,
) -> ImportResult<Vec<MeshInstances>> {
    let root = &document.root;
    let accessors = Accessors { document, buffers };
    // A node may be reached once: this excludes cycles and second parents.
    let mut seen = vec![false; root.nodes.len()];
    let mut stack: Vec<(usize, Mat4, usize)> =
        root_nodes(document).into_iter().rev().map(|n| (n, Mat4::IDENTITY, 1)).collect();
    let mut instances: Vec<MeshInstances> = Vec::new();
    // World transform of each node that was reached; then the index of each instance with a skin, and the number of the
    // skin.
    let mut world_from_nodes: Vec<Option<Mat4>> = vec![None; root.nodes.len()];
    let mut skinned: Vec<(usize, usize)> = Vec::new();
    while let Some((index, world_from_parent, depth)) = stack.pop() {
        let Some(node) = root.nodes.get(index) else { continue };
        match seen.get_mut(index) {
            Some(first) if !*first => *first = true,
            _ => {
                let message = format_args!("nodes[{index}] is reached twice: a cycle, or two parents");
                return Err(Box::new(
                    context.error_in_file("X010", message).help("every node has one parent; export the file again"),
                ));
            }
        }
        if depth > MAX_NODE_DEPTH {
            return Err(
                context.error_in_file("X010", format_args!("nodes[{index}] is nested deeper than {MAX_NODE_DEPTH}"))
            );
        }
        let world_from_node = world_from_parent * local_matrix(node);
        world_from_nodes.get_mut(index).into_iter().for_each(|world| *world = Some(world_from_node));
        if let Some(mesh) = node.mesh {
            skinned.extend(node.skin.map(|skin| (instances.len(), skin.value())));
            // A skinned mesh ignores the transform of its node: it stands where its joints do, which may follow in the file.
            let base = if node.skin.is_some() { Mat4::IDENTITY } else { world_from_node };
            let world_from_mesh = match document.instance_accessors.get(&index) {
                Some(instancing) => {
                    instance_matrices(context, &accessors, index, *instancing)?.iter().map(|m| base * *m).collect()
                }
                None => vec![base],
            };
            let called = |name: Option<&String>| name.cloned().unwrap_or_default();
            let own = root.meshes.get(mesh.value()).and_then(|m| m.name.as_ref());
            let name = [called(node.name.as_ref()), called(own)].join(" ").trim().to_owned();
            instances.push(MeshInstances { mesh: mesh.value(), name, world_from_mesh });
        }
        // Reversed, so that children leave the stack in the order of the file.
        let children = node.children.iter().flatten().rev();
        stack.extend(children.map(|c| (c.value(), world_from_node, depth + 1)));
    }
    for (instance, skin) in &skinned {
        let world_from_bound = bound_pose(context, &accessors, *skin, &world_from_nodes)?;
        if let Some(instance) = instances.get_mut(*instance) {
            instance.world_from_mesh.iter_mut().for_each(|m| *m = world_from_bound * *m);
        }
    }
    if !skinned.is_empty() {
        let what = match skinned.len() {
            1 => "a skinned mesh; it is".to_owned(),
            count => format!("{count} skinned meshes; they are"),
        };
        context.warn("X016", format_args!("holds {what} read as bound, without the skin"));
    }
    Ok(instances)
}

/// World transform of a mesh as its skin binds it: that of the first joint times its inverse bind matrix. Joints in
/// their bind pose all give the same matrix; it includes the transform of an armature, and the scale of quantized
/// positions. The identity if no joint is in the scene.
fn bound_pose(
    context: &ImportContext<'_>,
    accessors: &Accessors<'_>,
    skin: usize,
    world_from_nodes: &[Option<Mat4>],
) -> ImportResult<Mat4> {
    let skin = accessors.document.root.skins.get(skin);
    let joint = skin.and_then(|skin| world_from_nodes.get(skin.joints.first()?.value()).copied().flatten());
    let (Some(skin), Some(world_from_joint)) = (skin, joint) else { return Ok(Mat4::IDENTITY) };
    let values = match skin.inverse_bind_matrices {
        Some(index) => accessors.floats(context, index.value(), &[Type::Mat4], "vertices")?,
        None => Vec::new(),
    };
    let joint_from_bound = values.first_chunk::<16>().map_or(Mat4::IDENTITY, Mat4::from_cols_array);
    let pose = world_from_joint * joint_from_bound;
    // The product of a matrix and its inverse is the identity except for rounding.
    Ok(if pose.abs_diff_eq(Mat4::IDENTITY, 1e-5) { Mat4::IDENTITY } else { pose })
}

/// Root nodes of the default scene, or of the first scene if none is the default; without scenes, all nodes that are no
/// child.
fn root_nodes(document: &GltfDocument) -> Vec<usize> {
    let root = &document.root;
    let scene = root.scene.map_or(0, |s| s.value());
    if let Some(scene) = root.scenes.get(scene) {
        return scene.nodes.iter().map(|n| n.value()).collect();
    }
    // Without scenes the roots are the nodes that are no child of another node.
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    (0..root.nodes.len()).filter(|i| is_child.get(*i) == Some(&false)).collect()
}

/// Local transform of a node: its matrix, or translation, rotation and scale.
fn local_matrix(node: &gltf::json::Node) -> Mat4 {
    if let Some(matrix) = &node.matrix {
        return Mat4::from_cols_array(matrix);
    }
    trs(
        node.translation.map_or(Vec3::ZERO, Vec3::from),
        node.rotation.as_ref().map_or(Quat::IDENTITY, |r| Quat::from_array(r.0)),
        node.scale.map_or(Vec3::ONE, Vec3::from),
    )
}

/// T R S as one matrix; a quaternion of no length counts as no rotation.
fn trs(t: Vec3, r: Quat, s: Vec3) -> Mat4 {
    let length = r.length();
    let r = if length > 1e-6 { r / length } else { Quat::IDENTITY };
    Mat4::from_scale_rotation_translation(s, r, t)
}

/// Transforms of the instances of a node, relative to the node.
/// Source: EXT_mesh_gpu_instancing.
fn instance_matrices(
    context: &ImportContext<'_>,
    accessors: &Accessors<'_>,
    node: usize,
    accessor_of: InstanceAccessors,
) -> ImportResult<Vec<Mat4>> {
    let read = |index: Option<usize>, kind: Type| {
        index.map(|i| accessors.floats(context, i, &[kind], "instances")).transpose()
    };
    let (t, r, s) = (
        read(accessor_of.translation, Type::Vec3)?,
        read(accessor_of.rotation, Type::Vec4)?,
        read(accessor_of.scale, Type::Vec3)?,
    );
    // The attributes are optional, but those that are given have one value per instance.
    let counts: Vec<usize> =
        [(&t, 3), (&r, 4), (&s, 3)].iter().filter_map(|(v, n)| v.as_ref().map(|v| v.len() / n)).collect();
    let n = counts.first().copied().unwrap_or(0);
    if counts.iter().any(|c| *c != n) {
        return Err(
            context.error_in_file("X010", format_args!("nodes[{node}]: its instance attributes differ in length"))
        );
    }
    let vec3 = |v: &Option<Vec<f32>>, i: usize, default: Vec3| {
        v.as_ref().and_then(|v| v.get(3 * i..3 * i + 3)).map_or(default, Vec3::from_slice)
    };
    let quat = |i: usize| r.as_ref().and_then(|v| v.get(4 * i..4 * i + 4)).map_or(Quat::IDENTITY, Quat::from_slice);
    Ok((0..n).map(|i| trs(vec3(&t, i, Vec3::ZERO), quat(i), vec3(&s, i, Vec3::ONE))).collect())
}
