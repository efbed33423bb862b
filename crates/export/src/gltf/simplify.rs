//! Simplification of meshes by edge collapse, for levels of detail and for leaves that morph.

use glam::Vec3;
use meshoptimizer_rs::{
    Attributes, Limits, Positions, SimplifyOptions, SimplifySettings, Workspace, simplify_with_attributes,
};

use osier_base::convert::saturating_index;
use osier_base::{Error, Result};
use osier_scene::Mesh;

/// Weight of normals relative to positions in the simplification. Larger: limbs stay rounder.
const NORMAL_WEIGHT: f32 = 0.5;
/// Largest deviation of a simplified blade as a share of its size.
pub(super) const BLADE_DEVIATION: f32 = 0.3;

/// Simplifies a mesh to about `most` triangles over the same vertices; each material keeps its share. `deviation`: as a share of
/// the mesh's size; `label`: names the mesh in errors.
pub(super) fn with_fewer_triangles(mesh: &Mesh, most: usize, deviation: f32, label: &str) -> Result<Mesh> {
    if mesh.triangles.len() <= most {
        return Ok(mesh.clone());
    }
    let mut simple = mesh.clone();
    (simple.triangles, simple.subsets) = (Vec::new(), Vec::new());
    for s in &mesh.subsets {
        let triangles = mesh.subset_triangles(s);
        let target = share_of(most, triangles.len(), mesh.triangles.len()).max(1);
        let list = simplified(mesh, triangles, target, deviation, label)?;
        simple.append_subset(s.material, list);
    }
    Ok(simple)
}

/// The mesh without vertices that no triangle uses.
pub(super) fn compact(mesh: &Mesh) -> Mesh {
    let mut used: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    Mesh {
        triangles: mesh.triangles.iter().map(|t| t.map(|i| index_in(&used, i))).collect(),
        subsets: mesh.subsets.clone(),
        ..vertices_of(mesh, &used)
    }
}

pub(super) fn area(mesh: &Mesh) -> f64 {
    mesh.triangles.iter().map(|t| triangle_area(mesh, t)).sum()
}

pub(super) fn triangle_area(mesh: &Mesh, t: &[u32; 3]) -> f64 {
    let [a, b, c] = t.map(|i| mesh.points.get(i as usize).copied().unwrap_or_default());
    f64::from((b - a).cross(c - a).length()) * 0.5
}

/// `list` if it has a value for each of `count` vertices, else `count` times `fill`: meshes omit attributes that they lack.
pub(super) fn padded<T: Copy>(list: &[T], count: usize, fill: T) -> Vec<T> {
    if list.len() == count { list.to_vec() } else { vec![fill; count] }
}

/// Selects the values of `vertices` from a vertex attribute; empty if the mesh lacks the attribute.
pub(super) fn pick<T: Copy>(list: &[T], vertices: &[u32]) -> Vec<T> {
    vertices.iter().filter_map(|i| list.get(*i as usize)).copied().collect()
}

/// A mesh of the given vertices in this order, without triangles and custom attributes.
pub(super) fn vertices_of(mesh: &Mesh, vertices: &[u32]) -> Mesh {
    Mesh {
        points: pick(&mesh.points, vertices),
        normals: pick(&mesh.normals, vertices),
        uvs: pick(&mesh.uvs, vertices),
        colors: pick(&mesh.colors, vertices),
        ..Mesh::default()
    }
}

/// `total` times `part` / `all`, rounded down; 0 if `all` is 0.
pub(super) fn share_of(total: usize, part: usize, all: usize) -> usize {
    let share = total as u128 * part as u128 / (all as u128).max(1);
    // `part` is at most `all`, so that the share is at most `total`, which is a usize.
    usize::try_from(share).unwrap_or(usize::MAX)
}

/// Position of `vertex` in a sorted list that contains it.
pub(super) fn index_in(sorted: &[u32], vertex: u32) -> u32 {
    sorted.binary_search(&vertex).map_or(0, saturating_index)
}

/// Collapses edges of `triangles` until about `target` of them remain over the same vertices. `deviation`: as a share of the
/// mesh's size; `label`: names the mesh in errors.
fn simplified(
    mesh: &Mesh,
    triangles: &[[u32; 3]],
    target: usize,
    deviation: f32,
    label: &str,
) -> Result<Vec<[u32; 3]>> {
    let refused = |e: meshoptimizer_rs::Error| {
        Error::export("X005", format!("{label}: {e}; raise output.gltf.triangles, so that less is simplified"))
    };
    if target >= triangles.len() {
        return Ok(triangles.to_vec());
    }
    let positions: Vec<[f32; 3]> = mesh.points.iter().map(|p| p.to_array()).collect();
    let normals: Vec<f32> =
        padded(&mesh.normals, mesh.points.len(), Vec3::Y).iter().flat_map(|n| n.to_array()).collect();
    let attributes = Attributes::from_interleaved(&normals, mesh.points.len(), 3, 3, 0).map_err(refused)?;
    // PRUNE: small unconnected parts may vanish. SPARSE: the triangles use few of the vertices, which saves work on the others.
    let bits = SimplifyOptions::PRUNE.bits() | SimplifyOptions::SPARSE.bits();
    let options = SimplifyOptions::from_bits(bits).map_err(refused)?;
    let settings = SimplifySettings { target_index_count: target * 3, target_error: deviation, options };
    // No limits: osier has already checked the size of the mesh.
    let mut workspace = Workspace::new(Limits { max_bytes: usize::MAX, max_work: u64::MAX });
    let simple = simplify_with_attributes(
        triangles.as_flattened(),
        Positions::from_packed(&positions),
        attributes,
        &[NORMAL_WEIGHT; 3],
        None,
        settings,
        &mut workspace,
    )
    .map_err(refused)?;
    Ok(simple.indices.as_chunks::<3>().0.to_vec())
}
