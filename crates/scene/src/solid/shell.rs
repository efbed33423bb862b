//! Triangle meshes as solids, closed or open.

use std::time::Duration;

use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

use super::Nearest;
use osier_base::geometry::Bounds;

/// Largest distance, as a share of the length of a ray, between triangles that face the same way and count as one crossing. It
/// exceeds the rounding errors of distances to triangles that share an edge; two sheets of a closed surface that face alike are
/// farther apart.
const SAME_CROSSING: f32 = 1e-5;

/// A triangle mesh with a bounding volume hierarchy. If it has open edges, what counts as inside is a guess.
#[derive(Clone)]
pub struct Shell {
    triangles: Vec<[Vec3; 3]>,
    tree: Bvh2,
    bounds: Bounds,
    edges: EdgeCount,
}

impl std::fmt::Debug for Shell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Shell of {} triangles", self.triangles.len())
    }
}

impl Shell {
    /// `points`, m; triangles counter-clockwise from outside. Triangles without area or with an unknown point are left out;
    /// `None` if no triangle is left.
    #[inline]
    pub fn new(points: &[Vec3], triangles: &[[u32; 3]]) -> Option<Self> {
        let at = |i: u32| points.get(i as usize).copied();
        let all = triangles.iter().filter_map(|[a, b, c]| Some([at(*a)?, at(*b)?, at(*c)?]));
        let triangles: Vec<[Vec3; 3]> =
            all.filter(|[a, b, c]| (*b - *a).cross(*c - *a).length() > f32::MIN_POSITIVE).collect();
        if triangles.is_empty() {
            return None;
        }
        let boxes: Vec<Aabb> =
            triangles.iter().map(|[a, b, c]| Aabb::new(a.min(*b).min(*c).into(), a.max(*b).max(*c).into())).collect();
        let tree = build_bvh2(&boxes, BvhBuildParams::fast_build(), &mut Duration::default());
        let bounds = Bounds::of(triangles.iter().flatten().copied());
        let edges = count_edges(&triangles);
        Some(Self { triangles, tree, bounds, edges })
    }

    /// Number of edges that belong to an odd number of triangles; 0 for a closed mesh, and for several closed meshes that touch.
    #[inline]
    pub fn open_edges(&self) -> usize {
        self.edges.open
    }

    /// Corners of its triangles, m; triangles without area have been left out.
    #[inline]
    pub fn triangles(&self) -> &[[Vec3; 3]] {
        &self.triangles
    }

    pub(super) fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// True if more than three of the six rays along the axes find the point inside. If all triangles have a common outside, a
    /// ray does so that leaves the surface more often than it enters it (or less often, if the mesh is inside out), so that
    /// points in the overlap of two boxes are inside. Otherwise an odd number of crossings means inside.
    pub(super) fn contains(&self, at: Vec3) -> bool {
        let b = self.bounds;
        if at.cmplt(b.min).any() || at.cmpgt(b.max).any() {
            return false;
        }
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
        // Rays through a hole of an open mesh count a wrong number of crossings, so the majority of the rays decides.
        let mut met = [Vec::new(), Vec::new()];
        let tells_inside = |way: &&Vec3| {
            let [enters, leaves] = self.crossings(at, **way, &mut met);
            if self.edges.oriented { enters != leaves } else { (enters + leaves) % 2 == 1 }
        };
        axes.iter().filter(tells_inside).count() > 3
    }

    /// Number of times that the ray from `from` along the unit vector `way` passes through triangles that face it, and through
    /// triangles that face away. At an edge or a corner the triangles that face the same way are one crossing: rays along the axes
    /// meet the diagonals of faces on a grid exactly.
    /// `met`: buffers for the distances of the triangles that face the ray, and of those that face away.
    fn crossings(&self, from: Vec3, way: Vec3, met: &mut [Vec<f32>; 2]) -> [usize; 2] {
        // Long enough to leave the mesh from any point in its box.
        let far = self.bounds.size().max_element() * 2.0;
        let reach = from + way * far;
        met.iter_mut().for_each(Vec::clear);
        self.each_in_box(Bounds { min: from.min(reach), max: from.max(reach) }, |triangle| {
            if let Some(hit) = ray_hit(triangle, from, way) {
                met[usize::from(hit.faces_away)].push(hit.distance);
            }
            true
        });
        let distinct = |distances: &mut Vec<f32>| {
            distances.sort_by(f32::total_cmp);
            distances.dedup_by(|next, kept| *next - *kept <= far * SAME_CROSSING);
            distances.len()
        };
        met.each_mut().map(distinct)
    }

    /// Calls `take` with the triangles of the tree's leaves that overlap a box, until it returns false.
    fn each_in_box(&self, within: Bounds, mut take: impl FnMut([Vec3; 3]) -> bool) {
        self.tree.aabb_traverse(Aabb::new(within.min.into(), within.max.into()), |tree, node| {
            let node = &tree.nodes[node as usize];
            let first = node.first_index as usize;
            let mut triangles = tree.primitive_indices[first..first + node.prim_count as usize].iter();
            triangles.all(|i| take(self.triangles[*i as usize]))
        });
    }

    /// Whether a segment meets one of the triangles; see [`segment_meets`] for `slack`, m.
    pub(super) fn meets(&self, [from, to]: [Vec3; 2], slack: f32) -> bool {
        let within = Bounds { min: from.min(to), max: from.max(to) }.expanded(slack);
        let mut met = false;
        self.each_in_box(within, |triangle| {
            met = segment_meets(triangle, [from, to], slack);
            !met
        });
        met
    }

    /// Conservative test of a box: false only if the surface does not pass through it.
    pub(super) fn may_touch(&self, within: Bounds) -> bool {
        let (center, half) = (within.center(), within.size() / 2.0);
        let mut touched = false;
        self.each_in_box(within, |[a, b, c]| {
            let normal = (b - a).cross(c - a);
            // The plane of the triangle meets the box; its outline is not tested, so that the answer may be a false yes.
            touched = normal.dot(center - a).abs() <= normal.abs().dot(half);
            !touched
        });
        touched
    }

    pub(super) fn nearest(&self, at: Vec3) -> Nearest {
        let mut best = (f32::INFINITY, Vec3::ZERO, 0_usize);
        let mut stack = vec![0_u32];
        while let Some(i) = stack.pop() {
            let Some(node) = self.tree.nodes.get(i as usize) else { continue };
            if square_distance(node.aabb(), at) >= best.0 {
                continue;
            }
            let first = node.first_index as usize;
            if node.is_leaf() {
                for t in &self.tree.primitive_indices[first..first + node.prim_count as usize] {
                    let p = nearest_on(self.triangles[*t as usize], at);
                    let d = p.distance_squared(at);
                    if d < best.0 {
                        best = (d, p, *t as usize);
                    }
                }
            } else {
                // The nearer child is pushed last and so visited first, which shortens the search.
                let [a, b] = [node.first_index, node.first_index + 1];
                let away = |k: u32| self.tree.nodes.get(k as usize).map_or(0.0, |n| square_distance(n.aabb(), at));
                stack.extend(if away(a) < away(b) { [b, a] } else { [a, b] });
            }
        }
        let sign = if self.contains(at) { -1.0 } else { 1.0 };
        let distance = best.0.sqrt();
        let [a, b, c] = self.triangles[best.2];
        let flat = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let normal = if distance > 1e-5 { (at - best.1) * (sign / distance) } else { flat };
        Nearest { distance: distance * sign, normal }
    }
}

fn square_distance(b: &Aabb, at: Vec3) -> f32 {
    let (low, high) = (Vec3::from(b.min), Vec3::from(b.max));
    (low - at).max(at - high).max(Vec3::ZERO).length_squared()
}

/// Properties of a mesh that follow from its edges.
#[derive(Debug, Clone, Copy)]
struct EdgeCount {
    /// Number of edges that belong to an odd number of triangles.
    open: usize,
    /// Whether each edge is run through as often in one direction as in the other, so that the mesh is closed and its triangles
    /// have a common outside.
    oriented: bool,
}

/// An edge of a triangle; edges are equal if the bits of their end points are.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct DirectedEdge {
    /// Bits of the end points, the lower first.
    ends: [[u32; 3]; 2],
    /// Whether the triangle runs from the first to the second.
    rises: bool,
}

fn count_edges(triangles: &[[Vec3; 3]]) -> EdgeCount {
    // Adding 0 turns -0 into 0, whose bits differ although the points coincide.
    let bits = |p: Vec3| p.to_array().map(|v| (v + 0.0).to_bits());
    let mut edges: Vec<DirectedEdge> = Vec::with_capacity(triangles.len() * 3);
    for [a, b, c] in triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let (p, q) = (bits(*p), bits(*q));
            edges.push(DirectedEdge { ends: [p.min(q), p.max(q)], rises: p < q });
        }
    }
    edges.sort_unstable();
    let mut count = EdgeCount { open: 0, oriented: true };
    for run in edges.chunk_by(|a, b| a.ends == b.ends) {
        count.open += run.len() % 2;
        count.oriented &= 2 * run.iter().filter(|edge| edge.rises).count() == run.len();
    }
    count
}

/// Where a ray meets a triangle.
struct RayHit {
    /// Distance from the start of the ray, m.
    distance: f32,
    /// Whether the ray comes from behind the triangle.
    faces_away: bool,
}

/// Where the ray from `from` along the unit vector `way` crosses a triangle, from either side; `None` if it misses.
/// Source: T. Moeller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
fn ray_hit([a, b, c]: [Vec3; 3], from: Vec3, way: Vec3) -> Option<RayHit> {
    let (ab, ac) = (b - a, c - a);
    let across = way.cross(ac);
    let det = ab.dot(across);
    if det.abs() < f32::MIN_POSITIVE {
        return None;
    }
    let away = from - a;
    let u = away.dot(across) / det;
    let lift = away.cross(ab);
    let v = way.dot(lift) / det;
    let distance = ac.dot(lift) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some(RayHit { distance, faces_away: det < 0.0 })
}

/// Whether a segment passes a triangle grown by `slack`, m, in its plane, or ends within `slack` of it. The slack leaves no gap
/// between triangles that share an edge.
fn segment_meets([a, b, c]: [Vec3; 3], [from, to]: [Vec3; 2], slack: f32) -> bool {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside = |p: Vec3| {
        // Signed distances from the three edges, inwards.
        [(a, b), (b, c), (c, a)].iter().all(|(p0, p1)| {
            let inward = normal.cross(*p1 - *p0).normalize_or_zero();
            (p - *p0).dot(inward) >= -slack
        })
    };
    let (start, end) = ((from - a).dot(normal), (to - a).dot(normal));
    if start.abs() <= slack && inside(from) || end.abs() <= slack && inside(to) {
        return true;
    }
    start * end < 0.0 && inside(from + (to - from) * (start / (start - end)))
}

/// The point of a triangle nearest to `p`.
/// Source: C. Ericson, "Real-time collision detection", 2005, section 5.1.5 (regions of corners, edges and face).
pub(super) fn nearest_on([a, b, c]: [Vec3; 3], p: Vec3) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    let side = |from: Vec3| (ab.dot(p - from), ac.dot(p - from));
    let ((d1, d2), (d3, d4), (d5, d6)) = (side(a), side(b), side(c));
    // The point is nearest to a corner if it lies behind both sides that meet there.
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    // Barycentric coordinates of its projection, each times twice the squared area: where one is negative the point is
    // nearest to the side across from that corner.
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    // Its projection is inside the triangle.
    let share = 1.0 / (va + vb + vc);
    a + ab * (vb * share) + ac * (vc * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of side 2 around the origin.
    fn cube() -> Shell {
        let points: Vec<Vec3> = (0..8)
            .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32) * 2.0 - Vec3::ONE)
            .collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        Shell::new(&points, &triangles).expect("a cube")
    }

    #[test]
    fn a_cube_is_a_box() {
        let cube = cube();
        assert_eq!(cube.open_edges(), 0);
        for i in 0..500_u16 {
            let f = f32::from(i);
            let at = Vec3::new((f * 0.371) % 4.0 - 2.0, (f * 0.533) % 4.0 - 2.0, (f * 0.717) % 4.0 - 2.0);
            let over = at.abs() - Vec3::ONE;
            let truth = over.max(Vec3::ZERO).length() + over.max_element().min(0.0);
            let near = cube.nearest(at);
            assert!((near.distance - truth).abs() < 1e-5, "{at}: {near:?} {truth}");
            assert!(cube.nearest(at - near.normal * near.distance).distance.abs() < 1e-4);
        }
    }

    #[test]
    fn segments_meet_the_surface_and_not_what_is_beside_it() {
        let cube = cube();
        for i in 0..500_u16 {
            let f = f32::from(i);
            let at = |s: f32| Vec3::new((f * 0.371 * s) % 4.0, (f * 0.533 * s) % 4.0, (f * 0.717 * s) % 4.0) - 2.0;
            let (from, to) = (at(1.0), at(1.3));
            let distance = |p: Vec3| {
                let over = p.abs() - Vec3::ONE;
                over.max(Vec3::ZERO).length() + over.max_element().min(0.0)
            };
            let along: Vec<f32> = (0..=1000).map(|k| distance(from.lerp(to, k as f32 / 1000.0))).collect();
            let low = along.iter().copied().fold(f32::INFINITY, f32::min);
            let high = along.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let meets = cube.meets([from, to], 1e-4);
            assert!(low.abs() < 0.01 || high.abs() < 0.01 || meets == (low < 0.0 && high > 0.0), "{from} {to}");
            let within = Bounds { min: from.min(to), max: from.max(to) };
            assert!(!meets || cube.may_touch(within), "{from} {to}");
        }
        // Along the shared diagonal of a face's two triangles, in the plane of a face, and ending on one.
        assert!(cube.meets([Vec3::new(0.3, 0.3, -2.0), Vec3::new(0.3, 0.3, 0.0)], 1e-4));
        assert!(cube.meets([Vec3::new(1.0, 0.2, 0.3), Vec3::new(1.0, 0.4, 0.3)], 1e-4));
        assert!(cube.meets([Vec3::new(1.5, 0.2, 0.3), Vec3::new(1.0, 0.2, 0.3)], 1e-4));
        assert!(!cube.meets([Vec3::new(1.5, 0.2, 0.3), Vec3::new(1.01, 0.2, 0.3)], 1e-4));
        assert!(!cube.may_touch(Bounds { min: Vec3::splat(-0.5), max: Vec3::splat(0.5) }));
    }

    /// The diagonals of the cube's faces cross above each point of its own diagonal, and edges and corners of the octahedron lie
    /// on the axes: rays that count two or four triangles there count an inner point as outside.
    #[test]
    fn rays_through_edges_and_corners_count_once() {
        for v in [-0.75, -0.25, 0.0, 0.5] {
            assert!(cube().contains(Vec3::splat(v)), "{v}");
        }
        assert!(!cube().contains(Vec3::splat(1.25)));
        let points = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z];
        let faces = (0..8_u32).map(|k| {
            let (x, y, z) = (k & 1, 2 + (k >> 1 & 1), 4 + (k >> 2));
            // Each step to an opposite corner turns the face over.
            if (x + y + z).is_multiple_of(2) { [x, y, z] } else { [x, z, y] }
        });
        let octahedron = Shell::new(&points, &faces.collect::<Vec<_>>()).expect("an octahedron");
        assert_eq!(octahedron.open_edges(), 0);
        for (x, y, z, inside) in [
            (0.0, 0.0, 0.0, true),
            (0.3, 0.3, 0.0, true),
            (0.0, -0.6, 0.2, true),
            (0.7, 0.7, 0.0, false),
            (0.0, 0.6, -0.6, false),
        ] {
            assert_eq!(octahedron.contains(Vec3::new(x, y, z)), inside, "{x} {y} {z}");
        }
    }

    /// Of two cubes in one mesh that overlap, or that touch at an edge, all that lies in either is inside, also where they overlap; a
    /// cube inside out within another is a cavity.
    #[test]
    fn overlapping_parts_of_a_mesh_are_one_solid() {
        let corners: Vec<Vec3> = cube().triangles().iter().flatten().copied().collect();
        let both = |move_by: Vec3, scale: f32, flipped: bool| {
            let points: Vec<Vec3> =
                corners.iter().copied().chain(corners.iter().map(|p| *p * scale + move_by)).collect();
            let triangles: Vec<[u32; 3]> = (0..24)
                .map(|i| if flipped && i >= 12 { [3 * i, 3 * i + 2, 3 * i + 1] } else { [3 * i, 3 * i + 1, 3 * i + 2] })
                .collect();
            Shell::new(&points, &triangles).expect("two cubes")
        };
        let overlapping = both(Vec3::new(1.0, 0.5, 0.75), 1.0, false);
        let inside = |shell: &Shell, x: f32| shell.contains(Vec3::new(x, 0.1, 0.2));
        assert_eq!([-1.5, -0.5, 0.5, 1.5, 2.5].map(|x| inside(&overlapping, x)), [false, true, true, true, false]);
        assert_eq!(overlapping.open_edges(), 0);
        // They share the edge at x = 1, z = 1.
        let touching = both(Vec3::new(2.0, 0.0, 2.0), 1.0, false);
        assert_eq!((touching.open_edges(), touching.contains(Vec3::new(2.0, 0.1, 2.2))), (0, true));
        assert!(!touching.contains(Vec3::new(2.0, 0.1, 0.2)));
        let hollow = both(Vec3::ZERO, 0.5, true);
        assert_eq!([-0.75, 0.0, 0.75].map(|x| inside(&hollow, x)), [true, false, true]);
        // A cube beside it that is inside out is as solid.
        let apart = both(Vec3::new(3.0, 0.0, 0.0), 1.0, true);
        assert_eq!([0.0, 1.5, 3.0].map(|x| inside(&apart, x)), [true, false, true]);
    }

    /// The cube without its last faces: with at most two of six open its inside still counts as inside.
    #[test]
    fn the_inside_of_an_open_mesh_is_that_of_most_rays() {
        let points: Vec<Vec3> = cube().triangles().iter().flatten().copied().collect();
        for (faces, inside) in [(6, true), (5, true), (4, true), (3, false), (1, false)] {
            let triangles: Vec<[u32; 3]> = (0..2 * faces).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let open = Shell::new(&points, &triangles).expect("faces");
            assert_eq!(open.contains(Vec3::new(0.1, 0.2, -0.3)), inside, "{faces}");
        }
    }

    #[test]
    fn what_is_open_is_counted() {
        let cube = cube();
        let points: Vec<Vec3> = cube.triangles().iter().flatten().copied().collect();
        let triangles: Vec<[u32; 3]> = (0..11).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert_eq!(Shell::new(&points, &triangles).expect("most of a cube").open_edges(), 3);
    }
}
