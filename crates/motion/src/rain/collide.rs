//! Where falling drops meet moving leaves and wood.

use std::fmt;
use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};

use crate::rain::leaf::surface::LeafSurface;
use crate::rain::target::{LeafPose, WoodSegment};

/// Hits nearer to each other than this share of the way are one; the lower number counts.
const TIE: f32 = 1e-7;

/// A blade's triangles with a tree of boxes, in its own space; shared by all leaves that show it.
pub struct LeafCollider {
    tree: CwBvh,
    /// In the order of the tree: a corner, both edges from it, number of the triangle.
    faces: Vec<([Vec3; 3], u32)>,
    /// A ball around it.
    middle: DVec3,
    radius: f64,
}

impl fmt::Debug for LeafCollider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Target of {} triangles", self.faces.len())
    }
}

/// Where a way meets a blade.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafHit {
    /// Share of the way, 0 to 1.
    pub t: f64,
    /// Triangle of the sheet.
    pub triangle: usize,
    /// Weights of its second and third corner.
    pub weights: [f64; 2],
}

impl LeafCollider {
    /// Sorts a blade.
    pub fn new(sheet: &LeafSurface) -> Self {
        let corner = |i: u32| sheet.points()[i as usize].as_vec3();
        let boxes: Vec<Aabb> = sheet
            .triangles()
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| Vec3A::from(corner(i)));
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let tree = build_cwbvh(&boxes, BvhBuildParams::fast_build(), &mut Duration::default());
        let face = |i: &u32| {
            let [a, b, c] = sheet.triangles()[*i as usize].map(corner);
            ([a, b - a, c - a], *i)
        };
        let faces = tree.primitive_indices.iter().map(face).collect();
        let n = sheet.points().len().max(1) as f64;
        let middle = sheet.points().iter().fold(DVec3::ZERO, |s, p| s + *p) / n;
        let radius = sheet.points().iter().fold(0.0, |m: f64, p| m.max(p.distance(middle)));
        Self { tree, faces, middle, radius }
    }

    /// The first place where a way between two places of the blade's own space meets it, from either side.
    pub fn meets(&self, from: DVec3, to: DVec3) -> Option<LeafHit> {
        let d = (to - from).as_vec3();
        let length = d.length();
        if length <= 0.0 || self.faces.is_empty() {
            return None;
        }
        let o = from.as_vec3();
        let ray = Ray::new(o.into(), (d / length).into(), 0.0, length);
        let mut best: Option<(f32, u32, [f32; 2])> = None;
        let mut hit = RayHit::none();
        self.tree.ray_traverse(ray, &mut hit, |_, i| {
            let ([a, e, f], number) = self.faces[i];
            let Some((t, w)) = intersect_triangle(o, d, [a, e, f]) else { return f32::INFINITY };
            let nearer = best.is_none_or(|b| t < b.0 - TIE || (t <= b.0 + TIE && number < b.1));
            if nearer {
                best = Some((t, number, w));
            }
            // A little beyond what was found, so that equals are seen too.
            (t + 2.0 * TIE) * length
        });
        best.map(|(t, i, w)| LeafHit { t: f64::from(t), triangle: i as usize, weights: w.map(f64::from) })
    }

    /// Every triangle, one after the other.
    #[cfg(test)]
    fn intersect_all(&self, from: DVec3, to: DVec3) -> Option<(f32, u32)> {
        let (o, d) = (from.as_vec3(), (to - from).as_vec3());
        let hits = self.faces.iter().filter_map(|(f, i)| intersect_triangle(o, d, *f).map(|(t, _)| (t, *i)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    }
}

/// Share of the way `d` from `o` at which it crosses a triangle, and where. Source: Möller and Trumbore.
fn intersect_triangle(o: Vec3, d: Vec3, [a, e, f]: [Vec3; 3]) -> Option<(f32, [f32; 2])> {
    let p = d.cross(f);
    let det = e.dot(p);
    if det.abs() < f32::MIN_POSITIVE {
        return None;
    }
    let s = (o - a) / det;
    let q = s.cross(e);
    let (u, v, t) = (s.dot(p), d.dot(q), f.dot(q));
    let slack = -1e-6;
    (u >= slack && v >= slack && u + v <= 1.0 - slack && (0.0..=1.0).contains(&t)).then_some((t, [u, v]))
}

/// A leaf as drops meet it during a step: its blade, and where it was and is.
#[derive(Debug, Clone, Copy)]
pub struct MovingLeaf<'a> {
    /// Its blade.
    pub target: &'a LeafCollider,
    /// Factor on it.
    pub scale: f64,
    /// Where it was at the beginning of the step, and where it is at its end.
    pub poses: [LeafPose; 2],
}

impl MovingLeaf<'_> {
    /// Where a drop of diameter `d`, m, that goes from one place to another during the step meets it; the leaf's own motion
    /// is in the way, as both ends are seen from where the leaf then is.
    pub fn meets(&self, [from, to]: [DVec3; 2], d: f64) -> Option<LeafHit> {
        let seen = |p: DVec3, pose: &LeafPose| (pose.orientation.inverse() * (p - pose.position)) / self.scale;
        let (a, b) = (seen(from, &self.poses[0]), seen(to, &self.poses[1]));
        let way = b - a;
        let ahead = way.normalize_or_zero() * (0.5 * d / self.scale);
        let met = self.target.meets(a, b + ahead)?;
        let t = met.t * (way.length() + ahead.length()) / way.length().max(f64::MIN_POSITIVE);
        Some(LeafHit { t: t.min(1.0), ..met })
    }

    fn swept_bounds(&self) -> [DVec3; 2] {
        let r = DVec3::splat(self.target.radius * self.scale * 1.001);
        let at = self.poses.map(|pose| pose.to_world(self.target.middle, self.scale));
        [at[0].min(at[1]) - r, at[0].max(at[1]) + r]
    }
}

/// What a drop strikes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DropHit {
    /// A leaf, by number.
    Leaf(usize, LeafHit),
    /// A piece of wood, by number: share of the drop's way, share of the wood's length.
    Wood(usize, f64, f64),
}

impl DropHit {
    /// Share of the drop's way.
    pub fn t(&self) -> f64 {
        match self {
            Self::Leaf(_, met) => met.t,
            Self::Wood(_, t, _) => *t,
        }
    }
}

/// Boxes over all leaves and wood during a step.
pub struct RainCollider<'a> {
    leaves: &'a [MovingLeaf<'a>],
    wood: &'a [WoodSegment],
    tree: Option<Bvh2>,
}

impl<'a> RainCollider<'a> {
    /// Sorts them.
    pub fn new(leaves: &'a [MovingLeaf<'a>], wood: &'a [WoodSegment]) -> Self {
        let bounds = |[lo, hi]: [DVec3; 2]| Aabb::new(lo.as_vec3().into(), hi.as_vec3().into());
        let around = |b: &WoodSegment| {
            let r = DVec3::splat(b.radii[0].max(b.radii[1]));
            [b.ends[0].min(b.ends[1]) - r, b.ends[0].max(b.ends[1]) + r]
        };
        let boxes: Vec<Aabb> =
            leaves.iter().map(MovingLeaf::swept_bounds).chain(wood.iter().map(around)).map(bounds).collect();
        let tree = (!boxes.is_empty())
            .then(|| build_bvh2(&boxes, BvhBuildParams::very_fast_build(), &mut Duration::default()));
        Self { leaves, wood, tree }
    }

    /// What a drop of diameter `d`, m, strikes first on its way; `without`: a leaf that it does not see.
    pub fn first(&self, way: [DVec3; 2], d: f64, without: Option<usize>) -> Option<DropHit> {
        let tree = self.tree.as_ref()?;
        let r = Vec3::splat(osier_base::math::narrow(d));
        let [a, b] = way.map(|p| p.as_vec3());
        let strip = Aabb::new((a.min(b) - r).into(), (a.max(b) + r).into());
        let mut near = Vec::new();
        tree.aabb_traverse(strip, |tree, node| {
            let node = &tree.nodes[node as usize];
            let first = node.first_index as usize;
            near.extend_from_slice(&tree.primitive_indices[first..first + node.prim_count as usize]);
            true
        });
        near.sort_unstable();
        let mut best: Option<DropHit> = None;
        for i in near {
            let i = i as usize;
            let struck = match self.leaves.get(i) {
                Some(_) if without == Some(i) => None,
                Some(leaf) => leaf.meets(way, d).map(|met| DropHit::Leaf(i, met)),
                None => {
                    let k = i - self.leaves.len();
                    intersect_wood(&self.wood[k], way, d).map(|(t, share)| DropHit::Wood(k, t, share))
                }
            };
            if let Some(s) = struck.filter(|s| best.is_none_or(|b| s.t() < b.t() - f64::from(TIE))) {
                best = Some(s);
            }
        }
        best
    }
}

/// Where a drop on its way comes nearest to a piece of wood, if it touches it: shares of both.
fn intersect_wood(wood: &WoodSegment, [from, to]: [DVec3; 2], d: f64) -> Option<(f64, f64)> {
    let (u, v, w) = (to - from, wood.ends[1] - wood.ends[0], from - wood.ends[0]);
    let (a, b, c) = (u.dot(u), u.dot(v), v.dot(v));
    let (e, f) = (u.dot(w), v.dot(w));
    let det = a * c - b * b;
    let mut s = if det > 1e-18 { ((b * f - c * e) / det).clamp(0.0, 1.0) } else { 0.0 };
    let t = if c > 0.0 { ((b * s + f) / c).clamp(0.0, 1.0) } else { 0.0 };
    if a > 0.0 {
        s = ((b * t - e) / a).clamp(0.0, 1.0);
    }
    let apart = (w + u * s - v * t).length();
    let reach = wood.radii[0] + (wood.radii[1] - wood.radii[0]) * t + 0.5 * d;
    (apart <= reach).then_some((s, t))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::rain::leaf::surface::tests::flat;
    use osier_base::rng::Rng;

    fn bumpy() -> LeafSurface {
        let mut mesh = flat(0.08, 0.04, 12);
        for p in &mut mesh.points {
            p.z = 0.004 * osier_base::math::sin_f32(90.0 * p.x) * osier_base::math::cos_f32(70.0 * p.y);
        }
        LeafSurface::new(&mesh).expect("a blade")
    }

    #[test]
    fn the_tree_finds_what_all_triangles_say() {
        let target = LeafCollider::new(&bumpy());
        let mut draw = Rng::at(9, &["ways".into()]);
        let mut any = |r: f64| DVec3::new(draw.range(-r, r), draw.range(-r, r) + 0.04, draw.range(-r, r));
        let mut hits = 0;
        for _ in 0..100_000 {
            let (a, b) = (any(0.05), any(0.05));
            let slow = target.intersect_all(a, b);
            let fast = target.meets(a, b);
            hits += usize::from(slow.is_some());
            match (slow, fast) {
                (None, None) => {}
                (Some(s), Some(f)) => assert!((f64::from(s.0) - f.t).abs() < 1e-5, "{s:?} {f:?}"),
                // A way through an edge may slip between; the same triangles answer, though.
                (s, f) => panic!("{s:?} {f:?}"),
            }
        }
        assert!(hits > 10_000, "{hits}");
    }

    #[test]
    fn a_fast_drop_never_passes_a_moving_leaf() {
        let sheet = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let target = LeafCollider::new(&sheet);
        let flat = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        let pose = |y: f64| LeafPose::at_rest(DVec3::new(0.0, y, 0.0), flat);
        let h = 1.0 / 24.0;
        // The leaf swings up by 30 mm a step while the drop comes down at 10 m/s, from any height.
        for k in 0..50 {
            let mut p = DVec3::new(0.003, 1.0 + 0.02 * f64::from(k), -0.03);
            let mut y = 0.0;
            let mut met = None;
            for _ in 0..10 {
                let next = p - DVec3::Y * (10.0 * h);
                let moved = MovingLeaf { target: &target, scale: 1.0, poses: [pose(y), pose(y + 0.03)] };
                met = met.or_else(|| RainCollider::new(&[moved], &[]).first([p, next], 1e-3, None));
                (p, y) = (next, y + 0.03);
            }
            let Some(DropHit::Leaf(0, m)) = met else { panic!("{k}: {met:?}") };
            let uv = sheet.uv_of(m.triangle, m.weights);
            assert!((uv.x - 0.575).abs() < 1e-4 && (uv.y - 0.375).abs() < 1e-4, "{uv}");
        }
    }

    #[test]
    fn wood_is_met_where_it_is_thick() {
        let wood = WoodSegment { ends: [DVec3::ZERO, DVec3::X], radii: [0.02, 0.01] };
        let field = [wood];
        let field = RainCollider::new(&[], &field);
        let drop = |z: f64| field.first([DVec3::new(0.5, 0.1, z), DVec3::new(0.5, -0.1, z)], 1e-3, None);
        assert!(matches!(drop(0.0), Some(DropHit::Wood(0, t, s)) if (t - 0.5).abs() < 1e-9 && (s - 0.5).abs() < 1e-9));
        assert!(drop(0.0154).is_some() && drop(0.0157).is_none());
    }
}
