//! SIMD kernels over rows of texels: caps and wet spots (maximum), normals, drying.
//!
//! No product and sum are fused, so that results do not depend on the instruction set.

use std::ops::Range;

use glam::Vec3;
use pulp::{Arch, NullaryFnOnce, Simd, WithSimd};

use super::TILE;
use super::dirty_spans::RowSpans;
use super::texel_window::{ColumnSpan, TexelWindow};
use super::uv_raster::{RasterRow, UvRaster};
use crate::rain::drops::spherical_cap::{CapDeformation, SphericalCap};
use crate::rain::tuning::MIN_MAP_WETNESS;
use osier_base::math::narrow;
use osier_base::simd::{F32Lanes, Lane as _};

/// Texels that are processed together, the lanes of AVX2: caps are narrow, and wider vectors would mostly hold
/// texels beside them.
const GROUP: usize = 8;
/// Largest number of `f32` lanes of any instruction set.
const MAX_LANES: usize = 16;

/// The instruction set with vectors of [`GROUP`] lanes, if the processor has it, else the default one.
pub(super) fn arch() -> Arch {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        return Arch::V3(v3);
    }
    Arch::new()
}

/// Position and normal at the center of a kernel, and the scale of its leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CenterOnLeaf {
    /// Position on the scaled leaf, m.
    pub p: [f32; 3],
    pub n: [f32; 3],
    pub scale: f32,
}

impl CenterOnLeaf {
    /// Vectors from the center to texels at positions `p` of the blade at scale 1, m.
    #[inline(always)]
    fn offset<S: Simd>(&self, p: [F32Lanes<S>; 3]) -> [F32Lanes<S>; 3] {
        [p[0] * self.scale + -self.p[0], p[1] * self.scale + -self.p[1], p[2] * self.scale + -self.p[2]]
    }
}

#[inline(always)]
fn dot<S: Simd>(d: [F32Lanes<S>; 3], v: [f32; 3]) -> F32Lanes<S> {
    d[0] * v[0] + d[1] * v[1] + d[2] * v[2]
}

/// A function of the position around a center on the leaf.
pub(super) trait TexelKernel {
    fn center(&self) -> &CenterOnLeaf;

    /// Values at vectors `d` from the center, m; 0 outside of the kernel.
    fn evaluate<S: Simd>(&self, d: [F32Lanes<S>; 3]) -> F32Lanes<S>;
}

/// Height of a cap over the leaf, m; [`SphericalCap::height`] and [`CapDeformation::to_undeformed`] in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CapHeightKernel {
    center: CenterOnLeaf,
    /// Covectors that give the position in the undeformed footprint in base radii, 1/m.
    along: [f32; 3],
    across: [f32; 3],
    skew: f32,
    /// Square of the base radius a, m^2.
    a2: f32,
    /// Square of the sphere's radius r, m^2.
    r2: f32,
    /// r cos(theta), the height of the base over the sphere's center, m.
    base: f32,
    height_factor: f32,
    /// [`SphericalCap::wedge`] divided by the sphere's radius, 1/m.
    wedge: f32,
    /// Squared distance from the axis at which the cap ends, in base radii; infinite if the sphere's equator ends it.
    max_rho2: f32,
}

impl CapHeightKernel {
    /// `axis`: the unit tangent along which the cap is stretched and sheared.
    pub fn new(cap: &SphericalCap, deformation: &CapDeformation, center: CenterOnLeaf, axis: Vec3) -> Self {
        // Coordinates in the undeformed cap x = d . axis / (a stretch) and y = d . across stretch / a, with the factors in the covectors.
        let across = Vec3::from_array(center.n).cross(axis);
        Self {
            center,
            along: (axis * narrow(1.0 / (cap.a * deformation.stretch))).to_array(),
            across: (across * narrow(deformation.stretch / cap.a)).to_array(),
            skew: narrow(deformation.skew),
            a2: narrow(cap.a * cap.a),
            r2: narrow(cap.r * cap.r),
            base: narrow(cap.r * cap.cos_angle),
            height_factor: narrow(cap.height_factor),
            wedge: narrow(cap.wedge / cap.r),
            max_rho2: if cap.cos_angle < 0.0 { f32::INFINITY } else { 1.0 },
        }
    }
}

impl TexelKernel for CapHeightKernel {
    #[inline(always)]
    fn center(&self) -> &CenterOnLeaf {
        &self.center
    }

    #[inline(always)]
    fn evaluate<S: Simd>(&self, d: [F32Lanes<S>; 3]) -> F32Lanes<S> {
        let simd = d[0].simd;
        let (x, y) = (dot(d, self.along), dot(d, self.across));
        let rho2 = x * x + y * y;
        let under = F32Lanes::from_scalar(simd, self.r2) - rho2 * self.a2;
        let zero = F32Lanes::from_scalar(simd, 0.0);
        // h = factor (sqrt(r^2 - a^2 rho^2) - r cos(theta)) (1 + skew x), with x clamped to the footprint.
        let over_center = under.max(zero).sqrt();
        let mut h = (over_center + -self.base).max(zero) * self.height_factor;
        if self.wedge != 0.0 {
            // e^x by its series: x is at most ln 1.5, where the first term left out is below 1e-5.
            let x = over_center * self.wedge;
            let series = [5.0, 4.0, 3.0, 2.0, 1.0].iter().fold(x.splat(1.0), |sum, k| sum * x * (1.0 / k) + 1.0);
            h = h * series;
        }
        let h = h * (x.max(x.splat(-1.0)).min(x.splat(1.0)) * self.skew + 1.0);
        // 0 outside of the sphere and outside of the contact line.
        let h = under.select_gt(0.0, h, zero);
        (F32Lanes::from_scalar(simd, self.max_rho2) - rho2).select_gt(0.0, h, zero)
    }
}

/// Wetness around a path that was under water: w = peak edge(d) exp(-d / length), where d is the distance from the path. The end
/// of the path is the center. Source: [yang-wu] eq. 11, for a drop that moves along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WetPathKernel {
    pub center: CenterOnLeaf,
    /// Vector from the center to the beginning of the path, m.
    pub path: [f32; 3],
    /// `path` divided by its squared length, 1/m; 0 for a path without length.
    pub along: [f32; 3],
    /// Distance from the path at which the wet area ends, m.
    pub radius: f32,
    /// Inverse width of the linear edge, 1/m.
    pub inverse_edge: f32,
    /// Derivative of the exponent by the distance, -1/m.
    pub exponent_rate: f32,
    /// Wetness at the center, 0 to 1.
    pub peak: f32,
}

impl TexelKernel for WetPathKernel {
    #[inline(always)]
    fn center(&self) -> &CenterOnLeaf {
        &self.center
    }

    #[inline(always)]
    fn evaluate<S: Simd>(&self, d: [F32Lanes<S>; 3]) -> F32Lanes<S> {
        let simd = d[0].simd;
        // The nearest point of the path: the projection onto it, clamped to its ends.
        let t = dot(d, self.along).max(d[0].splat(0.0)).min(d[0].splat(1.0));
        let d = [d[0] - t * self.path[0], d[1] - t * self.path[1], d[2] - t * self.path[2]];
        let d = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        // Coverage of a texel by the swept disk, antialiased: (radius - d) / width + 1/2, clamped to 0 to 1.
        let edge = ((F32Lanes::from_scalar(simd, self.radius) - d) * self.inverse_edge + 0.5)
            .max(d.splat(0.0))
            .min(d.splat(1.0));
        edge * (d * self.exponent_rate).exp().min(d.splat(1.0)) * self.peak
    }
}

/// Raises texels of a span of a row to the values of the kernel. On a `FOLDED` blade only texels whose normal points to the side
/// of the kernel's normal are raised, since a fold brings the other side close.
#[inline(always)]
fn raise_texels<S: Simd, const FOLDED: bool>(
    simd: S,
    kernel: &impl TexelKernel,
    row: &RasterRow<'_>,
    texels: &mut [f32],
) {
    let center = *kernel.center();
    let ([px, py, pz], [nx, ny, nz]) = (row.p, row.n);
    let ((px, x), (py, y), (pz, z)) = (S::as_simd_f32s(px), S::as_simd_f32s(py), S::as_simd_f32s(pz));
    let ((nx, u), (ny, v), (nz, w)) = (S::as_simd_f32s(nx), S::as_simd_f32s(ny), S::as_simd_f32s(nz));
    // Whole vectors of texels; the remainder follows below.
    let (texels, rest) = S::as_mut_simd_f32s(texels);
    for (g, ((texels, px), (py, pz))) in texels.iter_mut().zip(px).zip(py.iter().zip(pz)).enumerate() {
        let p = [F32Lanes::new(simd, *px), F32Lanes::new(simd, *py), F32Lanes::new(simd, *pz)];
        let mut h = kernel.evaluate(center.offset(p));
        // The sign of n . n0 says on which side of a fold the texels lie.
        if FOLDED {
            let n = [F32Lanes::new(simd, nx[g]), F32Lanes::new(simd, ny[g]), F32Lanes::new(simd, nz[g])];
            h = dot(n, center.n).select_gt(0.0, h, h.splat(0.0));
        }
        *texels = F32Lanes::new(simd, *texels).max(h).value;
    }
    // The rest of the span is less than a vector: missing lanes load zeros and are not stored.
    if !rest.is_empty() {
        let p = [F32Lanes::partial_load(simd, x), F32Lanes::partial_load(simd, y), F32Lanes::partial_load(simd, z)];
        let mut h = kernel.evaluate(center.offset(p));
        if FOLDED {
            let n = [F32Lanes::partial_load(simd, u), F32Lanes::partial_load(simd, v), F32Lanes::partial_load(simd, w)];
            h = dot(n, center.n).select_gt(0.0, h, h.splat(0.0));
        }
        F32Lanes::partial_load(simd, rest).max(h).partial_store(rest);
    }
}

/// Raises texels of some rows of a map to the values of a kernel, within its window and the spans of columns. Returns the number
/// of texels processed.
pub(super) struct MaxBlendPass<'a, T> {
    pub kernel: &'a T,
    pub window: &'a TexelWindow,
    pub raster: &'a UvRaster,
    pub rows: &'a Range<usize>,
    pub spans: &'a RowSpans,
    /// The whole map, row by row.
    pub texels: &'a mut [f32],
}

impl<T: TexelKernel> WithSimd for MaxBlendPass<'_, T> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u64 {
        let Self { kernel, window, raster, rows, spans, texels } = self;
        let mut count = 0;
        let last = window.hi[1].min(rows.end);
        for first in (window.lo[1].max(rows.start)..last).step_by(TILE) {
            for (y, bounds) in (first..last).zip(window.tile_row_bounds(first)) {
                // Intersect the window's columns of this row with the spans to process.
                let columns = window.columns_within(bounds);
                for span in spans.row(y) {
                    let (from, to) = (columns.start.max(span.start), columns.end.min(span.end));
                    if from >= to {
                        continue;
                    }
                    // Extend to whole groups, within the span: vectors without a rest are faster, and the set of texels does not
                    // depend on the machine's vectors.
                    let (from, to) = (from / GROUP * GROUP, to.next_multiple_of(GROUP).min(span.end));
                    count += (to - from) as u64;
                    let columns = ColumnSpan { start: y * raster.side + from, end: y * raster.side + to };
                    let row = raster.row_texels(columns);
                    let texels = &mut texels[columns.start..columns.end];
                    if raster.blade_is_folded() {
                        raise_texels::<S, true>(simd, kernel, &row, texels);
                    } else {
                        raise_texels::<S, false>(simd, kernel, &row, texels);
                    }
                }
            }
        }
        count
    }
}

/// Heights around a span of a row, and the factors that turn their differences into slopes.
pub(super) struct NormalInputs<'a> {
    /// Heights of the row, with one more texel at either end, m.
    pub row: &'a [f32],
    pub above: &'a [f32],
    pub below: &'a [f32],
    /// As in [`UvRaster`].
    pub slope_factors: [&'a [f32]; 3],
    /// Inverse of the distance between opposite neighbours in u and in v, divided by the leaf's scale.
    pub inverse_distance: [f32; 2],
}

/// Normals of the water surface in tangent space, over a span of a row; see [`normal`].
pub(super) struct NormalPass<'a> {
    pub inputs: &'a NormalInputs<'a>,
    pub normals: &'a mut [[f32; 3]],
}

impl WithSimd for NormalPass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, normals } = self;
        let NormalInputs { row, above, below, slope_factors: [s, t, u], inverse_distance } = inputs;
        let n = normals.len();
        // Neighbours to the left and right are the row itself, shifted.
        let (left, right) = (&row[..n], &row[2..n + 2]);
        let (above, below, s, t, u) = (&above[..n], &below[..n], &s[..n], &t[..n], &u[..n]);
        let [lefts, rights] = [left, right].map(|l| S::as_simd_f32s(l).0);
        let [aboves, belows] = [above, below].map(|l| S::as_simd_f32s(l).0);
        let [ss, ts, us] = [s, t, u].map(|l| S::as_simd_f32s(l).0);
        let zero = F32Lanes::from_scalar(simd, 0.0);
        let mut components = [[0.0_f32; MAX_LANES]; 3];
        let mut groups = normals.chunks_exact_mut(S::F32_LANES);
        for (g, out) in groups.by_ref().enumerate() {
            // The formula of `normal`, in the same order of operations, so that vectors and remainder agree bit for bit.
            let du = (F32Lanes::new(simd, rights[g]) - F32Lanes::new(simd, lefts[g])) * inverse_distance[0];
            let dv = (F32Lanes::new(simd, aboves[g]) - F32Lanes::new(simd, belows[g])) * inverse_distance[1];
            let x = du * F32Lanes::new(simd, ss[g]);
            let y = du * F32Lanes::new(simd, ts[g]) + dv * F32Lanes::new(simd, us[g]);
            let k = zero.splat(1.0).div((x * x + y * y + 1.0).sqrt());
            S::as_mut_simd_f32s(&mut components[0]).0[0] = (zero - x * k).value;
            S::as_mut_simd_f32s(&mut components[1]).0[0] = (zero - y * k).value;
            S::as_mut_simd_f32s(&mut components[2]).0[0] = k.value;
            // Interleave: lanes hold components, the map holds vectors.
            let [x, y, z] = &components;
            for (((out, x), y), z) in out.iter_mut().zip(x).zip(y).zip(z) {
                *out = [*x, *y, *z];
            }
        }
        // The rest of the span, less than a vector, one by one.
        let rest = groups.into_remainder();
        let done = n - rest.len();
        for (i, out) in (done..n).zip(rest) {
            let du = (right[i] - left[i]) * inverse_distance[0];
            let dv = (above[i] - below[i]) * inverse_distance[1];
            *out = normal([du, dv], [s[i], t[i], u[i]]);
        }
    }
}

/// Normal of the water surface in tangent space from the derivatives of its height with respect to u and v, m: (-x, -y, 1)
/// normalized, where x and y are the slopes along the tangent (dp/du) and the bitangent. `slope_factors`: as in [`UvRaster`].
#[inline(always)]
pub(super) fn normal([du, dv]: [f32; 2], slope_factors: [f32; 3]) -> [f32; 3] {
    let (x, y) = (du * slope_factors[0], du * slope_factors[1] + dv * slope_factors[2]);
    let k = 1.0 / (x * x + y * y + 1.0).sqrt();
    [0.0 - x * k, 0.0 - y * k, k]
}

/// Multiplies the wetness of a span of a row by `decay`, with values below [`MIN_MAP_WETNESS`] set to 0. Returns whether any wetness
/// is left.
pub(super) struct DryingPass<'a> {
    pub decay: f32,
    pub wetness: &'a mut [f32],
}

impl NullaryFnOnce for DryingPass<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { decay, wetness } = self;
        // The bitwise or of all values is 0 only if all are +0; it vectorizes, unlike a comparison with early exit.
        let mut any = 0_u32;
        for w in wetness {
            let now = *w * decay;
            let now = if now < MIN_MAP_WETNESS { 0.0 } else { now };
            any |= now.to_bits();
            *w = now;
        }
        any != 0
    }
}
