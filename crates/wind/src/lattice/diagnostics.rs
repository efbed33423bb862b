//! Writes snapshots, and computes diagnostics of the flow from the same moments: density range, mass, checkerboard.

use super::domain::Domain;
use super::snapshot_layout::SnapshotLayout;
use super::tuning::DENSITY_RANGE;

/// Diagnostics of a whole domain, plane by plane in the order of z.
#[derive(Debug, Default)]
pub(super) struct FlowDiagnostics {
    pub planes: Vec<PlaneDiagnostics>,
}

/// Density range, mass and checkerboard of one plane of constant z.
#[derive(Debug, Default)]
pub(super) struct PlaneDiagnostics {
    /// First cell, by x and y, whose density is NaN or out of range.
    pub out_of_range: Option<[usize; 2]>,
    /// Sum of the density less 1.
    pub mass: f64,
    /// Sum of the density less 1, with a sign that alternates with the parity of x + y + z: nonzero if the sublattices of even
    /// and of odd cells decouple.
    pub checkerboard: f64,
}

/// Number of partial sums that are accumulated in parallel.
const PARTIAL_SUMS: usize = 8;

/// Memory that a pass fills with the moments of its last step, converted to a snapshot's units.
#[derive(Debug)]
pub(super) struct SnapshotTarget<'a> {
    pub grid: &'a SnapshotLayout,
    /// Speed of one cell per step, m/s.
    pub speed_unit: f32,
    /// Values of the grid's cells, halo included: velocity, m/s, and density less 1.
    pub values: &'a mut [[f32; 4]],
}

/// A plane of cells of a snapshot, with the halo around it.
#[derive(Debug)]
pub(super) struct SnapshotPlane<'a> {
    grid: &'a SnapshotLayout,
    speed_unit: f32,
    values: &'a mut [[f32; 4]],
}

impl<'a> SnapshotTarget<'a> {
    /// The planes of cells, without the halo planes.
    pub(super) fn split_planes(self) -> Vec<SnapshotPlane<'a>> {
        let Self { grid, speed_unit, values } = self;
        let planes = values.chunks_mut(grid.strides()[2]).skip(1).take(grid.n[2]);
        planes.map(|values| SnapshotPlane { grid, speed_unit, values }).collect()
    }
}

impl SnapshotPlane<'_> {
    /// Fills the halo rows, after all other rows are written.
    pub(super) fn fill_halo_rows(&mut self) {
        let row = self.grid.n[0] + 2;
        for y in [0, self.grid.n[1] + 1] {
            let from = (self.grid.source_of_halo_cell([1, y, 1])[1] + 1) * row;
            self.values.copy_within(from..from + row, y * row);
        }
    }
}

impl PlaneDiagnostics {
    /// Adds a row of cells, velocity by component and density less 1, to the diagnostics, and writes it into the snapshot's
    /// plane, if there is one. Solid cells are set to 0.
    #[inline(always)]
    pub(super) fn add_and_store_row(
        &mut self,
        domain: &Domain,
        y: usize,
        z: usize,
        moments: [&mut [f32]; 4],
        target: Option<&mut SnapshotPlane<'_>>,
    ) {
        let nx = domain.grid.n[0];
        let solid = &domain.solid[domain.grid.cell_index([0, y, z])..][..nx];
        // The flow never reads populations of solid cells, but they would distort sums and snapshots.
        let [ux, uy, uz, drho] = moments;
        for (x, _) in solid.iter().enumerate().filter(|(_, solid)| **solid) {
            (ux[x], uy[x], uz[x], drho[x]) = (0.0, 0.0, 0.0, 0.0);
        }
        self.accumulate_densities(drho, y, z);
        if let Some(SnapshotPlane { grid, speed_unit: speed, values }) = target {
            // Interleave the row for the snapshot, in m/s, then repeat or wrap its ends into the halo.
            let to = &mut values[(y + 1) * (nx + 2)..][..nx + 2];
            let cells = &mut to[1..=nx];
            let (ux, uy, uz, drho) = (&ux[..nx], &uy[..nx], &uz[..nx], &drho[..nx]);
            for k in 0..nx {
                cells[k] = [ux[k] * *speed, uy[k] * *speed, uz[k] * *speed, drho[k]];
            }
            let halo = [0, nx + 1].map(|x| to[grid.source_of_halo_cell([x, 1, 1])[0] + 1]);
            [to[0], to[nx + 1]] = halo;
        }
    }

    #[inline(always)]
    fn accumulate_densities(&mut self, row: &[f32], y: usize, z: usize) {
        // Eight partial sums let the loop vectorize, and fix the order of summation on every machine.
        let mut sums = [0.0_f64; PARTIAL_SUMS];
        let mut good = true;
        for chunk in row.chunks(PARTIAL_SUMS) {
            for (sum, drho) in sums.iter_mut().zip(chunk) {
                *sum += f64::from(*drho);
                good &= is_density_in_range(*drho);
            }
        }
        if !good && self.out_of_range.is_none() {
            self.out_of_range = row.iter().position(|drho| !is_density_in_range(*drho)).map(|x| [x, y]);
        }
        // PARTIAL_SUMS is even, so that the sums alternate between cells of even and of odd x.
        let every_other = |first: usize| sums.iter().skip(first).step_by(2).sum::<f64>();
        let (even, odd) = (every_other(0), every_other(1));
        self.mass += even + odd;
        self.checkerboard += if (y + z).is_multiple_of(2) { even - odd } else { odd - even };
    }
}

/// Whether a density less 1 is within [`DENSITY_RANGE`]; false for NaN.
#[inline(always)]
fn is_density_in_range(drho: f32) -> bool {
    (drho > DENSITY_RANGE[0] - 1.0) & (drho < DENSITY_RANGE[1] - 1.0)
}
