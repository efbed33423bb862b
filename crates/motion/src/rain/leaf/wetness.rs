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
    pub(in crate::rain) fn wetness(self, covered: f32, t: f64) -> f64 {
        let wet = math::pow(self.fraction, (t - f64::from(covered)).max(0.0) / self.time);
        if wet < MIN_WETNESS { 0.0 } else { wet }
    }
}

/// Reads wetness from a grid at one time. Neighbouring places mostly have been covered at the same time, so the last wetness is
/// reused.
#[derive(Debug)]
pub(in crate::rain) struct WetnessReader<'a> {
    grid: &'a WetnessGrid,
    t: f64,
    law: DryingLaw,
    last: Option<WetnessAtAge>,
}

/// Wetness of a cell for the time, s, at which it was last covered.
#[derive(Debug, Clone, Copy)]
struct WetnessAtAge {
    covered: f32,
    wetness: f64,
}

impl WetnessReader<'_> {
    /// Wetness at texture coordinates, 0 to 1, equal to [`WetnessGrid::wetness`] but faster for successive close places.
    pub fn wetness(&mut self, uv: DVec2) -> f64 {
        let Some(covered) = self.grid.last_covered_at(uv) else { return 0.0 };
        match self.last {
            Some(last) if last.covered.to_bits() == covered.to_bits() => last.wetness,
            _ => self.last.insert(WetnessAtAge { covered, wetness: self.law.wetness(covered, self.t) }).wetness,
        }
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
        self.last_covered_at(uv).map_or(0.0, |covered| law.wetness(covered, t))
    }

    /// Time at which the cell at texture coordinates was last covered, s; `None` if it never was.
    fn last_covered_at(&self, uv: DVec2) -> Option<f32> {
        let [x, y] = grid_cell(uv);
        self.last_covered.get(y * GRID_CELLS + x).copied().filter(|covered| covered.is_finite())
    }

    /// A reader of the wetness at time `t`, s, for many places that are close together.
    pub(in crate::rain) fn reader(&self, t: f64, law: DryingLaw) -> WetnessReader<'_> {
        WetnessReader { grid: self, t, law, last: None }
    }

    /// Mean wetness at time `t` over a blade that occupies `cells` cells, 0 to 1.
    pub fn mean_wetness(&self, cells: usize, t: f64, law: DryingLaw) -> f64 {
        // A drop covers neighbouring cells at the same time, so the last wetness is reused while the time repeats.
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
