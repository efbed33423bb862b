//! A leaf's blade sampled at the texels of a texture, and somewhat beyond its margin.

use glam::{DVec2, DVec3, Vec3};

use super::texel_window::{ColumnSpan, TexelWindow};
use crate::rain::leaf::relief::MaterialHeightMap;
use crate::rain::leaf::surface::{FirstFundamentalForm, LeafSurface, SurfacePoint};
use crate::rain::tuning::{FOLD_COSINE, MAP_BLEED, MAX_RELIEF_SAMPLES, WINDOW_MARGIN_MAX, WINDOW_MARGIN_MIN};
use osier_base::math::narrow;

/// Coordinate of texels far beyond the blade, m: so far away that no kernel reaches them.
const OFF_BLADE: f32 = 1e6;

/// The blade sampled at the texels of a texture; shared by all leaves of one shape.
#[derive(Debug)]
pub struct UvRaster {
    /// Number of texels along a side of the texture.
    pub(super) side: usize,
    /// Positions of the texels at scale 1, m, row by row from the top, component by component; [`OFF_BLADE`] more than [`MAP_BLEED`]
    /// texels beyond the blade.
    pub(super) p: [Vec<f32>; 3],
    /// Normals of the texels if the blade folds back on itself; other blades do not need them.
    n: Option<[Vec<f32>; 3]>,
    /// Factors from derivatives of height by u and v to slopes along the tangent and the bitangent, 1/m; see
    /// [`super::kernels::normal`].
    pub(super) slope_factors: [Vec<f32>; 3],
    /// Heights of the blade's relief at scale 1, m; `None` for a smooth blade.
    pub(super) relief: Option<Vec<f32>>,
    /// Factor on the radius of windows that covers the change of dp/du and dp/dv within them.
    margin: f64,
}

/// Texels of a raster in a range of indices, component by component.
pub(super) struct RasterRow<'a> {
    pub p: [&'a [f32]; 3],
    /// Empty unless the blade is folded.
    pub n: [&'a [f32]; 3],
}

/// Position, normal and slope factors at a texel on the blade, or on its continuation beyond the margin.
#[derive(Debug, Clone, Copy)]
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

/// A texel beyond the blade's margin whose values continue those of a texel on the blade.
#[derive(Debug, Clone, Copy)]
struct BleedTexel {
    texel: usize,
    /// Index of the nearest texel on the blade.
    source: usize,
    /// Whether it is one of the outermost, whose outer neighbours have no values.
    outermost: bool,
}

/// Texels within [`MAP_BLEED`] texels of those on the blade, from the margin outwards. Filters of renderers that reach over the
/// margin then find the values of the blade.
fn bleed_texels(on_blade: &[bool], side: usize) -> Vec<BleedTexel> {
    let mut source: Vec<Option<usize>> = (0..side * side).map(|k| on_blade[k].then_some(k)).collect();
    let mut ring: Vec<usize> = (0..side * side).filter(|k| on_blade[*k]).collect();
    let mut found = Vec::new();
    for distance in 1..=MAP_BLEED {
        // Candidates next to the last ring, each with the nearest of its neighbours' sources; of two equally near
        // the lower index.
        let squared = |a: usize, b: usize| {
            let [x, y] = [(a % side).abs_diff(b % side), (a / side).abs_diff(b / side)];
            x * x + y * y
        };
        let mut next: std::collections::BTreeMap<usize, usize> = std::collections::BTreeMap::new();
        for k in &ring {
            let Some(from) = source[*k] else { continue };
            let (x, y) = (k % side, k / side);
            for y in y.saturating_sub(1)..(y + 2).min(side) {
                for texel in (x.saturating_sub(1)..(x + 2).min(side)).map(|x| y * side + x) {
                    if source[texel].is_none() {
                        let best = next.entry(texel).or_insert(from);
                        let key = |s: usize| (squared(s, texel), s);
                        if key(from) < key(*best) {
                            *best = from;
                        }
                    }
                }
            }
        }
        next.iter().for_each(|(texel, from)| source[*texel] = Some(*from));
        let outermost = distance == MAP_BLEED;
        found.extend(next.iter().map(|(texel, source)| BleedTexel { texel: *texel, source: *source, outermost }));
        ring = next.into_keys().collect();
    }
    found
}

/// Heights of a relief at the texels of a blade, m, each the mean over its texel. Texels beyond the margin have the height of the
/// nearest texel on the blade, those farther away 0.
fn relief_texels(blade: &LeafSurface, side: usize, relief: &MaterialHeightMap, bleed: &[BleedTexel]) -> Vec<f32> {
    // As many samples across a texel as it has pixels of the map.
    let samples = relief.longer_side().div_ceil(side).clamp(1, MAX_RELIEF_SAMPLES);
    let n = (side * samples) as f64;
    let rows: Vec<usize> = (0..side).collect();
    let mean = |x: usize, y: usize| {
        let fine = |k: usize| (k * samples..(k + 1) * samples).map(|k| (k as f64 + 0.5) / n);
        let all = fine(y).flat_map(|y| fine(x).map(move |x| DVec2::new(x, 1.0 - y)));
        let heights = all.filter_map(|uv| Some(relief.height(blade.texture_uv(uv)?)));
        let (sum, count) = heights.fold((0.0, 0.0_f32), |s, h| (s.0 + h, s.1 + 1.0));
        sum / count.max(1.0)
    };
    let row = |y: &usize| -> Vec<f32> { (0..side).map(|x| mean(x, *y)).collect() };
    let mut heights: Vec<f32> = osier_base::par::par_map(&rows, row).into_iter().flatten().collect();
    // The center of a texel decides whether it is on the blade: replace also the means of bleed texels that overlap the blade.
    for b in bleed {
        heights[b.texel] = heights[b.source];
    }
    heights
}

impl UvRaster {
    /// Samples a blade at `side` by `side` texels. `relief`: heights over the texture coordinates of the blade's material.
    pub fn new(blade: &LeafSurface, side: usize, relief: Option<&MaterialHeightMap>) -> Self {
        let rows: Vec<usize> = (0..side).collect();
        let n = side as f64;
        let uv = |x: usize, y: usize| DVec2::new((x as f64 + 0.5) / n, 1.0 - (y as f64 + 0.5) / n);
        let row = |y: &usize| -> Vec<Option<SurfaceTexel>> {
            (0..side).map(|x| Some(SurfaceTexel::new(&blade.point_at(uv(x, *y), 1.0)?))).collect()
        };
        let mut texels: Vec<Option<SurfaceTexel>> =
            osier_base::par::par_map(&rows, row).into_iter().flatten().collect();
        // A blade whose normals all stay close to their mean cannot fold back on itself.
        let normals = || texels.iter().flatten().map(|t| Vec3::from_array(t.n));
        let mean = normals().sum::<Vec3>().normalize_or_zero();
        let folded = normals().any(|n| n.dot(mean) < FOLD_COSINE);
        // Windows use the tangent plane at their center: enlarge them by the variation of the map from texture to blade.
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
        // Beyond the margin the blade continues along the tangent planes of its outer texels.
        let on_blade: Vec<bool> = texels.iter().map(Option::is_some).collect();
        let bleed = bleed_texels(&on_blade, side);
        for b in &bleed {
            let [at, from] = [b.texel, b.source].map(|k| uv(k % side, k / side));
            texels[b.texel] = blade.point_at(from, 1.0).map(|near| {
                let SurfaceTexel { p, n, slope_factors } = SurfaceTexel::new(&SurfacePoint {
                    p: near.p + near.dpdu * (at - from).x + near.dpdv * (at - from).y,
                    ..near
                });
                // The outermost texels lack a neighbour, so that no slope can be computed.
                SurfaceTexel { p, n, slope_factors: if b.outermost { [0.0; 3] } else { slope_factors } }
            });
        }
        let column = |off_blade: f32, f: &dyn Fn(&SurfaceTexel) -> f32| -> Vec<f32> {
            texels.iter().map(|t| t.as_ref().map_or(off_blade, f)).collect()
        };
        Self {
            side,
            margin,
            p: [0, 1, 2].map(|k| column(OFF_BLADE, &|t| t.p[k])),
            n: folded.then(|| [0, 1, 2].map(|k| column(0.0, &|t| t.n[k]))),
            slope_factors: [0, 1, 2].map(|k| column(0.0, &|t| t.slope_factors[k])),
            relief: relief.map(|relief| relief_texels(blade, side, relief, &bleed)),
        }
    }

    /// Texels under a footprint of `radius`, m, stretched by `stretch` along the unit tangent `axis` and shrunk across it.
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
        // a x^2 + 2 b x y + c y^2 <= radius^2 in texture coordinates. Rows count downwards, against v, hence the sign of b.
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

    /// Whether parts of the blade face away from each other, so that kernels have to compare normals.
    pub(super) fn blade_is_folded(&self) -> bool {
        self.n.is_some()
    }

    /// The texels of a range of indices; their normals only if the blade is folded.
    #[inline(always)]
    pub(super) fn row_texels(&self, range: ColumnSpan) -> RasterRow<'_> {
        let ColumnSpan { start, end } = range;
        let [x, y, z] = &self.p;
        let p = [&x[start..end], &y[start..end], &z[start..end]];
        match &self.n {
            Some([x, y, z]) => RasterRow { p, n: [&x[start..end], &y[start..end], &z[start..end]] },
            None => RasterRow { p, n: [&[]; 3] },
        }
    }
}
