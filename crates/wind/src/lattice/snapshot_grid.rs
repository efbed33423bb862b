//! The grid of wind snapshots: cell values with a halo of one cell, and trilinear interpolation that knows solids.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::domain::{Domain, FaceCondition};
use super::inlet::InletWind;
use super::tuning::OUTSIDE_BLEND_CELLS;
use osier_base::geometry::Bounds;
use osier_base::math::narrow;

/// Layout of snapshot values, and which cells are solid. Shared by all snapshots of a run.
#[derive(Debug)]
pub(super) struct SnapshotGrid {
    /// Cells by axis, without the halo.
    pub n: [usize; 3],
    /// Lowest corner of the cells, m.
    pub origin: DVec3,
    /// Edge length of the cubic cells, m.
    pub spacing: f64,
    pub periodic: [bool; 3],
    /// By cell, halo included: solid, or below the ground.
    pub solid: Vec<bool>,
    /// By cell, halo included: whether any of the eight cells of which it is the lowest corner is solid.
    near_solid: Vec<bool>,
    /// The wind outside the grid.
    pub inlet: Arc<InletWind>,
    /// The lowest face is ground.
    ground: bool,
}

impl SnapshotGrid {
    /// `origin`: lowest corner, m; `spacing`: m.
    pub(super) fn new(domain: &Domain, origin: DVec3, spacing: f64, inlet: Arc<InletWind>) -> Self {
        let n = domain.grid.n;
        let periodic = [0, 2, 4].map(|f| domain.faces[f] == FaceCondition::Periodic);
        let ground = matches!(domain.faces[2], FaceCondition::Wall(_) | FaceCondition::Rough);
        let mut grid = Self { n, origin, spacing, periodic, solid: Vec::new(), near_solid: Vec::new(), inlet, ground };
        grid.solid = (0..grid.value_count())
            .map(|k| {
                let at = grid.coordinates_of_value(k);
                ground && at[1] == 0 || domain.is_solid(grid.source_of_halo_cell(at))
            })
            .collect();
        grid.mark_cells_near_solids();
        grid
    }

    fn mark_cells_near_solids(&mut self) {
        let strides = self.strides();
        let any = |k: usize| (0..8).any(|c| self.solid.get(k + corner_offset(c, strides)).copied().unwrap_or(false));
        self.near_solid = (0..self.value_count()).map(any).collect();
    }

    /// The part of the grid that covers some bounds, m, `margin` cells wider, and the part's lowest cell.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn crop(&self, bounds: Bounds, margin: f32) -> (Self, [usize; 3]) {
        // Axis by axis the range of cells that the bounds touch, in cells from the corner.
        let (mut low, mut n) = ([0; 3], self.n);
        for a in 0..3 {
            let in_cells = |v: f32| narrow((f64::from(v) - self.origin[a]) / self.spacing);
            let (from, to) = (in_cells(bounds.min[a]) - margin, in_cells(bounds.max[a]) + margin);
            let size = self.n[a] as f32;
            // A periodic axis stays whole if the bounds cross its end.
            if self.periodic[a] && (from < 0.0 || to > size) || from > to {
                continue;
            }
            low[a] = (from.clamp(0.0, size - 1.0) as usize).min(self.n[a] - 1);
            n[a] = (to.clamp(1.0, size).ceil() as usize).max(low[a] + 1) - low[a];
        }
        let periodic = std::array::from_fn(|a| self.periodic[a] && n[a] == self.n[a]);
        let origin = self.origin + DVec3::new(low[0] as f64, low[1] as f64, low[2] as f64) * self.spacing;
        let (spacing, inlet) = (self.spacing, Arc::clone(&self.inlet));
        let ground = self.ground && low[1] == 0;
        let mut part = Self { n, origin, spacing, periodic, solid: Vec::new(), near_solid: Vec::new(), inlet, ground };
        part.solid = (0..part.value_count()).map(|k| self.solid[self.index_in_uncropped(&part, low, k)]).collect();
        part.mark_cells_near_solids();
        (part, low)
    }

    /// Index here of the value `k` of a part that begins at the cell `low`.
    pub(super) fn index_in_uncropped(&self, part: &Self, low: [usize; 3], k: usize) -> usize {
        let (at, strides) = (part.coordinates_of_value(k), self.strides());
        (0..3).map(|a| (at[a] + low[a]) * strides[a]).sum()
    }

    /// Number of values: cells and halo.
    pub(super) fn value_count(&self) -> usize {
        self.n.iter().map(|n| n + 2).product()
    }

    /// Values from a cell to the next along each axis.
    pub(super) fn strides(&self) -> [usize; 3] {
        [1, self.n[0] + 2, (self.n[0] + 2) * (self.n[1] + 2)]
    }

    /// Coordinates of value `k`, counted from the halo: cell (0, 0, 0) is at (1, 1, 1).
    fn coordinates_of_value(&self, k: usize) -> [usize; 3] {
        let [_, row, plane] = self.strides();
        [k % row, k / row % (self.n[1] + 2), k / plane]
    }

    /// The cell whose value a halo cell repeats: across periodic faces the opposite one, else the nearest. Coordinates
    /// count from the halo, those of the result from the cells.
    pub(super) fn source_of_halo_cell(&self, at: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| match at[a] {
            0 if self.periodic[a] => self.n[a] - 1,
            p if p == self.n[a] + 1 && self.periodic[a] => 0,
            p => p.clamp(1, self.n[a]) - 1,
        })
    }

    /// Fills the halo planes of a snapshot's values, when all others are written.
    pub(super) fn fill_halo_planes(&self, values: &mut [[f32; 4]]) {
        let size = self.strides()[2];
        for z in [0, self.n[2] + 1] {
            let from = self.source_of_halo_cell([1, 1, z])[2] + 1;
            values.copy_within(from * size..(from + 1) * size, z * size);
        }
    }

    /// Velocity at a point, m, by trilinear interpolation of `values` (by index) at the eight cell centres around it.
    /// Within half a cell of a solid it falls linearly to 0; outside the grid, `outside` blends in over
    /// [`OUTSIDE_BLEND_CELLS`].
    /// Source: \[catkin\] eq. 11.
    /// Differs: eq. 11 starts at the closest node, which makes negative weights; this starts at the one below.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn sample(&self, at: Vec3, values: impl Fn(usize) -> Vec3, outside: impl Fn() -> Vec3) -> Vec3 {
        // In f64 down to the cell: f32 would lose 1e-5 of a cell a hundred cells from the corner.
        let s = (at.as_dvec3() - self.origin) / self.spacing;
        if s.y <= 0.0 && self.ground {
            return Vec3::ZERO;
        }
        let (mut base, mut fraction, mut beyond) = ([0; 3], [0.0; 3], 0.0_f64);
        for a in 0..3 {
            // Wrap periodic axes, clamp the others and note how far outside the point is, cells.
            let n = self.n[a] as f64;
            let inside = if self.periodic[a] { s[a] - (s[a] / n).floor() * n } else { s[a].clamp(0.0, n) };
            beyond = beyond.max((s[a] - inside).abs() * f64::from(u8::from(!self.periodic[a])));
            // Values sit at cell centres, half a cell in, after one halo cell.
            let from = inside + 0.5;
            base[a] = (from as usize).min(self.n[a]);
            fraction[a] = narrow(from - base[a] as f64);
        }
        // Interpolate between the eight cells around the point; outside the box, fade into the undisturbed inflow.
        let strides = self.strides();
        let first = base[0] + base[1] * strides[1] + base[2] * strides[2];
        let inner = self.interpolate_trilinear(first, fraction, values);
        if beyond > 0.0 {
            let share = narrow(beyond.min(1e3)).min(OUTSIDE_BLEND_CELLS) / OUTSIDE_BLEND_CELLS;
            return inner + (outside() - inner) * share;
        }
        inner
    }

    /// Trilinear interpolation between the eight cells from index `first` on.
    fn interpolate_trilinear(&self, first: usize, fraction: [f32; 3], values: impl Fn(usize) -> Vec3) -> Vec3 {
        let strides = self.strides();
        let weight = |c: usize| {
            let along = |a: usize| if c >> a & 1 == 1 { fraction[a] } else { 1.0 - fraction[a] };
            along(0) * along(1) * along(2)
        };
        if !self.near_solid[first] {
            return (0..8).fold(Vec3::ZERO, |sum, c| sum + values(first + corner_offset(c, strides)) * weight(c));
        }
        // Beside solids: the mean over the fluid cells alone, times the distance to the nearest solid cell (not to its
        // centre), which rises from 0 to 1 over half a cell.
        let (mut sum, mut total, mut nearest) = (Vec3::ZERO, 0.0, f32::INFINITY);
        for c in 0..8 {
            if self.solid[first + corner_offset(c, strides)] {
                let distance = |a: usize| ((fraction[a] - (c >> a & 1) as f32).abs() - 0.5).max(0.0);
                nearest = nearest.min(Vec3::from_array(std::array::from_fn(distance)).length());
            } else {
                sum += values(first + corner_offset(c, strides)) * weight(c);
                total += weight(c);
            }
        }
        if total > 0.0 { sum / total * (nearest * 2.0).min(1.0) } else { Vec3::ZERO }
    }
}

/// Offset of one of eight corners: bit `a` of `c` is a step along axis `a`.
fn corner_offset(c: usize, strides: [usize; 3]) -> usize {
    (c & 1) * strides[0] + (c >> 1 & 1) * strides[1] + (c >> 2) * strides[2]
}
