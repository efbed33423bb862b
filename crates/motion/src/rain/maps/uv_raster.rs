//! What a leaf's texture knows of its blade, and which of its texels a place reaches.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec3};

use super::TILE;
use crate::rain::leaf::surface::{LeafSurface, SurfacePoint};
use osier_base::math::narrow;

/// Windows are larger than what they hold by a factor: the least, and the most for blades whose texture is stretched here
/// and squeezed there.
const MARGIN: [f64; 2] = [1.05, 1.25];

/// Place of texels beyond the blade, m.
const FAR: f32 = 1e6;
/// Normals that all turn less than this from their mean are all on one side of it: cosine.
const ONE_SIDE: f32 = 0.8;

/// What a leaf's texture knows of its blade: made once, shared by all leaves of one form.
#[derive(Debug)]
pub struct UvRaster {
    pub(super) side: usize,
    /// Places of the texels, m of the blade's own space, component by component; [`FAR`] away beyond the blade.
    pub(super) p: [Vec<f32>; 3],
    /// Their normals, of blades that fold back on themselves; others need none.
    n: Option<[Vec<f32>; 3]>,
    /// What makes slopes in tangent space of changes per u and per v, 1/m: how, [`super::rows::normal`] tells.
    pub(super) slopes: [Vec<f32>; 3],
    /// Factor by which windows are larger than a distance at their middle asks for.
    margin: f64,
}

/// A row's texels of a chart.
pub(super) struct RasterRow<'a> {
    pub p: [&'a [f32]; 3],
    /// Empty where the blade is not folded.
    pub n: [&'a [f32]; 3],
}

/// A texel that is on the blade.
struct SurfaceTexel {
    p: [f32; 3],
    n: [f32; 3],
    slopes: [f32; 3],
}

impl SurfaceTexel {
    fn of(spot: &SurfacePoint) -> Self {
        let (a, b, c) = (spot.ju.dot(spot.ju), spot.ju.dot(spot.jv), spot.jv.dot(spot.jv));
        // H_u is the slope along u times |J_u|; what is left of H_v goes along the part of J_v across it.
        let across = ((a * c - b * b).max(0.0) / a).sqrt();
        let slopes = [1.0 / a.sqrt(), -b / (a * across), 1.0 / across].map(|x| if x.is_finite() { x } else { 0.0 });
        Self { p: spot.p.as_vec3().to_array(), n: spot.n.as_vec3().to_array(), slopes: slopes.map(narrow) }
    }
}

/// Rows and columns of texels, ends excluded, and the ellipse within them that a distance on the blade is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TexelWindow {
    pub lo: [usize; 2],
    pub hi: [usize; 2],
    middle: DVec2,
    /// Shift of the middle by row, and square of half of the width: at the middle, and less of it by row squared.
    lean: f64,
    half: [f64; 2],
}

impl TexelWindow {
    /// All texels.
    pub fn whole(side: usize) -> Self {
        Self { lo: [0; 2], hi: [side; 2], middle: DVec2::ZERO, lean: 0.0, half: [f64::INFINITY, 0.0] }
    }

    /// Whether it has some of a range of rows.
    pub fn meets(&self, rows: &Range<usize>) -> bool {
        self.lo[1] < rows.end && rows.start < self.hi[1]
    }

    /// Columns of some of its rows, ends excluded: at least those of each.
    pub fn span(&self, rows: Range<usize>) -> (usize, usize) {
        let rows = [rows.start.max(self.lo[1]), rows.end.min(self.hi[1]).saturating_sub(1)];
        let [first, last] = rows.map(|y| y as f64 + 0.5 - self.middle.y);
        let widest = first.max(0.0).min(last.max(first));
        let half = (self.half[0] - self.half[1] * widest * widest).max(0.0).sqrt() + 1.0;
        let [a, b] = [first, last].map(|dy| self.middle.x + self.lean * dy);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let (from, to) = ((a.min(b) - half) as usize, (a.max(b) + half + 1.0) as usize);
        (from.max(self.lo[0]), to.min(self.hi[0]))
    }

    /// Columns of [`TILE`] rows from `first` on, ends excluded, as numbers with fractions. All at once, as the processor takes
    /// several roots together and many windows are narrow.
    #[inline(always)]
    pub fn columns(&self, first: usize) -> [[f64; 2]; TILE] {
        let mut ends = [[0.0; TILE]; 2];
        let y = first as f64 + 0.5 - self.middle.y;
        let [starts, stops] = &mut ends;
        for (i, (from, to)) in starts.iter_mut().zip(stops).enumerate() {
            let dy = y + i as f64;
            let middle = self.middle.x + self.lean * dy;
            // Texels whose middle lies within, and somewhat more.
            let half = (self.half[0] - self.half[1] * dy * dy).max(0.0).sqrt() + 0.1;
            (*from, *to) = (middle - half - 0.5, middle + half + 0.5);
        }
        std::array::from_fn(|i| [ends[0][i], ends[1][i]])
    }

    /// Whole columns from those with fractions.
    #[inline(always)]
    pub fn whole_columns(&self, [from, to]: [f64; 2]) -> (usize, usize) {
        // Casts to whole numbers saturate: what is below 0 becomes 0.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let (from, to) = (from as usize, to as usize);
        (from.max(self.lo[0]), to.min(self.hi[0]))
    }
}

impl UvRaster {
    /// Looks up each of `side` by `side` texels.
    pub fn new(sheet: &LeafSurface, side: usize) -> Self {
        let rows: Vec<usize> = (0..side).collect();
        let n = side as f64;
        let row = |y: &usize| -> Vec<Option<SurfaceTexel>> {
            let v = 1.0 - (*y as f64 + 0.5) / n;
            let texel = |x: usize| Some(SurfaceTexel::of(&sheet.at(DVec2::new((x as f64 + 0.5) / n, v), 1.0)?));
            (0..side).map(texel).collect()
        };
        let texels: Vec<Option<SurfaceTexel>> = osier_base::par::par_map(&rows, row).into_iter().flatten().collect();
        let list = |beyond: f32, f: &dyn Fn(&SurfaceTexel) -> f32| -> Vec<f32> {
            texels.iter().map(|t| t.as_ref().map_or(beyond, f)).collect()
        };
        let normals = || texels.iter().flatten().map(|t| Vec3::from_array(t.n));
        let mean = normals().sum::<Vec3>().normalize_or_zero();
        let folded = normals().any(|n| n.dot(mean) < ONE_SIDE);
        let range = |k: usize| {
            let all = texels.iter().flatten().map(|t| f64::from(t.slopes[k]));
            all.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)))
        };
        let [(u0, u1), (lean0, lean1), (v0, v1)] = [0, 1, 2].map(range);
        let differs = (u1 / u0).max(v1 / v0) - 1.0 + (lean1 - lean0) / u0;
        let margin = if differs.is_finite() { (MARGIN[0] + differs).min(MARGIN[1]) } else { MARGIN[1] };
        Self {
            side,
            margin,
            p: [0, 1, 2].map(|k| list(FAR, &|t| t.p[k])),
            n: folded.then(|| [0, 1, 2].map(|k| list(0.0, &|t| t.n[k]))),
            slopes: [0, 1, 2].map(|k| list(0.0, &|t| t.slopes[k])),
        }
    }

    /// Texels within a distance, m, of a place.
    pub(super) fn window(&self, uv: DVec2, spot: &SurfacePoint, reach: f64) -> TexelWindow {
        self.ellipse(uv, [spot.ju, spot.jv], reach)
    }

    /// Texels under a footprint of radius `reach`, m, stretched by `q` along `axis`, a unit vector of the blade's plane.
    pub(super) fn footprint(&self, uv: DVec2, spot: &SurfacePoint, reach: f64, q: f64, axis: DVec3) -> TexelWindow {
        let across = spot.n.cross(axis);
        let shrunk = |j: DVec3| DVec3::new(j.dot(axis) / q, j.dot(across) * q, j.dot(spot.n));
        self.ellipse(uv, [spot.ju, spot.jv].map(shrunk), reach)
    }

    /// Texels within a distance of a place. `ju`, `jv`: ways that u and v go there.
    fn ellipse(&self, uv: DVec2, [ju, jv]: [DVec3; 2], reach: f64) -> TexelWindow {
        let n = self.side as f64;
        let reach = self.margin * reach;
        // Rows count against v, whence the sign of b.
        let (a, b, c) = (ju.dot(ju), -ju.dot(jv), jv.dot(jv));
        let det = (a * c - b * b).max(0.0);
        let r = DVec2::new(c, a).map(|x| (x / det.max(f64::MIN_POSITIVE)).sqrt() * reach);
        let clamp = |x: f64| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let k = x.clamp(0.0, n) as usize;
            k
        };
        let least = a.max(f64::MIN_POSITIVE);
        TexelWindow {
            lo: [clamp(((uv.x - r.x) * n).floor()), clamp(((1.0 - uv.y - r.y) * n).floor())],
            hi: [clamp(((uv.x + r.x) * n).ceil() + 1.0), clamp(((1.0 - uv.y + r.y) * n).ceil() + 1.0)],
            middle: DVec2::new(uv.x, 1.0 - uv.y) * n,
            lean: -b / least,
            half: [reach * reach * n * n / least, det / (least * least)],
        }
    }

    /// Whether parts of it look to the other side.
    pub(super) fn is_folded(&self) -> bool {
        self.n.is_some()
    }

    /// Texels of a row, the end excluded.
    #[inline(always)]
    pub(super) fn row(&self, from: usize, to: usize) -> RasterRow<'_> {
        let [x, y, z] = &self.p;
        let p = [&x[from..to], &y[from..to], &z[from..to]];
        match &self.n {
            Some([x, y, z]) => RasterRow { p, n: [&x[from..to], &y[from..to], &z[from..to]] },
            None => RasterRow { p, n: [&[]; 3] },
        }
    }
}
