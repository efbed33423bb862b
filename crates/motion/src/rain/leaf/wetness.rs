//! Wetness that acts on drops, on a coarse grid over a leaf's texture; the wetness maps that are written are separate and finer.

use glam::DVec2;

use super::{GRID_CELLS, grid_cell};
use crate::rain::tuning::MIN_WETNESS;
use osier_base::math;

/// Exponential drying: w(t) = fraction^(t / time).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DryingLaw {
    /// Fraction of the wetness that is left after `time`, 0 to 1.
    pub fraction: f64,
    /// Time to which `fraction` refers, s.
    pub time: f64,
}

impl DryingLaw {
    /// Wetness at time `t` of a cell that was last covered at time `covered`, s. Source: [yang-wu] eq. 11, without the distance.
    fn wetness(self, covered: f32, t: f64) -> f64 {
        let wet = math::pow(self.fraction, (t - f64::from(covered)).max(0.0) / self.time);
        if wet < MIN_WETNESS { 0.0 } else { wet }
    }
}

/// Times at which the cells of a grid over the leaf's texture were last covered by water; wetness follows from their age.
#[derive(Debug, Clone, Default)]
pub struct WetnessGrid {
    /// Times, s, row by row; negative infinity where a cell never was wet; empty while the whole leaf is dry.
    last_covered: Vec<f32>,
}

impl WetnessGrid {
    /// Marks the cells within `reach` of `uv`, both in texture coordinates, as covered at time `t`, s.
    pub fn mark_covered(&mut self, uv: DVec2, reach: DVec2, t: f64) {
        if self.last_covered.is_empty() {
            self.last_covered = vec![f32::NEG_INFINITY; GRID_CELLS * GRID_CELLS];
        }
        // The bounding box of the circle; on a grid this coarse its corners do not matter.
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
