//! Round cones: the hull of two balls. A point is one ball, a stretch of a curve a cone.

use glam::Vec3;
use obvhs::ray::Ray;

/// The hull of two balls.
#[derive(Debug, Clone, Copy)]
pub(super) struct RoundCone {
    ends: [Vec3; 2],
    radii: [f32; 2],
    /// Linear colour of its own.
    pub(super) color: Option<[f32; 3]>,
    /// See [`RoundCone::share`].
    share: f32,
}

impl RoundCone {
    pub(super) fn new(ends: [Vec3; 2], radii: [f32; 2]) -> Self {
        Self { ends, radii, color: None, share: 1.0 }
    }

    /// The same, met by a share of the rays only, 0..1.
    pub(super) fn veiled(self, share: f32) -> Self {
        Self { share, ..self }
    }

    pub(super) fn ball(center: Vec3, radius: f32, color: Option<[f32; 3]>) -> Self {
        Self { ends: [center, center], radii: [radius, radius], color, share: 1.0 }
    }

    /// PrimitiveRange of the rays on their way through it that meet it.
    pub(super) fn share(&self) -> f32 {
        self.share
    }

    /// About the area of its shadow, seen from its side.
    pub(super) fn shadow(&self) -> f32 {
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        std::f32::consts::FRAC_PI_2 * (ra * ra + rb * rb) + a.distance(b) * (ra + rb)
    }

    /// Largest thickness.
    pub(super) fn width(&self) -> f32 {
        2.0 * self.radii[0].max(self.radii[1])
    }

    pub(super) fn bounds(&self) -> [Vec3; 2] {
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        [(a - ra).min(b - rb), (a + ra).max(b + rb)]
    }

    /// Where a ray enters, in lengths of its direction.
    /// Own: the lateral surface is the cone that touches both balls; with `d = b - a`, `k = d.d - (ra - rb)^2` and `y` the
    /// place along it, a point x lies on it where |k (x - a) - d y| = k-scaled radius, a quadratic in t.
    pub(super) fn meet(&self, ray: &Ray) -> Option<f32> {
        let (start, d) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        // From the place on the ray that is nearest to the middle: hairs a thousandth as thick as they are far keep their
        // digits.
        let near = d.dot((a + b) * 0.5 - start) / d.length_squared();
        let o = start + d * near;
        let within = |t: f32| {
            let t = t + near;
            (t >= ray.tmin && t <= ray.tmax).then_some(t)
        };
        let axis = b - a;
        let narrowing = ra - rb;
        let length2 = axis.length_squared();
        let slant = length2 - narrowing * narrowing;
        let enters = |c: Vec3, r: f32| -> Option<f32> {
            let w = o - c;
            let (dd, dw) = (d.length_squared(), d.dot(w));
            // Perpendicular distance instead of the usual discriminant: small balls far away keep their digits.
            let beside = (w - d * (dw / dd)).length_squared();
            let h = (r * r - beside) * dd;
            (h >= 0.0).then(|| (-dw - osier_base::math::sqrt_f32(h)) / dd)
        };
        if slant <= 0.0 {
            // One ball holds the other.
            let (c, r) = if ra >= rb { (a, ra) } else { (b, rb) };
            return enters(c, r).and_then(within);
        }
        let w = o - a;
        let (m1, m2, m3) = (w.dot(axis), axis.dot(d), d.dot(w));
        let qa = slant * d.length_squared() - m2 * m2;
        let qb = slant * m3 - m1 * m2 + m2 * narrowing * ra;
        let qc = slant * w.length_squared() - m1 * m1 + m1 * narrowing * ra * 2.0 - length2 * ra * ra;
        let h = qb * qb - qa * qc;
        // The same root in two forms, each without a difference of equals. A ray within the opening of a cone (qa < 0) enters
        // it once.
        let root = |h: f32| {
            let s = osier_base::math::sqrt_f32(h);
            if qb < 0.0 { qc / (s - qb) } else { (-s - qb) / qa }
        };
        let side = (h >= 0.0 && qa != 0.0).then(|| root(h)).filter(|t| {
            let y = m1 - ra * narrowing + t * m2;
            y > 0.0 && y < slant
        });
        let caps = [enters(a, ra), enters(b, rb)].into_iter().flatten();
        side.into_iter().chain(caps).filter_map(within).min_by(f32::total_cmp)
    }

    /// Unit normal at a point of the surface.
    pub(super) fn normal(&self, p: Vec3) -> Vec3 {
        let ([a, b], [ra, rb]) = (self.ends, self.radii);
        let axis = b - a;
        let narrowing = ra - rb;
        let slant = axis.length_squared() - narrowing * narrowing;
        if slant <= 0.0 {
            return osier_base::math::normalize_or(p - if ra >= rb { a } else { b }, Vec3::Y);
        }
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
        let p = Vec3::from(ray.origin) + d * cone.meet(&ray).expect("it is met");
        assert!(distance(&cone, p).abs() < 2e-4, "distance {}", distance(&cone, p));
    }

    proptest! {
        #[test]
        fn rays_enter_at_the_surface(a in vector(), b in vector(), ra in 0.05_f32..0.4, rb in 0.05_f32..0.4, d in vector(), w in vector()) {
            let cone = RoundCone::new([a, b], [ra, rb]);
            prop_assume!(d.length() > 0.1);
            let target = a.lerp(b, 0.4) + w * 0.5;
            let ray = Ray::new(Vec3A::from(target - d * 8.0 / d.length()), Vec3A::from(d), 0.0, f32::INFINITY);
            match cone.meet(&ray) {
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
