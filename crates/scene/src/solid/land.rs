//! Height fields as solids.

use std::ops::RangeInclusive;

use glam::{Vec2, Vec3};

use super::Nearest;
use osier_base::geometry::Bounds;

/// Along which diagonal the square cells of a land are divided into two triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellDiagonal {
    /// From -x -z to +x +z.
    Main,
    /// The diagonal with the smaller height difference, which follows ridges and valleys better than a fixed one; from +x -z to
    /// -x +z if both differences are equal. The mesh of a terrain is divided in the same way.
    SmallerDifference,
}

impl CellDiagonal {
    /// Whether a cell is divided from -x -z to +x +z. Heights of its corners, m: at -x -z, +x -z, -x +z, +x +z.
    #[inline]
    pub fn is_main(self, [a, b, c, d]: [f32; 4]) -> bool {
        match self {
            Self::Main => true,
            Self::SmallerDifference => (a - d).abs() < (b - c).abs(),
        }
    }
}

/// Heights on a grid of square cells over a rectangle, from which [`LandForm::over`] makes a solid.
#[derive(Debug, Clone, PartialEq)]
pub struct LandGrid {
    /// Number of heights along x and along z, each at least 2.
    pub counts: [usize; 2],
    /// Length of the rectangle along x, m, > 0; that along z follows from the counts.
    pub width: f32,
    /// Centre of the rectangle in the world, x and z, m.
    pub center: Vec2,
    /// Heights, m: rows from -z to +z, in each from -x to +x.
    pub heights: Vec<f32>,
    /// How the cells are divided.
    pub diagonal: CellDiagonal,
}

/// A height field as a solid: two triangles for each square cell. Outside of the rectangle the height is that of the nearest
/// point of its edge.
#[derive(Debug, Clone, PartialEq)]
pub struct LandForm {
    columns: usize,
    rows: usize,
    /// Edge of a square cell of the height field, m.
    step: f32,
    /// Corner with the smallest x and z, m.
    corner: Vec2,
    /// Column and row at x = 0 and z = 0, in cells.
    origin: Vec2,
    heights: Vec<f32>,
    diagonal: CellDiagonal,
    bounds: Bounds,
    /// Cosine of the angle of the steepest slope. Its product with the vertical distance to the surface is a lower bound of the
    /// shortest distance.
    flattest: f32,
}

impl LandForm {
    /// Heights over a square around the origin. `heights`: `side * side`, m, rows from -z to +z, in each from -x to +x;
    /// `size`: length of a side, m. `None` where [`LandForm::over`] returns it.
    pub fn new(side: usize, size: f32, heights: Vec<f32>) -> Option<Self> {
        let diagonal = CellDiagonal::Main;
        Self::over(LandGrid { counts: [side; 2], width: size, center: Vec2::ZERO, heights, diagonal })
    }

    /// Heights over a rectangle. `None` for fewer than two rows or columns, for another number of heights than `counts` gives,
    /// or for a width that is not positive.
    pub fn over(grid: LandGrid) -> Option<Self> {
        let LandGrid { counts: [columns, rows], width, center, heights, diagonal } = grid;
        if columns < 2 || rows < 2 || heights.len() != columns.checked_mul(rows)? || width <= 0.0 {
            return None;
        }
        let low = heights.iter().copied().fold(f32::INFINITY, f32::min);
        let high = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let cells = Vec2::new((columns - 1) as f32, (rows - 1) as f32);
        let step = width / cells.x;
        let half = Vec2::new(width, if columns == rows { width } else { step * cells.y }) / 2.0;
        let (corner, far) = (center - half, center + half);
        let bounds = Bounds { min: Vec3::new(corner.x, low, corner.y), max: Vec3::new(far.x, high, far.y) };
        // Steepest difference between neighbours along both axes.
        let mut steepest = 0.0_f32;
        for z in 0..rows {
            for x in 0..columns {
                let here = heights[z * columns + x];
                if x + 1 < columns {
                    steepest = steepest.max((heights[z * columns + x + 1] - here).abs());
                }
                if z + 1 < rows {
                    steepest = steepest.max((heights[(z + 1) * columns + x] - here).abs());
                }
            }
        }
        // The steepest descent of a triangle is at most sqrt(2) times that along one axis.
        let slope = steepest * std::f32::consts::SQRT_2 / step;
        let origin = cells / 2.0 - center / step;
        Some(Self {
            columns,
            rows,
            step,
            corner,
            origin,
            heights,
            diagonal,
            bounds,
            flattest: 1.0 / (1.0 + slope * slope).sqrt(),
        })
    }

    /// Cell along x that contains `x`, and the position in it, 0 to 1; clamped to the rectangle.
    fn column(&self, x: f32) -> (usize, f32) {
        self.cell(x - self.corner.x, self.columns)
    }

    /// Cell along z that contains `z`, and the position in it, 0 to 1; clamped to the rectangle.
    fn row(&self, z: f32) -> (usize, f32) {
        self.cell(z - self.corner.y, self.rows)
    }

    /// Cell at a distance `v` from the edge, m, and the position in it, 0 to 1. `count`: heights along this axis.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the cells")]
    fn cell(&self, v: f32, count: usize) -> (usize, f32) {
        let at = (v / self.step).clamp(0.0, (count - 1) as f32);
        let cell = (at as usize).min(count - 2);
        (cell, at - cell as f32)
    }

    /// Height at (x, z), m; outside the rectangle, that of the nearest point of its edge.
    #[inline]
    pub fn height(&self, at: Vec2) -> f32 {
        let ((x, u), (z, v)) = (self.column(at.x), self.row(at.y));
        let h = |i: usize, k: usize| self.heights[(z + k) * self.columns + x + i];
        let [a, b, c, d] = [h(0, 0), h(1, 0), h(0, 1), h(1, 1)];
        if self.diagonal.is_main([a, b, c, d]) {
            if u >= v { a + (b - a) * u + (d - b) * v } else { a + (c - a) * v + (d - c) * u }
        } else if u + v <= 1.0 {
            a + (b - a) * u + (c - a) * v
        } else {
            d + (c - d) * (1.0 - u) + (b - d) * (1.0 - v)
        }
    }

    /// Its lowest and its highest height, m.
    pub fn height_range(&self) -> [f32; 2] {
        [self.bounds.min.y, self.bounds.max.y]
    }

    /// Box over the rectangle, from the lowest to the highest height.
    pub(super) fn bounds(&self) -> Bounds {
        self.bounds
    }

    pub(super) fn contains(&self, at: Vec3) -> bool {
        at.y < self.height(Vec2::new(at.x, at.z))
    }

    /// True if some point of a segment lies less than `slack`, m, above the land, measured vertically, or below it.
    pub(super) fn meets(&self, [from, to]: [Vec3; 2], slack: f32) -> bool {
        let gap = |t: f32| {
            let p = from.lerp(to, t);
            p.y - self.height(Vec2::new(p.x, p.z))
        };
        // The land is flat between the lines of its cells and their diagonals, so that the gap is least at one of these or at an
        // end. Lines: x, z, x - z and, where cells have the other diagonal, x + z at whole multiples of the step.
        let cells = |p: Vec3| [p.x, p.z, p.x - p.z, p.x + p.z].map(|v| v / self.step);
        let (column, row) = (self.origin.x, self.origin.y);
        let offset = [column, row, column - row, column + row];
        let families = if self.diagonal == CellDiagonal::Main { 3 } else { 4 };
        let dips = |axis: usize| {
            let (a, b) = (cells(from)[axis] + offset[axis], cells(to)[axis] + offset[axis]);
            let (mut line, last) = (a.min(b).ceil(), a.max(b));
            while line <= last {
                if gap(((line - a) / (b - a)).clamp(0.0, 1.0)) < slack {
                    return true;
                }
                line += 1.0;
            }
            false
        };
        gap(0.0) < slack || gap(1.0) < slack || (0..families).any(dips)
    }

    /// Conservative test of a box: false only if the surface does not pass through it.
    pub(super) fn may_touch(&self, within: Bounds) -> bool {
        let (center, half) = (within.center(), within.size() / 2.0);
        // Tangent of the angle of the steepest slope, at which the land rises or falls at most.
        let slope = (1.0 / (self.flattest * self.flattest) - 1.0).max(0.0).sqrt();
        // Height of the middle of the box over the land below it.
        let gap = center.y - self.height(Vec2::new(center.x, center.z));
        gap.abs() <= half.y + slope * Vec2::new(half.x, half.z).length()
    }

    /// Corner of the cell (x, z) with the smallest x and z, m; beyond the rectangle at the height of its nearest edge.
    fn corner(&self, x: isize, z: isize) -> Vec3 {
        let [x_at, z_at] = [x, z].map(|i| i as f32 * self.step);
        let within = |i: isize, count: usize| i.max(0).cast_unsigned().min(count - 1);
        let height = self.heights[within(z, self.rows) * self.columns + within(x, self.columns)];
        Vec3::new(x_at + self.corner.x, height, z_at + self.corner.y)
    }

    /// Cells along an axis that a range of distances from the edge, m, touches. `count`: heights along this axis; `beyond`: cells
    /// of the land's continuation beyond the rectangle count, too.
    #[allow(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    fn cells_touched(&self, range: [f32; 2], count: usize, beyond: bool) -> RangeInclusive<isize> {
        let [first, last] =
            range.map(|v| if beyond { (v / self.step).floor() as isize } else { self.cell(v, count).0.cast_signed() });
        first..=last
    }

    pub(super) fn nearest(&self, at: Vec3) -> Nearest {
        let gap = at.y - self.height(Vec2::new(at.x, at.z));
        let sign = if gap < 0.0 { -1.0 } else { 1.0 };
        let (x, u) = self.column(at.x);
        let (z, v) = self.row(at.z);
        let (x, z) = (x.cast_signed(), z.cast_signed());
        let lower = if self.diagonal.is_main(self.corner_heights(x, z)) { u >= v } else { u + v <= 1.0 };
        let normal = self.normal(x, z, lower);
        // Far from the surface a lower bound of the distance is enough: the height times the cosine of the steepest slope.
        if gap.abs() > 3.0 * self.step {
            return Nearest { distance: gap * self.flattest, normal };
        }
        // Near it, the nearest point is on a triangle of the cells within the height of the point.
        let reach = gap.abs();
        let (low, high) = (self.bounds.min, self.bounds.max);
        // For a point over the rectangle, no point of the land outside the rectangle is nearer than its edge.
        let beyond = at.x < low.x || at.x > high.x || at.z < low.z || at.z > high.z;
        let around = |v: f32| [v - reach, v + reach];
        let columns = self.cells_touched(around(at.x - self.corner.x), self.columns, beyond);
        let rows = self.cells_touched(around(at.z - self.corner.y), self.rows, beyond);
        let mut best = (f32::INFINITY, at, normal);
        for cz in rows {
            for cx in columns.clone() {
                let c = [
                    self.corner(cx, cz),
                    self.corner(cx + 1, cz),
                    self.corner(cx, cz + 1),
                    self.corner(cx + 1, cz + 1),
                ];
                let halves = if self.diagonal.is_main(c.map(|p| p.y)) {
                    [([c[0], c[3], c[1]], true), ([c[0], c[2], c[3]], false)]
                } else {
                    [([c[0], c[2], c[1]], true), ([c[1], c[2], c[3]], false)]
                };
                for (t, lower) in halves {
                    let p = super::shell::nearest_on(t, at);
                    let d = p.distance(at);
                    if d < best.0 {
                        best = (d, p, self.normal(cx, cz, lower));
                    }
                }
            }
        }
        let (distance, place, flat) = best;
        // For a point on the surface the direction to the nearest point is lost in rounding: take the normal of the triangle.
        let out = (at - place) * sign;
        Nearest { distance: distance * sign, normal: if distance > 1e-5 { out / distance } else { flat } }
    }

    /// Heights of the corners of the cell (x, z), m, in the order of [`CellDiagonal::is_main`].
    fn corner_heights(&self, x: isize, z: isize) -> [f32; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, k)| self.corner(x + i, z + k).y)
    }

    /// Normal of the triangle of the cell (x, z) that has its side at -z, or of the other one.
    fn normal(&self, x: isize, z: isize, lower: bool) -> Vec3 {
        let c = |i, k| self.corner(x + i, z + k);
        // Sides along x and along z of the triangle.
        let along = if lower { c(1, 0) - c(0, 0) } else { c(1, 1) - c(0, 1) };
        let is_main = self.diagonal.is_main(self.corner_heights(x, z));
        let across = if lower == is_main { c(1, 1) - c(1, 0) } else { c(0, 1) - c(0, 0) };
        across.cross(along).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_meet_a_ridge_between_their_ends() {
        // A ridge one metre high along z at x = 0, its cells half a metre wide.
        let heights = (0..81).map(|i| if i % 9 == 4 { 1.0 } else { 0.0 }).collect();
        let land = LandForm::new(9, 4.0, heights).expect("fits");
        let across = |y: f32| [Vec3::new(-0.6, y, 0.1), Vec3::new(0.7, y, 0.3)];
        assert!(land.meets(across(0.9), 1e-4) && !land.meets(across(1.01), 1e-4));
        assert!(!land.meets([Vec3::new(0.6, 0.1, -1.0), Vec3::new(1.4, 0.1, 1.0)], 1e-4));
        assert!(land.meets([Vec3::new(1.0, 0.5, 0.0), Vec3::new(1.0, -0.1, 0.0)], 1e-4));
        let around = |x: f32, y: f32| Bounds { min: Vec3::new(x, y, 0.0), max: Vec3::new(x + 0.2, y + 0.2, 0.2) };
        assert!(land.may_touch(around(-0.1, 0.7)) && !land.may_touch(around(1.0, 3.0)));
    }

    #[test]
    fn a_rectangle_lies_where_its_middle_is() {
        // 5 x 3 heights over 8 x 4 m around (100, -50): a ramp along x, and a step along z in its last row.
        let heights = (0..15).map(|i| (i % 5) as f32 + if i >= 10 { 1.0 } else { 0.0 }).collect();
        let (center, diagonal) = (Vec2::new(100.0, -50.0), CellDiagonal::Main);
        let grid = LandGrid { counts: [5, 3], width: 8.0, center, heights, diagonal };
        let land = LandForm::over(grid.clone()).expect("fits");
        for (x, z, h) in
            [(96.0, -52.0, 0.0), (104.0, -52.0, 4.0), (101.0, -50.0, 2.5), (101.0, -48.0, 3.5), (90.0, -60.0, 0.0)]
        {
            assert!((land.height(Vec2::new(x, z)) - h).abs() < 1e-5, "{x} {z}");
        }
        let near = land.nearest(Vec3::new(101.0, 4.5, -51.5));
        assert!((near.distance - 2.0 * Vec2::new(1.0, 2.0).normalize().y).abs() < 1e-4, "{near:?}");
        assert!(land.meets([Vec3::new(97.0, 3.0, -51.0), Vec3::new(103.0, 3.0, -51.0)], 0.0));
        assert!(!land.meets([Vec3::new(97.0, 3.0, -51.0), Vec3::new(99.0, 3.0, -51.0)], 0.0));
        assert!(LandForm::over(LandGrid { counts: [3, 5], heights: vec![0.0; 14], ..grid }).is_none());
    }

    /// One cell of 2 m: with the other diagonal a level triangle and y = 2 (x + z), and a ridge from +x -z to -x +z.
    #[test]
    fn cells_are_divided_along_either_diagonal() {
        let cell = |heights: [f32; 4], diagonal| {
            let heights = heights.to_vec();
            LandForm::over(LandGrid { counts: [2, 2], width: 2.0, center: Vec2::ZERO, heights, diagonal })
                .expect("fits")
        };
        let [main, smaller] = [CellDiagonal::Main, CellDiagonal::SmallerDifference];
        let (fold, ridge) = ([0.0, 0.0, 0.0, 4.0], [0.0, 2.0, 2.0, 0.0]);
        for (heights, diagonal, at, height) in [
            (fold, main, 0.0, 2.0),
            (fold, smaller, 0.0, 0.0),
            (fold, main, 0.5, 3.0),
            (fold, smaller, 0.5, 2.0),
            (fold, smaller, -0.5, 0.0),
            // Equal differences: the other diagonal.
            (ridge, smaller, 0.0, 2.0),
            // The main diagonal has the smaller difference; along the other one it would be 2.25 m.
            ([1.0, 5.0, 2.0, 1.0], smaller, 0.5, 1.0),
        ] {
            let found = cell(heights, diagonal).height(Vec2::splat(at));
            assert!((found - height).abs() < 1e-6, "{heights:?} {diagonal:?} {at}: {found}");
        }
        let land = cell(fold, smaller);
        // One metre above the slope, whose normal has the length 3: a third of a metre away.
        let near = land.nearest(Vec3::new(0.5, 3.0, 0.5));
        let normal = Vec3::new(-2.0, 1.0, -2.0) / 3.0;
        assert!((near.distance - 1.0 / 3.0).abs() < 1e-5 && near.normal.distance(normal) < 1e-4, "{near:?}");
        let near = land.nearest(Vec3::new(-0.8, 0.5, -0.8));
        assert!((near.distance - 0.5).abs() < 1e-5 && near.normal.distance(Vec3::Y) < 1e-4, "{near:?}");
        let over = [Vec3::new(-0.9, 1.5, -0.9), Vec3::new(0.9, 1.5, 0.9)];
        assert!(cell(ridge, smaller).meets(over, 0.0) && !cell(ridge, main).meets(over, 0.0));
    }

    #[test]
    fn a_slope_is_as_far_as_its_plane() {
        let heights = (0..25).map(|i| (i % 5) as f32 * 0.5).collect();
        let land = LandForm::new(5, 4.0, heights).expect("fits");
        let at = Vec3::new(0.3, 1.9, 0.2);
        let near = land.nearest(at);
        let normal = Vec3::new(-0.5, 1.0, 0.0).normalize();
        let truth = (at - Vec3::new(0.0, 1.0, 0.0)).dot(normal);
        assert!((near.distance - truth).abs() < 1e-5 && near.normal.distance(normal) < 1e-4, "{near:?} {truth}");
        assert!(land.contains(Vec3::new(0.0, 0.9, 0.0)) && !land.contains(Vec3::new(0.0, 1.1, 0.0)));
        let far = land.nearest(Vec3::new(0.0, 40.0, 0.0));
        assert!(far.distance > 20.0 && far.distance <= 39.0 * normal.y + 1e-3, "{far:?}");
    }
}
