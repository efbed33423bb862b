//! An artist's mesh as terrain: its highest surface along vertical lines.

use std::sync::Arc;

use glam::Vec3;

use super::Terrain;
use osier_base::par::par_map;
use osier_base::{Error, Result};

/// Triangles with a smaller vertical component of their unit normal are walls, which a vertical line meets at edges at most.
const LEAST_RISE: f32 = 1e-6;
/// Vertical distance from which two surfaces at one (x, z) count as separate, m. Own: above the rounding of coordinates of 1 km.
const LEAST_GAP: f32 = 1e-2;
/// Margin of the barycentric coordinates within which a point counts as inside, so that neighbours leave no gap between
/// them; for the index, margin as a share of the extent of the mesh.
const EDGE_MARGIN: f32 = 1e-5;
/// Triangles of the mesh for each cell of the index. Own: short lists are scanned faster than a finer index is read.
const TRIANGLES_PER_CELL: usize = 2;
/// Most cells along a side of the index.
const MAX_INDEX_SIDE: usize = 2048;

/// Where a vertical line meets the highest surface of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceHit {
    /// Height of the surface above y = 0, m.
    pub height: f32,
    /// Unit normal of the triangle, upwards.
    pub normal: Vec3,
}

/// Triangles with an index: for each cell of a grid over x and z, those that overlap it.
#[derive(Debug, Clone, PartialEq)]
pub struct TerrainSurface {
    triangles: Vec<[Vec3; 3]>,
    /// Smallest x and z, m.
    low: [f32; 2],
    /// Largest x and z, m.
    high: [f32; 2],
    /// Cells along x and along z.
    cells: [usize; 2],
    /// First entry of each cell in `entries`, and their number at the end.
    starts: Vec<u32>,
    /// Indices of triangles, cell by cell.
    entries: Vec<u32>,
}

impl TerrainSurface {
    /// Indexes a mesh in world space, m; `None` for one without a triangle that a vertical line can meet.
    pub fn new(points: &[Vec3], triangles: &[[u32; 3]]) -> Option<Self> {
        // Walls are left out: a vertical line meets their upper edges in the triangles beside them.
        let corner = |i: u32| points.get(i as usize).copied();
        let all: Vec<[Vec3; 3]> = triangles
            .iter()
            .filter_map(|&[a, b, c]| Some([corner(a)?, corner(b)?, corner(c)?]))
            .filter(|[a, b, c]| (*b - *a).cross(*c - *a).normalize_or_zero().y.abs() > LEAST_RISE)
            .collect();
        let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
        for p in all.iter().flatten() {
            for (axis, v) in [p.x, p.z].into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(v), high[axis].max(v));
            }
        }
        if all.is_empty() {
            return None;
        }
        let mut surface = Self {
            cells: index_cells(all.len(), low, high),
            triangles: all,
            low,
            high,
            starts: Vec::new(),
            entries: Vec::new(),
        };
        // Count the triangles of each cell, then enter them in their order.
        let [across, along] = surface.cells;
        let cells_of = |t: &[Vec3; 3]| {
            let [x, z] = surface.span(t);
            (z[0]..=z[1]).flat_map(move |j| (x[0]..=x[1]).map(move |i| j * across + i))
        };
        let mut counts = vec![0_u32; across * along + 1];
        surface.triangles.iter().flat_map(cells_of).for_each(|cell| counts[cell + 1] += 1);
        for k in 1..counts.len() {
            counts[k] += counts[k - 1];
        }
        let mut next = counts.clone();
        let mut entries = vec![0_u32; counts.last().copied().unwrap_or(0) as usize];
        for (i, t) in (0_u32..).zip(&surface.triangles) {
            for cell in cells_of(t) {
                entries[next[cell] as usize] = i;
                next[cell] += 1;
            }
        }
        (surface.starts, surface.entries) = (counts, entries);
        Some(surface)
    }

    /// Lengths of the triangles' bounding rectangle along x and along z, m; walls are not counted.
    pub fn size(&self) -> [f32; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    /// Heights of the corners of its triangles, m.
    pub(super) fn corner_heights(&self) -> impl Iterator<Item = f32> {
        self.triangles.iter().flatten().map(|p| p.y)
    }

    /// Height and normal of the highest triangle above or below (x, z), m; `None` over a hole or beyond the edge.
    pub fn highest_at(&self, x: f32, z: f32) -> Option<SurfaceHit> {
        let (mut best, mut of) = (f32::NEG_INFINITY, None);
        self.for_each_hit(x, z, |height, t| {
            if height > best {
                (best, of) = (height, Some(t));
            }
        });
        let [a, b, c] = of?;
        let normal = (*b - *a).cross(*c - *a).normalize_or_zero();
        Some(SurfaceHit { height: best, normal: if normal.y < 0.0 { -normal } else { normal } })
    }

    /// True if surfaces lie above each other at (x, z), by more than [`LEAST_GAP`].
    fn is_folded_at(&self, x: f32, z: f32) -> bool {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        self.for_each_hit(x, z, |height, _| (low, high) = (low.min(height), high.max(height)));
        high - low > LEAST_GAP
    }

    fn for_each_hit<'a>(&'a self, x: f32, z: f32, mut act: impl FnMut(f32, &'a [Vec3; 3])) {
        let inside = x >= self.low[0] && x <= self.high[0] && z >= self.low[1] && z <= self.high[1];
        if !inside {
            return;
        }
        let cell = self.cell(1, z) * self.cells[0] + self.cell(0, x);
        let of = |k: usize| self.starts.get(k).map_or(0, |v| *v as usize);
        for i in &self.entries[of(cell)..of(cell + 1)] {
            let Some(t) = self.triangles.get(*i as usize) else { continue };
            let [a, b, c] = t;
            // Barycentric coordinates in the plane of x and z, in double precision for large coordinates.
            let wide = |p: &Vec3| [f64::from(p.x) - f64::from(x), f64::from(p.z) - f64::from(z)];
            let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
            let [pa, pb, pc] = [wide(a), wide(b), wide(c)];
            let weights = [cross(pb, pc), cross(pc, pa), cross(pa, pb)];
            let area: f64 = weights.iter().sum();
            let weights = weights.map(|w| w / area);
            if weights.iter().all(|w| *w >= -f64::from(EDGE_MARGIN)) {
                let height = weights.iter().zip(t).map(|(w, p)| w * f64::from(p.y)).sum::<f64>();
                act(osier_base::math::narrow(height), t);
            }
        }
    }

    /// First and last cell that a triangle touches along both axes.
    fn span(&self, t: &[Vec3; 3]) -> [[usize; 2]; 2] {
        [0, 1].map(|axis| {
            let v = t.map(|p| if axis == 0 { p.x } else { p.z });
            let (low, high) = (v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2]));
            // A margin, for points that rounding moves over the border of a cell.
            let margin = EDGE_MARGIN * (self.high[axis] - self.low[axis]);
            [self.cell(axis, low - margin), self.cell(axis, high + margin)]
        })
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    fn cell(&self, axis: usize, v: f32) -> usize {
        let count = self.cells[axis];
        let share = (v - self.low[axis]) / (self.high[axis] - self.low[axis]).max(f32::MIN_POSITIVE);
        ((share.clamp(0.0, 1.0) * count as f32) as usize).min(count - 1)
    }
}

/// Numbers of about square cells of the index along x and along z, at most [`MAX_INDEX_SIDE`] each.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells of an index")]
fn index_cells(triangles: usize, low: [f32; 2], high: [f32; 2]) -> [usize; 2] {
    let size = [0, 1].map(|axis| (high[axis] - low[axis]).max(1e-3));
    let wanted = (triangles / TRIANGLES_PER_CELL).max(1) as f32;
    let edge = (size[0] * size[1] / wanted).sqrt();
    size.map(|length| ((length / edge).ceil() as usize).clamp(1, MAX_INDEX_SIDE))
}

/// Terrain of a mesh, and the faults that its sampling found, for warnings.
#[derive(Debug)]
pub struct MeshTerrain {
    /// The highest surface of the mesh, sampled as heights.
    pub land: Terrain,
    /// Samples over a hole or beyond the edge of the mesh; their heights follow from their neighbours.
    pub holes: usize,
    /// Samples at which surfaces lie above each other; the highest one counts.
    pub folded: usize,
}

impl Terrain {
    /// Terrain of an artist's mesh. Heights and normals are those of its highest surface; `cells` square cells along the longer
    /// side sample it for functions that need a grid. Samples over a hole are filled from its rim inwards with the mean
    /// of their neighbours.
    /// # Errors
    /// `Range` for a mesh without a length along x or z.
    pub fn from_mesh(surface: TerrainSurface, cells: usize) -> Result<MeshTerrain> {
        let size = surface.size();
        let longest = size[0].max(size[1]);
        if size[0] <= 0.0 || size[1] <= 0.0 {
            let (name, value) = ("terrain: width of the mesh".to_owned(), f64::from(size[0].min(size[1])));
            return Err(Error::Range { name, value, min: 1e-3, max: 1e6, unit: "m" });
        }
        // Square cells that cover the mesh; the shorter side is extended to a whole number of them.
        let step = longest / cells.max(1) as f32;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most `cells`")]
        let counts = size.map(|length| ((length / step - 1e-3).ceil().max(1.0) as usize).min(cells.max(1)) + 1);
        let size = counts.map(|n| step * (n - 1) as f32);
        let center = [0, 1].map(|axis| 0.5 * (surface.low[axis] + surface.high[axis]));
        let mut land = Self { counts, size, center, stride: 1, tileable: false, heights: Vec::new(), surface: None };
        let rows: Vec<usize> = (0..counts[1]).collect();
        let sampled = par_map(&rows, |&j| {
            let z = land.coordinate(1, j).clamp(surface.low[1], surface.high[1]);
            let one = |i: usize| {
                let x = land.coordinate(0, i).clamp(surface.low[0], surface.high[0]);
                (surface.highest_at(x, z).map(|hit| hit.height), surface.is_folded_at(x, z))
            };
            (0..counts[0]).map(one).collect::<Vec<_>>()
        });
        let sampled: Vec<_> = sampled.into_iter().flatten().collect();
        let heights: Vec<Option<f32>> = sampled.iter().map(|s| s.0).collect();
        let holes = heights.iter().filter(|h| h.is_none()).count();
        let folded = sampled.iter().filter(|s| s.1).count();
        land.heights = filled(heights, counts);
        land.surface = Some(Arc::new(surface));
        Ok(MeshTerrain { land, holes, folded })
    }
}

/// Heights without gaps: ring by ring, each empty sample next to filled ones takes their mean.
fn filled(mut heights: Vec<Option<f32>>, [columns, rows]: [usize; 2]) -> Vec<f32> {
    let mut empty: Vec<usize> = (0..heights.len()).filter(|i| heights[*i].is_none()).collect();
    while !empty.is_empty() && empty.len() < heights.len() {
        let ring: Vec<(usize, f32)> = empty
            .iter()
            .filter_map(|&i| {
                let (x, z) = (i % columns, i / columns);
                let beside = [
                    (x > 0).then(|| i - 1),
                    (x + 1 < columns).then(|| i + 1),
                    (z > 0).then(|| i - columns),
                    (z + 1 < rows).then(|| i + columns),
                ];
                let known = beside.into_iter().flatten().filter_map(|k| heights[k]);
                let (sum, count) = known.fold((0.0, 0_u8), |(s, n), h| (s + h, n + 1));
                (count > 0).then(|| (i, sum / f32::from(count)))
            })
            .collect();
        ring.iter().for_each(|(i, h)| heights[*i] = Some(*h));
        empty.retain(|i| heights[*i].is_none());
    }
    heights.into_iter().map(|h| h.unwrap_or(0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp of 20 x 10 m, y = x / 4 + 1, around (5, 0), with a hole of one cell, and a slab that hangs over it.
    fn ramp(with_slab: bool) -> TerrainSurface {
        let point = |i: u16, j: u16| {
            let (x, z) = (f32::from(i) - 5.0, f32::from(j) - 5.0);
            Vec3::new(x, x / 4.0 + 1.0, z)
        };
        let mut points: Vec<Vec3> = (0..11).flat_map(|j| (0..21).map(move |i| point(i, j))).collect();
        let mut triangles = Vec::new();
        for j in 0..10_u32 {
            for i in (0..20_u32).filter(|i| (*i, j) != (3, 7)) {
                let a = j * 21 + i;
                triangles.extend([[a, a + 21, a + 1], [a + 1, a + 21, a + 22]]);
            }
        }
        if with_slab {
            let first = u32::try_from(points.len()).expect("few");
            points.extend([[8.0, -2.0], [10.0, -2.0], [10.0, 2.0], [8.0, 2.0]].map(|[x, z]| Vec3::new(x, 9.0, z)));
            // Wound downwards: its normal is turned up.
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        TerrainSurface::new(&points, &triangles).expect("triangles")
    }

    #[test]
    fn the_highest_surface_counts() {
        let made = Terrain::from_mesh(ramp(true), 40).expect("land");
        let land = made.land;
        assert_eq!((land.counts, land.size, land.center), ([41, 21], [20.0, 10.0], [5.0, 0.0]));
        for (x, z, h) in [(-5.0, -5.0, -0.25), (15.0, 5.0, 4.75), (3.3, 1.7, 1.825), (9.0, 0.3, 9.0), (7.9, 0.3, 2.975)]
        {
            assert!((land.height_at(x, z) - h).abs() < 1e-5, "{x} {z}: {}", land.height_at(x, z));
        }
        assert!((land.normal_at(3.3, 1.7) - Vec3::new(-0.25, 1.0, 0.0).normalize()).length() < 1e-5);
        assert!((land.normal_at(9.0, 0.3) - Vec3::Y).length() < 1e-6);
        // The slab covers 5 x 9 samples with its edges; 0.5 m between samples leaves one inside the hole.
        assert!((32..=45).contains(&made.folded) && made.holes == 1, "{} {}", made.folded, made.holes);
        assert!(!land.covers(-1.5, 2.5) && land.covers(-2.5, 2.5) && !land.covers(15.1, 0.0));
        assert!((land.height_at(-1.5, 2.5) - 0.625).abs() < 1e-4, "a hole is filled from its border");
        assert_eq!(land.range().map(f32::to_bits), [-0.25_f32, 9.0].map(f32::to_bits));
        assert_eq!(Terrain::from_mesh(ramp(false), 40).expect("land").folded, 0);
    }

    #[test]
    fn a_mesh_that_no_vertical_line_meets_is_none() {
        let wall = [Vec3::ZERO, Vec3::X, Vec3::Y];
        assert!(TerrainSurface::new(&wall, &[[0, 1, 2]]).is_none());
        assert!(TerrainSurface::new(&wall, &[]).is_none());
    }
}
