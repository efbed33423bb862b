//! The first of many triangles at rest that a straight path meets.

use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};

use crate::rain::tuning::{HIT_TIE, TRIANGLE_SLACK};

/// A triangle in the form that the intersection test takes.
#[derive(Debug, Clone, Copy)]
struct ColliderTriangle {
    /// Position of the first corner, m.
    corner: Vec3,
    /// Edges from there to the second and to the third corner, m.
    edges: [Vec3; 2],
    /// Index among the triangles of the list.
    index: u32,
}

/// Triangles at rest, with a compressed wide hierarchy of their bounding boxes.
pub(crate) struct TriangleHierarchy {
    bvh: CwBvh,
    /// In the order of the leaves of the hierarchy.
    triangles: Vec<ColliderTriangle>,
}

/// First point at which a straight path meets triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TriangleHit {
    /// Fraction of the path, 0 to 1.
    pub t: f64,
    /// Index among the triangles.
    pub triangle: usize,
    /// Barycentric coordinates of the second and third corner.
    pub weights: [f64; 2],
}

/// Where a path meets one triangle, in single precision: fraction of the path, and weights of the second and third corner.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Crossing {
    t: f32,
    weights: [f32; 2],
}

impl TriangleHierarchy {
    /// Builds the hierarchy over triangles, each of which names three of the points, m.
    pub(crate) fn new(points: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let corners = |t: &[u32; 3]| t.map(|i| points[i as usize]);
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = corners(t).map(Vec3A::from);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let bvh = build_cwbvh(&boxes, BvhBuildParams::fast_build(), &mut Duration::default());
        let triangle = |index: &u32| {
            let [a, b, c] = corners(&triangles[*index as usize]);
            ColliderTriangle { corner: a, edges: [b - a, c - a], index: *index }
        };
        let triangles = bvh.primitive_indices.iter().map(triangle).collect();
        Self { bvh, triangles }
    }

    /// The first hit, from either side, of the straight path between two points, m.
    pub(crate) fn intersect(&self, from: DVec3, to: DVec3) -> Option<TriangleHit> {
        let d = (to - from).as_vec3();
        let length = d.length();
        if length <= 0.0 || self.triangles.is_empty() {
            return None;
        }
        let o = from.as_vec3();
        let ray = Ray::new(o.into(), (d / length).into(), 0.0, length);
        let mut best: Option<(Crossing, u32)> = None;
        let mut ray_hit = RayHit::none();
        self.bvh.ray_traverse(ray, &mut ray_hit, |_, i| {
            let triangle = &self.triangles[i];
            let Some(hit) = intersect_triangle(o, d, triangle) else { return f32::INFINITY };
            // A path may hit an edge that two triangles share: the lower index counts, whatever the order of traversal.
            let index = triangle.index;
            if best.is_none_or(|(b, i)| hit.t < b.t - HIT_TIE || (hit.t <= b.t + HIT_TIE && index < i)) {
                best = Some((hit, index));
            }
            // The traversal skips boxes beyond the returned distance: keep those that may hold a tie.
            (hit.t + 2.0 * HIT_TIE) * length
        });
        best.map(|(hit, index)| TriangleHit {
            t: f64::from(hit.t),
            triangle: index as usize,
            weights: hit.weights.map(f64::from),
        })
    }

    /// Number of triangles.
    pub(super) fn len(&self) -> usize {
        self.triangles.len()
    }

    /// The first hit by a test of every triangle, its share of the path and its triangle: the reference for
    /// [`TriangleHierarchy::intersect`].
    #[cfg(test)]
    pub(super) fn intersect_all(&self, from: DVec3, to: DVec3) -> Option<(f32, u32)> {
        let (o, d) = (from.as_vec3(), (to - from).as_vec3());
        let hits = self.triangles.iter().filter_map(|t| intersect_triangle(o, d, t).map(|hit| (hit.t, t.index)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    }
}

/// Where the path from `o` along `d` crosses a triangle. Source: Möller and Trumbore 1997.
fn intersect_triangle(o: Vec3, d: Vec3, triangle: &ColliderTriangle) -> Option<Crossing> {
    let ColliderTriangle { corner: a, edges: [e, f], .. } = *triangle;
    // Solve o + t d = a + u e + v f by Cramer's rule; the determinant is 0 for a path parallel to the triangle.
    let p = d.cross(f);
    let det = e.dot(p);
    if det.abs() < f32::MIN_POSITIVE {
        return None;
    }
    let s = (o - a) / det;
    let q = s.cross(e);
    let (u, v, t) = (s.dot(p), d.dot(q), f.dot(q));
    (u >= TRIANGLE_SLACK && v >= TRIANGLE_SLACK && u + v <= 1.0 - TRIANGLE_SLACK && (0.0..=1.0).contains(&t))
        .then_some(Crossing { t, weights: [u, v] })
}
