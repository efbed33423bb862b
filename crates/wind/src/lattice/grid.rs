//! Memory layout of the populations: one copy, updated in place by the AA pattern (Bailey, Myre, Walsh, Lilja, Saar 2009).
//!
//! One array per direction. Node (x, y, z), the halo layers -1 and n around the domain included, is element
//! x + 1 + (n_x + 2)(y + 1) + s_z (z + 1) of each array, plus a constant that puts the first cell of every plane at the
//! start of a cache line. Slot (k, x) is element x of array k. Rows follow each other without gaps: a step runs through a
//! plane as through one long row and computes the halo nodes between rows along with it. Their contents are meaningless;
//! boundary exchange writes what a cell reads from there before it reads ([`super::exchange`]).
//!
//! ```text
//!             before the step: arriving at x        after it: leaving x
//! even step   slot (i, x)                      ->   slot (opp i, x)          collision within the node
//! odd step    slot (opp i, x - c_i)            ->   slot (i, x + c_i)        collision and two streamings
//! ```
//!
//! The output of each is the input of the other, and either step writes exactly the slots that it reads: nodes can be updated in
//! any order, by several threads, without a second copy.

use super::stencil::{Q, VELOCITIES, opposite};
use osier_base::Result;

/// Nodes per block: the widest SIMD register, and one cache line of `f32`. Planes are computed in whole blocks.
pub(super) const BLOCK: usize = 16;
/// Offset within a page, in elements, between the starts of successive arrays. Without this skew the fifteen streams of a step
/// map to the same cache sets and evict each other.
const ARRAY_SKEW: usize = 5 * BLOCK;
/// Elements of a 4 KiB page.
const PAGE_ELEMENTS: usize = 1024;

/// Extents and strides of the population arrays, in elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LatticeGrid {
    /// Cells along x, y, z.
    pub n: [usize; 3],
    /// Distance of successive rows, elements.
    pub row_stride: usize,
    /// Distance of successive planes of constant z, elements.
    pub plane_stride: usize,
    /// Offset of a plane's first cell within the plane.
    pub first_cell: usize,
    /// Distance of successive arrays, elements.
    pub array_stride: usize,
}

/// The half of the AA pattern that comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StepParity {
    /// Populations lie at the node at which they arrive.
    Even,
    /// Populations lie at the node that they left, in the slot of the opposite direction.
    Odd,
}

impl StepParity {
    pub(super) fn from_step(step: u64) -> Self {
        if step.is_multiple_of(2) { Self::Even } else { Self::Odd }
    }
}

/// Row stride, plane stride, and offset of the first cell of a plane of `[x, y]` cells.
fn plane_layout([x, y]: [usize; 2]) -> [usize; 3] {
    // One halo node on either side of a row; `first` leaves room for the halo row and its halo node before it, on a
    // block boundary.
    let row = x + 2;
    let first = (row + 1).next_multiple_of(BLOCK);
    // Halo slots of an odd step lie a row and an element beyond the last row; the last block of a plane may overrun it.
    let plane = (first - row - 1 + row * (y + 2) + BLOCK).next_multiple_of(BLOCK);
    [row, plane, first]
}

impl LatticeGrid {
    pub(super) fn new(n: [usize; 3]) -> Self {
        let [row, plane, first] = plane_layout([n[0], n[1]]);
        Self {
            n,
            row_stride: row,
            plane_stride: plane,
            first_cell: first,
            // Whole pages, plus the skew that spreads the arrays over the cache sets.
            array_stride: (plane * (n[2] + 2)).next_multiple_of(PAGE_ELEMENTS) + ARRAY_SKEW,
        }
    }

    /// Bytes of the populations of `n` cells along each axis.
    pub(super) fn population_bytes(n: [usize; 3]) -> u64 {
        let [_, plane, _] = plane_layout([n[0], n[1]]);
        4 * Q as u64 * ((plane as u64 * (n[2] as u64 + 2)).next_multiple_of(PAGE_ELEMENTS as u64) + ARRAY_SKEW as u64)
    }

    pub(super) fn cell_count(&self) -> usize {
        self.n.iter().product()
    }

    /// Index of a cell of the domain, x fastest.
    pub(super) fn cell_index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.n[0] * (y + self.n[1] * z)
    }

    /// Element of a node in every array; coordinates range from -1 to n.
    #[allow(clippy::cast_sign_loss, clippy::cast_possible_wrap, reason = "from -1 on, below the sizes")]
    pub(super) fn node_element(&self, [x, y, z]: [isize; 3]) -> usize {
        // Element of the node (-1, -1, -1), from which rows and planes follow at constant strides.
        let before_halo = self.first_cell - self.row_stride - 1;
        before_halo + (x + 1) as usize + self.row_stride * (y + 1) as usize + self.plane_stride * (z + 1) as usize
    }

    /// Offset from a node to its neighbour in direction `i`, elements.
    #[allow(clippy::cast_possible_wrap, reason = "sizes fit")]
    pub(super) fn velocity_offset(&self, i: usize) -> isize {
        let c = VELOCITIES[i].map(|c| c as isize);
        c[0] + c[1] * self.row_stride as isize + c[2] * self.plane_stride as isize
    }

    /// Array and element of the population that left node `e` in direction `i` in the step before, when the next step has
    /// parity `next`: slot (opp i, x) or slot (i, x + c_i).
    pub(super) fn outgoing_slot_of(&self, next: StepParity, i: usize, e: usize) -> (usize, usize) {
        match next {
            StepParity::Odd => (opposite(i), e),
            StepParity::Even => (i, e.wrapping_add_signed(self.velocity_offset(i))),
        }
    }

    /// Elements of a plane from its first cell to its last.
    pub(super) fn plane_span(&self) -> usize {
        self.row_stride * (self.n[1] - 1) + self.n[0]
    }

    /// Offset from a node to the slot of array `k` that a step of this parity reads and writes for it.
    pub(super) fn slot_offset(&self, parity: StepParity, k: usize) -> isize {
        if parity == StepParity::Odd { self.velocity_offset(k) } else { 0 }
    }

    /// By direction: the slot from which a step of this parity reads the population that arrives at a node.
    pub(super) fn incoming_slots(&self, parity: StepParity) -> DirectionSlots {
        // AA pattern: an even step reads population i from array i of the node; an odd step reads it from the opposite array, one
        // node upstream.
        std::array::from_fn(|i| {
            let array = if parity == StepParity::Odd { opposite(i) } else { i };
            Slot { array, offset: self.slot_offset(parity, array) }
        })
    }

    /// By direction: the slot to which a step of this parity writes the population that leaves a node.
    pub(super) fn outgoing_slots(&self, parity: StepParity) -> DirectionSlots {
        // The converse of reading: an even step writes population i to the opposite array, an odd step writes it one node
        // downstream.
        std::array::from_fn(|i| {
            let array = if parity == StepParity::Odd { i } else { opposite(i) };
            Slot { array, offset: self.slot_offset(parity, array) }
        })
    }
}

/// Position of a population: the array, and the offset from the node's element.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slot {
    pub array: usize,
    pub offset: isize,
}

pub(super) type DirectionSlots = [Slot; Q];

/// The populations of all nodes, as deviations f_i - w_i from air at rest, which is all zero.
pub(super) struct Populations {
    grid: LatticeGrid,
    memory: PopulationMemory,
}

#[cfg(target_os = "linux")]
type PopulationMemory = memmap2::MmapMut;
#[cfg(not(target_os = "linux"))]
type PopulationMemory = Vec<CacheLine>;

impl std::fmt::Debug for Populations {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Populations").field("grid", &self.grid).finish_non_exhaustive()
    }
}

/// Zeroed memory of `elements` `f32`. Anonymous pages are zero already, and huge pages make the step a fifth faster.
#[cfg(target_os = "linux")]
fn allocate_zeroed(elements: usize) -> Result<PopulationMemory> {
    let out_of_memory = |e| osier_base::Error::io("allocate memory for", "the lattice wind", e);
    let memory = memmap2::MmapMut::map_anon(elements * 4).map_err(out_of_memory)?;
    // This is only advice; a system without huge pages refuses it.
    let _ = memory.advise(memmap2::Advice::HugePage);
    Ok(memory)
}

/// One cache line of `f32`: aligns arrays that the global allocator provides.
#[cfg(not(target_os = "linux"))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct CacheLine([f32; BLOCK]);

#[cfg(not(target_os = "linux"))]
fn allocate_zeroed(elements: usize) -> Result<PopulationMemory> {
    Ok(vec![bytemuck::Zeroable::zeroed(); elements.div_ceil(BLOCK)])
}

impl Populations {
    /// Air at rest.
    /// # Errors
    /// `Io` if the system cannot provide the memory.
    pub(super) fn new(grid: LatticeGrid) -> Result<Self> {
        Ok(Self { grid, memory: allocate_zeroed(grid.array_stride * Q)? })
    }

    /// The arrays, one per direction.
    pub(super) fn arrays(&self) -> [&[f32]; Q] {
        let all: &[f32] = bytemuck::cast_slice(&self.memory[..]);
        std::array::from_fn(|k| &all[k * self.grid.array_stride..(k + 1) * self.grid.array_stride])
    }

    /// As [`Self::arrays`], mutable: [`Q`] arrays of `array_stride` elements.
    pub(super) fn arrays_mut(&mut self) -> Vec<&mut [f32]> {
        let all: &mut [f32] = bytemuck::cast_slice_mut(&mut self.memory[..]);
        all.chunks_exact_mut(self.grid.array_stride).take(Q).collect()
    }
}
