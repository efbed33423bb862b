//! A shape of a mesh, as it is compared with others before it becomes a target.

use glam::Vec3;

/// Points and normals of a mesh at a frame; normals may be missing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MorphShape {
    pub points: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    /// Points that are not seen, which may lie anywhere; empty: all are seen.
    pub unseen: Vec<bool>,
}

impl MorphShape {
    /// Whether all points that are seen lie within `tolerance`, m, of those at `share` of the way between two shapes.
    pub(super) fn lies_between(&self, from: &Self, to: &Self, share: f32, tolerance: f32) -> bool {
        self.distances_between(from, to, share).all(|distance| distance <= tolerance)
    }

    /// Most that a point that is seen lies off its place at `share` of the way between two shapes, m.
    pub(super) fn distance_between(&self, from: &Self, to: &Self, share: f32) -> f32 {
        self.distances_between(from, to, share).fold(0.0, f32::max)
    }

    fn distances_between(&self, from: &Self, to: &Self, share: f32) -> impl Iterator<Item = f32> {
        let ways = self.points.iter().zip(&from.points).zip(&to.points).enumerate();
        let seen = ways.filter(|(i, _)| self.unseen.get(*i) != Some(&true));
        seen.map(move |(_, ((p, a), b))| p.distance(a.lerp(*b, share)))
    }
}
