//! The point where a ray hits a surface: position, normals, material and coat.

use glam::{Vec2, Vec3};

use super::coat::CoatMap;
use super::materials::ShadingParams;
use super::render_scene::{RenderScene, SceneHit, SolidInstance};
use super::solid::{PrimitiveHit, Primitives, RayTriangle, VertexData};
use super::texture::footprint;
use osier_base::math::normalize_or;
use osier_scene::MaterialId;

/// Smallest cosine between shading normal and direction to the viewer.
const MIN_VIEW_COSINE: f32 = 0.02;

/// Geometry and shading parameters at a point of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceInteraction {
    /// Position in the world, m.
    pub(super) p: Vec3,
    /// Geometric unit normal on the side of the viewer.
    pub(super) normal: Vec3,
    /// Interpolated and normal-mapped unit normal on the side of the viewer.
    pub(super) shading_normal: Vec3,
    /// Whether the viewer is on the outside of the surface.
    pub(super) is_outside: bool,
    /// Distance that transmitted light travels to the far side, m: the diameter of a hair, 0 for a leaf.
    pub(super) thickness: f32,
    pub(super) shading: ShadingParams,
    pub(super) material: MaterialId,
}

/// Attributes of a hit before textures are evaluated.
struct SurfaceAttributes {
    normal: Vec3,
    smooth_normal: Vec3,
    uv: Vec2,
    color: Option<Vec3>,
    material: MaterialId,
    /// Two edges of the triangle in the world, m.
    edges: [Vec3; 2],
    /// The same edges in texture coordinates.
    uv_edges: [Vec2; 2],
}

/// Mean colour and normal of an occluder, without texture look-ups.
pub(super) struct MeanSurface {
    /// Linear mean colour of its material times the vertex colour of a mesh, or the colour of a point.
    pub(super) color: Vec3,
    /// Geometric unit normal on the side of the ray's origin.
    pub(super) normal: Vec3,
}

impl RenderScene<'_> {
    /// Evaluates the surface at a hit. `spread`: width of the sample at unit distance.
    pub(super) fn surface(
        &self,
        hit: &SceneHit,
        origin: Vec3,
        direction: Vec3,
        spread: f32,
    ) -> Option<SurfaceInteraction> {
        let (instance, solid) = self.hit_instance(hit)?;
        let PrimitiveHit { t, primitive, barycentric } = hit.primitive;
        let p = origin + direction * t;
        let mut thickness = 0.0;
        let attributes = match &solid.kind {
            Primitives::Triangles { triangles, vertices } => {
                triangle_attributes(instance, triangles.get(primitive as usize)?, vertices, barycentric)
            }
            Primitives::Cones { cones, material } => {
                let cone = cones.get(primitive as usize)?;
                thickness = cone.width() * instance.world_from_local().linear.x_axis.length();
                let normal = instance.world_normal(cone.normal(instance.to_local(p)));
                SurfaceAttributes {
                    normal,
                    smooth_normal: normal,
                    uv: Vec2::ZERO,
                    color: cone.color.map(Vec3::from_array),
                    material: *material,
                    edges: [Vec3::X; 2],
                    uv_edges: [Vec2::ZERO; 2],
                }
            }
        };
        // Filter width of textures: the width of the sample on the surface, in texture coordinates.
        let width = footprint(spread * t * direction.length(), attributes.edges, attributes.uv_edges);
        // Both normals are turned to the side of the viewer; only water needs to know the side.
        let is_outside = attributes.normal.dot(direction) <= 0.0;
        let side = if is_outside { 1.0 } else { -1.0 };
        let mut shading_normal = self.mapped_normal(&attributes, width) * side;
        // Normal maps and interpolated normals may turn away from the viewer near the silhouette,
        // where reflection would be black: such a normal is bent back until its cosine to the
        // viewer is at least MIN_VIEW_COSINE.
        let to_viewer = -normalize_or(direction, Vec3::Z);
        let cosine = shading_normal.dot(to_viewer);
        if cosine < MIN_VIEW_COSINE {
            shading_normal =
                normalize_or(shading_normal + to_viewer * (MIN_VIEW_COSINE - cosine), attributes.normal * side);
        }
        // The colours at the vertices of a mesh multiply the colour or texture of the material; those of points replace it. The coat
        // acts on either.
        let mut shading = self.materials.shading(attributes.material, attributes.uv, width);
        if let Some(color) = attributes.color {
            shading.albedo = match solid.kind {
                Primitives::Triangles { .. } => shading.albedo * color,
                Primitives::Cones { .. } => color,
            };
        }
        if let Some(coat) = self.coat(attributes.material) {
            coat.apply(&mut shading, attributes.uv, width);
        }
        // An opaque hair transmits nothing to its far side.
        let thickness = if shading.translucency > 0.0 { thickness } else { 0.0 };
        let normal = attributes.normal * side;
        Some(SurfaceInteraction {
            p,
            normal,
            shading_normal,
            is_outside,
            thickness,
            shading,
            material: attributes.material,
        })
    }

    fn coat(&self, material: MaterialId) -> Option<&CoatMap> {
        self.coats.get(material as usize)?.as_ref()
    }

    /// The interpolated normal, perturbed by the normal map of the material. The map's x runs along
    /// growing u, its y along growing v.
    fn mapped_normal(&self, s: &SurfaceAttributes, width: f32) -> Vec3 {
        let Some(m) = self.materials.normal_map(s.material, s.uv, width) else { return s.smooth_normal };
        // Tangent vectors dp/du and dp/dv of the triangle: the solution of e = dp/du * d.x + dp/dv
        // * d.y for both edges.
        let ([e1, e2], [d1, d2]) = (s.edges, s.uv_edges);
        let det = d1.perp_dot(d2);
        if det.abs() < 1e-20 {
            return s.smooth_normal;
        }
        let dp_du = (e1 * d2.y - e2 * d1.y) / det;
        let dp_dv = (e2 * d1.x - e1 * d2.x) / det;
        // Gram-Schmidt: an orthonormal frame about the interpolated normal.
        let n = s.smooth_normal;
        let tangent = normalize_or(dp_du - n * n.dot(dp_du), Vec3::X);
        let bitangent = normalize_or(dp_dv - n * n.dot(dp_dv) - tangent * tangent.dot(dp_dv), Vec3::Z);
        normalize_or(tangent * m.x + bitangent * m.y + n * m.z, n)
    }

    /// Geometric unit normal of a hit on the outside: that of the triangle, or of the cone at `p`.
    pub(super) fn outer_normal(&self, hit: &SceneHit, p: Vec3) -> Vec3 {
        let Some((instance, solid)) = self.hit_instance(hit) else { return Vec3::Y };
        let i = hit.primitive.primitive as usize;
        let n = match &solid.kind {
            Primitives::Triangles { triangles, .. } => triangles.get(i).map(RayTriangle::normal),
            Primitives::Cones { cones, .. } => cones.get(i).map(|cone| cone.normal(instance.to_local(p))),
        };
        instance.world_normal(n.unwrap_or(Vec3::Y))
    }

    /// Mean colour and normal at a hit, without any texture look-up. `direction`: of the ray that hit it.
    pub(super) fn mean_surface(&self, hit: &SceneHit, direction: Vec3) -> MeanSurface {
        let Some((instance, solid)) = self.hit_instance(hit) else {
            return MeanSurface { color: Vec3::ZERO, normal: Vec3::Y };
        };
        let (n, color) = match &solid.kind {
            Primitives::Triangles { triangles, vertices } => match triangles.get(hit.primitive.primitive as usize) {
                Some(triangle) => {
                    let color = vertex_color(vertices, vertices.corners(triangle), hit.primitive.barycentric);
                    (triangle.normal(), self.materials.mean_color(triangle.material) * color.unwrap_or(Vec3::ONE))
                }
                None => (Vec3::Y, Vec3::ZERO),
            },
            Primitives::Cones { cones, material } => {
                let own = cones.get(hit.primitive.primitive as usize).and_then(|c| c.color);
                (-direction, own.map_or_else(|| self.materials.mean_color(*material), Vec3::from_array))
            }
        };
        let n = instance.world_normal(n);
        MeanSurface { color, normal: if n.dot(direction) > 0.0 { -n } else { n } }
    }
}

/// Attributes at a point of a triangle: interpolated, with normals and edges transformed to the world.
fn triangle_attributes(
    instance: &SolidInstance,
    triangle: &RayTriangle,
    vertices: &VertexData<'_>,
    barycentric: Vec2,
) -> SurfaceAttributes {
    let corners = vertices.corners(triangle);
    let normal = instance.world_normal(triangle.normal());
    let world_from_local = instance.world_from_local().linear;
    let (u, v) = (barycentric.x, barycentric.y);
    let [na, nb, nc] = corners.map(|i| vertices.normals.get(i).copied().unwrap_or(Vec3::ZERO));
    // Meshes without normals, or with opposite ones that cancel, are shaded flat.
    let smooth = na * (1.0 - u - v) + nb * u + nc * v;
    let smooth_normal = if smooth.length_squared() > 1e-12 { instance.world_normal(smooth) } else { normal };
    let [ua, ub, uc] = corners.map(|i| vertices.uvs.get(i).copied().unwrap_or_default());
    SurfaceAttributes {
        normal,
        smooth_normal,
        uv: vertices.uv(triangle, barycentric),
        color: vertex_color(vertices, corners, barycentric),
        material: triangle.material,
        edges: triangle.edges().map(|e| world_from_local * e),
        uv_edges: [ub - ua, uc - ua],
    }
}

/// Interpolated linear vertex colour; `None` for a mesh without.
fn vertex_color(vertices: &VertexData<'_>, corners: [usize; 3], barycentric: Vec2) -> Option<Vec3> {
    if vertices.colors.is_empty() {
        return None;
    }
    let [a, b, c] = corners.map(|i| vertices.colors.get(i).map_or(Vec3::ONE, |c| Vec3::new(c[0], c[1], c[2])));
    Some(a + (b - a) * barycentric.x + (c - a) * barycentric.y)
}
