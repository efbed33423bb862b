//! The grid of wind snapshots: cell values with a halo of one cell, and trilinear interpolation that takes solids into account.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::cells::CellGeometry;
use super::domain::{Domain, FaceCondition};
use super::inlet::InletWind;
use super::tuning::{OUTSIDE_BLEND_CELLS, RECORDING_MARGIN};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_scene::solid::{Solid, Solids};

/// The surfaces between the eight cells of an interpolation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NearSurface {
    /// None of the cells is solid.
    Air,
    /// Some of the cells are solid.
    Solid,
    /// A surface may pass between air cells.
    Cut,
}

/// Layout of snapshot values, and the solid cells. All snapshots of a run share it.
#[derive(Debug)]
pub(super) struct SnapshotLayout {
    /// Cells by axis, without the halo.
    pub n: [usize; 3],
    /// Lowest corner of the cells, m.
    pub origin: DVec3,
    /// Edge length of the cubic cells, m.
    pub spacing: f64,
    pub periodic: [bool; 3],
    /// By cell, including the halo: whether it is solid, or below the ground.
    pub solid: Vec<bool>,
    /// By cell, including the halo: whether a surface cuts a link from this air cell to another one.
    beside_cut: Vec<bool>,
    /// By cell, including the halo: the surfaces between the eight cells of which it is the lowest corner.
    near: Vec<NearSurface>,
    /// Solids whose surfaces cut links.
    solids: Arc<Solids>,
    /// The wind outside the grid.
    pub inlet: Arc<InletWind>,
    /// Whether the lowest face is ground.
    ground: bool,
    /// By axis: the first and last border of the whole box, of which this grid may be a part, in cells from the origin.
    whole_box: [[f64; 2]; 3],
}

/// A range of cells: the lowest cell, and the number of cells along each axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellRange {
    pub low: [usize; 3],
    pub n: [usize; 3],
}

impl CellRange {
    /// The cells of a box of `n` cells that cover the given bounds, m, extended by [`RECORDING_MARGIN`]; all cells along an axis
    /// on which the bounds are empty. `origin`: lowest corner of the box, m.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn covering(n: [usize; 3], origin: DVec3, spacing: f64, periodic: [bool; 3], bounds: Bounds) -> Self {
        let mut range = Self { low: [0; 3], n };
        for a in 0..3 {
            let in_cells = |v: f32| narrow((f64::from(v) - origin[a]) / spacing);
            let (from, to) = (in_cells(bounds.min[a]) - RECORDING_MARGIN, in_cells(bounds.max[a]) + RECORDING_MARGIN);
            let size = n[a] as f32;
            // A periodic axis is kept whole if the bounds cross its end.
            if periodic[a] && (from < 0.0 || to > size) || from > to {
                continue;
            }
            range.low[a] = (from.clamp(0.0, size - 1.0) as usize).min(n[a] - 1);
            range.n[a] = (to.clamp(1.0, size).ceil() as usize).max(range.low[a] + 1) - range.low[a];
        }
        range
    }
}

impl SnapshotLayout {
    /// `solids`: all solids in the wind.
    pub(super) fn new(domain: &Domain, cells: CellGeometry, solids: &[Solid], inlet: Arc<InletWind>) -> Self {
        let (n, CellGeometry { origin, spacing }) = (domain.grid.n, cells);
        let periodic = [0, 2, 4].map(|f| domain.faces[f] == FaceCondition::Periodic);
        let ground = matches!(domain.faces[2], FaceCondition::Wall(_) | FaceCondition::Rough);
        let has_cuts = !domain.cuts.halves().is_empty();
        let solids = Arc::new(Solids::new(if has_cuts { solids.to_vec() } else { Vec::new() }, false));
        let (solid, beside_cut, near) = (Vec::new(), Vec::new(), Vec::new());
        let whole_box = n.map(|n| [0.0, n as f64]);
        let mut grid = Self { n, origin, spacing, periodic, solid, beside_cut, near, solids, inlet, ground, whole_box };
        let source = |k: usize| grid.source_of_halo_cell(grid.coordinates(k));
        let values = 0..grid.value_count();
        let solid =
            values.clone().map(|k| ground && grid.coordinates(k)[1] == 0 || domain.is_solid(source(k))).collect();
        let beside = |k: usize| has_cuts && !domain.is_solid(source(k)) && domain.is_beside_cut_link(source(k));
        let beside_cut = values.map(beside).collect();
        (grid.solid, grid.beside_cut) = (solid, beside_cut);
        grid.mark_cells_near_surfaces();
        grid
    }

    fn mark_cells_near_surfaces(&mut self) {
        let strides = self.strides();
        let any = |cells: &[bool], k: usize| {
            (0..8).any(|c| cells.get(k + corner_offset(c, strides)).copied().unwrap_or(false))
        };
        let near = |k: usize| match () {
            () if any(&self.beside_cut, k) => NearSurface::Cut,
            () if any(&self.solid, k) => NearSurface::Solid,
            () => NearSurface::Air,
        };
        self.near = (0..self.value_count()).map(near).collect();
    }

    /// The part of the grid that covers the given bounds, m, and the part's lowest cell.
    pub(super) fn crop(&self, bounds: Bounds) -> (Self, [usize; 3]) {
        let CellRange { low, n } = CellRange::covering(self.n, self.origin, self.spacing, self.periodic, bounds);
        let periodic = std::array::from_fn(|a| self.periodic[a] && n[a] == self.n[a]);
        let origin = self.origin + DVec3::new(low[0] as f64, low[1] as f64, low[2] as f64) * self.spacing;
        let (spacing, inlet) = (self.spacing, Arc::clone(&self.inlet));
        let ground = self.ground && low[1] == 0;
        let solids = Arc::clone(&self.solids);
        let (solid, beside_cut, near) = (Vec::new(), Vec::new(), Vec::new());
        let whole_box = std::array::from_fn(|a| self.whole_box[a].map(|border| border - low[a] as f64));
        let mut part = Self { n, origin, spacing, periodic, solid, beside_cut, near, solids, inlet, ground, whole_box };
        let crop = |all: &[bool]| {
            (0..part.value_count()).map(|k| all[self.index_in_uncropped(&part, low, k)]).collect::<Vec<_>>()
        };
        (part.solid, part.beside_cut) = (crop(&self.solid), crop(&self.beside_cut));
        part.mark_cells_near_surfaces();
        (part, low)
    }

    /// Index in this layout of the value `k` of a cropped layout `part` whose lowest cell is `low`.
    pub(super) fn index_in_uncropped(&self, part: &Self, low: [usize; 3], k: usize) -> usize {
        let (at, strides) = (part.coordinates(k), self.strides());
        (0..3).map(|a| (at[a] + low[a]) * strides[a]).sum()
    }

    /// Number of values: cells and halo.
    pub(super) fn value_count(&self) -> usize {
        self.n.iter().map(|n| n + 2).product()
    }

    /// Distance in values between successive cells along each axis.
    pub(super) fn strides(&self) -> [usize; 3] {
        [1, self.n[0] + 2, (self.n[0] + 2) * (self.n[1] + 2)]
    }

    /// Coordinates of value `k`, counted from the halo: cell (0, 0, 0) is at (1, 1, 1).
    fn coordinates(&self, k: usize) -> [usize; 3] {
        let [_, row, plane] = self.strides();
        [k % row, k / row % (self.n[1] + 2), k / plane]
    }

    /// The cell whose value a halo cell repeats: across periodic faces the opposite one, otherwise the nearest. Coordinates count
    /// from the halo, those of the result from the cells.
    pub(super) fn source_of_halo_cell(&self, at: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| match at[a] {
            0 if self.periodic[a] => self.n[a] - 1,
            p if p == self.n[a] + 1 && self.periodic[a] => 0,
            p => p.clamp(1, self.n[a]) - 1,
        })
    }

    /// Fills the halo planes of a snapshot's values, after all other values are written.
    pub(super) fn fill_halo_planes(&self, values: &mut [[f32; 4]]) {
        let size = self.strides()[2];
        for z in [0, self.n[2] + 1] {
            let from = self.source_of_halo_cell([1, 1, z])[2] + 1;
            values.copy_within(from * size..(from + 1) * size, z * size);
        }
    }

    /// Velocity at a point, m, by trilinear interpolation of `values` (by index) at the eight cell centres around it. Within half
    /// a cell of a solid it falls linearly to 0, and cells behind a wall do not count; outside the box, `outside` blends in over
    /// [`OUTSIDE_BLEND_CELLS`].
    /// Source: \[catkin\] eq. 11.
    /// Differs: eq. 11 starts at the closest node, which makes negative weights; this starts at the one below.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    pub(super) fn sample(&self, at: Vec3, values: impl Fn(usize) -> Vec3, outside: impl Fn() -> Vec3) -> Vec3 {
        // Compute in f64 up to the cell: f32 would lose 1e-5 of a cell a hundred cells from the corner.
        let s = (at.as_dvec3() - self.origin) / self.spacing;
        if s.y <= 0.0 && self.ground {
            return Vec3::ZERO;
        }
        let (mut base, mut fraction, mut beyond, mut place) = ([0; 3], [0.0; 3], 0.0_f64, s);
        for a in 0..3 {
            // Wrap periodic axes, clamp the others, and compute how far outside the box the point is, cells.
            let n = self.n[a] as f64;
            let inside = if self.periodic[a] { s[a] - (s[a] / n).floor() * n } else { s[a].clamp(0.0, n) };
            if !self.periodic[a] {
                let [first, last] = self.whole_box[a];
                beyond = beyond.max(first - s[a]).max(s[a] - last);
            }
            // Values are at cell centres, half a cell inside, after one halo cell.
            place[a] = inside;
            let from = inside + 0.5;
            base[a] = (from as usize).min(self.n[a]);
            fraction[a] = narrow(from - base[a] as f64);
        }
        // Interpolate between the eight cells around the point; outside the box, fade into the undisturbed inflow.
        let strides = self.strides();
        let first = base[0] + base[1] * strides[1] + base[2] * strides[2];
        let inner = match self.near[first] {
            NearSurface::Cut => self.interpolate_beside_walls(place, base, fraction, values),
            near => self.interpolate_trilinear(first, near, fraction, values),
        };
        if beyond > 0.0 {
            let share = narrow(beyond.min(1e3)).min(OUTSIDE_BLEND_CELLS) / OUTSIDE_BLEND_CELLS;
            return inner + (outside() - inner) * share;
        }
        inner
    }

    /// Trilinear interpolation in the eight cells of which `first` is the lowest corner. Beside solids only air cells count.
    fn interpolate_trilinear(
        &self,
        first: usize,
        near: NearSurface,
        fraction: [f32; 3],
        values: impl Fn(usize) -> Vec3,
    ) -> Vec3 {
        let strides = self.strides();
        let weight = |c: usize| trilinear_weight(fraction, c);
        if near == NearSurface::Air {
            return (0..8).fold(Vec3::ZERO, |sum, c| sum + values(first + corner_offset(c, strides)) * weight(c));
        }
        // Beside solids: the mean over the fluid cells only, times the distance to the nearest solid cell (not to its centre),
        // which rises from 0 to 1 over half a cell.
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

    /// Trilinear interpolation where a surface may pass between the cells: the mean over the air cells whose centres
    /// are visible from the point, times the distance to the nearest surface, which rises from 0 to 1 over half a cell.
    /// `place`: the point, in cells from the lowest corner; `base`: coordinates of the lowest of the eight cells,
    /// counted from the halo.
    fn interpolate_beside_walls(
        &self,
        place: DVec3,
        base: [usize; 3],
        fraction: [f32; 3],
        values: impl Fn(usize) -> Vec3,
    ) -> Vec3 {
        let strides = self.strides();
        let first = base[0] + base[1] * strides[1] + base[2] * strides[2];
        let in_world = |cells: DVec3| (self.origin + cells * self.spacing).as_vec3();
        let (at, half) = (in_world(place), narrow(self.spacing / 2.0));
        let ground = if self.ground { narrow(place.y * self.spacing) } else { f32::INFINITY };
        let distance = self.solids.near(at, half).map_or(f32::INFINITY, |near| near.nearest.distance).min(ground);
        if distance <= 0.0 {
            return Vec3::ZERO;
        }
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for c in 0..8 {
            let (k, weight) = (first + corner_offset(c, strides), trilinear_weight(fraction, c));
            if weight <= 0.0 || self.solid[k] {
                continue;
            }
            // Clamp the centre of a halo cell to the box: only the part of the line of sight within the box counts.
            let center = |a: usize| (base[a] + (c >> a & 1)) as f64 - 0.5;
            let center = DVec3::from_array(std::array::from_fn(|a| center(a).clamp(0.0, self.n[a] as f64)));
            if !self.solids.meets([at, in_world(center)], 0.0) {
                sum += values(k) * weight;
                total += weight;
            }
        }
        if total > 0.0 { sum / total * (distance / half).min(1.0) } else { Vec3::ZERO }
    }
}

/// Weight of one of eight corners ([`corner_offset`]) in a trilinear interpolation.
fn trilinear_weight(fraction: [f32; 3], c: usize) -> f32 {
    let along = |a: usize| if c >> a & 1 == 1 { fraction[a] } else { 1.0 - fraction[a] };
    along(0) * along(1) * along(2)
}

/// Offset of one of eight corners: bit `a` of `c` is a step along axis `a`.
fn corner_offset(c: usize, strides: [usize; 3]) -> usize {
    (c & 1) * strides[0] + (c >> 1 & 1) * strides[1] + (c >> 2) * strides[2]
}
