//! Shadows of a far light, exact at every place that is asked for.
//!
//! Places are sorted into cells as the light sees them; everything is then projected onto the cells, and shades the
//! places that it covers and that lie behind it. No map of depths is made, so there is no resolution to choose and
//! nothing shades itself.
//! Source: T. Aila, S. Laine, "Alias-free shadow maps", EGSR 2004.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Vec2, Vec3};

use super::super::world::World;
use super::project::{InstanceProjection, Projected, Projection, cells, float, lesser};
use super::tasks::{RasterTarget, ScreenRect, Tasks};
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::par::par_map;

/// Places of a cell, on average.
const PLACES_PER_CELL: f32 = 0.2;
/// ShadowCells along a side at most.
const SIDE: f32 = 2048.0;

/// Which places a light reaches, as their rows are given.
/// `toward`: unit vector to the light. `rows`: places just off their surfaces, m; those not finite are not asked for.
pub(super) fn sunlit(world: &World<'_>, toward: Vec3, rows: &[Vec<Vec3>], tasks: &Tasks) -> Vec<bool> {
    let cells = ShadowCells::new(world, toward, rows);
    tasks.draw(world, &cells.view, &cells);
    let mut lit = vec![true; rows.iter().map(Vec::len).sum()];
    for (place, shaded) in cells.numbers.iter().zip(&cells.shaded) {
        if let Some(lit) = lit.get_mut(*place as usize) {
            *lit = !shaded.load(Ordering::Relaxed);
        }
    }
    lit
}

/// Places as the light sees them.
struct ShadowCells {
    toward: Vec3,
    view: Projection,
    size: [u32; 2],
    /// First place of each cell, row by row, and the number of all.
    starts: Vec<u32>,
    /// Cell coordinates and height towards the light.
    seen: Vec<Vec3>,
    /// Their numbers as they were given.
    numbers: Vec<u32>,
    shaded: Vec<AtomicBool>,
}

/// Places on a plane that faces the light, with their numbers.
type ShadowQueries = Vec<(u32, Vec3)>;

impl ShadowCells {
    fn new(world: &World<'_>, toward: Vec3, rows: &[Vec<Vec3>]) -> Self {
        // Whatever lies beside the shadow of the box around everything is lit.
        let middle = world.bounds.center();
        let plane = Projection::of_light(toward, middle, 1.0);
        let shadow = Bounds::of(world.bounds.corners().map(|p| plane.project(p)));
        let within = |q: Vec3| [0, 1].iter().all(|k| q[*k] >= shadow.min[*k] && q[*k] <= shadow.max[*k]);
        let firsts = rows.iter().scan(0_u32, |next, row| {
            let first = *next;
            *next += u32::try_from(row.len()).unwrap_or(u32::MAX);
            Some((first, row))
        });
        let numbered: Vec<(u32, &Vec<Vec3>)> = firsts.collect();
        let seen = |(first, row): &(u32, &Vec<Vec3>)| -> ShadowQueries {
            (*first..).zip(row.iter().map(|p| plane.project(*p))).filter(|(_, q)| within(*q)).collect()
        };
        let asked = par_map(&numbered, seen);
        let held = Bounds::of(asked.iter().flatten().map(|(_, q)| *q));
        let sides = held.size().truncate();
        let count: usize = asked.iter().map(Vec::len).sum();
        #[allow(clippy::cast_precision_loss, reason = "about as many")]
        let each = math::sqrt_f32(sides.x * sides.y * PLACES_PER_CELL / (count as f32).max(1.0));
        let cell = each.max(sides.max_element() / SIDE).max(f32::MIN_POSITIVE);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most SIDE, and rounding")]
        let size = [sides.x, sides.y].map(|side| (side / cell).min(SIDE) as u32 + 1);
        let corner = plane.back(Vec3::new(held.min.x, held.min.y, 0.0));
        let view = Projection::of_light(toward, if count == 0 { middle } else { corner }, cell);
        Self::sorted(toward, view, size, &asked, |q| {
            Vec3::new((q.x - held.min.x) / cell, (q.y - held.min.y) / cell, q.z)
        })
    }

    /// Places in order of their cells, each cell's as they were given. `scaled`: cell coordinates of a place on the plane.
    fn sorted(
        toward: Vec3,
        view: Projection,
        size: [u32; 2],
        asked: &[ShadowQueries],
        scaled: impl Fn(Vec3) -> Vec3,
    ) -> Self {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "held to the cells")]
        let cell = |q: Vec3| {
            let [x, y] = [0, 1].map(|k| (q[k] as u32).min(size[k] - 1));
            (y * size[0] + x) as usize
        };
        let mut starts = vec![0_u32; size[0] as usize * size[1] as usize + 1];
        asked.iter().flatten().for_each(|(_, q)| starts[cell(scaled(*q))] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        // Each cell's end moves down to its start as its places come in, the last first.
        let (mut seen, mut numbers) = (vec![Vec3::ZERO; sum as usize], vec![0; sum as usize]);
        for (number, q) in asked.iter().flatten().rev() {
            let q = scaled(*q);
            let slot = &mut starts[cell(q)];
            *slot -= 1;
            (seen[*slot as usize], numbers[*slot as usize]) = (q, *number);
        }
        let shaded = std::iter::repeat_with(|| AtomicBool::new(false)).take(seen.len()).collect();
        Self { toward, view, size, starts, seen, numbers, shaded }
    }

    /// Shades the places of some cells of a row for which `covers` holds, and `there`, which is asked after it.
    #[inline]
    fn each(&self, row: u32, columns: Range<u32>, covers: impl Fn(Vec3) -> bool, there: impl Fn(Vec3) -> bool) {
        if columns.is_empty() {
            return;
        }
        let row = (row * self.size[0]) as usize;
        let places =
            self.starts[row + columns.start as usize] as usize..self.starts[row + columns.end as usize] as usize;
        for (q, shaded) in self.seen[places.clone()].iter().zip(&self.shaded[places]) {
            if covers(*q) && !shaded.load(Ordering::Relaxed) && there(*q) {
                shaded.store(true, Ordering::Relaxed);
            }
        }
    }
}

impl RasterTarget for ShadowCells {
    #[inline]
    fn window<const N: usize>(&self, sight: &InstanceProjection, places: &[Projected; N]) -> Option<ScreenRect> {
        sight.window(places, self.size, cells)
    }

    #[inline]
    fn face(&self, sight: &InstanceProjection, corners: &[Projected; 3], _: u64, there: impl Fn(Vec2) -> bool) {
        let Some([columns, rows]) = self.window(sight, corners) else { return };
        let (left, top) = (columns.start, rows.start);
        let zero = Vec2::new(float(left), float(top));
        let Some(patch) = sight.patch(corners, zero) else { return };
        for row in rows {
            let y = float(row - top);
            let covers = |q: Vec3| {
                let (x, y) = (q.x - zero.x, q.y - zero.y);
                lesser(patch.inside(x, y), patch.depth(x, y) - q.z) >= 0.0
            };
            let there = |q: Vec3| there(patch.weights(q.x - zero.x, q.y - zero.y));
            self.each(row, patch.touched(&columns, [y, y + 1.0], left), covers, there);
        }
    }

    fn cone(&self, [columns, rows]: ScreenRect, _: u64, meets: impl Fn(Vec3, Vec3) -> Option<f32>) {
        let covers = |q| meets(self.view.back(q), self.toward).is_some();
        rows.for_each(|row| self.each(row, columns.clone(), covers, |_| true));
    }
}
