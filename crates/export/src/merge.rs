//! An asset as one mesh with its instances merged in, for formats without instances: streamed part by part, never all in memory.

use std::collections::BTreeSet;
use std::ops::Range;

use glam::{Vec2, Vec3};

use osier_base::Result;
use osier_base::convert::{index, narrow};
use osier_base::par::par_map;
use osier_scene::{
    Asset, Attribute, AttributeData, CANOPY_OCCLUSION, ClipChange, InstanceState, Instancer, LEAF_COLOR, Mesh, Subset,
    Trs, bent_normal,
};

/// Points or triangles of a batch.
const BATCH: usize = 1 << 16;
/// Number of batches that are formatted before they are written. Own: 8 batches keep two to eight threads busy and take
/// 50 MB as text; larger values take more memory.
const BATCHES_AT_ONCE: usize = 8;

/// Colour of a vertex without a colour: materials are multiplied by it.
const WHITE: [f32; 4] = [1.0; 4];

/// A range of the points or triangles of a part: of a mesh, or of an instance of a prototype.
pub(super) struct PartRange<'a> {
    pub mesh: &'a Mesh,
    /// Transform from the space of `mesh` to the world: first that of the instance, then that of the asset.
    pub trs: Trs,
    /// Vector that normals are bent by after the transform, see [`bent_normal`]; zero leaves them unchanged.
    pub toward: Vec3,
    /// Indices into the points of `mesh` or into its triangles, whichever the iterator gives.
    pub range: Range<usize>,
    /// Number of the part's first point in the merged mesh; 0 in ranges of points, which do not use it.
    pub base: u64,
}

impl PartRange<'_> {
    /// The points of `range`, transformed by `trs`; only for ranges of points.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
        self.mesh.points[self.range.clone()].iter().map(|p| self.trs.apply(*p))
    }

    /// The normals of `range`, transformed by `trs` and bent by `toward`; only for ranges of points.
    pub fn normals(&self) -> impl Iterator<Item = Vec3> {
        self.mesh.normals[self.range.clone()].iter().map(|n| bent_normal(transform_normal(&self.trs, *n), self.toward))
    }

    /// Triangles of `range`: vertices numbered from the part's first point. A transform that mirrors reverses the winding.
    pub fn corners(&self) -> impl Iterator<Item = [u32; 3]> {
        // The determinant of rotation and scale is the product of the scales; negative, it turns the faces inside out.
        let mirrors = self.trs.s.x * self.trs.s.y * self.trs.s.z < 0.0;
        self.mesh.triangles[self.range.clone()]
            .iter()
            .map(move |[a, b, c]| if mirrors { [*a, *c, *b] } else { [*a, *b, *c] })
    }
}

/// A mesh of an asset, or an instance of a prototype.
struct Part<'a> {
    mesh: &'a Mesh,
    trs: Trs,
    toward: Vec3,
}

enum PartSource<'a> {
    Mesh(&'a Mesh),
    Instances(&'a Instancer),
}

struct PartBlock<'a> {
    source: PartSource<'a>,
    vertices: u64,
    materials: BTreeSet<u32>,
}

impl PartBlock<'_> {
    fn parts(&self, world: Trs) -> impl Iterator<Item = Part<'_>> {
        // Both cases as one iterator: at most one mesh, then the instances if there are any.
        let (mesh, instances) = match &self.source {
            PartSource::Mesh(mesh) => (Some(Part { mesh, trs: world, toward: Vec3::ZERO }), None),
            PartSource::Instances(instancer) => (None, Some(live_instances(instancer, &instancer.rest))),
        };
        let instances = instances.into_iter().flatten();
        let placed = instances.map(move |p| Part { trs: world.then_inner(&p.trs), toward: world.r * p.toward, ..p });
        mesh.into_iter().chain(placed)
    }
}

/// All meshes and live instances of an asset at rest as one mesh: its size, and iterators over its parts. For an asset
/// that grows over the clip and has a rig, the meshes and instances of the rig are used.
pub(super) struct FlattenedAsset<'a> {
    blocks: Vec<PartBlock<'a>>,
    /// Indices into the scene's materials, each once, in the order of their first use.
    pub materials: Vec<u32>,
    known: BTreeSet<u32>,
    /// Whether some part has texture coordinates; parts that have none get zeros.
    pub has_uvs: bool,
    /// Number of points of all parts, each instance counted.
    pub vertices: u64,
    /// Number of triangles that have a material.
    pub triangles: u64,
}

impl<'a> FlattenedAsset<'a> {
    /// Counts the parts of an asset at rest. Visits every live instance and copies no geometry.
    pub fn of(asset: &'a Asset) -> Self {
        let (blocks, materials, known) = (Vec::new(), Vec::new(), BTreeSet::new());
        let mut flattened = Self { blocks, materials, known, has_uvs: false, vertices: 0, triangles: 0 };
        // At rest, a tree that grows over the clip contains everything that the clip ever shows; its rig is the tree at
        // one age.
        let grown = asset.rigged.as_deref().filter(|rig| rig.change == ClipChange::Growth);
        let objects = grown.map_or(&asset.meshes, |rig| &rig.meshes);
        let instancers = grown.map_or(&asset.instancers, |rig| &rig.instancers);
        let meshes = objects.iter().map(|o| PartSource::Mesh(&o.mesh));
        for source in meshes.chain(instancers.iter().map(PartSource::Instances)) {
            let mut block = PartBlock { source, vertices: 0, materials: BTreeSet::new() };
            // A prototype has many instances but is examined once: its address identifies it within the block.
            let mut seen: BTreeSet<*const Mesh> = BTreeSet::new();
            let mut vertices = 0;
            let mut materials = Vec::new();
            for Part { mesh, .. } in block.parts(Trs::IDENTITY) {
                vertices += mesh.points.len() as u64;
                flattened.triangles += mesh.subsets.iter().map(|s| mesh.subset_triangles(s).len() as u64).sum::<u64>();
                if seen.insert(std::ptr::from_ref(mesh)) {
                    flattened.has_uvs |= !mesh.uvs.is_empty();
                    materials.extend(mesh.subsets.iter().map(|s| s.material));
                }
            }
            flattened.vertices += vertices;
            for material in &materials {
                if flattened.known.insert(*material) {
                    flattened.materials.push(*material);
                }
            }
            (block.vertices, block.materials) = (vertices, materials.into_iter().collect());
            flattened.blocks.push(block);
        }
        flattened
    }

    /// Meshes of the asset with more points than a batch, which are split into several ranges; prototypes are excluded.
    pub fn large_meshes(&self) -> impl Iterator<Item = &Mesh> {
        let own =
            self.blocks.iter().filter_map(|b| if let PartSource::Mesh(mesh) = &b.source { Some(*mesh) } else { None });
        own.filter(|mesh| mesh.points.len() > BATCH)
    }

    /// All points, part by part, in ranges of at most [`BATCH`] points. `world`: transform of the asset.
    pub fn points(&self, world: Trs) -> impl Iterator<Item = PartRange<'_>> {
        self.blocks.iter().flat_map(move |b| b.parts(world)).flat_map(|Part { mesh, trs, toward }| {
            batch_ranges(0..mesh.points.len()).map(move |range| PartRange { mesh, trs, toward, range, base: 0 })
        })
    }

    /// Ranges of the triangles of a material. `base`: number of the asset's first point.
    pub fn triangles(&self, world: Trs, material: u32, base: u64) -> impl Iterator<Item = PartRange<'_>> {
        // Running sums of the points, so that each part's first point is known without a list of all instances.
        let starts = self.blocks.iter().scan(base, |next, b| {
            let start = *next;
            *next += b.vertices;
            Some((b, start))
        });
        // An instancer is visited once for each material of its prototypes, not for each material of the asset.
        let parts = starts.filter(move |(b, _)| b.materials.contains(&material)).flat_map(move |(b, start)| {
            b.parts(world).scan(start, |next, part| {
                let base = *next;
                *next += part.mesh.points.len() as u64;
                Some((part, base))
            })
        });
        parts.flat_map(move |(Part { mesh, trs, toward }, base)| {
            let ranges = mesh.subsets.iter().filter(move |s| s.material == material).flat_map(|s| {
                // Clamped as `subset_triangles` clamps it, so that a subset beyond the end is empty instead of out of bounds.
                let first = (s.first as usize).min(mesh.triangles.len());
                batch_ranges(first..first + mesh.subset_triangles(s).len())
            });
            ranges.map(move |range| PartRange { mesh, trs, toward, range, base })
        })
    }
}

/// An asset at rest as one mesh in memory, for copies that share it, with one subset for each material in order of first use.
/// Texture coordinates and attributes are zero and vertex colours white where a part has none.
/// # Errors
/// `TooMany` beyond 2^32 points or triangles.
pub(super) fn merge_asset(asset: &Asset) -> Result<Mesh> {
    let flattened = FlattenedAsset::of(asset);
    let mut mesh = Mesh::default();
    for Part { mesh: part, trs, toward } in flattened.blocks.iter().flat_map(|b| b.parts(Trs::IDENTITY)) {
        Attribute::append_all(&mut mesh.attributes, mesh.points.len(), &part.attributes, part.points.len());
        if !mesh.colors.is_empty() || !part.colors.is_empty() {
            mesh.colors.resize(mesh.points.len(), WHITE);
            mesh.colors.extend_from_slice(&part.colors);
            mesh.colors.resize(mesh.points.len() + part.points.len(), WHITE);
        }
        mesh.points.extend(part.points.iter().map(|p| trs.apply(*p)));
        mesh.normals.extend(part.normals.iter().map(|n| bent_normal(transform_normal(&trs, *n), toward)));
        if flattened.has_uvs {
            mesh.uvs.extend_from_slice(&part.uvs);
            // If one part has texture coordinates, the others are filled with zeros, so that the lists have equal
            // length.
            mesh.uvs.resize(mesh.points.len(), Vec2::ZERO);
        }
    }
    for material in &flattened.materials {
        let first = index(mesh.triangles.len(), "triangles of a mesh")?;
        for range in flattened.triangles(Trs::IDENTITY, *material, 0) {
            let base: u32 = narrow(range.base, "points of a mesh")?;
            mesh.triangles.extend(range.corners().map(|t| t.map(|i| i.saturating_add(base))));
        }
        let count = index(mesh.triangles.len(), "triangles of a mesh")? - first;
        mesh.subsets.push(Subset { material: *material, first, count });
    }
    let of_leaves = leaf_attributes(&flattened);
    mesh.attributes.retain(|a| of_leaves.iter().all(|leaf| leaf.name != a.name));
    mesh.attributes.extend(of_leaves);
    Ok(mesh)
}

/// Colour and occlusion of leaves at every vertex of a flattened asset, as attributes of four numbers; none if no instancer has
/// them. Vertices of other parts are white and not occluded. Normals are bent already.
fn leaf_attributes(flattened: &FlattenedAsset<'_>) -> Vec<Attribute> {
    let mut all = Vec::new();
    for (name, other) in [(LEAF_COLOR, WHITE), (CANOPY_OCCLUSION, [0.0; 4])] {
        let has = |b: &PartBlock<'_>| match &b.source {
            PartSource::Mesh(_) => false,
            PartSource::Instances(instancer) => instancer.rest.attribute(name).is_some(),
        };
        if !flattened.blocks.iter().any(has) {
            continue;
        }
        let mut values: Vec<[f32; 4]> = Vec::new();
        for block in &flattened.blocks {
            match &block.source {
                PartSource::Mesh(mesh) => match mesh.attributes.iter().find(|a| a.name == name).map(|a| &a.data) {
                    Some(AttributeData::Unit4(own)) => values.extend_from_slice(own),
                    _ => values.resize(values.len() + mesh.points.len(), other),
                },
                PartSource::Instances(instancer) => {
                    let data = instancer.rest.attribute(name);
                    for (i, mesh) in live_meshes(instancer, &instancer.rest) {
                        let value = match data {
                            Some(AttributeData::Unit4(list)) => list.get(i).copied(),
                            Some(AttributeData::Unit1(list)) => list.get(i).map(|x| [*x, 0.0, 0.0, 0.0]),
                            _ => None,
                        };
                        values.resize(values.len() + mesh.points.len(), value.unwrap_or(other));
                    }
                }
            }
        }
        all.push(Attribute::vertex(name, AttributeData::Unit4(values)));
    }
    all
}

/// The live instances; an instance whose prototype does not exist is skipped.
fn live_instances<'a>(instancer: &'a Instancer, state: &'a InstanceState) -> impl Iterator<Item = Part<'a>> {
    live_meshes(instancer, state).map(|(i, mesh)| Part {
        mesh,
        trs: instancer.transform(state, i),
        toward: state.canopy_normal(i),
    })
}

/// Indices of the live instances with the meshes of their prototypes; an instance whose prototype does not exist is skipped.
fn live_meshes<'a>(instancer: &'a Instancer, state: &'a InstanceState) -> impl Iterator<Item = (usize, &'a Mesh)> {
    (0..instancer.len()).filter(|i| state.is_alive(*i)).filter_map(|i| {
        let proto = instancer.protos.get(i).and_then(|p| instancer.prototypes.get(*p as usize))?;
        Some((i, &proto.mesh))
    })
}

fn batch_ranges(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    range.clone().step_by(BATCH).map(move |start| start..(start + BATCH).min(range.end))
}

/// Formats ranges in parallel, [`BATCHES_AT_ONCE`] batches at a time, and passes the results to `put` in order. A batch takes
/// ranges until it has [`BATCH`] elements.
pub(super) fn format_in_parallel<'a, R: Send>(
    pieces: impl Iterator<Item = PartRange<'a>>,
    format: impl Fn(&[PartRange<'a>]) -> R + Sync + Send,
    mut put: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    let mut batches: Vec<Vec<PartRange<'a>>> = Vec::new();
    // Number of elements for which the current batch has room; 0 opens the first batch at the first range.
    let mut room = 0;
    for range in pieces {
        let size = range.range.len();
        // Ranges are never split here: none is longer than a batch, as `batch_ranges` has cut them.
        if size > room {
            if batches.len() == BATCHES_AT_ONCE {
                // Formatted in parallel and written in order: the file has the same bytes for any number of threads.
                par_map(&batches, |b| format(b)).into_iter().try_for_each(&mut put)?;
                batches.clear();
            }
            batches.push(Vec::new());
            room = BATCH;
        }
        room -= size;
        if let Some(batch) = batches.last_mut() {
            batch.push(range);
        }
    }
    par_map(&batches, |b| format(b)).into_iter().try_for_each(put)
}

/// A normal under a transform: by the inverse transpose, which is the inverse scale followed by the rotation; unit length.
pub(super) fn transform_normal(trs: &Trs, n: Vec3) -> Vec3 {
    // A scale of zero has no inverse; along that axis the component is left as it is.
    let safe = |s: f32| if s == 0.0 { 1.0 } else { s };
    let scaled = Vec3::new(n.x / safe(trs.s.x), n.y / safe(trs.s.y), n.z / safe(trs.s.z));
    osier_base::math::normalize_or(trs.r * scaled, n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::{AssetKind, MeshMotion, MeshObject};

    fn part(mesh: &Mesh, trs: Trs, range: Range<usize>) -> PartRange<'_> {
        PartRange { mesh, trs, toward: Vec3::ZERO, range, base: 0 }
    }

    #[test]
    fn a_mirrored_part_keeps_its_outside() {
        let mesh = Mesh {
            points: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let trs = Trs { s: Vec3::new(1.0, 1.0, -2.0), ..Trs::IDENTITY };
        let points: Vec<Vec3> = part(&mesh, trs, 0..3).points().collect();
        let normals: Vec<Vec3> = part(&mesh, trs, 0..3).normals().collect();
        let corners: Vec<[u32; 3]> = part(&mesh, trs, 0..1).corners().collect();
        let [a, b, c] = corners[0].map(|i| points[i as usize]);
        assert!((b - a).cross(c - a).dot(normals[0]) > 0.0);
        assert!((normals[0] + Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn parts_without_colors_are_white_beside_colored_ones() {
        let part = |colors: Vec<[f32; 4]>| MeshObject {
            name: "part".into(),
            mesh: Mesh {
                points: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                normals: vec![Vec3::Z; 3],
                triangles: vec![[0, 1, 2]],
                colors,
                ..Mesh::default()
            }
            .with_material(0),
            motion: MeshMotion::Still,
            skin: None,
        };
        let red = vec![[1.0, 0.0, 0.0, 1.0]; 3];
        let greens = |parts: Vec<MeshObject>| {
            let asset = Asset {
                id: "plant".into(),
                kind: AssetKind::Plant,
                group: String::new(),
                skeleton: None,
                meshes: parts,
                instancers: Vec::new(),
                points: Vec::new(),
                curves: Vec::new(),
                rigged: None,
            };
            merge_asset(&asset).expect("few points").colors.iter().map(|c| c[1] > 0.5).collect::<Vec<_>>()
        };
        let mixed = greens(vec![part(Vec::new()), part(red), part(Vec::new())]);
        assert_eq!(mixed, [true, true, true, false, false, false, true, true, true]);
        assert!(greens(vec![part(Vec::new())]).is_empty());
    }

    #[test]
    fn pieces_come_in_order_whatever_their_sizes() {
        let mesh = Mesh { points: vec![Vec3::ZERO; 3 * BATCH + 5], ..Mesh::default() };
        let ranges: Vec<Range<usize>> = batch_ranges(0..mesh.points.len()).collect();
        let pieces = ranges.iter().map(|r| part(&mesh, Trs::IDENTITY, r.clone()));
        let mut got = Vec::new();
        let first = |p: &[PartRange<'_>]| p.iter().map(|p| p.range.clone()).collect::<Vec<_>>();
        format_in_parallel(pieces, first, |r| {
            got.extend(r);
            Ok(())
        })
        .expect("no writer fails");
        assert_eq!((got.clone(), got.len()), (ranges, 4));
    }
}
