//! The noise of [`crate::noise`] with its hashes in tables, for maps of a million samples: the same values, faster.

use crate::math;
use crate::rng::mix64;

/// Gradient noise on a periodic lattice; values of [`crate::noise::gradient2`].
struct Gradients {
    table: Vec<[f32; 2]>,
    period: [usize; 2],
}

impl Gradients {
    fn new(seed: u64, period: [u32; 2]) -> Self {
        let [nx, ny] = period.map(|p| p.max(1));
        let corner = |i: u32| {
            let h = mix64(&[seed, u64::from(i % nx), u64::from(i / nx)]);
            let a = (h >> 40) as f32 * (std::f32::consts::TAU / 16_777_216.0);
            [math::cos_f32(a), math::sin_f32(a)]
        };
        Self { table: (0..nx * ny).map(corner).collect(), period: [nx as usize, ny as usize] }
    }

    /// `p` in cells.
    fn at(&self, p: [f32; 2]) -> f32 {
        let ([x0, x1], fx) = cell(p[0], self.period[0]);
        let ([y0, y1], fy) = cell(p[1], self.period[1]);
        let slope = |x: usize, y: usize, dx: f32, dy: f32| {
            let g = self.table[y * self.period[0] + x];
            g[0] * dx + g[1] * dy
        };
        let (u, v) = (fade(fx), fade(fy));
        let low = math::lerp(slope(x0, y0, fx, fy), slope(x1, y0, fx - 1.0, fy), u);
        let high = math::lerp(slope(x0, y1, fx, fy - 1.0), slope(x1, y1, fx - 1.0, fy - 1.0), u);
        math::lerp(low, high, v) * std::f32::consts::SQRT_2
    }
}

/// Both lattice columns around `x`, wrapped, and the place between them.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "wrapped into the period before the cast")]
fn cell(x: f32, period: usize) -> ([usize; 2], f32) {
    let floor = x.floor();
    let n = period as i32;
    let i = (floor as i32).rem_euclid(n) as usize;
    let j = if i + 1 == period { 0 } else { i + 1 };
    ([i, j], x - floor)
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Octaves of gradient noise on the unit square, each of doubled frequency and half the weight; about [-1, 1].
pub(super) struct Fractal {
    octaves: Vec<Gradients>,
}

impl Fractal {
    /// `cells`: lattice cells across and up of the first octave.
    pub fn new(seed: u64, cells: [u32; 2], octaves: u32) -> Self {
        let octave = |o: u32| Gradients::new(seed.wrapping_add(u64::from(o)), cells.map(|c| c << o));
        Self { octaves: (0..octaves).map(octave).collect() }
    }

    /// Value at (x, y); one period is the unit square.
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
        for o in &self.octaves {
            sum += weight * o.at([x * o.period[0] as f32, y * o.period[1] as f32]);
            total += weight;
            weight *= 0.5;
        }
        sum / total
    }
}

/// What [`Cells`] find: distances in cells to the two nearest feature points, the way to the nearest, its hash.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    pub f1: f32,
    pub f2: f32,
    /// From the feature point, cells.
    pub from: [f32; 2],
    pub id: u64,
}

/// Cellular noise on the unit square; values of [`crate::noise::cellular2`].
pub(super) struct Cells {
    table: Vec<([f32; 2], u64)>,
    period: [usize; 2],
}

impl Cells {
    pub fn new(seed: u64, cells: [u32; 2], jitter: f32) -> Self {
        let [nx, ny] = cells.map(|p| p.max(1));
        let feature = |i: u32| {
            let h = mix64(&[seed, u64::from(i % nx), u64::from(i / nx)]);
            let part = |bits: u64| 0.5 + jitter * ((bits & 0xFF_FFFF) as f32 / 16_777_216.0 - 0.5);
            ([part(h >> 40), part(h >> 16)], h)
        };
        Self { table: (0..nx * ny).map(feature).collect(), period: [nx as usize, ny as usize] }
    }

    /// The nearest feature points to (x, y); one period is the unit square.
    pub fn at(&self, x: f32, y: f32) -> Near {
        let ([x0, x1], fx) = cell(x * self.period[0] as f32, self.period[0]);
        let ([y0, y1], fy) = cell(y * self.period[1] as f32, self.period[1]);
        let before = |i: usize, n: usize| if i == 0 { n - 1 } else { i - 1 };
        let columns = [(before(x0, self.period[0]), -1.0), (x0, 0.0), (x1, 1.0)];
        let rows = [(before(y0, self.period[1]), -1.0), (y0, 0.0), (y1, 1.0)];
        let mut best = (f32::MAX, f32::MAX, [0.0; 2], 0);
        for (row, dy) in rows {
            for (column, dx) in columns {
                let (p, id) = self.table[row * self.period[0] + column];
                let (ox, oy) = (p[0] + dx - fx, p[1] + dy - fy);
                let d = ox * ox + oy * oy;
                if d < best.0 {
                    best = (d, best.0, [-ox, -oy], id);
                } else if d < best.1 {
                    best.1 = d;
                }
            }
        }
        Near { f1: best.0.sqrt(), f2: best.1.sqrt(), from: best.2, id: best.3 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise;

    #[test]
    fn tables_give_the_values_of_the_reference() {
        let (fractal, cells) = (Fractal::new(7, [6, 3], 3), Cells::new(9, [5, 4], 0.9));
        for i in 0..200 {
            let (x, y) = (i as f32 * 0.0137 - 0.4, i as f32 * 0.0071 - 0.2);
            let want = noise::fractal2(7, [x * 6.0, y * 3.0], [6, 3], 3);
            assert!((fractal.at(x, y) - want).abs() < 1e-4);
            let (near, c) = (cells.at(x, y), noise::cellular2(9, [x * 5.0, y * 4.0], [5, 4], 0.9));
            assert!((near.f1 - c.f1).abs() < 1e-4 && (near.f2 - c.f2).abs() < 1e-4 && near.id == c.id);
        }
    }
}
