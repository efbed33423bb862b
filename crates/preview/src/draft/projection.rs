//! Rasterisation of triangles in homogeneous coordinates: projection, edge functions and pixel ranges.

use std::ops::Range;

use glam::{Mat3, Vec2, Vec3};

use super::super::perspective::PerspectiveCamera;
use super::super::render_scene::SolidInstance;
use super::super::solid::{RayTriangle, VertexData};
use osier_base::math;

/// Depth of the near plane, m.
const NEAR_PLANE: f32 = 1e-4;
/// Spans of at most this many columns are tested pixel by pixel: computing their bounds would cost more.
const SHORT_SPAN: u32 = 3;

/// Columns and rows of a raster.
pub(super) type RasterRect = [Range<u32>; 2];

/// A projection onto a raster: perspective for a camera, orthographic for a distant light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projection {
    /// A point p has raster coordinates q = `raster_from_world` (p - `origin`). In perspective pixels are q.xy / q.z
    /// and q.z is the depth; in orthographic projection they are q.xy, and q.z grows towards the light.
    raster_from_world: Mat3,
    world_from_raster: Mat3,
    origin: Vec3,
    is_orthographic: bool,
}

/// A projection from the space of one instance.
#[derive(Debug, Clone, Copy)]
pub(super) struct InstanceProjection {
    raster_from_local: Mat3,
    translation: Vec3,
    is_orthographic: bool,
}

/// A point after projection, before and after the division by depth.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ProjectedPoint {
    /// Homogeneous raster coordinates.
    q: Vec3,
    /// Pixel coordinates; NaN behind the near plane.
    pixel: Vec2,
}

/// Edge functions and depth of a projected triangle, linear in pixel coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct TriangleRaster {
    /// Coefficients over (x, y, 1) of three functions that are not negative inside: up to a common factor the
    /// homogeneous barycentric coordinates.
    edges: [Vec3; 3],
    /// Coefficients over (x, y, 1) of the inverse depth in perspective, of the depth in orthographic projection.
    depth: Vec3,
}

impl Projection {
    /// The projection of a camera; integer pixel coordinates are the centres of pixels. `top`: row of the picture
    /// that becomes row 0.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn of_camera(camera: &PerspectiveCamera, top: u32) -> Self {
        // A point at depth z through pixel (x, y) is z (corner + x right + y down): the columns map
        // (x z, y z, z) to it.
        let first = camera.corner + camera.right * 0.5 + camera.down * (top as f32 + 0.5);
        let world_from_raster = Mat3::from_cols(camera.right, camera.down, first);
        let raster_from_world = world_from_raster.inverse();
        Self { raster_from_world, world_from_raster, origin: camera.eye, is_orthographic: false }
    }

    /// The projection along the direction of a distant light. `to_light`: unit vector; `cell`: width of a pixel, m.
    pub(super) fn of_light(to_light: Vec3, origin: Vec3, cell: f32) -> Self {
        // Rows of the matrix are the axes of the raster, scaled to one unit per cell; the third is
        // the height towards the light.
        let x = math::perpendicular(to_light);
        let y = to_light.cross(x);
        let raster_from_world = Mat3::from_cols(x / cell, y / cell, to_light).transpose();
        let world_from_raster = Mat3::from_cols(x * cell, y * cell, to_light);
        Self { raster_from_world, world_from_raster, origin, is_orthographic: true }
    }

    /// Homogeneous raster coordinates of a point of the world.
    pub(super) fn project(&self, p: Vec3) -> Vec3 {
        self.raster_from_world * (p - self.origin)
    }

    /// The point of the world with homogeneous raster coordinates `q`.
    pub(super) fn unproject(&self, q: Vec3) -> Vec3 {
        self.world_from_raster * q + self.origin
    }

    /// The projection composed with the transform of an instance.
    pub(super) fn for_instance(&self, instance: &SolidInstance) -> InstanceProjection {
        let world_from_local = instance.world_from_local();
        InstanceProjection {
            raster_from_local: self.raster_from_world * world_from_local.linear,
            translation: self.project(world_from_local.translation),
            is_orthographic: self.is_orthographic,
        }
    }
}

impl InstanceProjection {
    #[inline]
    pub(super) fn project(&self, p: Vec3) -> ProjectedPoint {
        let q = self.raster_from_local * p + self.translation;
        let inverse_depth = match () {
            () if self.is_orthographic => 1.0,
            () if q.z > NEAR_PLANE => 1.0 / q.z,
            () => f32::NAN,
        };
        ProjectedPoint { q, pixel: q.truncate() * inverse_depth }
    }

    /// Lower and upper pixel coordinates of points; the whole plane if some lie behind the near plane, `None` if all
    /// do.
    #[inline]
    fn bounds<const N: usize>(&self, points: &[ProjectedPoint; N]) -> Option<[Vec2; 2]> {
        // The maximum is taken as -min(-a, -b), so that NaN is treated alike at both ends.
        let [mut lo, mut hi] = [points.first()?.pixel; 2];
        for p in points {
            lo = Vec2::new(min_f32(lo.x, p.pixel.x), min_f32(lo.y, p.pixel.y));
            hi = Vec2::new(-min_f32(-hi.x, -p.pixel.x), -min_f32(-hi.y, -p.pixel.y));
        }
        let around = [lo, hi];
        if self.is_orthographic || points.iter().all(|p| p.q.z > NEAR_PLANE) {
            return Some(around);
        }
        points.iter().any(|p| p.q.z > NEAR_PLANE).then_some([Vec2::NEG_INFINITY, Vec2::INFINITY])
    }

    /// Columns and rows of a raster of `size` in the bounding box of points. `clamped`: [`pixel_centers`] or
    /// [`touched_cells`].
    #[inline]
    pub(super) fn covered_rect<const N: usize>(
        &self,
        points: &[ProjectedPoint; N],
        size: [u32; 2],
        clamped: impl Fn(f32, f32, u32) -> Range<u32>,
    ) -> Option<RasterRect> {
        let [lo, hi] = self.bounds(points)?;
        let columns = clamped(lo.x, hi.x, size[0]);
        if columns.is_empty() {
            return None;
        }
        let rows = clamped(lo.y, hi.y, size[1]);
        (!rows.is_empty()).then_some([columns, rows])
    }

    /// Sets up the edge functions of a triangle; `None` if it is seen edge-on. Pixel coordinates count from `zero`,
    /// near the triangle: small numbers keep their digits. No clipping is needed: edge functions of homogeneous
    /// vertices hold for triangles that cross the plane of the eye.
    /// Source: M. Olano, T. Greer, "Triangle scan conversion using 2D homogeneous coordinates", Graphics Hardware 1997.
    #[inline]
    pub(super) fn set_up_triangle(&self, corners: &[ProjectedPoint; 3], zero: Vec2) -> Option<TriangleRaster> {
        let [a, b, c] = corners.map(|p| {
            let w = if self.is_orthographic { 1.0 } else { p.q.z };
            Vec3::new(p.q.x - zero.x * w, p.q.y - zero.y * w, w)
        });
        // Rows of the adjugate of the matrix of vertices: b x c is zero on the edge from b to c,
        // and so on. Their sum over the determinant interpolates the value 1 of all three vertices,
        // which is the inverse depth.
        let edges = [b.cross(c), c.cross(a), a.cross(b)];
        let determinant = a.dot(edges[0]);
        let inverse = 1.0 / determinant;
        if !inverse.is_finite() {
            return None;
        }
        let depth = if self.is_orthographic {
            edges[0] * corners[0].q.z + edges[1] * corners[1].q.z + edges[2] * corners[2].q.z
        } else {
            edges[0] + edges[1] + edges[2]
        };
        // Both sides of a triangle are visible: the sign makes the edge functions positive inside for either orientation.
        let side = if determinant < 0.0 { -1.0 } else { 1.0 };
        Some(TriangleRaster { edges: edges.map(|e| e * side), depth: depth * inverse })
    }
}

impl TriangleRaster {
    /// The smallest edge function at a pixel: not negative if the triangle covers it in front of the eye. One
    /// comparison for three edges: half of all tested pixels lie inside, so three branches would be mispredicted at
    /// every other pixel.
    #[inline]
    pub(super) fn min_edge(&self, x: f32, y: f32) -> f32 {
        let [a, b, c] = self.edges.map(|e| e.x * x + e.y * y + e.z);
        min_f32(min_f32(a, b), c)
    }

    /// The part of `columns` that the triangle may touch between the rows `y0` and `y1`, much narrower than the bounding box for
    /// a thin slanting triangle. `zero`: column that pixel coordinates count from.
    #[inline]
    pub(super) fn touched_columns(&self, columns: &Range<u32>, [y0, y1]: [f32; 2], zero: u32) -> Range<u32> {
        if columns.end - columns.start <= SHORT_SPAN {
            return columns.clone();
        }
        // Each edge e.x x + e.y y + e.z >= 0 bounds x from one side; the bound is widest at one of
        // the two rows.
        let (mut lo, mut hi) = (f32::NEG_INFINITY, f32::INFINITY);
        for e in &self.edges {
            let bound = -(e.z + (e.y * y0).max(e.y * y1)) / e.x;
            if e.x > 0.0 {
                lo = lo.max(bound);
            } else if e.x < 0.0 {
                hi = hi.min(bound);
            }
        }
        // The bounds are rounded, so the range is widened by a hundredth of a pixel.
        let touched = touched_cells(lo - 0.01, hi + 0.01, columns.end - zero);
        (touched.start + zero).max(columns.start)..(touched.end + zero).min(columns.end)
    }

    /// Depth at a pixel in orthographic projection; inverse depth in perspective.
    #[inline]
    pub(super) fn depth(&self, x: f32, y: f32) -> f32 {
        self.depth.x * x + self.depth.y * y + self.depth.z
    }

    /// Perspective-correct barycentric coordinates of the second and third corner at a pixel.
    pub(super) fn barycentric(&self, x: f32, y: f32) -> Vec2 {
        let [a, b, c] = self.edges.map(|e| e.x * x + e.y * y + e.z);
        Vec2::new(b, c) * (1.0 / (a + b + c))
    }
}

/// Projected vertices of some triangles, each projected once.
#[derive(Debug, Default)]
pub(super) struct ProjectedVertices {
    /// Index of the first in the mesh.
    first: usize,
    points: Vec<ProjectedPoint>,
}

impl ProjectedVertices {
    /// Projects the range of vertices that some triangles use.
    pub(super) fn project(
        &mut self,
        projection: &InstanceProjection,
        triangles: &[RayTriangle],
        vertices: &VertexData<'_>,
    ) {
        let used = triangles.iter().flat_map(|t| vertices.corners(t));
        let (first, last) = used.fold((usize::MAX, 0), |(lo, hi), i| (lo.min(i), hi.max(i)));
        self.first = first;
        self.points.clear();
        let used = vertices.points.get(first..=last).unwrap_or_default();
        self.points.extend(used.iter().map(|p| projection.project(*p)));
    }

    /// The projected corners of a triangle, by their indices in the mesh.
    #[inline]
    pub(super) fn corners(&self, corners: [usize; 3]) -> [ProjectedPoint; 3] {
        corners.map(|i| self.points.get(i - self.first).copied().unwrap_or_default())
    }
}

/// The smaller of two numbers that are not NaN. f32::min also handles NaN, which costs two more instructions.
#[inline]
pub(super) fn min_f32(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The integers from `lo` to `hi` within 0..`size`: pixels whose centres lie in the range.
#[inline]
pub(super) fn pixel_centers(lo: f32, hi: f32, size: u32) -> Range<u32> {
    let cells = touched_cells(lo, hi, size);
    let is_left_of_range = u32::from(to_f32(cells.start) < lo);
    (cells.start + is_left_of_range).min(cells.end)..cells.end
}

/// The cells [n, n + 1) of 0..`size` that the range from `lo` to `hi` touches.
#[inline]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "held to 0..size before")]
pub(super) fn touched_cells(lo: f32, hi: f32, size: u32) -> Range<u32> {
    let end = to_f32(size);
    if !(hi >= 0.0 && lo <= hi && lo < end) {
        return 0..0;
    }
    lo.max(0.0) as u32..(hi as u32).min(size.saturating_sub(1)) + 1
}

/// A pixel coordinate as a float, exactly.
#[inline]
#[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
pub(super) fn to_f32(n: u32) -> f32 {
    n as f32
}
