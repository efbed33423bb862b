//! Transcendental functions whose results have the same bits on every machine, and common vector formulas.
//!
//! The system's `sin` chooses instructions by CPU, and its last bit changes with them; these functions wrap the `libm` crate.

use glam::{Quat, Vec3};

macro_rules! wrap {
    ($($(#[$doc:meta])* $name:ident / $name32:ident => $f64:ident / $f32:ident;)*) => {$(
        $(#[$doc])*
        #[inline]
        pub fn $name(x: f64) -> f64 { libm::$f64(x) }
        $(#[$doc])*
        ///
        /// Single precision.
        #[inline]
        pub fn $name32(x: f32) -> f32 { libm::$f32(x) }
    )*};
}

wrap! {
    /// Sine of an angle in radians; NaN for infinity.
    sin / sin_f32 => sin / sinf;
    /// Cosine of an angle in radians; NaN for infinity.
    cos / cos_f32 => cos / cosf;
    /// Tangent of an angle in radians; NaN for infinity.
    tan / tan_f32 => tan / tanf;
    /// Arc sine, radians; NaN beyond +-1.
    asin / asin_f32 => asin / asinf;
    /// Arc cosine, radians; NaN beyond +-1.
    acos / acos_f32 => acos / acosf;
    /// Arc tangent, radians in [-pi/2, pi/2].
    atan / atan_f32 => atan / atanf;
    /// e^x; infinity for results beyond the largest number, 0 below the smallest.
    exp / exp_f32 => exp / expf;
    /// e^x - 1 without the cancellation near x = 0.
    exp_m1 / exp_m1_f32 => expm1 / expm1f;
    /// Real cube root, of the sign of x.
    cbrt / cbrt_f32 => cbrt / cbrtf;
    /// Natural logarithm; NaN below 0, -infinity at 0.
    ln / ln_f32 => log / logf;
    /// Hyperbolic tangent, in [-1, 1].
    tanh / tanh_f32 => tanh / tanhf;
    /// Square root; NaN below 0.
    sqrt / sqrt_f32 => sqrt / sqrtf;
}

/// Golden angle, rad: successive turns by it spread evenly for any number of them. 180 (3 - sqrt 5) degrees.
pub const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// [`GOLDEN_ANGLE`] rounded to single precision.
pub const GOLDEN_ANGLE_F32: f32 = 2.399_963_2;

/// Angle of the point (x, y) from the x axis, radians in (-pi, pi].
#[inline]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// `base` to the power `exponent`; NaN for a negative base with a fractional exponent, 1 for exponent 0.
#[inline]
pub fn pow(base: f64, exponent: f64) -> f64 {
    libm::pow(base, exponent)
}

/// [`pow`] in single precision, computed as such and not rounded from it.
#[inline]
pub fn pow_f32(base: f32, exponent: f32) -> f32 {
    libm::powf(base, exponent)
}

/// a b + c, rounded once: the same bits with or without an instruction for it, but not those of a product and a sum.
#[inline(always)]
#[allow(clippy::disallowed_methods, reason = "asked for by name, never left to the compiler")]
pub fn fused(a: f64, b: f64, c: f64) -> f64 {
    a.mul_add(b, c)
}

/// [`fused`] in single precision.
#[inline(always)]
#[allow(clippy::disallowed_methods, reason = "asked for by name, never left to the compiler")]
pub fn fused_f32(a: f32, b: f32, c: f32) -> f32 {
    a.mul_add(b, c)
}

/// Rounds to single precision: the one place where f64 results become stored f32 values.
#[inline]
#[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is the purpose")]
pub fn narrow(x: f64) -> f32 {
    x as f32
}

/// Linear interpolation a (1 - t) + b t, exactly `a` at t = 0 and `b` at t = 1; extrapolates outside of [0, 1].
#[inline]
pub fn lerp(a: f32, b: f32, t: f32) -> f32 {
    // Not a + (b - a) t, which may miss b by a rounding error at t = 1.
    a * (1.0 - t) + b * t
}

/// Hermite step: 0 below `a`, 1 above `b`, smooth between.
#[inline]
pub fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    // 3 t^2 - 2 t^3 has zero slope at both ends.
    t * t * (3.0 - 2.0 * t)
}

/// The unit vector along `v`, or `fallback` if `v` is shorter than 1e-9.
#[inline]
pub fn normalize_or(v: Vec3, fallback: Vec3) -> Vec3 {
    let length = v.length();
    if length > 1e-9 { v / length } else { fallback }
}

/// Some unit vector perpendicular to the unit vector `v`, chosen by its smallest component.
#[inline]
pub fn perpendicular(v: Vec3) -> Vec3 {
    let a = v.abs();
    let axis = if a.x <= a.y && a.x <= a.z {
        Vec3::X
    } else if a.y <= a.z {
        Vec3::Y
    } else {
        Vec3::Z
    };
    normalize_or(v.cross(axis), Vec3::X)
}

/// The rotation of smallest angle that takes unit vector `from` to unit vector `to`; a half-turn for opposite vectors.
#[inline]
pub fn rotation_between(from: Vec3, to: Vec3) -> Quat {
    let d = from.dot(to);
    // Near opposite vectors the cross product vanishes: half a turn about any perpendicular axis, the quaternion (axis,
    // 0).
    if d < -0.999_999 {
        let axis = perpendicular(from);
        return Quat::from_xyzw(axis.x, axis.y, axis.z, 0.0);
    }
    // (from x to, 1 + from . to) is the unit quaternion of half the angle times 2 cos(angle / 2): no trigonometry is
    // needed.
    let c = from.cross(to);
    Quat::from_xyzw(c.x, c.y, c.z, 1.0 + d).normalize()
}

/// The rotation by `angle`, rad, about unit vector `axis`, counterclockwise for a viewer whom the axis points at.
#[inline]
pub fn rotation_about(axis: Vec3, angle: f32) -> Quat {
    let v = axis * sin_f32(0.5 * angle);
    Quat::from_xyzw(v.x, v.y, v.z, cos_f32(0.5 * angle)).normalize()
}

/// Normalised linear interpolation of two rotations along the shorter arc; unlike slerp not of constant angular speed.
#[inline]
pub fn nlerp(a: Quat, b: Quat, t: f32) -> Quat {
    // q and -q are the same rotation; the one in the hemisphere of `a` gives the shorter arc.
    let b = if a.dot(b) < 0.0 { -b } else { b };
    Quat::from_vec4(glam::Vec4::from(a) * (1.0 - t) + glam::Vec4::from(b) * t).normalize()
}

/// One step of the double-reflection rotation-minimising frame.
/// `x0`, `x1`: centres; `t0`, `t1`: unit tangents; `e0`: unit reference perpendicular to `t0`.
/// Returns the unit reference at `x1`, perpendicular to `t1`. Reflections with a divisor below 1e-18 are skipped.
/// Source: W. Wang et al., "Computation of rotation minimizing frames", ACM TOG 27(1), 2008, table 1.
#[inline]
pub fn transport(x0: Vec3, t0: Vec3, e0: Vec3, x1: Vec3, t1: Vec3) -> Vec3 {
    // First reflection: in the plane that bisects the segment x0 x1. It takes the frame from x0 to x1 and t0 to t_l.
    let v1 = x1 - x0;
    let c1 = v1.dot(v1);
    let (e_l, t_l) =
        if c1 < 1e-18 { (e0, t0) } else { (e0 - v1 * (2.0 / c1 * v1.dot(e0)), t0 - v1 * (2.0 / c1 * v1.dot(t0))) };
    // Second reflection: in the plane that bisects t_l and t1. Two reflections are a rotation, and this one twists least.
    let v2 = t1 - t_l;
    let c2 = v2.dot(v2);
    let e1 = if c2 < 1e-18 { e_l } else { e_l - v2 * (2.0 / c2 * v2.dot(e_l)) };
    // One Gram-Schmidt step removes the rounding error along the tangent, which would accumulate over a long chain.
    let e = e1 - t1 * t1.dot(e1);
    let length = e.length();
    if length > 1e-9 { e / length } else { perpendicular(t1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pinned_bits() {
        assert_eq!(sin(1.0).to_bits(), 0x3fea_ed54_8f09_0cee);
        assert_eq!(exp(1.0).to_bits(), 0x4005_bf0a_8b14_576a);
        assert_eq!(pow(2.0, 0.5).to_bits(), 0x3ff6_a09e_667f_3bcd);
    }

    #[test]
    fn rotation_between_maps_even_opposite_vectors() {
        for (a, b) in [(Vec3::X, Vec3::Y), (Vec3::Y, -Vec3::Y), (Vec3::Z, Vec3::Z)] {
            assert!((rotation_between(a, b) * a - b).length() < 1e-6);
        }
    }

    #[test]
    fn transport_keeps_the_reference_perpendicular_and_does_not_twist_in_a_plane() {
        let tangent = |a: f32| Vec3::new(-sin_f32(a), cos_f32(a), 0.0);
        let point = |a: f32| Vec3::new(cos_f32(a), sin_f32(a), 0.0);
        let mut e = Vec3::Z;
        for i in 0..64 {
            let (a, b) = (i as f32 * 0.05, (i + 1) as f32 * 0.05);
            e = transport(point(a), tangent(a), e, point(b), tangent(b));
            assert!(e.dot(tangent(b)).abs() < 1e-6);
        }
        assert!((e - Vec3::Z).length() < 1e-5, "a plane curve has no torsion");
    }
}
