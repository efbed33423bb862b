//! Edge flips: improves the worst triangles of a triangulation until no flip helps.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec2;

/// Flips the diagonals of `triangles` (counter-clockwise in the plane) while that raises the lower quality of the two triangles
/// beside them; edges in `fixed` (smaller index first) stay. At most 12 sweeps.
/// Source: C. Lawson, "Software for C1 surface interpolation", 1977: swaps for better shape.
pub(super) fn flip_edges(points: &[Vec2], triangles: &mut [[u32; 3]], fixed: &BTreeSet<(u32, u32)>) {
    for _ in 0..12 {
        let mut faces_of_edge: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
        for (i, t) in triangles.iter().enumerate() {
            for k in 0..3 {
                faces_of_edge.entry(edge(t[k], t[(k + 1) % 3])).or_default().push(i);
            }
        }
        let mut flipped_faces = BTreeSet::new();
        for (key, pair) in &faces_of_edge {
            // Interior edges have two faces. A face takes part in one flip per sweep, since its edges are stale afterwards.
            let &[i, j] = pair.as_slice() else { continue };
            if fixed.contains(key) || flipped_faces.contains(&i) || flipped_faces.contains(&j) {
                continue;
            }
            if let Some(better) = flipped(points, triangles[i], triangles[j], *key) {
                [triangles[i], triangles[j]] = better;
                flipped_faces.extend([i, j]);
            }
        }
        if flipped_faces.is_empty() {
            break;
        }
    }
}

/// An edge as a key, smaller index first.
pub(super) fn edge(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

/// Triangles `s` and `t` with their shared edge replaced by the other diagonal, if that is better by 1 %.
fn flipped(points: &[Vec2], s: [u32; 3], t: [u32; 3], shared: (u32, u32)) -> Option<[[u32; 3]; 2]> {
    let (a, b) = shared;
    let apex = |t: [u32; 3]| t.into_iter().find(|v| *v != a && *v != b);
    let (c, d) = (apex(s)?, apex(t)?);
    // The order of the shared edge in s gives the orientation of the new triangles.
    let k = s.iter().position(|v| *v == c)?;
    let (from, to) = (s[(k + 1) % 3], s[(k + 2) % 3]);
    let new = [[c, from, d], [c, d, to]];
    let worst = |pair: [[u32; 3]; 2]| pair.into_iter().map(|t| triangle_quality(points, t)).fold(f32::MAX, f32::min);
    (worst(new) > worst([s, t]) * 1.01 + 1e-6).then_some(new)
}

/// Twice the area divided by the square of the longest side, negative if clockwise: 0 for slivers, 0.87 at most.
fn triangle_quality(points: &[Vec2], t: [u32; 3]) -> f32 {
    let [a, b, c] = t.map(|i| points[i as usize]);
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (b - a).perp_dot(c - a) / longest.max(1e-18)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_short_diagonal_wins_unless_kept() {
        let points = [Vec2::ZERO, Vec2::new(1.0, -0.1), Vec2::new(2.0, 0.0), Vec2::new(1.0, 0.1)];
        let long = [[0, 1, 2], [0, 2, 3]];
        let mut triangles = long;
        flip_edges(&points, &mut triangles, &BTreeSet::from([(0, 2)]));
        assert_eq!(triangles, long);
        flip_edges(&points, &mut triangles, &BTreeSet::new());
        assert!(triangles.iter().all(|t| t.contains(&1) && t.contains(&3)), "{triangles:?}");
        assert!(triangles.iter().all(|t| triangle_quality(&points, *t) > 0.0));
    }
}
