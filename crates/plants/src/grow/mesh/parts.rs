//! Classifies the triangles of a mesh into leaf blades and pieces of wood, by connectivity, names and shape.

use std::ops::Range;

use glam::{DMat3, DVec3, Vec3};

use osier_base::disjoint_sets::DisjointSets;
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::par::LookupMap;
use osier_import::Imported;

/// Points nearer than this share of the bounding box's diagonal are welded: above the rounding of exported text, below the width
/// of the thinnest twigs.
const WELD_DISTANCE: f32 = 1e-5;
/// Flat parts are blades: the least variance of their points along the principal axes is below this share of the middle one.
const MAX_FLATNESS: f64 = 0.02;
/// Parts with large holes are blades: the area that would close the holes exceeds this share of the part's area.
const MAX_OPEN_SHARE: f64 = 0.3;
/// Largest area of a blade found by shape, as a share of the whole mesh: a trunk made of one open sheet is no leaf.
const MAX_BLADE_AREA_SHARE: f64 = 0.05;
/// Largest area of a stalk, as a share of its blade's.
const STALK_AREA_SHARE: f64 = 0.25;
/// Largest distance of a stalk from its blade, as a share of the blade's size.
const STALK_GAP_SHARE: f32 = 0.03;
/// Fewest points of a piece of wood that gets axes, if any piece has so many; smaller pieces are bound to the nearest wood.
const MIN_WOOD_POINTS: usize = 12;
/// A volume below this share of area^(3/2) counts as zero; a sphere has 0.094.
const MIN_VOLUME_RATIO: f64 = 1e-4;

/// Points of a mesh welded by position, since files repeat them along seams.
#[derive(Debug)]
pub(super) struct WeldedPoints {
    /// Index into `points` of each point of the mesh.
    pub welded_index: Vec<u32>,
    /// Distinct positions, m.
    pub points: Vec<Vec3>,
}

/// A number of points, triangles, patches or nodes as a 32-bit index. None exceeds the number of points or triangles of an
/// imported mesh, whose indices have 32 bits.
#[allow(clippy::cast_possible_truncation, reason = "indices of an imported mesh have 32 bits")]
pub(super) fn index(n: usize) -> u32 {
    n as u32
}

/// Connected triangles, by index into the mesh.
pub(super) type TrianglePatch = Vec<u32>;

/// Triangles of a mesh, classified as blades or wood; wood holds no degenerate triangles.
#[derive(Debug)]
pub(super) struct MeshParts {
    pub welded: WeldedPoints,
    /// Triangles of each blade, its stalk included.
    pub blades: Vec<TrianglePatch>,
    /// Pieces of wood, in the order of the file.
    pub wood: Vec<WoodPiece>,
    /// Fewest points of a piece that gets axes: [`MIN_WOOD_POINTS`], or any number on a tree so coarse that no piece has so many.
    fewest_points: usize,
}

impl MeshParts {
    /// Whether a piece of its wood gets axes.
    pub fn has_axes(&self, piece: &WoodPiece) -> bool {
        piece.points.len() >= self.fewest_points && piece.encloses_volume()
    }
}

/// A piece of wood: a surface whose triangles are connected by edges.
#[derive(Debug)]
pub(super) struct WoodPiece {
    pub points: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Index of each point in `WeldedPoints::points`.
    pub welded: Vec<u32>,
    /// Area of the surface, m^2, without the fans that close its holes.
    pub area: f64,
    /// Enclosed volume once holes are closed, m^3; negative if the surface faces inwards.
    pub volume: f64,
    /// Area of the triangle fans that close its holes, m^2.
    cap_area: f64,
}

impl WoodPiece {
    /// Radius of the tube of this area and volume, m: V / A = r / 2.
    pub fn radius(&self) -> f64 {
        2.0 * self.volume.abs() / self.area
    }

    /// Whether it encloses a volume, so that it can have axes.
    fn encloses_volume(&self) -> bool {
        let root = math::sqrt(self.area);
        self.volume.abs() > MIN_VOLUME_RATIO * root * self.area && self.cap_area < MAX_OPEN_SHARE * self.area
    }
}

/// Splits the triangles of a mesh into blades and pieces of wood. `words`, in lower case: an object or a material whose name
/// contains one of them is a blade.
pub(super) fn classify_triangles(imported: &Imported, words: &[String]) -> MeshParts {
    let mesh = &imported.mesh;
    let welded = weld(&mesh.points);
    let triangles: Vec<[u32; 3]> =
        mesh.triangles.iter().map(|t| t.map(|i| welded.welded_index.get(i as usize).copied().unwrap_or(0))).collect();
    // Names decide if any matches; otherwise small flat or open surfaces are blades.
    let mut is_blade = blades_by_name(imported, words);
    let all_triangles: Vec<u32> = (0..).take(triangles.len()).collect();
    let has_area = |t: &&u32| {
        let [a, b, c] = triangles[**t as usize];
        a != b && b != c && c != a
    };
    if !is_blade.contains(&true) {
        let proper: Vec<u32> = all_triangles.iter().filter(has_area).copied().collect();
        let patches = connected_patches(&triangles, &proper, true);
        let areas: Vec<f64> = patches.iter().map(|p| area(&welded.points, &triangles, p)).collect();
        let all = areas.iter().fold(0.0, |sum, a| sum + a);
        for (patch, area) in patches.iter().zip(areas) {
            if area < MAX_BLADE_AREA_SHARE * all && is_sheet(&welded.points, &triangles, patch) {
                patch.iter().for_each(|t| is_blade[*t as usize] = true);
            }
        }
    }
    let of = |blade: bool| -> Vec<u32> {
        all_triangles.iter().filter(|t| is_blade[**t as usize] == blade).copied().collect()
    };
    // Triangles that share a vertex are one blade; pieces of wood share edges.
    let blades = merge_stalks(&welded.points, &triangles, connected_patches(&triangles, &of(true), false));
    let solid: Vec<u32> = of(false).iter().filter(has_area).copied().collect();
    let wood: Vec<WoodPiece> =
        connected_patches(&triangles, &solid, true).iter().map(|p| wood_piece(&welded.points, &triangles, p)).collect();
    let is_fine = |piece: &WoodPiece| piece.points.len() >= MIN_WOOD_POINTS && piece.encloses_volume();
    let fewest_points = if wood.iter().any(is_fine) { MIN_WOOD_POINTS } else { 0 };
    MeshParts { welded, blades, wood, fewest_points }
}

/// For each triangle, whether the name of its object or of its material marks it as a blade.
fn blades_by_name(imported: &Imported, words: &[String]) -> Vec<bool> {
    let mut is_blade = vec![false; imported.mesh.triangles.len()];
    // The words are in lower case already.
    let says = |name: &str| {
        let name = name.to_lowercase();
        words.iter().any(|w| name.contains(w.as_str()))
    };
    let mut mark = |run: Range<usize>| is_blade.get_mut(run).into_iter().flatten().for_each(|b| *b = true);
    imported.parts.iter().filter(|p| says(&p.name)).for_each(|p| mark(p.triangles.clone()));
    for s in &imported.mesh.subsets {
        if imported.materials.get(s.material as usize).is_some_and(|m| says(&m.name)) {
            mark(s.first as usize..s.first as usize + s.count as usize);
        }
    }
    is_blade
}

/// Welds points nearer than [`WELD_DISTANCE`], by a hash grid of cells twice as wide: eight cells hold all candidates.
fn weld(points: &[Vec3]) -> WeldedPoints {
    let bounds = Bounds::of(points.iter().copied());
    let near = (bounds.size().length() * WELD_DISTANCE).max(f32::MIN_POSITIVE);
    let cell = 2.0 * near;
    #[allow(clippy::cast_possible_truncation, reason = "at most 1e5 cells along a side")]
    let low = |p: Vec3| ((p - bounds.min) / cell - 0.5).floor().to_array().map(|v| v as i32);
    let mut last: LookupMap<[i32; 3], u32> = LookupMap::default();
    let (mut places, mut before): (Vec<Vec3>, Vec<u32>) = (Vec::new(), Vec::new());
    let mut of = Vec::with_capacity(points.len());
    for p in points {
        let [x, y, z] = low(*p);
        // The cell of the point shifted by half a cell and its seven upper neighbours cover every point within half a
        // cell's width.
        let cells = (0..8).map(|k| [x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)]);
        let found = cells.filter_map(|c| last.get(&c).copied()).find_map(|top| {
            std::iter::successors(Some(top), |i| before.get(*i as usize).copied().filter(|b| *b != u32::MAX))
                .find(|i| places[*i as usize].distance(*p) <= near)
        });
        of.push(found.unwrap_or_else(|| {
            let own_index = index(places.len());
            places.push(*p);
            #[allow(clippy::cast_possible_truncation, reason = "at most 1e5 cells along a side")]
            let own = ((*p - bounds.min) / cell).floor().to_array().map(|v| v as i32);
            before.push(last.insert(own, own_index).unwrap_or(u32::MAX));
            own_index
        }));
    }
    WeldedPoints { welded_index: of, points: places }
}

/// The connected components of a subset of the triangles, by shared edges or by shared points, each in the order of the file.
fn connected_patches(triangles: &[[u32; 3]], subset: &[u32], by_edges: bool) -> Vec<TrianglePatch> {
    // Each triangle contributes its edges (or its points) as keys; equal keys become neighbours by sorting.
    let mut links: Vec<([u32; 2], u32)> = Vec::with_capacity(subset.len() * 3);
    for (k, t) in (0..).zip(subset) {
        let [a, b, c] = triangles[*t as usize];
        if by_edges {
            links.extend([(a, b), (b, c), (c, a)].map(|(a, b)| ([a.min(b), a.max(b)], k)));
        } else {
            links.extend([a, b, c].map(|a| ([a, a], k)));
        }
    }
    links.sort_unstable();
    let mut sets = DisjointSets::new(subset.len());
    for w in links.windows(2) {
        if w[0].0 == w[1].0 {
            sets.join(w[0].1, w[1].1);
        }
    }
    // The first triangle of a component decides its place in the result.
    let mut place = vec![u32::MAX; subset.len()];
    let mut out: Vec<TrianglePatch> = Vec::new();
    for (k, t) in (0..).zip(subset) {
        let root = sets.find(k) as usize;
        if place[root] == u32::MAX {
            place[root] = index(out.len());
            out.push(Vec::new());
        }
        out[place[root] as usize].push(*t);
    }
    out
}

fn corners(points: &[Vec3], t: [u32; 3]) -> [DVec3; 3] {
    t.map(|i| points[i as usize].as_dvec3())
}

fn area(points: &[Vec3], triangles: &[[u32; 3]], patch: &TrianglePatch) -> f64 {
    let one = |t: &u32| {
        let [a, b, c] = corners(points, triangles[*t as usize]);
        (b - a).cross(c - a).length() * 0.5
    };
    patch.iter().fold(0.0, |sum, t| sum + one(t))
}

/// Whether a patch is flat, or has holes so large that it encloses no volume.
fn is_sheet(points: &[Vec3], triangles: &[[u32; 3]], patch: &TrianglePatch) -> bool {
    let piece = wood_piece(points, triangles, patch);
    if piece.cap_area > MAX_OPEN_SHARE * piece.area {
        return true;
    }
    // Covariance of the points (times their number): its eigenvalues are the variances along the principal axes.
    let n = piece.points.len() as f64;
    let middle = piece.points.iter().fold(DVec3::ZERO, |s, p| s + p.as_dvec3()) / n;
    let spread = piece.points.iter().fold(DMat3::ZERO, |m, p| {
        let d = p.as_dvec3() - middle;
        m + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
    });
    let [least, mid, _] = eigenvalues(&spread);
    least < MAX_FLATNESS * mid
}

/// Eigenvalues of a symmetric matrix in rising order.
/// Source: O. K. Smith, "Eigenvalues of a symmetric 3x3 matrix", CACM 4(4), 1961.
fn eigenvalues(m: &DMat3) -> [f64; 3] {
    // With q the mean of the diagonal and p^2 = tr((M - q I)^2) / 6, the eigenvalues are q + 2 p cos(a + 2 pi k / 3),
    // where cos(3 a) = det((M - q I) / p) / 2.
    let q = (m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0;
    let off = m.x_axis.y * m.x_axis.y + m.x_axis.z * m.x_axis.z + m.y_axis.z * m.y_axis.z;
    let d = DVec3::new(m.x_axis.x - q, m.y_axis.y - q, m.z_axis.z - q);
    let p = math::sqrt((d.length_squared() + 2.0 * off) / 6.0);
    if p <= 0.0 {
        return [q; 3];
    }
    let b = (*m - DMat3::from_diagonal(DVec3::splat(q))) * (1.0 / p);
    let angle = math::acos((b.determinant() * 0.5).clamp(-1.0, 1.0)) / 3.0;
    let most = q + 2.0 * p * math::cos(angle);
    let least = q + 2.0 * p * math::cos(angle + std::f64::consts::TAU / 3.0);
    [least, 3.0 * q - most - least, most]
}

/// Unit eigenvector of the least eigenvalue of a symmetric matrix.
pub(super) fn least_axis(m: &DMat3) -> DVec3 {
    let [least, ..] = eigenvalues(m);
    // The rows of M - lambda I are perpendicular to the eigenvector: the longest cross product of two of them gives
    // it best.
    let rest = *m - DMat3::from_diagonal(DVec3::splat(least));
    let (x, y, z) = (rest.x_axis, rest.y_axis, rest.z_axis);
    let crosses = [x.cross(y), y.cross(z), z.cross(x)];
    let longest = crosses.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    longest.and_then(DVec3::try_normalize).unwrap_or(DVec3::Y)
}

/// Merges stalks with their blades; files often hold them as separate surfaces next to the blade.
fn merge_stalks(points: &[Vec3], triangles: &[[u32; 3]], patches: Vec<TrianglePatch>) -> Vec<TrianglePatch> {
    let areas: Vec<f64> = patches.iter().map(|p| area(points, triangles, p)).collect();
    let places = |p: &TrianglePatch| -> Vec<Vec3> {
        let mut seen: Vec<u32> = p.iter().flat_map(|t| triangles[*t as usize]).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.iter().map(|i| points[*i as usize]).collect()
    };
    let places: Vec<Vec<Vec3>> = patches.iter().map(places).collect();
    // Smallest distance between the points of both parts, as a share of the size of the larger.
    let gap = |small: usize, large: usize| {
        let size = Bounds::of(places[large].iter().copied()).size().length();
        let apart = |a: &Vec3| places[large].iter().fold(f32::MAX, |m, b| m.min(a.distance(*b)));
        places[small].iter().fold(f32::MAX, |m, a| m.min(apart(a))) / size.max(f32::MIN_POSITIVE)
    };
    // A stalk is much smaller than its blade, stands next to it in the file, and almost touches it.
    let mut joined = DisjointSets::new(patches.len());
    for i in 0..patches.len() {
        let adjacent = [i.checked_sub(1), Some(i + 1).filter(|n| *n < patches.len())];
        let blades = adjacent.into_iter().flatten().filter(|n| areas[i] < STALK_AREA_SHARE * areas[*n]);
        let nearest = blades.map(|n| (gap(i, n), n)).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, n)) = nearest.filter(|(gap, _)| *gap < STALK_GAP_SHARE) {
            joined.join(index(i), index(n));
        }
    }
    let mut out: Vec<TrianglePatch> = Vec::new();
    let mut slot = vec![usize::MAX; patches.len()];
    for (i, patch) in (0..).zip(patches) {
        let root = joined.find(i) as usize;
        if slot[root] == usize::MAX {
            slot[root] = out.len();
            out.push(Vec::new());
        }
        out[slot[root]].extend(patch);
    }
    out
}

/// Copies a patch to a piece of wood and measures its surface.
fn wood_piece(points: &[Vec3], triangles: &[[u32; 3]], patch: &TrianglePatch) -> WoodPiece {
    let mut welded: Vec<u32> = patch.iter().flat_map(|t| triangles[*t as usize]).collect();
    welded.sort_unstable();
    welded.dedup();
    // Points of the piece in rising order; the rank of a welded index is its local one.
    let local = |i: u32| index(welded.partition_point(|w| *w < i));
    let own: Vec<[u32; 3]> = patch.iter().map(|t| triangles[*t as usize].map(local)).collect();
    let own_points: Vec<Vec3> = welded.iter().map(|i| points[*i as usize]).collect();
    let (area, volume, cap_area) = measure(&own_points, &own);
    WoodPiece { points: own_points, triangles: own, welded, area, volume, cap_area }
}

/// Returns the area, m^2, the volume that the surface encloses once triangle fans close its holes, m^3, and the area of these
/// fans, m^2.
fn measure(points: &[Vec3], triangles: &[[u32; 3]]) -> (f64, f64, f64) {
    // Volume by the divergence theorem: the sum of a . (b x c) / 6 over the triangles, about the centroid for the
    // sake of rounding.
    let middle = points.iter().fold(DVec3::ZERO, |s, p| s + p.as_dvec3()) / points.len().max(1) as f64;
    let at = |i: u32| points[i as usize].as_dvec3() - middle;
    let (mut area, mut volume, mut cap_area) = (0.0, 0.0, 0.0);
    let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::with_capacity(triangles.len() * 3);
    for t in triangles {
        let [a, b, c] = t.map(at);
        area += (b - a).cross(c - a).length() * 0.5;
        volume += a.dot(b.cross(c)) / 6.0;
        let [a, b, c] = *t;
        edges.extend([[a, b], [b, c], [c, a]].map(|e| ([e[0].min(e[1]), e[0].max(e[1])], e)));
    }
    // Edges of a single triangle bound holes. A fan about the middle of each loop closes it, so that the volume is that of the
    // closed surface.
    edges.sort_unstable();
    let free: Vec<[u32; 2]> =
        edges.chunk_by(|a, b| a.0 == b.0).filter_map(|run| if let [e] = run { Some(e.1) } else { None }).collect();
    let mut loops = DisjointSets::new(points.len());
    free.iter().for_each(|[a, b]| _ = loops.join(*a, *b));
    let mut loop_sums: Vec<(DVec3, f64)> = vec![(DVec3::ZERO, 0.0); points.len()];
    for [a, _] in &free {
        let hub = &mut loop_sums[loops.find(*a) as usize];
        *hub = (hub.0 + at(*a), hub.1 + 1.0);
    }
    for [a, b] in &free {
        let (sum, n) = loop_sums[loops.find(*a) as usize];
        let (a, b, hub) = (at(*a), at(*b), sum / n);
        cap_area += (b - a).cross(hub - a).length() * 0.5;
        volume += b.dot(a.cross(hub)) / 6.0;
    }
    (area, volume, cap_area)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_of_a_known_matrix() {
        let m = DMat3::from_cols(DVec3::new(2.0, 1.0, 0.0), DVec3::new(1.0, 2.0, 0.0), DVec3::new(0.0, 0.0, 5.0));
        let found = eigenvalues(&m);
        assert!(found.iter().zip([1.0, 3.0, 5.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        assert!((least_axis(&m).dot(DVec3::new(1.0, -1.0, 0.0).normalize()).abs() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn an_open_tube_has_the_volume_of_a_closed_one_and_a_sheet_has_none() {
        let n = 64_u32;
        let ring = |y: f32| {
            (0..n).map(move |k| {
                let a = k as f32 / n as f32 * std::f32::consts::TAU;
                Vec3::new(math::cos_f32(a), y, math::sin_f32(a)) * Vec3::new(0.1, 1.0, 0.1)
            })
        };
        let points: Vec<Vec3> = ring(0.0).chain(ring(2.0)).collect();
        let tube: Vec<[u32; 3]> =
            (0..n).flat_map(|k| [[k, k + n, (k + 1) % n], [(k + 1) % n, k + n, (k + 1) % n + n]]).collect();
        let patch: TrianglePatch = (0..).take(tube.len()).collect();
        let tube = wood_piece(&points, &tube, &patch);
        assert!((tube.radius() / 0.1 - 1.0).abs() < 2e-3 && tube.encloses_volume(), "{}", tube.radius());
        let sheet = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 0.3, 1.0), Vec3::Z];
        assert!(!wood_piece(&sheet, &[[0, 1, 2], [0, 2, 3]], &vec![0, 1]).encloses_volume());
    }
}
