//! Instances: by extension where viewers know it, merged into one mesh per prototype where they do not.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::{Quat, Vec3};

use super::document::Document;
use super::json::{Index, InstanceAttributes, Instancing, Mesh as JsonMesh, NodeExtensions};
use super::keys::unit;
use super::materials::Shown;
use super::meshes::{Drawn, Vertices, on_mesh};
use super::pieces::{Piece, pieces};
use osier_base::Result;
use osier_base::par::par_chunks;
use osier_scene::{InstanceState, Instancer, MaterialId, Mesh, Trs};

/// Instances of one prototype that move together.
#[derive(Debug)]
pub(super) struct Group<'a> {
    pub instancer: &'a Instancer,
    pub state: &'a InstanceState,
    /// Index into the prototypes.
    pub proto: usize,
    /// Indices of live instances.
    pub members: Vec<usize>,
    /// For errors.
    pub what: &'a str,
}

/// Members of each prototype: live instances in order.
pub(super) fn members(instancer: &Instancer, state: &InstanceState) -> Vec<Vec<usize>> {
    let mut lists = vec![Vec::new(); instancer.prototypes.len()];
    for i in (0..instancer.len()).filter(|&i| state.is_alive(i)) {
        if let Some(list) = lists.get_mut(instancer.protos[i] as usize) {
            list.push(i);
        }
    }
    lists
}

/// Instances that a chunk of work merges.
const MERGE_CHUNK: usize = 1024;

impl Document<'_> {
    /// Adds a prototype as a mesh.
    pub(super) fn prototype(&mut self, instancer: &Instancer, proto: usize, what: &str) -> Result<Option<Index>> {
        let Some(p) = instancer.prototypes.get(proto) else { return Ok(None) };
        let name = format!("{}_{}", instancer.name, p.name);
        self.mesh(Drawn { name: &name, what, mesh: &p.mesh, shown: Shown::Mesh, skin: None, shapes: &[] })
    }

    /// The instancing extension for a group, its transforms taken into the space of `joint` (asset from joint).
    pub(super) fn instancing(&mut self, group: &Group<'_>, joint: &Trs) -> Result<NodeExtensions> {
        let list: Vec<Trs> = group.members.iter().map(|i| group.transform(*i, joint)).collect();
        self.instancing_at(&list, group.what)
    }

    /// The instancing extension for a mesh at many places. `what`: for errors.
    pub(super) fn instancing_at(&mut self, list: &[Trs], what: &str) -> Result<NodeExtensions> {
        let rotations: Vec<Quat> = list.iter().map(|t| if t.r.w < 0.0 { -t.r } else { t.r }).collect();
        let translations: Vec<Vec3> = list.iter().map(|t| t.t).collect();
        let scales: Vec<Vec3> = list.iter().map(|t| t.s).collect();
        let rotation = self.buffer.short_quaternions(&rotations, what)?;
        let scale =
            if scales.iter().any(|s| *s != Vec3::ONE) { Some(self.buffer.vectors(&scales, None, what)?) } else { None };
        let translation = self.buffer.vectors(&translations, None, what)?;
        self.uses("EXT_mesh_gpu_instancing", true);
        let attributes = InstanceAttributes { rotation, scale, translation };
        Ok(NodeExtensions { instancing: Instancing { attributes } })
    }

    /// All instances of some groups of one instancer as one mesh in the space of `joint` (asset from joint), with a
    /// primitive for each material: instance after instance, each with its prototype's vertices.
    pub(super) fn merged(&mut self, name: String, groups: &[Group<'_>], joint: &Trs) -> Result<Option<Index>> {
        let mut meshes: BTreeMap<MaterialId, Mesh> = BTreeMap::new();
        let mut what = "";
        for group in groups {
            what = group.what;
            let Some(prototype) = group.instancer.prototypes.get(group.proto) else { continue };
            for piece in pieces(&prototype.mesh) {
                let mesh = merge(group, &prototype.mesh, &piece, joint);
                meshes.entry(piece.material).or_default().append(&mesh);
            }
        }
        let mut primitives = Vec::new();
        for (material, mesh) in meshes {
            let vertices = Vertices {
                what,
                points: Cow::Owned(mesh.points),
                normals: Cow::Owned(mesh.normals),
                uvs: Cow::Owned(mesh.uvs),
                colors: Cow::Owned(mesh.colors),
                attributes: Cow::Borrowed(&[]),
                skin: None,
                morphs: false,
            };
            primitives.push(self.primitive(&vertices, &mesh.triangles, on_mesh(material))?);
        }
        self.finish_mesh(JsonMesh { name, primitives, ..JsonMesh::default() })
    }
}

impl Group<'_> {
    /// Transform of an instance in the space of `joint` (asset from joint, without scale).
    fn transform(&self, instance: usize, joint: &Trs) -> Trs {
        let trs = self.instancer.transform(self.state, instance);
        let back = joint.r.conjugate();
        Trs { t: back * (trs.t - joint.t), r: unit(back * trs.r), s: trs.s }
    }
}

/// One piece of a prototype, repeated for every member.
fn merge(group: &Group<'_>, mesh: &Mesh, piece: &Piece<'_>, joint: &Trs) -> Mesh {
    let single = Mesh {
        points: piece.gather(&mesh.points).into_owned(),
        normals: piece.gather(&mesh.normals).into_owned(),
        uvs: piece.gather(&mesh.uvs).into_owned(),
        colors: piece.gather(&mesh.colors).into_owned(),
        attributes: Vec::new(),
        triangles: piece.triangles.to_vec(),
        subsets: Vec::new(),
    };
    let parts = par_chunks(&group.members, MERGE_CHUNK, |_, chunk| {
        let mut out = Mesh::default();
        for i in chunk {
            append(&mut out, &single, &group.transform(*i, joint));
        }
        out
    });
    let mut parts = parts.into_iter();
    let mut whole = parts.next().unwrap_or_default();
    parts.for_each(|part| whole.append(&part));
    whole
}

fn append(out: &mut Mesh, single: &Mesh, trs: &Trs) {
    let base = u32::try_from(out.points.len()).unwrap_or(u32::MAX);
    out.points.extend(single.points.iter().map(|p| trs.apply(*p)));
    out.normals.extend(single.normals.iter().map(|n| osier_base::math::normalize_or(trs.r * (*n / trs.s), *n)));
    out.uvs.extend_from_slice(&single.uvs);
    out.colors.extend_from_slice(&single.colors);
    out.triangles.extend(single.triangles.iter().map(|t| t.map(|i| base.saturating_add(i))));
}
