//! Vectors, rotations and columns of numbers in the SIMD lanes of `osier_base::simd`: several branches at once.
//!
//! No product and sum are fused, so that the bits of a lane do not depend on the instruction set. Functions on lanes are
//! `inline(always)` and hold no closures, which would not be compiled with the instructions of the dispatch.

use std::ops::{Add, Mul, RangeInclusive, Sub};

use osier_base::simd::{F64Lanes, Lane as _};
use pulp::Simd;

/// Number of rows to a multiple of which columns are padded: the `f64` numbers in the widest SIMD register of any target.
const WIDEST: usize = 8;

/// One vector for each SIMD lane, component by component.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Vec3Lanes<S: Simd>(pub(crate) [F64Lanes<S>; 3]);

impl<S: Simd> Vec3Lanes<S> {
    #[inline(always)]
    pub(crate) fn dot(self, o: Self) -> F64Lanes<S> {
        self.0[0] * o.0[0] + self.0[1] * o.0[1] + self.0[2] * o.0[2]
    }

    #[inline(always)]
    pub(crate) fn length(self) -> F64Lanes<S> {
        self.dot(self).sqrt()
    }

    #[inline(always)]
    pub(crate) fn cross(self, o: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, o.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }
}

impl<S: Simd> Add for Vec3Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self([self.0[0] + o.0[0], self.0[1] + o.0[1], self.0[2] + o.0[2]])
    }
}

impl<S: Simd> Sub for Vec3Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self([self.0[0] - o.0[0], self.0[1] - o.0[1], self.0[2] - o.0[2]])
    }
}

impl<S: Simd> Mul<F64Lanes<S>> for Vec3Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, k: F64Lanes<S>) -> Self {
        Self([self.0[0] * k, self.0[1] * k, self.0[2] * k])
    }
}

/// One rotation matrix per SIMD lane, by rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RotationLanes<S: Simd>([Vec3Lanes<S>; 3]);

impl<S: Simd> RotationLanes<S> {
    /// Rotation matrices of unit quaternions (x, y, z, w).
    #[inline(always)]
    pub(crate) fn from_quaternion([x, y, z, w]: [F64Lanes<S>; 4]) -> Self {
        // The standard matrix of a unit quaternion, with doubled components shared between entries.
        let one = F64Lanes::from_scalar(x.simd, 1.0);
        let (x2, y2, z2) = (x + x, y + y, z + z);
        let (xx, yy, zz) = (x * x2, y * y2, z * z2);
        let (xy, xz, yz) = (x * y2, x * z2, y * z2);
        let (wx, wy, wz) = (w * x2, w * y2, w * z2);
        Self([
            Vec3Lanes([one - (yy + zz), xy - wz, xz + wy]),
            Vec3Lanes([xy + wz, one - (xx + zz), yz - wx]),
            Vec3Lanes([xz - wy, yz + wx, one - (xx + yy)]),
        ])
    }

    #[inline(always)]
    pub(crate) fn apply(&self, v: Vec3Lanes<S>) -> Vec3Lanes<S> {
        Vec3Lanes([self.0[0].dot(v), self.0[1].dot(v), self.0[2].dot(v)])
    }

    #[inline(always)]
    pub(crate) fn apply_inverse(&self, v: Vec3Lanes<S>) -> Vec3Lanes<S> {
        // The product with the transposed matrix: the sum of the rows, weighted by the components of v.
        let [a, b, c] = self.0;
        a * v.0[0] + b * v.0[1] + c * v.0[2]
    }
}

/// Table of `K` columns, padded with zero rows, in blocks: [`WIDEST`] rows lie together, column after column.
#[derive(Debug, Clone)]
pub(crate) struct Columns<const K: usize>(Vec<f64>);

impl<const K: usize> Columns<K> {
    /// A table of `rows` zero rows, and padding up to a multiple of [`WIDEST`].
    pub(crate) fn new(rows: usize) -> Self {
        Self(vec![0.0; padded_row_count(rows) * K])
    }

    pub(crate) fn clear(&mut self) {
        self.0.fill(0.0);
    }

    /// Number of rows, padding included.
    pub(crate) fn rows(&self) -> usize {
        self.0.len() / K
    }

    /// Range of indices that begins with the first element of a row and ends with its last one.
    #[inline(always)]
    fn span(row: usize) -> RangeInclusive<usize> {
        // Blocks of WIDEST rows; within a block the columns follow each other, so that one register holds one column
        // of several rows.
        let first = row / WIDEST * K * WIDEST + row % WIDEST;
        first..=first + (K - 1) * WIDEST
    }

    #[inline(always)]
    pub(crate) fn row(&self, i: usize) -> [f64; K] {
        let all = &self.0[Self::span(i)];
        std::array::from_fn(|k| all[k * WIDEST])
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, i: usize, row: [f64; K]) {
        let all = &mut self.0[Self::span(i)];
        for k in 0..K {
            all[k * WIDEST] = row[k];
        }
    }

    #[inline(always)]
    pub(crate) fn add(&mut self, i: usize, row: [f64; K]) {
        let all = &mut self.0[Self::span(i)];
        for k in 0..K {
            all[k * WIDEST] += row[k];
        }
    }

    /// Index of the first register of a group of rows, and number of registers from one column to the next.
    #[inline(always)]
    fn lane_group<S: Simd>(group: usize) -> (usize, usize) {
        // A block has `parts` registers per column; the columns of one group are `parts` registers apart.
        let parts = WIDEST / S::F64_LANES;
        (group / parts * K * parts + group % parts, parts)
    }

    /// Loads a group of as many rows as there are lanes.
    #[inline(always)]
    pub(crate) fn get<S: Simd>(&self, simd: S, group: usize) -> [F64Lanes<S>; K] {
        let (first, apart) = Self::lane_group::<S>(group);
        let all = &S::as_simd_f64s(&self.0).0[first..=first + (K - 1) * apart];
        let mut row = [F64Lanes::new(simd, all[0]); K];
        for k in 1..K {
            row[k].value = all[k * apart];
        }
        row
    }

    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, group: usize, row: [F64Lanes<S>; K]) {
        let (first, apart) = Self::lane_group::<S>(group);
        let all = &mut S::as_mut_simd_f64s(&mut self.0).0[first..=first + (K - 1) * apart];
        for k in 0..K {
            all[k * apart] = row[k].value;
        }
    }
}

/// Smallest row count of at least `rows` that is a multiple of all lane counts.
pub(crate) fn padded_row_count(rows: usize) -> usize {
    rows.next_multiple_of(WIDEST)
}
