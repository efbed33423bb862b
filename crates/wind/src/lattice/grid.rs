//! Where populations lie in memory: one copy, changed in place.
//!
//! One array per velocity. Node (x, y, z), the layers -1 and n around the domain included, is element
//! x + 1 + (n_x + 2)(y + 1) + s_z (z + 1) of each, and some more, so that the first cell of a plane begins a line of the
//! cache. Slot (k, x) is array k at node x. Rows follow each other without gaps: a step runs through a plane as through one
//! long row, and computes the nodes around the domain along with it. What these hold is nobody's: boundaries put what a
//! cell reads there before it does, or hand it over as it is read.
//!
//! Before an even step slot (i, x) holds the population that arrives at x; after it, and before an odd one, slot
//! (opp i, x) holds what left x. An odd step gathers from slot (opp i, x - c_i) and leaves its results in slot (i, x + c_i),
//! where they arrive. Either step writes exactly the slots it read.

use super::stencil::{C, Q, opposite};

/// Nodes that are computed together.
pub(super) const BLOCK: usize = 16;
/// Arrays begin so many elements after a page of [`PAGE`] elements more than the one before: else the fifteen streams of a
/// step would fall on the same lines of the cache.
const APART: usize = 5 * BLOCK;
const PAGE: usize = 1024;

/// Sizes of the arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Grid {
    /// Cells along x, y, z.
    pub n: [usize; 3],
    /// Elements of a row.
    pub row: usize,
    /// Elements of a plane of constant z.
    pub plane: usize,
    /// Element of a plane that is its first cell.
    pub first: usize,
    /// Elements of an array.
    pub array: usize,
}

/// What the next step is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Parity {
    /// Arriving populations lie at their node.
    Even,
    /// Populations lie where they left.
    Odd,
}

impl Parity {
    pub(super) fn of(step: u64) -> Self {
        if step.is_multiple_of(2) { Self::Even } else { Self::Odd }
    }
}

/// Elements of a row, of a plane, and to its first cell.
fn sizes([x, y]: [usize; 2]) -> [usize; 3] {
    let row = x + 2;
    let first = (row + 1).next_multiple_of(BLOCK);
    // Boundaries of an odd step lie a row and an element further; the last block of a plane may run over.
    let plane = (first - row - 1 + row * (y + 2) + BLOCK).next_multiple_of(BLOCK);
    [row, plane, first]
}

impl Grid {
    pub(super) fn new(n: [usize; 3]) -> Self {
        let [row, plane, first] = sizes([n[0], n[1]]);
        Self { n, row, plane, first, array: (plane * (n[2] + 2)).next_multiple_of(PAGE) + APART }
    }

    /// Bytes of the populations of so many cells, before a grid of them is made.
    pub(super) fn bytes(n: [usize; 3]) -> u64 {
        let [_, plane, _] = sizes([n[0], n[1]]);
        4 * Q as u64 * ((plane as u64 * (n[2] as u64 + 2)).next_multiple_of(PAGE as u64) + APART as u64)
    }

    pub(super) fn cells(&self) -> usize {
        self.n.iter().product()
    }

    /// Number of a cell inside, x fastest.
    pub(super) fn cell(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.n[0] * (y + self.n[1] * z)
    }

    /// Element of a node in its array; the layers around the domain are -1 and n.
    #[allow(clippy::cast_sign_loss, clippy::cast_possible_wrap, reason = "from -1 on, below the sizes")]
    pub(super) fn element(&self, [x, y, z]: [isize; 3]) -> usize {
        let gap = self.first - self.row - 1;
        gap + (x + 1) as usize + self.row * (y + 1) as usize + self.plane * (z + 1) as usize
    }

    /// Elements from a node to the one a velocity leads to.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn shift(&self, i: usize) -> isize {
        let c = C[i].map(|c| c as isize);
        c[0] + c[1] * self.row as isize + c[2] * self.plane as isize
    }

    /// Array and element of what left node `e` along `i` in the step before: slot (opp i, x) or slot (i, x + c_i).
    pub(super) fn left(&self, parity: Parity, i: usize, e: usize) -> (usize, usize) {
        match parity {
            Parity::Odd => (opposite(i), e),
            Parity::Even => (i, e.wrapping_add_signed(self.shift(i))),
        }
    }
}

/// The populations themselves, less their weights; all zero is air at rest.
pub(super) struct Populations {
    grid: Grid,
    memory: Memory,
}

#[cfg(target_os = "linux")]
type Memory = memmap2::MmapMut;
#[cfg(not(target_os = "linux"))]
type Memory = Vec<Line>;

impl std::fmt::Debug for Populations {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Populations").field("grid", &self.grid).finish_non_exhaustive()
    }
}

/// Fresh memory from the system is zero, and on large pages, if it has them, a fifth faster.
#[cfg(target_os = "linux")]
fn zeroed(elements: usize) -> osier_base::Result<Memory> {
    let refused = |e| osier_base::Error::io("find memory for", "the lattice wind", e);
    let memory = memmap2::MmapMut::map_anon(elements * 4).map_err(refused)?;
    // Advice may be refused; then pages are small.
    let _ = memory.advise(memmap2::Advice::HugePage);
    Ok(memory)
}

/// A line of the cache.
#[cfg(not(target_os = "linux"))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct Line([f32; BLOCK]);

#[cfg(not(target_os = "linux"))]
fn zeroed(elements: usize) -> osier_base::Result<Memory> {
    Ok(vec![bytemuck::Zeroable::zeroed(); elements.div_ceil(BLOCK)])
}

impl Populations {
    /// Air at rest.
    /// # Errors
    /// `Io` if the system has no such memory.
    pub(super) fn new(grid: Grid) -> osier_base::Result<Self> {
        Ok(Self { grid, memory: zeroed(grid.array * Q)? })
    }

    /// Every array.
    pub(super) fn arrays(&self) -> [&[f32]; Q] {
        let all: &[f32] = bytemuck::cast_slice(&self.memory[..]);
        std::array::from_fn(|k| &all[k * self.grid.array..(k + 1) * self.grid.array])
    }

    /// Every array, to be written.
    pub(super) fn arrays_mut(&mut self) -> Vec<&mut [f32]> {
        let all: &mut [f32] = bytemuck::cast_slice_mut(&mut self.memory[..]);
        all.chunks_exact_mut(self.grid.array).take(Q).collect()
    }
}
