//! Neighbour search among points: a sparse uniform grid as one sorted array.

use glam::{IVec3, Vec3};

/// Indices of points, sorted by the cubic cell that holds the point. Building takes O(n log n), a query a binary search per row
/// of cells along z. Results of a query come in the order of the cells, not of distance.
/// # Examples
/// ```
/// use glam::Vec3;
/// use osier_base::neighbours::NeighbourGrid;
///
/// let points = [Vec3::ZERO, Vec3::X * 0.3, Vec3::X * 5.0];
/// let grid = NeighbourGrid::new(0.5, (0..).zip(points));
/// let mut found = Vec::new();
/// grid.for_each_in_box(Vec3::splat(-0.4), Vec3::splat(0.4), |i| found.push(i));
/// assert!(found.contains(&0) && found.contains(&1) && !found.contains(&2));
/// ```
#[derive(Debug, Clone, Default)]
pub struct NeighbourGrid {
    /// Edge length of a cubic cell, in the unit of the points.
    edge: f32,
    /// Key of the cell and index of the point, sorted.
    entries: Vec<(u64, u32)>,
}

/// Cells along an axis that a key can distinguish, on either side of the origin: 21 bits an axis. Farther cells share the
/// outermost key, which costs time in queries there and no result.
const MAX_CELL: i32 = 1 << 20;

/// The coordinates of a cell as one integer, x first, so that the cells of a row along z have consecutive keys.
fn key(cell: IVec3) -> u64 {
    let bits = |v: i32| u64::from((v.clamp(-MAX_CELL, MAX_CELL - 1) + MAX_CELL).cast_unsigned());
    (bits(cell.x) << 42) | (bits(cell.y) << 21) | bits(cell.z)
}

impl NeighbourGrid {
    /// `edge`: edge length of a cell, > 0, about the radius of the queries; `points`: index and position of each point, in any unit.
    pub fn new(edge: f32, points: impl Iterator<Item = (u32, Vec3)>) -> Self {
        let mut grid = Self { edge, entries: Vec::new() };
        grid.entries = points.map(|(id, p)| (key(grid.cell(p)), id)).collect();
        grid.entries.sort_unstable();
        grid
    }

    /// True for a grid of no points, such as the default: every query then finds nothing.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    fn cell(&self, p: Vec3) -> IVec3 {
        (p / self.edge).floor().as_ivec3()
    }

    /// Calls `visit` with the index of every point in the cells that a box touches: all points in the box, and some within a cell
    /// of it.
    pub fn for_each_in_box(&self, low: Vec3, high: Vec3, mut visit: impl FnMut(u32)) {
        // Cells beyond the outermost ones share their keys: each key is visited once.
        let bounded = |p: Vec3| self.cell(p).clamp(IVec3::splat(-MAX_CELL), IVec3::splat(MAX_CELL - 1));
        let (a, b) = (bounded(low), bounded(high));
        for x in a.x..=b.x {
            for y in a.y..=b.y {
                // The cells of a row along z are consecutive in the sorted array.
                let (first, last) = (key(IVec3::new(x, y, a.z)), key(IVec3::new(x, y, b.z)));
                let start = self.entries.partition_point(|(k, _)| *k < first);
                self.entries[start..].iter().take_while(|(k, _)| *k <= last).for_each(|(_, id)| visit(*id));
            }
        }
    }

    /// The point nearest to `at`, of equally near ones that of the lowest index. The box searched doubles until its half side is
    /// at least `reach`, so the point may lie somewhat farther than `reach`; `None` if that box is empty. `position`: maps the
    /// index of a point to its position, in the unit of the grid.
    pub fn nearest(&self, at: Vec3, reach: f32, position: impl Fn(u32) -> Vec3) -> Option<u32> {
        if self.is_empty() {
            return None;
        }
        let mut radius = self.edge;
        loop {
            let mut best: Option<(f32, u32)> = None;
            self.for_each_in_box(at - Vec3::splat(radius), at + Vec3::splat(radius), |i| {
                let found = (position(i).distance_squared(at), i);
                if best.is_none_or(|b| found.0.total_cmp(&b.0).then(found.1.cmp(&b.1)).is_lt()) {
                    best = Some(found);
                }
            });
            // The box holds the whole ball of its radius: a point in the ball is the nearest of all.
            let in_ball = best.is_some_and(|(d, _)| d <= radius * radius);
            if in_ball || radius >= reach {
                return best.map(|(_, i)| i);
            }
            radius *= 2.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_query_visits_all_points_in_the_box() {
        let points: Vec<Vec3> = (0..500_u16)
            .map(|i| {
                let f = f32::from(i);
                Vec3::new((f * 0.37) % 5.0 - 2.5, (f * 0.71) % 4.0, (f * 0.13) % 6.0 - 3.0)
            })
            .collect();
        let grid = NeighbourGrid::new(0.5, (0..).zip(points.iter().copied()));
        let (low, high) = (Vec3::new(-1.0, 0.7, -2.0), Vec3::new(0.6, 1.9, 1.1));
        let mut found = Vec::new();
        grid.for_each_in_box(low, high, |i| found.push(i));
        found.sort_unstable();
        let inside = |p: &Vec3| p.cmpge(low).all() && p.cmple(high).all();
        let wanted: Vec<u32> = (0..).zip(&points).filter(|(_, p)| inside(p)).map(|(i, _)| i).collect();
        assert!(wanted.len() > 20 && wanted.iter().all(|w| found.binary_search(w).is_ok()));
        assert!(found.iter().all(|i| {
            let p = points[*i as usize];
            p.cmpge(low - Vec3::splat(0.5)).all() && p.cmple(high + Vec3::splat(0.5)).all()
        }));
    }

    #[test]
    fn far_points_are_visited_once() {
        // Cells of 1 m: those beyond 2^20 m share the outermost.
        let points = [Vec3::new(2e6, 2e6, 0.0), Vec3::new(2e6 + 4.0, 2e6, 0.0)];
        let grid = NeighbourGrid::new(1.0, (0..).zip(points));
        let mut found = Vec::new();
        grid.for_each_in_box(Vec3::new(2e6 - 1.0, 2e6 - 1.0, -1.0), Vec3::new(2e6 + 5.0, 2e6 + 1.0, 1.0), |i| {
            found.push(i)
        });
        assert_eq!(found, [0, 1]);
    }

    #[test]
    fn the_nearest_point_is_that_of_a_search_of_all() {
        let point = |i: u32| {
            let f = crate::math::narrow(f64::from(i));
            Vec3::new((f * 0.37) % 5.0, (f * 0.71) % 4.0, (f * 0.13) % 6.0)
        };
        let grid = NeighbourGrid::new(0.2, (0..300).map(|i| (i, point(i))));
        for k in 0..60 {
            let at = point(k * 7 + 3) + Vec3::new(0.11, -0.23, 0.31);
            let wanted =
                (0..300).min_by(|a, b| point(*a).distance_squared(at).total_cmp(&point(*b).distance_squared(at)));
            assert_eq!(grid.nearest(at, 10.0, point), wanted);
        }
        assert_eq!(grid.nearest(Vec3::splat(100.0), 1.0, point), None);
    }
}
