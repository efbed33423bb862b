//! Binds vertices and loose parts of the artist's mesh to positions on the axes of the plant.

use glam::Vec3;

use super::axes::{ClusterSite, NODES_PER_CLUSTER};
use super::wood_search::{WoodSample, WoodSearch};
use osier_scene::plant::Plant;

/// A vertex is projected onto the axis within this many clusters of the one that it belongs to: enough for clusters that overlap,
/// too few to jump to another bend of the axis.
const WINDOW: usize = 2;
/// Spacing of samples along an axis, in radii.
const SAMPLE_SPACING_RADII: f32 = 0.5;

/// Position on an axis: index of the axis in the plant, and arc length, m.
pub(super) type AxisPosition = (u32, f32);

/// The point of the axis nearest to a vertex, within `WINDOW` clusters of the vertex's cluster.
pub(super) fn vertex_site(plant: &Plant, site: ClusterSite, p: Vec3) -> AxisPosition {
    let axis = &plant.axes[site.axis as usize];
    let nodes = plant.nodes_of(axis);
    let own = nodes.start + site.node as usize;
    let from = own.saturating_sub(WINDOW * NODES_PER_CLUSTER).clamp(nodes.start, nodes.end - 2);
    let to = (own + WINDOW * NODES_PER_CLUSTER).clamp(from + 1, nodes.end - 1);
    let mut best = (f32::INFINITY, 0.0);
    for k in from..to {
        // Orthogonal projection onto the segment, clamped to its ends.
        let (a, b) = (plant.nodes.p[k], plant.nodes.p[k + 1]);
        let along = b - a;
        let t = ((p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        let d = p.distance_squared(a + along * t);
        if d < best.0 {
            best = (d, osier_base::math::lerp(plant.nodes.s[k], plant.nodes.s[k + 1], t));
        }
    }
    (site.axis, best.1)
}

/// Search for the nearest bark, over samples of all axes half a radius apart.
pub(super) fn wood_search(plant: &Plant) -> WoodSearch<AxisPosition> {
    let mut places = Vec::new();
    for (i, axis) in (0..).zip(&plant.axes) {
        for k in plant.nodes_of(axis).skip(1) {
            let (s0, s1) = (plant.nodes.s[k - 1], plant.nodes.s[k]);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 64")]
            // Samples half a radius apart, so that the nearest one is right to a small share of the radius.
            let steps = ((s1 - s0) / (SAMPLE_SPACING_RADII * plant.nodes.r[k]).max(f32::MIN_POSITIVE))
                .ceil()
                .clamp(1.0, 64.0) as u16;
            places.extend((0..=steps).map(|j| {
                let s = osier_base::math::lerp(s0, s1, f32::from(j) / f32::from(steps));
                let at = plant.frame(axis, s);
                WoodSample { p: at.p, r: at.r, owner: (i, s) }
            }));
        }
    }
    WoodSearch::new(places)
}

/// Attachment of a loose part: the closest pair of one of its points and the bark. Returns the index of the point, the distance,
/// m, and the position on the axis; `None` without axes or points.
pub(super) fn nearest_point_of_part(
    near: &WoodSearch<AxisPosition>,
    points: &[Vec3],
) -> Option<(usize, f32, AxisPosition)> {
    // The closest of all points of the part; equal distances go to the lower index.
    let found = points.iter().enumerate().filter_map(|(i, p)| {
        let (gap, site) = near.nearest(*p)?;
        Some((i, gap, site))
    });
    found.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
}
