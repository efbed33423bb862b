//! Outlines of masks as polygons.

use glam::DVec2;

/// Marching squares at half the height of a field of `n` x `n` values, 0 beyond its border.
/// Returns closed rings in pixels, y down, pixel centres at whole numbers plus a half; outer rings run counter-clockwise
/// seen with y up, holes clockwise.
/// Own: every cell edge is crossed at most once, so rings never branch; saddles are cut so that set corners stay apart.
pub fn rings(field: &[f32], n: usize) -> Vec<Vec<DVec2>> {
    let at = |x: isize, y: isize| match (usize::try_from(x), usize::try_from(y)) {
        (Ok(x), Ok(y)) if x < n && y < n => field[y * n + x],
        _ => 0.0,
    };
    let size = n.cast_signed();
    // For each cell edge that a ring crosses, the edge that it crosses next. Edges are identified by their cell and a
    // side: 0 left, 1 top.
    let mut next = std::collections::BTreeMap::new();
    for y in -1..size {
        for x in -1..size {
            let corners = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)].map(|v| v > 0.5);
            // Edges of the cell in the order of its corners: top, right, bottom, left.
            let edges = [(x, y, 1), (x + 1, y, 0), (x, y + 1, 1), (x, y, 0)];
            for k in 0..4 {
                // A run of set corners begins at k: the ring enters the cell on the edge before the run and leaves it
                // on the edge after the run.
                if corners[k] && !corners[(k + 3) % 4] {
                    let mut last = k;
                    while corners[(last + 1) % 4] {
                        last = (last + 1) % 4;
                    }
                    next.insert(edges[last], edges[(k + 3) % 4]);
                }
            }
        }
    }
    #[allow(clippy::cast_precision_loss, reason = "pixels")]
    let point = |(x, y, side): (isize, isize, u8)| {
        let (u, v) = (x as f64 + 0.5, y as f64 + 0.5);
        let (a, b) = (at(x, y), if side == 0 { at(x, y + 1) } else { at(x + 1, y) });
        // Linear interpolation of the crossing of 0.5 on the edge between two pixel centres.
        let t = f64::from((0.5 - a) / (b - a)).clamp(0.0, 1.0);
        if side == 0 { DVec2::new(u, v + t) } else { DVec2::new(u + t, v) }
    };
    let mut out = Vec::new();
    while let Some((&start, _)) = next.iter().next() {
        // Follow the edges from the smallest one left until the ring closes; each edge is used once.
        let mut ring = Vec::new();
        let mut edge = start;
        while let Some(following) = next.remove(&edge) {
            ring.push(point(edge));
            edge = following;
        }
        out.push(ring);
    }
    for ring in &mut out {
        ring.reverse();
    }
    out
}

/// Twice the signed area, above 0 for rings that run counter-clockwise in the given axes.
pub fn area2(ring: &[DVec2]) -> f64 {
    (0..ring.len()).fold(0.0, |s, i| s + ring[i].perp_dot(ring[(i + 1) % ring.len()]))
}

/// Simplifies a ring: fewer points, within `tolerance` of the original ring, without edges that cross.
/// Source: D. Douglas, T. Peucker, "Algorithms for the reduction of the number of points", 1973, on both halves of the
/// ring; while edges cross, the farthest dropped point of each crossing edge is put back.
pub fn simplified(ring: &[DVec2], tolerance: f64) -> Vec<DVec2> {
    let n = ring.len();
    if n < 5 || tolerance <= 0.0 {
        return ring.to_vec();
    }
    // Split the ring at point 0 and the point farthest from it; each half is simplified as an open line.
    let far = (0..n).max_by(|a, b| ring[*a].distance(ring[0]).total_cmp(&ring[*b].distance(ring[0]))).unwrap_or(n / 2);
    let mut keep = vec![false; n + 1];
    (keep[0], keep[far], keep[n]) = (true, true, true);
    let at = |i: usize| ring[i % n];
    let mut stack = vec![(0, far), (far, n)];
    while let Some((a, b)) = stack.pop() {
        let Some((k, d)) = farthest(ring, a, b) else { continue };
        if d > tolerance {
            keep[k] = true;
            stack.extend([(a, k), (k, b)]);
        }
    }
    // While the simplified ring crosses itself, put back the farthest dropped point of each crossing edge; an edge without
    // dropped points stays as it is. At most 32 rounds.
    for _ in 0..32 {
        let kept: Vec<usize> = (0..n).filter(|i| keep[*i]).collect();
        let edges: Vec<(usize, usize)> =
            (0..kept.len()).map(|i| (kept[i], kept.get(i + 1).copied().unwrap_or(n))).collect();
        let segments: Vec<(DVec2, DVec2)> = edges.iter().map(|(a, b)| (at(*a), at(*b))).collect();
        let crossing = crossings(&segments);
        if crossing.is_empty() {
            break;
        }
        for i in crossing {
            if let Some((k, _)) = farthest(ring, edges[i].0, edges[i].1) {
                keep[k] = true;
            }
        }
    }
    (0..n).filter(|i| keep[*i]).map(at).collect()
}

/// The ring's point between the points `a` and `b` that lies farthest from their chord, and its distance.
fn farthest(ring: &[DVec2], a: usize, b: usize) -> Option<(usize, f64)> {
    let n = ring.len();
    let (p, q) = (ring[a % n], ring[b % n]);
    let d = q - p;
    let distance = |i: usize| {
        let v = ring[i % n] - p;
        let t = (v.dot(d) / d.length_squared().max(1e-30)).clamp(0.0, 1.0);
        (v - d * t).length()
    };
    (a + 1..b).map(|i| (i, distance(i))).max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)))
}

/// Indices of the segments of a closed chain that cross another segment, found with a grid.
pub fn crossings(segments: &[(DVec2, DVec2)]) -> Vec<usize> {
    let longest = segments.iter().fold(1.0_f64, |m, (a, b)| m.max(a.distance(*b)));
    #[allow(clippy::cast_possible_truncation, reason = "cells of a picture")]
    // Cells as wide as the longest segment: crossing segments have midpoints in neighbouring cells.
    let cell = |p: DVec2| ((p.x / longest).floor() as i64, (p.y / longest).floor() as i64);
    let mut grid: std::collections::BTreeMap<(i64, i64), Vec<usize>> = std::collections::BTreeMap::new();
    for (i, (a, b)) in segments.iter().enumerate() {
        grid.entry(cell((*a + *b) * 0.5)).or_default().push(i);
    }
    let side = |a: DVec2, b: DVec2, c: DVec2| (b - a).perp_dot(c - a);
    let cross = |(a, b): (DVec2, DVec2), (c, d): (DVec2, DVec2)| {
        side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
    };
    let mut out = Vec::new();
    for (i, s) in segments.iter().enumerate() {
        let (x, y) = cell((s.0 + s.1) * 0.5);
        let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        let hit = near.filter_map(|c| grid.get(&c)).flatten().any(|j| *j != i && cross(*s, segments[*j]));
        if hit {
            out.push(i);
        }
    }
    out
}

/// Even-odd test whether a point lies inside a closed ring; on the ring itself either result is possible.
pub fn inside(ring: &[DVec2], p: DVec2) -> bool {
    let n = ring.len();
    let crosses = |i: &usize| {
        let (a, b) = (ring[*i], ring[(i + 1) % n]);
        (a.y > p.y) != (b.y > p.y) && a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y) > p.x
    };
    (0..n).filter(crosses).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(n: usize, radius: f64) -> Vec<f32> {
        #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "pixels")]
        let soft = |i: usize| {
            let d = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5).distance(DVec2::splat(n as f64 / 2.0));
            (radius - d + 0.5).clamp(0.0, 1.0) as f32
        };
        (0..n * n).map(soft).collect()
    }

    #[test]
    fn the_contour_of_a_disc_has_its_area() {
        let all = rings(&disc(64, 20.0), 64);
        assert_eq!(all.len(), 1);
        // y down: counter-clockwise seen with y up is negative here.
        let area = -0.5 * area2(&all[0]);
        assert!((area / (std::f64::consts::PI * 400.0) - 1.0).abs() < 0.01, "{area}");
    }

    #[test]
    fn a_ring_has_an_outline_and_a_hole() {
        let (big, small) = (disc(64, 24.0), disc(64, 10.0));
        let field: Vec<f32> = big.iter().zip(&small).map(|(a, b)| a - b).collect();
        let mut areas: Vec<f64> = rings(&field, 64).iter().map(|r| -0.5 * area2(r)).collect();
        areas.sort_by(f64::total_cmp);
        assert!(areas.len() == 2 && areas[0] < -290.0 && areas[1] > 1780.0, "{areas:?}");
    }

    #[test]
    fn fewer_points_stay_near_and_do_not_cross() {
        let ring = rings(&disc(64, 20.0), 64).remove(0);
        for tolerance in [0.2, 1.0, 4.0] {
            let few = simplified(&ring, tolerance);
            let n = few.len();
            let segments: Vec<(DVec2, DVec2)> = (0..n).map(|i| (few[i], few[(i + 1) % n])).collect();
            assert!(crossings(&segments).is_empty());
            for p in &ring {
                let d = segments.iter().map(|(a, b)| {
                    let t = ((*p - *a).dot(*b - *a) / (*b - *a).length_squared()).clamp(0.0, 1.0);
                    p.distance(a.lerp(*b, t))
                });
                assert!(d.fold(f64::MAX, f64::min) <= tolerance + 1e-9);
            }
        }
    }
}
