//! Vertical outlines extruded along a horizontal line: boxes, walls, houses.

use glam::{Vec2, Vec3};

use super::Nearest;
use osier_base::geometry::Bounds;
use osier_base::math::{cos_f32, sin_f32};

/// A convex outline in the plane of depth and height, extruded along the width.
#[derive(Debug, Clone, PartialEq)]
pub struct Prism {
    /// Middle of the foot, m.
    foot: Vec3,
    /// Level unit vectors along width and depth.
    width: Vec3,
    depth: Vec3,
    /// (depth, height) of the corners, counter-clockwise, m.
    outline: Vec<Vec2>,
    /// Half of the extrusion's width, m.
    half: f32,
}

/// A rectangle around a face, with the directions of rows and columns of a map on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// Its upper left corner seen from outside, m.
    pub corner: Vec3,
    /// Vector along the whole upper edge, to the right as seen from outside, m.
    pub along: Vec3,
    /// Vector from the upper to the lower left corner, m.
    pub down: Vec3,
    /// Unit normal, out of the solid.
    pub normal: Vec3,
}

impl Prism {
    /// A box. `foot`: centre of its lower face; `size`: width, height, depth, m, all > 0; `turn`: rotation about +Y, rad. At 0
    /// the width points along +X, at pi/2 along -Z.
    #[inline]
    pub fn block(foot: Vec3, size: Vec3, turn: f32) -> Self {
        let (h, d) = (size.y, size.z / 2.0);
        let outline = [(-d, 0.0), (d, 0.0), (d, h), (-d, h)];
        Self::new(foot, turn, size.x, &outline)
    }

    /// A house with a gable roof whose ridge runs along its width. `size`: width, height of the eaves, depth, m, all > 0;
    /// `roof`: height of the ridge over the eaves, m, > 0.
    #[inline]
    pub fn house(foot: Vec3, size: Vec3, roof: f32, turn: f32) -> Self {
        let (h, d) = (size.y, size.z / 2.0);
        let outline = [(-d, 0.0), (d, 0.0), (d, h), (0.0, h + roof), (-d, h)];
        Self::new(foot, turn, size.x, &outline)
    }

    /// The slabs of the roof of a house, which project from its walls; empty for a box. They run from the ridge past eaves and gables by
    /// `overhang`, m, and from the surface of the roof down by `thickness`, m.
    pub fn roof_slabs(&self, overhang: f32, thickness: f32) -> Vec<Self> {
        let [_, _, front, ridge, back] = self.outline[..] else { return Vec::new() };
        let slab = |eave: Vec2| {
            let down = (eave - ridge).normalize();
            let low = eave + down * overhang;
            // Across the slab, into the house; the corners are counter-clockwise on either side of the ridge.
            let across = Vec2::new(down.y, -down.x) * thickness;
            let outline = if across.y < 0.0 {
                vec![ridge, ridge + across, low + across, low]
            } else {
                vec![ridge, low, low - across, ridge - across]
            };
            Self { outline, half: self.half + overhang, ..self.clone() }
        };
        [front, back].map(slab).into()
    }

    fn new(foot: Vec3, turn: f32, width: f32, outline: &[(f32, f32)]) -> Self {
        // Quarter turns are exact, so that walls along an axis stay on their cells.
        let [sin, cos] = [sin_f32(turn), cos_f32(turn)].map(|v| if v.abs() < 1e-6 { 0.0 } else { v });
        Self {
            foot,
            width: Vec3::new(cos, 0.0, -sin),
            depth: Vec3::new(sin, 0.0, cos),
            outline: outline.iter().map(|(d, h)| Vec2::new(*d, *h)).collect(),
            half: width / 2.0,
        }
    }

    /// Corners of both ends, m: those of the outline at +width, then at -width, counter-clockwise seen from -width.
    #[inline]
    pub fn ends(&self) -> [Vec<Vec3>; 2] {
        [self.half, -self.half].map(|along| self.outline.iter().map(|p| self.world(*p, along)).collect())
    }

    /// Rectangles of its vertical faces, at +depth, -depth, +width, -width; those of gables reach up to the ridge.
    pub fn sides(&self) -> [Side; 4] {
        let b = self.outline.iter().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        let eaves = self.outline.iter().filter(|p| p.x > b.1.x - 1e-6).map(|p| p.y).fold(0.0, f32::max);
        let size = b.1 - b.0;
        let front = |sign: f32| Side {
            // `along` points to the right when the side is seen from outside.
            corner: self.foot + self.depth * (size.x / 2.0 * sign) - self.width * (self.half * sign) + Vec3::Y * eaves,
            along: self.width * (2.0 * self.half * sign),
            down: -Vec3::Y * eaves,
            normal: self.depth * sign,
        };
        let end = |sign: f32| Side {
            corner: self.foot + self.width * (self.half * sign) + self.depth * (size.x / 2.0 * sign) + Vec3::Y * b.1.y,
            along: self.depth * (-size.x * sign),
            down: -Vec3::Y * b.1.y,
            normal: self.width * sign,
        };
        [front(1.0), front(-1.0), end(1.0), end(-1.0)]
    }

    /// Its horizontal bounding rectangle at the height of its highest edge: rows along the width, columns along the depth. `roof`: its
    /// own slabs, of [`Prism::roof_slabs`], which the rectangle holds too.
    pub fn plan(&self, roof: &[&Self]) -> Side {
        // The slabs of a roof have the axes of their house.
        let corners = roof.iter().flat_map(|slab| &slab.outline).chain(&self.outline);
        let (low, high) = corners.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        let half = roof.iter().fold(self.half, |half, slab| half.max(slab.half));
        Side {
            corner: self.world(Vec2::new(low.x, high.y), -half),
            along: self.width * (2.0 * half),
            down: self.depth * (high.x - low.x),
            normal: Vec3::Y,
        }
    }

    fn world(&self, p: Vec2, along: f32) -> Vec3 {
        self.foot + self.width * along + self.depth * p.x + Vec3::Y * p.y
    }

    pub(super) fn bounds(&self) -> Bounds {
        Bounds::of(self.ends().into_iter().flatten())
    }

    /// Whether a segment meets the prism grown by `slack`, m, on every side.
    /// Source: M. Cyrus, J. Beck, "Generalized two- and three-dimensional clipping", 1978.
    pub(super) fn meets(&self, [from, to]: [Vec3; 2], slack: f32) -> bool {
        // Split the ends of the segment into coordinates along the width and in the plane of the outline. A point of the segment
        // is from + t (to - from), t from 0 to 1.
        let plane = |p: Vec3| Vec2::new((p - self.foot).dot(self.depth), p.y - self.foot.y);
        let (a, b) = (plane(from), plane(to));
        let (along_a, along_b) = ((from - self.foot).dot(self.width), (to - self.foot).dot(self.width));
        let ends = [(along_a - self.half, along_b - self.half), (-along_a - self.half, -along_b - self.half)];
        let edges = self.outline.iter().enumerate().map(|(i, p)| {
            let normal = edge_normal(*p, self.outline[(i + 1) % self.outline.len()]);
            ((a - *p).dot(normal), (b - *p).dot(normal))
        });
        // Clip the part of the segment within reach against each face: distances of both ends from it, outwards.
        // The segment is inside between the last entry and the first exit.
        let (mut enter, mut leave) = (0.0_f32, 1.0_f32);
        for (start, end) in ends.into_iter().chain(edges) {
            let (start, end) = (start - slack, end - slack);
            if start > 0.0 && end > 0.0 {
                return false;
            }
            if start > 0.0 {
                enter = enter.max(start / (start - end));
            } else if end > 0.0 {
                leave = leave.min(start / (start - end));
            }
        }
        enter <= leave
    }

    pub(super) fn nearest(&self, at: Vec3) -> Nearest {
        let from = at - self.foot;
        let along = from.dot(self.width);
        let (side, out) = outline(&self.outline, Vec2::new(from.dot(self.depth), from.y));
        // Signed distance from the nearer end face.
        let over = along.abs() - self.half;
        let end = self.width * if along < 0.0 { -1.0 } else { 1.0 };
        let out = self.depth * out.x + Vec3::Y * out.y;
        // The point lies outside both an end face and a side face: take the distance to their common edge.
        if side > 0.0 && over > 0.0 {
            let away = Vec2::new(side, over);
            let distance = away.length();
            return Nearest { distance, normal: (out * side + end * over) / distance };
        }
        if side > over { Nearest { distance: side, normal: out } } else { Nearest { distance: over, normal: end } }
    }
}

/// Signed distance of a point from a convex counter-clockwise outline, negative inside, and the outward unit normal at the
/// nearest point of the outline.
fn outline(corners: &[Vec2], p: Vec2) -> (f32, Vec2) {
    let mut inside = (f32::NEG_INFINITY, Vec2::Y);
    let mut outside = (f32::INFINITY, Vec2::Y);
    for (i, a) in corners.iter().enumerate() {
        let next = corners[(i + 1) % corners.len()];
        let (edge, normal) = (next - *a, edge_normal(*a, next));
        // Inside of a convex outline the nearest edge is that with the largest signed distance.
        let depth = (p - *a).dot(normal);
        if depth > inside.0 {
            inside = (depth, normal);
        }
        let share = ((p - *a).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let away = p - *a - edge * share;
        let distance = away.length();
        if distance < outside.0 {
            // For a point on the edge the direction from the nearest point is undefined: take the normal of the edge.
            outside = (distance, if distance > 1e-6 { away / distance } else { normal });
        }
    }
    if inside.0 <= 0.0 { inside } else { outside }
}

/// Unit normal, outwards, of the edge of a counter-clockwise outline from `a` to `b`.
fn edge_normal(a: Vec2, b: Vec2) -> Vec2 {
    Vec2::new(b.y - a.y, a.x - b.x).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn house() -> Prism {
        Prism::house(Vec3::new(3.0, 0.0, -2.0), Vec3::new(10.0, 5.0, 8.0), 3.0, 0.4)
    }

    #[test]
    fn slabs_of_a_roof_lie_under_its_surface_and_project_from_the_walls() {
        let (house, across) = (house(), Vec2::new(3.0, 4.0).normalize());
        let slabs = house.roof_slabs(0.35, 0.16);
        assert!(slabs.len() == 2 && Prism::block(Vec3::ZERO, Vec3::ONE, 0.0).roof_slabs(0.35, 0.16).is_empty());
        // From the ridge down a slope of 3 in 4, on both sides.
        for (slab, side) in slabs.iter().zip([1.0, -1.0]) {
            let at = |down: f32, deep: f32, along: f32| {
                let p = Vec2::new(0.8 * down * side, 8.0 - 0.6 * down) - Vec2::new(across.x * side, across.y) * deep;
                slab.nearest(house.world(p, along)).distance
            };
            for (down, deep, along, distance) in [
                (2.0, 0.08, 0.0, -0.08),
                (2.0, 0.26, 0.0, 0.1),
                (2.0, -0.1, 0.0, 0.1),
                (5.3, 0.08, 0.0, -0.05),
                (5.45, 0.08, 0.0, 0.1),
                (2.0, 0.08, 5.3, -0.05),
                (2.0, 0.08, -5.45, 0.1),
            ] {
                let found = at(down, deep, along);
                assert!((found - distance).abs() < 1e-4, "{side}: {down} {deep} {along}: {found}, not {distance}");
            }
        }
    }

    /// Distance by trying every triangle's points is what the closed form says.
    #[test]
    fn distances_are_those_to_the_nearest_point() {
        let house = house();
        let [a, b] = house.ends();
        let mut surface = Vec::new();
        let n = 60_u16;
        let mut quad = |c: [Vec3; 4]| {
            for i in 0..=n {
                for j in 0..=n {
                    let (u, v) = (f32::from(i) / f32::from(n), f32::from(j) / f32::from(n));
                    surface.push(c[0].lerp(c[1], u).lerp(c[3].lerp(c[2], u), v));
                }
            }
        };
        for i in 0..a.len() {
            let k = (i + 1) % a.len();
            quad([a[i], a[k], b[k], b[i]]);
        }
        for end in [&a, &b] {
            quad([end[0], end[1], end[2], end[4]]);
            quad([end[4], end[2], end[3], end[3]]);
        }
        for i in 0..300_u16 {
            let f = f32::from(i);
            let at = Vec3::new(3.0 + (f * 0.37) % 16.0 - 8.0, (f * 0.21) % 11.0 - 1.0, -2.0 + (f * 0.53) % 14.0 - 7.0);
            let near = house.nearest(at);
            let sampled = surface.iter().map(|p| p.distance(at)).fold(f32::INFINITY, f32::min);
            assert!((near.distance.abs() - sampled).abs() < 0.1, "{at}: {near:?} against {sampled}");
            assert!((near.normal.length() - 1.0).abs() < 1e-5);
            let out = house.nearest(at - near.normal * near.distance);
            assert!(out.distance.abs() < 1e-4, "{at} leads to {out:?}");
        }
    }

    #[test]
    fn sides_lie_on_the_surface_and_look_out() {
        for side in house().sides() {
            assert!((side.down.cross(side.along).normalize() - side.normal).length() < 1e-5, "{side:?}");
            let middle = side.corner + side.along * 0.5 + side.down * 0.9;
            let near = house().nearest(middle);
            assert!(near.distance.abs() < 1e-4 && near.normal.distance(side.normal) < 1e-4, "{side:?} {near:?}");
        }
    }

    #[test]
    fn segments_meet_a_prism_where_their_points_are_inside() {
        let house = house();
        let mut met = 0;
        for i in 0..400_u16 {
            let f = f32::from(i);
            let at = |s: f32| {
                Vec3::new(
                    3.0 + (f * 0.37 * s) % 16.0 - 8.0,
                    (f * 0.21 * s) % 11.0 - 1.0,
                    -2.0 + (f * 0.53) % 14.0 - 7.0,
                )
            };
            let (from, to) = (at(1.0), at(1.7));
            let inside = (0..=1000).map(|k| house.nearest(from.lerp(to, k as f32 / 1000.0)).distance);
            let nearest = inside.fold(f32::INFINITY, f32::min);
            let meets = house.meets([from, to], 0.0);
            met += usize::from(meets);
            // Segments that graze an edge may go either way at this sampling.
            assert!(nearest.abs() < 0.02 || meets == (nearest < 0.0), "{from} {to}: {meets}, {nearest}");
            assert!(nearest > 0.4 || house.meets([from, to], 0.4), "{from} {to}: {nearest}");
        }
        assert!((50..350).contains(&met), "{met}");
    }
}
