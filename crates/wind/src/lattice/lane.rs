//! Numbers side by side, or one alone: what [`super::collide`] computes with.
//!
//! Only operations that IEEE 754 rounds in one way; where a product and a sum are one, the code says so, and never the
//! compiler: a lane's bits do not depend on how many there are, nor on the processor.
//! What handles lanes is `inline(always)` and holds no closures: these would not get the instructions of the lanes.

use std::ops::{Add, Mul, Sub};

use pulp::Simd;

use osier_base::math;

/// One number or several side by side.
pub(super) trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The same number in every lane.
    fn all(self, value: f64) -> Self;
    fn over(self, o: Self) -> Self;
    fn sqrt(self) -> Self;
    /// self a + b, rounded once.
    fn fused(self, a: Self, b: Self) -> Self;
    /// Whether any lane is above; never for NaN.
    fn any_above(self, bound: f64) -> bool;
    /// `then` where a lane is above `bound`, `otherwise` elsewhere.
    fn above(self, bound: f64, then: Self, otherwise: Self) -> Self;
}

impl Lane for f64 {
    #[inline(always)]
    fn all(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn over(self, o: Self) -> Self {
        self / o
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        math::sqrt(self)
    }
    #[inline(always)]
    fn fused(self, a: Self, b: Self) -> Self {
        math::fused(self, a, b)
    }
    #[inline(always)]
    fn any_above(self, bound: f64) -> bool {
        self > bound
    }
    #[inline(always)]
    fn above(self, bound: f64, then: Self, otherwise: Self) -> Self {
        if self > bound { then } else { otherwise }
    }
}

impl Lane for f32 {
    #[inline(always)]
    fn all(self, value: f64) -> Self {
        math::narrow(value)
    }
    #[inline(always)]
    fn over(self, o: Self) -> Self {
        self / o
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        math::sqrt_f32(self)
    }
    #[inline(always)]
    fn fused(self, a: Self, b: Self) -> Self {
        math::fused_f32(self, a, b)
    }
    #[inline(always)]
    fn any_above(self, bound: f64) -> bool {
        self > math::narrow(bound)
    }
    #[inline(always)]
    fn above(self, bound: f64, then: Self, otherwise: Self) -> Self {
        if self > math::narrow(bound) { then } else { otherwise }
    }
}

/// As many `f32` as the processor takes at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wide<S: Simd> {
    simd: S,
    pub(super) value: S::f32s,
}

impl<S: Simd> Wide<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, value: S::f32s) -> Self {
        Self { simd, value }
    }

    #[inline(always)]
    pub(super) fn splat(simd: S, value: f32) -> Self {
        Self { simd, value: simd.splat_f32s(value) }
    }
}

impl<S: Simd> Wide<S> {
    /// The larger of each lane; numbers only.
    #[inline(always)]
    pub(super) fn larger(self, o: Self) -> Self {
        Self { simd: self.simd, value: self.simd.max_f32s(self.value, o.value) }
    }
}

impl<S: Simd> Add for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { simd: self.simd, value: self.simd.add_f32s(self.value, o.value) }
    }
}

impl<S: Simd> Sub for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { simd: self.simd, value: self.simd.sub_f32s(self.value, o.value) }
    }
}

impl<S: Simd> Mul for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self { simd: self.simd, value: self.simd.mul_f32s(self.value, o.value) }
    }
}

impl<S: Simd> Lane for Wide<S> {
    #[inline(always)]
    fn all(self, value: f64) -> Self {
        Self::splat(self.simd, math::narrow(value))
    }
    #[inline(always)]
    fn over(self, o: Self) -> Self {
        Self { simd: self.simd, value: self.simd.div_f32s(self.value, o.value) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self { simd: self.simd, value: self.simd.sqrt_f32s(self.value) }
    }
    #[inline(always)]
    fn fused(self, a: Self, b: Self) -> Self {
        Self { simd: self.simd, value: self.simd.mul_add_f32s(self.value, a.value, b.value) }
    }
    #[inline(always)]
    fn any_above(self, bound: f64) -> bool {
        let bound = self.simd.splat_f32s(math::narrow(bound));
        self.simd.first_true_m32s(self.simd.less_than_f32s(bound, self.value)) < S::F32_LANES
    }
    #[inline(always)]
    fn above(self, bound: f64, then: Self, otherwise: Self) -> Self {
        let bound = self.simd.splat_f32s(math::narrow(bound));
        let mask = self.simd.less_than_f32s(bound, self.value);
        Self { simd: self.simd, value: self.simd.select_f32s(mask, then.value, otherwise.value) }
    }
}
