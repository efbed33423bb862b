//! A triangulated blade from an outline and a midrib.

use glam::{DVec2, Vec2, Vec3};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};

use super::outline::inside;
use super::rib::project_onto_line;
use osier_base::math::{self, narrow};
use osier_scene::Mesh;

/// A flat blade: points in pixels with y up, triangles counter-clockwise.
#[derive(Debug, Clone, PartialEq)]
pub struct FlatBlade {
    /// Points, pixels, y up.
    pub points: Vec<DVec2>,
    /// Corners, counter-clockwise seen from +Z.
    pub triangles: Vec<[u32; 3]>,
}

/// Triangulates the inside of rings (outline first, then holes; y up) with edges along the midrib and inner points on a
/// hexagonal grid of the given spacing.
/// Source: L. P. Chew, "Constrained Delaunay triangulations", 1989.
pub fn flat(rings: &[Vec<DVec2>], midrib: &[DVec2], spacing: f64) -> FlatBlade {
    let mut cdt = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut lines: Vec<(DVec2, DVec2)> = Vec::new();
    for ring in rings {
        let handles: Vec<_> = ring.iter().filter_map(|p| cdt.insert(Point2::new(p.x, p.y)).ok()).collect();
        for (i, from) in handles.iter().enumerate() {
            let to = handles[(i + 1) % handles.len()];
            if *from != to {
                cdt.try_add_constraint(*from, to);
                lines.push((ring[i], ring[(i + 1) % ring.len()]));
            }
        }
    }
    // Even-odd rule over all rings: inside the outline and outside the holes.
    let within = |p: DVec2| rings.iter().filter(|r| inside(r, p)).count() % 2 == 1;
    let kept: Vec<DVec2> = midrib.iter().copied().filter(|p| within(*p)).collect();
    let handles: Vec<_> = kept.iter().filter_map(|p| cdt.insert(Point2::new(p.x, p.y)).ok()).collect();
    for (pair, ends) in handles.windows(2).zip(kept.windows(2)) {
        if pair[0] != pair[1] && !cdt.try_add_constraint(pair[0], pair[1]).is_empty() {
            lines.push((ends[0], ends[1]));
        }
    }
    // Inner points keep half a spacing from constrained edges, or thin triangles would appear.
    for p in hexagonal_grid(rings, spacing) {
        if within(p) && lines.iter().all(|(a, b)| distance_to_segment(*a, *b, p) > 0.5 * spacing) {
            let _ = cdt.insert(Point2::new(p.x, p.y));
        }
    }
    let points: Vec<DVec2> = cdt.vertices().map(|v| DVec2::new(v.position().x, v.position().y)).collect();
    let mut triangles = Vec::new();
    for face in cdt.inner_faces() {
        let corners = face.vertices();
        let at = corners.map(|v| DVec2::new(v.position().x, v.position().y));
        // The triangulation covers the convex hull: keep triangles whose centroid lies in the leaf.
        if within((at[0] + at[1] + at[2]) / 3.0) {
            triangles.push(corners.map(|v| v.fix().index()));
        }
    }
    // The order of the library's faces is not specified; sorting fixes the written bytes.
    triangles.sort_unstable();
    compact(points, triangles)
}

/// Drops points that no triangle uses and renumbers the corners.
fn compact(points: Vec<DVec2>, triangles: Vec<[usize; 3]>) -> FlatBlade {
    // `new`: index of each kept point after renumbering, in the order in which triangles use them.
    let mut new = vec![u32::MAX; points.len()];
    let (mut kept, mut next_index) = (Vec::new(), 0_u32);
    let triangles = triangles
        .iter()
        .map(|t| {
            t.map(|i| {
                let slot = &mut new[i];
                if *slot == u32::MAX {
                    *slot = next_index;
                    next_index += 1;
                    kept.push(points[i]);
                }
                *slot
            })
        })
        .collect();
    FlatBlade { points: kept, triangles }
}

fn distance_to_segment(a: DVec2, b: DVec2, p: DVec2) -> f64 {
    let d = b - a;
    let t = ((p - a).dot(d) / d.length_squared().max(1e-30)).clamp(0.0, 1.0);
    (p - a - d * t).length()
}

#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "some thousand cells"
)]
fn hexagonal_grid(rings: &[Vec<DVec2>], spacing: f64) -> Vec<DVec2> {
    let all = || rings.iter().flatten();
    let low = all().fold(DVec2::INFINITY, |m, p| m.min(*p));
    let high = all().fold(DVec2::NEG_INFINITY, |m, p| m.max(*p));
    let rise = spacing * 0.866_025_403_784_438_6;
    let cells = |length: f64, step: f64| (length / step).clamp(0.0, 2000.0) as usize;
    let mut out = Vec::new();
    for row in 0..=cells(high.y - low.y, rise) {
        for column in 0..=cells(high.x - low.x, spacing) {
            let shift = if row % 2 == 0 { 0.25 } else { 0.75 };
            out.push(low + DVec2::new((column as f64 + shift) * spacing, (row as f64 + 0.5) * rise));
        }
    }
    out
}

/// Size, bend and stalk that a flat blade gets when it becomes a mesh in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BladePose {
    /// Distance from anchor to tip, m.
    pub size: f64,
    /// Width divided by `size`; `None` keeps the proportions of the table.
    pub width: Option<f64>,
    /// Droop from base to tip, rad.
    pub curl: f64,
    /// How far each half is folded up at the midrib, rad.
    pub fold: f64,
    /// Turn about the midrib towards the tip, rad.
    pub twist: f64,
    /// Length and radius of the stalk, m.
    pub petiole: (f64, f64),
}

/// Position of a blade on its maps, y up.
#[derive(Debug, Clone, PartialEq)]
pub struct BladePlacement {
    /// Pixels along a side of the maps.
    pub side: f64,
    /// Where the stalk meets the blade, pixels.
    pub anchor: DVec2,
    /// The midrib from the anchor to the tip, pixels.
    pub midrib: Vec<DVec2>,
    /// A place well inside the blade near its foot, whose colour the stalk takes.
    pub solid: DVec2,
    /// How far above the anchor the midrib enters the mesh, pixels.
    pub start: f64,
}

/// The blade as a mesh in organ space: stalk base at the origin, midrib along +Y, upper side +Z; one material (0). The
/// halves are folded about the midrib; slices across it turn about X by curl u^2.
/// Own: texture coordinates are places on the maps.
pub fn bent(flat: &FlatBlade, place: &BladePlacement, pose: &BladePose) -> Mesh {
    let length = place.midrib.last().map_or(1.0, |t| t.distance(place.anchor)).max(1e-9);
    let unit = pose.size / length;
    let wide = width_factor(flat, length, pose.width);
    let mut mesh = Mesh { triangles: flat.triangles.clone(), ..Mesh::default() };
    for p in &flat.points {
        let (u, span) = project_onto_line(&place.midrib, *p);
        let local = (*p - place.anchor) * DVec2::new(unit * wide, unit);
        let side = -span * unit * wide;
        // Fold: each half rotates up about the midrib, less towards the tip.
        let fold = pose.fold * (1.0 - 0.3 * u);
        let (up, out) = (side.abs() * math::sin(fold), side * (math::cos(fold) - 1.0));
        // Twist about the midrib, proportional to the position along it.
        let turn = pose.twist * u;
        let (x, z) = (local.x + out, up);
        let (x, z) = (x * math::cos(turn) - z * math::sin(turn), x * math::sin(turn) + z * math::cos(turn));
        // Curl: the midrib bends in the plane of y and z; points follow its normal.
        let (at, normal) = midrib_frame(local.y / pose.size, pose);
        let q = at + normal * z;
        mesh.points.push(Vec3::new(narrow(x), narrow(q.x + pose.petiole.0), narrow(q.y)));
        mesh.uvs.push(Vec2::new(narrow(p.x / place.side), narrow(p.y / place.side)));
    }
    mesh.normals = vertex_normals(&mesh);
    add_petiole(&mut mesh, place, pose);
    mesh.with_material(0)
}

/// Factor across the blade that makes it `width` times its length wide; 1 if no width is given.
fn width_factor(flat: &FlatBlade, length: f64, width: Option<f64>) -> f64 {
    let x = || flat.points.iter().map(|p| p.x);
    // Width of the drawn blade over its length.
    let own = (x().fold(f64::MIN, f64::max) - x().fold(f64::MAX, f64::min)) / length;
    width.filter(|_| own > 1e-9).map_or(1.0, |w| w / own)
}

/// The midrib at `v` (0 at the anchor, 1 at the tip; straight beyond both): place and normal in the plane of y and z.
fn midrib_frame(v: f64, pose: &BladePose) -> (DVec2, DVec2) {
    const STEPS: u32 = 16;
    let clamped = v.clamp(0.0, 1.0);
    // The angle grows with the square of the arc length; integrated by the midpoint rule.
    let angle = |t: f64| pose.curl * t * t;
    let mut at = DVec2::ZERO;
    let step = clamped / f64::from(STEPS);
    for k in 0..STEPS {
        let a = angle((f64::from(k) + 0.5) * step);
        at += DVec2::new(math::cos(a), -math::sin(a)) * (step * pose.size);
    }
    let a = angle(clamped);
    let along = DVec2::new(math::cos(a), -math::sin(a));
    (at + along * ((v - clamped) * pose.size), DVec2::new(math::sin(a), math::cos(a)))
}

fn vertex_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; mesh.points.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.points[i as usize]);
        // Not normalized: the cross product weights each triangle by its area.
        let n = (b - a).cross(c - a);
        for i in t {
            normals[*i as usize] += n;
        }
    }
    normals.iter().map(|n| math::normalize_or(*n * 1e6, Vec3::Z)).collect()
}

/// Adds the stalk: a thin tube from the origin to the blade, with the map's colours at the blade's foot.
fn add_petiole(mesh: &mut Mesh, place: &BladePlacement, pose: &BladePose) {
    const SIDES: u32 = 4;
    let (length, radius) = pose.petiole;
    if length <= 0.0 || radius <= 0.0 {
        return;
    }
    let first = mesh.next_point();
    let foot = place.solid / place.side;
    let blade = place.midrib.last().map_or(1.0, |t| t.distance(place.anchor)).max(1e-9);
    // The tube ends inside the blade, a quarter of its length beyond its base.
    let neck = length + place.start / blade * pose.size;
    for (y, r) in [(0.0, 1.4 * radius), (neck, radius), (neck + 0.25 * pose.size, 0.35 * radius)] {
        for k in 0..SIDES {
            let a = f64::from(k) / f64::from(SIDES) * std::f64::consts::TAU;
            let (sin, cos) = (math::sin(a), math::cos(a));
            let below = if y > neck { -0.6 * radius } else { 0.0 };
            mesh.points.push(Vec3::new(narrow(cos * r), narrow(y), narrow(sin * r + below)));
            mesh.normals.push(Vec3::new(narrow(cos), 0.0, narrow(sin)));
            mesh.uvs.push(Vec2::new(narrow(foot.x), narrow(foot.y)));
        }
    }
    for ring in 0..2 {
        for k in 0..SIDES {
            let (a, b) = (first + ring * SIDES + k, first + ring * SIDES + (k + 1) % SIDES);
            mesh.triangles.push([a, a + SIDES, b]);
            mesh.triangles.push([b, a + SIDES, b + SIDES]);
        }
    }
}
