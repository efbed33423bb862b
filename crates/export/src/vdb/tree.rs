//! Active voxels by the leaves of a tree of the type 5_4_3: nodes of 32^3 children of 128^3 cells, of 16^3 leaves of 8^3 voxels.

use glam::Vec3;

use osier_base::par::par_map;
use osier_scene::{VolumeCells, VolumeFrame, VolumeValues};

/// Voxels of a leaf, 8 along each axis.
const LEAF_VOXELS: usize = 512;
/// Edge of a leaf in cells.
const LEAF_SIDE: usize = 8;
/// Values no farther than this from the background, 0, are inactive.
const INACTIVE: f32 = 1e-6;

/// Position of a leaf in the tree. The order is that of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct LeafKey {
    /// Lowest cell of the child of the root, multiples of 4096.
    pub root: [i32; 3],
    /// Number of the child of level 5, from 0 to 32767.
    pub child5: u32,
    /// Number of the child of level 4, from 0 to 4095.
    pub child4: u32,
}

impl LeafKey {
    /// The leaf of a cell, and the number of the voxel in it.
    fn of(cell: [i32; 3]) -> (Self, usize) {
        // Two's complement makes these masks the floors of divisions by 4096, 128 and 8 for negative cells too.
        let number = |shift: u32, bits: u32| {
            let [x, y, z] = cell.map(|c| (c.cast_unsigned() >> shift) & ((1 << bits) - 1));
            x << (2 * bits) | y << bits | z
        };
        (Self { root: cell.map(|c| c & !4095), child5: number(7, 5), child4: number(3, 4) }, number(0, 3) as usize)
    }
}

/// A leaf of the tree with its active voxels; inactive ones have the background value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Leaf {
    pub key: LeafKey,
    /// Bit n: whether voxel n is active.
    pub mask: [u8; LEAF_VOXELS / 8],
    /// Numbers of the active voxels, in the order of their bits; three for a vector.
    pub values: Vec<f32>,
}

impl Leaf {
    /// A leaf of some voxels, in the order of their numbers; `None` without any.
    fn of(key: LeafKey, voxels: impl Iterator<Item = (usize, Value)>) -> Option<Self> {
        let mut leaf = Self { key, mask: [0; LEAF_VOXELS / 8], values: Vec::new() };
        for (voxel, value) in voxels.filter(|(_, value)| value.is_active()) {
            leaf.mask[voxel / 8] |= 1 << (voxel % 8);
            match value {
                Value::Scalar(v) => leaf.values.push(v),
                Value::Vector(v) => leaf.values.extend(v.to_array()),
            }
        }
        (!leaf.values.is_empty()).then_some(leaf)
    }

    /// Numbers of all voxels: 0 for inactive ones.
    pub(super) fn all_values(&self, components: usize) -> Vec<f32> {
        // The list of values is packed: each value belongs to the voxel of the next set bit.
        let mut all = vec![0.0; LEAF_VOXELS * components];
        let active = (0..LEAF_VOXELS).filter(|n| self.mask[n / 8] >> (n % 8) & 1 == 1);
        for (slot, value) in active.zip(self.values.chunks_exact(components)) {
            all[slot * components..(slot + 1) * components].copy_from_slice(value);
        }
        all
    }
}

#[derive(Debug, Clone, Copy)]
enum Value {
    Scalar(f32),
    Vector(Vec3),
}

impl Value {
    fn at(values: &VolumeValues, i: usize) -> Self {
        match values {
            VolumeValues::Scalar(v) => Self::Scalar(v[i]),
            VolumeValues::Vector(v) => Self::Vector(v[i]),
        }
    }

    /// Whether it differs from the background. NaN counts as active, so that it is reported when it is written.
    fn is_active(self) -> bool {
        match self {
            Self::Scalar(v) => v.is_nan() || v.abs() > INACTIVE,
            Self::Vector(v) => v.is_nan() || v.abs().max_element() > INACTIVE,
        }
    }
}

/// The leaves of a volume in the order of the file.
pub(super) fn leaves(volume: &VolumeFrame) -> Vec<Leaf> {
    let mut leaves = match &volume.cells {
        VolumeCells::Box(size) => box_leaves(*size, &volume.values),
        VolumeCells::List(cells) => list_leaves(cells, &volume.values),
    };
    leaves.sort_unstable_by_key(|leaf| leaf.key);
    leaves
}

fn list_leaves(cells: &[[i32; 3]], values: &VolumeValues) -> Vec<Leaf> {
    // Sort by leaf and voxel, so that the cells of each leaf are adjacent.
    let located = cells.iter().enumerate().map(|(i, cell)| (LeafKey::of(*cell), i));
    let mut voxels: Vec<((LeafKey, usize), usize)> = located.collect();
    voxels.sort_unstable();
    let same_leaf = voxels.chunk_by(|a, b| a.0.0 == b.0.0);
    let leaf = |voxels: &[((LeafKey, usize), usize)]| {
        Leaf::of(voxels[0].0.0, voxels.iter().map(|((_, voxel), i)| (*voxel, Value::at(values, *i))))
    };
    same_leaf.filter_map(leaf).collect()
}

fn box_leaves(size: [usize; 3], values: &VolumeValues) -> Vec<Leaf> {
    // Blocks of 8 cells along each axis; those at the far sides reach beyond the box.
    let blocks = size.map(|n| n.div_ceil(LEAF_SIDE));
    let columns: Vec<[usize; 2]> = (0..blocks[0]).flat_map(|x| (0..blocks[1]).map(move |y| [x, y])).collect();
    let of_column = |column: &[usize; 2]| -> Vec<Leaf> {
        let leaf = |z: usize| {
            let low = [column[0], column[1], z].map(|n| n * LEAF_SIDE);
            // The limit on voxels keeps every side far below 2^31.
            let (key, _) = LeafKey::of(low.map(|n| i32::try_from(n).unwrap_or(i32::MAX)));
            let voxel = |n: usize| {
                let [x, y, z] = [low[0] + (n >> 6), low[1] + (n >> 3 & 7), low[2] + (n & 7)];
                let inside = x < size[0] && y < size[1] && z < size[2];
                inside.then(|| (n, Value::at(values, (z * size[1] + y) * size[0] + x)))
            };
            Leaf::of(key, (0..LEAF_VOXELS).filter_map(voxel))
        };
        (0..blocks[2]).filter_map(leaf).collect()
    };
    par_map(&columns, of_column).concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_cells_are_in_the_leaf_below_them() {
        let (key, voxel) = LeafKey::of([-1, 8, 4096]);
        assert_eq!((key.root, voxel), ([-4096, 0, 4096], 7 << 6));
        assert_eq!((key.child5, key.child4), (31 << 10, 15 << 8 | 1 << 4));
    }

    #[test]
    fn a_box_and_a_list_of_its_cells_have_the_same_leaves() {
        let size = [11, 3, 9];
        let value = |i: usize| if i.is_multiple_of(5) { 0.0 } else { i as f32 };
        let values = VolumeValues::Scalar((0..11 * 3 * 9).map(value).collect());
        let cell = |i: usize| [i % 11, i / 11 % 3, i / 33].map(|n| i32::try_from(n).expect("small"));
        let list = VolumeCells::List((0..11 * 3 * 9).map(cell).collect());
        let of = |cells| leaves(&VolumeFrame { cells, values: values.clone() });
        let found = of(VolumeCells::Box(size));
        assert_eq!(found, of(list));
        assert_eq!((found.len(), found.iter().map(|l| l.values.len()).sum::<usize>()), (4, 297 - 60));
        let all = found[0].all_values(1);
        assert_eq!((all[1], all[8], all[64]), (33.0, 11.0, 1.0));
    }
}
