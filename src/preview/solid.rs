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
use super::looks::Looks;
use super::quality::Quality;
use crate::par::par_chunks;
use crate::scene::{Curves, MaterialId, Mesh, PointsNow};

/// Meshes of no more triangles than this have boxes fitted to each showing.
const HULL: usize = 500;

/// A triangle as rays want it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// First corner.
    a: Vec3,
    /// From the first corner to the second and the third.
    ab: Vec3,
    ac: Vec3,
    /// Index into the mesh's triangles.
    pub(super) triangle: u32,
    pub(super) material: MaterialId,
}

/// Where in a primitive a ray meets it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spot {
    /// Along the ray, in lengths of its direction.
    pub(super) t: f32,
    /// Primitive in the order of the tree.
    pub(super) primitive: u32,
    /// Weights of the second and third corner of a triangle.
    pub(super) at: Vec2,
}

/// Primitives of one kind.
#[derive(Debug)]
pub(super) enum Kind<'a> {
    Faces { faces: Vec<Face>, mesh: Skin<'a> },
    Cones { cones: Vec<RoundCone>, material: MaterialId },
}

/// What triangles look up at their corners.
#[derive(Debug)]
pub(super) struct Skin<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) normals: Cow<'a, [Vec3]>,
    pub(super) uvs: &'a [Vec2],
    pub(super) colors: &'a [[f32; 4]],
}

/// Primitives with their tree.
#[derive(Debug)]
pub(super) struct Solid<'a> {
    pub(super) kind: Kind<'a>,
    tree: CwBvh,
    /// Primitives that share one box: neighbours in a mesh lie close together, and fewer boxes are sorted sooner.
    run: usize,
    /// Some triangles let rays through where a map says so.
    cut: bool,
    /// Corners, for close boxes around showings; empty where they would be too many.
    pub(super) hull: Vec<Vec3>,
}

impl<'a> Solid<'a> {
    /// A mesh with its points and normals of the moment.
    pub(super) fn of_mesh(mesh: &'a Mesh, points: &[Vec3], normals: Cow<'a, [Vec3]>, looks: &Looks) -> Self {
        let mut faces = faces_of(mesh, points);
        let run = if faces.len() > HULL { looks.quality.run() } else { 1 };
        // The last run is filled up with triangles that no ray meets.
        faces.resize(faces.len().next_multiple_of(run), Face::NOTHING);
        let runs: Vec<&[Face]> = faces.chunks(run).collect();
        let tree = tree_of(&runs, looks.quality, |run| Face::bounds(run));
        let faces: Vec<Face> = arrange(&runs, &tree).concat();
        let cut = mesh.subsets.iter().any(|s| looks.is_cut(s.material));
        let skin = Skin { triangles: &mesh.triangles, normals, uvs: &mesh.uvs, colors: &mesh.colors };
        let hull = if faces.len() <= HULL { faces.iter().flat_map(Face::corners).collect() } else { Vec::new() };
        Self { kind: Kind::Faces { faces, mesh: skin }, tree, run, cut, hull }
    }

    /// Points as balls; those of no width are not there.
    pub(super) fn of_points(material: MaterialId, now: PointsNow<'_>, quality: Quality) -> Self {
        let color = |i: usize| now.colors.get(i).copied();
        let seen = now.positions.iter().zip(now.widths).enumerate().filter(|(_, (_, w))| **w > 0.0);
        let balls = seen.map(|(i, (p, w))| RoundCone::ball(*p, w * 0.5, color(i))).collect();
        Self::of_cones(balls, material, quality)
    }

    /// Curves as chains of round cones.
    pub(super) fn of_curves(curves: &Curves, points: &[Vec3], quality: Quality) -> Self {
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
        Self::of_cones(cones, curves.material, quality)
    }

    fn of_cones(cones: Vec<RoundCone>, material: MaterialId, quality: Quality) -> Self {
        let tree = tree_of(&cones, quality, RoundCone::bounds);
        let cones = arrange(&cones, &tree);
        Self { kind: Kind::Cones { cones, material }, tree, run: 1, cut: false, hull: Vec::new() }
    }

    /// Box of everything, or none if there is nothing.
    pub(super) fn bounds(&self) -> Option<[Vec3; 2]> {
        let b = &self.tree.total_aabb;
        let empty = self.tree.nodes.is_empty() || self.tree.primitive_indices.is_empty();
        (!empty).then(|| [Vec3::from(b.min), Vec3::from(b.max)])
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
            Kind::Faces { mesh, .. } => mesh.triangles.len(),
            Kind::Cones { cones, .. } => cones.len(),
        }
    }

    /// The nearest meeting within the ray's range.
    pub(super) fn nearest(&self, ray: Ray, looks: &Looks) -> Option<Spot> {
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
    pub(super) fn any(&self, ray: Ray, looks: &Looks) -> Option<Spot> {
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
        self.tree.ray_traverse_miss(ray, |ray, i| self.meet(ray, i, looks).map_or(f32::INFINITY, |s| s.t))
    }

    /// The nearest meeting with the primitives of box `i`.
    #[inline]
    fn meet(&self, ray: &Ray, i: usize, looks: &Looks) -> Option<Spot> {
        match &self.kind {
            Kind::Faces { faces, mesh } => {
                let mut best: Option<Spot> = None;
                for primitive in i * self.run..(i + 1) * self.run {
                    let face = faces.get(primitive)?;
                    let Some((t, at)) = face.meet(ray) else { continue };
                    let there = || !looks.is_cut(face.material) || looks.is_there(face.material, mesh.uv(face, at));
                    if best.is_none_or(|b| t < b.t) && (!self.cut || there()) {
                        best = Some(Spot { t, primitive: u32::try_from(primitive).ok()?, at });
                    }
                }
                best
            }
            Kind::Cones { cones, .. } => {
                let t = cones.get(i)?.meet(ray)?;
                Some(Spot { t, primitive: u32::try_from(i).ok()?, at: Vec2::ZERO })
            }
        }
    }
}

impl Face {
    /// Met by no ray.
    const NOTHING: Self = Self { a: Vec3::NAN, ab: Vec3::ZERO, ac: Vec3::ZERO, triangle: u32::MAX, material: 0 };

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

    fn corners(&self) -> [Vec3; 3] {
        [self.a, self.a + self.ab, self.a + self.ac]
    }

    /// Box around a few.
    fn bounds(faces: &[Self]) -> [Vec3; 2] {
        let none = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let seen = faces.iter().filter(|f| f.triangle != Self::NOTHING.triangle);
        seen.flat_map(Self::corners).fold(none, |[min, max], p| [min.min(p), max.max(p)])
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

impl Skin<'_> {
    pub(super) fn corners(&self, face: &Face) -> [usize; 3] {
        self.triangles.get(face.triangle as usize).copied().unwrap_or_default().map(|i| i as usize)
    }

    /// Texture coordinates; zero for a mesh without.
    pub(super) fn uv(&self, face: &Face, at: Vec2) -> Vec2 {
        let [a, b, c] = self.corners(face).map(|i| self.uvs.get(i).copied().unwrap_or_default());
        a + (b - a) * at.x + (c - a) * at.y
    }
}

fn faces_of(mesh: &Mesh, points: &[Vec3]) -> Vec<Face> {
    let mut faces = Vec::with_capacity(mesh.triangles.len());
    for subset in &mesh.subsets {
        for (i, t) in (subset.first..).zip(mesh.subset_triangles(subset)) {
            let [a, b, c] = t.map(|k| points.get(k as usize).copied().unwrap_or_default());
            faces.push(Face { a, ab: b - a, ac: c - a, triangle: i, material: subset.material });
        }
    }
    faces
}

fn arrange<T: Copy>(list: &[T], tree: &CwBvh) -> Vec<T> {
    tree.primitive_indices.iter().filter_map(|i| list.get(*i as usize).copied()).collect()
}

/// A tree of boxes over primitives.
pub(super) fn tree_of<T: Sync>(list: &[T], quality: Quality, bounds: impl Fn(&T) -> [Vec3; 2] + Sync + Send) -> CwBvh {
    if list.is_empty() {
        return CwBvh::default();
    }
    let boxed = |[min, max]: [Vec3; 2]| Aabb::new(Vec3A::from(min), Vec3A::from(max));
    let boxes: Vec<Aabb> =
        par_chunks(list, 1 << 14, |_, c| c.iter().map(|t| boxed(bounds(t))).collect::<Vec<_>>()).concat();
    let rule = match quality.sorting().iter().position(|n| list.len() <= *n) {
        Some(0) => BvhBuildParams::slow_build(),
        Some(1) => BvhBuildParams::medium_build(),
        Some(_) => BvhBuildParams::fast_build(),
        None if quality.hurries() => BvhBuildParams::fastest_build(),
        None => BvhBuildParams::very_fast_build(),
    };
    build_cwbvh(&boxes, rule, &mut Duration::default())
}
