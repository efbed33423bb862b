//! The simulated box: solid cells, the boundary condition of each face, and the source of each population.

use super::cut_links::CutHalfLinks;
use super::grid::LatticeGrid;
use super::stencil::{Q, VELOCITIES, opposite, reflected_direction};

/// Boundary condition of one face of the domain. Faces are numbered -x, +x, -y, +y, -z, +z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum FaceCondition {
    /// No slip: a wall half a cell outside, by halfway bounce-back. It moves tangentially with this velocity, cells per
    /// step.
    Wall([f64; 3]),
    /// Free slip, by specular reflection.
    Slip,
    /// Rough ground: free slip, with the wall stress of [`super::ground`].
    Rough,
    /// Periodic with the opposite face.
    Periodic,
    /// Inflow with a prescribed velocity.
    Inlet,
    /// Outflow at a density that lets sound waves leave.
    Outlet,
}

impl FaceCondition {
    pub(super) fn is_open(self) -> bool {
        matches!(self, Self::Inlet | Self::Outlet)
    }
}

/// Grid and solid cells of the box, links cut by surfaces, and the conditions at its six faces.
#[derive(Debug, Clone)]
pub(super) struct Domain {
    pub grid: LatticeGrid,
    pub faces: [FaceCondition; 6],
    /// Whether each cell is solid, x fastest.
    pub solid: Vec<bool>,
    /// Links cut by a surface, even one that contains no cell centre.
    pub cuts: CutHalfLinks,
}

/// Position, before the streaming, of a population that arrives at a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PopulationSource {
    /// At the upstream neighbour: plain streaming.
    Neighbour,
    /// It left `cell` in `direction`: bounce-back, specular reflection or a periodic face.
    Cell { direction: usize, cell: [usize; 3] },
    /// It left `cell` in `direction` and bounced back from a wall that moves with `velocity`, cells per step.
    MovingWall { direction: usize, cell: [usize; 3], velocity: [f64; 3] },
    /// It comes in `direction` from the ghost node at `position`, outside an open face.
    Ghost { direction: usize, position: [isize; 3] },
}

impl Domain {
    pub(super) fn is_solid(&self, cell: [usize; 3]) -> bool {
        self.solid[self.grid.cell_index(cell)]
    }

    /// The faces beyond which a node lies, at most one per axis.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn faces_outside_of(&self, node: [isize; 3]) -> [Option<usize>; 3] {
        std::array::from_fn(|a| match node[a] {
            p if p < 0 => Some(2 * a),
            p if p >= self.grid.n[a] as isize => Some(2 * a + 1),
            _ => None,
        })
    }

    /// The node as a cell, if it lies in the domain.
    #[allow(clippy::cast_sign_loss, reason = "not negative inside")]
    pub(super) fn node_as_cell(&self, node: [isize; 3]) -> Option<[usize; 3]> {
        self.faces_outside_of(node).iter().all(Option::is_none).then(|| node.map(|p| p as usize))
    }

    /// The node with its coordinates beyond periodic faces wrapped around.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn wrap_periodic(&self, mut node: [isize; 3]) -> [isize; 3] {
        for (a, face) in self.faces_outside_of(node).into_iter().enumerate() {
            if face.is_some_and(|f| self.faces[f] == FaceCondition::Periodic) {
                node[a] = node[a].rem_euclid(self.grid.n[a] as isize);
            }
        }
        node
    }

    /// Whether a surface cuts the link from a cell in direction `i`, to its neighbour or to the face before that.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn is_link_cut(&self, x: [usize; 3], i: usize) -> bool {
        let end = std::array::from_fn(|a| x[a] as isize + VELOCITIES[i][a] as isize);
        let far = self.node_as_cell(self.wrap_periodic(end)).map(|cell| self.grid.cell_index(cell));
        self.cuts.is_half_cut(self.grid.cell_index(x), i)
            || far.is_some_and(|far| self.cuts.is_half_cut(far, opposite(i)))
    }

    /// Source of the population that arrives at the fluid cell `x` in direction `i`. A surface that cuts its link takes
    /// precedence, then the conditions of faces in the order wall, periodic, slip, open. If the source is then still outside,
    /// solid or beyond a cut, the population bounces back.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn population_source(&self, x: [usize; 3], i: usize) -> PopulationSource {
        // Streaming: the population that arrives in direction i was at x - c_i. The node there determines the source.
        let upstream: [isize; 3] = std::array::from_fn(|a| x[a] as isize - VELOCITIES[i][a] as isize);
        let bounce_back = PopulationSource::Cell { direction: opposite(i), cell: x };
        // A surface cuts the link within the half that is nearer to x.
        if self.cuts.is_half_cut(self.grid.cell_index(x), opposite(i)) {
            return bounce_back;
        }
        let outside = self.faces_outside_of(upstream);
        // Walls: halfway bounce-back, with the momentum of a moving wall.
        let mut walls = outside.iter().flatten().filter_map(|f| match self.faces[*f] {
            FaceCondition::Wall(velocity) => Some(velocity),
            _ => None,
        });
        if let Some(velocity) = walls.next() {
            let moves = velocity.iter().any(|v| v.abs() > 0.0);
            // At an edge between a moving and a resting wall both count as resting, because otherwise mass would leak.
            let is_wall = |f: &&usize| matches!(self.faces[**f], FaceCondition::Wall(_));
            let alone = outside.iter().flatten().filter(is_wall).count() == 1;
            return if moves && alone {
                PopulationSource::MovingWall { direction: opposite(i), cell: x, velocity }
            } else {
                bounce_back
            };
        }
        // Periodic faces wrap the node; slip faces mirror direction and node.
        let mut node = self.wrap_periodic(upstream);
        let mut direction = i;
        for (a, face) in self.faces_outside_of(node).into_iter().enumerate() {
            if face.is_some_and(|f| matches!(self.faces[f], FaceCondition::Slip | FaceCondition::Rough)) {
                direction = reflected_direction(direction, a);
                node[a] = x[a] as isize;
            }
        }
        if self.faces_outside_of(node).iter().flatten().any(|f| self.faces[*f].is_open()) {
            return PopulationSource::Ghost { direction, position: node };
        }
        // Inside: plain streaming, or the mirrored or wrapped cell. If that is solid, halfway bounce-back applies: the wall lies
        // midway, and the population returns to the cell that it left, in the opposite direction. The same holds if the first
        // half of its link is cut.
        let is_free = |cell: [usize; 3]| {
            let c = self.grid.cell_index(cell);
            !self.solid[c] && !self.cuts.is_half_cut(c, direction)
        };
        match self.node_as_cell(node) {
            Some(cell) if is_free(cell) => {
                if direction == i && node == upstream {
                    PopulationSource::Neighbour
                } else {
                    PopulationSource::Cell { direction, cell }
                }
            }
            _ => bounce_back,
        }
    }

    /// Whether the upstream neighbour of a cell is solid, or the link from it cut; the cell must not lie at a face.
    pub(super) fn upstream_is_blocked(&self, x: [usize; 3], i: usize) -> bool {
        let upstream = std::array::from_fn(|a| x[a].wrapping_add_signed(-(VELOCITIES[i][a] as isize)));
        let [here, there] = [x, upstream].map(|cell| self.grid.cell_index(cell));
        self.solid[there] || self.cuts.is_half_cut(here, opposite(i)) || self.cuts.is_half_cut(there, i)
    }

    /// Whether a surface cuts a link between this air cell and another: the cell is next to a wall that may contain no cell.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn is_beside_cut_link(&self, x: [usize; 3]) -> bool {
        (1..Q).any(|i| {
            let end = std::array::from_fn(|a| x[a] as isize + VELOCITIES[i][a] as isize);
            let solid = self.node_as_cell(self.wrap_periodic(end)).is_some_and(|cell| self.is_solid(cell));
            !solid && self.is_link_cut(x, i)
        })
    }

    /// The cell of the domain nearest to a node outside: each coordinate is clamped.
    #[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "clamped to the domain")]
    pub(super) fn nearest_cell(&self, node: [isize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| node[a].clamp(0, self.grid.n[a] as isize - 1) as usize)
    }
}
