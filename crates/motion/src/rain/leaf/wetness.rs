//! How wet a leaf is where drops look for their way: coarse, apart from the maps that are written.

use glam::DVec2;

use osier_base::math;

/// Cells each way over texture coordinates.
pub(super) const CELLS: usize = 48;
/// Wetness that counts as none.
const DRY: f64 = 1.0 / 1024.0;

/// When each cell was last covered by water, s.
#[derive(Debug, Clone, Default)]
pub struct WetnessGrid {
    /// Empty while all of it is dry.
    seen: Vec<f32>,
}

impl WetnessGrid {
    /// Water covers a place with a reach, both in texture coordinates, at time `t`, s.
    pub fn cover(&mut self, uv: DVec2, reach: DVec2, t: f64) {
        if self.seen.is_empty() {
            self.seen = vec![f32::NEG_INFINITY; CELLS * CELLS];
        }
        let (lo, hi) = (cell(uv - reach), cell(uv + reach));
        for y in lo[1]..=hi[1] {
            for x in lo[0]..=hi[0] {
                self.seen[y * CELLS + x] = math::narrow(t);
            }
        }
    }

    /// How wet a place is at time `t`, 0 to 1. Source: [yang-wu] eq. 11, without the distance.
    pub fn at(&self, uv: DVec2, t: f64, law: (f64, f64)) -> f64 {
        let [x, y] = cell(uv);
        match self.seen.get(y * CELLS + x) {
            Some(seen) if seen.is_finite() => left(*seen, t, law),
            _ => 0.0,
        }
    }

    /// Its mean at time `t` over a blade that has `cells` of the cells.
    pub fn mean(&self, cells: usize, t: f64, law: (f64, f64)) -> f64 {
        // Drops cover cells in groups: the last one's answer often holds for the next.
        let (mut last, mut wet, mut sum) = (f32::NEG_INFINITY, 0.0, 0.0);
        for seen in self.seen.iter().filter(|s| s.is_finite()) {
            if seen.to_bits() != last.to_bits() {
                (last, wet) = (*seen, left(*seen, t, law));
            }
            sum += wet;
        }
        (sum / cells.max(1) as f64).min(1.0)
    }
}

/// Wetness at time `t` of what was covered at a time.
fn left(seen: f32, t: f64, (zeta, half_life): (f64, f64)) -> f64 {
    let wet = math::pow(zeta, (t - f64::from(seen)).max(0.0) / half_life);
    if wet < DRY { 0.0 } else { wet }
}

fn cell(uv: DVec2) -> [usize; 2] {
    let n = CELLS as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    [uv.x, uv.y].map(|x| (x * n).clamp(0.0, n - 1.0) as usize)
}
