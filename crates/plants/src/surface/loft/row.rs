//! Writing rows of points and the triangles between them into a tube's share of the arrays.

use glam::{Vec2, Vec3};

use super::Binding;

/// A tube's share of the arrays, filled from the front.
#[derive(Debug)]
pub(super) struct Out<'a> {
    pub points: &'a mut [Vec3],
    pub normals: &'a mut [Vec3],
    pub uvs: &'a mut [Vec2],
    pub binding: &'a mut [Binding],
    pub triangles: &'a mut [[u32; 3]],
    /// Index in the mesh of the first point of the share.
    pub base: u32,
    /// Points written.
    pub at: u32,
    /// Triangles written.
    pub done: usize,
}

/// A circle of points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub c: Vec3,
    /// Unit reference and its quarter turn.
    pub e: Vec3,
    pub b: Vec3,
    pub r: f32,
    /// The normal is `out` times the unit radial vector plus this.
    pub lean: Vec3,
    pub out: f32,
    /// u at the seam, u around, v.
    pub uv: [f32; 3],
    pub bind: Binding,
}

impl Out<'_> {
    /// Writes a row; returns the index of its first point.
    pub fn row(&mut self, row: &Row, circle: &[[f32; 3]]) -> u32 {
        let from = self.at as usize;
        let to = from + circle.len();
        let (x, y) = (row.e * row.r, row.b * row.r);
        let (nx, ny) = (row.e * row.out, row.b * row.out);
        let cells =
            self.points[from..to].iter_mut().zip(&mut self.normals[from..to]).zip(&mut self.uvs[from..to]).zip(circle);
        for (((p, n), uv), [cos, sin, share]) in cells {
            *p = row.c + x * *cos + y * *sin;
            *n = nx * *cos + ny * *sin + row.lean;
            *uv = Vec2::new(row.uv[0] + row.uv[1] * share, row.uv[2]);
        }
        self.binding[from..to].fill(row.bind);
        self.advance(circle.len())
    }

    /// Writes one point; returns its index.
    pub fn point(&mut self, p: Vec3, n: Vec3, uv: Vec2, bind: Binding) -> u32 {
        let i = self.at as usize;
        self.points[i] = p;
        self.normals[i] = n;
        self.uvs[i] = uv;
        self.binding[i] = bind;
        self.advance(1)
    }

    #[allow(clippy::cast_possible_truncation, reason = "rows have at most 33 points")]
    fn advance(&mut self, n: usize) -> u32 {
        let first = self.base + self.at;
        self.at += n as u32;
        first
    }

    /// Joins two rows of `n` sides, `a` below `b`.
    pub fn band(&mut self, a: u32, b: u32, n: u32) {
        let to = self.done + 2 * n as usize;
        for (pair, j) in self.triangles[self.done..to].chunks_exact_mut(2).zip(0..n) {
            pair[0] = [a + j, a + j + 1, b + j + 1];
            pair[1] = [a + j, b + j + 1, b + j];
        }
        self.done = to;
    }

    /// Joins a row with a point: above it, or below it for `down`.
    pub fn fan(&mut self, row: u32, apex: u32, n: u32, down: bool) {
        let to = self.done + n as usize;
        for (t, j) in self.triangles[self.done..to].iter_mut().zip(0..n) {
            *t = if down { [row + j + 1, row + j, apex] } else { [row + j, row + j + 1, apex] };
        }
        self.done = to;
    }
}
