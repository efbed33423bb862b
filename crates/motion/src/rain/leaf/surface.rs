//! A leaf's blade as a surface that drops move over: places by texture coordinates, directions, and its margin.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::rain::leaf::mask::AlphaMask;
use crate::rain::leaf::veins::VeinMap;
use crate::rain::leaf::wetness::GRID_CELLS;
use osier_scene::Mesh;

/// Triangles with less of the texture than this are not blade: petioles are drawn on a line of it.
const LEAST: f64 = 1e-9;

/// A place on a blade, in metres of leaf space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where, m.
    pub p: DVec3,
    /// Unit normal of the upper side, smooth.
    pub n: DVec3,
    /// How places change with u and with v, m.
    pub ju: DVec3,
    /// See `ju`.
    pub jv: DVec3,
}

impl SurfacePoint {
    /// Change of texture coordinates for a way over the surface, m. Source: G^-1 J^T d.
    pub fn uv(&self, d: DVec3) -> DVec2 {
        let (a, b, c) = (self.ju.dot(self.ju), self.ju.dot(self.jv), self.jv.dot(self.jv));
        let (x, y) = (self.ju.dot(d), self.jv.dot(d));
        let det = a * c - b * b;
        DVec2::new(c * x - b * y, a * y - b * x) / det.max(f64::MIN_POSITIVE)
    }

    /// Largest change of a texture coordinate on a way of 1 m.
    pub fn max_uv_rate(&self) -> DVec2 {
        let (a, b, c) = (self.ju.dot(self.ju), self.ju.dot(self.jv), self.jv.dot(self.jv));
        let det = (a * c - b * b).max(f64::MIN_POSITIVE);
        DVec2::new((c / det).max(0.0).sqrt(), (a / det).max(0.0).sqrt())
    }
}

/// A place on the margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarginPoint {
    /// Where, m.
    pub p: DVec3,
    /// How far, m.
    pub distance: f64,
    /// Along the margin, unit.
    pub along: DVec3,
    /// Number of the piece of margin.
    pub piece: usize,
    /// How far along that piece, 0 to 1.
    pub share: f64,
}

/// A blade, in its own metres; leaves that show it are larger or smaller by a factor.
#[derive(Debug, Clone)]
pub struct LeafSurface {
    points: Vec<DVec3>,
    normals: Vec<DVec3>,
    uvs: Vec<DVec2>,
    triangles: Vec<[u32; 3]>,
    /// Per triangle: J.
    jacobians: Vec<[DVec3; 2]>,
    cells: Vec<Vec<u32>>,
    /// Pieces of margin, each with the piece before and after it.
    rim: Vec<[u32; 2]>,
    next: Vec<[usize; 2]>,
    /// Area of the blade, m^2.
    area: f64,
    /// The point of the margin farthest from the stalk.
    tip: DVec3,
    /// What of it is leaf, if its picture cuts holes.
    cover: Option<AlphaMask>,
    /// Its veins, if it has a relief.
    grooves: Option<VeinMap>,
}

impl LeafSurface {
    /// The blade of a mesh with texture coordinates; none where it has no blade. Petioles, which stand on a line of the texture, are left out.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        if mesh.uvs.len() != mesh.points.len() {
            return None;
        }
        let points: Vec<DVec3> = mesh.points.iter().map(|p| p.as_dvec3()).collect();
        let uvs: Vec<DVec2> = mesh.uvs.iter().map(|p| p.as_dvec2()).collect();
        let normals: Vec<DVec3> = mesh.normals.iter().map(|p| p.as_dvec3()).collect();
        let mut triangles = Vec::new();
        let mut jacobians = Vec::new();
        let mut area = 0.0;
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| i as usize);
            let (s, t1) = (uvs[b] - uvs[a], uvs[c] - uvs[a]);
            let det = s.x * t1.y - s.y * t1.x;
            if det.abs() < LEAST {
                continue;
            }
            let (e, f) = (points[b] - points[a], points[c] - points[a]);
            jacobians.push([(e * t1.y - f * s.y) / det, (f * s.x - e * t1.x) / det]);
            triangles.push(*t);
            area += 0.5 * e.cross(f).length();
        }
        let (rim, next) = margin(&triangles, &points);
        let tip = rim.iter().map(|e| points[e[0] as usize]).max_by(|a, b| a.length().total_cmp(&b.length()))?;
        let mut sheet = Self {
            points,
            normals,
            uvs,
            triangles,
            jacobians,
            cells: Vec::new(),
            rim,
            next,
            area,
            tip,
            cover: None,
            grooves: None,
        };
        sheet.sort();
        Some(sheet)
    }

    /// The same blade with the holes that its picture cuts, and the veins of its relief.
    pub fn with(self, cover: Option<AlphaMask>, grooves: Option<VeinMap>) -> Self {
        Self { cover, grooves, ..self }
    }

    /// How deep in a vein texture coordinates lie, 0 to 1.
    pub fn vein_depth(&self, uv: DVec2) -> f64 {
        self.grooves.as_ref().map_or(0.0, |grooves| grooves.at(uv))
    }

    /// Whether a drop that comes down at texture coordinates meets leaf, not a hole.
    pub fn stops(&self, uv: DVec2) -> bool {
        self.cover.as_ref().is_none_or(|cover| cover.is_leaf(uv))
    }

    fn sort(&mut self) {
        self.cells = vec![Vec::new(); GRID_CELLS * GRID_CELLS];
        for (i, t) in self.triangles.iter().enumerate() {
            let corners = t.map(|k| self.uvs[k as usize]);
            let lo = cell(corners[0].min(corners[1]).min(corners[2]));
            let hi = cell(corners[0].max(corners[1]).max(corners[2]));
            for y in lo.1..=hi.1 {
                for x in lo.0..=hi.0 {
                    self.cells[y * GRID_CELLS + x].push(u32::try_from(i).unwrap_or(u32::MAX));
                }
            }
        }
    }

    /// Triangles of the blade, as corners.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Points of the mesh, m.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Texture coordinates of the points.
    pub fn uvs(&self) -> &[DVec2] {
        &self.uvs
    }

    /// Area of the blade, m^2.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Cells of the texture that have some of the blade, of `GRID_CELLS` each way.
    pub fn occupied_cells(&self) -> usize {
        self.cells.iter().filter(|c| !c.is_empty()).count()
    }

    /// Texture coordinates of a place of a triangle.
    pub fn uv_of(&self, triangle: usize, [b, c]: [f64; 2]) -> DVec2 {
        let [i, j, k] = self.triangles[triangle].map(|i| self.uvs[i as usize]);
        i + (j - i) * b + (k - i) * c
    }

    /// The place at texture coordinates, `scale` times as large; none outside of the blade.
    pub fn at(&self, uv: DVec2, scale: f64) -> Option<SurfacePoint> {
        if !uv.is_finite() {
            return None;
        }
        let (x, y) = cell(uv);
        for i in &self.cells[y * GRID_CELLS + x] {
            if let Some(w) = self.weights(*i as usize, uv) {
                return Some(self.spot(*i as usize, w, scale));
            }
        }
        None
    }

    /// The place at texture coordinates, beyond the margin on the plane of the last triangle that `near` is in.
    pub fn extrapolate(&self, uv: DVec2, near: &SurfacePoint, at: DVec2, scale: f64) -> SurfacePoint {
        self.at(uv, scale).unwrap_or_else(|| {
            let d = uv - at;
            SurfacePoint { p: near.p + near.ju * d.x + near.jv * d.y, ..*near }
        })
    }

    fn weights(&self, i: usize, uv: DVec2) -> Option<[f64; 3]> {
        let [a, b, c] = self.triangles[i].map(|k| self.uvs[k as usize]);
        let (s, t, d) = (b - a, c - a, uv - a);
        let det = s.x * t.y - s.y * t.x;
        let (u, v) = ((d.x * t.y - d.y * t.x) / det, (s.x * d.y - s.y * d.x) / det);
        let w = [1.0 - u - v, u, v];
        w.iter().all(|w| *w >= -1e-9).then_some(w)
    }

    fn spot(&self, i: usize, w: [f64; 3], scale: f64) -> SurfacePoint {
        let t = self.triangles[i].map(|k| k as usize);
        let sum = |list: &[DVec3]| (0..3).fold(DVec3::ZERO, |s, k| s + list[t[k]] * w[k]);
        let [ju, jv] = self.jacobians[i].map(|j| j * scale);
        let flat = ju.cross(jv);
        let n = sum(&self.normals).normalize_or(flat.normalize_or(DVec3::Z));
        SurfacePoint { p: sum(&self.points) * scale, n, ju, jv }
    }

    /// The nearest place of the margin to a place, both `scale` times as large.
    pub fn nearest_margin(&self, p: DVec3, scale: f64) -> Option<MarginPoint> {
        let q = p / scale;
        let mut best: Option<MarginPoint> = None;
        for (piece, [a, b]) in self.rim.iter().enumerate() {
            let (a, b) = (self.points[*a as usize], self.points[*b as usize]);
            let way = b - a;
            let share = ((q - a).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            let near = a + way * share;
            let distance = near.distance(q);
            if best.is_none_or(|r| distance < r.distance) {
                let along = way.normalize_or(DVec3::X);
                best = Some(MarginPoint { p: near, distance, along, piece, share });
            }
        }
        best.map(|r| MarginPoint { p: r.p * scale, distance: r.distance * scale, ..r })
    }

    /// The place on the margin a way further along it (back for less than 0), m.
    pub fn along_margin(&self, rim: &MarginPoint, way: f64, scale: f64) -> DVec3 {
        let (mut piece, mut left) = (rim.piece, way.abs() / scale);
        let side = usize::from(way >= 0.0);
        let ends = |piece: usize| {
            let [a, b] = self.rim[piece].map(|k| self.points[k as usize]);
            if side == 1 { (a, b) } else { (b, a) }
        };
        let mut from = rim.p / scale;
        for _ in 0..self.rim.len() {
            let (_, end) = ends(piece);
            let rest = from.distance(end);
            if left <= rest {
                return (from + (end - from).normalize_or_zero() * left) * scale;
            }
            left -= rest;
            from = end;
            piece = self.next[piece][side];
        }
        from * scale
    }

    /// Whether a place is at the blade's tip.
    pub fn is_tip(&self, p: DVec3, scale: f64, within: f64) -> bool {
        self.tip.distance(p / scale) * scale < within
    }

    /// Texture coordinates just inside of a place of the margin.
    pub fn margin_uv(&self, rim: &MarginPoint) -> DVec2 {
        let [a, b] = self.rim[rim.piece].map(|k| self.uvs[k as usize]);
        a + (b - a) * rim.share
    }
}

fn cell(uv: DVec2) -> (usize, usize) {
    let n = GRID_CELLS as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let one = |x: f64| (x * n).clamp(0.0, n - 1.0) as usize;
    (one(uv.x), one(uv.y))
}

/// Edges with one triangle, and the pieces before and after each. Points that share a place count as one.
fn margin(triangles: &[[u32; 3]], points: &[DVec3]) -> (Vec<[u32; 2]>, Vec<[usize; 2]>) {
    let mut places: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let mut same: BTreeMap<u32, u32> = BTreeMap::new();
    for i in triangles.iter().flatten() {
        let p = points[*i as usize].to_array().map(|x| (x + 0.0).to_bits());
        let first = *places.entry(p).or_insert(*i);
        same.insert(*i, first);
    }
    let mut count: BTreeMap<(u32, u32), (u32, [u32; 2])> = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let e = [same[&t[k]], same[&t[(k + 1) % 3]]];
            count.entry((e[0].min(e[1]), e[0].max(e[1]))).or_insert((0, e)).0 += 1;
        }
    }
    let rim: Vec<[u32; 2]> = count.values().filter(|(n, _)| *n == 1).map(|(_, e)| *e).collect();
    let mut starts: BTreeMap<u32, usize> = BTreeMap::new();
    let mut ends: BTreeMap<u32, usize> = BTreeMap::new();
    for (i, e) in rim.iter().enumerate() {
        starts.insert(e[0], i);
        ends.insert(e[1], i);
    }
    let next = rim
        .iter()
        .enumerate()
        .map(|(i, e)| [ends.get(&e[0]).copied().unwrap_or(i), starts.get(&e[1]).copied().unwrap_or(i)])
        .collect();
    (rim, next)
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
    fn places_and_ways_agree() {
        let sheet = LeafSurface::new(&flat(0.08, 0.04, 6)).expect("a blade");
        let spot = sheet.at(DVec2::new(0.3, 0.7), 2.0).expect("inside");
        assert!(spot.p.distance(DVec3::new(-0.016, 0.112, 0.0)) < 1e-8, "{:?}", spot.p);
        let d = spot.uv(DVec3::new(0.008, 0.016, 0.0));
        assert!((d - DVec2::new(0.1, 0.1)).length() < 1e-6, "{d}");
        assert!(sheet.at(DVec2::new(1.1, 0.5), 1.0).is_none());
        assert!((sheet.area() / 0.0032 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_margin_goes_round() {
        let sheet = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let rim = sheet.nearest_margin(DVec3::new(0.018, 0.04, 0.0), 1.0).expect("a margin");
        assert!((rim.distance - 0.002).abs() < 1e-8);
        let there = sheet.along_margin(&rim, 0.05, 1.0);
        let back = sheet.along_margin(&rim, -0.05, 1.0);
        // 40 mm to a corner, then 10 mm along the short side; one way up, the other down.
        let mut ends = [there, back].map(|p| (p.y * 1000.0).round());
        ends.sort_by(f64::total_cmp);
        assert!(ends[0].abs() < 0.5 && (ends[1] - 80.0).abs() < 0.5, "{ends:?}");
        assert!((there.x - 0.01).abs() < 1e-7 && (back.x - 0.01).abs() < 1e-7);
    }
}
