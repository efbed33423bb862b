//! Floating-point numbers in SIMD lanes, with the same bits on every instruction set.
//!
//! [`Lane`] is the arithmetic of a kernel: written once over `L: Lane`, it runs on a plain `f32` or `f64`, or on as many
//! numbers as a register of the processor holds ([`F32Lanes`], [`F64Lanes`]). All operations are those that IEEE 754 rounds
//! in one way, and a product and a sum are fused only by [`Lane::mul_add`], never by the compiler: the bits in a lane depend
//! neither on the number of lanes nor on the processor.
//!
//! Everything here is `#[inline(always)]`, and so must be every function between `pulp`'s dispatch and these; a closure
//! would not be compiled with the instructions that the dispatch chose.
//!
//! # Examples
//! ```
//! use osier_base::simd::{F32Lanes, Lane};
//! use pulp::{Arch, Simd, WithSimd};
//!
//! /// The hypotenuse of right triangles.
//! #[inline(always)]
//! fn hypotenuse<L: Lane>(a: L, b: L) -> L {
//!     (a * a + b * b).sqrt()
//! }
//!
//! struct All<'a>(&'a mut [f32]);
//!
//! impl WithSimd for All<'_> {
//!     type Output = ();
//!
//!     #[inline(always)]
//!     fn with_simd<S: Simd>(self, simd: S) {
//!         for part in self.0.chunks_mut(S::F32_LANES) {
//!             let a = F32Lanes::partial_load(simd, part);
//!             hypotenuse(a, a.splat(4.0)).partial_store(part);
//!         }
//!     }
//! }
//!
//! let mut sides = [3.0; 11];
//! Arch::new().dispatch(All(&mut sides));
//! assert_eq!(sides, [5.0; 11]);
//! assert_eq!(hypotenuse(3.0_f64, 4.0), 5.0);
//! ```

use std::f32::consts::{LN_2, LOG2_E};
use std::ops::{Add, Mul, Neg, Sub};

use pulp::{Scalar, Simd};

use crate::math;

/// One number, or one number in each lane of a register. Comparisons and extrema are meant for numbers only, not for NaN.
pub trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {
    /// `value`, rounded to the precision of the lanes, in every lane. `self` only names the instruction set.
    #[must_use]
    fn splat(self, value: f64) -> Self;

    /// self / divisor, lane by lane.
    #[must_use]
    fn div(self, divisor: Self) -> Self;

    /// Square root; NaN below 0.
    #[must_use]
    fn sqrt(self) -> Self;

    /// self a + b, rounded once.
    #[must_use]
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// The larger of both, lane by lane; for NaN the result depends on the instruction set.
    #[must_use]
    fn max(self, other: Self) -> Self;

    /// The smaller of both, lane by lane; for NaN the result depends on the instruction set.
    #[must_use]
    fn min(self, other: Self) -> Self;

    /// True if any lane is greater than `bound`, rounded to the precision of the lanes.
    fn any_gt(self, bound: f64) -> bool;

    /// True if all lanes are less than `bound`, rounded to the precision of the lanes.
    fn all_lt(self, bound: f64) -> bool;

    /// `then` in the lanes that are greater than `bound`, `otherwise` in the others.
    #[must_use]
    fn select_gt(self, bound: f64, then: Self, otherwise: Self) -> Self;

    /// `then` in the lanes that are less than `bound`, `otherwise` in the others.
    #[must_use]
    fn select_lt(self, bound: f64, then: Self, otherwise: Self) -> Self;
}

/// [`Lane`] for a plain number. `$round`: function that rounds an `f64` to the type.
macro_rules! scalar_lane {
    ($float:ty, $round:expr, $sqrt:path, $fused:path) => {
        impl Lane for $float {
            #[inline(always)]
            fn splat(self, value: f64) -> Self {
                $round(value)
            }
            #[inline(always)]
            fn div(self, divisor: Self) -> Self {
                self / divisor
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                $fused(self, a, b)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn any_gt(self, bound: f64) -> bool {
                self > $round(bound)
            }
            #[inline(always)]
            fn all_lt(self, bound: f64) -> bool {
                self < $round(bound)
            }
            #[inline(always)]
            fn select_gt(self, bound: f64, then: Self, otherwise: Self) -> Self {
                if self > $round(bound) { then } else { otherwise }
            }
            #[inline(always)]
            fn select_lt(self, bound: f64, then: Self, otherwise: Self) -> Self {
                if self < $round(bound) { then } else { otherwise }
            }
        }
    };
}

scalar_lane!(f32, math::narrow, math::sqrt_f32, math::fused_f32);
scalar_lane!(f64, std::convert::identity, math::sqrt, math::fused);

/// A register of numbers and its [`Lane`]. The names of `pulp`'s operations end in the type of the numbers.
macro_rules! register_lanes {
    (
        $(#[$doc:meta])*
        $name:ident, $float:ty, $round:expr, $register:ident, $count:ident,
        $splat:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $neg:ident, $sqrt:ident,
        $mul_add:ident, $max:ident, $min:ident, $reduce_max:ident, $less_than:ident, $select:ident, $first_true:ident
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy)]
        pub struct $name<S: Simd> {
            /// Token of the instruction set; operations on the register are its methods.
            pub simd: S,
            /// The register with one number per lane.
            pub value: S::$register,
        }

        impl<S: Simd> $name<S> {
            /// Wraps a register that an operation of `pulp` returned.
            #[inline(always)]
            pub fn new(simd: S, value: S::$register) -> Self {
                Self { simd, value }
            }

            /// `value` in every lane, without the conversion of [`Lane::splat`].
            #[inline(always)]
            pub fn from_scalar(simd: S, value: $float) -> Self {
                Self { simd, value: simd.$splat(value) }
            }

            /// Loads the first numbers of a slice, at most one register of them; the other lanes are 0.
            #[inline(always)]
            pub fn partial_load(simd: S, from: &[$float]) -> Self {
                Self { simd, value: simd.$load(from) }
            }

            /// Stores the first lanes to a slice, as many as it holds.
            #[inline(always)]
            pub fn partial_store(self, to: &mut [$float]) {
                self.simd.$store(to, self.value);
            }

            #[inline(always)]
            fn with(self, value: S::$register) -> Self {
                Self { simd: self.simd, value }
            }
        }

        impl $name<Scalar> {
            /// The number in the only lane of a processor without SIMD.
            #[inline(always)]
            pub fn scalar(self) -> $float {
                self.value
            }
        }

        impl<S: Simd> Add for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.with(self.simd.$add(self.value, other.value))
            }
        }

        impl<S: Simd> Add<$float> for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: $float) -> Self {
                self.with(self.simd.$add(self.value, self.simd.$splat(other)))
            }
        }

        impl<S: Simd> Sub for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.with(self.simd.$sub(self.value, other.value))
            }
        }

        impl<S: Simd> Mul for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.with(self.simd.$mul(self.value, other.value))
            }
        }

        impl<S: Simd> Mul<$float> for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: $float) -> Self {
                self.with(self.simd.$mul(self.value, self.simd.$splat(other)))
            }
        }

        impl<S: Simd> Neg for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.with(self.simd.$neg(self.value))
            }
        }

        impl<S: Simd> Lane for $name<S> {
            #[inline(always)]
            fn splat(self, value: f64) -> Self {
                Self::from_scalar(self.simd, $round(value))
            }
            #[inline(always)]
            fn div(self, divisor: Self) -> Self {
                self.with(self.simd.$div(self.value, divisor.value))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.with(self.simd.$sqrt(self.value))
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                self.with(self.simd.$mul_add(self.value, a.value, b.value))
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.with(self.simd.$max(self.value, other.value))
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                self.with(self.simd.$min(self.value, other.value))
            }
            #[inline(always)]
            fn any_gt(self, bound: f64) -> bool {
                let bound = self.simd.$splat($round(bound));
                // The index of the first true lane is the number of lanes if none is true.
                self.simd.$first_true(self.simd.$less_than(bound, self.value)) < S::$count
            }
            #[inline(always)]
            fn all_lt(self, bound: f64) -> bool {
                self.simd.$reduce_max(self.value) < $round(bound)
            }
            #[inline(always)]
            fn select_gt(self, bound: f64, then: Self, otherwise: Self) -> Self {
                let mask = self.simd.$less_than(self.simd.$splat($round(bound)), self.value);
                self.with(self.simd.$select(mask, then.value, otherwise.value))
            }
            #[inline(always)]
            fn select_lt(self, bound: f64, then: Self, otherwise: Self) -> Self {
                let mask = self.simd.$less_than(self.value, self.simd.$splat($round(bound)));
                self.with(self.simd.$select(mask, then.value, otherwise.value))
            }
        }
    };
}

register_lanes!(
    /// As many `f32` as a register of the instruction set holds.
    F32Lanes, f32, math::narrow, f32s, F32_LANES,
    splat_f32s, partial_load_f32s, partial_store_f32s, add_f32s, sub_f32s, mul_f32s, div_f32s, neg_f32s, sqrt_f32s,
    mul_add_f32s, max_f32s, min_f32s, reduce_max_f32s, less_than_f32s, select_f32s, first_true_m32s
);
register_lanes!(
    /// As many `f64` as a register of the instruction set holds.
    F64Lanes, f64, std::convert::identity, f64s, F64_LANES,
    splat_f64s, partial_load_f64s, partial_store_f64s, add_f64s, sub_f64s, mul_f64s, div_f64s, neg_f64s, sqrt_f64s,
    mul_add_f64s, max_f64s, min_f64s, reduce_max_f64s, less_than_f64s, select_f64s, first_true_m64s
);

impl<S: Simd> F32Lanes<S> {
    /// e^x, with a relative error below 1e-5 for x in [-87, 0] and below 2e-7 for x in [-1, 0]; e^-87 below.
    #[inline(always)]
    #[must_use]
    pub fn exp(self) -> Self {
        /// 1.5 * 2^23: the sum with it is rounded to an integer, which stands in the low bits of the significand.
        const ROUND_TO_INTEGER: f32 = 12_582_912.0;
        /// Taylor coefficients of 2^f at 0 from the first order on: (ln 2)^k / k!; |f| <= 0.5.
        const TAYLOR: [f32; 6] = [LN_2, 0.240_226_5, 0.055_504_11, 0.009_618_129, 0.001_333_355_8, 0.000_154_035_3];
        let simd = self.simd;
        // e^x = 2^y = 2^k 2^f, where y = x log2(e), k is the nearest integer and f what remains.
        let y = self.max(self.splat(-87.0)) * LOG2_E;
        let k = y + ROUND_TO_INTEGER;
        let f = y - (k + -ROUND_TO_INTEGER);
        // 2^f by Horner's scheme.
        let p = f * TAYLOR[5] + TAYLOR[4];
        let p = ((p * f + TAYLOR[3]) * f + TAYLOR[2]) * f + TAYLOR[1];
        let p = (p * f + TAYLOR[0]) * f + 1.0;
        // Times 2^k: k is added to the exponent, which begins at bit 23.
        let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(k.value), simd.splat_u32s(23));
        let bits = simd.add_u32s(simd.transmute_u32s_f32s(p.value), exponent);
        self.with(simd.transmute_f32s_u32s(bits))
    }
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;

    struct Exp<'a>(&'a mut [f32]);

    impl WithSimd for Exp<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            for part in self.0.chunks_mut(S::F32_LANES) {
                F32Lanes::partial_load(simd, part).exp().partial_store(part);
            }
        }
    }

    #[test]
    fn the_exponential_is_accurate_and_equal_on_all_instruction_sets() {
        let xs: Vec<f32> = (0..=8701).map(|i| -0.01 * i as f32).collect();
        let (mut wide, mut one) = (xs.clone(), xs.clone());
        Arch::new().dispatch(Exp(&mut wide));
        Arch::Scalar.dispatch(Exp(&mut one));
        assert_eq!(wide, one);
        for (x, y) in xs.into_iter().zip(wide).take(8700) {
            let (exact, y) = (math::exp(f64::from(x)), f64::from(y));
            assert!((y / exact - 1.0).abs() < 1e-5, "{x}: {y}");
            assert!(x < -1.0 || (y - exact).abs() < 2e-7, "{x}: {y}");
        }
        assert_eq!(one[0].to_bits(), 1.0_f32.to_bits());
    }

    /// One number through every operation.
    #[inline(always)]
    fn chain<L: Lane>(x: L) -> L {
        let y = x.mul_add(x, x.splat(0.1)).sqrt().div(x + x.splat(0.7));
        let z = y.select_gt(0.5, y * x, -y).max(x.splat(-0.3)).min(x.splat(0.9));
        z.select_lt(0.2, x - z, z)
    }

    struct Chain<'a>(&'a mut [f64]);

    impl WithSimd for Chain<'_> {
        type Output = bool;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> bool {
            let mut bounded = true;
            for part in self.0.chunks_mut(S::F64_LANES) {
                let all = chain(F64Lanes::partial_load(simd, part));
                bounded &= all.all_lt(2.0) && !all.any_gt(2.0);
                all.partial_store(part);
            }
            bounded
        }
    }

    #[test]
    fn a_lane_has_the_bits_of_a_plain_number() {
        let xs: Vec<f64> = (0..1001).map(|i| 0.001 * f64::from(i)).collect();
        let mut wide = xs.clone();
        assert!(Arch::new().dispatch(Chain(&mut wide)));
        for (x, y) in xs.into_iter().zip(wide) {
            assert_eq!(chain(x).to_bits(), y.to_bits(), "{x}");
        }
    }
}
