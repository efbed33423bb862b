//! What rays meet: triangles, points as balls, and curves as round cones, each kind with its tree of boxes.

use std::borrow::Cow;
use std::time::Duration;

use glam::{Vec2, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::Ray;

use super::cone::RoundCone;
use super::grain::{Detail, merged};
use super::looks::Looks;
use osier_base::math;
use osier_base::par::par_chunks;
use osier_scene::{Curves, MaterialId, Mesh, PointsNow};

/// Meshes of no more triangles than this have boxes fitted to each showing.
const HULL: usize = 500;
/// How much of what is behind it a streak of water hides, were it as long as wide. Own: chosen by eye, 0..2.
const VEIL: f32 = 0.6;
/// Radius of its ends, in radii of its middle.
const POINTED: f32 = 0.1;
/// Up to how many things are sorted slowly, fairly and fast.
const SORTING: [usize; 3] = [4_000, 100_000, 1_500_000];

/// A triangle as rays want it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// First corner.
    pub(super) a: Vec3,
    /// From the first corner to the second and the third.
    ab: Vec3,
    ac: Vec3,
    /// Index into the mesh's triangles.
    pub(super) triangle: u32,
    pub(super) material: MaterialId,
}

/// Where in a primitive a ray meets it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PrimitiveHit {
    /// Along the ray, in lengths of its direction.
    pub(super) t: f32,
    /// Primitive in the order of the tree.
    pub(super) primitive: u32,
    /// Weights of the second and third corner of a triangle.
    pub(super) at: Vec2,
}

/// Primitives of one kind.
#[derive(Debug)]
pub(super) enum Primitives<'a> {
    Faces { faces: Vec<Face>, mesh: CornerData<'a> },
    Cones { cones: Vec<RoundCone>, material: MaterialId },
}

/// What triangles look up at their corners.
#[derive(Debug)]
pub(super) struct CornerData<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    /// The point that stands for each; empty where each stands for itself.
    stand_ins: Vec<u32>,
    /// Empty for solids with boxes.
    pub(super) points: Vec<Vec3>,
    pub(super) normals: Cow<'a, [Vec3]>,
    pub(super) uvs: &'a [Vec2],
    pub(super) colors: &'a [[f32; 4]],
}

/// Primitives with their tree.
#[derive(Debug)]
pub(super) struct Solid<'a> {
    pub(super) kind: Primitives<'a>,
    /// Empty where no rays are cast.
    tree: CwBvh,
    /// Box of everything.
    bounds: Option<[Vec3; 2]>,
    /// Set if some triangles let rays through where a map says so: how wide the smallest detail that is seen is on that map,
    /// in texture coordinates.
    pub(super) cut: Option<f32>,
    /// Sum of its triangles' areas, m2; zero for cones.
    pub(super) area: f32,
    /// Corners, for close boxes around showings; empty where they would be too many.
    pub(super) hull: Vec<Vec3>,
}

impl<'a> Solid<'a> {
    /// A mesh with its points and normals of the moment.
    pub(super) fn of_mesh(
        mesh: &'a Mesh,
        points: &[Vec3],
        normals: Cow<'a, [Vec3]>,
        looks: &Looks,
        boxed: bool,
        detail: Detail,
    ) -> Self {
        let stand_ins = merged(points, detail.merged);
        let faces = faces_of(mesh, points, &stand_ins);
        let (faces, tree, bounds) = sorted(faces, boxed, Face::bounds);
        let area = faces.iter().map(|f| 0.5 * f.normal().length()).sum();
        let cut = mesh.subsets.iter().any(|s| looks.is_cut(s.material));
        let cut = cut.then(|| detail.seen * math::sqrt_f32(uv_area(mesh) / f32::max(area, f32::MIN_POSITIVE)));
        let kept = if boxed { Vec::new() } else { points.to_vec() };
        let skin = CornerData {
            triangles: &mesh.triangles,
            stand_ins,
            points: kept,
            normals,
            uvs: &mesh.uvs,
            colors: &mesh.colors,
        };
        let hull =
            if boxed && faces.len() <= HULL { faces.iter().flat_map(Face::corners).collect() } else { Vec::new() };
        Self { kind: Primitives::Faces { faces, mesh: skin }, tree, bounds, cut, area, hull }
    }

    /// Points as balls; those of no width are not there.
    pub(super) fn of_points(material: MaterialId, now: PointsNow<'_>, boxed: bool) -> Self {
        let color = |i: usize| now.colors.get(i).copied();
        let seen = now.positions.iter().zip(now.widths).enumerate().filter(|(_, (_, w))| **w > 0.0);
        let balls = seen.map(|(i, (p, w))| RoundCone::ball(*p, w * 0.5, color(i))).collect();
        Self::of_cones(balls, material, boxed)
    }

    /// Drops that fall, along their way in `shutter` seconds: veils that are pointed at both ends, as each drop is at each place
    /// for a part of the time only.
    pub(super) fn of_drops(material: MaterialId, now: PointsNow<'_>, shutter: f32, boxed: bool) -> Self {
        let seen = now.positions.iter().zip(now.widths).zip(now.velocities).filter(|((_, w), _)| **w > 0.0);
        let streaks = seen.flat_map(|((p, w), v)| {
            let (half, radius) = (*v * (shutter * 0.5), w * 0.5);
            if half.length() < w * 0.5 {
                return vec![RoundCone::ball(*p, radius, None)];
            }
            let share = (VEIL * radius / half.length()).min(1.0);
            let cone = |end: Vec3| RoundCone::new([*p, end], [radius, radius * POINTED]).veiled(share);
            vec![cone(*p + half), cone(*p - half)]
        });
        Self::of_cones(streaks.collect(), material, boxed)
    }

    /// Curves as chains of round cones.
    pub(super) fn of_curves(curves: &Curves, points: &[Vec3], boxed: bool) -> Self {
        let mut cones = Vec::with_capacity(points.len());
        let mut first = 0;
        for count in &curves.counts {
            let end = (first + *count as usize).min(points.len());
            for i in first..end.saturating_sub(1) {
                let radius = |k: usize| curves.widths.get(k).map_or(0.0, |w| w * 0.5);
                cones.push(RoundCone::new([points[i], points[i + 1]], [radius(i), radius(i + 1)]));
            }
            first = end;
        }
        Self::of_cones(cones, curves.material, boxed)
    }

    fn of_cones(cones: Vec<RoundCone>, material: MaterialId, boxed: bool) -> Self {
        let (cones, tree, bounds) = sorted(cones, boxed, RoundCone::bounds);
        Self { kind: Primitives::Cones { cones, material }, tree, bounds, cut: None, area: 0.0, hull: Vec::new() }
    }

    /// Box of everything, or none if there is nothing.
    pub(super) fn bounds(&self) -> Option<[Vec3; 2]> {
        self.bounds
    }

    /// False for a ray of the solid's own space that surely passes by: cheaper than to enter the tree, and most rays
    /// that meet the upright box around a tilted leaf pass by the leaf.
    #[inline]
    pub(super) fn is_near(&self, ray: &Ray) -> bool {
        let b = &self.tree.total_aabb;
        let slack = (b.max - b.min).max_element() * 1e-3;
        let (t1, t2) =
            ((b.min - slack - ray.origin) * ray.inv_direction, (b.max + slack - ray.origin) * ray.inv_direction);
        let (enter, leave) = (t1.min(t2).max_element().max(ray.tmin), t1.max(t2).min_element().min(ray.tmax));
        enter <= leave
    }

    /// Number of primitives.
    pub(super) fn len(&self) -> usize {
        match &self.kind {
            Primitives::Faces { faces, .. } => faces.len(),
            Primitives::Cones { cones, .. } => cones.len(),
        }
    }

    /// The nearest meeting within the ray's range.
    pub(super) fn nearest(&self, ray: Ray, looks: &Looks) -> Option<PrimitiveHit> {
        let mut best = None;
        let mut hit = obvhs::ray::RayHit::none();
        self.tree.ray_traverse(ray, &mut hit, |ray, i| match self.meet(ray, i, looks) {
            Some(spot) if spot.t < ray.tmax => {
                best = Some(spot);
                spot.t
            }
            _ => f32::INFINITY,
        });
        best
    }

    /// Any meeting within the ray's range, the first that is found.
    pub(super) fn any(&self, ray: Ray, looks: &Looks) -> Option<PrimitiveHit> {
        let mut found = None;
        let mut hit = obvhs::ray::RayHit::none();
        self.tree.ray_traverse(ray, &mut hit, |ray, i| match (&found, self.meet(ray, i, looks)) {
            (None, Some(spot)) => {
                found = Some(spot);
                // Nothing is nearer than this: the search ends.
                ray.tmin
            }
            _ => f32::INFINITY,
        });
        found
    }

    /// True if nothing lies within the ray's range.
    pub(super) fn lets_by(&self, ray: Ray, looks: &Looks) -> bool {
        let share = match &self.kind {
            Primitives::Cones { material, .. } => looks.passes(*material),
            Primitives::Faces { .. } => 0.0,
        };
        self.tree.ray_traverse_miss(ray, |ray, i| match self.meet(ray, i, looks) {
            // Water gathers light in one place and misses it in another: on the whole it passes.
            Some(_) if self.is_water(i, looks) => f32::INFINITY,
            Some(spot) if share <= 0.0 || chance(ray, i) >= share => spot.t,
            _ => f32::INFINITY,
        })
    }

    fn is_water(&self, i: usize, looks: &Looks) -> bool {
        match &self.kind {
            Primitives::Faces { faces, .. } => faces.get(i).is_some_and(|f| looks.is_water(f.material)),
            Primitives::Cones { material, .. } => looks.is_water(*material),
        }
    }

    /// The meeting with primitive `i` in the order of the tree.
    #[inline]
    pub(super) fn meet(&self, ray: &Ray, i: usize, looks: &Looks) -> Option<PrimitiveHit> {
        let primitive = u32::try_from(i).ok()?;
        match &self.kind {
            Primitives::Faces { faces, mesh } => {
                let face = faces.get(i)?;
                let (t, at) = face.meet(ray)?;
                let there = self.cut.is_none_or(|width| looks.is_kept(face.material, width, || mesh.uv(face, at)));
                there.then_some(PrimitiveHit { t, primitive, at })
            }
            Primitives::Cones { cones, .. } => {
                let cone = cones.get(i)?;
                let t = cone.meet(ray)?;
                (cone.share() >= 1.0 || chance(ray, i) < cone.share()).then_some(PrimitiveHit {
                    t,
                    primitive,
                    at: Vec2::ZERO,
                })
            }
        }
    }

    /// Where a ray meets primitive `i`, known to be met but for rounding.
    pub(super) fn spot(&self, ray: &Ray, i: usize) -> Option<PrimitiveHit> {
        let primitive = u32::try_from(i).ok()?;
        match &self.kind {
            Primitives::Faces { faces, .. } => {
                let (t, at) = faces.get(i)?.plane(ray);
                (t.is_finite() && at.is_finite()).then_some(PrimitiveHit { t, primitive, at })
            }
            Primitives::Cones { cones, .. } => {
                Some(PrimitiveHit { t: cones.get(i)?.meet(ray)?, primitive, at: Vec2::ZERO })
            }
        }
    }
}

impl Face {
    /// Source: T. Moeller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", JGT 2(1), 1997.
    #[inline]
    fn meet(&self, ray: &Ray) -> Option<(f32, Vec2)> {
        let (origin, direction) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let p = direction.cross(self.ac);
        let det = self.ab.dot(p);
        let inverse = 1.0 / det;
        let s = origin - self.a;
        let u = s.dot(p) * inverse;
        // Written so that NaN, from a triangle seen edge-on, is refused.
        if !(0.0..=1.0).contains(&u) {
            return None;
        }
        let q = s.cross(self.ab);
        let v = direction.dot(q) * inverse;
        if !(v >= 0.0 && u + v <= 1.0) {
            return None;
        }
        let t = self.ac.dot(q) * inverse;
        (t >= ray.tmin && t <= ray.tmax).then_some((t, Vec2::new(u, v)))
    }

    /// Where a ray meets the plane of the triangle: length along it, and weights of the second and third corner.
    fn plane(&self, ray: &Ray) -> (f32, Vec2) {
        let (s, direction) = (Vec3::from(ray.origin) - self.a, Vec3::from(ray.direction));
        let (p, q) = (direction.cross(self.ac), s.cross(self.ab));
        let inverse = 1.0 / self.ab.dot(p);
        (self.ac.dot(q) * inverse, Vec2::new(s.dot(p), direction.dot(q)) * inverse)
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

    /// Edges from the first corner.
    pub(super) fn edges(&self) -> [Vec3; 2] {
        [self.ab, self.ac]
    }
}

impl CornerData<'_> {
    pub(super) fn corners(&self, face: &Face) -> [usize; 3] {
        let own = self.triangles.get(face.triangle as usize).copied().unwrap_or_default();
        own.map(|i| self.stand_ins.get(i as usize).copied().unwrap_or(i) as usize)
    }

    /// Texture coordinates; zero for a mesh without.
    pub(super) fn uv(&self, face: &Face, at: Vec2) -> Vec2 {
        let [a, b, c] = self.corners(face).map(|i| self.uvs.get(i).copied().unwrap_or_default());
        a + (b - a) * at.x + (c - a) * at.y
    }
}

/// Area of a mesh's triangles on its maps, in texture coordinates.
fn uv_area(mesh: &Mesh) -> f32 {
    let corner = |i: u32| mesh.uvs.get(i as usize).copied().unwrap_or_default();
    let area = |[a, b, c]: [Vec2; 3]| 0.5 * (b - a).perp_dot(c - a).abs();
    mesh.triangles.iter().map(|t| area(t.map(corner))).sum()
}

/// Triangles of a mesh, those left out that merging made into lines.
fn faces_of(mesh: &Mesh, points: &[Vec3], stand_ins: &[u32]) -> Vec<Face> {
    let mut faces = Vec::with_capacity(mesh.triangles.len());
    for subset in &mesh.subsets {
        for (i, t) in (subset.first..).zip(mesh.subset_triangles(subset)) {
            let t = t.map(|k| stand_ins.get(k as usize).copied().unwrap_or(k));
            if !stand_ins.is_empty() && (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
                continue;
            }
            let [a, b, c] = t.map(|k| points.get(k as usize).copied().unwrap_or_default());
            faces.push(Face { a, ab: b - a, ac: c - a, triangle: i, material: subset.material });
        }
    }
    faces
}

/// Things in the order of their tree, the tree, and the box around all; in their own order with an empty tree if not
/// `boxed`.
pub(super) fn sorted<T: Copy + Sync>(
    list: Vec<T>,
    boxed: bool,
    bounds: impl Fn(&T) -> [Vec3; 2] + Sync + Send,
) -> (Vec<T>, CwBvh, Option<[Vec3; 2]>) {
    let around = |boxes: &[[Vec3; 2]]| boxes.iter().copied().reduce(|[lo, hi], [min, max]| [lo.min(min), hi.max(max)]);
    if !boxed {
        let parts = par_chunks(&list, 1 << 14, |_, c| around(&c.iter().map(&bounds).collect::<Vec<_>>()));
        let bounds = around(&parts.into_iter().flatten().collect::<Vec<_>>());
        return (list, CwBvh::default(), bounds);
    }
    if list.is_empty() {
        return (list, CwBvh::default(), None);
    }
    let bound = |[min, max]: [Vec3; 2]| Aabb::new(Vec3A::from(min), Vec3A::from(max));
    let boxes: Vec<Aabb> =
        par_chunks(&list, 1 << 14, |_, c| c.iter().map(|t| bound(bounds(t))).collect::<Vec<_>>()).concat();
    // How well boxes are sorted: few are sorted in no time and met by many rays.
    let rule = match SORTING.iter().position(|n| list.len() <= *n) {
        Some(0) => BvhBuildParams::slow_build(),
        Some(1) => BvhBuildParams::medium_build(),
        Some(_) => BvhBuildParams::fast_build(),
        None => BvhBuildParams::very_fast_build(),
    };
    let tree = build_cwbvh(&boxes, rule, &mut Duration::default());
    let arranged = tree.primitive_indices.iter().filter_map(|i| list.get(*i as usize).copied()).collect();
    let all = tree.total_aabb;
    (arranged, tree, Some([all.min.into(), all.max.into()]))
}

/// A number in 0..1 that only a ray and the hair or veil in its way decide.
fn chance(ray: &Ray, hair: usize) -> f32 {
    let bits = |v: f32| u64::from(v.to_bits());
    let (o, d) = (ray.origin, ray.direction);
    let key = osier_base::rng::mix64(&[bits(o.x) << 32 | bits(o.y), bits(o.z) << 32 | bits(d.x), hair as u64]);
    (key >> 40) as f32 / (1_u64 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quality;
    use crate::testing::scene_of;

    #[test]
    fn falling_water_is_met_by_few_rays_and_a_drop_at_rest_by_all() {
        let looks = Looks::new(&scene_of(Vec::new()), Quality::Normal);
        let met = |velocity: Vec3, y: f32| {
            let now = PointsNow { positions: &[Vec3::ZERO], widths: &[0.002], velocities: &[velocity], colors: &[] };
            let solid = Solid::of_drops(0, now, 0.005, true);
            let hit = |i: u16| {
                let from = Vec3A::new(0.0, y + 1e-6 * f32::from(i), 1.0);
                solid.nearest(Ray::new(from, Vec3A::NEG_Z, 0.0, f32::INFINITY), &looks).is_some()
            };
            (solid.len(), (0..800).filter(|i| hit(*i)).count())
        };
        assert_eq!(met(Vec3::ZERO, 0.0), (1, 800));
        // 30 mm long and 2 mm wide: 0.6 / 15 of the light is hidden.
        let (cones, hidden) = met(Vec3::NEG_Y * 6.0, 0.005);
        assert!(cones == 2 && (16..=64).contains(&hidden), "{hidden}");
    }
}
