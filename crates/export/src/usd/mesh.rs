//! Meshes: static, deforming, and of varying topology.

use std::collections::BTreeMap;

use glam::Vec3;

use super::arrays::{as_float3, as_ints};
use super::context::UsdContext;
use super::layer::{AnimatedPrim, AssetSample, LayerBuilder};
use super::layer_writer::{AttrHandle, AttrSpec, PrimMetadata};
use super::options::Tolerance;
use super::primvar::{self, AnimatedPrimvar};
use super::sample_reduction::{SampleReducer, SampleTolerance, TimeSample};
use super::value::{UsdArray, UsdValue};
use crate::up_axis::{UpAxis, extent_corners};
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::files::safe_name;
use osier_base::geometry::Bounds;
use osier_scene::{MaterialId, Mesh, MeshFrame, MeshMotion};

/// Attributes of a mesh that may get time samples.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeshAttrs {
    points: AttrHandle,
    normals: AttrHandle,
    counts: AttrHandle,
    indices: AttrHandle,
    extent: AttrHandle,
    /// Values and indices of `primvars:st`.
    uvs: Option<[AttrHandle; 2]>,
}

/// Where a mesh is defined, and how it will change.
pub(crate) struct MeshTarget<'a> {
    /// Path of the prim below which the scope of materials is.
    pub(crate) root: &'a str,
    /// Path of the mesh prim in the layer.
    pub(crate) path: &'a str,
    /// Whether the mesh is bound to a skeleton.
    pub(crate) skinned: bool,
    /// Whether its topology varies, so that its material subsets get time samples, too.
    pub(crate) varying: bool,
}

/// The arrays of a mesh in the element types and the axes of the stage.
struct MeshArrays<'a> {
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    /// The number 3 for each triangle.
    counts: Vec<i32>,
    indices: &'a [i32],
    extent: [[f32; 3]; 2],
}

impl<'a> MeshArrays<'a> {
    fn of(mesh: &'a Mesh, up: UpAxis) -> Result<Self> {
        let points = as_float3(&up.stage_vecs(&mesh.points)).to_vec();
        Ok(Self {
            extent: extent_corners(&Bounds::of(points.iter().map(|p| Vec3::from_array(*p)))),
            normals: as_float3(&up.stage_vecs(&mesh.normals)).to_vec(),
            points,
            counts: vec![3; mesh.triangles.len()],
            indices: as_ints(mesh.triangles.as_flattened(), "points of a mesh")?,
        })
    }
}

/// Texture coordinates of the points; zeros for a frame of varying topology that has none.
fn st_or_zeros(mesh: &Mesh) -> Vec<[f32; 2]> {
    if mesh.uvs.is_empty() { vec![[0.0; 2]; mesh.points.len()] } else { bytemuck::cast_slice(&mesh.uvs).to_vec() }
}

/// A material and the indices of its faces.
type MaterialFaces = (MaterialId, Vec<i32>);

/// The faces of each material that has any, in order of first use.
fn material_faces(mesh: &Mesh) -> Result<Vec<MaterialFaces>> {
    let mut out: Vec<MaterialFaces> = Vec::new();
    for s in mesh.subsets.iter().filter(|s| s.count > 0) {
        let end = narrow::<i32, u32>(s.first.saturating_add(s.count), "faces of a mesh")?;
        let faces = s.first.cast_signed()..end;
        match out.iter_mut().find(|(m, _)| *m == s.material) {
            Some((_, list)) => list.extend(faces),
            None => out.push((s.material, faces.collect())),
        }
    }
    Ok(out)
}

/// Defines a mesh in its rest state, with its primvars and materials. Returns the attributes that frames may sample.
pub(crate) fn define_mesh(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    place: &MeshTarget,
    mesh: &Mesh,
) -> Result<MeshAttrs> {
    let families = material_faces(mesh)?;
    let mut api = vec!["MaterialBindingAPI"];
    if place.skinned {
        api.push("SkelBindingAPI");
    }
    let path = place.path;
    layer.writer.define_prim(path, "Mesh", &PrimMetadata { api, ..PrimMetadata::default() })?;
    let two_sided = |m: &MaterialId| cx.scene.materials.get(*m as usize).is_some_and(|m| m.double_sided);
    if place.varying || families.iter().any(|(m, _)| two_sided(m)) {
        layer.set_uniform(&format!("{path}.doubleSided"), "bool", UsdValue::Bool(true))?;
    }
    let a = MeshArrays::of(mesh, cx.up)?;
    let attr = |layer: &mut LayerBuilder, name: &str, type_name, array: UsdArray| {
        layer.set_attr(&format!("{path}.{name}"), type_name, array.into())
    };
    let attrs = MeshAttrs {
        extent: attr(layer, "extent", "float3[]", UsdArray::Float3(&a.extent))?,
        counts: attr(layer, "faceVertexCounts", "int[]", UsdArray::Int(&a.counts))?,
        indices: attr(layer, "faceVertexIndices", "int[]", UsdArray::Int(a.indices))?,
        normals: layer.writer.create_attr(
            &format!("{path}.normals"),
            &AttrSpec::primvar("normal3f[]", "vertex"),
            Some(UsdArray::Float3(&a.normals).into()),
        )?,
        points: attr(layer, "points", "point3f[]", UsdArray::Float3(&a.points))?,
        uvs: define_st(layer, place, mesh, a.indices)?,
    };
    layer.set_uniform(&format!("{path}.orientation"), "token", UsdValue::Token("rightHanded"))?;
    layer.set_uniform(&format!("{path}.subdivisionScheme"), "token", UsdValue::Token("none"))?;
    define_display_color(layer, path, mesh)?;
    // Attributes of a mesh of varying topology are defined by the frames that have them.
    if !place.varying {
        primvar::define_all(layer, path, &mesh.attributes, cx.up)?;
    }
    // One material binds the mesh, several bind subsets that partition its faces. The subsets of varying topology are defined by
    // `VaryingMesh`, which samples them, too.
    match families.as_slice() {
        _ if place.varying => {}
        [] => {}
        [(material, _)] => layer.bind_material(cx, place.root, path, *material)?,
        several => {
            set_partition_family(layer, path)?;
            for (material, faces) in several {
                define_subset(cx, layer, place.root, path, *material, faces)?;
            }
        }
    }
    Ok(attrs)
}

/// Defines `primvars:st`: a coordinate for each point, as an indexed face-varying primvar whose indices equal those of the
/// faces. The crate file stores the two equal index arrays once; importers expect texture coordinates to be face-varying.
fn define_st(
    layer: &mut LayerBuilder,
    place: &MeshTarget,
    mesh: &Mesh,
    corners: &[i32],
) -> Result<Option<[AttrHandle; 2]>> {
    // A mesh that varies and is empty at rest may have coordinates in its frames.
    if mesh.uvs.is_empty() && !(place.varying && mesh.points.is_empty()) {
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

/// Defines `primvars:displayColor` from the vertex colours, if there are any.
fn define_display_color(layer: &mut LayerBuilder, path: &str, mesh: &Mesh) -> Result<()> {
    if mesh.colors.is_empty() || mesh.colors.len() != mesh.points.len() {
        return Ok(());
    }
    // `displayColor` has three components; the alpha of the vertex colours is dropped.
    let rgb: Vec<[f32; 3]> = mesh.colors.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let spec = AttrSpec::primvar("color3f[]", "vertex");
    layer.writer.create_attr(&format!("{path}.primvars:displayColor"), &spec, Some(UsdArray::Float3(&rgb).into()))?;
    Ok(())
}

/// Declares that the material subsets of the mesh at `path` cover each face exactly once.
fn set_partition_family(layer: &mut LayerBuilder, path: &str) -> Result<()> {
    let name = format!("{path}.subsetFamily:materialBind:familyType");
    layer.set_uniform(&name, "token", UsdValue::Token("partition")).map(|_| ())
}

/// Defines the `GeomSubset` with the faces of one material, below the mesh at `mesh`. Returns the attribute `indices`.
fn define_subset(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    root: &str,
    mesh: &str,
    material: MaterialId,
    faces: &[i32],
) -> Result<AttrHandle> {
    let name = cx.scene.materials.get(material as usize).map_or("faces", |m| m.name.as_str());
    let path = format!("{mesh}/{}", safe_name(name));
    layer.writer.define_prim(
        &path,
        "GeomSubset",
        &PrimMetadata { api: vec!["MaterialBindingAPI"], ..PrimMetadata::default() },
    )?;
    layer.set_uniform(&format!("{path}.elementType"), "token", UsdValue::Token("face"))?;
    layer.set_uniform(&format!("{path}.familyName"), "token", UsdValue::Token("materialBind"))?;
    let indices = layer.set_attr(&format!("{path}.indices"), "int[]", UsdArray::Int(faces).into())?;
    layer.bind_material(cx, root, &path, material)?;
    Ok(indices)
}

/// The attribute of velocities, m/s (or angular velocities, degrees/s), of a fixed number of points: created at the first frame
/// that has any.
#[derive(Debug, Default)]
pub(super) struct VelocitySamples(Option<AttrHandle>);

impl VelocitySamples {
    /// Adds a time sample; zeros, `count` of them, if a later frame has no velocities. `path`: of the attribute.
    pub(super) fn sample(
        &mut self,
        layer: &mut LayerBuilder,
        path: &str,
        values: &[[f32; 3]],
        count: usize,
        time: f64,
    ) -> Result<()> {
        // Create no attribute until a frame has velocities: one that holds only zeros would cost space.
        if values.is_empty() && self.0.is_none() {
            return Ok(());
        }
        let attr = match self.0 {
            Some(attr) => attr,
            None => layer.writer.create_attr(path, &AttrSpec::new("vector3f[]"), None)?,
        };
        self.0 = Some(attr);
        let zeros;
        // Once the attribute exists every frame gets a sample: without one, the last motion would be held.
        let values = if values.len() == count {
            values
        } else {
            zeros = vec![[0.0; 3]; count];
            &zeros
        };
        layer.writer.set_time_sample(attr, time, UsdArray::Float3(values).into())
    }
}

/// The reducer of the points of a mesh. `pixel`: see [`MeshInput::pixel`].
pub(super) fn point_reducer(tolerance: &Tolerance, pixel: f32) -> SampleReducer<Vec3> {
    SampleReducer::new(SampleTolerance { strict: tolerance.metres, seen: tolerance.pixels * pixel, levers: Vec::new() })
}

/// A mesh whose points move while its topology stays.
pub(super) struct DeformingMesh {
    pub(super) index: usize,
    pub(super) path: String,
    pub(super) attrs: MeshAttrs,
    pub(super) velocities: VelocitySamples,
    /// Omits samples that interpolation restores. `None` from the first frame with velocities, which
    /// belong to the points of their frame.
    reducer: Option<SampleReducer<Vec3>>,
    /// Box of the points over all frames so far, in the axes of the stage.
    pub(super) clip_bounds: Bounds,
}

impl DeformingMesh {
    fn write_points(&self, layer: &mut LayerBuilder, sample: Option<TimeSample<Vec3>>) -> Result<()> {
        let Some(TimeSample { time, values, .. }) = sample else { return Ok(()) };
        layer.writer.set_time_sample(self.attrs.points, time, UsdArray::Float3(as_float3(&values)).into())
    }
}

impl AnimatedPrim for DeformingMesh {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(object) = sample.asset.meshes.get(self.index) else { return Ok(()) };
        let (points, velocities): (&[Vec3], &[Vec3]) = match sample.state.mesh(self.index) {
            MeshFrame::Points { points, velocities, .. } => (points, velocities),
            _ => (&object.mesh.points, &[]),
        };
        let points = cx.up.stage_vecs(points);
        // An instancer of whole plants needs the extent over the clip, besides the extent of each frame.
        let b = Bounds::of(points.iter().copied());
        self.clip_bounds = self.clip_bounds.union(b);
        let b = extent_corners(&b);
        layer.writer.set_time_sample(self.attrs.extent, sample.time, UsdArray::Float3(&b).into())?;
        if !velocities.is_empty() {
            self.flush_samples(layer)?;
            self.reducer = None;
        }
        let count = points.len();
        match &mut self.reducer {
            Some(reducer) => {
                let unseen = object.mesh.unseen_points(&points);
                let due = reducer.push(TimeSample { time: sample.time, values: points.into_owned(), unseen });
                self.write_points(layer, due)?;
            }
            None => layer.writer.set_time_sample(
                self.attrs.points,
                sample.time,
                UsdArray::Float3(as_float3(&points)).into(),
            )?,
        }
        let v = cx.up.stage_vecs(velocities);
        self.velocities.sample(layer, &format!("{}.velocities", self.path), as_float3(&v), count, sample.time)
    }

    fn flush_samples(&mut self, layer: &mut LayerBuilder) -> Result<()> {
        let last = self.reducer.as_mut().and_then(SampleReducer::finish);
        self.write_points(layer, last)
    }

    fn clip_bounds(&self) -> Bounds {
        self.clip_bounds
    }
}

/// A mesh whose topology differs from frame to frame.
pub(super) struct VaryingMesh {
    pub(super) index: usize,
    pub(super) root: String,
    pub(super) path: String,
    pub(super) attrs: MeshAttrs,
    velocities: AttrHandle,
    /// Indices of the subset of each material seen so far.
    subsets: BTreeMap<MaterialId, AttrHandle>,
    /// Primvars of the attributes seen so far.
    primvars: Vec<AnimatedPrimvar>,
    /// Time codes of the frames so far, at which primvars and subsets that appear later get empty samples.
    times: Vec<f64>,
}

/// A frame of a mesh of varying topology.
#[derive(Clone, Copy)]
struct VaryingFrame<'m> {
    mesh: &'m Mesh,
    /// Time code.
    time: f64,
    /// Whether the values of this frame also become the default values, without a time.
    sets_default: bool,
}

impl VaryingFrame<'_> {
    /// Sets the value of an attribute at the frame.
    fn set(&self, layer: &mut LayerBuilder, attr: AttrHandle, array: UsdArray<'_>) -> Result<()> {
        if self.sets_default {
            layer.writer.set_default(attr, array.into())?;
        }
        layer.writer.set_time_sample(attr, self.time, array.into())
    }
}

impl VaryingMesh {
    pub(super) fn new(
        cx: &UsdContext,
        layer: &mut LayerBuilder,
        index: usize,
        place: &MeshTarget,
        mesh: &Mesh,
    ) -> Result<Self> {
        let attrs = define_mesh(cx, layer, place, mesh)?;
        // Velocities must be as many as points, at rest and in every frame.
        let still = vec![[0.0; 3]; mesh.points.len()];
        let path = format!("{}.velocities", place.path);
        let velocities = layer.set_attr(&path, "vector3f[]", UsdArray::Float3(&still).into())?;
        let families = material_faces(mesh)?;
        // A family without subsets is invalid: for a mesh that is empty at rest, the family is declared with the first
        // faces.
        if !families.is_empty() {
            set_partition_family(layer, place.path)?;
        }
        let mut subsets = BTreeMap::new();
        for (material, faces) in families {
            let attr = define_subset(cx, layer, place.root, place.path, material, &faces)?;
            subsets.insert(material, attr);
        }
        let (root, path) = (place.root.to_owned(), place.path.to_owned());
        Ok(Self { index, root, path, attrs, velocities, subsets, primvars: Vec::new(), times: Vec::new() })
    }

    /// Defines the subsets of materials that appear for the first time, with empty samples at the frames before.
    fn define_new_subsets(
        &mut self,
        cx: &UsdContext,
        layer: &mut LayerBuilder,
        families: &[MaterialFaces],
    ) -> Result<()> {
        if self.subsets.is_empty() && !families.is_empty() {
            set_partition_family(layer, &self.path)?;
        }
        for (material, _) in families {
            if !self.subsets.contains_key(material) {
                let attr = define_subset(cx, layer, &self.root, &self.path, *material, &[])?;
                for t in &self.times {
                    layer.writer.set_time_sample(attr, *t, UsdArray::Int(&[]).into())?;
                }
                self.subsets.insert(*material, attr);
            }
        }
        Ok(())
    }

    /// Samples the subset of every material seen so far, so that the subsets of each frame partition its faces.
    fn sample_subsets(
        &self,
        layer: &mut LayerBuilder,
        frame: VaryingFrame<'_>,
        families: &[MaterialFaces],
    ) -> Result<()> {
        for (material, attr) in &self.subsets {
            let faces = families.iter().find(|(m, _)| m == material).map_or(&[][..], |(_, f)| f);
            frame.set(layer, *attr, UsdArray::Int(faces))?;
        }
        Ok(())
    }

    /// Samples every attribute seen so far, so that its values fit the points at all frames: an empty array at frames
    /// without it.
    fn sample_primvars(&mut self, up: UpAxis, layer: &mut LayerBuilder, frame: VaryingFrame<'_>) -> Result<()> {
        let known = self.primvars.len();
        for a in frame.mesh.attributes.iter().filter(|a| !a.data.is_empty()) {
            if !self.primvars.iter().any(|p| p.name == a.name) {
                self.primvars.push(AnimatedPrimvar::define_without_default(layer, &self.path, a, up)?);
            }
        }
        // An attribute that appears late gets empty samples at the frames before.
        for t in &self.times {
            self.primvars.iter().skip(known).try_for_each(|p| p.sample(layer, *t, &[]))?;
        }
        self.primvars.iter().try_for_each(|p| p.sample(layer, frame.time, &frame.mesh.attributes))
    }
}

impl AnimatedPrim for VaryingMesh {
    fn sample_frame(&mut self, cx: &UsdContext, layer: &mut LayerBuilder, sample: &AssetSample) -> Result<()> {
        let Some(object) = sample.asset.meshes.get(self.index) else { return Ok(()) };
        let (mesh, velocities): (&Mesh, &[Vec3]) = match sample.state.mesh(self.index) {
            MeshFrame::Whole { mesh, velocities } => (mesh, velocities),
            _ => (&object.mesh, &[]),
        };
        let a = MeshArrays::of(mesh, cx.up)?;
        // A sample without velocities still needs as many zeros as points, or readers keep the velocities of the frame
        // before.
        let v = if velocities.len() == mesh.points.len() {
            as_float3(&cx.up.stage_vecs(velocities)).to_vec()
        } else {
            vec![[0.0; 3]; mesh.points.len()]
        };
        let st = st_or_zeros(mesh);
        let mut arrays = vec![
            (self.attrs.extent, UsdArray::Float3(&a.extent)),
            (self.attrs.counts, UsdArray::Int(&a.counts)),
            (self.attrs.indices, UsdArray::Int(a.indices)),
            (self.attrs.normals, UsdArray::Float3(&a.normals)),
            (self.attrs.points, UsdArray::Float3(&a.points)),
            (self.velocities, UsdArray::Float3(&v)),
        ];
        if let Some([values, corners]) = self.attrs.uvs {
            arrays.extend([(values, UsdArray::Float2(&st)), (corners, UsdArray::Int(a.indices))]);
        }
        // The default value is that of the first written frame, as for textures whose files change. Usually it is the
        // mesh at rest, which is already there.
        let rest = &object.mesh;
        let sets_default = self.times.is_empty() && (mesh.points != rest.points || mesh.triangles != rest.triangles);
        let frame = VaryingFrame { mesh, time: sample.time, sets_default };
        arrays.into_iter().try_for_each(|(attr, array)| frame.set(layer, attr, array))?;
        let families = material_faces(mesh)?;
        self.define_new_subsets(cx, layer, &families)?;
        self.sample_primvars(cx.up, layer, frame)?;
        self.sample_subsets(layer, frame, &families)?;
        self.times.push(frame.time);
        Ok(())
    }
}

/// Input of [`define_unskinned`]: a mesh and the visibility of errors in its place.
#[derive(Clone, Copy)]
pub(super) struct MeshInput<'a> {
    /// Index in the meshes of its asset.
    pub(super) index: usize,
    pub(super) object: &'a osier_scene::MeshObject,
    /// Pixel footprint at the asset, m; 0 if errors of any size are visible.
    pub(super) pixel: f32,
}

/// Defines a mesh that is not skinned. Returns the prim that takes its time samples, if it deforms or varies.
pub(super) fn define_unskinned(
    cx: &UsdContext,
    layer: &mut LayerBuilder,
    place: &MeshTarget,
    source: MeshInput<'_>,
) -> Result<Option<Box<dyn AnimatedPrim>>> {
    let MeshInput { index, object, pixel } = source;
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
            velocities: VelocitySamples::default(),
            reducer: Some(point_reducer(&cx.tolerance, pixel)),
            clip_bounds: Bounds::default(),
        })));
    }
    Ok(None)
}
