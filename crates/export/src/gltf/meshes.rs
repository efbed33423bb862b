//! Meshes and point clouds as primitives, with skin influences and morph targets.

use std::borrow::Cow;

use glam::{Vec2, Vec3};

use super::buffer::last_index;
use super::document::{GeometryKind, GltfDocument, MaterialVariant};
use super::hidden_parts::{HiddenParts, ShownVertices};
use super::json::{Attributes, Index, Mesh as JsonMesh, MeshExtras, MorphTarget, Primitive};
use super::materials::{has_normal_map, uses_uvs};
use super::meshopt;
use super::morph_shape::MorphShape;
use super::options::{INDEX_BYTES, Profile, VECTOR_BYTES, VertexStorage};
use super::quantize::QuantizedCube;
use super::submeshes::{Submesh, split_by_material};
use super::tangents::tangents;
use super::wind_channels::SECOND_UV;
use crate::skin_remap::byte_weights;
use osier_base::Result;
use osier_scene::{Attribute, AttributeData, MaterialId, Mesh, Points};

/// The vertex arrays of one primitive, each as long as `points` or empty.
#[derive(Debug)]
pub(super) struct Vertices<'a> {
    /// Asset and element, for errors.
    pub label: &'a str,
    pub points: Cow<'a, [Vec3]>,
    pub normals: Cow<'a, [Vec3]>,
    pub uvs: Cow<'a, [Vec2]>,
    pub colors: Cow<'a, [[f32; 4]]>,
    pub attributes: Cow<'a, [Attribute]>,
    pub skin: Option<SkinInfluences>,
    /// Whether the primitive has morph targets, whose vertices are in the order of the mesh.
    pub morphs: bool,
    /// The cube of quantized positions; `None` stores metres.
    pub cube: Option<QuantizedCube>,
}

impl Vertices<'_> {
    /// The vertices with these indices, in this order.
    fn gather(&self, indices: &[u32]) -> Self {
        fn pick<T: Copy>(all: &[T], indices: &[u32]) -> Vec<T> {
            indices.iter().filter_map(|i| all.get(*i as usize)).copied().collect()
        }
        let attribute = |a: &Attribute| Attribute { data: a.data.gather(indices), ..*a };
        Self {
            label: self.label,
            points: Cow::Owned(pick(&self.points, indices)),
            normals: Cow::Owned(pick(&self.normals, indices)),
            uvs: Cow::Owned(pick(&self.uvs, indices)),
            colors: Cow::Owned(pick(&self.colors, indices)),
            attributes: Cow::Owned(self.attributes.iter().map(attribute).collect()),
            skin: self.skin.as_ref().map(|s| SkinInfluences {
                joints: pick(&s.joints, indices),
                weights: pick(&s.weights, indices),
                count: s.count,
            }),
            morphs: self.morphs,
            cube: self.cube,
        }
    }
}

/// Up to four joints of each vertex with their weights, and the number of joints in the skin.
#[derive(Debug, Clone)]
pub(super) struct SkinInfluences {
    pub joints: Vec<[u16; 4]>,
    pub weights: Vec<[f32; 4]>,
    pub count: usize,
}

/// A mesh of the scene with the parameters of [`GltfDocument::add_mesh`].
#[derive(Debug, Clone, Copy)]
pub(super) struct MeshSource<'a> {
    pub name: &'a str,
    /// Asset and element, for errors.
    pub label: &'a str,
    pub mesh: &'a Mesh,
    pub geometry: GeometryKind,
    /// Joints and weights of every point of `mesh`, not of one material's points; `None` without a skin.
    pub skin: Option<&'a SkinInfluences>,
    /// Morph targets with their names; empty for a mesh that does not morph.
    pub shapes: &'a [(String, &'a MorphShape)],
    /// Morph targets of a mesh with hidden parts, in place of `shapes`.
    pub parts: Option<PartTargets<'a>>,
    /// The cube of quantized positions that meshes of a skin share; `None`: a cube around this mesh.
    pub cube: Option<QuantizedCube>,
}

impl<'a> MeshSource<'a> {
    /// A mesh without skin and morph targets, with a separate cube. `label`: asset and element, for errors.
    pub(super) fn of(name: &'a str, label: &'a str, mesh: &'a Mesh) -> Self {
        Self { name, label, mesh, geometry: GeometryKind::Mesh, skin: None, shapes: &[], parts: None, cube: None }
    }
}

/// Morph targets of a mesh with hidden parts: the first hides all parts, the others are differences from it.
#[derive(Debug, Clone, Copy)]
pub(super) struct PartTargets<'a> {
    pub hidden: &'a HiddenParts,
    /// Index of each shape that has a target, and name of the target.
    pub written: &'a [(usize, String)],
}

/// Name of the target that hides all parts of a mesh.
const HIDDEN: &str = "hidden";

/// Index of a mesh in the document, and how its stored positions are converted to metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct StoredMesh {
    pub index: Index,
    /// The cube in which positions are stored; `None`: positions are in metres.
    pub cube: Option<QuantizedCube>,
}

const MODE_POINTS: u32 = 0;

impl GltfDocument<'_> {
    /// Adds a mesh with a primitive for each material; `None` if it has no triangles.
    pub(super) fn add_mesh(&mut self, mesh_source: MeshSource<'_>) -> Result<Option<StoredMesh>> {
        let mut primitives = Vec::new();
        // The cube of a mesh that morphs contains all of its shapes, so that no difference between two shapes exceeds
        // its edge.
        let shapes = mesh_source.shapes.iter().flat_map(|(_, shape)| &shape.points);
        let parts = mesh_source.parts.iter().flat_map(|p| {
            let shown = p.written.iter().filter_map(|(k, _)| p.hidden.shapes.get(*k)).flat_map(|s| &s.points);
            p.hidden.hidden.iter().chain(shown)
        });
        let own = || self.quantized_cube(mesh_source.mesh.points.iter().chain(shapes).chain(parts).copied());
        let cube = mesh_source.cube.or_else(own);
        for submesh in split_by_material(mesh_source.mesh) {
            // Influences run over all vertices of the mesh and are restricted as the points are.
            let skin = mesh_source.skin.map(|s| SkinInfluences {
                joints: submesh.gather(&s.joints).into_owned(),
                weights: submesh.gather(&s.weights).into_owned(),
                count: s.count,
            });
            let vertices = Vertices {
                label: mesh_source.label,
                points: submesh.gather(&mesh_source.mesh.points),
                normals: submesh.gather(&mesh_source.mesh.normals),
                uvs: submesh.gather(&mesh_source.mesh.uvs),
                colors: submesh.gather(&mesh_source.mesh.colors),
                attributes: submesh.gather_attributes(&mesh_source.mesh.attributes),
                skin,
                morphs: !mesh_source.shapes.is_empty() || mesh_source.parts.is_some(),
                cube,
            };
            let variant = MaterialVariant { material: submesh.material, geometry: mesh_source.geometry };
            let mut primitive = self.build_primitive(&vertices, &submesh.triangles, variant)?;
            // Every primitive of a mesh must have the same number of targets in the same order (glTF 2.0, section 3.7.2.2).
            primitive.targets = match mesh_source.parts {
                Some(parts) => self.part_targets(parts, &submesh, &vertices)?,
                None => self.morph_targets(mesh_source, &submesh, &vertices)?,
            };
            primitives.push(primitive);
        }
        let mut target_names: Vec<String> = mesh_source.shapes.iter().map(|(name, _)| name.clone()).collect();
        let mut weights = Vec::new();
        if let Some(parts) = mesh_source.parts {
            target_names =
                [HIDDEN.to_owned()].into_iter().chain(parts.written.iter().map(|(_, name)| name.clone())).collect();
            // Readers without animation show the shape with the most visible parts.
            let fullest = parts.hidden.fullest();
            weights = [1.0]
                .into_iter()
                .chain(parts.written.iter().map(|(k, _)| f32::from(u8::from(Some(*k) == fullest))))
                .collect();
        }
        let extras = (!target_names.is_empty()).then_some(MeshExtras { target_names, osier: None });
        let mesh = JsonMesh { name: mesh_source.name.to_owned(), primitives, weights, extras };
        Ok(self.push_mesh(mesh)?.map(|index| StoredMesh { index, cube }))
    }

    /// The cube for positions that will be quantized; `None` if the document stores metres.
    pub(super) fn quantized_cube(&self, points: impl Iterator<Item = Vec3>) -> Option<QuantizedCube> {
        let quantizes = self.input.options.vertex_storage() == VertexStorage::Quantized;
        quantizes.then(|| QuantizedCube::around(points))
    }

    /// Adds a mesh of finished primitives; `None` without any.
    pub(super) fn push_mesh(&mut self, mesh: JsonMesh) -> Result<Option<Index>> {
        if mesh.primitives.is_empty() {
            return Ok(None);
        }
        self.root.meshes.push(mesh);
        last_index(self.root.meshes.len()).map(Some)
    }

    /// A primitive of triangles, with the accessors of its vertex arrays.
    pub(super) fn build_primitive(
        &mut self,
        vertices: &Vertices<'_>,
        triangles: &[[u32; 3]],
        variant: MaterialVariant,
    ) -> Result<Primitive> {
        // Compressed streams are shorter in the order in which triangles use their vertices. Targets keep the order of
        // the mesh.
        let (ordered_vertices, ordered_triangles);
        let (vertices, triangles) = if self.input.options.compresses() && !vertices.morphs {
            let (list, old) = meshopt::reorder(triangles, vertices.points.len())?;
            (ordered_vertices, ordered_triangles) = (vertices.gather(&old), list);
            (&ordered_vertices, ordered_triangles.as_slice())
        } else {
            (vertices, triangles)
        };
        let label = vertices.label;
        let count = vertices.points.len();
        // Without a cube the differences of morph targets are floats, and so are the positions that they are added to.
        let storage = match vertices.cube {
            None if vertices.morphs => VertexStorage::Floats,
            _ => self.input.options.vertex_storage(),
        };
        let small = storage != VertexStorage::Floats;
        let quantized = storage == VertexStorage::Quantized;
        // Colours and weights of bytes need no extension of glTF, and engines convert them to bytes anyway.
        let bytes = quantized || self.input.options.profile == Profile::Engine;
        if small {
            self.use_extension("KHR_mesh_quantization", true);
        }
        let position = match vertices.cube {
            Some(cube) => self.buffer.add_quantized_positions(&vertices.points, cube, label)?,
            None => self.buffer.add_positions(&vertices.points, label)?,
        };
        let mut attributes = Attributes { position, ..Attributes::default() };
        if vertices.normals.len() == count {
            attributes.normal = Some(if small {
                // The fourth byte is padding to the stride of four.
                let unit = |n: &Vec3| osier_base::math::normalize_or(*n, Vec3::Y).extend(0.0).to_array();
                let list: Vec<[f32; 4]> = vertices.normals.iter().map(unit).collect();
                self.buffer.add_quantized_directions(&list, "VEC3", label)?
            } else {
                self.buffer.add_normals(&vertices.normals, label)?
            });
        }
        if vertices.uvs.len() == count && uses_uvs(self.input.scene, variant.material) {
            // Texture coordinates of 16 bits need no extension.
            attributes.uv = Some(if bytes {
                self.buffer.add_quantized_uvs(&vertices.uvs, label)?
            } else {
                self.buffer.add_uvs(&vertices.uvs, label)?
            });
            // Tangent frames need normals and texture coordinates, and only a normal map uses them.
            if vertices.normals.len() == count && has_normal_map(self.input.scene, variant) {
                let list = tangents(&vertices.points, &vertices.normals, &vertices.uvs, triangles);
                attributes.tangent = Some(if small {
                    self.buffer.add_quantized_directions(&list, "VEC4", label)?
                } else {
                    self.buffer.add_vertex_vec4s(&list, label)?
                });
            }
        }
        if vertices.colors.len() == count {
            let colors = vertices.colors.iter().copied();
            attributes.color =
                Some(if bytes { self.buffer.add_byte_colors(colors)? } else { self.buffer.add_colors(colors)? });
        }
        for a in vertices.attributes.iter().filter(|a| a.data.len() == count && count > 0) {
            if let (SECOND_UV, AttributeData::Unit2(pairs)) = (a.name, &a.data) {
                attributes.second_uv = Some(self.buffer.add_vertex_vec2s(pairs, label)?);
                continue;
            }
            // Blender's importer fails on attributes of different widths: all attributes that are written have four
            // numbers. They lie in [0, 1]: 16 bits store them within 1 / 131070.
            let quads = match &a.data {
                AttributeData::Unit4(v) => self.buffer.add_colors(v.iter().copied())?,
                AttributeData::Unit2(v) => self.buffer.add_colors(v.iter().map(|[x, y]| [*x, *y, 0.0, 0.0]))?,
                _ => continue,
            };
            attributes.custom.insert(custom_name(a), quads);
        }
        if let Some(skin) = &vertices.skin {
            let joints = if bytes { Cow::Owned(joints_of_byte_weights(skin)) } else { Cow::Borrowed(&skin.joints) };
            attributes.joints = Some(self.buffer.add_joint_indices(&joints, skin.count)?);
            attributes.weights = Some(if bytes {
                self.buffer.add_byte_weights(&skin.weights, label)?
            } else {
                self.buffer.add_vertex_vec4s(&skin.weights, label)?
            });
        }
        let indices = Some(self.buffer.add_triangle_indices(triangles, count)?);
        let material = self.material_index(variant)?;
        Ok(Primitive { attributes, indices, material, ..Primitive::default() })
    }

    /// The morph targets of a primitive: differences of positions, and of normals if any shape changes them.
    fn morph_targets(
        &mut self,
        mesh_source: MeshSource<'_>,
        submesh: &Submesh<'_>,
        base: &Vertices<'_>,
    ) -> Result<Vec<MorphTarget>> {
        // A target is stored as shape - base; a viewer adds weight times that to the base (glTF 2.0, section 3.7.2.2).
        let difference = |shape: &[Vec3], base: &[Vec3]| -> Vec<Vec3> {
            submesh.gather(shape).iter().zip(base).map(|(s, b)| *s - *b).collect()
        };
        let lit = |shape: &MorphShape| {
            shape.normals.len() == shape.points.len() && submesh.gather(&shape.normals) != base.normals
        };
        // Either all targets of a primitive have normals or none has, as all must have the same attributes.
        let turns = base.normals.len() == base.points.len() && mesh_source.shapes.iter().any(|(_, shape)| lit(shape));
        let mut targets = Vec::with_capacity(mesh_source.shapes.len());
        for (_, MorphShape { points, normals, .. }) in mesh_source.shapes {
            let moved = difference(points, &base.points);
            let position = match base.cube {
                Some(cube) => self.buffer.add_quantized_differences(&moved, cube, mesh_source.label)?,
                None => self.buffer.add_positions(&moved, mesh_source.label)?,
            };
            let mut normal = None;
            if turns {
                let target = Some(super::json::target::VERTICES);
                normal =
                    Some(self.buffer.add_vectors(&difference(normals, &base.normals), target, mesh_source.label)?);
            }
            targets.push(MorphTarget { normal, position });
        }
        Ok(targets)
    }

    /// The morph targets of a primitive with hidden parts.
    fn part_targets(
        &mut self,
        PartTargets { hidden: parts, written }: PartTargets<'_>,
        submesh: &Submesh<'_>,
        base: &Vertices<'_>,
    ) -> Result<Vec<MorphTarget>> {
        let hidden = submesh.gather(&parts.hidden);
        let turns = base.normals.len() == base.points.len() && parts.has_normals();
        // Store the target that hides all parts as floats, relative to the quantized points: the vertices of a part
        // then coincide exactly, and no speck of it stays visible.
        let way = |(h, b): (&Vec3, &Vec3)| base.cube.map_or(*h - *b, |cube| cube.shares(*h) - cube.stored(*b));
        let to_hidden: Vec<Vec3> = hidden.iter().zip(base.points.iter()).map(way).collect();
        let position = self.buffer.add_positions(&to_hidden, base.label)?;
        let normal = if turns { Some(self.target_normals(&[], &[], base)?) } else { None };
        let mut targets = vec![MorphTarget { normal, position }];
        for shown in written.iter().filter_map(|(k, _)| parts.shapes.get(*k)) {
            let (indices, of_shape) = indices_in(submesh, shown);
            let moved: Vec<Vec3> = indices
                .iter()
                .zip(&of_shape)
                .map(|(i, n)| shown.points[*n] - hidden.get(*i as usize).copied().unwrap_or_default())
                .collect();
            let position = self.target_positions(&indices, &moved, base)?;
            let mut normal = None;
            if turns {
                let turned = |(i, n): (&u32, &usize)| shown.normals[*n] - base.normals[*i as usize];
                let turned: Vec<Vec3> = indices.iter().zip(&of_shape).map(turned).collect();
                normal = Some(self.target_normals(&indices, &turned, base)?);
            }
            targets.push(MorphTarget { normal, position });
        }
        Ok(targets)
    }

    /// Differences of positions at the increasing `indices` of a primitive; all others are zero.
    fn target_positions(&mut self, indices: &[u32], values: &[Vec3], base: &Vertices<'_>) -> Result<Index> {
        let (count, label) = (base.points.len(), base.label);
        match (base.cube, self.is_dense(indices.len(), count)) {
            (Some(cube), true) => self.buffer.add_quantized_differences(&spread(indices, values, count), cube, label),
            (Some(cube), false) => self.buffer.add_sparse_quantized_differences(indices, values, count, cube, label),
            (None, true) => self.buffer.add_positions(&spread(indices, values, count), label),
            (None, false) => self.buffer.add_sparse_vectors(indices, values, count, label),
        }
    }

    /// Differences of normals, as [`Self::target_positions`].
    fn target_normals(&mut self, indices: &[u32], values: &[Vec3], base: &Vertices<'_>) -> Result<Index> {
        let (count, label) = (base.points.len(), base.label);
        if self.is_dense(indices.len(), count) {
            let target = Some(super::json::target::VERTICES);
            return self.buffer.add_vectors(&spread(indices, values, count), target, label);
        }
        self.buffer.add_sparse_vectors(indices, values, count, label)
    }

    /// Whether a target with `held` of `count` vertices is shorter as a dense list with zeros than as a sparse one with
    /// indices. Compression shortens zeros, but not indices.
    fn is_dense(&self, held: usize, count: usize) -> bool {
        self.input.options.compresses() || held * (VECTOR_BYTES + INDEX_BYTES) > count * VECTOR_BYTES
    }

    /// Adds a point cloud; hidden points (width 0) are left out. `None` if nothing remains.
    pub(super) fn add_point_cloud(&mut self, cloud: &Points, label: &str) -> Result<Option<StoredMesh>> {
        // Points without widths are all visible.
        let shown: Vec<usize> =
            (0..cloud.positions.len()).filter(|&i| cloud.widths.get(i).is_none_or(|w| *w > 0.0)).collect();
        if shown.is_empty() {
            return Ok(None);
        }
        let points: Vec<Vec3> = shown.iter().map(|&i| cloud.positions[i]).collect();
        let mut attributes =
            Attributes { position: self.buffer.add_positions(&points, label)?, ..Attributes::default() };
        let colored = cloud.colors.len() == cloud.positions.len();
        if colored {
            let color = |&i: &usize| {
                let [r, g, b] = cloud.colors[i];
                [r, g, b, 1.0]
            };
            attributes.color = Some(self.buffer.add_colors(shown.iter().map(color))?);
        }
        for a in &cloud.attributes {
            // Only counts are exported for points: colours and unit vectors are for meshes.
            let Some(all) = a.data.counts().filter(|v| v.len() == cloud.positions.len()) else { continue };
            #[allow(clippy::cast_precision_loss, reason = "below 2^24")]
            let values: Vec<f32> = shown.iter().map(|&i| all[i] as f32).collect();
            attributes.custom.insert(custom_name(a), self.buffer.add_vertex_scalars(&values, label)?);
        }
        let geometry = if colored { GeometryKind::ColoredPoints } else { GeometryKind::PlainPoints };
        let material = self.material_index(MaterialVariant { material: cloud.material, geometry })?;
        let primitive = Primitive { attributes, material, mode: Some(MODE_POINTS), ..Primitive::default() };
        let mesh = JsonMesh { name: cloud.name.clone(), primitives: vec![primitive], ..JsonMesh::default() };
        Ok(self.push_mesh(mesh)?.map(|index| StoredMesh { index, cube: None }))
    }
}

/// The vertices of a submesh that a shape contains: their indices in the submesh, and in the lists of the shape.
fn indices_in(submesh: &Submesh<'_>, shown: &ShownVertices) -> (Vec<u32>, Vec<usize>) {
    let Some(vertices) = &submesh.vertices else {
        return (shown.indices.clone(), (0..shown.indices.len()).collect());
    };
    // Both lists are increasing.
    let mut own = (0_u32..).zip(vertices).peekable();
    let mut found = (Vec::new(), Vec::new());
    for (n, i) in shown.indices.iter().enumerate() {
        while own.next_if(|(_, vertex)| *vertex < i).is_some() {}
        if let Some((index, _)) = own.next_if(|(_, vertex)| *vertex == i) {
            found.0.push(index);
            found.1.push(n);
        }
    }
    found
}

/// A list of `count` vectors: `values` at `indices`, zeros elsewhere.
fn spread(indices: &[u32], values: &[Vec3], count: usize) -> Vec<Vec3> {
    let mut all = vec![Vec3::ZERO; count];
    for (i, value) in indices.iter().zip(values) {
        if let Some(place) = all.get_mut(*i as usize) {
            *place = *value;
        }
    }
    all
}

/// The joints of vertices whose weights are stored as bytes: joint 0 where a weight rounds to 0, as glTF requires for
/// unused slots.
fn joints_of_byte_weights(skin: &SkinInfluences) -> Vec<[u16; 4]> {
    let used = |(joints, weights): (&[u16; 4], &[f32; 4])| {
        let bytes = byte_weights(weights);
        std::array::from_fn(|k| if bytes[k] > 0 { joints[k] } else { 0 })
    };
    skin.joints.iter().zip(&skin.weights).map(used).collect()
}

/// Name of an attribute that glTF does not define: with an underscore, in capitals.
pub(super) fn custom_name(attribute: &Attribute) -> String {
    format!("_{}", attribute.name.to_ascii_uppercase())
}

pub(super) fn mesh_material(material: MaterialId) -> MaterialVariant {
    MaterialVariant { material, geometry: GeometryKind::Mesh }
}
