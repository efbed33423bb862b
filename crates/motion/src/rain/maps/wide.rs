//! Numbers side by side, as many as the processor takes at once: texels of a row are worked on together.
//!
//! Only operations that IEEE 754 rounds in one way, and no fused ones: the bits do not depend on how many there are. What
//! handles them is `inline(always)` and holds no closures: these would not get the instructions of the lanes.

use std::f32::consts::{LN_2, LOG2_E};
use std::ops::{Add, Mul, Sub};

use pulp::Simd;

#[derive(Debug, Clone, Copy)]
pub(super) struct Wide<S: Simd>(pub S, pub S::f32s);

impl<S: Simd> Wide<S> {
    #[inline(always)]
    pub fn all(simd: S, x: f32) -> Self {
        Self(simd, simd.splat_f32s(x))
    }

    /// The first lanes from a short list, 0 in the others.
    #[inline(always)]
    pub fn part(simd: S, list: &[f32]) -> Self {
        Self(simd, simd.partial_load_f32s(list))
    }

    #[inline(always)]
    pub fn times(self, x: f32) -> Self {
        self * Self::all(self.0, x)
    }

    #[inline(always)]
    pub fn plus(self, x: f32) -> Self {
        self + Self::all(self.0, x)
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(self.0, self.0.sqrt_f32s(self.1))
    }

    #[inline(always)]
    pub fn inverse(self) -> Self {
        Self(self.0, self.0.div_f32s(self.0.splat_f32s(1.0), self.1))
    }

    #[inline(always)]
    pub fn max(self, o: Self) -> Self {
        Self(self.0, self.0.max_f32s(self.1, o.1))
    }

    #[inline(always)]
    pub fn at_least(self, x: f32) -> Self {
        self.max(Self::all(self.0, x))
    }

    #[inline(always)]
    pub fn at_most(self, x: f32) -> Self {
        Self(self.0, self.0.min_f32s(self.1, self.0.splat_f32s(x)))
    }

    /// The number where another is above a bound, 0 elsewhere.
    #[inline(always)]
    pub fn where_above(self, other: Self, bound: f32) -> Self {
        let mask = self.0.less_than_f32s(self.0.splat_f32s(bound), other.1);
        Self(self.0, self.0.select_f32s(mask, self.1, self.0.splat_f32s(0.0)))
    }

    /// e^x within 1e-5 of its value for x in [-87, 0], within 2e-7 from -1 on; e^-87 below.
    #[inline(always)]
    pub fn exp(self) -> Self {
        /// Adding it leaves a whole number in a float's last bits.
        const WHOLE: f32 = 12_582_912.0;
        /// Coefficients of 2^f around 0, |f| <= 0.5: ln 2^k / k!.
        const C: [f32; 6] = [LN_2, 0.240_226_5, 0.055_504_11, 0.009_618_129, 0.001_333_355_8, 0.000_154_035_3];
        let simd = self.0;
        let y = self.at_least(-87.0).times(LOG2_E);
        let k = y.plus(WHOLE);
        let f = y - k.plus(-WHOLE);
        let p = f.times(C[5]).plus(C[4]);
        let p = (((p * f).plus(C[3]) * f).plus(C[2]) * f).plus(C[1]);
        let p = ((p * f).plus(C[0]) * f).plus(1.0);
        // The whole part goes into the exponent.
        let whole = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(k.1), simd.splat_u32s(23));
        let bits = simd.add_u32s(simd.transmute_u32s_f32s(p.1), whole);
        Self(simd, simd.transmute_f32s_u32s(bits))
    }
}

impl<S: Simd> Add for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self(self.0, self.0.add_f32s(self.1, o.1))
    }
}

impl<S: Simd> Sub for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self(self.0, self.0.sub_f32s(self.1, o.1))
    }
}

impl<S: Simd> Mul for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self(self.0, self.0.mul_f32s(self.1, o.1))
    }
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;
    use osier_base::math;

    struct Exp<'a>(&'a mut [f32]);

    impl WithSimd for Exp<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            for part in self.0.chunks_mut(S::F32_LANES) {
                let all = Wide::part(simd, part).exp();
                simd.partial_store_f32s(part, all.1);
            }
        }
    }

    #[test]
    fn the_exponential_is_one_and_the_same_on_all_lanes() {
        let xs: Vec<f32> = (0..=8701).map(|i| -0.01 * i as f32).collect();
        let (mut wide, mut one) = (xs.clone(), xs.clone());
        Arch::new().dispatch(Exp(&mut wide));
        Arch::Scalar.dispatch(Exp(&mut one));
        assert_eq!(wide, one);
        for (x, found) in xs.into_iter().zip(wide).take(8700) {
            let (meant, found) = (math::exp(f64::from(x)), f64::from(found));
            assert!((found / meant - 1.0).abs() < 1e-5, "{x}: {found}");
            assert!(x < -1.0 || (found - meant).abs() < 2e-7, "{x}: {found}");
        }
        assert_eq!(one[0].to_bits(), 1.0_f32.to_bits());
    }
}
