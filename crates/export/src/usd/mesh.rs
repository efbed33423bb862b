//! Meshes: still, deforming, of varying topology.

use std::collections::BTreeMap;

use glam::Vec3;

use super::axis::{UpAxis, extent};
use super::stage::{Attr, AttrSpec, PrimMeta};
use super::target::{Context, Part, Shot, Target};
use super::value::{Array, Value};
use osier_base::Result;
use osier_base::fence::safe_name;
use osier_base::geometry::Bounds;
use osier_scene::{MaterialId, Mesh, MeshFrame, MeshMotion};

/// Attributes of a mesh that may have samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeshAttrs {
    points: Attr,
    normals: Attr,
    counts: Attr,
    indices: Attr,
    extent: Attr,
    uvs: Option<[Attr; 2]>,
}

/// Where a mesh goes and what is special about it.
pub(super) struct Place<'a> {
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
struct Arrays {
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    counts: Vec<i32>,
    indices: Vec<i32>,
    extent: [[f32; 3]; 2],
}

fn triples(v: &[Vec3]) -> &[[f32; 3]] {
    bytemuck::cast_slice(v)
}

impl Arrays {
    fn of(mesh: &Mesh, up: UpAxis) -> Self {
        let points = triples(&up.vecs(&mesh.points)).to_vec();
        let flat = mesh.triangles.as_flattened();
        Self {
            extent: extent(&Bounds::of(points.iter().map(|p| Vec3::from_array(*p)))),
            normals: triples(&up.vecs(&mesh.normals)).to_vec(),
            points,
            counts: vec![3; mesh.triangles.len()],
            indices: flat.iter().map(|i| i32::try_from(*i).unwrap_or(i32::MAX)).collect(),
        }
    }
}

/// Texture coordinates, zeros where a mesh of varying topology has none.
fn uvs(mesh: &Mesh) -> Vec<[f32; 2]> {
    if mesh.uvs.is_empty() { vec![[0.0; 2]; mesh.points.len()] } else { bytemuck::cast_slice(&mesh.uvs).to_vec() }
}

/// Faces of each material, in order of first use.
fn families(mesh: &Mesh) -> Vec<(MaterialId, Vec<i32>)> {
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
pub(super) fn define(cx: &Context, target: &mut Target, place: &Place, mesh: &Mesh) -> Result<MeshAttrs> {
    let families = families(mesh);
    let mut api = vec!["MaterialBindingAPI"];
    if place.skinned {
        api.push("SkelBindingAPI");
    }
    let path = place.path;
    target.stage.prim(path, "Mesh", &PrimMeta { api, ..PrimMeta::default() })?;
    let two_sided = |m: &MaterialId| cx.scene.materials.get(*m as usize).is_some_and(|m| m.double_sided);
    if place.varying || families.iter().any(|(m, _)| two_sided(m)) {
        target.fix(&format!("{path}.doubleSided"), "bool", Value::Bool(true))?;
    }
    let a = Arrays::of(mesh, cx.up);
    let attr = |target: &mut Target, name: &str, type_name, array: Array| {
        target.set(&format!("{path}.{name}"), type_name, array.into())
    };
    let attrs = MeshAttrs {
        extent: attr(target, "extent", "float3[]", Array::Float3(&a.extent))?,
        counts: attr(target, "faceVertexCounts", "int[]", Array::Int(&a.counts))?,
        indices: attr(target, "faceVertexIndices", "int[]", Array::Int(&a.indices))?,
        normals: target.stage.attr(
            &format!("{path}.normals"),
            &AttrSpec::primvar("normal3f[]", "vertex"),
            Some(Array::Float3(&a.normals).into()),
        )?,
        points: attr(target, "points", "point3f[]", Array::Float3(&a.points))?,
        uvs: coordinates(target, place, mesh, &a.indices)?,
    };
    target.fix(&format!("{path}.orientation"), "token", Value::Token("rightHanded"))?;
    target.fix(&format!("{path}.subdivisionScheme"), "token", Value::Token("none"))?;
    colors(target, path, mesh)?;
    wind(target, path, mesh)?;
    match families.as_slice() {
        _ if place.varying => {}
        [] => {}
        [(material, _)] => target.bind(cx, place.root, path, *material)?,
        several => {
            partition(target, path)?;
            for (material, faces) in several {
                subset(cx, target, place.root, (path, *material), faces)?;
            }
        }
    }
    Ok(attrs)
}

/// One coordinate per point, looked up by face corner: the corners' indices are those of the faces, stored once.
fn coordinates(target: &mut Target, place: &Place, mesh: &Mesh, corners: &[i32]) -> Result<Option<[Attr; 2]>> {
    if mesh.uvs.is_empty() && !place.varying {
        return Ok(None);
    }
    let spec = AttrSpec::primvar("texCoord2f[]", "faceVarying");
    let st =
        target.stage.attr(&format!("{}.primvars:st", place.path), &spec, Some(Array::Float2(&uvs(mesh)).into()))?;
    let indices = target.set(&format!("{}.primvars:st:indices", place.path), "int[]", Array::Int(corners).into())?;
    Ok(Some([st, indices]))
}

fn colors(target: &mut Target, path: &str, mesh: &Mesh) -> Result<()> {
    if mesh.colors.is_empty() || mesh.colors.len() != mesh.points.len() {
        return Ok(());
    }
    let rgb: Vec<[f32; 3]> = mesh.colors.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let spec = AttrSpec::primvar("color3f[]", "vertex");
    target.stage.attr(&format!("{path}.primvars:displayColor"), &spec, Some(Array::Float3(&rgb).into()))?;
    Ok(())
}

/// Attributes for shaders that sway by themselves.
fn wind(target: &mut Target, path: &str, mesh: &Mesh) -> Result<()> {
    if mesh.wind.is_empty() || mesh.wind.len() != mesh.points.len() {
        return Ok(());
    }
    let whole: Vec<[f32; 4]> = mesh.wind.iter().map(|p| p.wind).collect();
    let branch: Vec<[f32; 2]> = mesh.wind.iter().map(|p| p.branch).collect();
    let axes: Vec<i32> = mesh.wind.iter().map(|p| p.axis).collect();
    let list = [
        ("wind", "color4f[]", Array::Float4(&whole)),
        ("wind2", "float2[]", Array::Float2(&branch)),
        ("wind_axis", "int[]", Array::Int(&axes)),
    ];
    for (name, kind, values) in list {
        let spec = AttrSpec::primvar(kind, "vertex");
        target.stage.attr(&format!("{path}.primvars:{name}"), &spec, Some(values.into()))?;
    }
    Ok(())
}

fn partition(target: &mut Target, path: &str) -> Result<()> {
    let name = format!("{path}.subsetFamily:materialBind:familyType");
    target.fix(&name, "token", Value::Token("partition")).map(|_| ())
}

/// The faces of one material of the mesh at `of.0`.
fn subset(cx: &Context, target: &mut Target, root: &str, of: (&str, MaterialId), faces: &[i32]) -> Result<Attr> {
    let name = cx.scene.materials.get(of.1 as usize).map_or("faces", |m| m.name.as_str());
    let path = format!("{}/{}", of.0, safe_name(name));
    target.stage.prim(&path, "GeomSubset", &PrimMeta { api: vec!["MaterialBindingAPI"], ..PrimMeta::default() })?;
    target.fix(&format!("{path}.elementType"), "token", Value::Token("face"))?;
    target.fix(&format!("{path}.familyName"), "token", Value::Token("materialBind"))?;
    let indices = target.set(&format!("{path}.indices"), "int[]", Array::Int(faces).into())?;
    target.bind(cx, root, &path, of.1)?;
    Ok(indices)
}

/// Velocities of a thing with a fixed number of points: written from the first frame that has any.
#[derive(Debug, Default)]
pub(super) struct Velocities(Option<Attr>);

impl Velocities {
    /// Adds a sample; `n` zeros if a later frame has none. `path`: of the attribute.
    pub(super) fn sample(
        &mut self,
        target: &mut Target,
        path: &str,
        values: &[[f32; 3]],
        (n, time): (usize, f64),
    ) -> Result<()> {
        if values.is_empty() && self.0.is_none() {
            return Ok(());
        }
        let attr = match self.0 {
            Some(attr) => attr,
            None => target.stage.attr(path, &AttrSpec::new("vector3f[]"), None)?,
        };
        self.0 = Some(attr);
        let zeros;
        let values = if values.len() == n {
            values
        } else {
            zeros = vec![[0.0; 3]; n];
            &zeros
        };
        target.stage.sample(attr, time, Array::Float3(values).into())
    }
}

/// A mesh whose points move.
pub(super) struct Deforming {
    pub(super) index: usize,
    pub(super) path: String,
    pub(super) attrs: MeshAttrs,
    pub(super) velocities: Velocities,
    /// Box of all frames so far.
    pub(super) reach: Bounds,
}

impl Part for Deforming {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(object) = shot.asset.meshes.get(self.index) else { return Ok(()) };
        let (points, velocities): (&[Vec3], &[Vec3]) = match shot.state.mesh(self.index) {
            MeshFrame::Points { points, velocities, .. } => (points, velocities),
            _ => (&object.mesh.points, &[]),
        };
        let points = cx.up.vecs(points);
        let b = Bounds::of(points.iter().copied());
        self.reach = self.reach.union(b);
        let b = extent(&b);
        target.stage.sample(self.attrs.extent, shot.time, Array::Float3(&b).into())?;
        target.stage.sample(self.attrs.points, shot.time, Array::Float3(triples(&points)).into())?;
        let v = cx.up.vecs(velocities);
        self.velocities.sample(target, &format!("{}.velocities", self.path), triples(&v), (points.len(), shot.time))
    }

    fn reach(&self) -> Bounds {
        self.reach
    }
}

/// A mesh that is another one at every frame.
pub(super) struct Varying {
    pub(super) index: usize,
    pub(super) root: String,
    pub(super) path: String,
    pub(super) attrs: MeshAttrs,
    velocities: Attr,
    /// Indices of the subset of each material seen so far.
    subsets: BTreeMap<MaterialId, Attr>,
    /// Drops that the points are of, and that these are wet, from the first frame that has some.
    drops: Option<[Attr; 2]>,
    /// Times of the frames so far.
    times: Vec<f64>,
}

impl Varying {
    pub(super) fn new(cx: &Context, target: &mut Target, index: usize, place: &Place, mesh: &Mesh) -> Result<Self> {
        let attrs = define(cx, target, place, mesh)?;
        let still = vec![[0.0; 3]; mesh.points.len()];
        let path = format!("{}.velocities", place.path);
        let velocities = target.set(&path, "vector3f[]", Array::Float3(&still).into())?;
        partition(target, place.path)?;
        let mut subsets = BTreeMap::new();
        for (material, faces) in families(mesh) {
            let attr = subset(cx, target, place.root, (place.path, material), &faces)?;
            subsets.insert(material, attr);
        }
        let (root, path) = (place.root.to_owned(), place.path.to_owned());
        Ok(Self { index, root, path, attrs, velocities, subsets, drops: None, times: Vec::new() })
    }

    /// Faces of every material ever seen, so that each frame's subsets are a partition of that frame's faces.
    fn sample_subsets(&mut self, cx: &Context, target: &mut Target, mesh: &Mesh, time: f64) -> Result<()> {
        let families = families(mesh);
        for (material, _) in &families {
            if !self.subsets.contains_key(material) {
                let attr = subset(cx, target, &self.root, (&self.path, *material), &[])?;
                for t in &self.times {
                    target.stage.sample(attr, *t, Array::Int(&[]).into())?;
                }
                self.subsets.insert(*material, attr);
            }
        }
        self.sample_drops(target, mesh, time)?;
        for (material, attr) in &self.subsets {
            let faces = families.iter().find(|(m, _)| m == material).map_or(&[][..], |(_, f)| f);
            target.stage.sample(*attr, time, Array::Int(faces).into())?;
        }
        self.times.push(time);
        Ok(())
    }
}

impl Varying {
    /// `primvars:drop_id`, and `primvars:wetness`, which is 1 for water as leaves have it from 0 to 1.
    fn sample_drops(&mut self, target: &mut Target, mesh: &Mesh, time: f64) -> Result<()> {
        if mesh.drops.is_empty() && self.drops.is_none() {
            return Ok(());
        }
        let known = self.drops.is_some();
        let [id, wetness] = match self.drops {
            Some(attrs) => attrs,
            None => {
                let mut primvar = |name: &str, kind| {
                    let spec = AttrSpec::primvar(kind, "vertex");
                    target.stage.attr(&format!("{}.primvars:{name}", self.path), &spec, None)
                };
                [primvar("drop_id", "int[]")?, primvar("wetness", "float[]")?]
            }
        };
        self.drops = Some([id, wetness]);
        // Frames before had no drops.
        for t in self.times.iter().filter(|_| !known) {
            target.stage.sample(id, *t, Array::Int(&[]).into())?;
            target.stage.sample(wetness, *t, Array::Float(&[]).into())?;
        }
        target.stage.sample(id, time, Array::Int(&mesh.drops).into())?;
        target.stage.sample(wetness, time, Array::Float(&vec![1.0; mesh.drops.len()]).into())
    }
}

impl Part for Varying {
    fn frame(&mut self, cx: &Context, target: &mut Target, shot: &Shot) -> Result<()> {
        let Some(object) = shot.asset.meshes.get(self.index) else { return Ok(()) };
        let (mesh, velocities): (&Mesh, &[Vec3]) = match shot.state.mesh(self.index) {
            MeshFrame::Whole { mesh, velocities } => (mesh, velocities),
            _ => (&object.mesh, &[]),
        };
        let a = Arrays::of(mesh, cx.up);
        let time = shot.time;
        let v = if velocities.len() == mesh.points.len() {
            triples(&cx.up.vecs(velocities)).to_vec()
        } else {
            vec![[0.0; 3]; mesh.points.len()]
        };
        let st = uvs(mesh);
        let mut sample = |attr, array: Array| target.stage.sample(attr, time, array.into());
        sample(self.attrs.extent, Array::Float3(&a.extent))?;
        sample(self.attrs.counts, Array::Int(&a.counts))?;
        sample(self.attrs.indices, Array::Int(&a.indices))?;
        sample(self.attrs.normals, Array::Float3(&a.normals))?;
        sample(self.attrs.points, Array::Float3(&a.points))?;
        sample(self.velocities, Array::Float3(&v))?;
        if let Some([values, corners]) = self.attrs.uvs {
            sample(values, Array::Float2(&st))?;
            sample(corners, Array::Int(&a.indices))?;
        }
        self.sample_subsets(cx, target, mesh, time)
    }
}

/// A mesh of an asset that is not skinned.
pub(super) fn part(
    cx: &Context,
    target: &mut Target,
    index: usize,
    place: &Place,
    object: &osier_scene::MeshObject,
) -> Result<Option<Box<dyn Part>>> {
    if object.motion == MeshMotion::Varying {
        return Ok(Some(Box::new(Varying::new(cx, target, index, place, &object.mesh)?)));
    }
    let attrs = define(cx, target, place, &object.mesh)?;
    if object.motion == MeshMotion::Deforming {
        let path = place.path.to_owned();
        return Ok(Some(Box::new(Deforming {
            index,
            path,
            attrs,
            velocities: Velocities::default(),
            reach: Bounds::default(),
        })));
    }
    Ok(None)
}
