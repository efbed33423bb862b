//! 32 chains side by side, in scalar loops: the reference whose results the SIMD loops must reproduce.

use super::{ChaosGame, Chunk, Coefficients, LANES, TileLayout};

/// State of all lanes of a block.
#[derive(Debug, Clone)]
pub(super) struct Lanes {
    /// State of the xoshiro128+ generators: four words per lane.
    pub s: [[u32; LANES]; 4],
    pub x: [f32; LANES],
    pub y: [f32; LANES],
    pub z: [f32; LANES],
    /// The map that made the last point.
    pub map: [u32; LANES],
}

impl Lanes {
    /// All lanes at the point `start`, with generators that are not seeded yet.
    pub fn at(start: [f32; 3], map: u32) -> Self {
        let all = |v| [v; LANES];
        Self { s: [[0; LANES]; 4], x: all(start[0]), y: all(start[1]), z: all(start[2]), map: [map; LANES] }
    }

    /// Sets the generator of a lane; all zeros, which it would never leave, become 1.
    #[allow(clippy::cast_possible_truncation, reason = "halves of words")]
    pub fn seed(&mut self, lane: usize, words: [u64; 2]) {
        let mut words = [words[0] as u32, (words[0] >> 32) as u32, words[1] as u32, (words[1] >> 32) as u32];
        if words == [0; 4] {
            words[0] = 1;
        }
        for (row, w) in self.s.iter_mut().zip(words) {
            row[lane] = w;
        }
    }

    /// The next 32 random bits of a lane, of which the upper 31 are good.
    /// Source: D. Blackman, S. Vigna, "Scrambled linear pseudorandom number generators", 2018: xoshiro128+.
    #[inline(always)]
    pub fn draw(&mut self, lane: usize) -> u32 {
        let [a, b, c, d] = &mut self.s;
        let result = a[lane].wrapping_add(d[lane]);
        // xoshiro128+: the sum of the outer words is the output, then the linear step.
        let t = b[lane] << 9;
        c[lane] ^= a[lane];
        d[lane] ^= b[lane];
        b[lane] ^= c[lane];
        a[lane] ^= d[lane];
        c[lane] ^= t;
        d[lane] = d[lane].rotate_left(11);
        result
    }

    /// Advances all lanes by the steps of a chunk and records every point.
    pub fn advance(&mut self, game: &ChaosGame, chunk: &mut Chunk) {
        for step in 0..chunk.steps {
            for lane in 0..LANES {
                let draw = self.draw(lane) >> 1;
                self.step(game, lane, draw);
            }
            (chunk.x[step], chunk.y[step], chunk.z[step]) = (self.x, self.y, self.z);
            chunk.map[step] = self.map;
        }
    }

    /// One step of one lane: products and sums in this order, never fused.
    #[inline(always)]
    pub fn step(&mut self, game: &ChaosGame, lane: usize, draw: u32) {
        // Without a chaos matrix there is one row of thresholds; with one the last map selects its row.
        let row = match game.rows.as_slice() {
            [only] => only,
            rows => &rows[self.map[lane] as usize],
        };
        // Few maps: counting thresholds without branches is faster than a search. Both give the same index.
        let map = if row.len() <= 16 {
            row.iter().map(|t| usize::from(*t <= draw)).sum()
        } else {
            row.partition_point(|t| *t <= draw)
        };
        let c = &game.maps[map];
        let (x, y, z) = (self.x[lane], self.y[lane], self.z[lane]);
        if game.dim == 2 {
            self.x[lane] = (c[0] * x + c[1] * y) + c[9];
            self.y[lane] = (c[3] * x + c[4] * y) + c[10];
        } else {
            self.x[lane] = ((c[0] * x + c[1] * y) + c[2] * z) + c[9];
            self.y[lane] = ((c[3] * x + c[4] * y) + c[5] * z) + c[10];
            self.z[lane] = ((c[6] * x + c[7] * y) + c[8] * z) + c[11];
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most some thousand maps")]
        let map = map as u32;
        self.map[lane] = map;
    }
}

/// Scalar variant of [`super::images`]: products and sums in the order of a step, never fused.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "inside by the test"
)]
pub(super) fn images(c: &Coefficients, place: [&[f32]; 3], layout: TileLayout, out: &mut [u32]) {
    let (w, h) = (layout.width as f32, layout.height as f32);
    let outside = layout.outside() as u32;
    for (i, out) in out.iter_mut().enumerate() {
        let (px, py) = (place[0][i], place[1][i]);
        let (mut x, mut y) = (c[0] * px + c[1] * py, c[3] * px + c[4] * py);
        if let Some(pz) = place[2].get(i) {
            (x, y) = (x + c[2] * pz, y + c[5] * pz);
        }
        (x, y) = (x + c[9], y + c[10]);
        // Comparisons are false for NaN, which falls into the outside cell.
        let inside = x >= 0.0 && x < w && y >= 0.0 && y < h;
        *out = if inside { layout.cell(x as usize, y as usize) as u32 } else { outside };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_the_published_one() {
        let mut lanes = Lanes::at([0.0; 3], 0);
        lanes.seed(5, [1 | (2 << 32), 3 | (4 << 32)]);
        // First outputs of the authors' program for the state 1 2 3 4.
        let out: Vec<u32> = (0..6).map(|_| lanes.draw(5)).collect();
        assert_eq!(out, [5, 12_295, 25_178_119, 27_286_542, 39_879_690, 1_140_358_681]);
    }
}
