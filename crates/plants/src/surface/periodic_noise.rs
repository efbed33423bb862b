//! The noise of [`osier_base::noise`] with its hashes in tables, for maps of a million samples: the same values, faster.

use osier_base::math;
use osier_base::rng::mix64;

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

    /// Value at `p`, in cells of the lattice.
    fn at(&self, p: [f32; 2]) -> f32 {
        let ([x0, x1], fx) = cell(p[0], self.period[0]);
        let ([y0, y1], fy) = cell(p[1], self.period[1]);
        // Dot products of the corner gradients with the offsets, blended by the quintic fade.
        let slope = |x: usize, y: usize, dx: f32, dy: f32| {
            let g = self.table[y * self.period[0] + x];
            g[0] * dx + g[1] * dy
        };
        let (u, v) = (fade(fx), fade(fy));
        let low = math::lerp(slope(x0, y0, fx, fy), slope(x1, y0, fx - 1.0, fy), u);
        let high = math::lerp(slope(x0, y1, fx, fy - 1.0), slope(x1, y1, fx - 1.0, fy - 1.0), u);
        math::lerp(low, high, v) * std::f32::consts::SQRT_2
    }

    /// Adds the values along a row to `out`, times `weight`; places are `xs` periods across, ascending, and `y` cells up.
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
fn cell(x: f32, period: usize) -> ([usize; 2], f32) {
    let (column, place) = split(x);
    let i = wrap(column, period);
    let j = if i + 1 == period { 0 } else { i + 1 };
    ([i, j], place)
}

/// The number rounded down, and the rest.
#[allow(clippy::cast_possible_truncation, reason = "a map has a few thousand cells; beyond, the cast saturates")]
fn split(x: f32) -> (i32, f32) {
    // A cast and a comparison, because `floor` is a function call on instruction sets without rounding.
    let cut = x as i32;
    let whole = if cut as f32 > x { cut.wrapping_sub(1) } else { cut };
    (whole, x - whole as f32)
}

/// The column in 0..period that is congruent to `column`.
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

/// Quintic fade 6 t^5 - 15 t^4 + 10 t^3, whose first and second derivatives vanish at 0 and 1.
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

    /// Weighted mean of the octaves at (x, y); the unit square is one period.
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
        for o in &self.octaves {
            sum += weight * o.at([x * o.period[0] as f32, y * o.period[1] as f32]);
            total += weight;
            weight *= 0.5;
        }
        sum / total
    }

    /// Values at (x, y) for all x of `xs`, which ascend: [`FractalNoise::at`] except for rounding, several times faster.
    pub fn row(&self, xs: &[f32], y: f32) -> Vec<f32> {
        let mut out = vec![0.0; xs.len()];
        let octaves = || self.octaves.iter().zip(std::iter::successors(Some(1.0_f32), |w| Some(w * 0.5)));
        let total = octaves().fold(0.0, |sum, (_, weight)| sum + weight);
        for (o, weight) in octaves() {
            o.add_row(xs, y * o.period[1] as f32, weight / total, &mut out);
        }
        out
    }
}

/// Centres of `side` pixels on the unit interval.
pub(super) fn pixel_centres(side: u32) -> Vec<f32> {
    (0..side).map(|x| (x as f32 + 0.5) / side as f32).collect()
}

/// Result of [`CellularNoise`]: distances in cells to the two nearest feature points, offset from the nearest, its hash.
#[derive(Debug, Clone, Copy)]
pub(super) struct NearestFeature {
    pub f1: f32,
    pub f2: f32,
    /// Vector from the feature point to the sample, cells.
    pub from: [f32; 2],
    pub id: u64,
}

/// Cellular noise on the unit square; values of [`osier_base::noise::cellular2`].
pub(super) struct CellularNoise {
    table: Vec<([f32; 2], u64)>,
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
        Self { table: (0..nx * ny).map(feature).collect(), period: [nx as usize, ny as usize] }
    }

    /// The nearest feature points to (x, y); the unit square is one period. Only the 3 x 3 cells around are searched.
    pub fn at(&self, x: f32, y: f32) -> NearestFeature {
        let ([x0, x1], fx) = cell(x * self.period[0] as f32, self.period[0]);
        let ([y0, y1], fy) = cell(y * self.period[1] as f32, self.period[1]);
        let before = |i: usize, n: usize| if i == 0 { n - 1 } else { i - 1 };
        let columns = [(before(x0, self.period[0]), -1.0), (x0, 0.0), (x1, 1.0)];
        let rows = [(before(y0, self.period[1]), -1.0), (y0, 0.0), (y1, 1.0)];
        // Selections instead of branches, which would be mispredicted: which point is nearest is random.
        let (mut first, mut second, mut nearest) = (f32::MAX, f32::MAX, ([0.0; 2], 0));
        for (row, dy) in rows {
            let row = &self.table[row * self.period[0]..][..self.period[0]];
            for (column, dx) in columns {
                let (p, id) = row[column];
                let (ox, oy) = (p[0] + dx - fx, p[1] + dy - fy);
                let d = ox * ox + oy * oy;
                let closer = d < first;
                second = if closer { first } else { second.min(d) };
                first = if closer { d } else { first };
                nearest = if closer { ([-ox, -oy], id) } else { nearest };
            }
        }
        NearestFeature { f1: first.sqrt(), f2: second.sqrt(), from: nearest.0, id: nearest.1 }
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
            assert!((fractal.at(x, y) - want).abs() < 1e-4);
            let (near, c) = (cells.at(x, y), noise::cellular2(9, [x * 5.0, y * 4.0], [5, 4], 0.9));
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
                    for (x, got) in xs.iter().zip(fractal.row(&xs, y)) {
                        let want = fractal.at(*x, y);
                        assert!((got - want).abs() < 1e-4, "{cells:?} at {x}, {y}: {got}, not {want}");
                    }
                }
            }
        }
        assert!(FractalNoise::new(3, [4, 4], 2).row(&[f32::NAN, f32::INFINITY], 0.5).len() == 2);
    }
}
