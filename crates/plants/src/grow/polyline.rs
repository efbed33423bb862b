//! Appends polylines to a plant as axes, with arc lengths and rotation-minimizing frames.

use glam::{Mat3, Quat, Vec3};

use osier_base::math;
use osier_scene::plant::{Axis, AxisEnd, AxisKind, Plant};

/// Id, attachment and order of an axis to be added.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewAxis {
    pub id: u64,
    /// Index of the parent axis, or `plant::NONE`.
    pub parent: u32,
    /// Arc length of the attachment on the parent, m.
    pub parent_s: f32,
    /// Branching order, 0 for roots.
    pub order: u8,
    /// Number of the fork that it belongs to, or `plant::NONE`.
    pub fork: u32,
}

/// Appends an axis along a polyline. `radius`: by index of the point, m; `color`: colour index of all its nodes.
pub(super) fn push_axis(plant: &mut Plant, axis: NewAxis, points: &[Vec3], radius: impl Fn(usize) -> f32, color: u16) {
    let first = node_index(plant.nodes.len());
    let length = push_nodes(plant, axis.parent, points, radius, color);
    plant.axes.push(Axis {
        id: axis.id,
        parent: axis.parent,
        parent_s: axis.parent_s,
        order: axis.order,
        kind: AxisKind::Stem,
        first,
        count: node_index(points.len()),
        length,
        s_exposed: 0.0,
        material: 0,
        fork: axis.fork,
        end: AxisEnd::Tip,
        birth: 0.0,
    });
}

/// A number of nodes in 32 bits. Nodes come from words and clusters, which are limited to some millions.
#[allow(clippy::cast_possible_truncation, reason = "words and clusters are limited to some millions")]
fn node_index(n: usize) -> u32 {
    n as u32
}

/// Appends the nodes of an axis; returns its length, m. `radius`: by index of the point, m; `parent`: index of the parent axis.
fn push_nodes(plant: &mut Plant, parent: u32, points: &[Vec3], radius: impl Fn(usize) -> f32, color: u16) -> f32 {
    let parent_tangent = plant.axes.get(parent as usize).map_or(Vec3::Z, |a| plant.nodes.q[a.first as usize] * Vec3::Y);
    // Arc length, frame, radius and colour of every node; birth is 0, since only derivations have a time.
    let mut s = 0.0;
    for (i, (p, q)) in points.iter().zip(frames(points, parent_tangent)).enumerate() {
        // Arc lengths are those of the stored, rounded positions.
        s += if i > 0 { p.distance(points[i - 1]) } else { 0.0 };
        plant.nodes.p.push(*p);
        plant.nodes.q.push(q);
        plant.nodes.r.push(radius(i));
        plant.nodes.s.push(s);
        plant.nodes.birth.push(0.0);
        plant.nodes.color.push(color);
    }
    s
}

/// Rotation-minimizing frames along a polyline (double reflection), Y along the bisector of both segments. X of the first frame
/// is perpendicular to `parent_tangent`, so that a branch does not twist where it leaves.
fn frames(points: &[Vec3], parent_tangent: Vec3) -> Vec<Quat> {
    let last = points.len() - 1;
    let dir = |i: usize| math::normalize_or(points[i + 1] - points[i], Vec3::Y);
    // Each end has only one segment, whose direction is its tangent.
    let tangent = |i: usize| match i {
        0 => dir(0),
        i if i == last => dir(last - 1),
        i => math::normalize_or(dir(i - 1) + dir(i), dir(i)),
    };
    let mut x = math::normalize_or(tangent(0).cross(parent_tangent), math::perpendicular(tangent(0)));
    let mut out = Vec::with_capacity(points.len());
    for i in 0..=last {
        let t = tangent(i);
        if i > 0 {
            // Carry X from node to node without a turn about the tangent.
            x = math::transport(points[i - 1], tangent(i - 1), x, points[i], t);
        }
        out.push(Quat::from_mat3(&Mat3::from_cols(x, t, x.cross(t))).normalize());
    }
    out
}
