//! Prototypes that the turtle creates: filled polygons, discs, spheres, stretched organs. Equal ones are shared.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use super::frame::{TurtlePose, narrow};
use osier_base::geometry::{newell, triangulate};
use osier_base::math;
use osier_scene::plant::Proto;
use osier_scene::{MaterialId, Mesh};

/// Polygons whose corners agree to this share of their size share a prototype. Larger values merge
/// shapes that differ visibly, smaller ones keep rotated copies apart that differ by rounding alone.
const POLYGON_TOLERANCE: f64 = 1e-4;
/// Corners of a disc, and of a sphere around its equator: flat sides stay within 2 % of the radius.
const SIDES: u32 = 16;
/// Rings of a sphere between its poles.
const RINGS: u32 = 7;

/// Indices of the prototypes created so far, by the properties in which shared prototypes agree.
#[derive(Debug, Default)]
pub(super) struct PrototypeCache {
    polygons: BTreeMap<(MaterialId, Vec<i32>), Option<u16>>,
    stretched: BTreeMap<(u16, [i32; 2]), u16>,
    discs: BTreeMap<MaterialId, u16>,
    spheres: BTreeMap<MaterialId, u16>,
    rings: BTreeMap<(MaterialId, i32), u16>,
    surfaces: BTreeMap<SurfaceKey, u16>,
}

/// Points rounded to a grid, and material and number of triangles of each subset.
type SurfaceKey = (Vec<[i32; 3]>, Vec<(MaterialId, u32)>);

/// More prototypes than 16 bits can index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TooManyPrototypes;

/// A polygon as a scaled prototype.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PolygonPrototype {
    /// Index in the list of prototypes.
    pub proto: u16,
    /// Scale that gives the prototype, whose largest coordinate is 1, its size, m.
    pub size: f64,
}

/// Appends a prototype; `None` if there are 65,535 already.
fn add_prototype(protos: &mut Vec<Proto>, name: String, mesh: Mesh) -> Option<u16> {
    let i = u16::try_from(protos.len()).ok().filter(|i| *i < u16::MAX)?;
    protos.push(Proto { name, mesh: Arc::new(mesh) });
    Some(i)
}

/// Name of a shape that exists once for each material. `earlier`: number of these so far.
fn unique_name(name: &str, earlier: usize) -> String {
    if earlier == 0 { name.to_owned() } else { format!("{name}_{earlier}") }
}

impl PrototypeCache {
    /// Prototype of a planar polygon; `Ok(None)` if it has no area. `corners`: corners in plant space, m; `pose`: pose
    /// of the prototype.
    pub fn polygon(
        &mut self,
        protos: &mut Vec<Proto>,
        material: MaterialId,
        corners: &[DVec3],
        pose: TurtlePose,
    ) -> Result<Option<PolygonPrototype>, TooManyPrototypes> {
        let TurtlePose { p, q } = pose;
        let back = q.inverse();
        // Corners in the frame of the first one, without doubled corners (the closing one included).
        let mut local: Vec<DVec3> = corners.iter().map(|c| back * (*c - p)).collect();
        local.dedup_by(|a, b| (*a - *b).length() < 1e-9);
        if local.len() > 1 && (local[0] - local[local.len() - 1]).length() < 1e-9 {
            local.pop();
        }
        // Polygons of any size share a prototype: corners are divided by the largest coordinate and compared on a grid.
        let size = local.iter().fold(0.0_f64, |m, c| m.max(c.abs().max_element()));
        if local.len() < 3 || !size.is_finite() || size < 1e-7 {
            return Ok(None);
        }
        let key: Vec<i32> =
            local.iter().flat_map(|c| (*c / (size * POLYGON_TOLERANCE)).to_array()).map(round_to_i32).collect();
        let key = (material, key);
        if let Some(known) = self.polygons.get(&key) {
            return Ok(known.map(|proto| PolygonPrototype { proto, size }));
        }
        let corners: Vec<Vec3> = local.iter().map(|c| narrow(*c / size)).collect();
        let Some(mesh) = polygon_mesh(&corners) else {
            self.polygons.insert(key, None);
            return Ok(None);
        };
        let name = format!("polygon_{}", protos.len());
        let i = add_prototype(protos, name, mesh.with_material(material)).ok_or(TooManyPrototypes)?;
        self.polygons.insert(key, Some(i));
        Ok(Some(PolygonPrototype { proto: i, size }))
    }

    /// The shared disc of a material, of diameter 1 and facing +Z, registered on first use; `None` without a free index.
    pub fn disc(&mut self, protos: &mut Vec<Proto>, material: MaterialId) -> Option<u16> {
        if let Some(known) = self.discs.get(&material) {
            return Some(*known);
        }
        let corner = |i: u32| {
            let a = corner_angle(i, SIDES);
            Vec3::new(0.5 * math::cos_f32(a), 0.5 * math::sin_f32(a), 0.0)
        };
        let corners: Vec<Vec3> = (0..SIDES).map(corner).collect();
        let mesh = polygon_mesh(&corners).unwrap_or_default().with_material(material);
        let name = unique_name("disc", self.discs.len());
        let i = add_prototype(protos, name, mesh)?;
        self.discs.insert(material, i);
        Some(i)
    }

    /// The shared sphere of a material, of diameter 1, registered on first use; `None` without a free index.
    pub fn sphere(&mut self, protos: &mut Vec<Proto>, material: MaterialId) -> Option<u16> {
        if let Some(known) = self.spheres.get(&material) {
            return Some(*known);
        }
        let name = unique_name("sphere", self.spheres.len());
        let i = add_prototype(protos, name, sphere_mesh().with_material(material))?;
        self.spheres.insert(material, i);
        Some(i)
    }

    /// Prototype of a mesh whose largest coordinate is 1; equal ones are shared. `None` without a free index.
    pub fn surface(&mut self, protos: &mut Vec<Proto>, name: &str, mesh: Mesh) -> Option<u16> {
        let grid = |p: &Vec3| p.to_array().map(|v| round_to_i32(f64::from(v) / POLYGON_TOLERANCE));
        let key =
            (mesh.points.iter().map(grid).collect(), mesh.subsets.iter().map(|s| (s.material, s.count)).collect());
        if let Some(&i) = self.surfaces.get(&key) {
            return Some(i);
        }
        let name = format!("{name}_{}", protos.len());
        let i = add_prototype(protos, name, mesh)?;
        self.surfaces.insert(key, i);
        Some(i)
    }

    /// Prototype of a ring of diameter 1 around +Z. `tube`: diameter of its tube; rings whose tubes differ by less than a percent
    /// share a prototype. `None` without a free index.
    pub fn ring(&mut self, protos: &mut Vec<Proto>, material: MaterialId, tube: f64) -> Option<u16> {
        let key = (material, round_to_i32(math::ln(tube.max(1e-6)) * 100.0));
        if let Some(&i) = self.rings.get(&key) {
            return Some(i);
        }
        let name = format!("ring_{}", protos.len());
        let i = add_prototype(protos, name, ring_mesh(math::narrow(tube)).with_material(material))?;
        self.rings.insert(key, i);
        Some(i)
    }

    /// Prototype `source` stretched by `ratio` across and along the normal, relative to its length.
    pub fn stretched(&mut self, protos: &mut Vec<Proto>, source: u16, ratio: [f64; 2]) -> Option<u16> {
        // Ratios are rounded to steps of a percent, so that nearly equal ones share a prototype.
        let key = (source, ratio.map(|r| round_to_i32(math::ln(r.max(1e-6)) * 100.0)));
        if let Some(&i) = self.stretched.get(&key) {
            return Some(i);
        }
        let source = protos.get(usize::from(source))?;
        let factor = Vec3::new(math::narrow(ratio[0]), 1.0, math::narrow(ratio[1]));
        let mut mesh = Mesh::clone(&source.mesh);
        for p in &mut mesh.points {
            *p *= factor;
        }
        // Normals transform by the inverse of the stretch.
        for n in &mut mesh.normals {
            *n = math::normalize_or(*n / factor, *n);
        }
        let name = format!("{}_{}", source.name, protos.len());
        let i = add_prototype(protos, name, mesh)?;
        self.stretched.insert(key, i);
        Some(i)
    }
}

#[allow(clippy::cast_possible_truncation, reason = "saturates; only compared for equality")]
fn round_to_i32(x: f64) -> i32 {
    x.round() as i32
}

/// Angle of corner `i` of a regular polygon, rad.
fn corner_angle(i: u32, corners: u32) -> f32 {
    std::f32::consts::TAU * i as f32 / corners as f32
}

/// A planar polygon, triangulated, its upper side towards +Z where it has one; `None` without area.
fn polygon_mesh(corners: &[Vec3]) -> Option<Mesh> {
    let mut corners = corners.to_vec();
    let mut normal = newell(&corners);
    if normal.z < 0.0 {
        corners.reverse();
        normal = -normal;
    }
    let n = normal.try_normalize().filter(|_| normal.length() > 1e-9)?;
    let e1 = math::perpendicular(n);
    let e2 = n.cross(e1);
    // Triangulate in the plane of the polygon, with axes e1 and e2 across its normal.
    let outline: Vec<Vec2> = corners.iter().map(|c| Vec2::new(c.dot(e1), c.dot(e2))).collect();
    let triangles = triangulate(&outline);
    if triangles.is_empty() {
        return None;
    }
    // Polygons that roughly face +Z, as leaves do, keep their own axes as texture coordinates.
    let in_blade = |c: &Vec3| if n.z > 0.3 { c.truncate() } else { Vec2::new(c.dot(e1), c.dot(e2)) };
    let plane: Vec<Vec2> = corners.iter().map(in_blade).collect();
    // Texture coordinates span 0..1 over the box of the corners.
    let low = plane.iter().fold(Vec2::INFINITY, |m, c| m.min(*c));
    let high = plane.iter().fold(Vec2::NEG_INFINITY, |m, c| m.max(*c));
    let size = (high - low).max(Vec2::splat(1e-9));
    Some(Mesh {
        uvs: plane.iter().map(|c| (*c - low) / size).collect(),
        normals: vec![n; corners.len()],
        points: corners,
        triangles,
        ..Mesh::default()
    })
}

/// Sides of the tube's cross-section, and steps around the ring.
const RING_SIDES: [u32; 2] = [6, 32];

/// A torus around +Z: a tube of this diameter whose centreline has diameter 1.
fn ring_mesh(tube: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let [sides, steps] = RING_SIDES;
    for k in 0..=steps {
        let a = corner_angle(k % steps, steps);
        let out = Vec3::new(math::cos_f32(a), math::sin_f32(a), 0.0);
        for i in 0..=sides {
            let b = corner_angle(i % sides, sides);
            let n = out * math::cos_f32(b) + Vec3::Z * math::sin_f32(b);
            mesh.points.push(out * 0.5 + n * (0.5 * tube));
            mesh.normals.push(n);
            mesh.uvs.push(Vec2::new(k as f32 / steps as f32, i as f32 / sides as f32));
        }
    }
    let row = sides + 1;
    for k in 0..steps {
        for i in 0..sides {
            let (a, b) = (k * row + i, (k + 1) * row + i);
            mesh.triangles.push([a, b, b + 1]);
            mesh.triangles.push([a, b + 1, a + 1]);
        }
    }
    mesh
}

/// A sphere of diameter 1 as rings of latitude around Y, with a texture seam.
fn sphere_mesh() -> Mesh {
    let mut mesh = Mesh::default();
    for ring in 0..=RINGS + 1 {
        let v = ring as f32 / (RINGS + 1) as f32;
        let (y, r) = (-math::cos_f32(std::f32::consts::PI * v), math::sin_f32(std::f32::consts::PI * v));
        for i in 0..=SIDES {
            let a = corner_angle(i % SIDES, SIDES);
            let n = Vec3::new(r * math::cos_f32(a), y, -r * math::sin_f32(a));
            mesh.points.push(n * 0.5);
            mesh.normals.push(math::normalize_or(n, Vec3::Y));
            mesh.uvs.push(Vec2::new(i as f32 / SIDES as f32, v));
        }
    }
    let row = SIDES + 1;
    // Each quad between the rings gives two triangles; at the poles, where one edge has no length, only one of them.
    for ring in 0..=RINGS {
        for i in 0..SIDES {
            let (a, b) = (ring * row + i, (ring + 1) * row + i);
            if ring > 0 {
                mesh.triangles.push([a, a + 1, b + 1]);
            }
            if ring < RINGS {
                mesh.triangles.push([a, b + 1, b]);
            }
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_face_outwards() {
        let mesh = sphere_mesh();
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            let n = (b - a).cross(c - a);
            assert!(n.length() > 1e-6 && n.dot(a + b + c) > 0.0, "{t:?}");
        }
        let ring = ring_mesh(0.1);
        for t in &ring.triangles {
            let [a, b, c] = t.map(|i| ring.points[i as usize]);
            let n = t.iter().map(|i| ring.normals[*i as usize]).sum::<Vec3>();
            assert!((b - a).cross(c - a).dot(n) > 0.0, "{t:?}");
        }
        assert!((ring.bounds().max.x - 0.55).abs() < 1e-6 && (ring.bounds().max.z - 0.05).abs() < 0.01);
        let mut protos = Vec::new();
        let disc = PrototypeCache::default().disc(&mut protos, 0).expect("room");
        let mesh = &protos[usize::from(disc)].mesh;
        assert_eq!(mesh.triangles.len(), 14);
        assert!(mesh.normals.iter().all(|n| n.z > 0.999));
    }

    #[test]
    fn equal_polygons_of_any_size_share_a_prototype() {
        let mut shapes = PrototypeCache::default();
        let mut protos = Vec::new();
        let square = |k: f64| [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]].map(|c| DVec3::new(c[0], c[1], 0.0) * k);
        let at = TurtlePose { p: DVec3::ZERO, q: glam::DQuat::IDENTITY };
        let a = shapes.polygon(&mut protos, 0, &square(1.0), at).expect("room").expect("area");
        let b = shapes.polygon(&mut protos, 0, &square(3.0), at).expect("room").expect("area");
        assert_eq!((a.proto, b.proto), (0, 0));
        assert!((b.size / a.size - 3.0).abs() < 1e-12);
        let line = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        assert_eq!(shapes.polygon(&mut protos, 0, &line, at), Ok(None));
        assert_eq!(shapes.polygon(&mut protos, 0, &line[..2], at), Ok(None));
    }
}
