//! Writes rings of points and the triangles between them into a tube's range of the mesh.

use glam::{Vec2, Vec3};

use super::AxisBinding;
use super::layout::CirclePoint;

/// The array ranges of consecutive tubes, filled from the front.
#[derive(Debug)]
pub(super) struct TubeWriter<'a> {
    pub points: &'a mut [Vec3],
    pub normals: &'a mut [Vec3],
    pub uvs: &'a mut [Vec2],
    pub bindings: &'a mut [AxisBinding],
    pub triangles: &'a mut [[u32; 3]],
    /// Index in the mesh of the first point of the range.
    pub first_point: u32,
    /// Number of points written to the range, which is the position of the next one.
    pub points_written: u32,
    /// Number of triangles written to the range, which is the position of the next one.
    pub triangles_written: usize,
}

/// A ring of points with their normals and texture coordinates; the first point is repeated at the seam.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointRing {
    /// Centre of the circle, m.
    pub c: Vec3,
    /// Unit vector towards the seam, and that vector rotated by a quarter turn about the axis.
    pub e: Vec3,
    pub b: Vec3,
    /// Radius of the circle, m; 0 is allowed.
    pub r: f32,
    /// A normal is `radial` times the unit radial vector plus `axial`.
    pub radial: f32,
    pub axial: Vec3,
    /// u at the seam, change of u once around, v.
    pub uv: [f32; 3],
    pub binding: AxisBinding,
}

impl TubeWriter<'_> {
    /// Writes a ring of as many points as `circle` has; returns the mesh index of the first.
    pub fn ring(&mut self, ring: &PointRing, circle: &[CirclePoint]) -> u32 {
        let from = self.points_written as usize;
        let to = from + circle.len();
        // Scaled axes of the ring's plane: p = c + x cos + y sin, and the same for normals.
        let (x, y) = (ring.e * ring.r, ring.b * ring.r);
        let (nx, ny) = (ring.e * ring.radial, ring.b * ring.radial);
        let targets =
            self.points[from..to].iter_mut().zip(&mut self.normals[from..to]).zip(&mut self.uvs[from..to]).zip(circle);
        for (((p, n), uv), CirclePoint { cos, sin, turn }) in targets {
            *p = ring.c + x * *cos + y * *sin;
            *n = nx * *cos + ny * *sin + ring.axial;
            *uv = Vec2::new(ring.uv[0] + ring.uv[1] * turn, ring.uv[2]);
        }
        self.bindings[from..to].fill(ring.binding);
        self.advance(circle.len())
    }

    /// Writes one point, such as the middle of a cap; returns its mesh index.
    pub fn point(&mut self, p: Vec3, n: Vec3, uv: Vec2, binding: AxisBinding) -> u32 {
        let i = self.points_written as usize;
        self.points[i] = p;
        self.normals[i] = n;
        self.uvs[i] = uv;
        self.bindings[i] = binding;
        self.advance(1)
    }

    /// Counts `n` points as written; returns the mesh index of the first.
    #[allow(clippy::cast_possible_truncation, reason = "rings have at most 33 points")]
    fn advance(&mut self, n: usize) -> u32 {
        let first = self.first_point + self.points_written;
        self.points_written += n as u32;
        first
    }

    /// Joins two rings of `n` sides by a strip of quads; `a`, `b`: first points of the lower and the upper ring.
    pub fn quad_strip(&mut self, a: u32, b: u32, n: u32) {
        // Quad (j, j + 1) of both rings, split along the diagonal from lower left to upper right.
        let to = self.triangles_written + 2 * n as usize;
        for (pair, j) in self.triangles[self.triangles_written..to].chunks_exact_mut(2).zip(0..n) {
            pair[0] = [a + j, a + j + 1, b + j + 1];
            pair[1] = [a + j, b + j + 1, b + j];
        }
        self.triangles_written = to;
    }

    /// Joins a ring of `n` sides to an apex by a triangle fan that faces along the axis, or against it for `down`.
    pub fn triangle_fan(&mut self, ring: u32, apex: u32, n: u32, down: bool) {
        let to = self.triangles_written + n as usize;
        for (t, j) in self.triangles[self.triangles_written..to].iter_mut().zip(0..n) {
            *t = if down { [ring + j + 1, ring + j, apex] } else { [ring + j, ring + j + 1, apex] };
        }
        self.triangles_written = to;
    }
}
