//! Geometry in the space of an asset or prototype: triangles, points as balls and curves as round cones, each solid with its
//! bounding volume hierarchy (BVH). Instances of it share one [`Solid`].

use std::borrow::Cow;
use std::time::Duration;

use glam::{Vec2, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::Ray;

use super::detail::{MIN_CLUSTERED_AREA, MeshDetail, cluster_vertices, keep_thin_parts};
use super::materials::{AlphaSample, PreviewMaterials};
use super::round_cone::RoundCone;
use osier_base::math;
use osier_base::par::par_chunks;
use osier_scene::{Curves, MaterialId, Mesh, PointsNow};

/// Triangles of the largest mesh whose instances get boxes around their transformed corners. The boxes of larger
/// meshes enclose the transformed box of the solid: looser, but without a copy of every corner.
const MAX_TIGHT_BOX_TRIANGLES: usize = 500;
/// Opacity of a motion-blurred drop that moves by its own radius. Own: chosen by eye, 0 to 2; larger ones make rain
/// denser.
const STREAK_OPACITY: f32 = 0.6;
/// Radius at the ends of a streak relative to its middle: a drop is at each end for the shortest part of the exposure.
const STREAK_END_RADIUS: f32 = 0.1;
/// Most primitives for a BVH of high, of medium and of low build effort: small trees take little time to build and are traversed
/// often, the largest would delay the picture by seconds.
const BUILD_EFFORT: [usize; 3] = [4_000, 100_000, 1_500_000];

/// A triangle in the form that the intersection test needs: a corner and two edges.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayTriangle {
    /// First corner, in the space of the solid.
    pub(super) a: Vec3,
    /// Edge from the first corner to the second.
    ab: Vec3,
    /// Edge from the first corner to the third.
    ac: Vec3,
    /// Index into the mesh's triangles.
    pub(super) index: u32,
    pub(super) material: MaterialId,
}

/// Intersection of a ray with a primitive of a solid.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PrimitiveHit {
    /// Distance along the ray, as a multiple of the length of its direction.
    pub(super) t: f32,
    /// Index of the primitive in the order of the BVH.
    pub(super) primitive: u32,
    /// Barycentric coordinates of the second and third corner of a triangle; zero for cones.
    pub(super) barycentric: Vec2,
}

/// Primitives of a solid, all of one kind.
#[derive(Debug)]
pub(super) enum Primitives<'a> {
    Triangles { triangles: Vec<RayTriangle>, vertices: VertexData<'a> },
    Cones { cones: Vec<RoundCone>, material: MaterialId },
}

/// Attributes of vertices, interpolated over triangles.
#[derive(Debug)]
pub(super) struct VertexData<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    /// Index of the vertex that replaces each after clustering; empty without clustering.
    replacements: Vec<u32>,
    /// Kept for rasterisation only; empty for solids with a BVH.
    pub(super) points: Vec<Vec3>,
    pub(super) normals: Cow<'a, [Vec3]>,
    pub(super) uvs: &'a [Vec2],
    pub(super) colors: &'a [[f32; 4]],
}

/// Primitives of one mesh, cloud or set of curves, with their BVH.
#[derive(Debug)]
pub(super) struct Solid<'a> {
    pub(super) kind: Primitives<'a>,
    /// Empty if the scene is rasterised.
    bvh: CwBvh,
    /// Lower and upper corner of the box around all primitives; `None` without any.
    bounds: Option<[Vec3; 2]>,
    /// Width of the smallest visible detail in texture coordinates, if the alpha of a texture cuts some triangles out.
    pub(super) cutout_footprint: Option<f32>,
    /// Sum of its triangles' areas, m2; zero for cones.
    pub(super) area: f32,
    /// Corners of all triangles for tight boxes around instances; empty beyond [`MAX_TIGHT_BOX_TRIANGLES`].
    pub(super) corners: Vec<Vec3>,
}

impl<'a> Solid<'a> {
    /// A mesh with the points and normals of the frame.
    pub(super) fn of_mesh(
        mesh: &'a Mesh,
        points: &[Vec3],
        normals: Cow<'a, [Vec3]>,
        materials: &PreviewMaterials,
        with_bvh: bool,
        detail: MeshDetail,
    ) -> Self {
        let mut replacements = cluster_vertices(points, detail.cluster_size);
        keep_thin_parts(&mesh.triangles, points, detail.cluster_size, &mut replacements);
        let mut triangles = prepare_triangles(mesh, points, &replacements);
        // Needles are thinner than a cluster and would vanish: a mesh that would lose most of its area is not clustered.
        if !replacements.is_empty() {
            let whole = prepare_triangles(mesh, points, &[]);
            if area(&triangles) < MIN_CLUSTERED_AREA * area(&whole) {
                (replacements, triangles) = (Vec::new(), whole);
            }
        }
        let Bvh { primitives: triangles, bvh, bounds } = build_bvh(triangles, with_bvh, RayTriangle::bounds);
        let area = area(&triangles);
        // One width for the whole mesh: that of the smallest visible detail, scaled by the mean
        // ratio of texture to surface.
        let has_cutout = mesh.subsets.iter().any(|s| materials.has_alpha_cutout(s.material));
        let cutout_footprint =
            has_cutout.then(|| detail.smallest * math::sqrt_f32(uv_area(mesh) / f32::max(area, f32::MIN_POSITIVE)));
        let kept = if with_bvh { Vec::new() } else { points.to_vec() };
        let vertices = VertexData {
            triangles: &mesh.triangles,
            replacements,
            points: kept,
            normals,
            uvs: &mesh.uvs,
            colors: &mesh.colors,
        };
        let is_small = with_bvh && triangles.len() <= MAX_TIGHT_BOX_TRIANGLES;
        let corners = if is_small { triangles.iter().flat_map(RayTriangle::corners).collect() } else { Vec::new() };
        Self { kind: Primitives::Triangles { triangles, vertices }, bvh, bounds, cutout_footprint, area, corners }
    }

    /// Points as balls; points of width 0 are left out.
    pub(super) fn of_points(material: MaterialId, now: PointsNow<'_>, with_bvh: bool) -> Self {
        let color = |i: usize| now.colors.get(i).copied();
        let visible = now.positions.iter().zip(now.widths).enumerate().filter(|(_, (_, w))| **w > 0.0);
        let balls = visible.map(|(i, (p, w))| RoundCone::ball(*p, w * 0.5, color(i))).collect();
        Self::of_cones(balls, material, with_bvh)
    }

    /// Falling drops as motion-blurred streaks over `shutter` seconds: translucent double cones, since a drop covers each point
    /// of its path only for a part of the exposure.
    pub(super) fn of_drops(material: MaterialId, now: PointsNow<'_>, shutter: f32, with_bvh: bool) -> Self {
        let visible = now.positions.iter().zip(now.widths).zip(now.velocities).filter(|((_, w), _)| **w > 0.0);
        let streaks = visible.flat_map(|((p, w), v)| {
            // Half of the drop's path during the exposure; a drop that moves less than its radius is drawn as a ball.
            let (half, radius) = (*v * (shutter * 0.5), w * 0.5);
            if half.length() < w * 0.5 {
                return vec![RoundCone::ball(*p, radius, None)];
            }
            // Motion blur spreads the drop along its path, so opacity falls with the streak's length.
            let opacity = (STREAK_OPACITY * radius / half.length()).min(1.0);
            let cone =
                |end: Vec3| RoundCone::new([*p, end], [radius, radius * STREAK_END_RADIUS]).with_opacity(opacity);
            vec![cone(*p + half), cone(*p - half)]
        });
        Self::of_cones(streaks.collect(), material, with_bvh)
    }

    /// Curves as chains of round cones.
    pub(super) fn of_curves(curves: &Curves, points: &[Vec3], with_bvh: bool) -> Self {
        let mut cones = Vec::with_capacity(points.len());
        let mut first = 0;
        for count in &curves.counts {
            let end = (first + *count as usize).min(points.len());
            // A curve of n points has n - 1 segments, each with the radii of its ends.
            for i in first..end.saturating_sub(1) {
                let radius = |k: usize| curves.widths.get(k).map_or(0.0, |w| w * 0.5);
                cones.push(RoundCone::new([points[i], points[i + 1]], [radius(i), radius(i + 1)]));
            }
            first = end;
        }
        Self::of_cones(cones, curves.material, with_bvh)
    }

    fn of_cones(cones: Vec<RoundCone>, material: MaterialId, with_bvh: bool) -> Self {
        let Bvh { primitives: cones, bvh, bounds } = build_bvh(cones, with_bvh, RoundCone::bounds);
        let kind = Primitives::Cones { cones, material };
        Self { kind, bvh, bounds, cutout_footprint: None, area: 0.0, corners: Vec::new() }
    }

    /// Lower and upper corner of the box around all primitives; `None` without any.
    pub(super) fn bounds(&self) -> Option<[Vec3; 2]> {
        self.bounds
    }

    /// False for a ray, in the space of the solid, that misses its box. The test is cheaper than the root of the BVH, and most
    /// rays that hit the axis-aligned world box of a tilted leaf miss the box in the leaf's space.
    #[inline]
    pub(super) fn hits_bounds(&self, ray: &Ray) -> bool {
        let b = &self.bvh.total_aabb;
        // Slab test; a slack keeps flat leaves whose box has no thickness.
        let slack = (b.max - b.min).max_element() * 1e-3;
        let (t1, t2) =
            ((b.min - slack - ray.origin) * ray.inv_direction, (b.max + slack - ray.origin) * ray.inv_direction);
        // The ray is inside of all three slabs between the latest entry and the earliest exit.
        let (enter, leave) = (t1.min(t2).max_element().max(ray.tmin), t1.max(t2).min_element().min(ray.tmax));
        enter <= leave
    }

    /// Number of triangles or of cones.
    pub(super) fn len(&self) -> usize {
        match &self.kind {
            Primitives::Triangles { triangles, .. } => triangles.len(),
            Primitives::Cones { cones, .. } => cones.len(),
        }
    }

    /// The closest intersection within the range of the ray.
    pub(super) fn closest_hit(&self, ray: Ray, materials: &PreviewMaterials) -> Option<PrimitiveHit> {
        let mut best = None;
        let mut hit = obvhs::ray::RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, i| match self.intersect(ray, i, materials) {
            Some(hit) if hit.t < ray.tmax => {
                best = Some(hit);
                hit.t
            }
            _ => f32::INFINITY,
        });
        best
    }

    /// Any intersection within the range of the ray: the first that the traversal finds.
    pub(super) fn any_hit(&self, ray: Ray, materials: &PreviewMaterials) -> Option<PrimitiveHit> {
        let mut found = None;
        let mut hit = obvhs::ray::RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, i| match (&found, self.intersect(ray, i, materials)) {
            (None, Some(hit)) => {
                found = Some(hit);
                // A hit at the lower end of the range ends the traversal.
                ray.tmin
            }
            _ => f32::INFINITY,
        });
        found
    }

    /// True if nothing opaque lies within the range of a shadow ray.
    pub(super) fn is_unoccluded(&self, ray: Ray, materials: &PreviewMaterials) -> bool {
        let transmittance = match &self.kind {
            Primitives::Cones { material, .. } => materials.hair_transmittance(*material),
            Primitives::Triangles { .. } => 0.0,
        };
        self.bvh.ray_traverse_miss(ray, |ray, i| match self.intersect(ray, i, materials) {
            // Caustics are not computed: water focuses light in one place and lacks it in another,
            // so on average it casts no shadow.
            Some(_) if self.is_water(i, materials) => f32::INFINITY,
            // Hair transmits a fraction of the light: a random choice per ray and hair has that
            // mean.
            Some(hit) if transmittance <= 0.0 || random_unit(ray, i) >= transmittance => hit.t,
            _ => f32::INFINITY,
        })
    }

    fn is_water(&self, i: usize, materials: &PreviewMaterials) -> bool {
        match &self.kind {
            Primitives::Triangles { triangles, .. } => triangles.get(i).is_some_and(|f| materials.is_water(f.material)),
            Primitives::Cones { material, .. } => materials.is_water(*material),
        }
    }

    /// Intersection with primitive `i` in the order of the BVH. Also `None` where a texture cuts it out, and for a random
    /// share 1 - opacity of the rays that meet a cone.
    #[inline]
    pub(super) fn intersect(&self, ray: &Ray, i: usize, materials: &PreviewMaterials) -> Option<PrimitiveHit> {
        let primitive = u32::try_from(i).ok()?;
        match &self.kind {
            Primitives::Triangles { triangles, vertices } => {
                let triangle = triangles.get(i)?;
                let TriangleHit { t, barycentric } = triangle.intersect(ray)?;
                let is_opaque = self.cutout_footprint.is_none_or(|width| {
                    materials.is_opaque_at(triangle.material, || vertices.alpha_sample(triangle, barycentric, width))
                });
                is_opaque.then_some(PrimitiveHit { t, primitive, barycentric })
            }
            Primitives::Cones { cones, .. } => {
                let cone = cones.get(i)?;
                let t = cone.intersect(ray)?;
                (cone.opacity() >= 1.0 || random_unit(ray, i) < cone.opacity()).then_some(PrimitiveHit {
                    t,
                    primitive,
                    barycentric: Vec2::ZERO,
                })
            }
        }
    }

    /// Intersection with primitive `i` that rasterisation found visible: for a triangle the intersection with its
    /// plane, as rounding may put the ray just beside it.
    pub(super) fn project_hit(&self, ray: &Ray, i: usize) -> Option<PrimitiveHit> {
        let primitive = u32::try_from(i).ok()?;
        match &self.kind {
            Primitives::Triangles { triangles, .. } => {
                let TriangleHit { t, barycentric } = triangles.get(i)?.intersect_plane(ray);
                (t.is_finite() && barycentric.is_finite()).then_some(PrimitiveHit { t, primitive, barycentric })
            }
            Primitives::Cones { cones, .. } => {
                Some(PrimitiveHit { t: cones.get(i)?.intersect(ray)?, primitive, barycentric: Vec2::ZERO })
            }
        }
    }
}

/// Intersection of a ray with a triangle or its plane.
#[derive(Debug, Clone, Copy)]
struct TriangleHit {
    /// Distance along the ray, as a multiple of the length of its direction.
    t: f32,
    /// Coordinates of the second and third corner.
    barycentric: Vec2,
}

impl RayTriangle {
    /// The intersection within the range of the ray, from either side.
    /// Source: T. Moeller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", JGT 2(1), 1997.
    #[inline]
    fn intersect(&self, ray: &Ray) -> Option<TriangleHit> {
        let (origin, direction) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        // Cramer's rule for origin + t direction = a + u ab + v ac.
        let p = direction.cross(self.ac);
        let det = self.ab.dot(p);
        let inverse = 1.0 / det;
        let s = origin - self.a;
        let u = s.dot(p) * inverse;
        // These comparisons are false for the NaN of a triangle seen edge-on.
        if !(0.0..=1.0).contains(&u) {
            return None;
        }
        let q = s.cross(self.ab);
        let v = direction.dot(q) * inverse;
        if !(v >= 0.0 && u + v <= 1.0) {
            return None;
        }
        let t = self.ac.dot(q) * inverse;
        (t >= ray.tmin && t <= ray.tmax).then_some(TriangleHit { t, barycentric: Vec2::new(u, v) })
    }

    /// The intersection with the plane of the triangle, by Cramer's rule as above but without the tests.
    fn intersect_plane(&self, ray: &Ray) -> TriangleHit {
        let (s, direction) = (Vec3::from(ray.origin) - self.a, Vec3::from(ray.direction));
        let (p, q) = (direction.cross(self.ac), s.cross(self.ab));
        let inverse = 1.0 / self.ab.dot(p);
        let barycentric = Vec2::new(s.dot(p), direction.dot(q)) * inverse;
        TriangleHit { t: self.ac.dot(q) * inverse, barycentric }
    }

    fn corners(&self) -> [Vec3; 3] {
        [self.a, self.a + self.ab, self.a + self.ac]
    }

    fn bounds(&self) -> [Vec3; 2] {
        let [a, b, c] = self.corners();
        [a.min(b).min(c), a.max(b).max(c)]
    }

    /// Twice the triangle's area times its unit normal; counter-clockwise is outside.
    pub(super) fn normal(&self) -> Vec3 {
        self.ab.cross(self.ac)
    }

    /// Edges from the first corner to the second and to the third.
    pub(super) fn edges(&self) -> [Vec3; 2] {
        [self.ab, self.ac]
    }
}

impl VertexData<'_> {
    /// Indices of the corners of a triangle after clustering.
    pub(super) fn corners(&self, triangle: &RayTriangle) -> [usize; 3] {
        let own = self.triangles.get(triangle.index as usize).copied().unwrap_or_default();
        own.map(|i| self.replacements.get(i as usize).copied().unwrap_or(i) as usize)
    }

    /// Interpolated texture coordinates; zero for a mesh without.
    pub(super) fn uv(&self, triangle: &RayTriangle, barycentric: Vec2) -> Vec2 {
        let [a, b, c] = self.corner_uvs(triangle);
        a + (b - a) * barycentric.x + (c - a) * barycentric.y
    }

    /// Where the alpha of a triangle is tested. `width`: of the smallest visible detail of the mesh in texture coordinates. A triangle
    /// whose corners share one place of the texture, as those of stalks do, has the alpha of that place from any distance: the mean
    /// around it would cut out a stalk that is coloured from the narrow foot of a blade.
    pub(super) fn alpha_sample(&self, triangle: &RayTriangle, barycentric: Vec2, width: f32) -> AlphaSample {
        let [a, b, c] = self.corner_uvs(triangle);
        let footprint = if a == b && b == c { 0.0 } else { width };
        AlphaSample { uv: a + (b - a) * barycentric.x + (c - a) * barycentric.y, footprint }
    }

    /// Texture coordinates of the corners of a triangle; zero for a mesh without.
    fn corner_uvs(&self, triangle: &RayTriangle) -> [Vec2; 3] {
        self.corners(triangle).map(|i| self.uvs.get(i).copied().unwrap_or_default())
    }
}

/// Total area of a mesh's triangles in texture coordinates.
fn uv_area(mesh: &Mesh) -> f32 {
    let corner = |i: u32| mesh.uvs.get(i as usize).copied().unwrap_or_default();
    let area = |[a, b, c]: [Vec2; 3]| 0.5 * (b - a).perp_dot(c - a).abs();
    mesh.triangles.iter().map(|t| area(t.map(corner))).sum()
}

fn area(triangles: &[RayTriangle]) -> f32 {
    triangles.iter().map(|f| 0.5 * f.normal().length()).sum()
}

/// The triangles of a mesh without those that clustering collapsed into lines or points.
fn prepare_triangles(mesh: &Mesh, points: &[Vec3], replacements: &[u32]) -> Vec<RayTriangle> {
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    for subset in &mesh.subsets {
        for (i, t) in (subset.first..).zip(mesh.subset_triangles(subset)) {
            let t = t.map(|k| replacements.get(k as usize).copied().unwrap_or(k));
            if !replacements.is_empty() && (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
                continue;
            }
            // Points come from the frame, indices from the mesh at rest.
            let [a, b, c] = t.map(|k| points.get(k as usize).copied().unwrap_or_default());
            let triangle = RayTriangle { a, ab: b - a, ac: c - a, index: i, material: subset.material };
            // Triangles that have not grown yet lie in one point: no ray can hit them, and a BVH
            // cannot separate boxes in one place.
            if triangle.ab.cross(triangle.ac) != Vec3::ZERO {
                triangles.push(triangle);
            }
        }
    }
    triangles
}

/// Primitives with a BVH over their boxes.
pub(super) struct Bvh<T> {
    /// In the order of the leaves of the BVH.
    pub(super) primitives: Vec<T>,
    pub(super) bvh: CwBvh,
    /// Lower and upper corner of the box around all; `None` without any.
    pub(super) bounds: Option<[Vec3; 2]>,
}

/// Builds the BVH of a list; without `with_bvh` only the box around all is computed and the order is kept.
pub(super) fn build_bvh<T: Copy + Sync>(
    list: Vec<T>,
    with_bvh: bool,
    bounds: impl Fn(&T) -> [Vec3; 2] + Sync + Send,
) -> Bvh<T> {
    let around = |boxes: &[[Vec3; 2]]| boxes.iter().copied().reduce(|[lo, hi], [min, max]| [lo.min(min), hi.max(max)]);
    if !with_bvh {
        // The union of boxes is exact, so chunks may be joined in any grouping.
        let parts = par_chunks(&list, 1 << 14, |_, c| around(&c.iter().map(&bounds).collect::<Vec<_>>()));
        let bounds = around(&parts.into_iter().flatten().collect::<Vec<_>>());
        return Bvh { primitives: list, bvh: CwBvh::default(), bounds };
    }
    if list.is_empty() {
        return Bvh { primitives: list, bvh: CwBvh::default(), bounds: None };
    }
    let bound = |[min, max]: [Vec3; 2]| Aabb::new(Vec3A::from(min), Vec3A::from(max));
    // Boxes are computed in parallel, in the order of the list: the BVH is the same with any number
    // of threads.
    let boxes: Vec<Aabb> =
        par_chunks(&list, 1 << 14, |_, c| c.iter().map(|t| bound(bounds(t))).collect::<Vec<_>>()).concat();
    let effort = match BUILD_EFFORT.iter().position(|n| list.len() <= *n) {
        Some(0) => BvhBuildParams::slow_build(),
        Some(1) => BvhBuildParams::medium_build(),
        Some(_) => BvhBuildParams::fast_build(),
        None => BvhBuildParams::very_fast_build(),
    };
    let bvh = build_cwbvh(&boxes, effort, &mut Duration::default());
    // Primitives are stored in the order of the leaves, so that a leaf reads consecutive memory and
    // no index table.
    let primitives = bvh.primitive_indices.iter().filter_map(|i| list.get(*i as usize).copied()).collect();
    let all = bvh.total_aabb;
    Bvh { primitives, bvh, bounds: Some([all.min.into(), all.max.into()]) }
}

/// A pseudorandom number in [0, 1) that depends only on the ray and the primitive: the same for every thread and traversal order.
fn random_unit(ray: &Ray, primitive: usize) -> f32 {
    let bits = |v: f32| u64::from(v.to_bits());
    let (o, d) = (ray.origin, ray.direction);
    // Bits of the ray, not of the pixel: rays that start at one surface must not agree on every
    // hair.
    let key = osier_base::rng::mix64(&[bits(o.x) << 32 | bits(o.y), bits(o.z) << 32 | bits(d.x), primitive as u64]);
    (key >> 40) as f32 / (1_u64 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quality;
    use crate::testing::{material, scene_of};
    use osier_scene::{Image, ImageKind, Maps, Material, Pixels};

    #[test]
    fn a_part_of_one_texel_is_not_cut_out_from_afar() {
        // One opaque texel in the upper left corner of a transparent picture.
        let mut pixels = vec![0; 8 * 8 * 4];
        pixels[3] = 255;
        let name = "foot".into();
        let image =
            Image { name, kind: ImageKind::Color, width: 8, height: 8, channels: 4, pixels: Pixels::U8(pixels) };
        let maps = Maps { color: Some(0), ..Maps::default() };
        let mut scene = scene_of(vec![Material { alpha_cutoff: Some(0.5), maps, ..material(0.5, 0.0, 1.5) }]);
        scene.images = vec![image];
        let materials = PreviewMaterials::new(&scene, Quality::Normal);
        // A stalk coloured from that texel, and a blade that shows the whole picture.
        let stalk = [Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::Y];
        let blade = [Vec3::X * 2.0, Vec3::X * 3.0, Vec3::new(2.0, 1.0, 0.0)];
        let mesh = Mesh {
            points: [stalk, blade].concat(),
            normals: vec![Vec3::Z; 6],
            uvs: [[Vec2::new(0.5 / 8.0, 7.5 / 8.0); 3], [Vec2::ZERO, Vec2::X, Vec2::Y]].concat(),
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..Mesh::default()
        }
        .with_material(0);
        for smallest in [0.0, 2.0] {
            let detail = MeshDetail { smallest, cluster_size: 0.0 };
            let solid = Solid::of_mesh(&mesh, &mesh.points, Cow::Borrowed(&mesh.normals), &materials, true, detail);
            let is_hit = |x: f32, y: f32| {
                let ray = Ray::new(Vec3A::new(x, y, 1.0), Vec3A::NEG_Z, 0.0, f32::INFINITY);
                solid.closest_hit(ray, &materials).is_some()
            };
            assert!(is_hit(0.0, 0.0) && !is_hit(2.3, 0.3), "details of {smallest}");
        }
    }

    #[test]
    fn falling_water_is_met_by_few_rays_and_a_drop_at_rest_by_all() {
        let materials = PreviewMaterials::new(&scene_of(Vec::new()), Quality::Normal);
        let met = |velocity: Vec3, y: f32| {
            let now = PointsNow { positions: &[Vec3::ZERO], widths: &[0.002], velocities: &[velocity], colors: &[] };
            let solid = Solid::of_drops(0, now, 0.005, true);
            let hit = |i: u16| {
                let from = Vec3A::new(0.0, y + 1e-6 * f32::from(i), 1.0);
                solid.closest_hit(Ray::new(from, Vec3A::NEG_Z, 0.0, f32::INFINITY), &materials).is_some()
            };
            (solid.len(), (0..800).filter(|i| hit(*i)).count())
        };
        assert_eq!(met(Vec3::ZERO, 0.0), (1, 800));
        // 30 mm long and 2 mm wide: 0.6 / 15 of the light is hidden.
        let (cones, hidden) = met(Vec3::NEG_Y * 6.0, 0.005);
        assert!(cones == 2 && (16..=64).contains(&hidden), "{hidden}");
    }
}
