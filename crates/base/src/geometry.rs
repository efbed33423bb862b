//! Boxes and polygons.

use glam::{Vec2, Vec3};

/// An axis-aligned box; empty until a point is added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Corner with the smallest coordinates, m; +infinity in an empty box.
    pub min: Vec3,
    /// Corner with the largest coordinates, m; -infinity in an empty box.
    pub max: Vec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY }
    }
}

impl Bounds {
    /// Box of some points; empty for none.
    #[inline]
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::default(), |b, p| b.with(p))
    }

    /// The box grown to hold `p`.
    #[must_use]
    #[inline]
    pub fn with(self, p: Vec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box that holds both; an empty one adds nothing.
    #[must_use]
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The box expanded by `d` on every side; an empty box stays empty.
    #[must_use]
    #[inline]
    pub fn expanded(self, d: f32) -> Self {
        if self.is_empty() { self } else { Self { min: self.min - Vec3::splat(d), max: self.max + Vec3::splat(d) } }
    }

    /// True if no point was added, that is if the minimum exceeds the maximum.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.min.x > self.max.x
    }

    /// The eight corners, x changing fastest, then y, then z.
    #[inline]
    pub fn corners(&self) -> [Vec3; 8] {
        let (a, b) = (self.min, self.max);
        std::array::from_fn(|i| {
            let pick = |bit: usize, lo: f32, hi: f32| if i & bit == 0 { lo } else { hi };
            Vec3::new(pick(1, a.x, b.x), pick(2, a.y, b.y), pick(4, a.z, b.z))
        })
    }

    /// Midpoint of the corners, m; the origin for an empty box.
    #[inline]
    pub fn center(&self) -> Vec3 {
        if self.is_empty() { Vec3::ZERO } else { (self.min + self.max) * 0.5 }
    }

    /// Side lengths along x, y and z, m; zero for an empty box.
    #[inline]
    pub fn size(&self) -> Vec3 {
        if self.is_empty() { Vec3::ZERO } else { self.max - self.min }
    }
}

/// Newell normal of a polygon (not normalised; its length is twice the area).
#[inline]
pub fn newell(points: &[Vec3]) -> Vec3 {
    // The sum of the cross products of successive position vectors; the origin cancels over a closed outline.
    let n = points.len();
    (0..n).fold(Vec3::ZERO, |s, i| s + points[i].cross(points[(i + 1) % n]))
}

/// Triangles of a simple polygon by ear clipping, as indices into `outline`, each in the same sense of rotation as the
/// outline; empty if the polygon has no area.
#[inline]
pub fn triangulate(outline: &[Vec2]) -> Vec<[u32; 3]> {
    let flat: Vec<f32> = outline.iter().flat_map(|p| [p.x, p.y]).collect();
    let Ok(indices) = earcutr::earcut(&flat, &[], 2) else { return Vec::new() };
    // Outlines have fewer than 2^32 corners: earcut would not end on more.
    #[allow(clippy::cast_possible_truncation, reason = "indices into an outline of fewer corners")]
    let index = |i: usize| i as u32;
    // The shoelace sum, twice the signed area: its sign is the sense of rotation of the outline.
    let area: f32 = (0..outline.len()).fold(0.0, |s, i| s + outline[i].perp_dot(outline[(i + 1) % outline.len()]));
    let side = |t: &[usize]| (outline[t[1]] - outline[t[0]]).perp_dot(outline[t[2]] - outline[t[0]]);
    // Triangles of the opposite sense are reversed, whatever order the library returns.
    let orient = |t: &[usize]| {
        let flip = side(t) * area < 0.0;
        if flip { [index(t[0]), index(t[2]), index(t[1])] } else { [index(t[0]), index(t[1]), index(t[2])] }
    };
    indices.chunks_exact(3).map(orient).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_concave_polygon_keeps_its_area_and_side() {
        let outline = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0)].map(|(x, y)| Vec2::new(x, y));
        let triangles = triangulate(&outline);
        let at = |i: u32| outline[i as usize];
        let areas: Vec<f32> =
            triangles.iter().map(|t| (at(t[1]) - at(t[0])).perp_dot(at(t[2]) - at(t[0])) / 2.0).collect();
        assert!(areas.iter().all(|a| *a > 0.0));
        assert!((areas.iter().fold(0.0, |s, a| s + a) - 2.5).abs() < 1e-6);
    }

    #[test]
    fn bounds_grow() {
        let b = Bounds::of([Vec3::ZERO, Vec3::new(1.0, -2.0, 3.0)]);
        assert_eq!(b.size(), Vec3::new(1.0, 2.0, 3.0));
        assert!(Bounds::default().expanded(1.0).is_empty());
        assert_eq!(b.corners().len(), 8);
    }
}
