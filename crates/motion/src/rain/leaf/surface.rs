//! The blade of a leaf as a parametric surface p(u, v) that drops move over, with its margin.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3, Vec3};

use super::{GRID_CELLS, grid_cell};
use crate::rain::leaf::alpha_mask::AlphaMask;
use crate::rain::leaf::chart::{BladeChart, LeafChart};
use crate::rain::leaf::veins::VeinMap;
use crate::rain::tuning::MIN_UV_AREA;
use osier_scene::Mesh;

/// How far outside of a triangle its barycentric coordinates may lie, so that rounding leaves no gap between neighbours.
const BARYCENTRIC_TOLERANCE: f64 = 1e-9;

/// A point of the blade with its tangent frame, in leaf space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Position in leaf space, m.
    pub p: DVec3,
    /// Unit normal of the upper side, interpolated from the vertices.
    pub n: DVec3,
    /// Partial derivative of the position with respect to u, m.
    pub dpdu: DVec3,
    /// Partial derivative of the position with respect to v, m.
    pub dpdv: DVec3,
}

/// Coefficients E, F and G of the first fundamental form of a surface, m^2: squared lengths on it are E du^2 + 2 F du dv + G dv^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstFundamentalForm {
    /// E, the squared length of dp/du.
    pub e: f64,
    /// F, the dot product of dp/du and dp/dv.
    pub f: f64,
    /// G, the squared length of dp/dv.
    pub g: f64,
}

impl FirstFundamentalForm {
    /// The form of a surface with these partial derivatives, m.
    pub fn new(dpdu: DVec3, dpdv: DVec3) -> Self {
        Self { e: dpdu.dot(dpdu), f: dpdu.dot(dpdv), g: dpdv.dot(dpdv) }
    }

    /// E G - F^2, m^4: the square of the area on the surface of the unit square of texture coordinates.
    pub fn determinant(&self) -> f64 {
        self.e * self.g - self.f * self.f
    }
}

impl SurfacePoint {
    /// Change of the texture coordinates for a displacement `d` along the surface, m: the least-squares solution
    /// (J^T J)^-1 J^T d with J = (dp/du, dp/dv).
    pub fn uv_offset(&self, d: DVec3) -> DVec2 {
        let form = FirstFundamentalForm::new(self.dpdu, self.dpdv);
        let (x, y) = (self.dpdu.dot(d), self.dpdv.dot(d));
        DVec2::new(form.g * x - form.f * y, form.e * y - form.f * x) / form.determinant().max(f64::MIN_POSITIVE)
    }

    /// Largest change of each texture coordinate per metre along the surface, 1/m: half the sides of the box around the ellipse
    /// that a circle of radius 1 m becomes.
    pub fn max_uv_rate(&self) -> DVec2 {
        let form = FirstFundamentalForm::new(self.dpdu, self.dpdv);
        let det = form.determinant().max(f64::MIN_POSITIVE);
        DVec2::new((form.g / det).max(0.0).sqrt(), (form.e / det).max(0.0).sqrt())
    }
}

/// A point of the blade's margin, in leaf space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarginPoint {
    /// Position in leaf space, m.
    pub p: DVec3,
    /// Distance, m, from the point for which it was searched.
    pub distance: f64,
    /// Unit tangent of the margin, in the winding of the blade's triangles.
    pub tangent: DVec3,
    /// Index of the margin edge that it lies on.
    pub edge: usize,
    /// Fraction of that edge's length at which it lies, 0 to 1.
    pub fraction: f64,
}

/// The blade of a leaf at scale 1; leaves that share it scale it by a factor.
#[derive(Debug, Clone)]
pub struct LeafSurface {
    points: Vec<DVec3>,
    normals: Vec<DVec3>,
    /// Coordinates in the chart: the texture coordinates of the mesh, or those of `chart`.
    uvs: Vec<DVec2>,
    /// Coordinates in the textures of the mesh's material; `None` if they are those of the chart.
    texture_uvs: Option<Vec<DVec2>>,
    chart: Option<LeafChart>,
    triangles: Vec<[u32; 3]>,
    /// dp/du and dp/dv of each triangle, m; constant over it.
    partials: Vec<[DVec3; 2]>,
    /// The triangles as the search by chart coordinates needs them.
    chart_triangles: Vec<ChartTriangle>,
    /// Triangles that overlap each cell of the grid over texture coordinates, row by row.
    cells: Vec<Vec<usize>>,
    margin: LeafMargin,
    /// Area of the blade, m^2.
    area: f64,
    /// The point of the margin farthest from the origin, where the stalk ends, m.
    tip: DVec3,
    alpha_mask: Option<AlphaMask>,
    veins: Option<VeinMap>,
}

impl LeafSurface {
    /// The blade of a mesh; `None` if none of its triangles has an area. Drops are placed by the texture coordinates of the mesh
    /// if they are one-to-one, else by a computed [chart](LeafSurface::chart). Petioles, whose triangles have no area in the
    /// texture, are left out.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let BladeChart { blade, own: chart } = BladeChart::new(mesh)?;
        let vertex = |list: &[Vec3]| match &chart {
            Some(chart) => chart.vertices.iter().map(|i| list[*i as usize].as_dvec3()).collect(),
            None => list.iter().map(|p| p.as_dvec3()).collect::<Vec<_>>(),
        };
        let (points, normals) = (vertex(&mesh.points), vertex(&mesh.normals));
        let own_uvs = || mesh.uvs.iter().map(|p| p.as_dvec2()).collect::<Vec<_>>();
        let uvs = chart.as_ref().map_or_else(own_uvs, |chart| chart.uvs.clone());
        let mut triangles = Vec::new();
        let mut pieces = Vec::new();
        let mut partials = Vec::new();
        let mut area = 0.0;
        for (k, piece) in blade.indices.iter().zip(&blade.pieces) {
            // Over a triangle p is linear in (u, v): solve (e, f) = (dp/du, dp/dv) [uv1 uv2] for the partial derivatives, where
            // e and f are its edges in space, uv1 and uv2 in the texture.
            let t = chart.as_ref().map_or(mesh.triangles[*k], |chart| chart.triangles[*k]);
            let [a, b, c] = t.map(|i| i as usize);
            let (uv1, uv2) = (uvs[b] - uvs[a], uvs[c] - uvs[a]);
            let det = uv1.x * uv2.y - uv1.y * uv2.x;
            if det.abs() < MIN_UV_AREA {
                continue;
            }
            let (e, f) = (points[b] - points[a], points[c] - points[a]);
            partials.push([(e * uv2.y - f * uv1.y) / det, (f * uv1.x - e * uv2.x) / det]);
            triangles.push(t);
            pieces.push(*piece);
            area += 0.5 * e.cross(f).length();
        }
        let margin = LeafMargin::new(&triangles, &pieces, &points);
        // Leaf space has its origin at the end of the stalk: the tip is the margin's farthest vertex.
        let starts = margin.edges.iter().map(|e| points[e[0] as usize]);
        let tip = starts.max_by(|a, b| a.length().total_cmp(&b.length()))?;
        let chart_triangles = triangles.iter().map(|t| ChartTriangle::new(t.map(|k| uvs[k as usize]))).collect();
        let cells = triangles_by_cell(&triangles, &uvs);
        let has_textures = chart.is_some() && mesh.uvs.len() == mesh.points.len();
        let texture_uvs = chart
            .as_ref()
            .filter(|_| has_textures)
            .map(|chart| chart.vertices.iter().map(|i| mesh.uvs[*i as usize].as_dvec2()).collect());
        let (alpha_mask, veins) = (None, None);
        Some(Self {
            points,
            normals,
            uvs,
            texture_uvs,
            chart,
            triangles,
            partials,
            chart_triangles,
            cells,
            margin,
            area,
            tip,
            alpha_mask,
            veins,
        })
    }

    /// The computed chart of the blade; `None` if the texture coordinates of its mesh are one-to-one.
    pub fn chart(&self) -> Option<&LeafChart> {
        self.chart.as_ref()
    }

    /// Length on the blade that one side of the square of chart coordinates spans at scale 1, m: the larger of the means of |dp/du| and
    /// |dp/dv| over the chart.
    pub fn metres_per_chart_side(&self) -> f64 {
        let (mut along, mut total) = ([0.0; 2], 0.0);
        for (t, [dpdu, dpdv]) in self.triangles.iter().zip(&self.partials) {
            let [a, b, c] = t.map(|i| self.uvs[i as usize]);
            let area = 0.5 * (b - a).perp_dot(c - a).abs();
            along = [along[0] + area * dpdu.length(), along[1] + area * dpdv.length()];
            total += area;
        }
        along[0].max(along[1]) / total.max(f64::MIN_POSITIVE)
    }

    /// Side of a picture over the chart divided by the side of a picture over the texture coordinates of the mesh that has the
    /// same resolution on the blade; 1 for a blade without a computed chart.
    pub fn chart_to_texture_side_ratio(&self) -> f64 {
        let Some(texture_uvs) = &self.texture_uvs else { return 1.0 };
        let area = |uvs: &[DVec2]| {
            let of = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| uvs[i as usize]);
                (b - a).perp_dot(c - a).abs()
            };
            self.triangles.iter().map(of).sum::<f64>()
        };
        (area(texture_uvs) / area(&self.uvs).max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Coordinates in the textures of the mesh's material for chart coordinates; `None` beyond the blade. Both are the same for a
    /// blade without a computed chart.
    pub fn texture_uv(&self, uv: DVec2) -> Option<DVec2> {
        let Some(texture_uvs) = &self.texture_uvs else { return Some(uv) };
        let (i, weights) = self.locate(uv)?;
        Some(self.triangles[i].iter().zip(weights).fold(DVec2::ZERO, |s, (k, w)| s + texture_uvs[*k as usize] * w))
    }

    /// dp/du and dp/dv, m, of the material's textures and of the chart at a point of the chart; `None` beyond the blade, where
    /// the textures have no area, and for a blade without a computed chart.
    pub fn texture_and_chart_partials(&self, uv: DVec2) -> Option<[[DVec3; 2]; 2]> {
        let (i, _) = self.locate(uv)?;
        let [a, b, c] = self.triangles[i].map(|k| k as usize);
        let texture_uvs = self.texture_uvs.as_ref()?;
        let (uv1, uv2) = (texture_uvs[b] - texture_uvs[a], texture_uvs[c] - texture_uvs[a]);
        let det = uv1.perp_dot(uv2);
        let (e, f) = (self.points[b] - self.points[a], self.points[c] - self.points[a]);
        let of_texture = [(e * uv2.y - f * uv1.y) / det, (f * uv1.x - e * uv2.x) / det];
        (det.abs() >= MIN_UV_AREA).then_some([of_texture, self.partials[i]])
    }

    /// The blade with holes and with veins that lead drops; `None` for neither.
    pub fn with_maps(self, alpha_mask: Option<AlphaMask>, veins: Option<VeinMap>) -> Self {
        Self { alpha_mask, veins, ..self }
    }

    /// Depth of the vein at texture coordinates, 0 to 1; 0 without a vein map.
    pub fn vein_depth(&self, uv: DVec2) -> f64 {
        let Some(veins) = &self.veins else { return 0.0 };
        self.texture_uv(uv).map_or(0.0, |uv| veins.depth(uv))
    }

    /// Whether a drop that strikes at texture coordinates meets the leaf, not a hole of the alpha mask.
    pub fn is_solid(&self, uv: DVec2) -> bool {
        let Some(mask) = &self.alpha_mask else { return true };
        self.texture_uv(uv).is_some_and(|uv| mask.is_solid(uv))
    }

    /// The blade's triangles as indices of [`LeafSurface::points`].
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Positions of the vertices at scale 1, m, vertices doubled by the chart included.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Chart coordinates of the vertices, in the order of [`LeafSurface::points`].
    pub fn uvs(&self) -> &[DVec2] {
        &self.uvs
    }

    /// Area of one side of the blade at scale 1, m^2, without petiole.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Number of grid cells over the texture, of `GRID_CELLS` squared, that hold some of the blade.
    pub fn occupied_cell_count(&self) -> usize {
        self.cells.iter().filter(|c| !c.is_empty()).count()
    }

    /// Chart coordinates of a point of a triangle from the barycentric coordinates of its second and third corner.
    pub fn interpolate_uv(&self, triangle: usize, [b, c]: [f64; 2]) -> DVec2 {
        let [i, j, k] = self.triangles[triangle].map(|i| self.uvs[i as usize]);
        i + (j - i) * b + (k - i) * c
    }

    /// The point at texture coordinates on a leaf of factor `scale`, in leaf space; `None` beyond the blade.
    pub fn point_at(&self, uv: DVec2, scale: f64) -> Option<SurfacePoint> {
        let (i, weights) = self.locate(uv)?;
        Some(self.interpolate(i, weights, scale))
    }

    /// The triangle that holds texture coordinates, and their barycentric coordinates in it; `None` beyond the blade.
    fn locate(&self, uv: DVec2) -> Option<(usize, [f64; 3])> {
        if !uv.is_finite() {
            return None;
        }
        let [x, y] = grid_cell(uv);
        // Only triangles whose boxes overlap the cell can contain the point.
        self.cells[y * GRID_CELLS + x].iter().find_map(|&i| Some((i, self.chart_triangles[i].barycentric(uv)?)))
    }

    /// The point at texture coordinates; beyond the blade, the point on the tangent plane of `near`, whose
    /// coordinates are `near_uv`.
    pub fn extrapolate(&self, uv: DVec2, near: &SurfacePoint, near_uv: DVec2, scale: f64) -> SurfacePoint {
        self.point_at(uv, scale).unwrap_or_else(|| {
            let d = uv - near_uv;
            SurfacePoint { p: near.p + near.dpdu * d.x + near.dpdv * d.y, ..*near }
        })
    }

    fn interpolate(&self, i: usize, weights: [f64; 3], scale: f64) -> SurfacePoint {
        let [a, b, c] = self.triangles[i];
        let [u, v, w] = weights;
        let sum = |list: &[DVec3]| DVec3::ZERO + list[a as usize] * u + list[b as usize] * v + list[c as usize] * w;
        // Lengths scale with the leaf, normals do not; without vertex normals use that of the triangle.
        let [dpdu, dpdv] = self.partials[i].map(|j| j * scale);
        let face_normal = || dpdu.cross(dpdv).normalize_or(DVec3::Z);
        let n = sum(&self.normals).try_normalize().unwrap_or_else(face_normal);
        SurfacePoint { p: sum(&self.points) * scale, n, dpdu, dpdv }
    }

    /// The point of the margin nearest to `p`, m, on a leaf of factor `scale`; `None` for a closed surface.
    pub fn nearest_margin(&self, p: DVec3, scale: f64) -> Option<MarginPoint> {
        // The margin is stored at scale 1: search there, then scale the result.
        let q = p / scale;
        let mut best: Option<MarginPoint> = None;
        let mut least = f64::INFINITY;
        for (edge, MarginSegment { start, along, squared_length }) in self.margin.segments.iter().enumerate() {
            // Project onto the segment.
            let fraction = ((q - *start).dot(*along) / squared_length).clamp(0.0, 1.0);
            let near = *start + *along * fraction;
            // Most edges are farther than the best so far: compare the squares before taking a root.
            let squared = near.distance_squared(q);
            if best.is_some() && squared >= least {
                continue;
            }
            let distance = squared.sqrt();
            if best.is_none_or(|r| distance < r.distance) {
                least = squared;
                best = Some(MarginPoint { p: near, distance, tangent: *along, edge, fraction });
            }
        }
        best.map(|r| MarginPoint {
            p: r.p * scale,
            distance: r.distance * scale,
            tangent: r.tangent.normalize_or(DVec3::X),
            ..r
        })
    }

    /// The position on the margin at an arc length of `offset`, m, from a point of it; negative offsets go backwards.
    pub fn walk_margin(&self, from: &MarginPoint, offset: f64, scale: f64) -> DVec3 {
        let (mut edge, mut left) = (from.edge, offset.abs() / scale);
        let forward = offset >= 0.0;
        let ahead = |edge: usize| {
            let [a, b] = self.margin.edges[edge].map(|k| self.points[k as usize]);
            if forward { b } else { a }
        };
        let mut p = from.p / scale;
        // At most once around the margin.
        for _ in 0..self.margin.edges.len() {
            let end = ahead(edge);
            let rest = p.distance(end);
            if left <= rest {
                return (p + (end - p).normalize_or_zero() * left) * scale;
            }
            left -= rest;
            p = end;
            // Continue on the next edge in this direction; an edge at the end of an open margin is its own neighbour.
            let neighbours = self.margin.neighbours[edge];
            edge = if forward { neighbours.next } else { neighbours.previous };
        }
        p * scale
    }

    /// Whether `p`, m, is closer than `radius`, m, to the blade's tip.
    pub fn is_tip(&self, p: DVec3, scale: f64, radius: f64) -> bool {
        self.tip.distance(p / scale) * scale < radius
    }

    /// Texture coordinates of a point of the margin, linear along its edge.
    pub fn uv_of_margin_point(&self, margin: &MarginPoint) -> DVec2 {
        let [a, b] = self.margin.edges[margin.edge].map(|k| self.uvs[k as usize]);
        a + (b - a) * margin.fraction
    }
}

/// Indices of the triangles whose bounding boxes in the texture overlap each grid cell, row by row.
fn triangles_by_cell(triangles: &[[u32; 3]], uvs: &[DVec2]) -> Vec<Vec<usize>> {
    let mut cells = vec![Vec::new(); GRID_CELLS * GRID_CELLS];
    // A box may overlap cells that its triangle does not; lookups test the triangle itself.
    for (i, t) in triangles.iter().enumerate() {
        let corners = t.map(|k| uvs[k as usize]);
        let lo = grid_cell(corners[0].min(corners[1]).min(corners[2]));
        let hi = grid_cell(corners[0].max(corners[1]).max(corners[2]));
        for y in lo[1]..=hi[1] {
            for x in lo[0]..=hi[0] {
                cells[y * GRID_CELLS + x].push(i);
            }
        }
    }
    cells
}

/// A triangle in the chart: its first corner, its edges from there, and their determinant.
#[derive(Debug, Clone, Copy)]
struct ChartTriangle {
    a: DVec2,
    s: DVec2,
    t: DVec2,
    det: f64,
}

impl ChartTriangle {
    fn new([a, b, c]: [DVec2; 3]) -> Self {
        let (s, t) = (b - a, c - a);
        Self { a, s, t, det: s.x * t.y - s.y * t.x }
    }

    /// Barycentric coordinates of texture coordinates; `None` outside of the triangle.
    #[inline]
    fn barycentric(&self, uv: DVec2) -> Option<[f64; 3]> {
        // Solve uv = a + u s + v t by Cramer's rule.
        let Self { a, s, t, det } = *self;
        let d = uv - a;
        let (u, v) = ((d.x * t.y - d.y * t.x) / det, (s.x * d.y - s.y * d.x) / det);
        let w = [1.0 - u - v, u, v];
        w.iter().all(|w| *w >= -BARYCENTRIC_TOLERANCE).then_some(w)
    }
}

/// The boundary of the blade: edges with a single triangle, linked in their order around it.
#[derive(Debug, Clone)]
struct LeafMargin {
    /// Start and end vertex of each edge, in the winding of its triangle.
    edges: Vec<[u32; 2]>,
    neighbours: Vec<EdgeNeighbours>,
    /// The edges in leaf space at scale 1.
    segments: Vec<MarginSegment>,
}

/// An edge of the margin in leaf space at scale 1, m.
#[derive(Debug, Clone, Copy)]
struct MarginSegment {
    start: DVec3,
    /// Vector from its start to its end.
    along: DVec3,
    /// Square of its length, m^2; the smallest positive number for an edge without length, so that divisions are safe.
    squared_length: f64,
}

/// Indices of the margin edges before and after an edge; the index of the edge itself where there is none.
#[derive(Debug, Clone, Copy)]
struct EdgeNeighbours {
    previous: usize,
    next: usize,
}

impl LeafMargin {
    /// `pieces`: piece of the chart that each triangle lies in; cuts between pieces are part of the margin.
    fn new(triangles: &[[u32; 3]], pieces: &[usize], points: &[DVec3]) -> Self {
        // Weld vertices of a piece that share a position (seams of normals split them), so that a seam is no margin. Adding 0.0 turns
        // -0.0 into 0.0, whose bits are the same then.
        let mut first_at: BTreeMap<(usize, [u64; 3]), u32> = BTreeMap::new();
        let mut welded: BTreeMap<u32, u32> = BTreeMap::new();
        for (i, piece) in triangles.iter().zip(pieces).flat_map(|(t, piece)| t.iter().map(move |i| (i, piece))) {
            let p = points[*i as usize].to_array().map(|x| (x + 0.0).to_bits());
            let first = *first_at.entry((*piece, p)).or_insert(*i);
            welded.insert(*i, first);
        }
        // Count the triangles of each undirected edge: the boundary has one.
        let mut count: BTreeMap<(u32, u32), (u32, [u32; 2])> = BTreeMap::new();
        for t in triangles {
            for k in 0..3 {
                let e = [welded[&t[k]], welded[&t[(k + 1) % 3]]];
                count.entry((e[0].min(e[1]), e[0].max(e[1]))).or_insert((0, e)).0 += 1;
            }
        }
        let edges: Vec<[u32; 2]> = count.values().filter(|(n, _)| *n == 1).map(|(_, e)| *e).collect();
        // Link the edges by their common vertices. Edges keep the winding of their triangles, so that one starts where another ends.
        let mut starting: BTreeMap<u32, usize> = BTreeMap::new();
        let mut ending: BTreeMap<u32, usize> = BTreeMap::new();
        for (i, e) in edges.iter().enumerate() {
            starting.insert(e[0], i);
            ending.insert(e[1], i);
        }
        let link = |(i, e): (usize, &[u32; 2])| EdgeNeighbours {
            previous: ending.get(&e[0]).copied().unwrap_or(i),
            next: starting.get(&e[1]).copied().unwrap_or(i),
        };
        let neighbours = edges.iter().enumerate().map(link).collect();
        let segment = |[a, b]: &[u32; 2]| {
            let start = points[*a as usize];
            let along = points[*b as usize] - start;
            MarginSegment { start, along, squared_length: along.length_squared().max(f64::MIN_POSITIVE) }
        };
        let segments = edges.iter().map(segment).collect();
        Self { edges, neighbours, segments }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use glam::{Vec2, Vec3};

    use super::*;

    /// A flat blade of a length along +Y and a width, cut into `n` by `n` squares.
    pub fn flat(length: f32, width: f32, n: u32) -> Mesh {
        let mut mesh = Mesh::default();
        for y in 0..=n {
            for x in 0..=n {
                let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
                mesh.points.push(Vec3::new((u - 0.5) * width, v * length, 0.0));
                mesh.normals.push(Vec3::Z);
                mesh.uvs.push(Vec2::new(u, v));
            }
        }
        for y in 0..n {
            for x in 0..n {
                let (a, b) = (y * (n + 1) + x, (y + 1) * (n + 1) + x);
                mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
            }
        }
        mesh
    }

    #[test]
    fn point_at_and_uv_offset_of_a_flat_blade() {
        let blade = LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade");
        let point = blade.point_at(DVec2::new(0.3, 0.7), 2.0).expect("inside");
        assert!(point.p.distance(DVec3::new(-0.016, 0.112, 0.0)) < 1e-8, "{:?}", point.p);
        let d = point.uv_offset(DVec3::new(0.008, 0.016, 0.0));
        assert!((d - DVec2::new(0.1, 0.1)).length() < 1e-6, "{d}");
        assert!(blade.point_at(DVec2::new(1.1, 0.5), 1.0).is_none());
        assert!((blade.area() / 0.0032 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_margin_goes_round() {
        let blade = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let margin = blade.nearest_margin(DVec3::new(0.018, 0.04, 0.0), 1.0).expect("a margin");
        assert!((margin.distance - 0.002).abs() < 1e-8);
        let there = blade.walk_margin(&margin, 0.05, 1.0);
        let back = blade.walk_margin(&margin, -0.05, 1.0);
        // 40 mm to a corner, then 10 mm along the short side; one way up, the other down.
        let mut ends = [there, back].map(|p| (p.y * 1000.0).round());
        ends.sort_by(f64::total_cmp);
        assert!(ends[0].abs() < 0.5 && (ends[1] - 80.0).abs() < 0.5, "{ends:?}");
        assert!((there.x - 0.01).abs() < 1e-7 && (back.x - 0.01).abs() < 1e-7);
    }
}
