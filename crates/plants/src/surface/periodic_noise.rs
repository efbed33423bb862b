//! The noise of [`osier_base::noise`] with its hashes in tables, for maps of a million samples: the same values, faster.
//!
//! Samples at scattered places are computed in batches of [`BATCH`]: the table entries of a batch are copied into arrays,
//! one for each component, over which the compiler vectorizes the arithmetic.

use pulp::{Arch, Simd, WithSimd};

use osier_base::math;
use osier_base::rng::mix64;

/// Number of samples that are computed together: two registers of AVX-512.
const BATCH: usize = 32;

/// Gradient noise on a periodic lattice; values of [`osier_base::noise::gradient2`].
struct GradientNoise {
    table: Vec<[f32; 2]>,
    period: [usize; 2],
}

impl GradientNoise {
    fn new(seed: u64, period: [u32; 2]) -> Self {
        let [nx, ny] = period.map(|p| p.max(1));
        // Gradients of the whole period in a table: unit vectors at hashed angles.
        let corner = |i: u32| {
            let h = mix64(&[seed, u64::from(i % nx), u64::from(i / nx)]);
            let a = (h >> 40) as f32 * (std::f32::consts::TAU / 16_777_216.0);
            [math::cos_f32(a), math::sin_f32(a)]
        };
        Self { table: (0..nx * ny).map(corner).collect(), period: [nx as usize, ny as usize] }
    }

    /// Adds the values at the places (x, y) of a batch to `sums`, times `weight`; the unit square is one period.
    #[inline(always)]
    fn add_batch(&self, x: &[f32; BATCH], y: &[f32; BATCH], weight: f32, sums: &mut [f32; BATCH]) {
        let [nx, ny] = self.period;
        // Gradients at the corners (x0, y0), (x1, y0), (x0, y1), (x1, y1) of the lattice cells.
        let mut gradients = [[[0.0; BATCH]; 2]; 4];
        let columns = CellBatch::new(x, nx);
        let rows = CellBatch::new(y, ny);
        for k in 0..BATCH {
            let [low, high] = [rows.low[k], rows.high[k]].map(|row| &self.table[row as usize * nx..][..nx]);
            let [left, right] = [columns.low[k] as usize, columns.high[k] as usize];
            for (gradient, g) in gradients.iter_mut().zip([low[left], low[right], high[left], high[right]]) {
                (gradient[0][k], gradient[1][k]) = (g[0], g[1]);
            }
        }
        let (fx, fy) = (&columns.place, &rows.place);
        // Dot products of the corner gradients with the offsets, blended by the quintic fade.
        let [g00, g10, g01, g11] = &gradients;
        for k in 0..BATCH {
            let slope = |g: &[[f32; BATCH]; 2], dx: f32, dy: f32| g[0][k] * dx + g[1][k] * dy;
            let (u, v) = (fade(fx[k]), fade(fy[k]));
            let low = blend(slope(g00, fx[k], fy[k]), slope(g10, fx[k] - 1.0, fy[k]), u);
            let high = blend(slope(g01, fx[k], fy[k] - 1.0), slope(g11, fx[k] - 1.0, fy[k] - 1.0), u);
            sums[k] += weight * (blend(low, high, v) * std::f32::consts::SQRT_2);
        }
    }

    /// Adds the values along a row to `out`, times `weight`; places are `xs` periods across, ascending, and `y` cells up.
    #[inline(always)]
    fn add_row(&self, xs: &[f32], y: f32, weight: f32, out: &mut [f32]) {
        let n = self.period[0];
        let cells = n as f32;
        let ([below, above], fy) = cell(y, self.period[1]);
        let (below, above) = (&self.table[below * n..][..n], &self.table[above * n..][..n]);
        let (v, weight) = (fade(fy), weight * std::f32::consts::SQRT_2);
        // For fixed y the vertical blend of a column's corner contributions is linear in the horizontal offset: a + b dx.
        let line = |column: i32| {
            let i = wrap(column, n);
            let ([ax, ay], [bx, by]) = (below[i], above[i]);
            [math::lerp(ay * fy, by * (fy - 1.0), v) * weight, math::lerp(ax, bx, v) * weight]
        };
        let (mut first, mut run) = (0, 1);
        while let Some(x) = xs.get(first) {
            let column = split(x * cells).0;
            let (from, next) = (column as f32, column as f32 + 1.0);
            // The run of samples in this lattice column: guessed from the last run, then corrected by comparison.
            let mut end = (first + run).clamp(first + 1, xs.len());
            while end < xs.len() && xs[end] * cells < next {
                end += 1;
            }
            while end > first + 1 && xs[end - 1] * cells >= next {
                end -= 1;
            }
            let ([a, b], [c, d]) = (line(column), line(column.wrapping_add(1)));
            for (o, x) in out[first..end].iter_mut().zip(&xs[first..end]) {
                let f = x * cells - from;
                *o += math::lerp(a + b * f, c + d * (f - 1.0), fade(f));
            }
            (first, run) = (end, end - first);
        }
    }
}

/// The lattice columns on both sides of `x`, wrapped, and the position between them, 0 to 1.
#[inline(always)]
fn cell(x: f32, period: usize) -> ([usize; 2], f32) {
    let (column, place) = split(x);
    let i = wrap(column, period);
    let j = if i + 1 == period { 0 } else { i + 1 };
    ([i, j], place)
}

/// [`cell`] of each number of a batch, after it is multiplied by the period.
struct CellBatch {
    low: [i32; BATCH],
    high: [i32; BATCH],
    place: [f32; BATCH],
}

impl CellBatch {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "periods fit")]
    fn new(x: &[f32; BATCH], period: usize) -> Self {
        let (n, cells) = (period as i32, period as f32);
        let mut out = Self { low: [0; BATCH], high: [0; BATCH], place: [0.0; BATCH] };
        // One period beyond 0..n is reached by an addition, which vectorizes.
        let mut within = true;
        for ((low, place), x) in out.low.iter_mut().zip(&mut out.place).zip(x) {
            let column;
            (column, *place) = split(x * cells);
            let near = if column < 0 { column.wrapping_add(n) } else { column };
            let near = if near >= n { near - n } else { near };
            within &= near >= 0 && near < n;
            *low = near;
        }
        if !within {
            out.low = out.low.map(|column| column.rem_euclid(n));
        }
        for (high, low) in out.high.iter_mut().zip(&out.low) {
            *high = if low + 1 == n { 0 } else { low + 1 };
        }
        out
    }
}

/// The number rounded down, and the rest.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "a map has a few thousand cells; beyond, the cast saturates")]
fn split(x: f32) -> (i32, f32) {
    // A cast and a comparison, because `floor` is a function call on instruction sets without rounding.
    let cut = x as i32;
    let whole = if cut as f32 > x { cut.wrapping_sub(1) } else { cut };
    (whole, x - whole as f32)
}

/// The column in 0..period that is congruent to `column`.
#[inline(always)]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "periods fit, and the result is in 0..period"
)]
fn wrap(column: i32, period: usize) -> usize {
    let n = period as i32;
    // Samples of maps are within a period of 0..n, where an addition suffices; the division is for all others.
    let near = if column < 0 { column.wrapping_add(n) } else { column };
    let near = if near >= n { near - n } else { near };
    if (0..n).contains(&near) { near as usize } else { column.rem_euclid(n) as usize }
}

/// [`math::lerp`], compiled with the instructions of the function that calls it.
#[inline(always)]
fn blend(a: f32, b: f32, t: f32) -> f32 {
    a * (1.0 - t) + b * t
}

/// Quintic fade 6 t^5 - 15 t^4 + 10 t^3, whose first and second derivatives vanish at 0 and 1.
#[inline(always)]
fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Octaves of gradient noise on the unit square, each of doubled frequency and half the weight; about [-1, 1].
pub(super) struct FractalNoise {
    octaves: Vec<GradientNoise>,
}

impl FractalNoise {
    /// `cells`: lattice cells across and up of the first octave.
    pub fn new(seed: u64, cells: [u32; 2], octaves: u32) -> Self {
        // Octave o has 2^o times the cells, and seed + o, as in `noise::fractal2`.
        let octave = |o: u32| GradientNoise::new(seed.wrapping_add(u64::from(o)), cells.map(|c| c << o));
        Self { octaves: (0..octaves).map(octave).collect() }
    }

    /// Weighted means of the octaves at some places (x, y); the unit square is one period.
    pub fn at_places(&self, places: &[[f32; 2]]) -> Vec<f32> {
        let mut out = vec![0.0; places.len()];
        Arch::new().dispatch(FractalKernel { octaves: &self.octaves, places, out: &mut out });
        out
    }

    /// Values at (x, y) for all x of `xs`, which ascend: [`FractalNoise::at_places`] except for rounding, several times faster.
    pub fn row(&self, xs: &[f32], y: f32) -> Vec<f32> {
        let mut out = vec![0.0; xs.len()];
        Arch::new().dispatch(RowKernel { octaves: &self.octaves, xs, y, out: &mut out });
        out
    }
}

/// Computes [`FractalNoise::row`].
struct RowKernel<'a> {
    octaves: &'a [GradientNoise],
    xs: &'a [f32],
    y: f32,
    out: &'a mut [f32],
}

impl WithSimd for RowKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (mut total, mut weight) = (0.0, 1.0);
        for _ in self.octaves {
            total += weight;
            weight *= 0.5;
        }
        weight = 1.0;
        for octave in self.octaves {
            octave.add_row(self.xs, self.y * octave.period[1] as f32, weight / total, self.out);
            weight *= 0.5;
        }
    }
}

/// Computes [`FractalNoise::at_places`] batch by batch.
struct FractalKernel<'a> {
    octaves: &'a [GradientNoise],
    places: &'a [[f32; 2]],
    out: &'a mut [f32],
}

impl WithSimd for FractalKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (places, out) in self.places.chunks(BATCH).zip(self.out.chunks_mut(BATCH)) {
            let [x, y] = columns_of(places);
            let mut sums = [0.0; BATCH];
            let (mut weight, mut total) = (1.0, 0.0);
            for octave in self.octaves {
                octave.add_batch(&x, &y, weight, &mut sums);
                total += weight;
                weight *= 0.5;
            }
            for (out, sum) in out.iter_mut().zip(&sums) {
                *out = sum / total;
            }
        }
    }
}

/// Coordinates x and y of at most [`BATCH`] places; 0 behind the last one.
#[inline(always)]
fn columns_of(places: &[[f32; 2]]) -> [[f32; BATCH]; 2] {
    let mut out = [[0.0; BATCH]; 2];
    for (k, place) in places.iter().enumerate().take(BATCH) {
        (out[0][k], out[1][k]) = (place[0], place[1]);
    }
    out
}

/// Centres of `side` pixels on the unit interval.
pub(super) fn pixel_centres(side: u32) -> Vec<f32> {
    (0..side).map(|x| (x as f32 + 0.5) / side as f32).collect()
}

/// Result of [`CellularNoise`]: distances in cells to the two nearest feature points, offset from the nearest, its hash.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NearestFeature {
    pub f1: f32,
    pub f2: f32,
    /// Vector from the feature point to the sample, cells.
    pub from: [f32; 2],
    pub id: u64,
}

/// Cellular noise on the unit square; values of [`osier_base::noise::cellular2`].
pub(super) struct CellularNoise {
    /// Feature point of each cell, relative to the corner of the cell, and its hash.
    points: Vec<[f32; 2]>,
    ids: Vec<u64>,
    period: [usize; 2],
}

impl CellularNoise {
    pub fn new(seed: u64, cells: [u32; 2], jitter: f32) -> Self {
        let [nx, ny] = cells.map(|p| p.max(1));
        let feature = |i: u32| {
            let h = mix64(&[seed, u64::from(i % nx), u64::from(i / nx)]);
            let part = |bits: u64| 0.5 + jitter * ((bits & 0xFF_FFFF) as f32 / 16_777_216.0 - 0.5);
            ([part(h >> 40), part(h >> 16)], h)
        };
        let (points, ids) = (0..nx * ny).map(feature).unzip();
        Self { points, ids, period: [nx as usize, ny as usize] }
    }

    /// The nearest feature points to some places (x, y); the unit square is one period. Only the 3 x 3 cells around are
    /// searched.
    pub fn at_places(&self, places: &[[f32; 2]]) -> Vec<NearestFeature> {
        let mut out = vec![NearestFeature::default(); places.len()];
        Arch::new().dispatch(CellularKernel { noise: self, places, out: &mut out });
        out
    }

    /// The nearest feature points to the first places of a batch, as many as `out` takes.
    #[inline(always)]
    fn batch(&self, x: &[f32; BATCH], y: &[f32; BATCH], out: &mut [NearestFeature]) {
        let [nx, ny] = self.period;
        // Feature points of the 3 x 3 cells around, relative to the corner of the cell, and their indices.
        let mut points = [[[0.0; BATCH]; 2]; 9];
        let mut indices = [[0; BATCH]; 9];
        let (columns, rows) = (CellBatch::new(x, nx), CellBatch::new(y, ny));
        for k in 0..BATCH {
            let around = |cells: &CellBatch, n: usize| {
                let [low, high] = [cells.low[k] as usize, cells.high[k] as usize];
                [if low == 0 { n - 1 } else { low - 1 }, low, high]
            };
            let (columns, rows) = (around(&columns, nx), around(&rows, ny));
            for (n, (point, index)) in points.iter_mut().zip(&mut indices).enumerate() {
                let i = rows[n / 3] * nx + columns[n % 3];
                (point[0][k], point[1][k]) = (self.points[i][0], self.points[i][1]);
                index[k] = i;
            }
        }
        let (fx, fy) = (&columns.place, &rows.place);
        // Selections instead of branches, which would be mispredicted: which point is nearest is random.
        let (mut first, mut second) = ([f32::MAX; BATCH], [f32::MAX; BATCH]);
        let (mut from, mut nearest) = ([[0.0; BATCH]; 2], [0_u32; BATCH]);
        for (n, point) in points.iter().enumerate() {
            for k in 0..BATCH {
                let ox = point[0][k] + OFFSETS[n % 3] - fx[k];
                let oy = point[1][k] + OFFSETS[n / 3] - fy[k];
                let d = ox * ox + oy * oy;
                let closer = d < first[k];
                second[k] = if closer { first[k] } else { second[k].min(d) };
                first[k] = if closer { d } else { first[k] };
                from[0][k] = if closer { -ox } else { from[0][k] };
                from[1][k] = if closer { -oy } else { from[1][k] };
                nearest[k] = if closer { NUMBERS[n] } else { nearest[k] };
            }
        }
        for (k, out) in out.iter_mut().enumerate().take(BATCH) {
            let id = self.ids[indices[nearest[k] as usize][k]];
            *out = NearestFeature { f1: first[k].sqrt(), f2: second[k].sqrt(), from: [from[0][k], from[1][k]], id };
        }
    }
}

/// Numbers of the 3 x 3 cells.
const NUMBERS: [u32; 9] = [0, 1, 2, 3, 4, 5, 6, 7, 8];
/// Offsets of the cells around a cell, along one axis.
const OFFSETS: [f32; 3] = [-1.0, 0.0, 1.0];

/// Computes [`CellularNoise::at_places`] batch by batch.
struct CellularKernel<'a> {
    noise: &'a CellularNoise,
    places: &'a [[f32; 2]],
    out: &'a mut [NearestFeature],
}

impl WithSimd for CellularKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (places, out) in self.places.chunks(BATCH).zip(self.out.chunks_mut(BATCH)) {
            let [x, y] = columns_of(places);
            self.noise.batch(&x, &y, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::noise;

    #[test]
    fn tables_give_the_values_of_the_reference() {
        let (fractal, cells) = (FractalNoise::new(7, [6, 3], 3), CellularNoise::new(9, [5, 4], 0.9));
        for i in 0..200 {
            let (x, y) = (i as f32 * 0.0137 - 0.4, i as f32 * 0.0071 - 0.2);
            let want = noise::fractal2(7, [x * 6.0, y * 3.0], [6, 3], 3);
            assert!((fractal.at_places(&[[x, y]])[0] - want).abs() < 1e-4);
            let near = cells.at_places(&[[x, y]])[0];
            let c = noise::cellular2(9, [x * 5.0, y * 4.0], [5, 4], 0.9);
            assert!((near.f1 - c.f1).abs() < 1e-4 && (near.f2 - c.f2).abs() < 1e-4 && near.id == c.id);
        }
    }

    #[test]
    fn rows_give_the_values_of_their_points() {
        for (cells, octaves) in [([6, 3], 5), ([1, 1], 1), ([150, 7], 2)] {
            let fractal = FractalNoise::new(3, cells, octaves);
            // Beyond the unit line too, densely, sparsely and with gaps.
            for step in [0.0004_f32, 0.013, 0.31] {
                let xs: Vec<f32> = (0..400_u16).map(|i| f32::from(i) * step - 1.3).collect();
                for y in [-0.7, 0.0, 0.31, 2.2] {
                    let places: Vec<[f32; 2]> = xs.iter().map(|x| [*x, y]).collect();
                    for ((x, got), want) in xs.iter().zip(fractal.row(&xs, y)).zip(fractal.at_places(&places)) {
                        assert!((got - want).abs() < 1e-4, "{cells:?} at {x}, {y}: {got}, not {want}");
                    }
                }
            }
        }
        assert!(FractalNoise::new(3, [4, 4], 2).row(&[f32::NAN, f32::INFINITY], 0.5).len() == 2);
    }
}
