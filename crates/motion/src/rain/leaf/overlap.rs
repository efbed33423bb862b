//! Overlaps of triangles in the plane of texture coordinates.

use glam::DVec2;

use crate::rain::tuning::OVERLAP_TOLERANCE;

/// Largest number of cells along a side of the grid in which overlaps are searched; limits its memory.
const MAX_OVERLAP_CELLS: usize = 512;

/// Twice the area of a triangle, without sign.
pub(super) fn area([a, b, c]: &[DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a).abs()
}

/// Whether any two triangles of the plane overlap by more than [`OVERLAP_TOLERANCE`] of the extent of all.
pub(super) fn any_overlap(triangles: &[[DVec2; 3]]) -> bool {
    overlap_exceeds(triangles, 0.0)
}

/// Whether triangles that overlap others have more than a `fraction` of the total area. Exits at the first excess.
pub(super) fn overlap_exceeds(triangles: &[[DVec2; 3]], fraction: f64) -> bool {
    let corners = || triangles.iter().flatten();
    let low = corners().fold(DVec2::INFINITY, |m, p| m.min(*p));
    let high = corners().fold(DVec2::NEG_INFINITY, |m, p| m.max(*p));
    let extent = (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
    let tolerance = OVERLAP_TOLERANCE * extent.max_element();
    // Only triangles that share a cell of a grid can overlap.
    let n = triangles.len().isqrt().clamp(1, MAX_OVERLAP_CELLS);
    let cell = |p: DVec2| {
        let x = (p - low) / extent * n as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
        [x.x, x.y].map(|x| (x as usize).min(n - 1))
    };
    let mut cells: Vec<Vec<usize>> = vec![Vec::new(); n * n];
    let most = fraction * triangles.iter().map(area).sum::<f64>();
    let mut overlapping = 0.0;
    for (i, t) in triangles.iter().enumerate() {
        // The area that a triangle shares is at most its area and at most that of the largest triangle that it overlaps.
        let mut shared = 0.0_f64;
        let (from, to) = (cell(t[0].min(t[1]).min(t[2])), cell(t[0].max(t[1]).max(t[2])));
        for k in (from[1]..=to[1]).flat_map(|y| (from[0]..=to[0]).map(move |x| y * n + x)) {
            for j in &cells[k] {
                if triangles_overlap(&triangles[*j], t, tolerance) {
                    shared = shared.max(area(&triangles[*j]).min(area(t)));
                }
            }
            cells[k].push(i);
        }
        overlapping += shared;
        if overlapping > most {
            return true;
        }
    }
    false
}

/// Whether two triangles overlap by more than a distance: no edge of either separates them. Source: separating axis theorem.
fn triangles_overlap(a: &[DVec2; 3], b: &[DVec2; 3], tolerance: f64) -> bool {
    let axes = [a, b].into_iter().flat_map(|t| (0..3).map(|k| (t[(k + 1) % 3] - t[k]).perp().normalize_or_zero()));
    axes.filter(|axis| *axis != DVec2::ZERO).all(|axis| {
        let range = |t: &[DVec2; 3]| {
            let [x, y, z] = t.map(|p| p.dot(axis));
            (x.min(y).min(z), x.max(y).max(z))
        };
        let ((a0, a1), (b0, b1)) = (range(a), range(b));
        a1.min(b1) - a0.max(b0) > tolerance
    })
}
