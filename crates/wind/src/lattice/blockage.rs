//! Amount of the inflow that solids block: the share of blocked rows of cells, and the narrowest passage past the solids.

use std::collections::VecDeque;

use super::domain::{Domain, FaceCondition};
use super::stencil::opposite;

/// Level of a cell that the search has not reached from an inlet.
const UNREACHED: u32 = u32::MAX;

/// Share of the rows of cells along an axis that a solid cell or a cut link blocks, 0 to 1: an upper bound of the share
/// of the inflow that is blocked, since all other rows are free from end to end.
pub(super) fn blocked_row_share(domain: &Domain, along: usize) -> f64 {
    let n = domain.grid.n;
    let across = [(along + 1) % 3, (along + 2) % 3];
    let forward = 2 * along + 1;
    let mut blocked = 0_usize;
    for i in 0..n[across[0]] {
        for j in 0..n[across[1]] {
            let mut cell = [0; 3];
            (cell[across[0]], cell[across[1]]) = (i, j);
            blocked += usize::from((0..n[along]).any(|k| {
                cell[along] = k;
                domain.is_solid(cell) || domain.is_link_cut(cell, forward)
            }));
        }
    }
    blocked as f64 / (n[across[0]] * n[across[1]]) as f64
}

/// Share of the inflow's cross-section that stays open at the narrowest position between inlets and outlets, 0 to 1, counted in
/// faces of cells. The search ends when the share reaches `enough`.
///
/// By Menger's theorem the narrowest section has as many faces as there are paths from inlets to outlets that share no
/// face. That number is the maximum flow through a network with an edge of capacity 1 for every face between two air
/// cells.
/// Source: Y. Dinitz, "Algorithm for solution of a problem of maximum flow in networks with power estimation", 1970.
pub(super) fn narrowest_open_share(domain: &Domain, enough: f64) -> f64 {
    let mut network = FlowNetwork::new(domain);
    let inlets = network.ends(FaceCondition::Inlet);
    let wanted = enough * inlets.len() as f64;
    let mut flow = 0.0_f64;
    // Each phase finds augmenting paths of the shortest remaining length; if there are none, the flow is maximal.
    while flow < wanted && network.find_levels(&inlets) {
        for end in &inlets {
            if flow < wanted && !network.is_end_used(*end) && network.find_augmenting_path(*end) {
                flow += 1.0;
            }
        }
    }
    if inlets.is_empty() { 1.0 } else { flow / inlets.len() as f64 }
}

/// A face of a cell at an inlet or outlet, where paths of the network begin or end.
#[derive(Debug, Clone, Copy)]
struct NetworkEnd {
    cell: [usize; 3],
    face: usize,
}

/// Air cells, connected by their faces. Faces are numbered -x, +x, -y, +y, -z, +z.
struct FlowNetwork<'a> {
    domain: &'a Domain,
    /// By cell and axis: flow through its upper face, -1 to 1.
    flow: Vec<[i8; 3]>,
    /// Per cell: bit mask of the faces at inlets and outlets that a path uses.
    used_ends: Vec<u8>,
    /// Per cell: number of steps from the nearest unused inlet.
    level: Vec<u32>,
    /// Per cell: the face that the search tries next.
    next_face: Vec<u8>,
}

impl<'a> FlowNetwork<'a> {
    fn new(domain: &'a Domain) -> Self {
        let count = domain.grid.cell_count();
        Self {
            domain,
            flow: vec![[0; 3]; count],
            used_ends: vec![0; count],
            level: vec![UNREACHED; count],
            next_face: vec![0; count],
        }
    }

    /// Faces of air cells at those faces of the box that have a condition.
    fn ends(&self, condition: FaceCondition) -> Vec<NetworkEnd> {
        let n = self.domain.grid.n;
        let cells = (0..self.flow.len()).filter(|c| !self.domain.solid[*c]);
        let cells = cells.map(|c| [c % n[0], c / n[0] % n[1], c / n[0] / n[1]]);
        let faces = cells.flat_map(|cell| (0..6).map(move |face| NetworkEnd { cell, face }));
        faces.filter(|end| self.is_end(*end, condition)).collect()
    }

    /// Whether a face of a cell is part of a face of the box with this condition, and no surface lies between it and the cell's
    /// centre.
    fn is_end(&self, NetworkEnd { cell, face }: NetworkEnd, condition: FaceCondition) -> bool {
        let last = self.domain.grid.n[face / 2] - 1;
        cell[face / 2] == if face.is_multiple_of(2) { 0 } else { last }
            && self.domain.faces[face] == condition
            && !self.domain.is_link_cut(cell, opposite(face + 1))
    }

    fn is_end_used(&self, NetworkEnd { cell, face }: NetworkEnd) -> bool {
        self.used_ends[self.domain.grid.cell_index(cell)] >> face & 1 == 1
    }

    /// The air cell beyond a face; `None` if there is none, or if a surface lies in between.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    fn neighbor(&self, cell: [usize; 3], face: usize) -> Option<[usize; 3]> {
        let mut node = cell.map(|c| c as isize);
        node[face / 2] += if face.is_multiple_of(2) { -1 } else { 1 };
        let next = self.domain.node_as_cell(self.domain.wrap_periodic(node))?;
        // Directions along the axes are numbered +x, -x, ... beginning with 1.
        (!self.domain.is_solid(next) && !self.domain.is_link_cut(cell, opposite(face + 1))).then_some(next)
    }

    /// The flow through the face between two cells, and the sign of flow out of `cell`.
    fn face_flow(&mut self, cell: [usize; 3], next: [usize; 3], face: usize) -> (&mut i8, i8) {
        let (owner, sign) = if face.is_multiple_of(2) { (next, -1) } else { (cell, 1) };
        (&mut self.flow[self.domain.grid.cell_index(owner)][face / 2], sign)
    }

    /// Numbers the cells by their distance from unused inlets. Returns whether an unused outlet can be reached.
    fn find_levels(&mut self, inlets: &[NetworkEnd]) -> bool {
        self.level.fill(UNREACHED);
        self.next_face.fill(0);
        let grid = self.domain.grid;
        // Breadth first from all inlets with capacity left, so that levels are distances in cells.
        let mut queue = VecDeque::new();
        for end in inlets {
            if !self.is_end_used(*end) {
                self.level[grid.cell_index(end.cell)] = 0;
                queue.push_back(end.cell);
            }
        }
        let mut reached = false;
        while let Some(cell) = queue.pop_front() {
            for face in 0..6 {
                let end = NetworkEnd { cell, face };
                reached |= self.is_end(end, FaceCondition::Outlet) && !self.is_end_used(end);
                let Some(next) = self.neighbor(cell, face) else { continue };
                let (flow, sign) = self.face_flow(cell, next, face);
                let at = grid.cell_index(next);
                // A face carries at most one unit in either direction; flow against this direction can be undone.
                if *flow * sign < 1 && self.level[at] == UNREACHED {
                    self.level[at] = self.level[grid.cell_index(cell)] + 1;
                    queue.push_back(next);
                }
            }
        }
        reached
    }

    /// Finds a path from an inlet to an unused outlet along ascending levels, and adds one unit of flow along it.
    fn find_augmenting_path(&mut self, inlet: NetworkEnd) -> bool {
        let grid = self.domain.grid;
        // The path so far: cells, and the face by which it leaves each of them.
        let (mut way, mut cell): (Vec<NetworkEnd>, [usize; 3]) = (Vec::new(), inlet.cell);
        loop {
            let c = grid.cell_index(cell);
            let face = usize::from(self.next_face[c]);
            if face == 6 {
                // Dead end: go back one cell, and try its next face.
                let Some(last) = way.pop() else { return false };
                cell = last.cell;
                self.next_face[grid.cell_index(cell)] += 1;
                continue;
            }
            let end = NetworkEnd { cell, face };
            if self.is_end(end, FaceCondition::Outlet) && !self.is_end_used(end) {
                self.used_ends[c] |= 1 << face;
                break;
            }
            let onward = self.neighbor(cell, face).filter(|next| {
                let (flow, sign) = self.face_flow(cell, *next, face);
                *flow * sign < 1 && self.level[grid.cell_index(*next)] == self.level[c] + 1
            });
            if let Some(next) = onward {
                way.push(end);
                cell = next;
            } else {
                self.next_face[c] += 1;
            }
        }
        self.used_ends[grid.cell_index(inlet.cell)] |= 1 << inlet.face;
        for step in way {
            if let Some(next) = self.neighbor(step.cell, step.face) {
                let (flow, sign) = self.face_flow(step.cell, next, step.face);
                *flow += sign;
            }
        }
        true
    }
}

#[cfg(test)]
#[allow(clippy::print_stdout, reason = "tests")]
mod tests {
    use super::super::cut_links::CutHalfLinks;
    use super::super::grid::LatticeGrid;
    use super::*;

    /// A channel along x of 24 x 10 x 12 cells, of which some are solid.
    fn channel(solid: impl Fn([usize; 3]) -> bool) -> Domain {
        let grid = LatticeGrid::new([24, 10, 12]);
        let n = grid.n;
        let solid = (0..grid.cell_count()).map(|c| solid([c % n[0], c / n[0] % n[1], c / n[0] / n[1]])).collect();
        let faces = [
            FaceCondition::Inlet,
            FaceCondition::Outlet,
            FaceCondition::Rough,
            FaceCondition::Slip,
            FaceCondition::Periodic,
            FaceCondition::Periodic,
        ];
        Domain { grid, faces, solid, cuts: CutHalfLinks::default() }
    }

    #[test]
    fn the_narrowest_section_counts_and_not_what_stands_in_the_way() {
        // No solid; a wall with a gap of 2 x 3 cells; two walls that leave half each, on opposite sides; a wall without a gap.
        let gap = |[x, y, z]: [usize; 3]| x == 12 && !(y < 2 && (4..7).contains(&z));
        let staggered = |[x, y, _]: [usize; 3]| x == 6 && y < 5 || x == 18 && y >= 5;
        for (domain, rows, open) in [
            (channel(|_| false), 0.0, 1.0),
            (channel(gap), 1.0 - 6.0 / 120.0, 6.0 / 120.0),
            (channel(staggered), 1.0, 0.5),
            (channel(|[x, _, _]| x == 3), 1.0, 0.0),
        ] {
            let (blocked, found) = (blocked_row_share(&domain, 0), narrowest_open_share(&domain, 1.0));
            println!("rows blocked {blocked:.3}, open {found:.3}");
            assert!((blocked - rows).abs() < 1e-12 && (found - open).abs() < 1e-12, "{blocked} {found}");
            assert!((narrowest_open_share(&domain, 0.1) - open.min(0.1)).abs() < 1e-12);
        }
    }
}
