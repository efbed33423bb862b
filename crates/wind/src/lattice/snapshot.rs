//! Wind snapshots, and the wind between two of them.

use std::cell::LazyCell;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::super::Wind;
use super::snapshot_layout::SnapshotLayout;

/// The wind of one frame: velocity, m/s, and density less 1 of every cell.
#[derive(Debug)]
pub struct WindSnapshot {
    pub(super) grid: Arc<SnapshotLayout>,
    /// Velocity, m/s, and density less 1 of each cell, x fastest, halo included.
    pub(super) values: Vec<[f32; 4]>,
    /// Time, s; 0 is the clip's first frame.
    pub(super) time: f64,
}

impl WindSnapshot {
    /// Time, s; 0 is the clip's first frame.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Number of cells along x, y and z, without the halo.
    pub fn cells(&self) -> [usize; 3] {
        self.grid.n
    }

    /// Lowest corner of the cells, m.
    pub fn origin(&self) -> DVec3 {
        self.grid.origin
    }

    /// Edge length of the cubic cells, m.
    pub fn spacing(&self) -> f64 {
        self.grid.spacing
    }

    /// Velocity, m/s, and density less 1 of a cell; `None` if it is solid or outside the box.
    pub fn cell(&self, at: [usize; 3]) -> Option<(Vec3, f32)> {
        let [nx, ny, nz] = self.grid.n;
        if at[0] >= nx || at[1] >= ny || at[2] >= nz {
            return None;
        }
        let strides = self.grid.strides();
        let k = at[0] + 1 + (at[1] + 1) * strides[1] + (at[2] + 1) * strides[2];
        let [x, y, z, drho] = self.values[k];
        (!self.grid.solid[k]).then_some((Vec3::new(x, y, z), drho))
    }
}

/// The wind between two snapshots, by linear interpolation in time and trilinear interpolation in space.
#[derive(Debug, Clone)]
pub struct InterpolatedWind {
    /// The earlier snapshot, whose inflow applies outside the box.
    pub before: Arc<WindSnapshot>,
    /// The later snapshot, with the same cells as `before`.
    pub after: Arc<WindSnapshot>,
    /// Time of `before`, s; at earlier times the wind is constant.
    pub t0: f64,
    /// Time of `after`, s; at later times the wind is constant.
    pub t1: f64,
}

impl Wind for InterpolatedWind {
    fn sample(&self, places: &[Vec3], t: f64, out: &mut [Vec3]) {
        let part = if self.t1 > self.t0 { ((t - self.t0) / (self.t1 - self.t0)).clamp(0.0, 1.0) } else { 0.0 };
        let part = osier_base::math::narrow(part);
        // State of the undisturbed inflow, which applies outside the box; computed only if a position needs it.
        let (grid, inlet) = (&self.before.grid, &self.before.grid.inlet);
        let outside = LazyCell::new(|| inlet.state_at(t, inlet.gust_factor(t)));
        for (place, u) in places.iter().zip(out) {
            // Interpolate linearly in time at the cells, before the interpolation in space.
            let value = |k: usize| {
                let (a, b) = (self.before.values[k], self.after.values[k]);
                let a = Vec3::new(a[0], a[1], a[2]);
                a + (Vec3::new(b[0], b[1], b[2]) - a) * part
            };
            *u = grid.sample(*place, value, || inlet.velocity_with_state(place.as_dvec3(), &outside).as_vec3());
        }
    }

    fn mean(&self) -> Vec3 {
        self.before.grid.inlet.mean()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.before.grid.inlet.mean_at(position)
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.before.grid.inlet.mean_at_time(position, t)
    }

    fn has_varying_mean(&self) -> bool {
        self.before.grid.inlet.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.before.grid.inlet.prescribed_mean_at_time(t)
    }

    fn period(&self) -> Option<f64> {
        None
    }
}
