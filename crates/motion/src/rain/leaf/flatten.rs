//! Flattening of blades: projection on the best-fit plane where that is one-to-one, else an embedding in a disk, else in pieces.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::overlap::any_overlap;
use crate::rain::tuning::{CHART_GAP, EMBED_ROUNDS, EMBED_TOLERANCE, MIN_PROJECTED_AREA};
use osier_base::math;

/// A connected piece of a blade, mapped to the plane without overlaps.
pub(super) struct FlatPiece {
    /// Indices among the triangles of the blade.
    pub triangles: Vec<usize>,
    /// Position of each vertex in the plane, m; in chart coordinates once it is packed.
    pub uvs: BTreeMap<u32, DVec2>,
}

/// A blade mapped to the plane, in one or several pieces.
pub(super) struct FlatBlade {
    pub pieces: Vec<FlatPiece>,
    /// Number of cuts: pieces minus connected parts of the blade.
    pub cuts: usize,
}

struct Flattener<'a> {
    points: &'a [DVec3],
    /// Welded vertices of each triangle: all vertices at one position are one vertex.
    triangles: &'a [[u32; 3]],
}

/// Principal axes of a piece by area, of unit length.
struct PrincipalAxes {
    /// Along the largest extent.
    major: DVec3,
    /// The normal of the best-fit plane.
    normal: DVec3,
}

/// Flattens a blade. The blade as a whole is projected if that is one-to-one; else each connected part is projected, or embedded
/// in a disk, or cut in two.
pub(super) fn flatten(points: &[DVec3], triangles: &[[u32; 3]]) -> FlatBlade {
    let blade = Flattener { points, triangles };
    let all: Vec<usize> = (0..triangles.len()).collect();
    if let Some(piece) = blade.project(&all) {
        return FlatBlade { pieces: vec![piece], cuts: 0 };
    }
    let mut waiting = blade.connected_components(&all);
    let parts = waiting.len();
    // Parts are taken from the end: reverse them, so that pieces keep their order.
    waiting.reverse();
    let mut pieces = Vec::new();
    while let Some(part) = waiting.pop() {
        match blade.project(&part).or_else(|| blade.embed(&part)) {
            Some(piece) => pieces.push(piece),
            // This ends: each half has fewer triangles, and a single triangle is flat.
            None => waiting.extend(blade.split(&part).iter().flat_map(|half| blade.connected_components(half)).rev()),
        }
    }
    let cuts = pieces.len() - parts;
    FlatBlade { pieces, cuts }
}

impl Flattener<'_> {
    fn corners(&self, k: usize) -> [DVec3; 3] {
        self.triangles[k].map(|i| self.points[i as usize])
    }

    /// Unit normal of a triangle times twice its area, m^2.
    fn doubled_area_normal(&self, k: usize) -> DVec3 {
        let [a, b, c] = self.corners(k);
        (b - a).cross(c - a)
    }

    /// Projection on the best-fit plane, with v along the longest extent; `None` if triangles overlap or almost vanish there.
    fn project(&self, part: &[usize]) -> Option<FlatPiece> {
        let axes = self.principal_axes(part);
        // The normal points to the side that most triangles face; v points away from the stalk, which ends at the origin.
        let facing = part.iter().fold(DVec3::ZERO, |s, k| s + self.doubled_area_normal(*k));
        let center = part.iter().fold(DVec3::ZERO, |s, k| {
            let [a, b, c] = self.corners(*k);
            s + (a + b + c) * self.doubled_area_normal(*k).length()
        });
        let toward = |axis: DVec3, side: DVec3| if axis.dot(side) < 0.0 { -axis } else { axis };
        let (normal, v) = (toward(axes.normal, facing), toward(axes.major, center));
        let u = v.cross(normal);
        let flat = |i: u32| DVec2::new(self.points[i as usize].dot(u), self.points[i as usize].dot(v));
        let shrinks = part.iter().any(|k| {
            let n = self.doubled_area_normal(*k);
            n.dot(normal).abs() < MIN_PROJECTED_AREA * n.length()
        });
        if shrinks {
            return None;
        }
        let corners: Vec<[DVec2; 3]> = part.iter().map(|k| self.triangles[*k].map(flat)).collect();
        let uvs = part.iter().flat_map(|k| self.triangles[*k]).map(|i| (i, flat(i))).collect();
        (!any_overlap(&corners)).then(|| FlatPiece { triangles: part.to_vec(), uvs })
    }

    /// Principal axes of the second moments of the part's area.
    fn principal_axes(&self, part: &[usize]) -> PrincipalAxes {
        let area = |k: &usize| 0.5 * self.doubled_area_normal(*k).length();
        let total: f64 = part.iter().map(area).sum();
        let sum = part.iter().fold(DVec3::ZERO, |s, k| {
            let [a, b, c] = self.corners(*k);
            s + (a + b + c) * (area(k) / 3.0)
        });
        let center = sum / total.max(f64::MIN_POSITIVE);
        // Second moments of a triangle: area / 12 (sum of v v^T over its corners + s s^T), where s is the sum of its corners.
        let mut m = [[0.0; 3]; 3];
        for k in part {
            let [a, b, c] = self.corners(*k).map(|p| p - center);
            for v in [a, b, c, a + b + c] {
                let v = v.to_array();
                for (row, x) in m.iter_mut().zip(v) {
                    row.iter_mut().zip(v).for_each(|(m, y)| *m += area(k) / 12.0 * x * y);
                }
            }
        }
        symmetric_axes(m)
    }

    /// Groups of triangles that are connected by edges, in the order of their first triangles.
    fn connected_components(&self, part: &[usize]) -> Vec<Vec<usize>> {
        let mut of_edge: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
        for k in part {
            undirected_edges(self.triangles[*k]).iter().for_each(|e| of_edge.entry(*e).or_default().push(*k));
        }
        let mut left: BTreeSet<usize> = part.iter().copied().collect();
        let mut parts = Vec::new();
        while let Some(first) = left.pop_first() {
            let (mut found, mut open) = (vec![first], vec![first]);
            while let Some(k) = open.pop() {
                for near in undirected_edges(self.triangles[k]).iter().flat_map(|e| &of_edge[e]) {
                    if left.remove(near) {
                        found.push(*near);
                        open.push(*near);
                    }
                }
            }
            found.sort_unstable();
            parts.push(found);
        }
        parts
    }

    /// Halves a part: by the side of the best-fit plane that triangles face, which separates the two sides of a thick leaf; else
    /// by the middle of its length.
    fn split(&self, part: &[usize]) -> [Vec<usize>; 2] {
        let axes = self.principal_axes(part);
        let [up, down] = [false, true].map(|down| {
            let is_side = |k: &&usize| (self.doubled_area_normal(**k).dot(axes.normal) < 0.0) == down;
            part.iter().filter(is_side).copied().collect::<Vec<_>>()
        });
        if !up.is_empty() && !down.is_empty() {
            return [up, down];
        }
        let along = |k: &usize| self.corners(*k).iter().sum::<DVec3>().dot(axes.major);
        let mut sorted = part.to_vec();
        sorted.sort_by(|a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
        let second = sorted.split_off(part.len() / 2);
        [sorted, second]
    }

    /// Embedding of a part with one margin in a disk, one-to-one: its margin lies on a circle, every other vertex at the weighted mean of
    /// its neighbours. `None` if the part has no margin, several or holes.
    /// Source: Tutte 1963; weights of mean value coordinates, Floater 2003, made symmetric.
    fn embed(&self, part: &[usize]) -> Option<FlatPiece> {
        let margin = self.margin_loop(part)?;
        let weights = self.mean_value_weights(part);
        // The circle has the area of the part; the margin is placed by arc length, from the vertex nearest to the stalk at the bottom.
        let lengths: Vec<f64> = (0..margin.len())
            .map(|k| self.points[margin[k] as usize].distance(self.points[margin[(k + 1) % margin.len()] as usize]))
            .collect();
        let total: f64 = lengths.iter().sum();
        let area: f64 = part.iter().map(|k| 0.5 * self.doubled_area_normal(*k).length()).sum();
        let radius = (area / PI).sqrt();
        let mut uvs: BTreeMap<u32, DVec2> = BTreeMap::new();
        let mut walked = 0.0;
        for (i, length) in margin.iter().zip(&lengths) {
            let angle = TAU * walked / total - 0.5 * PI;
            uvs.insert(*i, radius * DVec2::new(math::cos(angle), math::sin(angle)));
            walked += length;
        }
        solve_means(&weights, &mut uvs);
        let signed: f64 = part
            .iter()
            .filter_map(|k| {
                let [a, b, c] = self.triangles[*k].map(|i| uvs.get(&i).copied());
                Some((b? - a?).perp_dot(c? - a?))
            })
            .sum();
        if signed < 0.0 {
            uvs.values_mut().for_each(|uv| uv.x = -uv.x);
        }
        let corners: Vec<[DVec2; 3]> = part.iter().map(|k| self.triangles[*k].map(|i| uvs[&i])).collect();
        (!any_overlap(&corners)).then(|| FlatPiece { triangles: part.to_vec(), uvs })
    }

    /// Vertices around a part that is a disk, beginning with the one nearest to the origin; `None` for another topology.
    fn margin_loop(&self, part: &[usize]) -> Option<Vec<u32>> {
        let mut count: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        part.iter().flat_map(|k| undirected_edges(self.triangles[*k])).for_each(|e| *count.entry(e).or_default() += 1);
        let vertices: BTreeSet<u32> = part.iter().flat_map(|k| self.triangles[*k]).collect();
        // Euler's characteristic of a disk is 1.
        if count.values().any(|n| *n > 2) || vertices.len() + part.len() != count.len() + 1 {
            return None;
        }
        let mut beside: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (a, b) in count.iter().filter(|(_, n)| **n == 1).map(|(e, _)| *e) {
            beside.entry(a).or_default().push(b);
            beside.entry(b).or_default().push(a);
        }
        if beside.values().any(|near| near.len() != 2) {
            return None;
        }
        let by_distance = |a: &&u32, b: &&u32| {
            let [a, b] = [a, b].map(|i| self.points[**i as usize].length_squared());
            a.total_cmp(&b)
        };
        let first = *beside.keys().min_by(by_distance)?;
        let (mut around, mut last, mut here) = (vec![first], first, beside[&first][0]);
        while here != first {
            around.push(here);
            let next = beside[&here].iter().copied().find(|i| *i != last)?;
            (last, here) = (here, next);
        }
        (around.len() == beside.len()).then_some(around)
    }

    /// Weight of each edge, both ways: (tan(a / 2) + tan(b / 2)) / length, with the angles on either side of it at one end, summed over
    /// both ends. Positive, which makes the embedding one-to-one.
    fn mean_value_weights(&self, part: &[usize]) -> BTreeMap<u32, BTreeMap<u32, f64>> {
        let mut weights: BTreeMap<u32, BTreeMap<u32, f64>> = BTreeMap::new();
        for k in part {
            let (t, p) = (self.triangles[*k], self.corners(*k));
            for c in 0..3 {
                let (l, r) = ((c + 1) % 3, (c + 2) % 3);
                let (e, f) = (p[l] - p[c], p[r] - p[c]);
                // tan(angle / 2) = sin / (1 + cos), of the corner's angle.
                let [e_length, f_length] = [e, f].map(|v| v.length().max(f64::MIN_POSITIVE));
                let tangent = e.cross(f).length() / (e_length * f_length + e.dot(f)).max(f64::MIN_POSITIVE);
                for (near, length) in [(t[l], e_length), (t[r], f_length)] {
                    for (a, b) in [(t[c], near), (near, t[c])] {
                        *weights.entry(a).or_default().entry(b).or_default() += tangent / length;
                    }
                }
            }
        }
        weights
    }
}

/// Edges of a triangle, each with its lower vertex first.
fn undirected_edges([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b)))
}

/// Eigenvectors of a symmetric matrix for its largest and its smallest eigenvalue, by Jacobi's rotations.
fn symmetric_axes(mut m: [[f64; 3]; 3]) -> PrincipalAxes {
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    // Eight sweeps of three rotations; convergence is quadratic, and five sweeps suffice for a matrix of this size.
    for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(3 * 8) {
        if m[p][q].abs() <= f64::MIN_POSITIVE {
            continue;
        }
        let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
        let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
        let c = 1.0 / (t * t + 1.0).sqrt();
        let s = t * c;
        for row in &mut m {
            let (a, b) = (row[p], row[q]);
            (row[p], row[q]) = (c * a - s * b, s * a + c * b);
        }
        let (a, b) = (m[p], m[q]);
        m[p] = std::array::from_fn(|k| c * a[k] - s * b[k]);
        m[q] = std::array::from_fn(|k| s * a[k] + c * b[k]);
        let (a, b) = (axes[p], axes[q]);
        (axes[p], axes[q]) = (a * c - b * s, a * s + b * c);
    }
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| m[*b][*b].total_cmp(&m[*a][*a]).then(a.cmp(b)));
    PrincipalAxes { major: axes[order[0]].normalize_or(DVec3::Y), normal: axes[order[2]].normalize_or(DVec3::Z) }
}

/// Places every vertex that has no place yet at the weighted mean of its neighbours, by conjugate gradients.
fn solve_means(weights: &BTreeMap<u32, BTreeMap<u32, f64>>, placed: &mut BTreeMap<u32, DVec2>) {
    let free: Vec<u32> = weights.keys().copied().filter(|i| !placed.contains_key(i)).collect();
    let index: BTreeMap<u32, usize> = free.iter().enumerate().map(|(k, i)| (*i, k)).collect();
    // For each row: sum of weights, neighbours without a place, and the contribution of placed neighbours to the right side.
    let diagonal: Vec<f64> = free.iter().map(|i| weights[i].values().sum()).collect();
    let near: Vec<Vec<(usize, f64)>> =
        free.iter().map(|i| weights[i].iter().filter_map(|(j, w)| Some((*index.get(j)?, *w))).collect()).collect();
    let fixed = |i: &u32| weights[i].iter().filter_map(|(j, w)| Some(*placed.get(j)? * *w)).sum::<DVec2>();
    let right: Vec<DVec2> = free.iter().map(fixed).collect();
    let apply = |x: &[DVec2]| -> Vec<DVec2> {
        let row = |k: usize| near[k].iter().fold(x[k] * diagonal[k], |s, (j, w)| s - x[*j] * *w);
        (0..x.len()).map(row).collect()
    };
    // Solve for both coordinates at once, each with its step lengths, preconditioned by the diagonal.
    let dot = |a: &[DVec2], b: &[DVec2]| a.iter().zip(b).fold(DVec2::ZERO, |s, (a, b)| s + *a * *b);
    let scaled = |r: &[DVec2]| -> Vec<DVec2> { r.iter().zip(&diagonal).map(|(r, d)| *r / *d).collect() };
    let quotient = |a: DVec2, b: DVec2| {
        DVec2::select(b.cmpgt(DVec2::ZERO), a / b.max(DVec2::splat(f64::MIN_POSITIVE)), DVec2::ZERO)
    };
    let mut x = vec![DVec2::ZERO; free.len()];
    let mut residual = right;
    let mut z = scaled(&residual);
    let mut direction = z.clone();
    let mut rz = dot(&residual, &z);
    let enough = rz * (EMBED_TOLERANCE * EMBED_TOLERANCE);
    for _ in 0..EMBED_ROUNDS {
        if rz.cmple(enough).all() {
            break;
        }
        let image = apply(&direction);
        let step = quotient(rz, dot(&direction, &image));
        for (k, (direction, image)) in direction.iter().zip(&image).enumerate() {
            x[k] += step * *direction;
            residual[k] -= step * *image;
        }
        z = scaled(&residual);
        let next = dot(&residual, &z);
        let keep = quotient(next, rz);
        direction.iter_mut().zip(&z).for_each(|(d, z)| *d = *z + keep * *d);
        rz = next;
    }
    placed.extend(free.into_iter().zip(x));
}

/// Moves pieces into the unit square, with gaps around them: a single piece is stretched over all of it; several keep their
/// proportions and are arranged in rows.
pub(super) fn pack(pieces: &mut [FlatPiece]) {
    let bounds = |piece: &FlatPiece| {
        let all = || piece.uvs.values();
        let low = all().fold(DVec2::INFINITY, |m, p| m.min(*p));
        (low, all().fold(DVec2::NEG_INFINITY, |m, p| m.max(*p)) - low)
    };
    if let [piece] = pieces {
        let (low, size) = bounds(piece);
        let scale = DVec2::splat(1.0 - 2.0 * CHART_GAP) / size.max(DVec2::splat(f64::MIN_POSITIVE));
        piece.uvs.values_mut().for_each(|uv| *uv = CHART_GAP + (*uv - low) * scale);
        return;
    }
    let boxes: Vec<(DVec2, DVec2)> = pieces.iter().map(bounds).collect();
    // The highest pieces first, so that rows are well filled.
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by(|a, b| boxes[*b].1.y.total_cmp(&boxes[*a].1.y).then(a.cmp(b)));
    // Rows within a square, from the bottom; `None` if they do not fit.
    let rows = |side: f64| {
        let gap = CHART_GAP * side / (pieces.len() as f64).sqrt();
        let (mut at, mut row_height) = (DVec2::splat(gap), 0.0_f64);
        let mut corners = vec![DVec2::ZERO; boxes.len()];
        for k in &order {
            let size = boxes[*k].1;
            if at.x + size.x + gap > side {
                at = DVec2::new(gap, at.y + row_height + gap);
                row_height = 0.0;
            }
            if at.x + size.x + gap > side || at.y + size.y + gap > side {
                return None;
            }
            corners[*k] = at;
            at.x += size.x + gap;
            row_height = row_height.max(size.y);
        }
        Some(corners)
    };
    let mut side = boxes.iter().map(|b| b.1.x * b.1.y).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    // Enlarge the square until the pieces fit, at the latest when it is as wide as all of them side by side.
    let corners = loop {
        match rows(side) {
            Some(corners) => break corners,
            None => side *= 1.05,
        }
    };
    for ((piece, (low, _)), corner) in pieces.iter_mut().zip(boxes).zip(corners) {
        piece.uvs.values_mut().for_each(|uv| *uv = (*uv - low + corner) / side);
    }
}
