//! The skin of a plant whose skeleton has another pose: every node moved, turned and thickened on its own. Own.

use glam::{Quat, Vec3};

use osier_base::math::{lerp, nlerp, smoothstep};
use osier_scene::plant::{Axis, NONE, Plant, Site};

/// Range of the shift by which a branch moves into a parent that is thinner than at rest, in multiples of the length of branch
/// within the parent. Up to the first multiple arc lengths shrink in proportion to the parent's radius, so that the slanted rings
/// of the collar keep their slant; from there to the second multiple the shift decreases to 0.
const JUNCTION_REACH: [f32; 2] = [2.0, 5.0];
/// Greatest fraction of its length that a branch may have within its parent to be shifted; a branch with a greater one has no collar.
const MOST_INSIDE: f32 = 0.9;

/// A point of the skin or an organ, bound to the skeleton.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrowthBinding {
    /// Index into [`Plant::axes`].
    pub axis: u32,
    /// Arc length on that axis, m.
    pub s: f32,
}

/// Nodes of a plant in a pose, parallel to [`Plant::nodes`].
#[derive(Debug, Clone, Copy)]
pub struct PosedNodes<'a> {
    /// Positions of the nodes in this pose, m, in the plant's space.
    pub p: &'a [Vec3],
    /// Frames of the nodes in this pose: +Y along the axis.
    pub q: &'a [Quat],
    /// Radii, m; 0 for a node that does not exist in this pose.
    pub r: &'a [f32],
}

/// Points and normals of a skin in a pose.
#[derive(Debug, Clone, Default)]
pub struct PosedSkin {
    /// Positions of the vertices in this pose, m.
    pub points: Vec<Vec3>,
    /// Unit normals of the vertices, in the order of `points`; empty if the skin at rest has none.
    pub normals: Vec<Vec3>,
}

/// The skin of a plant in a pose. `points`, `normals`: the skin at rest, with one normal per point or none at all; `bindings`:
/// one per point.
pub fn pose_skin(
    plant: &Plant,
    pose: PosedNodes<'_>,
    points: &[Vec3],
    normals: &[Vec3],
    bindings: &[GrowthBinding],
) -> PosedSkin {
    let mut skin = PosedSkin { points: Vec::with_capacity(points.len()), normals: Vec::with_capacity(normals.len()) };
    for (i, (p, bound)) in points.iter().zip(bindings).enumerate() {
        let shape = &plant.axes[bound.axis as usize];
        let rest = plant.frame(shape, bound.s);
        let now = posed_site(plant, pose, shape, drawn_in(plant, pose, *bound));
        // Rotate the offset from the centreline as the frame rotates, and scale it by the ratio of the radii.
        let turn = (now.q * rest.q.inverse()).normalize();
        skin.points.push(now.p + turn * (*p - rest.p) * (now.r / rest.r.max(f32::MIN_POSITIVE)));
        if let Some(n) = normals.get(i) {
            skin.normals.push(turn * *n);
        }
    }
    skin
}

/// Site, in the pose, of the point of an axis that has the arc length `s`, m, at rest.
fn posed_site(plant: &Plant, pose: PosedNodes<'_>, axis: &Axis, s: f32) -> Site {
    let (i, t) = plant.segment(axis, s);
    Site {
        p: pose.p[i].lerp(pose.p[i + 1], t),
        q: nlerp(pose.q[i], pose.q[i + 1], t),
        r: lerp(pose.r[i], pose.r[i + 1], t),
    }
}

/// Arc length, m, to which a binding moves while the parent of its branch is thinner than at rest. Near its base a branch moves
/// inwards along its axis by the missing thickness of the parent.
fn drawn_in(plant: &Plant, pose: PosedNodes<'_>, bound: GrowthBinding) -> f32 {
    let shape = &plant.axes[bound.axis as usize];
    if shape.parent == NONE {
        return bound.s;
    }
    let parent = &plant.axes[shape.parent as usize];
    let (now, rest) = (posed_site(plant, pose, parent, shape.parent_s), plant.frame(parent, shape.parent_s));
    drawn_by(shape, now.r / rest.r.max(f32::MIN_POSITIVE), bound.s)
}

/// Arc length, m, to which `s` moves on a branch whose parent has the fraction `thickness` of its radius at rest.
pub(crate) fn drawn_by(branch: &Axis, thickness: f32, s: f32) -> f32 {
    let inside = branch.s_exposed;
    if inside <= 0.0 || thickness >= 1.0 || inside > MOST_INSIDE * branch.length {
        return s;
    }
    // The shift ends before the tip, which stays where it is.
    let end = (JUNCTION_REACH[1] * inside).min(branch.length);
    let start = (JUNCTION_REACH[0] * inside).min(0.5 * end);
    let lacking = (1.0 - thickness) * s.min(start);
    s - lacking * (1.0 - smoothstep(start, end, s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::plant::{AxisEnd, AxisKind, Nodes};

    /// A trunk of 2 m along +Y, radius 0.1 m.
    fn trunk() -> Plant {
        let axis = Axis {
            id: 1,
            parent: NONE,
            parent_s: 0.0,
            order: 0,
            kind: AxisKind::Stem,
            first: 0,
            count: 2,
            length: 2.0,
            s_exposed: 0.0,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        };
        let nodes = Nodes {
            p: vec![Vec3::ZERO, Vec3::Y * 2.0],
            q: vec![Quat::IDENTITY; 2],
            r: vec![0.1; 2],
            s: vec![0.0, 2.0],
            birth: vec![0.0, 1.0],
            color: vec![0; 2],
        };
        Plant { axes: vec![axis], nodes, materials: vec!["bark".into()], ..Plant::default() }
    }

    #[test]
    fn the_pose_at_rest_is_the_rest() {
        let plant = trunk();
        let pose = PosedNodes { p: &plant.nodes.p, q: &plant.nodes.q, r: &plant.nodes.r };
        let p = Vec3::new(0.1, 0.5, 0.0);
        let skin = pose_skin(&plant, pose, &[p], &[Vec3::X], &[GrowthBinding { axis: 0, s: 0.5 }]);
        assert!(skin.points[0].distance(p) < 1e-6 && skin.normals[0].distance(Vec3::X) < 1e-6);
    }

    #[test]
    fn wood_that_is_turned_and_half_as_thick_carries_its_skin() {
        let plant = trunk();
        // Tilted by 90 degrees about Z: +Y becomes -X, +X becomes +Y.
        let turn = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
        let (p, q) = ([Vec3::ZERO, Vec3::X * -2.0], [turn; 2]);
        let pose = PosedNodes { p: &p, q: &q, r: &[0.05; 2] };
        let bound = [GrowthBinding { axis: 0, s: 0.5 }];
        let skin = pose_skin(&plant, pose, &[Vec3::new(0.1, 0.5, 0.0)], &[Vec3::X], &bound);
        assert!(skin.points[0].distance(Vec3::new(-0.5, 0.05, 0.0)) < 1e-6, "{}", skin.points[0]);
        assert!(skin.normals[0].distance(Vec3::Y) < 1e-6);
    }
}
