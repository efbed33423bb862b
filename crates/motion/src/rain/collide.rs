//! Continuous collision of falling drops with moving leaves, with wood and with solids.

use std::fmt;
use std::time::Duration;

use glam::{DVec3, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

use crate::rain::leaf::surface::LeafSurface;
use crate::rain::solids::RainSolids;
use crate::rain::target::{LeafPose, WoodSegment};
use crate::rain::triangle_hierarchy::{TriangleHierarchy, TriangleHit};
use crate::rain::tuning::{HIT_TIE, REFITS_PER_BUILD};

/// The triangles of a blade in a bounding volume hierarchy, at scale 1; shared by all leaves of one shape.
pub struct LeafCollider {
    hierarchy: TriangleHierarchy,
    /// Center of the bounding sphere, in blade space, m.
    center: DVec3,
    /// Radius of the bounding sphere, m.
    radius: f64,
}

impl fmt::Debug for LeafCollider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LeafCollider of {} triangles", self.hierarchy.len())
    }
}

impl LeafCollider {
    /// Builds hierarchy and bounding sphere of a blade at scale 1, once for all leaves of one shape.
    pub fn new(blade: &LeafSurface) -> Self {
        let corners: Vec<Vec3> = blade.points().iter().map(|p| p.as_vec3()).collect();
        let hierarchy = TriangleHierarchy::new(&corners, blade.triangles());
        // A sphere around the centroid bounds the blade in any orientation.
        let n = blade.points().len().max(1) as f64;
        let center = blade.points().iter().fold(DVec3::ZERO, |s, p| s + *p) / n;
        let radius = blade.points().iter().fold(0.0, |m: f64, p| m.max(p.distance(center)));
        Self { hierarchy, center, radius }
    }

    /// The first hit, from either side, of the straight path between two points of blade space at scale 1, m.
    pub(crate) fn intersect(&self, from: DVec3, to: DVec3) -> Option<TriangleHit> {
        self.hierarchy.intersect(from, to)
    }
}

/// A leaf that moves during a time step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MovingLeaf<'a> {
    /// Triangles of the blade at scale 1.
    pub collider: &'a LeafCollider,
    /// Factor on the size of the blade.
    pub scale: f64,
    /// Poses at the beginning and at the end of the step.
    pub poses: [LeafPose; 2],
}

impl MovingLeaf<'_> {
    /// Where a drop of diameter `d`, m, meets the leaf on its path between two world positions during the step.
    pub fn intersect_path(&self, [from, to]: [DVec3; 2], d: f64) -> Option<TriangleHit> {
        // In the frame of the moving leaf the blade is at rest. The path leads from the drop's start in the first pose to its
        // end in the second pose, and is taken as straight, so that no drop passes a leaf between two steps.
        let to_leaf = |p: DVec3, pose: &LeafPose| (pose.orientation.inverse() * (p - pose.position)) / self.scale;
        let (a, b) = (to_leaf(from, &self.poses[0]), to_leaf(to, &self.poses[1]));
        let path = b - a;
        // The drop touches with its front, half a diameter ahead of its center.
        let ahead = path.normalize_or_zero() * (0.5 * d / self.scale);
        let hit = self.collider.intersect(a, b + ahead)?;
        // From a fraction of the lengthened path to one of the center's path.
        let t = hit.t * (path.length() + ahead.length()) / path.length().max(f64::MIN_POSITIVE);
        Some(TriangleHit { t: t.min(1.0), ..hit })
    }

    /// Bounding box of the leaf in both poses, in the world.
    fn swept_bounds(&self) -> [DVec3; 2] {
        // The bounding sphere is enlarged by a thousandth, since boxes are in single precision.
        let r = DVec3::splat(self.collider.radius * self.scale * 1.001);
        let at = self.poses.map(|pose| pose.to_world(self.collider.center, self.scale));
        [at[0].min(at[1]) - r, at[0].max(at[1]) + r]
    }
}

/// Where the path of a drop comes nearest to a wood segment that it touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WoodHit {
    /// Fraction of the path, 0 to 1.
    pub t: f64,
    /// Fraction of the segment's length, 0 to 1.
    pub fraction: f64,
}

/// The first thing that the path of a drop meets in a step, with the place of contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DropHit {
    /// A leaf by its index in the simulation, and the struck point of its blade.
    Leaf { leaf: usize, hit: TriangleHit },
    /// A wood segment by its index over all plants, and the struck place along it.
    Wood { segment: usize, hit: WoodHit },
    /// A wall, a roof or a mesh, at which the drop ends.
    Solid {
        /// Fraction of the path, 0 to 1.
        t: f64,
    },
}

impl DropHit {
    /// Fraction of the drop's path, 0 to 1.
    pub fn path_fraction(&self) -> f64 {
        match self {
            Self::Leaf { hit, .. } => hit.t,
            Self::Wood { hit, .. } => hit.t,
            Self::Solid { t } => *t,
        }
    }
}

/// A bounding volume hierarchy over the boxes that leaves and wood sweep, kept from step to step: plants move as a whole, so that
/// their boxes stay neighbours, and the hierarchy is fitted to the new boxes instead of built anew.
#[derive(Default)]
pub(crate) struct SweptHierarchy {
    /// `None` before the first step, and without leaves and wood.
    bvh: Option<Bvh2>,
    boxes: Vec<Aabb>,
    /// Steps since the hierarchy was built; it is built again after [`REFITS_PER_BUILD`].
    age: u32,
}

impl fmt::Debug for SweptHierarchy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SweptHierarchy of {} boxes", self.boxes.len())
    }
}

impl SweptHierarchy {
    /// Fits the hierarchy to the boxes of a step; builds it if their number has changed or it has become old.
    fn update(&mut self, boxes: Vec<Aabb>) {
        let known = self.boxes.len();
        self.boxes = boxes;
        match &mut self.bvh {
            Some(bvh) if known == self.boxes.len() && self.age < REFITS_PER_BUILD => {
                for node in bvh.nodes.iter_mut().filter(|node| node.is_leaf()) {
                    let first = node.first_index as usize;
                    let primitives = &bvh.primitive_indices[first..first + node.prim_count as usize];
                    let union = |sum: Aabb, i: &u32| sum.union(&self.boxes[*i as usize]);
                    node.set_aabb(primitives.iter().fold(Aabb::empty(), union));
                }
                bvh.refit_all();
                self.age += 1;
            }
            bvh => {
                let params = BvhBuildParams::very_fast_build();
                *bvh = (!self.boxes.is_empty()).then(|| build_bvh2(&self.boxes, params, &mut Duration::default()));
                self.age = 0;
            }
        }
    }
}

/// All that drops can strike during one time step: moving leaves, wood and solids.
pub(crate) struct RainCollider<'a> {
    leaves: &'a [MovingLeaf<'a>],
    wood: &'a [WoodSegment],
    solids: &'a RainSolids,
    /// Hierarchy over the boxes of the leaves, followed by those of the wood segments.
    hierarchy: &'a SweptHierarchy,
}

impl<'a> RainCollider<'a> {
    /// Fits the hierarchy, which is kept from the step before, to the leaves and the wood of this step.
    pub fn new(
        leaves: &'a [MovingLeaf<'a>],
        wood: &'a [WoodSegment],
        solids: &'a RainSolids,
        hierarchy: &'a mut SweptHierarchy,
    ) -> Self {
        let aabb = |[lo, hi]: [DVec3; 2]| Aabb::new(lo.as_vec3().into(), hi.as_vec3().into());
        let capsule_bounds = |b: &WoodSegment| {
            let r = DVec3::splat(b.radii[0].max(b.radii[1]));
            [b.ends[0].min(b.ends[1]) - r, b.ends[0].max(b.ends[1]) + r]
        };
        let swept = leaves.iter().map(MovingLeaf::swept_bounds).chain(wood.iter().map(capsule_bounds));
        hierarchy.update(swept.map(aabb).collect());
        Self { leaves, wood, solids, hierarchy }
    }

    /// The first hit of a drop of diameter `d`, m, on its path between two world positions. `passes`: whether it passes through
    /// a leaf, by the index of the leaf.
    pub fn first_hit(&self, path: [DVec3; 2], d: f64, passes: impl Fn(usize) -> bool) -> Option<DropHit> {
        let plant = self.first_plant_hit(path, d, passes);
        let solid = self.solids.first_hit(path, d).map(|t| DropHit::Solid { t });
        // The nearer of both; at a tie the leaf or the wood.
        match (plant, solid) {
            (Some(plant), Some(solid)) => {
                Some(if solid.path_fraction() < plant.path_fraction() { solid } else { plant })
            }
            (plant, solid) => plant.or(solid),
        }
    }

    /// As [`RainCollider::first_hit`], of leaves and wood only.
    fn first_plant_hit(&self, path: [DVec3; 2], d: f64, passes: impl Fn(usize) -> bool) -> Option<DropHit> {
        let bvh = self.hierarchy.bvh.as_ref()?;
        // Broad phase: primitives whose boxes overlap that of the path.
        let r = Vec3::splat(osier_base::math::narrow(d));
        let [a, b] = path.map(|p| p.as_vec3());
        let path_bounds = Aabb::new((a.min(b) - r).into(), (a.max(b) + r).into());
        let mut candidates = Vec::new();
        bvh.aabb_traverse(path_bounds, |bvh, node| {
            let node = &bvh.nodes[node as usize];
            let first = node.first_index as usize;
            candidates.extend_from_slice(&bvh.primitive_indices[first..first + node.prim_count as usize]);
            true
        });
        // Narrow phase in the order of indices, so that ties do not depend on the hierarchy.
        candidates.sort_unstable();
        let mut best: Option<DropHit> = None;
        for i in candidates {
            let i = i as usize;
            let hit = match self.leaves.get(i) {
                Some(_) if passes(i) => None,
                Some(leaf) => leaf.intersect_path(path, d).map(|hit| DropHit::Leaf { leaf: i, hit }),
                None => {
                    let segment = i - self.leaves.len();
                    intersect_wood_segment(&self.wood[segment], path, d).map(|hit| DropHit::Wood { segment, hit })
                }
            };
            if let Some(s) =
                hit.filter(|s| best.is_none_or(|b| s.path_fraction() < b.path_fraction() - f64::from(HIT_TIE)))
            {
                best = Some(s);
            }
        }
        best
    }
}

/// Where a drop of diameter `d`, m, comes nearest to a wood segment on its path; `None` if it does not touch the wood there.
fn intersect_wood_segment(wood: &WoodSegment, [from, to]: [DVec3; 2], d: f64) -> Option<WoodHit> {
    // Closest points of two segments, from + s u and ends[0] + t v: minimize |w + s u - t v|^2 over s, clamp s, then solve for t,
    // clamp it, and solve for s again.
    let (u, v, w) = (to - from, wood.ends[1] - wood.ends[0], from - wood.ends[0]);
    let (a, b, c) = (u.dot(u), u.dot(v), v.dot(v));
    let (e, f) = (u.dot(w), v.dot(w));
    let det = a * c - b * b;
    let mut s = if det > 1e-18 { ((b * f - c * e) / det).clamp(0.0, 1.0) } else { 0.0 };
    let t = if c > 0.0 { ((b * s + f) / c).clamp(0.0, 1.0) } else { 0.0 };
    if a > 0.0 {
        s = ((b * t - e) / a).clamp(0.0, 1.0);
    }
    // A tapered capsule: its radius at t, and that of the drop.
    let distance = (w + u * s - v * t).length();
    let reach = wood.radii[0] + (wood.radii[1] - wood.radii[0]) * t + 0.5 * d;
    (distance <= reach).then_some(WoodHit { t: s, fraction: t })
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
    fn hierarchy_finds_the_first_hit() {
        let collider = LeafCollider::new(&bumpy());
        let mut draw = Rng::at(9, &["ways".into()]);
        let mut any = |r: f64| DVec3::new(draw.range(-r, r), draw.range(-r, r) + 0.04, draw.range(-r, r));
        let mut hits = 0;
        for _ in 0..100_000 {
            let (a, b) = (any(0.05), any(0.05));
            let slow = collider.hierarchy.intersect_all(a, b);
            let fast = collider.intersect(a, b);
            hits += usize::from(slow.is_some());
            match (slow, fast) {
                (None, None) => {}
                (Some(s), Some(f)) => assert!((f64::from(s.0) - f.t).abs() < 1e-5, "{s:?} {f:?}"),
                // Both use the same test of a triangle, so they agree at edges too.
                (s, f) => panic!("{s:?} {f:?}"),
            }
        }
        assert!(hits > 10_000, "{hits}");
    }

    #[test]
    fn a_fast_drop_never_passes_a_moving_leaf() {
        let blade = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let collider = LeafCollider::new(&blade);
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
                let moved = MovingLeaf { collider: &collider, scale: 1.0, poses: [pose(y), pose(y + 0.03)] };
                met =
                    met.or_else(|| {
                        RainCollider::new(&[moved], &[], &RainSolids::default(), &mut SweptHierarchy::default())
                            .first_hit([p, next], 1e-3, |_| false)
                    });
                (p, y) = (next, y + 0.03);
            }
            let Some(DropHit::Leaf { leaf: 0, hit }) = met else { panic!("{k}: {met:?}") };
            let uv = blade.interpolate_uv(hit.triangle, hit.weights);
            assert!((uv.x - 0.575).abs() < 1e-4 && (uv.y - 0.375).abs() < 1e-4, "{uv}");
        }
    }

    #[test]
    fn a_hierarchy_that_is_fitted_finds_what_a_new_one_finds() {
        let blade = LeafSurface::new(&flat(0.08, 0.04, 4)).expect("a blade");
        let collider = LeafCollider::new(&blade);
        let mut draw = Rng::at(5, &["crown".into()]);
        let mut places: Vec<DVec3> =
            (0..400).map(|_| DVec3::new(draw.range(-1.0, 1.0), draw.range(-1.0, 1.0), draw.range(-1.0, 1.0))).collect();
        let solids = RainSolids::default();
        let mut kept = SweptHierarchy::default();
        let mut hits = 0;
        for _ in 0..3 * REFITS_PER_BUILD {
            let before = places.clone();
            places.iter_mut().for_each(|p| *p += DVec3::new(draw.range(0.0, 0.01), draw.range(-0.01, 0.01), 0.005));
            let flat = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
            let pose = |p: DVec3| LeafPose::at_rest(p, flat);
            let moving: Vec<MovingLeaf<'_>> = before
                .iter()
                .zip(&places)
                .map(|(a, b)| MovingLeaf { collider: &collider, scale: 1.0, poses: [pose(*a), pose(*b)] })
                .collect();
            let mut new = SweptHierarchy::default();
            let rebuilt = RainCollider::new(&moving, &[], &solids, &mut new);
            let fitted = RainCollider::new(&moving, &[], &solids, &mut kept);
            for _ in 0..50 {
                let from = DVec3::new(draw.range(-1.0, 1.0), 1.0, draw.range(-1.0, 1.0));
                let path = [from, from - DVec3::Y * draw.range(0.0, 2.0)];
                let hit = fitted.first_hit(path, 2e-3, |_| false);
                assert_eq!(hit, rebuilt.first_hit(path, 2e-3, |_| false));
                hits += usize::from(hit.is_some());
            }
        }
        assert!(hits > 100, "{hits}");
    }

    #[test]
    fn wood_is_met_where_it_is_thick() {
        let wood = WoodSegment { ends: [DVec3::ZERO, DVec3::X], radii: [0.02, 0.01] };
        let segments = [wood];
        let solids = RainSolids::default();
        let mut hierarchy = SweptHierarchy::default();
        let collider = RainCollider::new(&[], &segments, &solids, &mut hierarchy);
        let drop = |z: f64| collider.first_hit([DVec3::new(0.5, 0.1, z), DVec3::new(0.5, -0.1, z)], 1e-3, |_| false);
        assert!(
            matches!(drop(0.0), Some(DropHit::Wood { segment: 0, hit }) if (hit.t - 0.5).abs() < 1e-9 && (hit.fraction - 0.5).abs() < 1e-9)
        );
        assert!(drop(0.0154).is_some() && drop(0.0157).is_none());
    }
}
