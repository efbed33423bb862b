//! How thick wood is at each point of its surface, measured by rays through it.

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};

use super::parts::WoodPiece;
use osier_base::math;
use osier_base::par::par_chunks;

/// Points that one task measures; results do not depend on this number.
const CHUNK: usize = 1024;
/// Rays of the cone besides the one straight in, and the half angle of the cone, rad. A wider cone hits the walls of forks,
/// a narrower one measures a single direction seven times.
const RAYS: u8 = 6;
const TILT: f32 = 0.6;
/// Passes of Laplacian smoothing of the radii over the surface.
const SMOOTHING_PASSES: usize = 2;
/// A radius is clamped to this range, in mean radii of the piece, because rays through gaps in the mesh give meaningless lengths.
const RADIUS_RANGE: [f32; 2] = [0.02, 50.0];

/// Unit normals at the points, the area-weighted mean of the faces around: outwards, whichever way the surface faces.
pub(super) fn normals(piece: &WoodPiece) -> Vec<Vec3> {
    let side = if piece.volume < 0.0 { -1.0 } else { 1.0 };
    let mut sums = vec![Vec3::ZERO; piece.points.len()];
    for t in &piece.triangles {
        let [a, b, c] = t.map(|i| piece.points[i as usize]);
        let area = (b - a).cross(c - a) * side;
        t.iter().for_each(|i| sums[*i as usize] += area);
    }
    // Divide by the largest component first: the length of a sum, twice an area, may be below 1e-9, which
    // `normalize_or` treats as 0.
    let unit = |n: &Vec3| n / n.abs().max_element().max(f32::MIN_POSITIVE);
    sums.iter().map(|n| math::normalize_or(unit(n), Vec3::Y)).collect()
}

/// Radius of the wood under each point, m: half the median distance to the opposite side.
/// Own: after the shape diameter of L. Shapira et al., "Consistent mesh partitioning", The Visual Computer 24, 2008.
pub(super) fn radii(piece: &WoodPiece, normals: &[Vec3]) -> Vec<f32> {
    let whole = math::narrow(piece.radius());
    let walls = ThicknessRays::new(piece);
    let points: Vec<(Vec3, Vec3)> = piece.points.iter().copied().zip(normals.iter().copied()).collect();
    let measured =
        par_chunks(&points, CHUNK, |_, part| part.iter().map(|(p, n)| walls.radius(*p, *n, whole)).collect::<Vec<_>>())
            .concat();
    smooth(piece, measured)
}

/// Each radius becomes the mean of itself and its neighbours (one count per shared triangle), [`SMOOTHING_PASSES`] times.
fn smooth(piece: &WoodPiece, radii: Vec<f32>) -> Vec<f32> {
    let mut radii = radii;
    for _ in 0..SMOOTHING_PASSES {
        let mut sums: Vec<(f32, f32)> = radii.iter().map(|r| (*r, 1.0)).collect();
        for t in &piece.triangles {
            for k in 0..3 {
                let (a, b) = (t[k] as usize, t[(k + 1) % 3] as usize);
                sums[a] = (sums[a].0 + radii[b], sums[a].1 + 1.0);
                sums[b] = (sums[b].0 + radii[a], sums[b].1 + 1.0);
            }
        }
        radii = sums.iter().map(|(sum, n)| sum / n).collect();
    }
    radii
}

/// The triangles of a piece in a bounding volume hierarchy, for rays that measure its thickness.
struct ThicknessRays {
    tree: CwBvh,
    /// Triangles in the order of the hierarchy's leaves: a corner and the two edges from it.
    faces: Vec<[Vec3; 3]>,
}

impl ThicknessRays {
    fn new(piece: &WoodPiece) -> Self {
        let corner = |i: u32| piece.points[i as usize];
        let boxes: Vec<Aabb> = piece
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| Vec3A::from(corner(i)));
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let tree = build_cwbvh(&boxes, BvhBuildParams::very_fast_build(), &mut Duration::default());
        let face = |i: &u32| {
            let [a, b, c] = piece.triangles[*i as usize].map(corner);
            [a, b - a, c - a]
        };
        let faces = tree.primitive_indices.iter().map(face).collect();
        Self { tree, faces }
    }

    /// Half the median length of a cone of rays from `p` to the opposite wall, m. `n`: outward normal; `whole`: mean radius.
    fn radius(&self, p: Vec3, n: Vec3, whole: f32) -> f32 {
        // Directions of the cone around -n, evenly spaced about it.
        let (x, y) = (math::perpendicular(n), n.cross(math::perpendicular(n)));
        let (sin, cos) = (math::sin_f32(TILT), math::cos_f32(TILT));
        let tilted = (0..RAYS).map(|k| {
            let a = f32::from(k) * (std::f32::consts::TAU / f32::from(RAYS));
            n * -cos + (x * math::cos_f32(a) + y * math::sin_f32(a)) * sin
        });
        // Start a little below the surface, so that no ray hits the triangle that it starts from.
        let start = p - n * (whole * 1e-3);
        let mut ways: Vec<f32> = std::iter::once(-n).chain(tilted).filter_map(|d| self.ray_length(start, d)).collect();
        ways.sort_by(f32::total_cmp);
        // The median ignores the few rays that leave through an opening or run along the branch.
        let median = ways.get(ways.len() / 2).map_or(whole, |d| d * 0.5);
        median.clamp(whole * RADIUS_RANGE[0], whole * RADIUS_RANGE[1])
    }

    /// Length of a ray up to the nearest triangle; `None` if it hits none.
    fn ray_length(&self, from: Vec3, along: Vec3) -> Option<f32> {
        let ray = Ray::new_inf(from.into(), along.into());
        let mut hit = RayHit::none();
        let mut nearest = f32::INFINITY;
        self.tree.ray_traverse(ray, &mut hit, |ray, i| {
            let t = self.faces.get(i).and_then(|f| ray_triangle(f, from, along)).unwrap_or(f32::INFINITY);
            if t < ray.tmax {
                nearest = nearest.min(t);
            }
            t
        });
        nearest.is_finite().then_some(nearest)
    }
}

/// Ray parameter of the hit with a triangle, from either side; `None` if the ray misses.
/// Source: T. Moeller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
fn ray_triangle([a, ab, ac]: &[Vec3; 3], from: Vec3, along: Vec3) -> Option<f32> {
    let across = along.cross(*ac);
    let det = ab.dot(across);
    if det.abs() < f32::MIN_POSITIVE {
        return None;
    }
    // Barycentric coordinates u, v and the ray parameter t by Cramer's rule.
    let away = from - *a;
    let u = away.dot(across) / det;
    let lift = away.cross(*ab);
    let v = along.dot(lift) / det;
    let t = ac.dot(lift) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}
