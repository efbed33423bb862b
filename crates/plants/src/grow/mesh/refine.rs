//! Subdivides the surface of a piece of wood: clusters are sets of vertices, and long triangles have none where the axis needs
//! them.

use glam::Vec3;

use super::parts::{WoodPiece, index};
use super::thickness;
use osier_base::math;
use osier_base::par::LookupMap;

/// Longest edge, in sizes of a cluster; finer edges give smoother centrelines and cost time in proportion to the square.
const MAX_EDGE: f32 = 0.25;
/// Most points of a piece; beyond it edges stay long, and the skeleton becomes coarser.
const MAX_POINTS: usize = 2_000_000;

/// Surface of a piece of wood, subdivided for clustering; the points of the piece come first.
#[derive(Debug)]
pub(super) struct RefinedSurface {
    pub points: Vec<Vec3>,
    /// Unit normals, outwards.
    pub normals: Vec<Vec3>,
    /// Radius of the wood below, m.
    pub radii: Vec<f32>,
    /// Size of a cluster here, m.
    pub sizes: Vec<f32>,
    /// Area that each point stands for, m^2: a third of the triangles around it.
    pub areas: Vec<f64>,
    /// Neighbours of point `i`: `neighbour_list[first_neighbour[i]..first_neighbour[i + 1]]`.
    first_neighbour: Vec<u32>,
    neighbour_list: Vec<u32>,
}

/// How the size of clusters follows from the radius of the wood.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClusterSizes {
    /// Size everywhere, m; `None`: [`CLUSTER_RADII`] times the radius.
    pub fixed: Option<f32>,
    /// Least size where it follows the radius, m.
    pub least: f32,
}

/// Length of a cluster along the wood, in radii. Smaller clusters break rings into patches, larger ones miss bends.
const CLUSTER_RADII: f32 = 3.0;

impl ClusterSizes {
    fn at(&self, radius: f32) -> f32 {
        self.fixed.unwrap_or((CLUSTER_RADII * radius).max(self.least))
    }
}

impl RefinedSurface {
    /// Measures the radius at each point of a piece, and divides edges longer than a quarter of a cluster.
    pub fn new(piece: &WoodPiece, sizes: ClusterSizes) -> Self {
        let mut normals = thickness::normals(piece);
        let mut radii = thickness::radii(piece, &normals);
        let mut points = piece.points.clone();
        let mut triangles = piece.triangles.clone();
        let mut cuts: LookupMap<[u32; 2], EdgeSplit> = LookupMap::default();
        // Position, normal and radius are linear along a divided edge. Each edge is divided once, whichever of its triangles
        // comes first, so that the surface stays closed.
        for e in triangles.iter().flat_map(|t| edges(*t)) {
            if cuts.get(&e).is_some() {
                continue;
            }
            let [a, b] = e.map(|i| i as usize);
            let longest = MAX_EDGE * sizes.at(radii[a].min(radii[b]));
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 4096")]
            let parts = (points[a].distance(points[b]) / longest).ceil().clamp(1.0, 4096.0) as u16;
            let fits = points.len() + usize::from(parts) < MAX_POINTS;
            let cut = EdgeSplit { first: index(points.len()), count: if fits { parts - 1 } else { 0 } };
            for k in 1..=cut.count {
                let t = f32::from(k) / f32::from(parts);
                points.push(points[a].lerp(points[b], t));
                normals.push(math::normalize_or(normals[a].lerp(normals[b], t), normals[a]));
                radii.push(math::lerp(radii[a], radii[b], t));
            }
            cuts.insert(e, cut);
        }
        // Each triangle with points on its edges is divided by them.
        triangles = triangles.iter().flat_map(|t| strip(*t, &cuts)).collect();
        let sizes = radii.iter().map(|r| sizes.at(*r)).collect();
        let (first_neighbour, neighbour_list) = adjacency(points.len(), &triangles);
        // Lumped areas: a third of each triangle at each of its corners (|cross| / 6).
        let mut areas = vec![0.0; points.len()];
        for t in &triangles {
            let [a, b, c] = t.map(|i| points[i as usize].as_dvec3());
            let third = (b - a).cross(c - a).length() / 6.0;
            t.iter().for_each(|i| areas[*i as usize] += third);
        }
        Self { points, normals, radii, sizes, areas, first_neighbour, neighbour_list }
    }

    /// Points that share an edge with point `i`.
    pub fn neighbours(&self, i: u32) -> &[u32] {
        let first = &self.first_neighbour;
        &self.neighbour_list[first[i as usize] as usize..first[i as usize + 1] as usize]
    }

    /// Number of clusters that fit: the length of the wood divided by that of a cluster, as the integral of dA / (2 pi
    /// r size) over the surface.
    pub fn estimated_clusters(&self) -> f64 {
        let one = |i: usize| self.areas[i] / (std::f64::consts::TAU * f64::from(self.radii[i] * self.sizes[i]));
        (0..self.points.len()).fold(0.0, |sum, i| sum + one(i))
    }
}

/// The edges of a triangle, each from its lower index to its higher one.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
}

/// Points that divide an edge: consecutive indices from its end of lower index to the other.
#[derive(Debug, Clone, Copy)]
struct EdgeSplit {
    first: u32,
    count: u16,
}

/// All points of a divided edge from `a` to `b`, both included.
fn chain(a: u32, b: u32, cuts: &LookupMap<[u32; 2], EdgeSplit>) -> Vec<u32> {
    let between = cuts.get(&[a.min(b), a.max(b)]).map_or(0..0, |c| c.first..c.first + u32::from(c.count));
    let mut all = vec![a.min(b)];
    all.extend(between);
    all.push(a.max(b));
    if a > b {
        all.reverse();
    }
    all
}

/// Divides a triangle whose edges hold points into a strip between the two edges that hold most. No points are added inside, so
/// that needle-shaped triangles are divided no more than their edges require.
fn strip(t: [u32; 3], cuts: &LookupMap<[u32; 2], EdgeSplit>) -> Vec<[u32; 3]> {
    let chains = [0, 1, 2].map(|k| chain(t[k], t[(k + 1) % 3], cuts));
    // The strip begins at the corner opposite to the edge that holds fewest points.
    let base = (0..3).min_by_key(|k| chains[*k].len()).unwrap_or(0);
    let (foot, p) = (&chains[base], &chains[(base + 2) % 3]);
    let mut q = chains[(base + 1) % 3].clone();
    q.reverse();
    // Both sides begin at the apex: `p` leads to the first point of the foot, `q` to its last.
    let mut out = Vec::with_capacity(p.len() + q.len() + foot.len());
    let (mut i, mut j) = (0, 0);
    let (np, nq) = (p.len() - 1, q.len() - 1);
    // Advance along both sides at equal shares of their length, so that the triangles of the strip are no slimmer
    // than needed.
    while i < np || j < nq {
        let last = i + j + 1 == np + nq;
        // Compare (i + 1) / np with (j + 1) / nq: the side that lags behind advances.
        let on_p = j == nq || i < np && (i + 1) * nq <= (j + 1) * np;
        if i == 0 && j == 0 {
            (i, j) = (1, 1);
            if np == 1 && nq == 1 {
                out.extend(foot.windows(2).map(|w| [p[0], w[0], w[1]]));
            } else {
                out.push([p[0], p[1], q[1]]);
            }
            continue;
        }
        match (last, on_p) {
            (true, _) => {
                // The last step fans out to the points of the foot.
                let from = if on_p { p[i] } else { q[j] };
                out.extend(foot.windows(2).map(|w| [from, w[0], w[1]]));
            }
            (false, true) => out.push([p[i], p[i + 1], q[j]]),
            (false, false) => out.push([p[i], q[j + 1], q[j]]),
        }
        if on_p { i += 1 } else { j += 1 }
    }
    out
}

/// Vertices that share an edge with each vertex, as compressed rows: first index of each row, and all rows.
fn adjacency(n: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut links: Vec<[u32; 2]> = triangles.iter().flat_map(|t| edges(*t)).collect();
    links.sort_unstable();
    links.dedup();
    // Compressed sparse rows by a counting sort: count, running sum, fill.
    let mut first = vec![0_u32; n + 1];
    links.iter().flatten().for_each(|i| first[*i as usize + 1] += 1);
    for i in 0..n {
        first[i + 1] += first[i];
    }
    let mut next = first.clone();
    let mut around = vec![0; links.len() * 2];
    for [a, b] in links {
        for (from, to) in [(a, b), (b, a)] {
            around[next[from as usize] as usize] = to;
            next[from as usize] += 1;
        }
    }
    (first, around)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_triangle_keeps_its_outline_and_its_side() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for counts in (0..64).map(|k| [k & 3, k >> 2 & 3, k >> 4]) {
            let mut points = corners.to_vec();
            let mut cuts = LookupMap::default();
            for (e, count) in edges([0, 1, 2]).into_iter().zip(counts) {
                cuts.insert(e, EdgeSplit { first: u32::try_from(points.len()).expect("small"), count });
                let [a, b] = e.map(|i| corners[i as usize]);
                points.extend((1..=count).map(|k| a.lerp(b, f32::from(k) / f32::from(count + 1))));
            }
            for turned in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
                let parts = strip(turned, &cuts);
                let area = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(|i| points[i as usize]);
                    (b - a).cross(c - a).z
                };
                assert!(parts.iter().all(|t| area(t) > 1e-6), "{counts:?}: {parts:?}");
                assert!((parts.iter().map(area).sum::<f32>() - 1.0).abs() < 1e-5, "{counts:?}");
                assert_eq!(parts.len(), 1 + usize::from(counts.iter().sum::<u16>()), "{counts:?}");
            }
        }
    }
}
