//! Instances: by EXT_mesh_gpu_instancing for viewers that support it, merged into one mesh otherwise.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::{Quat, Vec3};

use super::document::GltfDocument;
use super::json::{Index, InstanceAttributes, Instancing, Mesh as JsonMesh, NodeExtensions};
use super::keys::renormalized;
use super::meshes::{MeshSource, StoredMesh, Vertices, custom_name, mesh_material};
use super::quantize::{QuantizedCube, place_stored};
use super::stream::Stream;
use super::submeshes::{Submesh, split_by_material};
use osier_base::Result;
use osier_base::convert::index;
use osier_base::par::par_chunks;
use osier_scene::{Attribute, AttributeData, InstanceState, Instancer, MaterialId, Mesh, Trs, bent_normal};

/// Instances of one prototype below the same node.
#[derive(Debug)]
pub(super) struct InstanceGroup<'a> {
    pub instancer: &'a Instancer,
    pub state: &'a InstanceState,
    /// Index into the prototypes of `instancer`.
    pub proto: usize,
    /// Indices into `instancer`; only instances that are alive in `state`.
    pub members: Vec<usize>,
    /// Asset and instancer, for errors.
    pub label: &'a str,
}

/// Indices of the live instances of each prototype, increasing; an empty list for a prototype without any.
pub(super) fn live_by_prototype(instancer: &Instancer, state: &InstanceState) -> Vec<Vec<usize>> {
    let mut lists = vec![Vec::new(); instancer.prototypes.len()];
    for i in (0..instancer.len()).filter(|&i| state.is_alive(i)) {
        if let Some(list) = lists.get_mut(instancer.protos[i] as usize) {
            list.push(i);
        }
    }
    lists
}

const MERGE_CHUNK: usize = 1024;

impl GltfDocument<'_> {
    /// Adds the mesh of a prototype once, for its instances to refer to; `None` if it has no triangles.
    pub(super) fn add_prototype_mesh(
        &mut self,
        instancer: &Instancer,
        proto: usize,
        label: &str,
    ) -> Result<Option<StoredMesh>> {
        let Some(p) = instancer.prototypes.get(proto) else { return Ok(None) };
        let name = format!("{}_{}", instancer.name, p.name);
        self.add_mesh(MeshSource::of(&name, label, &p.mesh))
    }

    /// The instancing extension for a group below a joint. `joint`: transform of the joint to the asset's space at rest; `cube`:
    /// that of the prototype's stored positions.
    pub(super) fn group_instancing(
        &mut self,
        group: &InstanceGroup<'_>,
        joint: &Trs,
        cube: Option<QuantizedCube>,
    ) -> Result<NodeExtensions> {
        let place = |i: &usize| place_stored(&group.transform(*i, joint), cube);
        let list: Vec<Trs> = group.members.iter().map(place).collect();
        let mut extensions = self.add_instancing(&list, Stream::INSTANCE_ROTATIONS, group.label)?;
        extensions.instancing.attributes.custom = self.leaf_attributes(group, &[joint.r.conjugate()])?;
        Ok(extensions)
    }

    /// The attributes that leaves have at rest, for the members of a group, once for each of `turns`: the rotations from the
    /// space of the asset to that of a joint, or to those of copies.
    pub(super) fn leaf_attributes(
        &mut self,
        group: &InstanceGroup<'_>,
        turns: &[Quat],
    ) -> Result<BTreeMap<String, Index>> {
        let members: Vec<u32> =
            group.members.iter().map(|i| index(*i, "instances of a node")).collect::<Result<_>>()?;
        let mut custom = BTreeMap::new();
        for a in group.state.attributes.iter().filter(|a| a.is_of_leaves()) {
            let accessor = match a.data.gather(&members) {
                AttributeData::Unit4(colors) => self.buffer.add_instance_quads(&colors.repeat(turns.len()))?,
                AttributeData::Unit1(values) => self.buffer.add_scalars(&values.repeat(turns.len()), group.label)?,
                AttributeData::Vector(list) => {
                    let turned = |turn: &Quat| list.iter().map(|v| *turn * Vec3::from_array(*v)).collect::<Vec<_>>();
                    let list: Vec<Vec3> = turns.iter().flat_map(turned).collect();
                    self.buffer.add_vectors(&list, None, group.label)?
                }
                _ => continue,
            };
            custom.insert(custom_name(a), accessor);
        }
        Ok(custom)
    }

    /// The instancing extension with these transforms: translation and scale as floats, rotation as normalised i16. A scale of 1
    /// throughout is omitted. `stream`: how compression rounds the rotations; `label`: names the instances in errors.
    pub(super) fn add_instancing(&mut self, list: &[Trs], stream: Stream, label: &str) -> Result<NodeExtensions> {
        // q and -q are the same rotation; the one with w >= 0 is written.
        let rotations: Vec<Quat> = list.iter().map(|t| if t.r.w < 0.0 { -t.r } else { t.r }).collect();
        let translations: Vec<Vec3> = list.iter().map(|t| t.t).collect();
        let scales: Vec<Vec3> = list.iter().map(|t| t.s).collect();
        // Rotation, scale, translation: alphabetical order, in which the JSON lists the attributes.
        let rotation = self.buffer.add_instance_rotations(&rotations, stream, label)?;
        let scale = if scales.iter().any(|s| *s != Vec3::ONE) {
            Some(self.buffer.add_vectors(&scales, None, label)?)
        } else {
            None
        };
        let translation = self.buffer.add_vectors(&translations, None, label)?;
        self.use_extension("EXT_mesh_gpu_instancing", true);
        let attributes = InstanceAttributes { rotation, scale, translation, custom: BTreeMap::new() };
        Ok(NodeExtensions { instancing: Instancing { attributes } })
    }

    /// All instances of some groups of one instancer as one mesh below a joint, with a primitive for each material: instance
    /// after instance, each with its prototype's vertices. `joint`: transform of the joint to the asset's space at rest.
    pub(super) fn add_merged_mesh(
        &mut self,
        name: String,
        groups: &[InstanceGroup<'_>],
        joint: &Trs,
    ) -> Result<Option<StoredMesh>> {
        let mut meshes: BTreeMap<MaterialId, Mesh> = BTreeMap::new();
        let mut label = "";
        for group in groups {
            label = group.label;
            let Some(prototype) = group.instancer.prototypes.get(group.proto) else { continue };
            for submesh in split_by_material(&prototype.mesh) {
                let mesh = repeat_submesh(group, &prototype.mesh, &submesh, joint)?;
                // The map is sorted by material, so the order of the primitives depends neither on groups nor on prototypes.
                meshes.entry(submesh.material).or_default().append(&mesh);
            }
        }
        let cube = self.quantized_cube(meshes.values().flat_map(|m| m.points.iter().copied()));
        let mut primitives = Vec::new();
        for (material, mesh) in meshes {
            let vertices = Vertices {
                label,
                points: Cow::Owned(mesh.points),
                normals: Cow::Owned(mesh.normals),
                uvs: Cow::Owned(mesh.uvs),
                colors: Cow::Owned(mesh.colors),
                attributes: Cow::Owned(mesh.attributes),
                skin: None,
                morphs: false,
                cube,
            };
            primitives.push(self.build_primitive(&vertices, &mesh.triangles, mesh_material(material))?);
        }
        // The subsets were joined by material above, so no material occurs in two primitives.
        let mesh = self.push_mesh(JsonMesh { name, primitives, ..JsonMesh::default() })?;
        Ok(mesh.map(|index| StoredMesh { index, cube }))
    }
}

impl InstanceGroup<'_> {
    /// Transform of an instance in the space of a joint; the joint's scale is ignored.
    fn transform(&self, instance: usize, joint: &Trs) -> Trs {
        let trs = self.instancer.transform(self.state, instance);
        // Relative to the joint J at rest: J^-1 T has translation R_J^-1 (t - t_J), rotation R_J^-1 r and the scale of T.
        let back = joint.r.conjugate();
        Trs { t: back * (trs.t - joint.t), r: renormalized(back * trs.r), s: trs.s }
    }
}

/// The part of a prototype that has one material, repeated for every member of the group.
fn repeat_submesh(group: &InstanceGroup<'_>, mesh: &Mesh, submesh: &Submesh<'_>, joint: &Trs) -> Result<Mesh> {
    let single = Mesh {
        points: submesh.gather(&mesh.points).into_owned(),
        normals: submesh.gather(&mesh.normals).into_owned(),
        uvs: submesh.gather(&mesh.uvs).into_owned(),
        colors: submesh.gather(&mesh.colors).into_owned(),
        attributes: Vec::new(),
        triangles: submesh.triangles.to_vec(),
        subsets: Vec::new(),
    };
    // Chunks have a fixed size and are joined in order: the result does not depend on the number of threads.
    let chunks = par_chunks(&group.members, MERGE_CHUNK, |_, chunk| -> Result<Mesh> {
        let mut out = Mesh::default();
        for i in chunk {
            let toward = joint.r.conjugate() * group.state.canopy_normal(*i);
            append_transformed(&mut out, &single, &group.transform(*i, joint), toward)?;
        }
        out.attributes = vertex_attributes(group, chunk, single.points.len());
        Ok(out)
    });
    let mut chunks = chunks.into_iter();
    let mut merged = chunks.next().transpose()?.unwrap_or_default();
    for chunk in chunks {
        merged.append(&chunk?);
    }
    Ok(merged)
}

/// The attributes that leaves have at rest at each of their vertices: colours and occlusion. Normals are bent already.
fn vertex_attributes(group: &InstanceGroup<'_>, members: &[usize], points: usize) -> Vec<Attribute> {
    fn repeated<T: Copy>(list: &[T], members: &[usize], points: usize) -> Vec<T> {
        members.iter().filter_map(|i| list.get(*i)).flat_map(|v| std::iter::repeat_n(*v, points)).collect()
    }
    let leaves = group.state.attributes.iter().filter(|a| a.is_of_leaves());
    let at_vertices = leaves.filter_map(|a| match &a.data {
        AttributeData::Unit4(v) => Some(Attribute::vertex(a.name, AttributeData::Unit4(repeated(v, members, points)))),
        AttributeData::Unit1(v) => {
            // Merged meshes have attributes of four numbers.
            let quads = repeated(v, members, points).into_iter().map(|x| [x, 0.0, 0.0, 0.0]).collect();
            Some(Attribute::vertex(a.name, AttributeData::Unit4(quads)))
        }
        _ => None,
    });
    at_vertices.collect()
}

/// Appends a transformed copy of a mesh: normals by the inverse transpose of the transform, bent by `toward`.
fn append_transformed(out: &mut Mesh, single: &Mesh, trs: &Trs, toward: Vec3) -> Result<()> {
    let base = index(out.points.len(), "points of a mesh")?;
    out.points.extend(single.points.iter().map(|p| trs.apply(*p)));
    let turned = |n: &Vec3| osier_base::math::normalize_or(trs.r * (*n / trs.s), *n);
    out.normals.extend(single.normals.iter().map(|n| bent_normal(turned(n), toward)));
    out.uvs.extend_from_slice(&single.uvs);
    out.colors.extend_from_slice(&single.colors);
    out.triangles.extend(single.triangles.iter().map(|t| t.map(|i| base.saturating_add(i))));
    Ok(())
}
