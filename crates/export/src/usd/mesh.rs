//! Meshes: still, deforming, of varying topology.

use std::collections::BTreeMap;

use glam::Vec3;

use super::axis::{UpAxis, extent};
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder, UsdContext};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMeta};
use super::value::{UsdArray, UsdValue};
use osier_base::Result;
use osier_base::files::safe_name;
use osier_base::geometry::Bounds;
use osier_scene::{MaterialId, Mesh, MeshFrame, MeshMotion};

/// Attributes of a mesh that may have samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeshAttrs {
    points: AttrHandle,
    normals: AttrHandle,
    counts: AttrHandle,
    indices: AttrHandle,
    extent: AttrHandle,
    uvs: Option<[AttrHandle; 2]>,
}

/// Where a mesh goes and what is special about it.
pub(super) struct MeshPrim<'a> {
    /// Prim that holds the materials' scope.
    pub(super) root: &'a str,
    /// Path of the mesh.
    pub(super) path: &'a str,
    /// Follows a skeleton.
    pub(super) skinned: bool,
    /// Changes its topology, so that its subsets come with its frames.
    pub(super) varying: bool,
}

/// The arrays of a mesh as the format wants them.
struct MeshArrays {
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    counts: Vec<i32>,
    indices: Vec<i32>,
    extent: [[f32; 3]; 2],
}

fn as_float3(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

impl MeshArrays {
    fn of(mesh: &Mesh, up: UpAxis) -> Self {
        let points = as_float3(&up.vecs(&mesh.points)).to_vec();
        let flat = mesh.triangles.as_flattened();
        Self {
            extent: extent(&Bounds::of(points.iter().map(|p| Vec3::from_array(*p)))),
            normals: as_float3(&up.vecs(&mesh.normals)).to_vec(),
            points,
            counts: vec![3; mesh.triangles.len()],
            indices: flat.iter().map(|i| i32::try_from(*i).unwrap_or(i32::MAX)).collect(),
        }
    }
}

/// Texture coordinates, zeros where a mesh of varying topology has none.
fn st_or_zeros(mesh: &Mesh) -> Vec<[f32; 2]> {
    if mesh.uvs.is_empty() { vec![[0.0; 2]; mesh.points.len()] } else { bytemuck::cast_slice(&mesh.uvs).to_vec() }
}

/// Faces of each material, in order of first use.
fn material_faces(mesh: &Mesh) -> Vec<(MaterialId, Vec<i32>)> {
    let mut out: Vec<(MaterialId, Vec<i32>)> = Vec::new();
    for s in &mesh.subsets {
        let faces = (s.first..s.first.saturating_add(s.count)).map(|i| i32::try_from(i).unwrap_or(i32::MAX));
        match out.iter_mut().find(|(m, _)| *m == s.material) {
            Some((_, list)) => list.extend(faces),
            None => out.push((s.material, faces.collect())),
        }
    }
    out
}

/// Writes a mesh at rest.
pub(super) fn define_mesh(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    place: &MeshPrim,
    mesh: &Mesh,
) -> Result<MeshAttrs> {
    let families = material_faces(mesh);
    let mut api = vec!["MaterialBindingAPI"];
    if place.skinned {
        api.push("SkelBindingAPI");
    }
    let path = place.path;
    layer.writer.define_prim(path, "Mesh", &PrimMeta { api, ..PrimMeta::default() })?;
    let two_sided = |m: &MaterialId| cx.scene.materials.get(*m as usize).is_some_and(|m| m.double_sided);
    if place.varying || families.iter().any(|(m, _)| two_sided(m)) {
        layer.set_uniform(&format!("{path}.doubleSided"), "bool", UsdValue::Bool(true))?;
    }
    let a = MeshArrays::of(mesh, cx.up);
    let attr = |layer: &mut LayerBuilder, name: &str, type_name, array: UsdArray| {
        layer.set_attr(&format!("{path}.{name}"), type_name, array.into())
    };
    let attrs = MeshAttrs {
        extent: attr(layer, "extent", "float3[]", UsdArray::Float3(&a.extent))?,
        counts: attr(layer, "faceVertexCounts", "int[]", UsdArray::Int(&a.counts))?,
        indices: attr(layer, "faceVertexIndices", "int[]", UsdArray::Int(&a.indices))?,
        normals: layer.writer.create_attr(
            &format!("{path}.normals"),
            &AttrSpec::primvar("normal3f[]", "vertex"),
            Some(UsdArray::Float3(&a.normals).into()),
        )?,
        points: attr(layer, "points", "point3f[]", UsdArray::Float3(&a.points))?,
        uvs: define_st(layer, place, mesh, &a.indices)?,
    };
    layer.set_uniform(&format!("{path}.orientation"), "token", UsdValue::Token("rightHanded"))?;
    layer.set_uniform(&format!("{path}.subdivisionScheme"), "token", UsdValue::Token("none"))?;
    define_display_color(layer, path, mesh)?;
    define_shader_wind(layer, path, mesh)?;
    match families.as_slice() {
        _ if place.varying => {}
        [] => {}
        [(material, _)] => layer.bind_material(cx, place.root, path, *material)?,
        several => {
            set_partition_family(layer, path)?;
            for (material, faces) in several {
                define_subset(cx, layer, place.root, (path, *material), faces)?;
            }
        }
    }
    Ok(attrs)
}

/// One coordinate per point, looked up by face corner: the corners' indices are those of the faces, stored once.
fn define_st(
    layer: &mut LayerBuilder,
    place: &MeshPrim,
    mesh: &Mesh,
    corners: &[i32],
) -> Result<Option<[AttrHandle; 2]>> {
    if mesh.uvs.is_empty() && !place.varying {
        return Ok(None);
    }
    let spec = AttrSpec::primvar("texCoord2f[]", "faceVarying");
    let st = layer.writer.create_attr(
        &format!("{}.primvars:st", place.path),
        &spec,
        Some(UsdArray::Float2(&st_or_zeros(mesh)).into()),
    )?;
    let indices =
        layer.set_attr(&format!("{}.primvars:st:indices", place.path), "int[]", UsdArray::Int(corners).into())?;
    Ok(Some([st, indices]))
}

fn define_display_color(layer: &mut LayerBuilder, path: &str, mesh: &Mesh) -> Result<()> {
    if mesh.colors.is_empty() || mesh.colors.len() != mesh.points.len() {
        return Ok(());
    }
    let rgb: Vec<[f32; 3]> = mesh.colors.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let spec = AttrSpec::primvar("color3f[]", "vertex");
    layer.writer.create_attr(&format!("{path}.primvars:displayColor"), &spec, Some(UsdArray::Float3(&rgb).into()))?;
    Ok(())
}

/// Attributes for shaders that sway by themselves.
fn define_shader_wind(layer: &mut LayerBuilder, path: &str, mesh: &Mesh) -> Result<()> {
    if mesh.wind.is_empty() || mesh.wind.len() != mesh.points.len() {
        return Ok(());
    }
    let whole: Vec<[f32; 4]> = mesh.wind.iter().map(|p| p.wind).collect();
    let branch: Vec<[f32; 2]> = mesh.wind.iter().map(|p| p.branch).collect();
    let axes: Vec<i32> = mesh.wind.iter().map(|p| p.axis).collect();
    let list = [
        ("wind", "color4f[]", UsdArray::Float4(&whole)),
        ("wind2", "float2[]", UsdArray::Float2(&branch)),
        ("wind_axis", "int[]", UsdArray::Int(&axes)),
    ];
    for (name, kind, values) in list {
        let spec = AttrSpec::primvar(kind, "vertex");
        layer.writer.create_attr(&format!("{path}.primvars:{name}"), &spec, Some(values.into()))?;
    }
    Ok(())
}

fn set_partition_family(layer: &mut LayerBuilder, path: &str) -> Result<()> {
    let name = format!("{path}.subsetFamily:materialBind:familyType");
    layer.set_uniform(&name, "token", UsdValue::Token("partition")).map(|_| ())
}

/// The faces of one material of the mesh at `of.0`.
fn define_subset(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    of: (&str, MaterialId),
    faces: &[i32],
) -> Result<AttrHandle> {
    let name = cx.scene.materials.get(of.1 as usize).map_or("faces", |m| m.name.as_str());
    let path = format!("{}/{}", of.0, safe_name(name));
    layer.writer.define_prim(
        &path,
        "GeomSubset",
        &PrimMeta { api: vec!["MaterialBindingAPI"], ..PrimMeta::default() },
    )?;
    layer.set_uniform(&format!("{path}.elementType"), "token", UsdValue::Token("face"))?;
    layer.set_uniform(&format!("{path}.familyName"), "token", UsdValue::Token("materialBind"))?;
    let indices = layer.set_attr(&format!("{path}.indices"), "int[]", UsdArray::Int(faces).into())?;
    layer.bind_material(cx, root, &path, of.1)?;
    Ok(indices)
}

/// VelocityAttr of a thing with a fixed number of points: written from the first frame that has any.
#[derive(Debug, Default)]
pub(super) struct VelocityAttr(Option<AttrHandle>);

impl VelocityAttr {
    /// Adds a sample; `count` zeros if a later frame has none. `path`: of the attribute.
    pub(super) fn sample(
        &mut self,
        layer: &mut LayerBuilder,
        path: &str,
        values: &[[f32; 3]],
        count: usize,
        time: f64,
    ) -> Result<()> {
        if values.is_empty() && self.0.is_none() {
            return Ok(());
        }
        let attr = match self.0 {
            Some(attr) => attr,
            None => layer.writer.create_attr(path, &AttrSpec::new("vector3f[]"), None)?,
        };
        self.0 = Some(attr);
        let zeros;
        let values = if values.len() == count {
            values
        } else {
            zeros = vec![[0.0; 3]; count];
            &zeros
        };
        layer.writer.set_time_sample(attr, time, UsdArray::Float3(values).into())
    }
}

/// A mesh whose points move.
pub(super) struct DeformingMesh {
    pub(super) index: usize,
    pub(super) path: String,
    pub(super) attrs: MeshAttrs,
    pub(super) velocities: VelocityAttr,
    /// Box of all frames so far.
    pub(super) reach: Bounds,
}

impl AnimatedPrim for DeformingMesh {
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(object) = sample.asset.meshes.get(self.index) else { return Ok(()) };
        let (points, velocities): (&[Vec3], &[Vec3]) = match sample.state.mesh(self.index) {
            MeshFrame::Points { points, velocities, .. } => (points, velocities),
            _ => (&object.mesh.points, &[]),
        };
        let points = cx.up.vecs(points);
        let b = Bounds::of(points.iter().copied());
        self.reach = self.reach.union(b);
        let b = extent(&b);
        layer.writer.set_time_sample(self.attrs.extent, sample.time, UsdArray::Float3(&b).into())?;
        layer.writer.set_time_sample(self.attrs.points, sample.time, UsdArray::Float3(as_float3(&points)).into())?;
        let v = cx.up.vecs(velocities);
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&v), points.len(), sample.time)
    }

    fn reach(&self) -> Bounds {
        self.reach
    }
}

/// A mesh that is another one at every frame.
pub(super) struct VaryingMesh {
    pub(super) index: usize,
    pub(super) root: String,
    pub(super) path: String,
    pub(super) attrs: MeshAttrs,
    velocities: AttrHandle,
    /// Indices of the subset of each material seen so far.
    subsets: BTreeMap<MaterialId, AttrHandle>,
    /// Drops that the points are of, and that these are wet, from the first frame that has some.
    drops: Option<[AttrHandle; 2]>,
    /// Times of the frames so far.
    times: Vec<f64>,
}

impl VaryingMesh {
    pub(super) fn new(
        cx: &UsdContext,
        layer: &mut LayerBuilder,
        index: usize,
        place: &MeshPrim,
        mesh: &Mesh,
    ) -> Result<Self> {
        let attrs = define_mesh(cx, layer, place, mesh)?;
        let still = vec![[0.0; 3]; mesh.points.len()];
        let path = format!("{}.velocities", place.path);
        let velocities = layer.set_attr(&path, "vector3f[]", UsdArray::Float3(&still).into())?;
        set_partition_family(layer, place.path)?;
        let mut subsets = BTreeMap::new();
        for (material, faces) in material_faces(mesh) {
            let attr = define_subset(cx, layer, place.root, (place.path, material), &faces)?;
            subsets.insert(material, attr);
        }
        let (root, path) = (place.root.to_owned(), place.path.to_owned());
        Ok(Self { index, root, path, attrs, velocities, subsets, drops: None, times: Vec::new() })
    }

    /// Faces of every material ever seen, so that each frame's subsets are a partition of that frame's faces.
    fn sample_subsets(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, mesh: &Mesh, time: f64) -> Result<()> {
        let families = material_faces(mesh);
        for (material, _) in &families {
            if !self.subsets.contains_key(material) {
                let attr = define_subset(cx, layer, &self.root, (&self.path, *material), &[])?;
                for t in &self.times {
                    layer.writer.set_time_sample(attr, *t, UsdArray::Int(&[]).into())?;
                }
                self.subsets.insert(*material, attr);
            }
        }
        self.sample_drops(layer, mesh, time)?;
        for (material, attr) in &self.subsets {
            let faces = families.iter().find(|(m, _)| m == material).map_or(&[][..], |(_, f)| f);
            layer.writer.set_time_sample(*attr, time, UsdArray::Int(faces).into())?;
        }
        self.times.push(time);
        Ok(())
    }
}

impl VaryingMesh {
    /// `primvars:drop_id`, and `primvars:wetness`, which is 1 for water as leaves have it from 0 to 1.
    fn sample_drops(&mut self, layer: &mut LayerBuilder, mesh: &Mesh, time: f64) -> Result<()> {
        if mesh.drops.is_empty() && self.drops.is_none() {
            return Ok(());
        }
        let known = self.drops.is_some();
        let [id, wetness] = match self.drops {
            Some(attrs) => attrs,
            None => {
                let mut primvar = |name: &str, kind| {
                    let spec = AttrSpec::primvar(kind, "vertex");
                    layer.writer.create_attr(&format!("{}.primvars:{name}", self.path), &spec, None)
                };
                [primvar("drop_id", "int[]")?, primvar("wetness", "float[]")?]
            }
        };
        self.drops = Some([id, wetness]);
        // Frames before had no drops.
        for t in self.times.iter().filter(|_| !known) {
            layer.writer.set_time_sample(id, *t, UsdArray::Int(&[]).into())?;
            layer.writer.set_time_sample(wetness, *t, UsdArray::Float(&[]).into())?;
        }
        layer.writer.set_time_sample(id, time, UsdArray::Int(&mesh.drops).into())?;
        layer.writer.set_time_sample(wetness, time, UsdArray::Float(&vec![1.0; mesh.drops.len()]).into())
    }
}

impl AnimatedPrim for VaryingMesh {
    fn frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(object) = sample.asset.meshes.get(self.index) else { return Ok(()) };
        let (mesh, velocities): (&Mesh, &[Vec3]) = match sample.state.mesh(self.index) {
            MeshFrame::Whole { mesh, velocities } => (mesh, velocities),
            _ => (&object.mesh, &[]),
        };
        let a = MeshArrays::of(mesh, cx.up);
        let time = sample.time;
        let v = if velocities.len() == mesh.points.len() {
            as_float3(&cx.up.vecs(velocities)).to_vec()
        } else {
            vec![[0.0; 3]; mesh.points.len()]
        };
        let st = st_or_zeros(mesh);
        let mut sample = |attr, array: UsdArray| layer.writer.set_time_sample(attr, time, array.into());
        sample(self.attrs.extent, UsdArray::Float3(&a.extent))?;
        sample(self.attrs.counts, UsdArray::Int(&a.counts))?;
        sample(self.attrs.indices, UsdArray::Int(&a.indices))?;
        sample(self.attrs.normals, UsdArray::Float3(&a.normals))?;
        sample(self.attrs.points, UsdArray::Float3(&a.points))?;
        sample(self.velocities, UsdArray::Float3(&v))?;
        if let Some([values, corners]) = self.attrs.uvs {
            sample(values, UsdArray::Float2(&st))?;
            sample(corners, UsdArray::Int(&a.indices))?;
        }
        self.sample_subsets(cx, layer, mesh, time)
    }
}

/// A mesh of an asset that is not skinned.
pub(super) fn define_unskinned(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    index: usize,
    place: &MeshPrim,
    object: &osier_scene::MeshObject,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    if object.motion == MeshMotion::Varying {
        return Ok(Some(Box::new(VaryingMesh::new(cx, layer, index, place, &object.mesh)?)));
    }
    let attrs = define_mesh(cx, layer, place, &object.mesh)?;
    if object.motion == MeshMotion::Deforming {
        let path = place.path.to_owned();
        return Ok(Some(Box::new(DeformingMesh {
            index,
            path,
            attrs,
            velocities: VelocityAttr::default(),
            reach: Bounds::default(),
        })));
    }
    Ok(None)
}
