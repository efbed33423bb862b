//! Sparse uniform grid of points for lookup by location.

use glam::{IVec3, Vec3};

/// Indices of points, sorted by the cell that they are in.
#[derive(Debug, Clone, Default)]
pub(super) struct CellGrid {
    size: f32,
    /// Cell key and index, sorted.
    all: Vec<(u64, u32)>,
}

/// Cells along an axis that a key distinguishes, half of them negative.
const REACH: i32 = 1 << 20;

fn cell_key(cube: IVec3) -> u64 {
    let part = |v: i32| u64::from((v.clamp(-REACH, REACH - 1) + REACH).cast_unsigned());
    (part(cube.x) << 42) | (part(cube.y) << 21) | part(cube.z)
}

impl CellGrid {
    /// `size`: cell size, m, > 0. `places`: index and position, m, of each point.
    pub fn new(size: f32, places: impl Iterator<Item = (u32, Vec3)>) -> Self {
        let mut grid = Self { size, all: Vec::new() };
        grid.all = places.map(|(id, p)| (cell_key(grid.cell_of(p)), id)).collect();
        grid.all.sort_unstable();
        grid
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    fn cell_of(&self, p: Vec3) -> IVec3 {
        (p / self.size).floor().as_ivec3()
    }

    /// Calls `take` with the index of every point in the cells that a box touches.
    pub fn for_each_in_box(&self, low: Vec3, high: Vec3, mut take: impl FnMut(u32)) {
        let (a, b) = (self.cell_of(low), self.cell_of(high));
        for x in a.x..=b.x {
            for y in a.y..=b.y {
                // Cells of one row have consecutive keys: one binary search per row.
                let (first, last) = (cell_key(IVec3::new(x, y, a.z)), cell_key(IVec3::new(x, y, b.z)));
                let start = self.all.partition_point(|(k, _)| *k < first);
                self.all[start..].iter().take_while(|(k, _)| *k <= last).for_each(|(_, id)| take(*id));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_query_returns_the_points_in_it() {
        let places: Vec<Vec3> = (0..500_u16)
            .map(|i| {
                let f = f32::from(i);
                Vec3::new((f * 0.37) % 5.0 - 2.5, (f * 0.71) % 4.0, (f * 0.13) % 6.0 - 3.0)
            })
            .collect();
        let grid = CellGrid::new(0.5, (0..).zip(places.iter().copied()));
        let (low, high) = (Vec3::new(-1.0, 0.7, -2.0), Vec3::new(0.6, 1.9, 1.1));
        let mut found = Vec::new();
        grid.for_each_in_box(low, high, |i| found.push(i));
        found.sort_unstable();
        let inside = |p: &Vec3| p.cmpge(low).all() && p.cmple(high).all();
        let wanted: Vec<u32> = (0..).zip(&places).filter(|(_, p)| inside(p)).map(|(i, _)| i).collect();
        assert!(wanted.len() > 20 && wanted.iter().all(|w| found.binary_search(w).is_ok()));
        assert!(found.iter().all(|i| {
            let p = places[*i as usize];
            p.cmpge(low - Vec3::splat(0.5)).all() && p.cmple(high + Vec3::splat(0.5)).all()
        }));
    }
}
