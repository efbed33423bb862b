//! Voxelization of solids into lattice cells, and checks of the result.

use std::collections::VecDeque;

use glam::DVec3;

use super::blockage::blocked_row_share;
use super::cells::{CellGeometry, cell_center};
use super::domain::Domain;
use super::grid::LatticeGrid;
use super::report::LatticeWarning;
use super::stencil::opposite;
use super::tuning::{MAX_BLOCKAGE, MIN_CELLS_PER_HEIGHT, OPEN_FACE_CLEARANCE};
use osier_base::par;
use osier_scene::solid::{Form, Solid};

/// Counts and defects of voxelized solids, from which the warnings are made.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VoxelReport {
    /// Number of solid cells, filled ones included.
    pub solid: usize,
    /// Number of enclosed air cells that were made solid.
    pub filled: usize,
    /// Whether a solid other than terrain is within [`OPEN_FACE_CLEARANCE`] of an open face.
    pub crowded: bool,
    /// Share of the cross-section that solids block.
    pub blocked: f64,
    /// Solids lower than [`MIN_CELLS_PER_HEIGHT`] cells, and their heights in cells.
    pub coarse: Vec<(String, f64)>,
    /// Warnings S032 about solids whose meshes are not closed.
    pub open: Vec<String>,
}

impl VoxelReport {
    /// Warnings S021, S031 and S032 about the result.
    pub(super) fn warnings(&self) -> Vec<LatticeWarning> {
        let mut warnings = Vec::new();
        let mut warn = |code, text: String| warnings.push(LatticeWarning { code, text });
        // Warnings about the flow of the whole box.
        if self.crowded {
            warn(
                "S021",
                format!(
                    "a solid is within {OPEN_FACE_CLEARANCE} cells of an inlet or outlet of the lattice wind and disturbs the \
                 flow there; enlarge the box with wind.lattice.cells"
                ),
            );
        }
        if self.blocked > MAX_BLOCKAGE {
            warn(
                "S021",
                format!(
                    "solids block {:.0} % of the cross-section of the lattice wind and accelerate the flow past them; \
                 enlarge the box with wind.lattice.cells",
                    100.0 * self.blocked
                ),
            );
        }
        if self.filled > 0 {
            let text =
                format!("{} air cells are enclosed by solids and count as solid: no wind blows there", self.filled);
            warn("S021", text);
        }
        // Warnings about the flow around single solids.
        for (name, cells) in &self.coarse {
            let finer = format!("wind.lattice.dx to 1/{MIN_CELLS_PER_HEIGHT} of its height or less");
            warn(
                "S031",
                format!(
                    "solid \"{name}\" is only {cells:.1} cells high: its wake depends on the size of the cells; lower {finer}"
                ),
            );
        }
        for text in &self.open {
            warn("S032", text.clone());
        }
        warnings
    }
}

/// Whether each cell is solid, x fastest: its centre is inside a solid.
pub(super) fn voxelize(grid: &LatticeGrid, cells: CellGeometry, solids: &[Solid]) -> Vec<bool> {
    let planes: Vec<usize> = (0..grid.n[2]).collect();
    // One task per plane; within the plane each solid tests the cells inside its bounds.
    let planes = par::par_map(&planes, |z| {
        let mut plane = vec![false; grid.n[0] * grid.n[1]];
        for solid in solids {
            let Some([columns, rows]) = cells.cells_within_bounds(grid, solid, 0.0, *z) else { continue };
            for y in rows {
                for x in columns.clone() {
                    let cell = &mut plane[x + grid.n[0] * y];
                    *cell = *cell || solid.contains(cell_center(cells, [x, y, *z]));
                }
            }
        }
        plane
    });
    planes.concat()
}

/// Makes enclosed air solid, then checks the clearance of open faces and the blockage of the cross-section. `along`: axis to
/// which the wind is most nearly parallel.
pub(super) fn fill_and_check_solids(
    domain: &mut Domain,
    solids: &[Solid],
    cells: CellGeometry,
    along: usize,
) -> VoxelReport {
    let CellGeometry { origin, spacing } = cells;
    let filled = fill_enclosed_air(domain);
    // Check the clearance: terrain has to reach the faces, but obstacles must not.
    let obstacles: Vec<Solid> = solids.iter().filter(|s| !matches!(s.form, Form::Land(_))).cloned().collect();
    let open = |f: usize| domain.faces[f].is_open();
    let n = domain.grid.n;
    let clearance = osier_base::math::narrow(OPEN_FACE_CLEARANCE as f64 * spacing);
    let (low, high) =
        (origin.as_vec3(), (origin + DVec3::new(n[0] as f64, n[1] as f64, n[2] as f64) * spacing).as_vec3());
    let crowded = obstacles.iter().any(|s| {
        let b = s.bounds();
        [0, 2].iter().any(|&a| {
            open(2 * a) && b.min[a] < low[a] + clearance && b.max[a] > low[a]
                || open(2 * a + 1) && b.max[a] > high[a] - clearance && b.min[a] < high[a]
        })
    });
    let blocked = blocked_row_share(domain, along);
    let solid = domain.solid.iter().filter(|s| **s).count();
    let bounded = obstacles.iter().map(|s| (s.name.clone(), cells.height_in_cells(s)));
    // A solid of exactly the least height may be slightly lower due to rounding. The height is not positive for a solid below the
    // box.
    let coarse =
        bounded.filter(|(_, height)| *height > 0.0 && *height < f64::from(MIN_CELLS_PER_HEIGHT) - 0.01).collect();
    let open = obstacles.iter().filter_map(|s| s.open_mesh_warning("the lattice wind")).collect();
    VoxelReport { solid, filled, crowded, blocked, coarse, open }
}

/// Makes solid every air cell from which no path through air leads to an open face: a flood fill from the open faces. Returns the
/// number of filled cells, except those whose centre lies on a surface, in which no wind is expected.
#[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "sizes fit")]
fn fill_enclosed_air(domain: &mut Domain) -> usize {
    let n = domain.grid.n;
    let mut reached = vec![false; domain.solid.len()];
    let mut queue = VecDeque::new();
    // Seeds: the air cells at open faces.
    for (c, reached) in reached.iter_mut().enumerate() {
        let cell = [c % n[0], c / n[0] % n[1], c / n[0] / n[1]];
        let at_face = |f: usize| cell[f / 2] == if f.is_multiple_of(2) { 0 } else { n[f / 2] - 1 };
        if !domain.solid[c] && (0..6).any(|f| domain.faces[f].is_open() && at_face(f)) {
            *reached = true;
            queue.push_back(cell);
        }
    }
    // Spread to the six neighbours, including those across periodic faces.
    while let Some(cell) = queue.pop_front() {
        for f in 0..6 {
            // Faces are numbered -x, +x, ..., directions along the axes +x, -x, ... from 1 on.
            if domain.is_link_cut(cell, opposite(f + 1)) {
                continue;
            }
            let mut next = cell.map(|c| c as isize);
            next[f / 2] += if f.is_multiple_of(2) { -1 } else { 1 };
            let Some(next) = domain.node_as_cell(domain.wrap_periodic(next)) else { continue };
            let c = domain.grid.cell_index(next);
            if !domain.solid[c] && !reached[c] {
                reached[c] = true;
                queue.push_back(next);
            }
        }
    }
    let mut filled = 0;
    for (c, (solid, reached)) in domain.solid.iter_mut().zip(&reached).enumerate() {
        if !*solid && !*reached {
            *solid = true;
            filled += usize::from(!domain.cuts.is_isolated(c));
        }
    }
    filled
}
