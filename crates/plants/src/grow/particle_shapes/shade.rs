//! Shade of a growing plant: voxels that sum the shade of the nodes above them. Axes turn away from it.

use glam::{DVec3, IVec3};

/// Layers below a node that it shades; in layer q it shades a square of 2 q + 1 cells a side.
const LAYERS: i32 = 6;
/// Shade that a node casts on its own cell; each layer below gets half of that above it.
const STRENGTH: f64 = 0.2;
/// Shade is summed in units of 2^-20, so that sums do not depend on their order.
const UNIT: f64 = 1.0 / 1_048_576.0;
/// Smallest cell, m: about a twig with its leaves.
const MIN_CELL: f64 = 0.1;
/// Cells along the reach of a plant, unless they would be smaller than [`MIN_CELL`].
const CELLS: f64 = 64.0;
/// A gradient per metre below this has no direction.
const MIN_GRADIENT: f64 = 1e-6;

/// Shade around a plant in cubic cells, cast by its nodes on the layers below them.
#[derive(Debug, Clone)]
pub struct ShadeGrid {
    /// Edge length of a cell, m; at least [`MIN_CELL`].
    cell: f64,
    /// Corner of the cell (0, 0, 0), m.
    origin: DVec3,
    dims: IVec3,
    /// Shade of each cell in units of 2^-20, x fastest, then z, then y.
    shade: Vec<u32>,
}

impl ShadeGrid {
    /// An empty grid for a plant whose axes stay within `reach`, m, of the root disc.
    pub fn new(reach: f64) -> Self {
        let cell = (reach / CELLS).max(MIN_CELL);
        // Below the ground two layers are enough to read a gradient at it.
        let (half, below) = (whole((reach / cell).ceil()) + 1, 2);
        let dims = IVec3::new(2 * half, half + below, 2 * half);
        let origin = DVec3::new(f64::from(-half), f64::from(-below), f64::from(-half)) * cell;
        let cells = [dims.x, dims.y, dims.z].iter().map(|n| n.unsigned_abs() as usize).product();
        Self { cell, origin, dims, shade: vec![0; cells] }
    }

    fn cell_of(&self, p: DVec3) -> IVec3 {
        let at = ((p - self.origin) / self.cell).floor();
        IVec3::new(whole(at.x), whole(at.y), whole(at.z))
    }

    fn index(&self, c: IVec3) -> Option<usize> {
        let inside = c.cmpge(IVec3::ZERO).all() && c.cmplt(self.dims).all();
        inside.then(|| ((c.y * self.dims.z + c.z) * self.dims.x + c.x).unsigned_abs() as usize)
    }

    /// Adds the shade of nodes: in layer q below a node's cell, STRENGTH 2^-q for |dx|, |dz| <= q.
    pub fn add(&mut self, nodes: impl Iterator<Item = DVec3>) {
        // Nodes of one cell cast equal shade, so they are counted first.
        let mut cells: Vec<[i32; 3]> = nodes.map(|p| self.cell_of(p).to_array()).collect();
        cells.sort_unstable();
        for run in cells.chunk_by(|a, b| a == b) {
            let count = run.len() as f64;
            let top = IVec3::from_array(run[0]);
            for q in 0..=LAYERS {
                let amount = units(STRENGTH / f64::from(1_u32 << q.unsigned_abs()) * count);
                for z in -q..=q {
                    // Visit only the part of the row that lies inside the grid.
                    let (low, high) = ((top.x - q).max(0), (top.x + q).min(self.dims.x - 1));
                    let Some(first) = self.index(IVec3::new(low, top.y - q, top.z + z)).filter(|_| low <= high) else {
                        continue;
                    };
                    let row = &mut self.shade[first..=first + (high - low).unsigned_abs() as usize];
                    row.iter_mut().for_each(|s| *s = s.saturating_add(amount));
                }
            }
        }
    }

    /// Shade at a point; 0 outside of the grid.
    pub fn shade(&self, p: DVec3) -> f64 {
        self.at(self.cell_of(p))
    }

    fn at(&self, c: IVec3) -> f64 {
        self.index(c).map_or(0.0, |i| f64::from(self.shade[i]) * UNIT)
    }

    /// Vector that points out of the shade; its length is the shade at `p`, at most 1.
    pub fn way_out(&self, p: DVec3) -> DVec3 {
        let c = self.cell_of(p);
        // Central differences over two cells.
        let slope = |e: IVec3| (self.at(c + e) - self.at(c - e)) / (2.0 * self.cell);
        let gradient = DVec3::new(slope(IVec3::X), slope(IVec3::Y), slope(IVec3::Z));
        -gradient / gradient.length().max(MIN_GRADIENT) * self.at(c).min(1.0)
    }
}

/// Integer part of a coordinate in cells; values far beyond a grid are clamped, which keeps them outside.
#[allow(clippy::cast_possible_truncation, reason = "clamped to 2^20 cells")]
fn whole(x: f64) -> i32 {
    x.clamp(-1_048_576.0, 1_048_576.0) as i32
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to u32")]
fn units(shade: f64) -> u32 {
    (shade / UNIT).min(f64::from(u32::MAX)) as u32
}
