//! The node tree flattened: where each mesh stands.

use glam::{Mat4, Quat, Vec3};
use gltf::json::accessor::Type;

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::document::{Document, Instancing};
use crate::{Job, Outcome};

/// Deepest nesting.
const DEPTH: usize = 256;

/// A mesh with its places in the world of the file.
#[derive(Debug)]
pub(super) struct Placed {
    pub(super) mesh: usize,
    /// The node's name and the mesh's.
    pub(super) name: String,
    pub(super) world_from_mesh: Vec<Mat4>,
}

/// All placed meshes of the default scene (the first one, else all roots), parents before children.
/// # Errors
/// X010 for cycles, nodes with two parents, nesting beyond 256, damaged instances.
pub(super) fn walk(job: &mut Job<'_>, document: &Document, buffers: &Buffers<'_>) -> Outcome<Vec<Placed>> {
    let root = &document.root;
    let accessors = Accessors { document, buffers };
    let mut seen = vec![false; root.nodes.len()];
    let mut stack: Vec<(usize, Mat4, usize)> =
        tops(document).into_iter().rev().map(|n| (n, Mat4::IDENTITY, 1)).collect();
    let mut placed = Vec::new();
    let mut skinned = 0;
    while let Some((index, world_from_parent, depth)) = stack.pop() {
        let Some(node) = root.nodes.get(index) else { continue };
        match seen.get_mut(index) {
            Some(first) if !*first => *first = true,
            _ => {
                let message = format_args!("nodes[{index}] is reached twice: a cycle, or two parents");
                return Err(Box::new(
                    job.inside("X010", message).help("every node has one parent; export the file again"),
                ));
            }
        }
        if depth > DEPTH {
            return Err(job.inside("X010", format_args!("nodes[{index}] is nested deeper than {DEPTH}")));
        }
        let world_from_node = world_from_parent * local(node);
        if let Some(mesh) = node.mesh {
            skinned += usize::from(node.skin.is_some());
            // The skin, not the node, would place it; at rest it stands where it was bound.
            let base = if node.skin.is_some() { Mat4::IDENTITY } else { world_from_node };
            let world_from_mesh = match document.instancing.get(&index) {
                Some(instancing) => instances(job, &accessors, index, *instancing)?.iter().map(|m| base * *m).collect(),
                None => vec![base],
            };
            let called = |name: Option<&String>| name.cloned().unwrap_or_default();
            let own = root.meshes.get(mesh.value()).and_then(|m| m.name.as_ref());
            let name = [called(node.name.as_ref()), called(own)].join(" ").trim().to_owned();
            placed.push(Placed { mesh: mesh.value(), name, world_from_mesh });
        }
        let children = node.children.iter().flatten().rev();
        stack.extend(children.map(|c| (c.value(), world_from_node, depth + 1)));
    }
    if skinned > 0 {
        job.warn("X016", format_args!("holds {skinned} skinned meshes; they are read as bound, without their skin"));
    }
    Ok(placed)
}

fn tops(document: &Document) -> Vec<usize> {
    let root = &document.root;
    let scene = root.scene.map_or(0, |s| s.value());
    if let Some(scene) = root.scenes.get(scene) {
        return scene.nodes.iter().map(|n| n.value()).collect();
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    (0..root.nodes.len()).filter(|i| is_child.get(*i) == Some(&false)).collect()
}

fn local(node: &gltf::json::Node) -> Mat4 {
    if let Some(matrix) = &node.matrix {
        return Mat4::from_cols_array(matrix);
    }
    trs(
        node.translation.map_or(Vec3::ZERO, Vec3::from),
        node.rotation.as_ref().map_or(Quat::IDENTITY, |r| Quat::from_array(r.0)),
        node.scale.map_or(Vec3::ONE, Vec3::from),
    )
}

fn trs(t: Vec3, r: Quat, s: Vec3) -> Mat4 {
    let length = r.length();
    let r = if length > 1e-6 { r / length } else { Quat::IDENTITY };
    Mat4::from_scale_rotation_translation(s, r, t)
}

/// Transforms of the instances of a node.
/// Source: EXT_mesh_gpu_instancing.
fn instances(job: &Job<'_>, accessors: &Accessors<'_>, node: usize, of: Instancing) -> Outcome<Vec<Mat4>> {
    let read =
        |index: Option<usize>, kind: Type| index.map(|i| accessors.floats(job, i, &[kind], "instances")).transpose();
    let (t, r, s) = (read(of.translation, Type::Vec3)?, read(of.rotation, Type::Vec4)?, read(of.scale, Type::Vec3)?);
    let counts: Vec<usize> =
        [(&t, 3), (&r, 4), (&s, 3)].iter().filter_map(|(v, n)| v.as_ref().map(|v| v.len() / n)).collect();
    let n = counts.first().copied().unwrap_or(0);
    if counts.iter().any(|c| *c != n) {
        return Err(job.inside("X010", format_args!("nodes[{node}]: its instance attributes differ in length")));
    }
    let vec3 = |v: &Option<Vec<f32>>, i: usize, default: Vec3| {
        v.as_ref().and_then(|v| v.get(3 * i..3 * i + 3)).map_or(default, Vec3::from_slice)
    };
    let quat = |i: usize| r.as_ref().and_then(|v| v.get(4 * i..4 * i + 4)).map_or(Quat::IDENTITY, Quat::from_slice);
    Ok((0..n).map(|i| trs(vec3(&t, i, Vec3::ZERO), quat(i), vec3(&s, i, Vec3::ONE))).collect())
}
