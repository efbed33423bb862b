//! Visibility buffer: the closest primitive of every pixel.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Vec2, Vec3};

use super::super::perspective::PerspectiveCamera;
use super::super::render_scene::{RenderScene, SceneHit, ray};
use super::draw_list::{DrawList, Raster};
use super::projection::{InstanceProjection, ProjectedPoint, Projection, RasterRect, pixel_centers, to_f32};

/// Consecutive rows of a picture, which are rasterised together.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowBand {
    /// First row of the picture that belongs to the band.
    pub(super) top: u32,
    /// Width and height, pixels.
    pub(super) size: [u32; 2],
}

impl RowBand {
    pub(super) fn pixels(self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Position in the picture of pixel `i` of the band.
    #[allow(clippy::cast_possible_truncation, reason = "a band's pixels fit")]
    pub(super) fn pixel_position(self, i: usize) -> [u32; 2] {
        [(i % self.size[0] as usize) as u32, self.top + (i / self.size[0] as usize) as u32]
    }
}

/// The closest primitive at each pixel of a band.
#[derive(Debug)]
pub(super) struct VisibilityBuffer<'c> {
    camera: &'c PerspectiveCamera,
    /// Depth as the bits of an f32 in the upper half, the number of the primitive in the lower. Bits of positive
    /// floats sort like the floats, so the minimum is the closest primitive; ties go to the lower number, whatever
    /// the order of drawing.
    keys: Vec<AtomicU64>,
    band: RowBand,
}

/// Key of a pixel that no primitive covers.
const EMPTY: u64 = u64::MAX;

impl<'c> VisibilityBuffer<'c> {
    /// Rasterises all primitives. Their numbers must fit 32 bits.
    pub(super) fn new(
        world: &RenderScene<'_>,
        camera: &'c PerspectiveCamera,
        band: RowBand,
        draw_list: &DrawList,
    ) -> Self {
        let keys = std::iter::repeat_with(|| AtomicU64::new(EMPTY)).take(band.pixels()).collect();
        let buffer = Self { camera, keys, band };
        draw_list.draw(world, &Projection::of_camera(camera, band.top), &buffer);
        buffer
    }

    /// Depth test of one pixel; `is_opaque` is evaluated only for a primitive that passes it.
    #[inline]
    fn test_and_set(&self, [x, y]: [u32; 2], depth: f32, number: u64, is_opaque: impl Fn() -> bool) {
        let Some(cell) = self.keys.get((y * self.band.size[0] + x) as usize) else { return };
        // Relaxed order suffices: a stale value only costs a superfluous alpha test before the
        // atomic minimum.
        let key = u64::from(depth.to_bits()) << 32 | number;
        if depth > 0.0 && key < cell.load(Ordering::Relaxed) && is_opaque() {
            cell.fetch_min(key, Ordering::Relaxed);
        }
    }

    /// The hit of pixel `i` of the band along its ray. `first_numbers`: number of the first primitive of each instance.
    pub(super) fn hit(
        &self,
        world: &RenderScene<'_>,
        i: usize,
        origin: Vec3,
        direction: Vec3,
        first_numbers: &[u64],
    ) -> Option<SceneHit> {
        let key = self.keys.get(i)?.load(Ordering::Relaxed);
        if key == EMPTY {
            return None;
        }
        // From the number of the primitive to its instance: the last one that starts at or before
        // it.
        let number = key & u64::from(u32::MAX);
        let instance = first_numbers.partition_point(|first| *first <= number).checked_sub(1)?;
        let primitive = usize::try_from(number - first_numbers.get(instance)?).ok()?;
        let (placed, solid) = world.instance(instance)?;
        let primitive =
            solid.project_hit(&placed.local_ray(&ray(origin, direction, [0.0, f32::INFINITY])), primitive)?;
        Some(SceneHit { instance: u32::try_from(instance).ok()?, primitive })
    }
}

impl Raster for VisibilityBuffer<'_> {
    #[inline]
    fn covered_rect<const N: usize>(
        &self,
        projection: &InstanceProjection,
        points: &[ProjectedPoint; N],
    ) -> Option<RasterRect> {
        projection.covered_rect(points, self.band.size, pixel_centers)
    }

    #[inline]
    fn draw_triangle(
        &self,
        projection: &InstanceProjection,
        corners: &[ProjectedPoint; 3],
        number: u64,
        is_opaque: impl Fn(Vec2) -> bool,
    ) {
        let Some([columns, rows]) = self.covered_rect(projection, corners) else { return };
        // Edge functions are evaluated relative to the corner of the bounding box.
        let zero = [columns.start, rows.start];
        let Some(raster) = projection.set_up_triangle(corners, Vec2::new(to_f32(zero[0]), to_f32(zero[1]))) else {
            return;
        };
        for y in rows {
            let dy = to_f32(y - zero[1]);
            for x in raster.touched_columns(&columns, [dy; 2], zero[0]) {
                let dx = to_f32(x - zero[0]);
                if raster.min_edge(dx, dy) >= 0.0 {
                    let depth = 1.0 / raster.depth(dx, dy);
                    self.test_and_set([x, y], depth, number, || is_opaque(raster.barycentric(dx, dy)));
                }
            }
        }
    }

    fn draw_cone(&self, [columns, rows]: RasterRect, number: u64, intersect: impl Fn(Vec3, Vec3) -> Option<f32>) {
        for [x, y] in rows.flat_map(|y| columns.clone().map(move |x| [x, y])) {
            // Along a vector of unit depth the distance is the depth.
            let direction = self.camera.unit_depth_vector([x, y + self.band.top]);
            if let Some(depth) = intersect(self.camera.eye, direction) {
                self.test_and_set([x, y], depth, number, || true);
            }
        }
    }
}
