//! A grown axis: the particles that a tip left behind.

use glam::DVec3;

use osier_base::rng::Rng;
use osier_scene::plant::AxisEnd;

/// Parent of a root axis, beyond any index.
pub(super) const ROOT: usize = usize::MAX;

/// A particle that the tip left behind: a node of the axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShapeNode {
    pub p: DVec3,
    /// Unit tangent of growth.
    pub tangent: DVec3,
    /// Unit roll reference, perpendicular to the tangent.
    pub reference: DVec3,
    /// Arc length from the first node of the axis, m.
    pub s: f64,
    /// Growth time at which the tip passed here, counted from the start of the plant, t.
    pub time: f64,
}

/// An axis as growth leaves it, before it has radii.
#[derive(Debug, Clone)]
pub(super) struct ShapeAxis {
    pub id: u64,
    /// Index of the parent among the grown axes, or [`ROOT`].
    pub parent: usize,
    pub parent_s: f64,
    pub ordinal: u64,
    pub level: u8,
    pub forks: u8,
    pub fork: u32,
    /// Length to which the axis was meant to grow, m.
    pub length: f64,
    /// Assumed arc length within its parent, m.
    pub exposed: f64,
    pub end: AxisEnd,
    /// Nodes from the base to the tip, at least two.
    pub nodes: Vec<ShapeNode>,
    /// Arc lengths at which the axis spawns others, m, in ascending order.
    pub sites: Vec<f64>,
}

impl ShapeAxis {
    /// Arc length of the last node, m; below `length` if the axis ended early.
    pub fn grown_length(&self) -> f64 {
        self.nodes.last().map_or(0.0, |n| n.s)
    }

    /// The node at an arc length, m, interpolated between its neighbours and clamped to the ends; the frame is orthonormal.
    pub fn at(&self, s: f64) -> ShapeNode {
        let i = self.nodes.partition_point(|n| n.s <= s).clamp(1, self.nodes.len() - 1);
        let (a, b) = (self.nodes[i - 1], self.nodes[i]);
        let t = if b.s > a.s { ((s - a.s) / (b.s - a.s)).clamp(0.0, 1.0) } else { 0.0 };
        let tangent = a.tangent.lerp(b.tangent, t).try_normalize().unwrap_or(b.tangent);
        let across = a.reference.lerp(b.reference, t);
        let reference = (across - tangent * tangent.dot(across)).try_normalize();
        ShapeNode {
            p: a.p.lerp(b.p, t),
            tangent,
            reference: reference.unwrap_or_else(|| tangent.any_orthonormal_vector()),
            s,
            time: a.time + (b.time - a.time) * t,
        }
    }

    /// With probability `share`, ends the axis at its last site, where its child continues in its place. The draw
    /// depends on `seed` and the id of the axis.
    pub fn lose_apex(&mut self, share: f64, seed: u64) {
        let Some(&last) = self.sites.last().filter(|s| share > 0.0 && **s > 0.0) else { return };
        if Rng::at(seed, &[self.id.into(), "apex".into()]).chance(share) {
            let tip = self.at(last);
            self.nodes.retain(|n| n.s < last);
            self.nodes.push(tip);
        }
    }
}
