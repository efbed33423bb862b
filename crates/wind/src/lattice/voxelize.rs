//! Voxelization of solids into lattice cells, and checks of the result.

use std::collections::VecDeque;

use glam::{DVec3, Vec3};

use super::domain::Domain;
use super::grid::LatticeGrid;
use super::report::LatticeWarning;
use super::tuning::{MAX_BLOCKAGE, OPEN_FACE_CLEARANCE};
use osier_base::geometry::Bounds;
use osier_base::par;
use osier_scene::solid::{Form, Slab, Solid};

/// Result of [`fill_and_check_solids`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VoxelReport {
    /// Number of solid cells, filled ones included.
    pub solid: usize,
    /// Number of enclosed air cells that were made solid.
    pub filled: usize,
    /// Whether a solid other than terrain is within [`OPEN_FACE_CLEARANCE`] of an open face.
    pub crowded: bool,
    /// Share of the cross-section that solids block, if it is above [`MAX_BLOCKAGE`].
    pub blocked: Option<f64>,
}

impl VoxelReport {
    /// The result as warnings S021.
    pub(super) fn warnings(&self) -> Vec<LatticeWarning> {
        let mut warnings = Vec::new();
        let mut warn = |text: String| warnings.push(LatticeWarning { code: "S021", text });
        if self.crowded {
            warn(format!(
                "a solid is within {OPEN_FACE_CLEARANCE} cells of an inlet or outlet of the lattice wind and disturbs the \
                 flow there; enlarge the box with wind.lattice.cells"
            ));
        }
        if let Some(share) = self.blocked {
            warn(format!(
                "solids block {:.0} % of the cross-section of the lattice wind and accelerate the flow past them; \
                 enlarge the box with wind.lattice.cells",
                100.0 * share
            ));
        }
        if self.filled > 0 {
            warn(format!("{} air cells are enclosed by solids and count as solid: no wind blows there", self.filled));
        }
        warnings
    }
}

/// Centre of a cell, m. `origin`: lowest corner of the box, m; `spacing`: edge of a cell, m.
pub(super) fn cell_center(origin: DVec3, spacing: f64, cell: [usize; 3]) -> Vec3 {
    let offset = DVec3::new(cell[0] as f64 + 0.5, cell[1] as f64 + 0.5, cell[2] as f64 + 0.5);
    (origin + offset * spacing).as_vec3()
}

/// Whether each cell is solid, x fastest: its centre is inside a solid, or it belongs to the one layer of cells that stands for a
/// solid thinner than a cell.
pub(super) fn voxelize(grid: &LatticeGrid, origin: DVec3, spacing: f64, solids: &[Solid]) -> Vec<bool> {
    let planes: Vec<usize> = (0..grid.n[2]).collect();
    let half = osier_base::math::narrow(spacing / 2.0);
    // Bounds and slab once per solid; a cell outside the bounds needs no exact test.
    let candidates: Vec<_> =
        solids.iter().map(|s| (s, candidate_bounds(s, half), slab_thinner_than_cell(s, half))).collect();
    // One task per plane; within the plane each solid tests the cells inside its bounds.
    let planes = par::par_map(&planes, |z| {
        let mut plane = vec![false; grid.n[0] * grid.n[1]];
        for (solid, bounds, thin) in &candidates {
            for (i, cell) in plane.iter_mut().enumerate() {
                let center = cell_center(origin, spacing, [i % grid.n[0], i / grid.n[0], *z]);
                let inside = center.cmpge(bounds.min).all() && center.cmple(bounds.max).all();
                let claims =
                    || solid.contains(center) || thin.is_some_and(|t| is_in_slab_layer(solid, t, half, center));
                *cell = *cell || inside && claims();
            }
        }
        plane
    });
    planes.concat()
}

/// Bounds in which a solid may own cells; terrain extends without bound horizontally and downwards. `half`: half an edge of a
/// cell, m.
fn candidate_bounds(solid: &Solid, half: f32) -> Bounds {
    // One cell wider: a thin solid may own a cell whose centre lies outside of it.
    let bounds = solid.bounds().grown(2.0 * half);
    match solid.form {
        Form::Land(_) => {
            Bounds { min: Vec3::splat(f32::NEG_INFINITY), max: Vec3::new(f32::INFINITY, bounds.max.y, f32::INFINITY) }
        }
        _ => bounds,
    }
}

/// The slab of a solid thinner than a cell, whose inside may lie between all cell centres. `half`: half an edge of a cell, m.
fn slab_thinner_than_cell(solid: &Solid, half: f32) -> Option<Slab> {
    solid.slab().filter(|s| s.thickness <= 2.001 * half)
}

/// Whether the cell at `center` belongs to the layer that stands for a thin solid: the solid's middle plane passes within half
/// a cell of its centre. Distances are along the axis nearest to the slab's normal, so that each row has exactly one such cell
/// and the layer has no hole.
fn is_in_slab_layer(solid: &Solid, slab: Slab, half: f32, center: Vec3) -> bool {
    let axis = slab.across.abs().max_position();
    let distance = (center - slab.center).dot(slab.across) / slab.across[axis];
    let mut projected = center;
    projected[axis] -= distance;
    distance >= -half && distance < half && solid.contains(projected)
}

/// Makes enclosed air solid, then checks the clearance of open faces and the blockage of the cross-section. `along`: axis that
/// the wind is most parallel to.
pub(super) fn fill_and_check_solids(
    domain: &mut Domain,
    solids: &[Solid],
    origin: DVec3,
    spacing: f64,
    along: usize,
) -> VoxelReport {
    let filled = fill_enclosed_air(domain);
    // Clearance: terrain has to reach the faces, obstacles must not.
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
    // Blockage: the share of rows of cells along the wind with at least one solid cell.
    let across = [(along + 1) % 3, (along + 2) % 3];
    let mut blocked_rows = 0_usize;
    for i in 0..n[across[0]] {
        for j in 0..n[across[1]] {
            let mut cell = [0; 3];
            (cell[across[0]], cell[across[1]]) = (i, j);
            blocked_rows += usize::from((0..n[along]).any(|k| {
                cell[along] = k;
                domain.is_solid(cell)
            }));
        }
    }
    let share = blocked_rows as f64 / (n[across[0]] * n[across[1]]) as f64;
    let solid = domain.solid.iter().filter(|s| **s).count();
    VoxelReport { solid, filled, crowded, blocked: (share > MAX_BLOCKAGE).then_some(share) }
}

/// Makes solid every air cell from which no path through air leads to an open face: a flood fill from the open faces.
/// Returns their number.
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
    // Spread to the six neighbours, across periodic faces too.
    while let Some(cell) = queue.pop_front() {
        for f in 0..6 {
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
    for (solid, reached) in domain.solid.iter_mut().zip(&reached) {
        if !*solid && !*reached {
            *solid = true;
            filled += 1;
        }
    }
    filled
}
