//! A leaf's blade sampled at the texels of a texture.

use glam::{DVec2, DVec3, Vec3};

use super::texel_window::{ColumnSpan, TexelWindow};
use crate::rain::leaf::surface::{FirstFundamentalForm, LeafSurface, SurfacePoint};
use crate::rain::tuning::{FOLD_COSINE, WINDOW_MARGIN_MAX, WINDOW_MARGIN_MIN};
use osier_base::math::narrow;

/// Coordinate of texels beyond the blade, m: so far away that no kernel reaches them.
const OFF_BLADE: f32 = 1e6;

/// The blade at the texels of a texture; shared by all leaves of one shape.
#[derive(Debug)]
pub struct UvRaster {
    /// Texels of a side of the texture.
    pub(super) side: usize,
    /// Positions of the texels at scale 1, m, row by row from the top, component by component; [`OFF_BLADE`] beyond the blade.
    pub(super) p: [Vec<f32>; 3],
    /// Normals of the texels of a blade that folds back on itself; others need none.
    n: Option<[Vec<f32>; 3]>,
    /// Factors from derivatives of height by u and v to slopes along the tangent and the bitangent, 1/m; see
    /// [`super::kernels::normal`].
    pub(super) slope_factors: [Vec<f32>; 3],
    /// Factor on the radius of windows that covers the change of dp/du and dp/dv within them.
    margin: f64,
}

/// Texels of a raster in a range of indices.
pub(super) struct RasterRow<'a> {
    pub p: [&'a [f32]; 3],
    /// Empty if the blade is not folded.
    pub n: [&'a [f32]; 3],
}

/// A texel on the blade.
struct SurfaceTexel {
    p: [f32; 3],
    n: [f32; 3],
    slope_factors: [f32; 3],
}

impl SurfaceTexel {
    fn new(point: &SurfacePoint) -> Self {
        let form = FirstFundamentalForm::new(point.dpdu, point.dpdv);
        // With the unit tangent T = dp/du / |dp/du| and the bitangent B = N x T: H_u = |dp/du| H_T, and
        // H_v = (F / |dp/du|) H_T + across H_B, where across = sqrt((E G - F^2) / E) is the part of dp/dv along B. Solved for the slopes:
        // H_T = H_u / sqrt(E), H_B = -F / (E across) H_u + H_v / across.
        let across = (form.determinant().max(0.0) / form.e).sqrt();
        let slope_factors = [1.0 / form.e.sqrt(), -form.f / (form.e * across), 1.0 / across];
        let slope_factors = slope_factors.map(|x| if x.is_finite() { x } else { 0.0 });
        Self {
            p: point.p.as_vec3().to_array(),
            n: point.n.as_vec3().to_array(),
            slope_factors: slope_factors.map(narrow),
        }
    }
}

impl UvRaster {
    /// Samples a blade at `side` by `side` texels.
    pub fn new(blade: &LeafSurface, side: usize) -> Self {
        let rows: Vec<usize> = (0..side).collect();
        let n = side as f64;
        let row = |y: &usize| -> Vec<Option<SurfaceTexel>> {
            let v = 1.0 - (*y as f64 + 0.5) / n;
            let texel = |x: usize| Some(SurfaceTexel::new(&blade.point_at(DVec2::new((x as f64 + 0.5) / n, v), 1.0)?));
            (0..side).map(texel).collect()
        };
        let texels: Vec<Option<SurfaceTexel>> = osier_base::par::par_map(&rows, row).into_iter().flatten().collect();
        let column = |off_blade: f32, f: &dyn Fn(&SurfaceTexel) -> f32| -> Vec<f32> {
            texels.iter().map(|t| t.as_ref().map_or(off_blade, f)).collect()
        };
        // A blade whose normals all stay close to their mean cannot fold back on itself.
        let normals = || texels.iter().flatten().map(|t| Vec3::from_array(t.n));
        let mean = normals().sum::<Vec3>().normalize_or_zero();
        let folded = normals().any(|n| n.dot(mean) < FOLD_COSINE);
        // Windows use the tangent plane at their center: widen them by how much the map from texture to blade varies.
        let range = |k: usize| {
            let all = texels.iter().flatten().map(|t| f64::from(t.slope_factors[k]));
            all.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)))
        };
        let [(u0, u1), (shear0, shear1), (v0, v1)] = [0, 1, 2].map(range);
        let variation = (u1 / u0).max(v1 / v0) - 1.0 + (shear1 - shear0) / u0;
        let margin = if variation.is_finite() {
            (WINDOW_MARGIN_MIN + variation).min(WINDOW_MARGIN_MAX)
        } else {
            WINDOW_MARGIN_MAX
        };
        Self {
            side,
            margin,
            p: [0, 1, 2].map(|k| column(OFF_BLADE, &|t| t.p[k])),
            n: folded.then(|| [0, 1, 2].map(|k| column(0.0, &|t| t.n[k]))),
            slope_factors: [0, 1, 2].map(|k| column(0.0, &|t| t.slope_factors[k])),
        }
    }

    /// Texels within `radius`, m, of a point with texture coordinates `uv`.
    pub(super) fn circle_window(&self, uv: DVec2, point: &SurfacePoint, radius: f64) -> TexelWindow {
        self.ellipse_window(uv, point.dpdu, point.dpdv, radius)
    }

    /// Texels under a footprint of `radius`, m, stretched by `stretch` along the unit tangent `axis`.
    pub(super) fn footprint_window(
        &self,
        uv: DVec2,
        point: &SurfacePoint,
        radius: f64,
        stretch: f64,
        axis: DVec3,
    ) -> TexelWindow {
        // In coordinates shrunk along the axis and stretched across it the footprint is a circle.
        let across = point.n.cross(axis);
        let unstretch = |j: DVec3| DVec3::new(j.dot(axis) / stretch, j.dot(across) * stretch, j.dot(point.n));
        self.ellipse_window(uv, unstretch(point.dpdu), unstretch(point.dpdv), radius)
    }

    /// Texels of the ellipse |dpdu du + dpdv dv| <= radius around `uv`.
    fn ellipse_window(&self, uv: DVec2, dpdu: DVec3, dpdv: DVec3, radius: f64) -> TexelWindow {
        let n = self.side as f64;
        let radius = self.margin * radius;
        // a x^2 + 2 b x y + c y^2 <= radius^2 in texture coordinates. Rows count against v, whence the sign of b.
        let (a, b, c) = (dpdu.dot(dpdu), -dpdu.dot(dpdv), dpdv.dot(dpdv));
        let det = (a * c - b * b).max(0.0);
        // Half-axes of the bounding box: radius sqrt(c / det) and radius sqrt(a / det).
        let r = DVec2::new(c, a).map(|x| (x / det.max(f64::MIN_POSITIVE)).sqrt() * radius);
        let clamp = |x: f64| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let k = x.clamp(0.0, n) as usize;
            k
        };
        // Row by row: x = -b / a y +- sqrt(radius^2 / a - det / a^2 y^2).
        let a = a.max(f64::MIN_POSITIVE);
        TexelWindow {
            lo: [clamp(((uv.x - r.x) * n).floor()), clamp(((1.0 - uv.y - r.y) * n).floor())],
            hi: [clamp(((uv.x + r.x) * n).ceil() + 1.0), clamp(((1.0 - uv.y + r.y) * n).ceil() + 1.0)],
            center: DVec2::new(uv.x, 1.0 - uv.y) * n,
            shear: -b / a,
            half_width2: radius * radius * n * n / a,
            half_width2_decrease: det / (a * a),
        }
    }

    /// Whether parts of the blade face away from each other.
    pub(super) fn is_folded(&self) -> bool {
        self.n.is_some()
    }

    /// The texels of a range of indices; their normals only if the blade is folded.
    #[inline(always)]
    pub(super) fn texel_range(&self, range: ColumnSpan) -> RasterRow<'_> {
        let ColumnSpan { start, end } = range;
        let [x, y, z] = &self.p;
        let p = [&x[start..end], &y[start..end], &z[start..end]];
        match &self.n {
            Some([x, y, z]) => RasterRow { p, n: [&x[start..end], &y[start..end], &z[start..end]] },
            None => RasterRow { p, n: [&[]; 3] },
        }
    }
}
