//! Round cones, the convex hulls of two balls: a point is drawn as one ball, a segment of a curve as a cone.

use glam::Vec3;
use obvhs::ray::Ray;

/// The convex hull of two balls.
#[derive(Debug, Clone, Copy)]
pub(super) struct RoundCone {
    ends: [Vec3; 2],
    radii: [f32; 2],
    /// Linear colour in place of that of the material.
    pub(super) color: Option<[f32; 3]>,
    opacity: f32,
}

impl RoundCone {
    pub(super) fn new(ends: [Vec3; 2], radii: [f32; 2]) -> Self {
        Self { ends, radii, color: None, opacity: 1.0 }
    }

    /// The same cone, hit only by a fraction `opacity` of the rays, 0 to 1.
    pub(super) fn with_opacity(self, opacity: f32) -> Self {
        Self { opacity, ..self }
    }

    pub(super) fn ball(center: Vec3, radius: f32, color: Option<[f32; 3]>) -> Self {
        Self { ends: [center, center], radii: [radius, radius], color, opacity: 1.0 }
    }

    /// Fraction of the rays through the cone that hit it.
    pub(super) fn opacity(&self) -> f32 {
        self.opacity
    }

    /// Area of its silhouette from the side, m2: a trapezium with a half disc at each end.
    pub(super) fn silhouette_area(&self) -> f32 {
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        std::f32::consts::FRAC_PI_2 * (ra * ra + rb * rb) + a.distance(b) * (ra + rb)
    }

    /// Diameter of its thicker end, m.
    pub(super) fn width(&self) -> f32 {
        2.0 * self.radii[0].max(self.radii[1])
    }

    pub(super) fn bounds(&self) -> [Vec3; 2] {
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        [(a - ra).min(b - rb), (a + ra).max(b + rb)]
    }

    /// Where a ray enters the cone, in lengths of its direction.
    /// Own: the lateral surface is the cone that touches both balls; with `v = b - a`,
    /// `k = v.v - (ra - rb)^2` and `m = (x - a).v`, a point x lies on it where
    /// `k |x - a|^2 - m^2 + 2 m (ra - rb) ra - v.v ra^2 = 0`, a quadratic in the ray's parameter.
    pub(super) fn intersect(&self, ray: &Ray) -> Option<f32> {
        let (start, d) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        // The ray is started from its point closest to the middle of the cone: at a distance a
        // thousand times the radius of a hair, f32 would otherwise lose the radius.
        let near = d.dot((a + b) * 0.5 - start) / d.length_squared();
        let o = start + d * near;
        let within = |t: f32| {
            let t = t + near;
            (t >= ray.tmin && t <= ray.tmax).then_some(t)
        };
        let axis = b - a;
        let narrowing = ra - rb;
        let length2 = axis.length_squared();
        // This is the k of the formula: the squared length of the lateral surface between its circles of contact.
        let slant = length2 - narrowing * narrowing;
        let enters_ball = |c: Vec3, r: f32| -> Option<f32> {
            let w = o - c;
            let (dd, dw) = (d.length_squared(), d.dot(w));
            // The usual discriminant (d.w)^2 - d.d (w.w - r^2) is a difference of large numbers;
            // r^2 less the squared distance of the ray from the centre is not.
            let beside = (w - d * (dw / dd)).length_squared();
            let h = (r * r - beside) * dd;
            (h >= 0.0).then(|| (-dw - osier_base::math::sqrt_f32(h)) / dd)
        };
        if slant <= 0.0 {
            // One ball contains the other.
            let (c, r) = if ra >= rb { (a, ra) } else { (b, rb) };
            return enters_ball(c, r).and_then(within);
        }
        // Coefficients of qa t^2 + 2 qb t + qc = 0.
        let w = o - a;
        let (m1, m2, m3) = (w.dot(axis), axis.dot(d), d.dot(w));
        let qa = slant * d.length_squared() - m2 * m2;
        let qb = slant * m3 - m1 * m2 + m2 * narrowing * ra;
        let qc = slant * w.length_squared() - m1 * m1 + m1 * narrowing * ra * 2.0 - length2 * ra * ra;
        let h = qb * qb - qa * qc;
        // The smaller root in the one of its two forms that subtracts no nearly equal numbers. A
        // ray steeper than the opening of the cone (qa < 0) enters it once.
        let root = |h: f32| {
            let s = osier_base::math::sqrt_f32(h);
            if qb < 0.0 { qc / (s - qb) } else { (-s - qb) / qa }
        };
        // A root counts only between the circles of contact; beyond them the ray may enter one of
        // the balls.
        let side = (h >= 0.0 && qa != 0.0).then(|| root(h)).filter(|t| {
            let y = m1 - ra * narrowing + t * m2;
            y > 0.0 && y < slant
        });
        let caps = [enters_ball(a, ra), enters_ball(b, rb)].into_iter().flatten();
        side.into_iter().chain(caps).filter_map(within).min_by(f32::total_cmp)
    }

    /// Unit normal at a point of the surface: constant along each line of the lateral surface, radial on the balls.
    pub(super) fn normal(&self, p: Vec3) -> Vec3 {
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        let axis = b - a;
        let narrowing = ra - rb;
        let slant = axis.length_squared() - narrowing * narrowing;
        // One ball contains the other: the normal is radial.
        if slant <= 0.0 {
            return osier_base::math::normalize_or(p - if ra >= rb { a } else { b }, Vec3::Y);
        }
        // Foot of the normal on the axis, k-scaled and held between the centres of the balls.
        let y = ((p - a).dot(axis) - ra * narrowing).clamp(0.0, slant);
        osier_base::math::normalize_or((p - a) * slant - axis * y, Vec3::Y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;
    use proptest::prelude::*;

    /// Signed distance from a round cone, by search along the axis.
    fn distance(c: &RoundCone, p: Vec3) -> f32 {
        let at = |t: f32| p.distance(c.ends[0].lerp(c.ends[1], t)) - (c.radii[0] * (1.0 - t) + c.radii[1] * t);
        (0..=4000).map(|i| at(i as f32 / 4000.0)).fold(f32::MAX, f32::min)
    }

    fn vector() -> impl Strategy<Value = Vec3> {
        [-1.0_f32..1.0, -1.0_f32..1.0, -1.0_f32..1.0].prop_map(Vec3::from_array)
    }

    #[test]
    fn a_ray_along_a_widening_cone_enters_by_its_side() {
        let ends = [Vec3::new(-0.424_860_7, -0.179_997_89, 0.0), Vec3::new(0.0, -0.193_865_58, 0.781_311_2)];
        let cone = RoundCone::new(ends, [0.05, 0.355_807_87]);
        let d = Vec3::new(0.511_563_3, 0.0, 0.801_616_1);
        let target = ends[0].lerp(ends[1], 0.4) + Vec3::Z * 0.105_383_72;
        let ray = Ray::new(Vec3A::from(target - d * 8.0 / d.length()), Vec3A::from(d), 0.0, f32::INFINITY);
        let p = Vec3::from(ray.origin) + d * cone.intersect(&ray).expect("a hit");
        assert!(distance(&cone, p).abs() < 2e-4, "distance {}", distance(&cone, p));
    }

    proptest! {
        #[test]
        fn rays_enter_at_the_surface(a in vector(), b in vector(), ra in 0.05_f32..0.4, rb in 0.05_f32..0.4, d in vector(), w in vector()) {
            let cone = RoundCone::new([a, b], [ra, rb]);
            prop_assume!(d.length() > 0.1);
            let target = a.lerp(b, 0.4) + w * 0.5;
            let ray = Ray::new(Vec3A::from(target - d * 8.0 / d.length()), Vec3A::from(d), 0.0, f32::INFINITY);
            match cone.intersect(&ray) {
                Some(t) => {
                    let p = Vec3::from(ray.origin) + d * t;
                    prop_assert!(distance(&cone, p).abs() < 2e-4, "distance {}", distance(&cone, p));
                    prop_assert!(cone.normal(p).dot(d) <= 1e-3);
                    prop_assert!((distance(&cone, p + cone.normal(p) * 0.1) - 0.1).abs() < 1e-3);
                }
                None => {
                    let closest = (0..2000).map(|i| distance(&cone, Vec3::from(ray.origin) + d * (i as f32 * 0.008 / d.length())));
                    prop_assert!(closest.fold(f32::MAX, f32::min) > -1e-3);
                }
            }
        }
    }
}
