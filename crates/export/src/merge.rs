//! Assets as one mesh each, for formats without instances: part by part, never all at once.

use std::collections::BTreeSet;
use std::ops::Range;

use glam::{Vec2, Vec3};

use osier_base::Result;
use osier_base::par::par_map;
use osier_scene::{Asset, Attribute, InstanceState, Instancer, Mesh, Subset, Trs};

/// Points or triangles of a batch, and batches that are made at once.
/// Own: 8 batches keep two to eight threads busy and take 50 MB as text.
const BATCH: usize = 1 << 16;
const AT_ONCE: usize = 8;

/// A run of a part's points or triangles.
pub(super) struct Piece<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// Where it is.
    pub trs: Trs,
    /// The run: of points, or of triangles of the mesh.
    pub range: Range<usize>,
    /// Number of the part's first point, over all.
    pub base: u64,
}

impl Piece<'_> {
    /// Points of the run, moved.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
        self.mesh.points[self.range.clone()].iter().map(|p| self.trs.apply(*p))
    }

    /// Normals of the run, turned.
    pub fn normals(&self) -> impl Iterator<Item = Vec3> {
        self.mesh.normals[self.range.clone()].iter().map(|n| normal(&self.trs, *n))
    }

    /// Corners of the run's triangles, numbered from the part's first point; a mirrored part keeps its outside.
    pub fn corners(&self) -> impl Iterator<Item = [u32; 3]> {
        let turned = self.trs.s.x * self.trs.s.y * self.trs.s.z < 0.0;
        self.mesh.triangles[self.range.clone()]
            .iter()
            .map(move |[a, b, c]| if turned { [*a, *c, *b] } else { [*a, *b, *c] })
    }
}

enum Source<'a> {
    Mesh(&'a Mesh),
    Instances(&'a Instancer),
}

struct Block<'a> {
    source: Source<'a>,
    vertices: u64,
    materials: BTreeSet<u32>,
}

impl Block<'_> {
    fn parts(&self, world: Trs) -> impl Iterator<Item = (&Mesh, Trs)> {
        let (mesh, instances) = match &self.source {
            Source::Mesh(mesh) => (Some((*mesh, world)), None),
            Source::Instances(instancer) => (None, Some(shown(instancer, &instancer.rest))),
        };
        mesh.into_iter().chain(instances.into_iter().flatten().map(move |(mesh, trs)| (mesh, world.then_inner(&trs))))
    }
}

/// All meshes and live instances of an asset at rest, as one mesh.
pub(super) struct Flat<'a> {
    blocks: Vec<Block<'a>>,
    /// Materials in the order of their first use.
    pub materials: Vec<u32>,
    known: BTreeSet<u32>,
    /// True if some part has texture coordinates; those of the others are zero.
    pub has_uvs: bool,
    /// Points.
    pub vertices: u64,
    /// Triangles of all materials.
    pub triangles: u64,
}

impl<'a> Flat<'a> {
    /// Counts an asset.
    pub fn of(asset: &'a Asset) -> Self {
        let (blocks, materials, known) = (Vec::new(), Vec::new(), BTreeSet::new());
        let mut flat = Self { blocks, materials, known, has_uvs: false, vertices: 0, triangles: 0 };
        let meshes = asset.meshes.iter().map(|o| Source::Mesh(&o.mesh));
        for source in meshes.chain(asset.instancers.iter().map(Source::Instances)) {
            let mut block = Block { source, vertices: 0, materials: BTreeSet::new() };
            let mut seen: BTreeSet<*const Mesh> = BTreeSet::new();
            let mut vertices = 0;
            let mut materials = Vec::new();
            for (mesh, _) in block.parts(Trs::IDENTITY) {
                vertices += mesh.points.len() as u64;
                flat.triangles += mesh.subsets.iter().map(|s| mesh.subset_triangles(s).len() as u64).sum::<u64>();
                if seen.insert(std::ptr::from_ref(mesh)) {
                    flat.has_uvs |= !mesh.uvs.is_empty();
                    materials.extend(mesh.subsets.iter().map(|s| s.material));
                }
            }
            flat.vertices += vertices;
            for material in &materials {
                if flat.known.insert(*material) {
                    flat.materials.push(*material);
                }
            }
            (block.vertices, block.materials) = (vertices, materials.into_iter().collect());
            flat.blocks.push(block);
        }
        flat
    }

    /// Meshes that are passed on in several runs.
    pub fn large(&self) -> impl Iterator<Item = &Mesh> {
        let own =
            self.blocks.iter().filter_map(|b| if let Source::Mesh(mesh) = &b.source { Some(*mesh) } else { None });
        own.filter(|mesh| mesh.points.len() > BATCH)
    }

    /// Runs of points where the asset stands at `world`.
    pub fn points(&self, world: Trs) -> impl Iterator<Item = Piece<'_>> {
        self.blocks
            .iter()
            .flat_map(move |b| b.parts(world))
            .flat_map(|(mesh, trs)| runs(0..mesh.points.len()).map(move |range| Piece { mesh, trs, range, base: 0 }))
    }

    /// Runs of the triangles of a material. `base`: number of the asset's first point.
    pub fn triangles(&self, world: Trs, material: u32, base: u64) -> impl Iterator<Item = Piece<'_>> {
        let starts = self.blocks.iter().scan(base, |next, b| {
            let start = *next;
            *next += b.vertices;
            Some((b, start))
        });
        let parts = starts.filter(move |(b, _)| b.materials.contains(&material)).flat_map(move |(b, start)| {
            b.parts(world).scan(start, |next, (mesh, trs)| {
                let base = *next;
                *next += mesh.points.len() as u64;
                Some((mesh, trs, base))
            })
        });
        parts.flat_map(move |(mesh, trs, base)| {
            let worn = mesh.subsets.iter().filter(move |s| s.material == material).flat_map(|s| {
                let first = (s.first as usize).min(mesh.triangles.len());
                runs(first..first + mesh.subset_triangles(s).len())
            });
            worn.map(move |range| Piece { mesh, trs, range, base })
        })
    }
}

/// All of an asset at rest as one mesh in memory, with one subset per material in order of first use, for copies that share it.
/// Texture coordinates are zero where a part has none, attributes likewise; vertex colours are dropped.
pub(super) fn merged(asset: &Asset) -> Mesh {
    let flat = Flat::of(asset);
    let mut mesh = Mesh::default();
    for (part, trs) in flat.blocks.iter().flat_map(|b| b.parts(Trs::IDENTITY)) {
        Attribute::append_all(&mut mesh.attributes, mesh.points.len(), &part.attributes, part.points.len());
        mesh.points.extend(part.points.iter().map(|p| trs.apply(*p)));
        mesh.normals.extend(part.normals.iter().map(|n| normal(&trs, *n)));
        if flat.has_uvs {
            mesh.uvs.extend_from_slice(&part.uvs);
            mesh.uvs.resize(mesh.points.len(), Vec2::ZERO);
        }
    }
    for material in &flat.materials {
        let first = u32::try_from(mesh.triangles.len()).unwrap_or(u32::MAX);
        for piece in flat.triangles(Trs::IDENTITY, *material, 0) {
            let base = u32::try_from(piece.base).unwrap_or(u32::MAX);
            mesh.triangles.extend(piece.corners().map(|t| t.map(|i| i.saturating_add(base))));
        }
        let count = u32::try_from(mesh.triangles.len()).unwrap_or(u32::MAX) - first;
        mesh.subsets.push(Subset { material: *material, first, count });
    }
    mesh
}

/// Live instances with their prototypes' meshes.
fn shown<'a>(instancer: &'a Instancer, state: &'a InstanceState) -> impl Iterator<Item = (&'a Mesh, Trs)> {
    (0..instancer.len()).filter(|i| state.is_alive(*i)).filter_map(|i| {
        let proto = instancer.protos.get(i).and_then(|p| instancer.prototypes.get(*p as usize))?;
        Some((&proto.mesh, instancer.transform(state, i)))
    })
}

fn runs(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    range.clone().step_by(BATCH).map(move |start| start..(start + BATCH).min(range.end))
}

/// Formats pieces in parallel, some at a time, and passes the results on in order.
pub(super) fn stream<'a, R: Send>(
    pieces: impl Iterator<Item = Piece<'a>>,
    format: impl Fn(&[Piece<'a>]) -> R + Sync + Send,
    mut put: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    let mut batches: Vec<Vec<Piece<'a>>> = Vec::new();
    let mut room = 0;
    for piece in pieces {
        let size = piece.range.len();
        if size > room {
            if batches.len() == AT_ONCE {
                par_map(&batches, |b| format(b)).into_iter().try_for_each(&mut put)?;
                batches.clear();
            }
            batches.push(Vec::new());
            room = BATCH;
        }
        room -= size;
        if let Some(batch) = batches.last_mut() {
            batch.push(piece);
        }
    }
    par_map(&batches, |b| format(b)).into_iter().try_for_each(put)
}

/// A normal under a transform: inverse scale, then rotation.
pub(super) fn normal(trs: &Trs, n: Vec3) -> Vec3 {
    let safe = |s: f32| if s == 0.0 { 1.0 } else { s };
    let scaled = Vec3::new(n.x / safe(trs.s.x), n.y / safe(trs.s.y), n.z / safe(trs.s.z));
    osier_base::math::normalize_or(trs.r * scaled, n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_part_keeps_its_outside() {
        let mesh = Mesh {
            points: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let trs = Trs { s: Vec3::new(1.0, 1.0, -2.0), ..Trs::IDENTITY };
        let points: Vec<Vec3> = Piece { mesh: &mesh, trs, range: 0..3, base: 0 }.points().collect();
        let normals: Vec<Vec3> = Piece { mesh: &mesh, trs, range: 0..3, base: 0 }.normals().collect();
        let corners: Vec<[u32; 3]> = Piece { mesh: &mesh, trs, range: 0..1, base: 0 }.corners().collect();
        let [a, b, c] = corners[0].map(|i| points[i as usize]);
        assert!((b - a).cross(c - a).dot(normals[0]) > 0.0);
        assert!((normals[0] + Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn pieces_come_in_order_whatever_their_sizes() {
        let mesh = Mesh { points: vec![Vec3::ZERO; 3 * BATCH + 5], ..Mesh::default() };
        let ranges: Vec<Range<usize>> = runs(0..mesh.points.len()).collect();
        let pieces = ranges.iter().map(|r| Piece { mesh: &mesh, trs: Trs::IDENTITY, range: r.clone(), base: 0 });
        let mut got = Vec::new();
        let first = |p: &[Piece<'_>]| p.iter().map(|p| p.range.clone()).collect::<Vec<_>>();
        stream(pieces, first, |r| {
            got.extend(r);
            Ok(())
        })
        .expect("no writer fails");
        assert_eq!((got.clone(), got.len()), (ranges, 4));
    }
}
