//! The place where a ray met something: where it is, which way it faces, what it is made of.

use glam::{Vec2, Vec3};

use super::looks::ShadingParams;
use super::solid::{CornerData, Primitives};
use super::texture::footprint;
use super::wet::CoatMap;
use super::world::{Hit, SolidInstance, World};
use osier_base::math::normalize_or;
use osier_scene::MaterialId;

/// A place on a surface, seen from one side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    /// In the world, m.
    pub(super) p: Vec3,
    /// Unit normal of the flat triangle, towards the viewer.
    pub(super) face: Vec3,
    /// Unit normal for light, towards the viewer.
    pub(super) n: Vec3,
    /// True if the viewer is on the outside.
    pub(super) outside: bool,
    /// How far light goes through it to its other side, m: hairs are thick, sheets are not.
    pub(super) thick: f32,
    pub(super) finish: ShadingParams,
    pub(super) material: MaterialId,
}

/// A place on its triangle, before anything is looked up there.
struct TrianglePoint {
    face: Vec3,
    n: Vec3,
    uv: Vec2,
    color: Option<Vec3>,
    material: MaterialId,
    /// Edges of the triangle in the world and in texture coordinates.
    edges: [Vec3; 2],
    uv_edges: [Vec2; 2],
}

impl World<'_> {
    /// What lies at a hit. `spread`: width of the sample at unit distance.
    pub(super) fn surface(&self, hit: &Hit, origin: Vec3, direction: Vec3, spread: f32) -> Option<Surface> {
        let (showing, solid) = self.met(hit)?;
        let p = origin + direction * hit.spot.t;
        let mut thick = 0.0;
        let flat = match &solid.kind {
            Primitives::Faces { faces, mesh } => {
                triangle(showing, faces.get(hit.spot.primitive as usize)?, mesh, hit.spot.at)
            }
            Primitives::Cones { cones, material } => {
                let cone = cones.get(hit.spot.primitive as usize)?;
                thick = cone.width() * showing.world().0.x_axis.length();
                let n = showing.normal(cone.normal(showing.to_local(p)));
                let color = cone.color.map(Vec3::from_array);
                TrianglePoint {
                    face: n,
                    n,
                    uv: Vec2::ZERO,
                    color,
                    material: *material,
                    edges: [Vec3::X; 2],
                    uv_edges: [Vec2::ZERO; 2],
                }
            }
        };
        let width = footprint(spread * hit.spot.t * direction.length(), flat.edges, flat.uv_edges);
        let outside = flat.face.dot(direction) <= 0.0;
        let side = if outside { 1.0 } else { -1.0 };
        let mut n = self.relief(&flat, width) * side;
        // Relief and smooth normals may lean away from the viewer at the rim; light is then taken from the rim.
        let toward = -normalize_or(direction, Vec3::Z);
        let lean = n.dot(toward);
        if lean < 0.02 {
            n = normalize_or(n + toward * (0.02 - lean), flat.face * side);
        }
        let mut finish = self.looks.finish(flat.material, flat.uv, width);
        if let Some(color) = flat.color {
            finish.albedo = color;
        }
        if let Some(sheet) = self.sheet(flat.material) {
            sheet.apply(&mut finish, flat.uv, width);
        }
        // What light does not go through has no far side.
        let thick = if finish.translucency > 0.0 { thick } else { 0.0 };
        Some(Surface { p, face: flat.face * side, n, outside, thick, finish, material: flat.material })
    }

    /// Water on a material.
    fn sheet(&self, material: MaterialId) -> Option<&CoatMap> {
        self.sheets.get(material as usize)?.as_ref()
    }

    /// The smooth normal, turned by the normal map.
    /// The map's x runs along growing u, its y along growing v.
    fn relief(&self, flat: &TrianglePoint, width: f32) -> Vec3 {
        let own = || self.looks.relief(flat.material, flat.uv, width);
        let Some(m) = self.sheet(flat.material).map(|s| s.relief(flat.uv, width)).or_else(own) else { return flat.n };
        let ([e1, e2], [d1, d2]) = (flat.edges, flat.uv_edges);
        let det = d1.perp_dot(d2);
        if det.abs() < 1e-20 {
            return flat.n;
        }
        let along_u = (e1 * d2.y - e2 * d1.y) / det;
        let along_v = (e2 * d1.x - e1 * d2.x) / det;
        let t = normalize_or(along_u - flat.n * flat.n.dot(along_u), Vec3::X);
        let b = normalize_or(along_v - flat.n * flat.n.dot(along_v) - t * t.dot(along_v), Vec3::Z);
        normalize_or(t * m.x + b * m.y + flat.n * m.z, flat.n)
    }

    /// Unit normal of what lies at a hit: that of the flat triangle, or of the cone at `p`.
    pub(super) fn facing(&self, hit: &Hit, p: Vec3) -> Vec3 {
        let Some((showing, solid)) = self.met(hit) else { return Vec3::Y };
        let i = hit.spot.primitive as usize;
        let n = match &solid.kind {
            Primitives::Faces { faces, .. } => faces.get(i).map(super::solid::Face::normal),
            Primitives::Cones { cones, .. } => cones.get(i).map(|cone| cone.normal(showing.to_local(p))),
        };
        showing.normal(n.unwrap_or(Vec3::Y))
    }

    /// Mean colour of what lies at a hit, and its unit normal against the ray.
    pub(super) fn glimpse(&self, hit: &Hit, direction: Vec3) -> (Vec3, Vec3) {
        let Some((showing, solid)) = self.met(hit) else { return (Vec3::ZERO, Vec3::Y) };
        let (n, color) = match &solid.kind {
            Primitives::Faces { faces, mesh } => match faces.get(hit.spot.primitive as usize) {
                Some(face) => {
                    let color = vertex_color(mesh, mesh.corners(face), hit.spot.at);
                    (face.normal(), color.unwrap_or_else(|| self.looks.mean(face.material)))
                }
                None => (Vec3::Y, Vec3::ZERO),
            },
            Primitives::Cones { cones, material } => {
                let own = cones.get(hit.spot.primitive as usize).and_then(|c| c.color);
                (-direction, own.map_or_else(|| self.looks.mean(*material), Vec3::from_array))
            }
        };
        let n = showing.normal(n);
        (color, if n.dot(direction) > 0.0 { -n } else { n })
    }
}

fn triangle(showing: &SolidInstance, face: &super::solid::Face, mesh: &CornerData<'_>, at: Vec2) -> TrianglePoint {
    let corners = mesh.corners(face);
    let flat = showing.normal(face.normal());
    let world = showing.world().0;
    let [na, nb, nc] = corners.map(|i| mesh.normals.get(i).copied().unwrap_or(Vec3::ZERO));
    let smooth = na * (1.0 - at.x - at.y) + nb * at.x + nc * at.y;
    let n = if smooth.length_squared() > 1e-12 { showing.normal(smooth) } else { flat };
    let [ua, ub, uc] = corners.map(|i| mesh.uvs.get(i).copied().unwrap_or_default());
    TrianglePoint {
        face: flat,
        n,
        uv: mesh.uv(face, at),
        color: vertex_color(mesh, corners, at),
        material: face.material,
        edges: face.edges().map(|e| world * e),
        uv_edges: [ub - ua, uc - ua],
    }
}

fn vertex_color(mesh: &CornerData<'_>, corners: [usize; 3], at: Vec2) -> Option<Vec3> {
    if mesh.colors.is_empty() {
        return None;
    }
    let [a, b, c] = corners.map(|i| mesh.colors.get(i).map_or(Vec3::ONE, |c| Vec3::new(c[0], c[1], c[2])));
    Some(a + (b - a) * at.x + (c - a) * at.y)
}
