//! Charts of leaf blades: texture coordinates that are one-to-one, so that no two points of the blade share a texel.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};

use super::flatten::{FlatPiece, flatten, pack};
use super::overlap::{area, overlap_exceeds};
use crate::rain::tuning::{CHART_SEAM_TOLERANCE, MAX_FAULTY_AREA, MIN_UV_AREA};
use osier_scene::Mesh;

/// Reason why the texture coordinates of a mesh cannot be the chart of its blade, which must be one-to-one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UvFault {
    /// The mesh has no texture coordinates, or no triangle has an area in them.
    Missing,
    /// Some coordinates lie outside of 0 to 1.
    OutOfRange,
    /// Two parts of the blade share texels, such as mirrored halves.
    Overlap,
    /// Neighbouring triangles lie apart in the texture.
    Seam,
}

impl UvFault {
    /// The fault as the predicate of a sentence whose subject is texture coordinates, for diagnostics.
    pub fn words(self) -> &'static str {
        match self {
            Self::Missing => "are missing",
            Self::OutOfRange => "leave the range of 0 to 1",
            Self::Overlap => "put several parts of the blade on the same texels",
            Self::Seam => "have a seam across the blade",
        }
    }
}

/// Texture coordinates that are computed for a blade whose mesh has no one-to-one ones; vertices are doubled along cuts.
/// Source: [yang-wu] projects the leaf on a plane; blades that overlap there are embedded in a disk (see `flatten`).
#[derive(Debug, Clone)]
pub struct LeafChart {
    /// Why the texture coordinates of the mesh are not used.
    pub fault: UvFault,
    /// Texture coordinates, 0 to 1, of each vertex of the chart.
    pub uvs: Vec<DVec2>,
    /// Index of the vertex of the mesh for each vertex of the chart.
    pub vertices: Vec<u32>,
    /// All triangles of the mesh in their order, by vertices of the chart.
    pub triangles: Vec<[u32; 3]>,
    /// Number of cuts through the blade: pieces of the chart minus connected parts of the blade.
    pub cuts: usize,
}

/// The triangles of a mesh that form its blade: those with an area, without petioles and without second sides.
pub(super) struct BladePartOfMesh {
    /// Indices of the triangles of the blade in the mesh.
    pub indices: Vec<usize>,
    /// Piece of the chart that each of them lies in.
    pub pieces: Vec<usize>,
}

/// The blade of a mesh with one-to-one texture coordinates for it.
pub(super) struct BladeChart {
    pub blade: BladePartOfMesh,
    /// The computed chart; `None` if the texture coordinates of the mesh are one-to-one.
    pub own: Option<LeafChart>,
}

impl BladeChart {
    /// The chart of a mesh's blade; `None` if no triangle has an area. The texture coordinates of the mesh are used
    /// if they are one-to-one. Petioles, whose triangles have no area in the texture, and second sides of triangles
    /// do not belong to the blade.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let points: Vec<DVec3> = mesh.points.iter().map(|p| p.as_dvec3()).collect();
        let welded = weld(&points);
        let has_uvs = mesh.uvs.len() == mesh.points.len();
        let uv = |i: u32| mesh.uvs[i as usize].as_dvec2();
        let uv_area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(uv);
            (b - a).perp_dot(c - a)
        };
        let all = || 0..mesh.triangles.len();
        let mut seen = BTreeSet::new();
        let mut is_first_side = |k: usize| {
            let mut corners = mesh.triangles[k].map(|i| welded[i as usize]);
            corners.sort_unstable();
            seen.insert(corners)
        };
        let mapped = |k: &usize| has_uvs && uv_area(&mesh.triangles[*k]).abs() >= MIN_UV_AREA;
        let with_area: Vec<usize> = all().filter(mapped).filter(|k| is_first_side(*k)).collect();
        let fault = if with_area.is_empty() {
            UvFault::Missing
        } else {
            let corners: Vec<[DVec2; 3]> = with_area.iter().map(|k| mesh.triangles[*k].map(uv)).collect();
            let edges =
                with_area.iter().zip(&corners).map(|(k, uvs)| (mesh.triangles[*k].map(|i| welded[i as usize]), *uvs));
            match own_uv_fault(&corners, edges) {
                Some(fault) => fault,
                None => {
                    let pieces = vec![0; with_area.len()];
                    return Some(Self { blade: BladePartOfMesh { indices: with_area, pieces }, own: None });
                }
            }
        };
        // Compute a chart, from the triangles that have an area in space.
        let space_area = |k: usize| {
            let [a, b, c] = mesh.triangles[k].map(|i| points[i as usize]);
            (b - a).cross(c - a).length()
        };
        let candidates: Vec<usize> =
            if with_area.is_empty() { all().filter(|k| is_first_side(*k)).collect() } else { with_area };
        let indices: Vec<usize> = candidates.into_iter().filter(|k| space_area(*k) > 0.0).collect();
        let triangles: Vec<[u32; 3]> = indices.iter().map(|k| mesh.triangles[*k].map(|i| welded[i as usize])).collect();
        if triangles.is_empty() {
            return None;
        }
        let mut flat = flatten(&points, &triangles);
        pack(&mut flat.pieces);
        let mut pieces = vec![0; triangles.len()];
        for (piece, of) in flat.pieces.iter().enumerate() {
            of.triangles.iter().for_each(|k| pieces[*k] = piece);
        }
        let blade = BladePartOfMesh { indices, pieces };
        let own = place_vertices(mesh, &points, &welded, &blade, &flat.pieces);
        Some(Self { own: Some(LeafChart { fault, cuts: flat.cuts, ..own }), blade })
    }
}

/// Index of the first vertex at the position of each vertex: meshes double vertices at seams of textures and normals.
pub(super) fn weld(points: &[DVec3]) -> Vec<u32> {
    // Adding 0.0 turns -0.0 into 0.0, whose bits are the same then.
    let mut first_at: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let position = |p: &DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
    (0_u32..).zip(points).map(|(i, p)| *first_at.entry(position(p)).or_insert(i)).collect()
}

/// Reason why texture coordinates are not one-to-one; `None` if they are. `corners`: coordinates of each triangle's corners;
/// `edges`: welded vertices of each triangle, and the coordinates of its corners.
fn own_uv_fault(corners: &[[DVec2; 3]], edges: impl Iterator<Item = ([u32; 3], [DVec2; 3])>) -> Option<UvFault> {
    let range = -CHART_SEAM_TOLERANCE..=1.0 + CHART_SEAM_TOLERANCE;
    if !corners.iter().flatten().all(|uv| range.contains(&uv.x) && range.contains(&uv.y)) {
        return Some(UvFault::OutOfRange);
    }
    if overlap_exceeds(corners, MAX_FAULTY_AREA) {
        return Some(UvFault::Overlap);
    }
    // Both triangles of an edge must have the same coordinates at its ends.
    let mut ends: BTreeMap<(u32, u32), [DVec2; 2]> = BTreeMap::new();
    let (mut at_seams, mut total) = (0.0, 0.0);
    for (vertices, uvs) in edges {
        let mut is_apart = false;
        for k in 0..3 {
            let (a, b) = (k, (k + 1) % 3);
            let (low, high) = if vertices[a] < vertices[b] { (a, b) } else { (b, a) };
            let here = [uvs[low], uvs[high]];
            let there = ends.entry((vertices[low], vertices[high])).or_insert(here);
            is_apart |= here.iter().zip(there.iter()).any(|(a, b)| a.distance(*b) > CHART_SEAM_TOLERANCE);
        }
        total += area(&uvs);
        at_seams += if is_apart { area(&uvs) } else { 0.0 };
    }
    (at_seams > MAX_FAULTY_AREA * total).then_some(UvFault::Seam)
}

/// Assigns chart coordinates to the vertices of a mesh. Vertices whose triangles lie in several pieces are doubled; vertices of
/// triangles outside of the blade get the coordinates of the nearest vertex of the blade.
fn place_vertices(
    mesh: &Mesh,
    points: &[DVec3],
    welded: &[u32],
    blade: &BladePartOfMesh,
    pieces: &[FlatPiece],
) -> LeafChart {
    let mut piece_of: Vec<Option<usize>> = vec![None; mesh.triangles.len()];
    blade.indices.iter().zip(&blade.pieces).for_each(|(k, piece)| piece_of[*k] = Some(*piece));
    // Second sides of triangles get the piece of the first sides.
    let key = |k: usize| {
        let mut corners = mesh.triangles[k].map(|i| welded[i as usize]);
        corners.sort_unstable();
        corners
    };
    let first: BTreeMap<[u32; 3], usize> =
        blade.indices.iter().zip(&blade.pieces).map(|(k, p)| (key(*k), *p)).collect();
    let mut placed: Vec<Option<DVec2>> = vec![None; points.len()];
    let mut piece_at: Vec<Option<usize>> = vec![None; points.len()];
    let mut doubled: BTreeMap<(u32, usize), u32> = BTreeMap::new();
    let mut vertices: Vec<u32> = (0_u32..).zip(points).map(|(i, _)| i).collect();
    let mut triangles = mesh.triangles.clone();
    for (k, triangle) in triangles.iter_mut().enumerate() {
        let Some(piece) = piece_of[k].or_else(|| first.get(&key(k)).copied()) else { continue };
        for i in triangle {
            let Some(uv) = pieces[piece].uvs.get(&welded[*i as usize]).copied() else { continue };
            let here = piece_at[*i as usize].get_or_insert(piece);
            if *here == piece {
                placed[*i as usize] = Some(uv);
                continue;
            }
            // Another piece already uses this vertex: this piece gets a copy.
            let next = vertices.len();
            let copy = *doubled.entry((*i, piece)).or_insert_with(|| {
                vertices.push(*i);
                placed.push(Some(uv));
                #[allow(clippy::cast_possible_truncation, reason = "at most three for each triangle, which u32 counts")]
                let copy = next as u32;
                copy
            });
            *i = copy;
        }
    }
    let known: Vec<(DVec3, DVec2)> =
        vertices.iter().zip(&placed).filter_map(|(i, uv)| Some((points[*i as usize], (*uv)?))).collect();
    let nearest = |p: DVec3| {
        let by_distance =
            |a: &&(DVec3, DVec2), b: &&(DVec3, DVec2)| a.0.distance_squared(p).total_cmp(&b.0.distance_squared(p));
        known.iter().min_by(by_distance).map_or(DVec2::splat(0.5), |k| k.1)
    };
    let uvs = vertices.iter().zip(&placed).map(|(i, uv)| uv.unwrap_or_else(|| nearest(points[*i as usize]))).collect();
    LeafChart { fault: UvFault::Missing, uvs, vertices, triangles, cuts: 0 }
}

impl LeafChart {
    /// The mesh with the chart as its texture coordinates; normals, colors and vertex attributes follow the doubled vertices.
    #[must_use]
    pub fn apply_to(&self, mesh: &Mesh) -> Mesh {
        fn pick<T: Copy>(all: &[T], indices: &[u32]) -> Vec<T> {
            indices.iter().filter_map(|i| all.get(*i as usize)).copied().collect()
        }
        let mut attributes = mesh.attributes.clone();
        for attribute in attributes.iter_mut().filter(|a| a.domain == osier_scene::AttributeDomain::Vertex) {
            attribute.data = attribute.data.gather(&self.vertices);
        }
        Mesh {
            points: pick(&mesh.points, &self.vertices),
            normals: pick(&mesh.normals, &self.vertices),
            uvs: self.uvs.iter().map(|uv| uv.as_vec2()).collect(),
            colors: pick(&mesh.colors, &self.vertices),
            attributes,
            triangles: self.triangles.clone(),
            subsets: mesh.subsets.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::overlap::any_overlap;
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::rain::leaf::surface::{LeafSurface, tests::flat};
    use osier_base::math;

    const MAP: u32 = 64;

    /// Asserts that no two triangles of the chart overlap, and that the centroid of each triangle is found again from its chart
    /// coordinates.
    fn assert_one_to_one(surface: &LeafSurface) {
        for (i, t) in surface.triangles().iter().enumerate() {
            let p = t.iter().fold(DVec3::ZERO, |s, k| s + surface.points()[*k as usize] / 3.0);
            let uv = surface.interpolate_uv(i, [1.0 / 3.0; 2]);
            assert!(uv.cmpge(DVec2::ZERO).all() && uv.cmple(DVec2::ONE).all(), "{uv}");
            let found = surface.point_at(uv, 1.0).expect("on the blade");
            assert!(found.p.distance(p) < 1e-7, "triangle {i}: {} from {p}", found.p);
        }
        let corners: Vec<[DVec2; 3]> =
            surface.triangles().iter().map(|t| t.map(|k| surface.uvs()[k as usize])).collect();
        assert!(!any_overlap(&corners));
    }

    /// Texels of the chart that are on the blade.
    fn covered(surface: &LeafSurface) -> usize {
        let at = |k: u32| DVec2::new(f64::from(k % MAP) + 0.5, f64::from(k / MAP) + 0.5) / f64::from(MAP);
        (0..MAP * MAP).filter(|k| surface.point_at(at(*k), 1.0).is_some()).count()
    }

    fn fault(surface: &LeafSurface) -> Option<(UvFault, usize)> {
        surface.chart().map(|c| (c.fault, c.cuts))
    }

    #[test]
    fn coordinates_that_are_one_to_one_are_kept() {
        let surface = LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade");
        assert!(surface.chart().is_none());
        assert_one_to_one(&surface);
        // The other side of the blade, with the same vertices or copies of them, is left out.
        let mut both = flat(0.08, 0.04, 6);
        let other = Mesh { triangles: both.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect(), ..both.clone() };
        both.append(&other);
        let surface = LeafSurface::new(&both).expect("a blade");
        assert!(surface.chart().is_none() && surface.triangles().len() == 72);
        assert!(
            surface.nearest_margin(DVec3::new(0.0, 0.04, 0.0), 1.0).is_some_and(|m| (m.distance - 0.02).abs() < 1e-8)
        );
    }

    #[test]
    fn faults_of_coordinates_are_told_apart() {
        let with = |change: &dyn Fn(usize, Vec2) -> Vec2| {
            let mut mesh = flat(0.08, 0.04, 6);
            mesh.uvs = mesh.uvs.iter().enumerate().map(|(i, uv)| change(i, *uv)).collect();
            LeafSurface::new(&mesh).expect("a blade")
        };
        let mirrored = with(&|_, uv| Vec2::new((uv.x - 0.5).abs(), uv.y));
        let beyond = with(&|_, uv| uv * 2.0);
        let one_point = with(&|_, _| Vec2::ZERO);
        assert_eq!(fault(&mirrored), Some((UvFault::Overlap, 0)));
        assert_eq!(fault(&beyond), Some((UvFault::OutOfRange, 0)));
        assert_eq!(fault(&one_point), Some((UvFault::Missing, 0)));
        let none = LeafSurface::new(&Mesh { uvs: Vec::new(), ..flat(0.08, 0.04, 6) }).expect("a blade");
        assert_eq!(fault(&none), Some((UvFault::Missing, 0)));
        // The two halves of a leaf side by side in the texture.
        let mut halves = flat(0.08, 0.02, 6);
        let mut right = flat(0.08, 0.02, 6);
        halves.points.iter_mut().for_each(|p| p.x -= 0.01);
        right.points.iter_mut().for_each(|p| p.x += 0.01);
        halves.uvs.iter_mut().for_each(|uv| uv.x *= 0.4);
        right.uvs.iter_mut().for_each(|uv| uv.x = 0.6 + 0.4 * uv.x);
        halves.append(&right);
        let cut = LeafSurface::new(&halves).expect("a blade");
        assert_eq!(fault(&cut), Some((UvFault::Seam, 0)));
        // All are flat: projected, they fill their charts.
        for surface in [mirrored, beyond, one_point, none, cut] {
            assert_one_to_one(&surface);
            assert!((surface.area() / 0.0032 - 1.0).abs() < 1e-5, "{}", surface.area());
            assert!(covered(&surface) > 62 * 62 - 1, "{}", covered(&surface));
            // The tip, farthest from the stalk, lies at large v.
            let middle = surface.point_at(DVec2::new(0.5, 0.9), 1.0).expect("inside");
            assert!(middle.p.distance(DVec3::new(0.0, 0.072, 0.0)) < 2e-3 && middle.n.z > 0.99, "{middle:?}");
        }
    }

    #[test]
    fn the_textures_of_a_mirrored_leaf_are_found_through_its_chart() {
        let mut mesh = flat(0.08, 0.04, 6);
        mesh.uvs.iter_mut().for_each(|uv| uv.x = (uv.x - 0.5).abs());
        let surface = LeafSurface::new(&mesh).expect("a blade");
        for (x, y) in [(0.013, 0.02), (-0.013, 0.02), (0.004, 0.07), (-0.004, 0.07)] {
            let uv = DVec2::new(0.5 + x / 0.04 * (1.0 - 1.0 / 32.0), 0.5 + (y / 0.08 - 0.5) * (1.0 - 1.0 / 32.0));
            let found = surface.point_at(uv, 1.0).expect("inside");
            assert!(found.p.distance(DVec3::new(x, y, 0.0)) < 1e-6, "{found:?}");
            let texture = surface.texture_uv(uv).expect("inside");
            assert!(texture.distance(DVec2::new(x.abs() / 0.04, y / 0.08)) < 1e-6, "{texture}");
        }
        assert!(
            (surface.chart_to_texture_side_ratio() - 1.0 / (1.0 - 1.0 / 32.0)).abs() < 1e-6,
            "{}",
            surface.chart_to_texture_side_ratio()
        );
    }

    /// A strip of 80 by 40 mm rolled around the y axis by an angle, without texture coordinates.
    fn rolled(angle: f32) -> Mesh {
        let mut mesh = flat(0.08, 0.04, 24);
        mesh.uvs.clear();
        let radius = 0.04 / angle;
        for (p, n) in mesh.points.iter_mut().zip(&mut mesh.normals) {
            // A spiral whose turns do not touch.
            let turn = p.x / radius;
            let r = radius + 2e-4 * turn;
            let (sin, cos) = (math::sin_f32(turn), math::cos_f32(turn));
            *n = Vec3::new(sin, 0.0, cos);
            *p = Vec3::new(r * sin, p.y, r * cos - radius);
        }
        mesh
    }

    #[test]
    fn rolled_leaves_are_embedded_in_one_piece() {
        for angle in [1.0, 3.0, 5.0, 9.0] {
            let surface = LeafSurface::new(&rolled(angle)).expect("a blade");
            assert_eq!(fault(&surface), Some((UvFault::Missing, 0)), "{angle}");
            assert_one_to_one(&surface);
            assert!(covered(&surface) > 2500, "{angle}: {}", covered(&surface));
            assert!((surface.area() / 0.0032 - 1.0).abs() < 0.02, "{}", surface.area());
        }
    }

    #[test]
    fn a_thick_leaf_has_a_sheet_for_either_side() {
        // A closed box of 40 x 80 x 1 mm.
        let mut mesh = flat(0.08, 0.04, 4);
        mesh.uvs.clear();
        let below = Mesh {
            points: mesh.points.iter().map(|p| *p - Vec3::Z * 1e-3).collect(),
            normals: mesh.normals.iter().map(|n| -*n).collect(),
            triangles: mesh.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect(),
            ..mesh.clone()
        };
        mesh.append(&below);
        let rim: Vec<u32> = (0..5).chain([9, 14, 19, 24, 23, 22, 21, 20, 15, 10, 5]).collect();
        for (k, a) in rim.iter().enumerate() {
            let b = rim[(k + 1) % rim.len()];
            mesh.triangles.extend([[*a, a + 25, b + 25], [*a, b + 25, b]]);
        }
        let surface = LeafSurface::new(&mesh).expect("a blade");
        assert_one_to_one(&surface);
        assert_eq!(fault(&surface).map(|f| f.0), Some(UvFault::Missing));
        assert!(surface.nearest_margin(DVec3::new(0.0, 0.04, 0.0), 1.0).is_some());
        let chart = surface.chart().expect("of its own");
        assert!((1..=5).contains(&chart.cuts), "{}", chart.cuts);
        // Vertices along the cuts are doubled; positions of corners do not change.
        let charted = chart.apply_to(&mesh);
        assert!(charted.points.len() > mesh.points.len() && charted.uvs.len() == charted.points.len());
        for (a, b) in mesh.triangles.iter().zip(&charted.triangles) {
            assert!(a.iter().zip(b).all(|(a, b)| mesh.points[*a as usize] == charted.points[*b as usize]));
        }
    }

    #[test]
    fn a_mesh_without_area_is_no_blade() {
        let mut mesh = flat(0.08, 0.04, 2);
        mesh.points.iter_mut().for_each(|p| *p = Vec3::ZERO);
        mesh.uvs.clear();
        assert!(LeafSurface::new(&mesh).is_none());
        assert!(LeafSurface::new(&Mesh::default()).is_none());
    }
}
