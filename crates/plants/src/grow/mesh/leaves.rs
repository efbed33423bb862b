//! Turns the blades of an artist's mesh into organs: each pivots about its attachment vertex; congruent blades share a prototype.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Mat3, Quat, Vec3};

use super::bind::{self, AxisPosition};
use super::parts::{TrianglePatch, index};
use super::wood_search::WoodSearch;
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::par::par_map;
use osier_base::rng::{Rng, child, mix64, word};
use osier_scene::plant::{Organ, Plant, Proto};
use osier_scene::{Mesh, Subset};

/// Blades share a prototype if no point deviates by more than this share of their size.
const SHAPE_TOLERANCE: f32 = 1e-3;
/// Largest number of prototypes; blades of further shapes stay part of the wood. Keeps files and the search for a match small.
const MAX_SHAPES: usize = 4096;
/// A blade larger than this share of the plant's diagonal is not a single leaf but several leaves that share vertices.
const MAX_LEAF_SIZE: f32 = 0.25;

/// A blade as a mesh, with its attachment to the bark.
struct LeafBlade {
    mesh: Mesh,
    /// Diagonal of the bounding box, m.
    size: f32,
    /// Index of the point nearest to the bark, and the position on the axes there.
    attachment: (usize, AxisPosition),
}

/// A shape that congruent blades share, taken from the first of them.
struct LeafShape {
    proto: u16,
    points: Vec<Vec3>,
    /// Indices of three points far apart, whose frame is compared.
    corners: [usize; 3],
    attachment: usize,
    q: Quat,
}

/// A blade as an instance of a prototype, in plant space.
struct PlacedLeaf {
    site: AxisPosition,
    pivot: Vec3,
    q: Quat,
    scale: f32,
    proto: u16,
}

/// Blades that stay part of the wood, by index.
#[derive(Debug, Default)]
pub(super) struct UnplacedLeaves {
    /// Blades too large to be single leaves, and all blades of a plant without wood.
    pub large: Vec<usize>,
    /// Blades whose shape would exceed [`MAX_SHAPES`].
    pub unmatched: Vec<usize>,
}

/// Adds blades to a plant as organs; returns those that cannot be organs.
pub(super) fn place_leaves(
    plant: &mut Plant,
    mesh: &Mesh,
    blades: &[TrianglePatch],
    near: &WoodSearch<AxisPosition>,
) -> UnplacedLeaves {
    let whole = mesh.bounds().size().length();
    let material = materials(mesh);
    let cut = par_map(blades, |patch| cut_out_blade(mesh, &material, patch, near));
    // Blades with equal topology are compared with the shapes known so far; a new shape becomes a prototype.
    let mut left = UnplacedLeaves::default();
    let mut shapes: BTreeMap<u64, Vec<LeafShape>> = BTreeMap::new();
    let mut placed_leaves: Vec<PlacedLeaf> = Vec::new();
    for (i, blade) in cut.into_iter().enumerate() {
        match blade.filter(|b| b.size <= MAX_LEAF_SIZE * whole) {
            None => left.large.push(i),
            Some(blade) => {
                let known_shapes = shapes.entry(topology_hash(&blade.mesh)).or_default();
                match known_shapes.iter().find_map(|s| match_shape(s, &blade, near)) {
                    Some(h) => placed_leaves.push(h),
                    None if plant.protos.len() >= MAX_SHAPES => left.unmatched.push(i),
                    None => {
                        let (shape, h) = new_shape(plant, blade);
                        known_shapes.push(shape);
                        placed_leaves.push(h);
                    }
                }
            }
        }
    }
    placed_leaves.sort_by(|a, b| (a.site.0.cmp(&b.site.0)).then(a.site.1.total_cmp(&b.site.1)));
    plant.organs = placed_leaves.into_iter().map(|h| organ(plant, h)).collect();
    left
}

/// Sets ids and tints of the organs from the ids of their axes and their rank along them.
pub(super) fn assign_ids(plant: &mut Plant) {
    let mut rank = (u32::MAX, 0_u64);
    for organ in &mut plant.organs {
        rank = if organ.axis == rank.0 { (rank.0, rank.1 + 1) } else { (organ.axis, 0) };
        let axis = plant.axes.get(organ.axis as usize).map_or(0, |a| a.id);
        organ.id = mix64(&[axis, word("organ"), rank.1]);
        organ.tint = Rng::from_key(child(organ.id, word("tint"))).unit_f32();
    }
}

/// Index of the material of each triangle; 0 where no subset covers it.
fn materials(mesh: &Mesh) -> Vec<u32> {
    let mut of = vec![0; mesh.triangles.len()];
    for s in &mesh.subsets {
        let run = s.first as usize..s.first as usize + s.count as usize;
        of.get_mut(run).into_iter().flatten().for_each(|m| *m = s.material);
    }
    of
}

/// Copies the triangles of `patch` to a mesh that holds only their points, in the order of `mesh`. Also returns the index in
/// `mesh` of each point. `material`: by index of the triangle in `mesh`.
pub(super) fn submesh(mesh: &Mesh, material: impl Fn(u32) -> u32, patch: &[u32]) -> (Mesh, Vec<u32>) {
    // Vertices of the patch in rising order, renumbered by their rank.
    let mut used: Vec<u32> = patch.iter().flat_map(|t| mesh.triangles[*t as usize]).collect();
    used.sort_unstable();
    used.dedup();
    let local = |i: u32| index(used.partition_point(|u| *u < i));
    let mut out = Mesh {
        points: used.iter().map(|i| mesh.points[*i as usize]).collect(),
        normals: used.iter().map(|i| mesh.normals[*i as usize]).collect(),
        uvs: used.iter().filter_map(|i| mesh.uvs.get(*i as usize)).copied().collect(),
        colors: used.iter().filter_map(|i| mesh.colors.get(*i as usize)).copied().collect(),
        triangles: patch.iter().map(|t| mesh.triangles[*t as usize].map(local)).collect(),
        subsets: Vec::new(),
        ..Mesh::default()
    };
    // Consecutive triangles of one material make a subset.
    for (first, t) in (0..).zip(patch) {
        let material = material(*t);
        match out.subsets.last_mut() {
            Some(last) if last.material == material => last.count += 1,
            _ => out.subsets.push(Subset { material, first, count: 1 }),
        }
    }
    (out, used)
}

/// The mesh without its `removed` triangles, and the index in `mesh` of each remaining point.
pub(super) fn remaining_mesh(mesh: &Mesh, removed: &[bool]) -> (Mesh, Vec<u32>) {
    let material = materials(mesh);
    let kept: Vec<u32> = (0..).take(mesh.triangles.len()).filter(|t| !removed[*t as usize]).collect();
    submesh(mesh, |t| material[t as usize], &kept)
}

/// A blade as a separate mesh, its triangles sorted by material; `None` on a plant without wood.
fn cut_out_blade(
    mesh: &Mesh,
    material: &[u32],
    patch: &TrianglePatch,
    near: &WoodSearch<AxisPosition>,
) -> Option<LeafBlade> {
    // Sorting by material keeps the subsets of equal blades alike, whatever the order in the file.
    let mut patch = patch.clone();
    patch.sort_by_key(|t| (material[*t as usize], *t));
    let (mesh, _) = submesh(mesh, |t| material[t as usize], &patch);
    let size = mesh.bounds().size().length();
    let (i, _, site) = bind::nearest_point_of_part(near, &mesh.points)?;
    Some(LeafBlade { mesh, size, attachment: (i, site) })
}

/// Hash of everything that congruent blades have in common: triangles, materials, texture coordinates, colours.
fn topology_hash(mesh: &Mesh) -> u64 {
    // Positions and normals are left out: they differ by the placement, which is found by comparison.
    let corners = mesh.triangles.iter().flatten().map(|i| u64::from(*i));
    let runs = mesh.subsets.iter().flat_map(|s| [u64::from(s.material), u64::from(s.count)]);
    let uvs = mesh.uvs.iter().flat_map(|uv| uv.to_array()).map(|v| u64::from(v.to_bits()));
    let colors = mesh.colors.iter().flatten().map(|v| u64::from(v.to_bits()));
    let all: Vec<u64> =
        std::iter::once(mesh.points.len() as u64).chain(corners).chain(runs).chain(uvs).chain(colors).collect();
    mix64(&all)
}

/// Indices of three points that define a frame well: the first point, the one farthest from it, and the one that spans the
/// largest triangle with both.
fn far_corners(points: &[Vec3]) -> [usize; 3] {
    let most = |value: &dyn Fn(Vec3) -> f32| {
        let all = points.iter().enumerate();
        all.max_by(|a, b| value(*a.1).total_cmp(&value(*b.1)).then(b.0.cmp(&a.0))).map_or(0, |(i, _)| i)
    };
    let a = points[0];
    let b = most(&|p| p.distance_squared(a));
    let c = most(&|p| (points[b] - a).cross(p - a).length_squared());
    [0, b, c]
}

/// Orthonormal frame of three points: X along the first two, Y in their plane.
fn frame(points: &[Vec3], [a, b, c]: [usize; 3]) -> Mat3 {
    let x = math::normalize_or(points[b] - points[a], Vec3::X);
    let z = math::normalize_or(math::normalize_or(x.cross(points[c] - points[a]), Vec3::ZERO), math::perpendicular(x));
    Mat3::from_cols(x, z.cross(x), z)
}

/// The blade as an instance of a shape; `None` if no similarity (rotation, uniform scale, translation) maps the shape onto it.
fn match_shape(shape: &LeafShape, blade: &LeafBlade, near: &WoodSearch<AxisPosition>) -> Option<PlacedLeaf> {
    let (own, points) = (&shape.points, &blade.mesh.points);
    let [a, b, _] = shape.corners;
    // The similarity that the three frame points determine; then every point must agree within the tolerance.
    let length = own[b].distance(own[a]);
    let scale = points[b].distance(points[a]) / length.max(f32::MIN_POSITIVE);
    let turn = frame(points, shape.corners) * frame(own, shape.corners).transpose();
    let placed = |p: Vec3| turn * ((p - own[a]) * scale) + points[a];
    let off = own.iter().zip(points).fold(0.0_f32, |m, (p, q)| m.max(placed(*p).distance_squared(*q)));
    if math::sqrt_f32(off) > SHAPE_TOLERANCE * blade.size || scale <= 0.0 {
        return None;
    }
    let pivot = placed(own[shape.attachment]);
    // The attachment point of the shape is the pivot, even if another point of this blade lies slightly nearer to the bark.
    let site = near.nearest(pivot).map_or(blade.attachment.1, |(_, site)| site);
    let q = (Quat::from_mat3(&turn) * shape.q).normalize();
    Some(PlacedLeaf { site, pivot, q, scale, proto: shape.proto })
}

/// A prototype for a new shape: the pivot at its origin, +Y to the middle of the blade, +Z its upper side.
fn new_shape(plant: &mut Plant, blade: LeafBlade) -> (LeafShape, PlacedLeaf) {
    let LeafBlade { mut mesh, attachment: (attachment, site), .. } = blade;
    let points = mesh.points.clone();
    let pivot = points[attachment];
    let middle = points.iter().fold(Vec3::ZERO, |s, p| s + (*p - pivot)) / points.len() as f32;
    // Frame of the prototype: +Y from the pivot to the centroid, +Z the area-weighted normal, made perpendicular.
    let y = math::normalize_or(middle, Vec3::Y);
    let face = mesh.triangles.iter().fold(Vec3::ZERO, |s, t| {
        let [a, b, c] = t.map(|i| points[i as usize]);
        s + (b - a).cross(c - a)
    });
    // Divide by the largest component first: the length of this sum, twice the leaf's area, may be below 1e-9, which
    // `normalize_or` treats as 0.
    let face = face / face.abs().max_element().max(f32::MIN_POSITIVE);
    let z = math::normalize_or(face - y * face.dot(y), math::perpendicular(y));
    let q = Quat::from_mat3(&Mat3::from_cols(y.cross(z), y, z)).normalize();
    let back = q.conjugate();
    mesh.points.iter_mut().for_each(|p| *p = back * (*p - pivot));
    mesh.normals.iter_mut().for_each(|n| *n = back * *n);
    #[allow(clippy::cast_possible_truncation, reason = "at most MAX_SHAPES prototypes")]
    let proto = plant.protos.len() as u16;
    plant.protos.push(Proto { name: format!("leaf_{proto}"), mesh: Arc::new(mesh) });
    let shape = LeafShape { proto, corners: far_corners(&points), points, attachment, q };
    (shape, PlacedLeaf { site, pivot, q, scale: 1.0, proto })
}

/// The organ of a placed leaf, in the frame of its axis; `assign_ids` sets its id and tint.
fn organ(plant: &Plant, h: PlacedLeaf) -> Organ {
    // Offset and rotation relative to the axis frame: the leaf follows its twig.
    let at = plant.frame(&plant.axes[h.site.0 as usize], h.site.1);
    let back = at.q.conjugate();
    Organ {
        id: 0,
        axis: h.site.0,
        s: h.site.1,
        offset: back * (h.pivot - at.p),
        q: (back * h.q).normalize(),
        scale: h.scale,
        proto: h.proto,
        petiole: 0.0,
        tint: 0.0,
        birth: 0.0,
    }
}

/// Box around the triangles of a patch, in the space of the mesh, m.
pub(super) fn bounds(mesh: &Mesh, patch: &TrianglePatch) -> Bounds {
    Bounds::of(patch.iter().flat_map(|t| mesh.triangles[*t as usize]).map(|i| mesh.points[i as usize]))
}
