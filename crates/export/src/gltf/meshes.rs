//! Meshes, skins' weights, morph targets and point clouds as primitives.

use std::borrow::Cow;

use glam::{Vec2, Vec3};

use super::Profile;
use super::buffer::last;
use super::document::Document;
use super::json::{Attributes, Index, Mesh as JsonMesh, MeshExtras, MorphTarget, Primitive};
use super::materials::{Shown, Surface, relief, textured};
use super::pieces::{Piece, pieces};
use super::tangents::tangents;
use osier_base::Result;
use osier_scene::{Attribute, AttributeData, MaterialId, Mesh, Points};

/// Vertices of one primitive.
#[derive(Debug)]
pub(super) struct Vertices<'a> {
    /// For errors: asset and element.
    pub what: &'a str,
    pub points: Cow<'a, [Vec3]>,
    pub normals: Cow<'a, [Vec3]>,
    pub uvs: Cow<'a, [Vec2]>,
    pub colors: Cow<'a, [[f32; 4]]>,
    pub attributes: Cow<'a, [Attribute]>,
    pub skin: Option<Influences>,
    /// It has morph targets.
    pub morphs: bool,
}

/// Joints and weights of vertices, and the number of joints in the skin.
#[derive(Debug, Clone)]
pub(super) struct Influences {
    pub joints: Vec<[u16; 4]>,
    pub weights: Vec<[f32; 4]>,
    pub count: usize,
}

/// Points and normals of one shape; the normals may be missing.
pub(super) type Shape = (Vec<Vec3>, Vec<Vec3>);

/// A mesh to write.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawn<'a> {
    pub name: &'a str,
    /// For errors.
    pub what: &'a str,
    pub mesh: &'a Mesh,
    pub shown: Shown,
    /// Over all vertices of the mesh.
    pub skin: Option<&'a Influences>,
    /// Targets with their names.
    pub shapes: &'a [(String, &'a Shape)],
}

const MODE_POINTS: u32 = 0;

impl Document<'_> {
    /// Adds a mesh; `None` if it has no triangles.
    pub(super) fn mesh(&mut self, drawn: Drawn<'_>) -> Result<Option<Index>> {
        let mut primitives = Vec::new();
        for piece in pieces(drawn.mesh) {
            let skin = drawn.skin.map(|s| Influences {
                joints: piece.gather(&s.joints).into_owned(),
                weights: piece.gather(&s.weights).into_owned(),
                count: s.count,
            });
            let vertices = Vertices {
                what: drawn.what,
                points: piece.gather(&drawn.mesh.points),
                normals: piece.gather(&drawn.mesh.normals),
                uvs: piece.gather(&drawn.mesh.uvs),
                colors: piece.gather(&drawn.mesh.colors),
                attributes: piece.gather_attributes(&drawn.mesh.attributes),
                skin,
                morphs: !drawn.shapes.is_empty(),
            };
            let surface = Surface { material: piece.material, shown: drawn.shown };
            let mut primitive = self.primitive(&vertices, &piece.triangles, surface)?;
            primitive.targets = self.targets(drawn, &piece, &vertices)?;
            primitives.push(primitive);
        }
        let target_names: Vec<String> = drawn.shapes.iter().map(|(name, _)| name.clone()).collect();
        let extras = (!target_names.is_empty()).then_some(MeshExtras { target_names });
        self.finish_mesh(JsonMesh { name: drawn.name.to_owned(), primitives, weights: Vec::new(), extras })
    }

    /// Adds a mesh of finished primitives; `None` without any.
    pub(super) fn finish_mesh(&mut self, mesh: JsonMesh) -> Result<Option<Index>> {
        if mesh.primitives.is_empty() {
            return Ok(None);
        }
        self.root.meshes.push(mesh);
        last(self.root.meshes.len()).map(Some)
    }

    /// Adds a primitive of triangles.
    pub(super) fn primitive(
        &mut self,
        vertices: &Vertices<'_>,
        triangles: &[[u32; 3]],
        surface: Surface,
    ) -> Result<Primitive> {
        let what = vertices.what;
        let count = vertices.points.len();
        // Targets of morphs are differences in floats, to which normals in bytes do not add.
        let small = self.from.profile == Profile::Web && !vertices.morphs;
        if small {
            self.uses("KHR_mesh_quantization", true);
        }
        let position = self.buffer.positions(&vertices.points, what)?;
        let mut attributes = Attributes { position, ..Attributes::default() };
        if vertices.normals.len() == count {
            attributes.normal = Some(if small {
                let unit = |n: &Vec3| osier_base::math::normalize_or(*n, Vec3::Y).extend(0.0).to_array();
                let list: Vec<[f32; 4]> = vertices.normals.iter().map(unit).collect();
                self.buffer.directions(&list, "VEC3", what)?
            } else {
                self.buffer.normals(&vertices.normals, what)?
            });
        }
        if vertices.uvs.len() == count && textured(self.from.scene, surface.material) {
            attributes.uv = Some(self.buffer.uvs(&vertices.uvs, what)?);
            if vertices.normals.len() == count && relief(self.from.scene, surface.material) {
                let list = tangents(&vertices.points, &vertices.normals, &vertices.uvs, triangles);
                attributes.tangent = Some(if small {
                    self.buffer.directions(&list, "VEC4", what)?
                } else {
                    self.buffer.quads(&list, what)?
                });
            }
        }
        if vertices.colors.len() == count {
            attributes.color = Some(self.buffer.colors(vertices.colors.iter().copied())?);
        }
        for a in vertices.attributes.iter().filter(|a| a.data.len() == count && count > 0) {
            // Blender's importer mixes up attributes of unlike width and then fails: all that are written have four numbers.
            let quads = match &a.data {
                AttributeData::Unit4(v) => self.buffer.colors(v.iter().copied())?,
                AttributeData::Unit2(v) => self.buffer.colors(v.iter().map(|[x, y]| [*x, *y, 0.0, 0.0]))?,
                _ => continue,
            };
            attributes.custom.insert(custom_name(a), quads);
        }
        if let Some(skin) = &vertices.skin {
            attributes.joints = Some(self.buffer.joints(&skin.joints, skin.count)?);
            attributes.weights = Some(self.buffer.quads(&skin.weights, what)?);
        }
        let indices = Some(self.buffer.indices(triangles, count)?);
        let material = self.surface(surface)?;
        Ok(Primitive { attributes, indices, material, ..Primitive::default() })
    }

    fn targets(&mut self, drawn: Drawn<'_>, piece: &Piece<'_>, base: &Vertices<'_>) -> Result<Vec<MorphTarget>> {
        let difference = |shape: &[Vec3], base: &[Vec3]| -> Vec<Vec3> {
            piece.gather(shape).iter().zip(base).map(|(s, b)| *s - *b).collect()
        };
        let lit = |(points, normals): &Shape| normals.len() == points.len() && piece.gather(normals) != base.normals;
        let turns = base.normals.len() == base.points.len() && drawn.shapes.iter().any(|(_, shape)| lit(shape));
        let mut targets = Vec::with_capacity(drawn.shapes.len());
        for (_, (points, normals)) in drawn.shapes {
            let position = self.buffer.positions(&difference(points, &base.points), drawn.what)?;
            let mut normal = None;
            if turns {
                let target = Some(super::json::target::VERTICES);
                normal = Some(self.buffer.vectors(&difference(normals, &base.normals), target, drawn.what)?);
            }
            targets.push(MorphTarget { normal, position });
        }
        Ok(targets)
    }

    /// Adds a point cloud; hidden points (width 0) are left out. `None` if nothing remains.
    pub(super) fn cloud(&mut self, cloud: &Points, what: &str) -> Result<Option<Index>> {
        let shown: Vec<usize> =
            (0..cloud.positions.len()).filter(|&i| cloud.widths.get(i).is_none_or(|w| *w > 0.0)).collect();
        if shown.is_empty() {
            return Ok(None);
        }
        let points: Vec<Vec3> = shown.iter().map(|&i| cloud.positions[i]).collect();
        let mut attributes = Attributes { position: self.buffer.positions(&points, what)?, ..Attributes::default() };
        let colored = cloud.colors.len() == cloud.positions.len();
        if colored {
            let color = |&i: &usize| {
                let [r, g, b] = cloud.colors[i];
                [r, g, b, 1.0]
            };
            attributes.color = Some(self.buffer.colors(shown.iter().map(color))?);
        }
        for a in &cloud.attributes {
            let Some(all) = a.data.counts().filter(|v| v.len() == cloud.positions.len()) else { continue };
            #[allow(clippy::cast_precision_loss, reason = "below 2^24")]
            let values: Vec<f32> = shown.iter().map(|&i| all[i] as f32).collect();
            attributes.custom.insert(custom_name(a), self.buffer.numbers(&values, what)?);
        }
        let shown = if colored { Shown::Colored } else { Shown::Plain };
        let material = self.surface(Surface { material: cloud.material, shown })?;
        let primitive = Primitive { attributes, material, mode: Some(MODE_POINTS), ..Primitive::default() };
        self.finish_mesh(JsonMesh { name: cloud.name.clone(), primitives: vec![primitive], ..JsonMesh::default() })
    }
}

/// Name of an attribute that glTF does not define: with an underscore, in capitals.
fn custom_name(attribute: &Attribute) -> String {
    format!("_{}", attribute.name.to_ascii_uppercase())
}

/// A surface of a mesh.
pub(super) fn on_mesh(material: MaterialId) -> Surface {
    Surface { material, shown: Shown::Mesh }
}
