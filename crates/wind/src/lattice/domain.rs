//! What stands where, and from where each population of a cell at a boundary comes.

use super::grid::Grid;
use super::stencil::{C, mirror, opposite};

/// What one face of the domain does. Faces: -x, +x, -y, +y, -z, +z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Face {
    /// A wall half a cell outside, that moves along itself with a velocity, cells a step.
    Wall([f64; 3]),
    /// Nothing passes, nothing drags.
    Slip,
    /// Nothing passes, and what drags is found in [`super::ground`]: rough ground.
    Rough,
    /// Joined with the face across.
    Periodic,
    /// Air comes in with a known velocity.
    Inlet,
    /// Air goes out.
    Outlet,
}

impl Face {
    pub(super) fn is_open(self) -> bool {
        matches!(self, Self::Inlet | Self::Outlet)
    }
}

/// Cells of the domain.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    pub grid: Grid,
    pub faces: [Face; 6],
    /// One for every cell, x fastest.
    pub solid: Vec<bool>,
}

/// Where the population that arrives along a velocity was before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Source {
    /// At the neighbour it comes from, as always.
    Neighbour,
    /// It left this cell along this velocity.
    Left(usize, [usize; 3]),
    /// It left this cell along this velocity and was struck by a wall that moves.
    Struck(usize, [usize; 3], [f64; 3]),
    /// It comes along this velocity from the place outside an open face.
    Ghost(usize, [isize; 3]),
}

impl Cells {
    pub(super) fn is_solid(&self, cell: [usize; 3]) -> bool {
        self.solid[self.grid.cell(cell)]
    }

    /// The faces that a place is beyond, at most one to an axis.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn beyond(&self, place: [isize; 3]) -> [Option<usize>; 3] {
        std::array::from_fn(|a| match place[a] {
            p if p < 0 => Some(2 * a),
            p if p >= self.grid.n[a] as isize => Some(2 * a + 1),
            _ => None,
        })
    }

    /// The place itself if it lies inside.
    #[allow(clippy::cast_sign_loss, reason = "not negative inside")]
    pub(super) fn inside(&self, place: [isize; 3]) -> Option<[usize; 3]> {
        self.beyond(place).iter().all(Option::is_none).then(|| place.map(|p| p as usize))
    }

    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn wrapped(&self, mut place: [isize; 3]) -> [isize; 3] {
        for (a, face) in self.beyond(place).into_iter().enumerate() {
            if face.is_some_and(|f| self.faces[f] == Face::Periodic) {
                place[a] = place[a].rem_euclid(self.grid.n[a] as isize);
            }
        }
        place
    }

    /// From where the population comes that arrives at the fluid cell `x` along `i`.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn source(&self, x: [usize; 3], i: usize) -> Source {
        let straight: [isize; 3] = std::array::from_fn(|a| x[a] as isize - C[i][a] as isize);
        let back = Source::Left(opposite(i), x);
        let outside = self.beyond(straight);
        let mut walls = outside.iter().flatten().filter_map(|f| match self.faces[*f] {
            Face::Wall(velocity) => Some(velocity),
            _ => None,
        });
        if let Some(velocity) = walls.next() {
            let moves = velocity.iter().any(|v| v.abs() > 0.0);
            // Where a wall that moves meets one that does not, both rest: else air would leak.
            let alone = outside.iter().flatten().filter(|f| matches!(self.faces[**f], Face::Wall(_))).count() == 1;
            return if moves && alone { Source::Struck(opposite(i), x, velocity) } else { back };
        }
        let mut place = self.wrapped(straight);
        let mut along = i;
        let beyond = self.beyond(place);
        for (a, face) in beyond.into_iter().enumerate() {
            if face.is_some_and(|f| matches!(self.faces[f], Face::Slip | Face::Rough)) {
                along = mirror(along, a);
                place[a] = x[a] as isize;
            }
        }
        if self.beyond(place).iter().flatten().any(|f| self.faces[*f].is_open()) {
            return Source::Ghost(along, place);
        }
        match self.inside(place) {
            Some(q) if !self.is_solid(q) => {
                if along == i && place == straight {
                    Source::Neighbour
                } else {
                    Source::Left(along, q)
                }
            }
            _ => back,
        }
    }

    /// Whether the cell from which a population comes is solid; the cell itself must not lie at a face.
    pub(super) fn beside(&self, x: [usize; 3], i: usize) -> bool {
        self.is_solid(std::array::from_fn(|a| x[a].wrapping_add_signed(-(C[i][a] as isize))))
    }
}
