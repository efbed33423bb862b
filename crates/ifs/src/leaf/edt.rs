//! Exact Euclidean distance transform of a pixel mask.
//!
//! # Examples
//! ```
//! use osier_ifs::leaf::edt::nearest;
//!
//! // One set pixel in a row of three.
//! let (squares, pixels) = nearest(&[true, false, false], 3, 1);
//! assert_eq!((squares, pixels), (vec![0.0, 1.0, 4.0], vec![0, 0, 0]));
//! ```

/// Row index that marks a column without a set pixel.
const NO_ROW: usize = usize::MAX;

/// For every pixel the nearest pixel that is set, and the squared distance to it in pixels (`f64::INFINITY` and
/// `u32::MAX` if none is set).
/// Source: P. Felzenszwalb, D. Huttenlocher, "Distance transforms of sampled functions", 2012: lower envelopes of
/// parabolas, first down the columns, then along the rows.
pub fn nearest(set: &[bool], width: usize, height: usize) -> (Vec<f64>, Vec<u32>) {
    // Down the columns: the nearest set pixel of the same column.
    let mut row_of = vec![NO_ROW; set.len()];
    for x in 0..width {
        let mut last: Option<usize> = None;
        for y in 0..height {
            if set[y * width + x] {
                last = Some(y);
            }
            row_of[y * width + x] = last.unwrap_or(NO_ROW);
        }
        last = None;
        // Upwards: take the set pixel below where it is nearer than the one above.
        for y in (0..height).rev() {
            if set[y * width + x] {
                last = Some(y);
            }
            let above = row_of[y * width + x];
            if let Some(below) = last
                && (above == NO_ROW || below - y < y - above)
            {
                row_of[y * width + x] = last.unwrap_or(NO_ROW);
            }
        }
    }
    let (mut squares, mut index) = (vec![f64::INFINITY; set.len()], vec![u32::MAX; set.len()]);
    let mut envelope = Envelope::default();
    for y in 0..height {
        let line = y * width..(y + 1) * width;
        envelope.line(y, width, &row_of[line.clone()], &mut squares[line.clone()], &mut index[line]);
    }
    (squares, index)
}

/// Columns whose parabolas form the lower envelope of a row, and where each takes over.
#[derive(Default)]
struct Envelope {
    at: Vec<usize>,
    from: Vec<f64>,
}

impl Envelope {
    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "pixels")]
    fn line(&mut self, y: usize, width: usize, row_of: &[usize], squares: &mut [f64], index: &mut [u32]) {
        self.at.clear();
        self.from.clear();
        let depth = |x: usize| {
            let d = y as f64 - row_of[x] as f64;
            d * d
        };
        for x in (0..width).filter(|x| row_of[*x] != NO_ROW) {
            // Abscissa where the parabolas of columns x and v intersect.
            let meets = |v: usize| {
                let (a, b) = (x as f64, v as f64);
                ((depth(x) + a * a) - (depth(v) + b * b)) / (2.0 * (a - b))
            };
            let mut start = f64::NEG_INFINITY;
            // Remove parabolas that the new one hides before they take over.
            while let Some(&v) = self.at.last() {
                start = meets(v);
                if self.from.last().is_some_and(|f| start <= *f) {
                    self.at.pop();
                    self.from.pop();
                    start = f64::NEG_INFINITY;
                } else {
                    break;
                }
            }
            self.at.push(x);
            self.from.push(start);
        }
        // Walk along the row through the envelope; k is the parabola that is lowest at x.
        let mut k = 0;
        for x in 0..width {
            while self.from.get(k + 1).is_some_and(|f| *f < x as f64) {
                k += 1;
            }
            if let Some(&v) = self.at.get(k) {
                let d = x as f64 - v as f64;
                squares[x] = d * d + depth(v);
                index[x] = (row_of[v] * width + v) as u32;
            }
        }
    }
}

/// Signed distance to the border of the set pixels, in pixels: above 0 inside, below 0 outside, +-0.5 at the border's
/// pixels.
#[allow(clippy::cast_possible_truncation, reason = "distances of pixels")]
pub fn signed(set: &[bool], width: usize, height: usize) -> (Vec<f32>, Vec<u32>) {
    let outside: Vec<bool> = set.iter().map(|s| !s).collect();
    let ((to_set, index), (to_rest, _)) =
        osier_base::par::join(|| nearest(set, width, height), || nearest(&outside, width, height));
    let one = |i: usize| {
        let d = if set[i] { to_rest[i].sqrt() - 0.5 } else { 0.5 - to_set[i].sqrt() };
        d.clamp(-1e6, 1e6) as f32
    };
    ((0..set.len()).map(one).collect(), index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::rng::Rng;

    #[test]
    fn distances_equal_those_of_trying_every_pixel() {
        for case in 0..6_u64 {
            let mut draw = Rng::at(case, &["edt".into()]);
            let share = [0.002, 0.01, 0.1, 0.5, 0.9, 0.0][usize::try_from(case).expect("small")];
            let set: Vec<bool> = (0..64 * 64).map(|_| draw.chance(share)).collect();
            let (squares, index) = nearest(&set, 64, 64);
            for i in 0..set.len() {
                let d = |j: usize| {
                    let (dx, dy) = ((i % 64) as f64 - (j % 64) as f64, (i / 64) as f64 - (j / 64) as f64);
                    dx * dx + dy * dy
                };
                let best = (0..set.len()).filter(|j| set[*j]).map(d).fold(f64::INFINITY, f64::min);
                assert!(squares[i].to_bits() == best.to_bits(), "case {case}, pixel {i}: {} not {best}", squares[i]);
                assert!(best.is_infinite() || d(index[i] as usize).to_bits() == best.to_bits());
            }
        }
    }

    #[test]
    fn a_disc_is_as_deep_as_its_radius() {
        let set: Vec<bool> = (0..64 * 64_i32).map(|i| (i % 64 - 32).pow(2) + (i / 64 - 32).pow(2) <= 400).collect();
        let (sd, _) = signed(&set, 64, 64);
        assert!((sd[32 * 64 + 32] - 20.0).abs() <= 0.5, "{}", sd[32 * 64 + 32]);
    }
}
