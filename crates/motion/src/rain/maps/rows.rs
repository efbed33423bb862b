//! What is done to rows of texels.

use std::ops::Range;

use glam::Vec3;
use pulp::{Arch, NullaryFnOnce, Simd, WithSimd};

use super::dirty::RowSpans;
use super::uv_raster::{RasterRow, TexelWindow, UvRaster};
use super::{DRY, TILE};
use crate::rain::drops::shape::{Footprint, SphericalCap};
use osier_base::math::narrow;
use osier_base::simd::{F32Lanes, Lane as _};

/// Texels that are worked on together: caps are narrow, and the widest vectors would mostly work beside them.
const GROUP: usize = 8;

/// The processor's vectors of [`GROUP`] numbers, if it has such.
pub(super) fn arch() -> Arch {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        return Arch::V3(v3);
    }
    Arch::new()
}

/// Where something stands on the leaf, as its texels are asked. `scale`: of the leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct KernelOrigin {
    pub p: [f32; 3],
    pub n: [f32; 3],
    pub scale: f32,
}

impl KernelOrigin {
    /// Ways from it to texels, m.
    #[inline(always)]
    fn way<S: Simd>(&self, p: [F32Lanes<S>; 3]) -> [F32Lanes<S>; 3] {
        [p[0] * self.scale + -self.p[0], p[1] * self.scale + -self.p[1], p[2] * self.scale + -self.p[2]]
    }
}

#[inline(always)]
fn along<S: Simd>(d: [F32Lanes<S>; 3], way: [f32; 3]) -> F32Lanes<S> {
    d[0] * way[0] + d[1] * way[1] + d[2] * way[2]
}

/// A cap as texels ask for it, in the precision of maps. Source: as [`SphericalCap::height`] and [`Footprint::at`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CapKernel {
    stand: KernelOrigin,
    /// Ways over the leaf, in base radii.
    along: [f32; 3],
    across: [f32; 3],
    skew: f32,
    a2: f32,
    r2: f32,
    base: f32,
    omega: f32,
    /// Square of the distance at which it ends, in base radii.
    ends: f32,
}

impl CapKernel {
    pub fn new(cap: &SphericalCap, print: &Footprint, stand: KernelOrigin, along: Vec3) -> Self {
        let across = Vec3::from_array(stand.n).cross(along);
        Self {
            stand,
            along: (along * narrow(1.0 / (cap.a * print.q))).to_array(),
            across: (across * narrow(print.q / cap.a)).to_array(),
            skew: narrow(print.skew),
            a2: narrow(cap.a * cap.a),
            r2: narrow(cap.r * cap.r),
            base: narrow(cap.r * cap.c),
            omega: narrow(cap.omega),
            ends: if cap.c < 0.0 { f32::INFINITY } else { 1.0 },
        }
    }
}

impl TexelKernel for CapKernel {
    #[inline(always)]
    fn stand(&self) -> &KernelOrigin {
        &self.stand
    }

    #[inline(always)]
    fn at<S: Simd>(&self, d: [F32Lanes<S>; 3]) -> F32Lanes<S> {
        let simd = d[0].simd;
        let (x, y) = (along(d, self.along), along(d, self.across));
        let rho2 = x * x + y * y;
        let under = F32Lanes::from_scalar(simd, self.r2) - rho2 * self.a2;
        let none = F32Lanes::from_scalar(simd, 0.0);
        // omega (sqrt(r^2 - a^2 rho^2) - r cos theta), sheared along the slope; 0 outside the contact line.
        let h = (under.max(none).sqrt() + -self.base).max(none) * self.omega;
        let h = h * (x.max(x.splat(-1.0)).min(x.splat(1.0)) * self.skew + 1.0);
        let h = under.select_gt(0.0, h, none);
        (F32Lanes::from_scalar(simd, self.ends) - rho2).select_gt(0.0, h, none)
    }
}

/// A wet place as texels ask for it. Source: [yang-wu] eq. 11.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WetSpotKernel {
    pub stand: KernelOrigin,
    /// How far, m, and 1 / width of its soft edge, 1/m.
    pub reach: f32,
    pub edge: f32,
    /// Wetness falls to 1 / e over this way: -1 / m.
    pub fall: f32,
    /// Wetness at its middle, in the store's units.
    pub peak: f32,
}

impl TexelKernel for WetSpotKernel {
    #[inline(always)]
    fn stand(&self) -> &KernelOrigin {
        &self.stand
    }

    #[inline(always)]
    fn at<S: Simd>(&self, d: [F32Lanes<S>; 3]) -> F32Lanes<S> {
        let simd = d[0].simd;
        let d = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let edge =
            ((F32Lanes::from_scalar(simd, self.reach) - d) * self.edge + 0.5).max(d.splat(0.0)).min(d.splat(1.0));
        edge * (d * self.fall).exp().min(d.splat(1.0)) * self.peak
    }
}

/// Something that raises texels around it.
pub(super) trait TexelKernel {
    /// Where it stands.
    fn stand(&self) -> &KernelOrigin;

    /// How high it is at ways from there, m.
    fn at<S: Simd>(&self, d: [F32Lanes<S>; 3]) -> F32Lanes<S>;
}

/// Raises texels of a row. Of a folded blade only those on the same side.
#[inline(always)]
fn press<S: Simd, const FOLDED: bool>(simd: S, stamp: &impl TexelKernel, row: &RasterRow<'_>, made: &mut [f32]) {
    let stand = *stamp.stand();
    let ([px, py, pz], [nx, ny, nz]) = (row.p, row.n);
    let ((px, x), (py, y), (pz, z)) = (S::as_simd_f32s(px), S::as_simd_f32s(py), S::as_simd_f32s(pz));
    let ((nx, u), (ny, v), (nz, w)) = (S::as_simd_f32s(nx), S::as_simd_f32s(ny), S::as_simd_f32s(nz));
    let (made, rest) = S::as_mut_simd_f32s(made);
    for (g, ((made, px), (py, pz))) in made.iter_mut().zip(px).zip(py.iter().zip(pz)).enumerate() {
        let mut h = stamp.at(stand.way([F32Lanes::new(simd, *px), F32Lanes::new(simd, *py), F32Lanes::new(simd, *pz)]));
        if FOLDED {
            let n = [F32Lanes::new(simd, nx[g]), F32Lanes::new(simd, ny[g]), F32Lanes::new(simd, nz[g])];
            h = along(n, stand.n).select_gt(0.0, h, h.splat(0.0));
        }
        *made = F32Lanes::new(simd, *made).max(h).value;
    }
    if !rest.is_empty() {
        let mut h = stamp.at(stand.way([
            F32Lanes::partial_load(simd, x),
            F32Lanes::partial_load(simd, y),
            F32Lanes::partial_load(simd, z),
        ]));
        if FOLDED {
            let n = [F32Lanes::partial_load(simd, u), F32Lanes::partial_load(simd, v), F32Lanes::partial_load(simd, w)];
            h = along(n, stand.n).select_gt(0.0, h, h.splat(0.0));
        }
        F32Lanes::partial_load(simd, rest).max(h).partial_store(rest);
    }
}

/// What a stamp does to some rows of a map, within its window and runs of columns. Dispatched, it tells how many texels that
/// were.
pub(super) struct MaxPass<'a, T> {
    pub stamp: &'a T,
    pub window: &'a TexelWindow,
    pub chart: &'a UvRaster,
    pub rows: &'a Range<usize>,
    pub runs: &'a RowSpans,
    pub made: &'a mut [f32],
}

impl<T: TexelKernel> WithSimd for MaxPass<'_, T> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u64 {
        let Self { stamp, window, chart, rows, runs, made } = self;
        let mut texels = 0;
        let end = window.hi[1].min(rows.end);
        for first in (window.lo[1].max(rows.start)..end).step_by(TILE) {
            for (y, ends) in (first..end).zip(window.columns(first)) {
                let (from, to) = window.whole_columns(ends);
                for run in runs.of(y) {
                    let (from, to) = (from.max(run.0), to.min(run.1));
                    if from >= to {
                        continue;
                    }
                    // Groups without a rest are faster, and the same texels on every machine.
                    let (from, to) = (from / GROUP * GROUP, to.next_multiple_of(GROUP).min(run.1));
                    texels += (to - from) as u64;
                    let (from, to) = (y * chart.side + from, y * chart.side + to);
                    let row = chart.row(from, to);
                    let made = &mut made[from..to];
                    if chart.is_folded() {
                        press::<S, true>(simd, stamp, &row, made);
                    } else {
                        press::<S, false>(simd, stamp, &row, made);
                    }
                }
            }
        }
        texels
    }
}

/// Heights around the texels of a row, and what slopes are made of.
pub(super) struct NormalInputs<'a> {
    /// The row's own heights, with one more at either end.
    pub own: &'a [f32],
    pub above: &'a [f32],
    pub below: &'a [f32],
    pub slopes: [&'a [f32]; 3],
    /// 1 / distance of the neighbours, in u and in v.
    pub per: [f32; 2],
}

/// Normals of the water's surface in tangent space. Source: -G^-1 (H_u, H_v) along the surface.
pub(super) struct NormalPass<'a>(pub &'a NormalInputs<'a>, pub &'a mut [[f32; 3]]);

/// Most numbers that a processor takes at once.
const MOST: usize = 16;

impl WithSimd for NormalPass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(NormalInputs { own, above, below, slopes: [s, t, u], per }, out) = self;
        let n = out.len();
        let (left, right) = (&own[..n], &own[2..n + 2]);
        let (above, below, s, t, u) = (&above[..n], &below[..n], &s[..n], &t[..n], &u[..n]);
        let [lefts, rights] = [left, right].map(|l| S::as_simd_f32s(l).0);
        let [aboves, belows] = [above, below].map(|l| S::as_simd_f32s(l).0);
        let [ss, ts, us] = [s, t, u].map(|l| S::as_simd_f32s(l).0);
        let none = F32Lanes::from_scalar(simd, 0.0);
        let mut parts = [[0.0_f32; MOST]; 3];
        let mut groups = out.chunks_exact_mut(S::F32_LANES);
        for (g, out) in groups.by_ref().enumerate() {
            let du = (F32Lanes::new(simd, rights[g]) - F32Lanes::new(simd, lefts[g])) * per[0];
            let dv = (F32Lanes::new(simd, aboves[g]) - F32Lanes::new(simd, belows[g])) * per[1];
            let x = du * F32Lanes::new(simd, ss[g]);
            let y = du * F32Lanes::new(simd, ts[g]) + dv * F32Lanes::new(simd, us[g]);
            let k = none.splat(1.0).div((x * x + y * y + 1.0).sqrt());
            S::as_mut_simd_f32s(&mut parts[0]).0[0] = (none - x * k).value;
            S::as_mut_simd_f32s(&mut parts[1]).0[0] = (none - y * k).value;
            S::as_mut_simd_f32s(&mut parts[2]).0[0] = k.value;
            let [x, y, z] = &parts;
            for (((out, x), y), z) in out.iter_mut().zip(x).zip(y).zip(z) {
                *out = [*x, *y, *z];
            }
        }
        let rest = groups.into_remainder();
        let done = n - rest.len();
        for (i, out) in (done..n).zip(rest) {
            let (du, dv) = ((right[i] - left[i]) * per[0], (above[i] - below[i]) * per[1]);
            *out = normal([du, dv], [s[i], t[i], u[i]]);
        }
    }
}

/// A normal by the changes of height per u and per v. `slopes`: as in [`super::UvRaster`], over the leaf's scale.
#[inline(always)]
pub(super) fn normal([du, dv]: [f32; 2], slopes: [f32; 3]) -> [f32; 3] {
    let (x, y) = (du * slopes[0], du * slopes[1] + dv * slopes[2]);
    let k = 1.0 / (x * x + y * y + 1.0).sqrt();
    [0.0 - x * k, 0.0 - y * k, k]
}

/// Dries a row; dispatched, it tells whether any wetness is left. `left`: share of what was.
pub(super) struct DryingPass<'a> {
    pub left: f32,
    pub wetness: &'a mut [f32],
}

impl NullaryFnOnce for DryingPass<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { left, wetness } = self;
        let mut any = 0_u32;
        for w in wetness {
            let now = *w * left;
            let now = if now < DRY { 0.0 } else { now };
            any |= now.to_bits();
            *w = now;
        }
        any != 0
    }
}
