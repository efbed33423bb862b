//! Polygons into triangles.

use glam::{Vec2, Vec3};

use osier_base::geometry;
use osier_base::math::{normalize_or, perpendicular};

/// Triangles of faces with `arities` corners each (none given: all are triangles). Faces of fewer than three corners are
/// left out; concave ones keep their outline.
pub(super) fn triangulate(points: &[Vec3], indices: &[u32], arities: &[u32]) -> Vec<[u32; 3]> {
    let triple = |t: &[u32]| match t {
        [a, b, c] => [*a, *b, *c],
        _ => [0; 3],
    };
    if arities.is_empty() {
        return indices.chunks_exact(3).map(triple).collect();
    }
    let mut triangles = Vec::with_capacity(indices.len());
    let mut rest = indices;
    for arity in arities {
        let (face, after) = rest.split_at((*arity as usize).min(rest.len()));
        rest = after;
        match face.len() {
            ..3 => {}
            3 => triangles.push(triple(face)),
            _ => polygon(points, face, &mut triangles),
        }
    }
    triangles
}

/// Appends the triangles of one polygon, cut in the plane of its Newell normal; a polygon without area becomes a fan.
fn polygon(points: &[Vec3], face: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let corners: Vec<Vec3> = face.iter().map(|i| points.get(*i as usize).copied().unwrap_or_default()).collect();
    let origin = corners.first().copied().unwrap_or_default();
    // Subtract a corner and divide by the extent, so that far and tiny polygons keep their digits.
    let extent = corners.iter().fold(0.0_f32, |m, p| m.max((*p - origin).abs().max_element()));
    let local: Vec<Vec3> = corners.iter().map(|p| (*p - origin) / extent.max(f32::MIN_POSITIVE)).collect();
    let normal = normalize_or(geometry::newell(&local), Vec3::ZERO);
    // Axes of the polygon's plane with x cross y along the normal, so that the outline is counter-clockwise.
    let (x, y) = (perpendicular(normal), normal.cross(perpendicular(normal)));
    let outline: Vec<Vec2> = local.iter().map(|p| Vec2::new(x.dot(*p), y.dot(*p))).collect();
    let cut = if normal.length_squared() > 0.5 { geometry::triangulate(&outline) } else { Vec::new() };
    let corner = |i: usize| face.get(i).copied().unwrap_or(0);
    // A simple polygon gives exactly n - 2 triangles; fewer mean that it crosses itself or has no area.
    if cut.len() == face.len() - 2 {
        triangles.extend(cut.iter().map(|t| t.map(|i| corner(i as usize))));
    } else {
        triangles.extend((2..face.len()).map(|i| [corner(0), corner(i - 1), corner(i)]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_concave_leaf_outline_keeps_its_area_and_side() {
        let outline = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0)];
        let points: Vec<Vec3> = outline.iter().map(|(x, z)| Vec3::new(100.0 + x * 1e-3, 5.0, z * -1e-3)).collect();
        let triangles = triangulate(&points, &[0, 1, 2, 3, 4, 0, 1, 0, 1, 2], &[5, 2, 3]);
        assert_eq!(triangles.len(), 4);
        let up = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| points[i as usize]);
            (b - a).cross(c - a).y
        };
        assert!(triangles.iter().all(|t| up(t) > 0.0));
        let area: f32 = triangles[..3].iter().map(|t| up(t) / 2.0).fold(0.0, |s, a| s + a);
        assert!((area - 2.5e-6).abs() < 1e-7, "{area}");
    }
}
