//! Heights by midpoint displacement (the diamond-square scheme).

use super::{Terrain, TerrainParams};
use osier_base::Result;
use osier_base::math::{narrow, pow};
use osier_base::par::par_map;
use osier_base::rng::{Key, Rng, child};

impl Terrain {
    /// Generates a square height field around the origin.
    /// Corners are A u. Level l = 0, 1 .. n - 1 has squares of 2^(n - l) cells and displaces by a_l u, a_l = A 2^(-H l):
    /// first each square's middle, from the mean of its corners (diamond), then each edge's middle, from the mean of
    /// the four heights half a square away (square), by a_l 2^(-H / 2) u. u is uniform in [-1, 1] and drawn at the
    /// address ("terrain", l, half, row, column) on that level's lattice: any order gives the same bytes, and a larger
    /// n keeps every height it shares with a smaller one. |h| <= A + sum a_l (1 + 2^(-H / 2)) before `smooth`.
    /// # Errors
    /// `Range` for a value outside its range.
    /// Source: [zhao-zhang] 4.
    /// Differs: the paper displaces by "similar" amounts in both half steps; that is `paper`. At an open border the
    /// mean is of three heights, at a tileable one of four, wrapped.
    pub fn generate(params: &TerrainParams) -> Result<Self> {
        params.check()?;
        let side = (1_usize << params.n) + 1;
        let mut land = Self {
            counts: [side; 2],
            size: [narrow(params.size); 2],
            center: [0.0; 2],
            stride: params.stride as usize,
            tileable: params.tileable,
            heights: vec![0.0; side * side],
            surface: None,
        };
        let key = Rng::key(params.seed, &["terrain".into()]);
        land.set_corners(params, key);
        for level in 0..params.n {
            // a_l = A 2^(-H l); the square step lies half a level on, at 2^(-H / 2) of it.
            let by = params.amplitude * pow(2.0, -params.exponent * f64::from(level));
            let half = if params.paper { 1.0 } else { pow(2.0, -params.exponent * 0.5) };
            let key = child(key, u64::from(level));
            land.diamond(level, by, child(key, Key::from("diamond").0));
            land.square(level, by * half, child(key, Key::from("square").0));
        }
        for _ in 0..params.smooth {
            land.smooth_binomial();
        }
        if let Some(floor) = params.floor.map(narrow) {
            land.heights.iter_mut().for_each(|h| *h = h.max(floor));
        }
        Ok(land)
    }

    /// Sets the four corners, given or drawn; a tileable land has one height at all of them.
    fn set_corners(&mut self, params: &TerrainParams, key: u64) {
        let last = self.counts[0] - 1;
        let key = child(key, Key::from("corner").0);
        for (c, (i, j)) in [(0, 0), (1, 0), (0, 1), (1, 1)].into_iter().enumerate() {
            let drawn = if self.tileable { (0, 0) } else { (j, i) };
            let given = params.corners.and_then(|g| g.get(if self.tileable { 0 } else { c }).copied());
            let h = given.unwrap_or_else(|| params.amplitude * uniform(child(child(key, drawn.0), drawn.1)));
            let at = usize::from(j == 1) * last * self.counts[0] + usize::from(i == 1) * last;
            self.heights[at] = narrow(h);
        }
    }

    /// The diamond step: sets the middles of the squares of a level to the mean of their corners plus `by` u.
    fn diamond(&mut self, level: u32, by: f64, key: u64) {
        let squares = 1_usize << level;
        let step = (self.counts[0] - 1) >> level;
        let rows: Vec<usize> = (0..squares).collect();
        let done = par_map(&rows, |&j| {
            let key = child(key, j as u64);
            let (low, high) = (self.row(j * step), self.row((j + 1) * step));
            let one = |i: usize| {
                let (w, e) = (i * step, (i + 1) * step);
                // In double precision the sum of four f32 heights is exact, so that the order of the corners changes nothing.
                let sum = f64::from(low[w]) + f64::from(low[e]) + f64::from(high[w]) + f64::from(high[e]);
                narrow(0.25 * sum + by * uniform(child(key, i as u64)))
            };
            (0..squares).map(one).collect::<Vec<f32>>()
        });
        // Write the new heights back in order; the rows were computed in parallel from the old ones.
        for (j, row) in done.iter().enumerate() {
            let at = (j * step + step / 2) * self.counts[0] + step / 2;
            row.iter().zip(self.heights[at..].iter_mut().step_by(step)).for_each(|(from, to)| *to = *from);
        }
    }

    /// The square step: sets the middles of the edges of a level's squares to the mean of the heights around plus `by` u.
    fn square(&mut self, level: u32, by: f64, key: u64) {
        let m = 2_usize << level;
        let k = (self.counts[0] - 1) / m;
        let rows: Vec<usize> = (0..=m).collect();
        let done = par_map(&rows, |&j| {
            let key = child(key, if self.tileable { j % m } else { j } as u64);
            // Rows and columns half a square away; `None` beyond an open border.
            let before = |v: usize| if v > 0 { Some(v - 1) } else { self.tileable.then_some(m - 1) };
            let after = |v: usize| if v < m { Some(v + 1) } else { self.tileable.then_some(1) };
            let row = |j: usize| self.row(j * k);
            let (north, here, south) = (before(j).map(row), row(j), after(j).map(row));
            let one = |i: usize| {
                let (west, east) = (before(i).map(|i| here[i * k]), after(i).map(|i| here[i * k]));
                let around = [north.map(|r| r[i * k]), south.map(|r| r[i * k]), west, east];
                let sum = around.iter().flatten().fold(0.0, |s, h| s + f64::from(*h));
                let count = if around.iter().all(Option::is_some) { 4.0 } else { 3.0 };
                let column = if self.tileable { i % m } else { i };
                narrow(sum / count + by * uniform(child(key, column as u64)))
            };
            ((j + 1) % 2..=m).step_by(2).map(one).collect::<Vec<f32>>()
        });
        for (j, row) in done.iter().enumerate() {
            let at = j * k * self.counts[0] + ((j + 1) % 2) * k;
            row.iter().zip(self.heights[at..].iter_mut().step_by(2 * k)).for_each(|(from, to)| *to = *from);
        }
    }

    /// Heights of row `j`, counted from -z, from -x to +x.
    fn row(&self, j: usize) -> &[f32] {
        &self.heights[j * self.counts[0]..(j + 1) * self.counts[0]]
    }

    /// One binomial pass, 1 2 1 along both axes; beyond a border that is not tileable the border's heights are repeated.
    pub(super) fn smooth_binomial(&mut self) {
        let [columns, rows] = self.counts;
        let before = |v: usize, n: usize| if v > 0 { v - 1 } else { [0, n - 2][usize::from(self.tileable)] };
        let after = |v: usize, n: usize| if v < n - 1 { v + 1 } else { [n - 1, 1][usize::from(self.tileable)] };
        let rows_of: Vec<usize> = (0..rows).collect();
        let done = par_map(&rows_of, |&j| {
            let (a, b, c) = (self.row(before(j, rows)), self.row(j), self.row(after(j, rows)));
            // Separable kernel (1 2 1) / 4 in both directions: columns first, then the row, divided by 16.
            let column = |i: usize| f64::from(a[i]) + 2.0 * f64::from(b[i]) + f64::from(c[i]);
            let one = |i: usize| {
                let (west, east) = (before(i, columns), after(i, columns));
                narrow((column(west) + 2.0 * column(i) + column(east)) / 16.0)
            };
            (0..columns).map(one).collect::<Vec<f32>>()
        });
        self.heights = done.concat();
    }
}

/// u of a key: uniform in [-1, 1), the first draw of its stream.
fn uniform(key: u64) -> f64 {
    2.0 * Rng::from_key(key).unit_f64() - 1.0
}
