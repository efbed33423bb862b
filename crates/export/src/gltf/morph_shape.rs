//! A shape of a mesh at a frame, compared with others before it becomes a morph target.

use glam::Vec3;

/// Points and normals of a mesh at a frame; normals may be missing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MorphShape {
    pub points: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    /// Whether each point is hidden, so that its position does not matter; empty: all are visible.
    pub unseen: Vec<bool>,
}

impl MorphShape {
    /// Whether all visible points lie within `tolerance`, m, of the interpolation between two shapes. `share`: 0 for
    /// `from`, 1 for `to`.
    pub(super) fn lies_between(&self, from: &Self, to: &Self, share: f32, tolerance: f32) -> bool {
        self.distances_between(from, to, share).all(|distance| distance <= tolerance)
    }

    /// Largest distance of a visible point from the interpolation between two shapes, m. `share`: as in
    /// [`Self::lies_between`].
    pub(super) fn distance_between(&self, from: &Self, to: &Self, share: f32) -> f32 {
        self.distances_between(from, to, share).fold(0.0, f32::max)
    }

    fn distances_between(&self, from: &Self, to: &Self, share: f32) -> impl Iterator<Item = f32> {
        let ways = self.points.iter().zip(&from.points).zip(&to.points).enumerate();
        let seen = ways.filter(|(i, _)| self.unseen.get(*i) != Some(&true));
        seen.map(move |(_, ((p, a), b))| p.distance(a.lerp(*b, share)))
    }
}
