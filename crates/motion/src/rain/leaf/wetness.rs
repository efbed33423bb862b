//! Wetness of a leaf as running drops sense it: a coarse grid over the texture, apart from the maps that are written.

use glam::DVec2;

use osier_base::math;

/// Cells each way over texture coordinates.
pub(crate) const GRID_CELLS: usize = 48;
/// Wetness that counts as none.
const DRY: f64 = 1.0 / 1024.0;

/// Exponential drying: wetness falls to `zeta` of its value in `half_life` seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DryingLaw {
    /// Fraction left after `half_life`, 0 to 1.
    pub zeta: f64,
    /// Time to which `zeta` refers, s.
    pub half_life: f64,
}

impl DryingLaw {
    /// Wetness at time `t` of a cell that was last covered at time `covered`, s. Source: [yang-wu] eq. 11, without the distance.
    fn wetness(self, covered: f32, t: f64) -> f64 {
        let wet = math::pow(self.zeta, (t - f64::from(covered)).max(0.0) / self.half_life);
        if wet < DRY { 0.0 } else { wet }
    }
}

/// Time at which each cell was last covered by water, s.
#[derive(Debug, Clone, Default)]
pub struct WetnessGrid {
    /// Row by row, negative infinity where a cell never was wet; empty while the whole leaf is dry.
    last_covered: Vec<f32>,
}

impl WetnessGrid {
    /// Marks the cells within `reach` of `uv`, both in texture coordinates, as covered at time `t`, s.
    pub fn cover(&mut self, uv: DVec2, reach: DVec2, t: f64) {
        if self.last_covered.is_empty() {
            self.last_covered = vec![f32::NEG_INFINITY; GRID_CELLS * GRID_CELLS];
        }
        let (lo, hi) = (grid_cell(uv - reach), grid_cell(uv + reach));
        for y in lo[1]..=hi[1] {
            for x in lo[0]..=hi[0] {
                self.last_covered[y * GRID_CELLS + x] = math::narrow(t);
            }
        }
    }

    /// Wetness at texture coordinates and time `t`, s: 0 to 1.
    pub fn wetness(&self, uv: DVec2, t: f64, law: DryingLaw) -> f64 {
        let [x, y] = grid_cell(uv);
        match self.last_covered.get(y * GRID_CELLS + x) {
            Some(covered) if covered.is_finite() => law.wetness(*covered, t),
            _ => 0.0,
        }
    }

    /// Mean wetness at time `t` over a blade that occupies `cells` cells, 0 to 1.
    pub fn mean_wetness(&self, cells: usize, t: f64, law: DryingLaw) -> f64 {
        // A drop covers neighbouring cells at the same time, so the last power is reused while the time repeats.
        let (mut last, mut wet, mut sum) = (f32::NEG_INFINITY, 0.0, 0.0);
        for covered in self.last_covered.iter().filter(|s| s.is_finite()) {
            if covered.to_bits() != last.to_bits() {
                (last, wet) = (*covered, law.wetness(*covered, t));
            }
            sum += wet;
        }
        (sum / cells.max(1) as f64).min(1.0)
    }
}

fn grid_cell(uv: DVec2) -> [usize; 2] {
    let n = GRID_CELLS as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    [uv.x, uv.y].map(|x| (x * n).clamp(0.0, n - 1.0) as usize)
}
