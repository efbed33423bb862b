//! From places to pixels: triangles where a view shows them.

use std::ops::Range;

use glam::{Mat3, Vec2, Vec3};

use super::super::lens::Lens;
use super::super::solid::{CornerData, Face};
use super::super::world::SolidInstance;
use super::tasks::ScreenRect;
use osier_base::math;

/// Nearer to an eye than this nothing is projected, m.
const NEAR: f32 = 1e-4;

/// Straight lines of sight onto a plane of pixels: from an eye, or all along one direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projection {
    /// A place p is seen at q = turn (p - origin). From an eye, pixel coordinates are q.xy / q.z and q.z is the depth;
    /// along one direction they are q.xy, and depth grows with q.z.
    turn: Mat3,
    /// The other way.
    back: Mat3,
    origin: Vec3,
    parallel: bool,
}

/// A view of a solid's own space.
#[derive(Debug, Clone, Copy)]
pub(super) struct InstanceProjection {
    turn: Mat3,
    shift: Vec3,
    parallel: bool,
}

/// A place in a view.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Projected {
    q: Vec3,
    /// PixelSamples coordinates; not a number behind the eye.
    at: Vec2,
}

/// A triangle in a view: what covers a pixel, and how deep it lies there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// Area of the triangle of a pixel with each edge is edge . (x, y, 1), up to a common factor; not below 0 inside.
    edges: [Vec3; 3],
    /// Over (x, y, 1): the inverse depth from an eye, the depth along one direction.
    depth: Vec3,
}

impl Projection {
    /// What a lens sees; whole pixel coordinates are the middles of pixels. `top`: row of the picture that becomes row 0.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub(super) fn of_lens(lens: &Lens, top: u32) -> Self {
        let first = lens.corner + lens.right * 0.5 + lens.down * (top as f32 + 0.5);
        let back = Mat3::from_cols(lens.right, lens.down, first);
        Self { turn: back.inverse(), back, origin: lens.eye, parallel: false }
    }

    /// What lies before places on their way to a far light. `toward`: unit vector to it; `cell`: width of a pixel, m.
    pub(super) fn of_light(toward: Vec3, origin: Vec3, cell: f32) -> Self {
        let x = math::perpendicular(toward);
        let y = toward.cross(x);
        let turn = Mat3::from_cols(x / cell, y / cell, toward).transpose();
        Self { turn, back: Mat3::from_cols(x * cell, y * cell, toward), origin, parallel: true }
    }

    pub(super) fn project(&self, p: Vec3) -> Vec3 {
        self.turn * (p - self.origin)
    }

    /// The place that is seen at `q`.
    pub(super) fn back(&self, q: Vec3) -> Vec3 {
        self.back * q + self.origin
    }

    /// The view of a showing's own space.
    pub(super) fn onto(&self, showing: &SolidInstance) -> InstanceProjection {
        let (world, origin) = showing.world();
        InstanceProjection { turn: self.turn * world, shift: self.project(origin), parallel: self.parallel }
    }
}

impl InstanceProjection {
    #[inline]
    pub(super) fn see(&self, p: Vec3) -> Projected {
        let q = self.turn * p + self.shift;
        let share = match () {
            () if self.parallel => 1.0,
            () if q.z > NEAR => 1.0 / q.z,
            () => f32::NAN,
        };
        Projected { q, at: q.truncate() * share }
    }

    /// Box of pixels around places; all of the plane if some lie behind the eye, none if all do.
    #[inline]
    fn frame<const N: usize>(&self, places: &[Projected; N]) -> Option<[Vec2; 2]> {
        let [mut lo, mut hi] = [places.first()?.at; 2];
        for p in places {
            lo = Vec2::new(lesser(lo.x, p.at.x), lesser(lo.y, p.at.y));
            hi = Vec2::new(-lesser(-hi.x, -p.at.x), -lesser(-hi.y, -p.at.y));
        }
        let around = [lo, hi];
        if self.parallel || places.iter().all(|p| p.q.z > NEAR) {
            return Some(around);
        }
        places.iter().any(|p| p.q.z > NEAR).then_some([Vec2::NEG_INFINITY, Vec2::INFINITY])
    }

    /// Columns and rows of a plane of `size` for the box around places. `held`: [`span`] or [`cells`].
    #[inline]
    pub(super) fn window<const N: usize>(
        &self,
        places: &[Projected; N],
        size: [u32; 2],
        held: impl Fn(f32, f32, u32) -> Range<u32>,
    ) -> Option<ScreenRect> {
        let [lo, hi] = self.frame(places)?;
        let columns = held(lo.x, hi.x, size[0]);
        if columns.is_empty() {
            return None;
        }
        let rows = held(lo.y, hi.y, size[1]);
        (!rows.is_empty()).then_some([columns, rows])
    }

    /// The triangle of three places, with pixel coordinates counted from `zero`: small numbers keep their digits. None if
    /// it is seen edge-on.
    /// Source: M. Olano, T. Greer, "Triangle scan conversion using 2D homogeneous coordinates", Graphics Hardware 1997.
    #[inline]
    pub(super) fn patch(&self, corners: &[Projected; 3], zero: Vec2) -> Option<Patch> {
        let [a, b, c] = corners.map(|p| {
            let w = if self.parallel { 1.0 } else { p.q.z };
            Vec3::new(p.q.x - zero.x * w, p.q.y - zero.y * w, w)
        });
        let edges = [b.cross(c), c.cross(a), a.cross(b)];
        let all = a.dot(edges[0]);
        let share = 1.0 / all;
        if !share.is_finite() {
            return None;
        }
        let depth = if self.parallel {
            edges[0] * corners[0].q.z + edges[1] * corners[1].q.z + edges[2] * corners[2].q.z
        } else {
            edges[0] + edges[1] + edges[2]
        };
        let side = if all < 0.0 { -1.0 } else { 1.0 };
        Some(Patch { edges: edges.map(|e| e * side), depth: depth * share })
    }
}

impl Patch {
    /// Not below zero if the triangle covers a pixel, before the eye. No branch depends on it yet: half of all pixels that
    /// are asked for lie inside, so the processor would guess wrong at every other.
    #[inline]
    pub(super) fn inside(&self, x: f32, y: f32) -> f32 {
        let [a, b, c] = self.edges.map(|e| e.x * x + e.y * y + e.z);
        lesser(lesser(a, b), c)
    }

    /// Those of some columns that the triangle may touch between two rows: of a thin slanting one few of its box.
    #[inline]
    pub(super) fn touched(&self, columns: &Range<u32>, [y0, y1]: [f32; 2], zero: u32) -> Range<u32> {
        const FEW: u32 = 3;
        if columns.end - columns.start <= FEW {
            return columns.clone();
        }
        let (mut lo, mut hi) = (f32::NEG_INFINITY, f32::INFINITY);
        for e in &self.edges {
            let bound = -(e.z + (e.y * y0).max(e.y * y1)) / e.x;
            if e.x > 0.0 {
                lo = lo.max(bound);
            } else if e.x < 0.0 {
                hi = hi.min(bound);
            }
        }
        // A little more, as these are rounded.
        let near = cells(lo - 0.01, hi + 0.01, columns.end - zero);
        (near.start + zero).max(columns.start)..(near.end + zero).min(columns.end)
    }

    /// Depth at a pixel along one direction; one over the depth from an eye.
    #[inline]
    pub(super) fn depth(&self, x: f32, y: f32) -> f32 {
        self.depth.x * x + self.depth.y * y + self.depth.z
    }

    /// Weights of the second and third corner at a pixel.
    pub(super) fn weights(&self, x: f32, y: f32) -> Vec2 {
        let [a, b, c] = self.edges.map(|e| e.x * x + e.y * y + e.z);
        Vec2::new(b, c) * (1.0 / (a + b + c))
    }
}

/// Vertices of some triangles in a view, each looked at once.
#[derive(Debug, Default)]
pub(super) struct Vertices {
    first: usize,
    seen: Vec<Projected>,
}

impl Vertices {
    /// Sees the vertices of some faces.
    pub(super) fn see(&mut self, sight: &InstanceProjection, faces: &[Face], mesh: &CornerData<'_>) {
        let used = faces.iter().flat_map(|f| mesh.corners(f));
        let (first, last) = used.fold((usize::MAX, 0), |(lo, hi), i| (lo.min(i), hi.max(i)));
        self.first = first;
        self.seen.clear();
        self.seen.extend(mesh.points.get(first..=last).unwrap_or_default().iter().map(|p| sight.see(*p)));
    }

    /// Corners of a triangle of those seen.
    #[inline]
    pub(super) fn corners(&self, corners: [usize; 3]) -> [Projected; 3] {
        corners.map(|i| self.seen.get(i - self.first).copied().unwrap_or_default())
    }
}

/// One instruction, as neither is NaN.
#[inline]
pub(super) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The whole numbers from `lo` to `hi` that lie in 0..size; empty if there are none.
#[inline]
pub(super) fn span(lo: f32, hi: f32, size: u32) -> Range<u32> {
    let cells = cells(lo, hi, size);
    let beside = u32::from(float(cells.start) < lo);
    (cells.start + beside).min(cells.end)..cells.end
}

/// The cells n to n + 1 of 0..size that the range from `lo` to `hi` touches.
#[inline]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "held to 0..size before")]
pub(super) fn cells(lo: f32, hi: f32, size: u32) -> Range<u32> {
    let end = float(size);
    if !(hi >= 0.0 && lo <= hi && lo < end) {
        return 0..0;
    }
    lo.max(0.0) as u32..(hi as u32).min(size.saturating_sub(1)) + 1
}

/// A small whole number as a float.
#[inline]
#[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
pub(super) fn float(n: u32) -> f32 {
    n as f32
}
