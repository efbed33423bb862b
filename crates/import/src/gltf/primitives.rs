//! Primitives of meshes as parts in world space.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use glam::{Mat3, Mat4, Vec2, Vec3};
use gltf::json::accessor::Type;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::document::{GltfDocument, TextureCoordinates, UvTransform};
use super::materials::GltfMaterials;
use super::nodes::MeshInstances;
use crate::assembly::MeshPart;
use crate::{ImportContext, ImportResult};
use osier_base::math;

/// A part for every instance of every primitive, within the limits on vertices and triangles.
/// # Errors
/// X009 or X010.
pub(super) fn mesh_parts(
    context: &mut ImportContext<'_>,
    document: &GltfDocument,
    buffers: &Buffers<'_>,
    instances: &[MeshInstances],
    materials: &mut GltfMaterials<'_>,
) -> ImportResult<Vec<MeshPart>> {
    let accessors = Accessors { document, buffers };
    let mut meshes: BTreeMap<usize, Vec<MeshPart>> = BTreeMap::new();
    let mut parts = Vec::new();
    let (mut vertices, mut triangles) = (0, 0);
    for instance in instances {
        // A mesh that several nodes place is read once.
        let local = match meshes.entry(instance.mesh) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(mesh(context, &accessors, instance.mesh, materials)?),
        };
        for part in local {
            // Counted before the copies are made.
            let copies = instance.world_from_mesh.len() as u64;
            vertices += part.points.len() as u64 * copies;
            triangles += part.triangles.len() as u64 * copies;
            context.limit("vertices", vertices)?;
            context.limit("triangles", triangles)?;
            let named = |m: &Mat4| MeshPart { name: instance.name.clone(), ..transformed(part, *m) };
            parts.extend(instance.world_from_mesh.iter().map(named));
        }
    }
    Ok(parts)
}

/// A part transformed: normals by the inverse transpose; the triangles of a mirrored part are reversed to keep their side.
fn transformed(part: &MeshPart, world_from_mesh: Mat4) -> MeshPart {
    let mut part = part.clone();
    let linear = Mat3::from_mat4(world_from_mesh);
    let det = linear.determinant();
    part.points.iter_mut().for_each(|p| *p = world_from_mesh.transform_point3(*p));
    if det.abs() > 0.0 {
        // Normals go with the inverse transpose, so that they stay perpendicular under unequal scales.
        let for_normals = linear.inverse().transpose();
        part.normals.iter_mut().for_each(|n| *n = (for_normals * *n).normalize_or_zero());
    } else {
        part.normals.clear();
    }
    if det < 0.0 {
        part.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    part
}

/// Reads the primitives of a mesh that consist of triangles, in the coordinates of the mesh; leaves out others with X016.
fn mesh(
    context: &mut ImportContext<'_>,
    accessors: &Accessors<'_>,
    index: usize,
    materials: &mut GltfMaterials<'_>,
) -> ImportResult<Vec<MeshPart>> {
    let mut parts = Vec::new();
    let Some(mesh) = accessors.document.root.meshes.get(index) else { return Ok(parts) };
    for (k, primitive) in mesh.primitives.iter().enumerate() {
        let place = format!("meshes[{index}].primitives[{k}]");
        if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
            context.warn("X016", "holds morph targets; they are not read");
        }
        let mode = match &primitive.mode {
            Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => *mode,
            _ => {
                let warning =
                    context.error_in_file("X016", format_args!("{place} is made of points or lines; it is left out"));
                context.report.push(*warning);
                continue;
            }
        };
        let material = primitive.material.map(|m| m.value());
        // The material decides which texture coordinates are read.
        let coordinates = materials.texture_coordinates(material);
        let mut part = vertex_attributes(context, accessors, primitive, coordinates)?;
        // Without indices the vertices follow each other as they are stored.
        let order = match primitive.indices {
            Some(indices) => accessors.vertex_indices(context, indices.value())?,
            None => (0..part.points.len()).filter_map(|i| u32::try_from(i).ok()).collect(),
        };
        part.triangles = triangles(&order, mode);
        part.material = materials.material_index(context, material)?;
        part.place = place;
        parts.push(part);
    }
    Ok(parts)
}

/// Vertex attributes of a primitive; texture coordinates of one set, transformed.
/// # Errors
/// X010 where attributes differ in length.
fn vertex_attributes(
    context: &ImportContext<'_>,
    accessors: &Accessors<'_>,
    primitive: &Primitive,
    coordinates: TextureCoordinates,
) -> ImportResult<MeshPart> {
    let attribute = |s: Semantic| primitive.attributes.get(&Checked::Valid(s)).map(|i| i.value());
    // Numbers of an attribute; empty where the primitive does not have it.
    let floats = |s: Semantic, types: &[Type]| {
        attribute(s).map(|i| accessors.floats(context, i, types, "vertices")).transpose().map(Option::unwrap_or_default)
    };
    let points = floats(Semantic::Positions, &[Type::Vec3])?;
    let normals = floats(Semantic::Normals, &[Type::Vec3])?;
    let uvs = floats(Semantic::TexCoords(coordinates.set), &[Type::Vec2])?;
    let colors = floats(Semantic::Colors(0), &[Type::Vec3, Type::Vec4])?;
    // Colours have three or four components, as their accessor says.
    let width = attribute(Semantic::Colors(0)).map_or(4, |i| accessors.width(i)).max(1);
    let part = MeshPart {
        points: points.chunks_exact(3).map(Vec3::from_slice).collect(),
        normals: normals.chunks_exact(3).map(Vec3::from_slice).collect(),
        uvs: uvs.chunks_exact(2).map(|uv| from_gltf_uv(Vec2::from_slice(uv), coordinates.transform)).collect(),
        colors: colors.chunks_exact(width).map(rgba).collect(),
        ..MeshPart::default()
    };
    let n = part.points.len();
    let lengths = [part.normals.len(), part.uvs.len(), part.colors.len()];
    if lengths.iter().any(|l| *l != 0 && *l != n) {
        return Err(context.error_about_file("X010", "has a primitive whose attributes differ in length"));
    }
    Ok(part)
}

/// A vertex colour; absent components are 1.
fn rgba(c: &[f32]) -> [f32; 4] {
    std::array::from_fn(|i| c.get(i).copied().unwrap_or(1.0))
}

/// Texture coordinates with v up.
/// Source: KHR_texture_transform (translation x rotation x scale, rotation counter-clockwise with v down).
fn from_gltf_uv(uv: Vec2, transform: Option<UvTransform>) -> Vec2 {
    let Some(t) = transform else { return Vec2::new(uv.x, 1.0 - uv.y) };
    let (sin, cos) = (math::sin(t.rotation), math::cos(t.rotation));
    // In the file's coordinates, with v down; the last line turns v up.
    let (u, v) = (f64::from(uv.x) * t.scale[0], f64::from(uv.y) * t.scale[1]);
    let (u, v) = (cos * u + sin * v + t.offset[0], -sin * u + cos * v + t.offset[1]);
    Vec2::new(math::narrow(u), math::narrow(1.0 - v))
}

/// Triangles of an index list.
/// Source: glTF 2.0 specification, section 3.7.2.1.
fn triangles(order: &[u32], mode: Mode) -> Vec<[u32; 3]> {
    let triple = |w: &[u32]| match w {
        [a, b, c] => [*a, *b, *c],
        _ => [0; 3],
    };
    match (mode, order) {
        (Mode::TriangleStrip, _) => {
            let turned = |(i, w): (usize, &[u32])| {
                let [a, b, c] = triple(w);
                // Every second triangle of a strip has its first two corners swapped, so that all have one winding.
                if i % 2 == 0 { [a, b, c] } else { [b, a, c] }
            };
            order.windows(3).enumerate().map(turned).collect()
        }
        (Mode::TriangleFan, [hub, rim @ ..]) => {
            rim.iter().zip(rim.iter().skip(1)).map(|(a, b)| [*a, *b, *hub]).collect()
        }
        _ => order.chunks_exact(3).map(triple).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_side() {
        assert_eq!(triangles(&[0, 1, 2, 3], Mode::TriangleStrip), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangles(&[0, 1, 2, 3], Mode::TriangleFan), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(triangles(&[0, 1, 2, 3], Mode::Triangles), [[0, 1, 2]]);
    }

    #[test]
    fn texture_transform_follows_the_specification() {
        let t = UvTransform { offset: [0.1, 0.2], rotation: std::f64::consts::FRAC_PI_2, scale: [2.0, 1.0] };
        let uv = from_gltf_uv(Vec2::new(0.25, 0.5), Some(t));
        // (0.5, 0.5) turned: u = v, v = -u.
        assert!((uv - Vec2::new(0.6, 1.0 - (-0.3))).length() < 1e-6, "{uv}");
    }
}
