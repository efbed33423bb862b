//! Alias-free shadows of a distant light, exact at every point that is queried.
//!
//! The points are sorted into cells of a raster that faces the light. All primitives are then drawn into this raster
//! and shade the points that they cover and that lie behind them. There is no depth map, hence no resolution to
//! choose and no bias against surfaces that shade themselves.
//! Source: T. Aila, S. Laine, "Alias-free shadow maps", EGSR 2004.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Vec2, Vec3};

use super::super::render_scene::RenderScene;
use super::draw_list::{DrawList, Raster};
use super::projection::{InstanceProjection, ProjectedPoint, Projection, RasterRect, min_f32, to_f32, touched_cells};
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::par::par_map;

/// Points per cell on average: with fewer, empty cells cost more than the points that they save.
const POINTS_PER_CELL: f32 = 0.2;
/// Cells along a side at most; bounds the memory of the raster to 16 MB.
const MAX_SIDE: f32 = 2048.0;

/// Whether a distant light reaches each point, row after row. `to_light`: unit vector; `rows`: points just off their surfaces, m;
/// points that are not finite count as lit.
pub(super) fn sunlit_points(
    world: &RenderScene<'_>,
    to_light: Vec3,
    rows: &[Vec<Vec3>],
    draw_list: &DrawList,
) -> Vec<bool> {
    let cells = ShadowCells::new(world, to_light, rows);
    draw_list.draw(world, &cells.projection, &cells);
    let mut is_lit = vec![true; rows.iter().map(Vec::len).sum()];
    for (number, is_shaded) in cells.numbers.iter().zip(&cells.is_shaded) {
        if let Some(is_lit) = is_lit.get_mut(*number as usize) {
            *is_lit = !is_shaded.load(Ordering::Relaxed);
        }
    }
    is_lit
}

/// Points in the cells of a raster that faces the light.
struct ShadowCells {
    to_light: Vec3,
    projection: Projection,
    /// Number of columns and rows of cells.
    size: [u32; 2],
    /// Index of the first point of each cell, row by row, and the number of all points.
    cell_starts: Vec<u32>,
    /// Raster coordinates, and height towards the light in m, in the order of the cells.
    points: Vec<Vec3>,
    /// Index of each of `points` in the query, counted over all rows.
    numbers: Vec<u32>,
    is_shaded: Vec<AtomicBool>,
}

/// A point of a query, projected onto a plane that faces the light.
#[derive(Debug, Clone, Copy)]
struct ShadowQuery {
    /// Index of the point in the query, counted over all rows.
    number: u32,
    /// Position on the plane and height towards the light, m.
    q: Vec3,
}

impl ShadowCells {
    fn new(world: &RenderScene<'_>, to_light: Vec3, rows: &[Vec<Vec3>]) -> Self {
        // Points beside the shadow of the scene's box are lit and need no cell.
        let middle = world.bounds.center();
        let plane = Projection::of_light(to_light, middle, 1.0);
        let shadow = Bounds::of(world.bounds.corners().map(|p| plane.project(p)));
        let is_within = |q: Vec3| [0, 1].iter().all(|k| q[*k] >= shadow.min[*k] && q[*k] <= shadow.max[*k]);
        let numbered_rows: Vec<(u32, &Vec<Vec3>)> = rows
            .iter()
            .scan(0_u32, |next, row| {
                let first = *next;
                // A band has at most 2^22 pixels.
                *next += row.iter().map(|_| 1).sum::<u32>();
                Some((first, row))
            })
            .collect();
        let project_row = |(first, row): &(u32, &Vec<Vec3>)| -> Vec<ShadowQuery> {
            let projected = (*first..).zip(row.iter().map(|p| plane.project(*p)));
            projected.filter(|(_, q)| is_within(*q)).map(|(number, q)| ShadowQuery { number, q }).collect()
        };
        let queries = par_map(&numbered_rows, project_row);
        // The raster spans the box of the queried points, with cells of the size that holds
        // POINTS_PER_CELL on average.
        let extent = Bounds::of(queries.iter().flatten().map(|query| query.q));
        let sides = extent.size().truncate();
        let count: usize = queries.iter().map(Vec::len).sum();
        #[allow(clippy::cast_precision_loss, reason = "about as many")]
        let mean_cell = math::sqrt_f32(sides.x * sides.y * POINTS_PER_CELL / (count as f32).max(1.0));
        let cell = mean_cell.max(sides.max_element() / MAX_SIDE).max(f32::MIN_POSITIVE);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most MAX_SIDE, and rounding")]
        let size = [sides.x, sides.y].map(|side| (side / cell).min(MAX_SIDE) as u32 + 1);
        let corner = plane.unproject(Vec3::new(extent.min.x, extent.min.y, 0.0));
        let projection = Projection::of_light(to_light, if count == 0 { middle } else { corner }, cell);
        Self::sorted(to_light, projection, size, &queries, |q| {
            Vec3::new((q.x - extent.min.x) / cell, (q.y - extent.min.y) / cell, q.z)
        })
    }

    /// Counting sort of the points by cell, stable within a cell. `to_raster`: converts positions on
    /// the plane to raster coordinates.
    fn sorted(
        to_light: Vec3,
        projection: Projection,
        size: [u32; 2],
        queries: &[Vec<ShadowQuery>],
        to_raster: impl Fn(Vec3) -> Vec3,
    ) -> Self {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "held to the cells")]
        let cell_of = |q: Vec3| {
            let [x, y] = [0, 1].map(|k| (q[k] as u32).min(size[k] - 1));
            (y * size[0] + x) as usize
        };
        // Count the points of each cell, then sum up: each entry becomes the end of its cell.
        let mut cell_starts = vec![0_u32; size[0] as usize * size[1] as usize + 1];
        queries.iter().flatten().for_each(|query| cell_starts[cell_of(to_raster(query.q))] += 1);
        let mut sum = 0;
        for start in &mut cell_starts {
            sum += *start;
            *start = sum;
        }
        // Filling the cells from their ends, the last point first, moves each end down to the start
        // of its cell.
        let (mut points, mut numbers) = (vec![Vec3::ZERO; sum as usize], vec![0; sum as usize]);
        for query in queries.iter().flatten().rev() {
            let q = to_raster(query.q);
            let slot = &mut cell_starts[cell_of(q)];
            *slot -= 1;
            (points[*slot as usize], numbers[*slot as usize]) = (q, query.number);
        }
        let is_shaded = std::iter::repeat_with(|| AtomicBool::new(false)).take(points.len()).collect();
        Self { to_light, projection, size, cell_starts, points, numbers, is_shaded }
    }

    /// Marks points as shaded in some cells of a row if a primitive covers them and is opaque there. `is_opaque` is evaluated
    /// only for points that are covered and not shaded yet.
    #[inline]
    fn shade_points(
        &self,
        row: u32,
        columns: Range<u32>,
        covers: impl Fn(Vec3) -> bool,
        is_opaque: impl Fn(Vec3) -> bool,
    ) {
        if columns.is_empty() {
            return;
        }
        // Cells of a row are consecutive, hence so are their points.
        let row = (row * self.size[0]) as usize;
        let points = self.cell_starts[row + columns.start as usize] as usize
            ..self.cell_starts[row + columns.end as usize] as usize;
        for (q, is_shaded) in self.points[points.clone()].iter().zip(&self.is_shaded[points]) {
            if covers(*q) && !is_shaded.load(Ordering::Relaxed) && is_opaque(*q) {
                is_shaded.store(true, Ordering::Relaxed);
            }
        }
    }
}

impl Raster for ShadowCells {
    #[inline]
    fn covered_rect<const N: usize>(
        &self,
        projection: &InstanceProjection,
        points: &[ProjectedPoint; N],
    ) -> Option<RasterRect> {
        projection.covered_rect(points, self.size, touched_cells)
    }

    #[inline]
    fn draw_triangle(
        &self,
        projection: &InstanceProjection,
        corners: &[ProjectedPoint; 3],
        _: u64,
        is_opaque: impl Fn(Vec2) -> bool,
    ) {
        let Some([columns, rows]) = self.covered_rect(projection, corners) else { return };
        let (left, top) = (columns.start, rows.start);
        let zero = Vec2::new(to_f32(left), to_f32(top));
        let Some(raster) = projection.set_up_triangle(corners, zero) else { return };
        for row in rows {
            let y = to_f32(row - top);
            // A point is in shadow if it is inside of all edges and below the triangle as the light
            // sees it.
            let covers = |q: Vec3| {
                let (x, y) = (q.x - zero.x, q.y - zero.y);
                min_f32(raster.min_edge(x, y), raster.depth(x, y) - q.z) >= 0.0
            };
            let is_opaque = |q: Vec3| is_opaque(raster.barycentric(q.x - zero.x, q.y - zero.y));
            self.shade_points(row, raster.touched_columns(&columns, [y, y + 1.0], left), covers, is_opaque);
        }
    }

    fn draw_cone(&self, [columns, rows]: RasterRect, _: u64, intersect: impl Fn(Vec3, Vec3) -> Option<f32>) {
        let covers = |q| intersect(self.projection.unproject(q), self.to_light).is_some();
        rows.for_each(|row| self.shade_points(row, columns.clone(), covers, |_| true));
    }
}
