//! Which cells are solid.

use std::collections::VecDeque;

use glam::{DVec3, Vec3};

use super::domain::Domain;
use super::grid::LatticeGrid;
use super::report::LatticeWarning;
use super::tuning::{MAX_BLOCKAGE, OPEN_FACE_CLEARANCE};
use osier_base::geometry::Bounds;
use osier_base::par;
use osier_scene::solid::{Form, Slab, Solid};

/// What marking has found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VoxelReport {
    /// Solid cells.
    pub solid: usize,
    /// Domain of pockets that were filled.
    pub filled: usize,
    /// Something other than land stands too near an open face.
    pub crowded: bool,
    /// Share of the inflow that is blocked, if it is too much.
    pub blocked: Option<f64>,
}

impl VoxelReport {
    /// What should be known.
    pub(super) fn warnings(&self) -> Vec<LatticeWarning> {
        let mut notes = Vec::new();
        let mut note = |text: String| notes.push(LatticeWarning { code: "S021", text });
        if self.crowded {
            note("a solid stands within 4 cells of a face through which the lattice wind comes or goes, and disturbs it; \
                  widen the box with wind.lattice.cells"
                .into());
        }
        if let Some(share) = self.blocked {
            note(format!(
                "solids block {:.0} % of the lattice wind, which squeezes past them; widen the box with \
                 wind.lattice.cells",
                100.0 * share
            ));
        }
        if self.filled > 0 {
            note(format!("{} cells of air that nothing joins with the open are still", self.filled));
        }
        notes
    }
}

/// Middle of a cell, m.
pub(super) fn cell_center(origin: DVec3, spacing: f64, cell: [usize; 3]) -> Vec3 {
    let at = DVec3::new(cell[0] as f64 + 0.5, cell[1] as f64 + 0.5, cell[2] as f64 + 0.5);
    (origin + at * spacing).as_vec3()
}

/// Domain of solids: those whose middle is inside, and of a part thinner than a cell the layer that holds its middle.
pub(super) fn voxelize(grid: &LatticeGrid, origin: DVec3, spacing: f64, solids: &[Solid]) -> Vec<bool> {
    let planes: Vec<usize> = (0..grid.n[2]).collect();
    let half = osier_base::math::narrow(spacing / 2.0);
    let reach: Vec<_> = solids.iter().map(|s| (s, claim_bounds(s, half), thin_slab(s, half))).collect();
    let planes = par::par_map(&planes, |z| {
        let mut plane = vec![false; grid.n[0] * grid.n[1]];
        for (solid, bounds, thin) in &reach {
            for (i, cell) in plane.iter_mut().enumerate() {
                let at = cell_center(origin, spacing, [i % grid.n[0], i / grid.n[0], *z]);
                let inside = at.cmpge(bounds.min).all() && at.cmple(bounds.max).all();
                *cell =
                    *cell || inside && (solid.contains(at) || thin.is_some_and(|t| in_thin_layer(solid, t, half, at)));
            }
        }
        plane
    });
    planes.concat()
}

/// The box in which a solid may claim cells; land goes on for ever, and down.
fn claim_bounds(solid: &Solid, half: f32) -> Bounds {
    let bounds = solid.bounds().grown(2.0 * half);
    match solid.form {
        Form::Land(_) => {
            Bounds { min: Vec3::splat(f32::NEG_INFINITY), max: Vec3::new(f32::INFINITY, bounds.max.y, f32::INFINITY) }
        }
        _ => bounds,
    }
}

/// Its thinnest direction, if cells may miss it.
fn thin_slab(solid: &Solid, half: f32) -> Option<Slab> {
    solid.slab().filter(|s| s.thickness <= 2.001 * half)
}

/// Whether a place is in the layer of cells that holds the middle of a solid thinner than a cell. Measured along the nearest
/// axis, just one cell of a row is.
fn in_thin_layer(solid: &Solid, slab: Slab, half: f32, at: Vec3) -> bool {
    let axis = slab.across.abs().max_position();
    let away = (at - slab.center).dot(slab.across) / slab.across[axis];
    let mut on = at;
    on[axis] -= away;
    away >= -half && away < half && solid.contains(on)
}

/// Fills pockets that no open face reaches and judges what stands where.
pub(super) fn fill_and_check(
    domain: &mut Domain,
    solids: &[Solid],
    origin: DVec3,
    spacing: f64,
    along: usize,
) -> VoxelReport {
    let filled = fill_enclosed_air(domain);
    let standing: Vec<Solid> = solids.iter().filter(|s| !matches!(s.form, Form::Land(_))).cloned().collect();
    let open = |f: usize| domain.faces[f].is_open();
    let n = domain.grid.n;
    let reach = osier_base::math::narrow(OPEN_FACE_CLEARANCE as f64 * spacing);
    let (low, high) =
        (origin.as_vec3(), (origin + DVec3::new(n[0] as f64, n[1] as f64, n[2] as f64) * spacing).as_vec3());
    let crowded = standing.iter().any(|s| {
        let b = s.bounds();
        [0, 2].iter().any(|&a| {
            open(2 * a) && b.min[a] < low[a] + reach && b.max[a] > low[a]
                || open(2 * a + 1) && b.max[a] > high[a] - reach && b.min[a] < high[a]
        })
    });
    let across = [(along + 1) % 3, (along + 2) % 3];
    let mut hidden = 0_usize;
    for i in 0..n[across[0]] {
        for j in 0..n[across[1]] {
            let mut cell = [0; 3];
            (cell[across[0]], cell[across[1]]) = (i, j);
            hidden += usize::from((0..n[along]).any(|k| {
                cell[along] = k;
                domain.is_solid(cell)
            }));
        }
    }
    let share = hidden as f64 / (n[across[0]] * n[across[1]]) as f64;
    let solid = domain.solid.iter().filter(|s| **s).count();
    VoxelReport { solid, filled, crowded, blocked: (share > MAX_BLOCKAGE).then_some(share) }
}

/// Makes solid what no path of cells joins with an open face.
#[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "sizes fit")]
fn fill_enclosed_air(domain: &mut Domain) -> usize {
    let n = domain.grid.n;
    let mut reached = vec![false; domain.solid.len()];
    let mut queue = VecDeque::new();
    for (c, reached) in reached.iter_mut().enumerate() {
        let cell = [c % n[0], c / n[0] % n[1], c / n[0] / n[1]];
        let at_face = |f: usize| cell[f / 2] == if f.is_multiple_of(2) { 0 } else { n[f / 2] - 1 };
        if !domain.solid[c] && (0..6).any(|f| domain.faces[f].is_open() && at_face(f)) {
            *reached = true;
            queue.push_back(cell);
        }
    }
    while let Some(cell) = queue.pop_front() {
        for f in 0..6 {
            let mut next = cell.map(|c| c as isize);
            next[f / 2] += if f.is_multiple_of(2) { -1 } else { 1 };
            let Some(next) = domain.cell_at(domain.wrap_periodic(next)) else { continue };
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
