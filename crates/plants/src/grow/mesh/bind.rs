//! What of the artist's mesh hangs where on the plant.

use glam::Vec3;

use super::axes::{ClusterSite, NODES_PER_CLUSTER};
use super::wood_search::{WoodSample, WoodSearch};
use osier_scene::plant::Plant;

/// A vertex is sought so many clusters up and down its axis.
const WINDOW: usize = 2;
/// Places per radius along an axis.
const SAMPLES_PER_RADIUS: f32 = 0.5;

/// Axis and arc length, m.
pub(super) type Site = (u32, f32);

/// Where on its cluster's axis a vertex is.
pub(super) fn vertex_site(plant: &Plant, seat: ClusterSite, p: Vec3) -> Site {
    let axis = &plant.axes[seat.axis as usize];
    let nodes = plant.nodes_of(axis);
    let own = nodes.start + seat.node as usize;
    let from = own.saturating_sub(WINDOW * NODES_PER_CLUSTER).clamp(nodes.start, nodes.end - 2);
    let to = (own + WINDOW * NODES_PER_CLUSTER).clamp(from + 1, nodes.end - 1);
    let mut best = (f32::INFINITY, 0.0);
    for k in from..to {
        let (a, b) = (plant.nodes.p[k], plant.nodes.p[k + 1]);
        let along = b - a;
        let t = ((p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        let d = p.distance_squared(a + along * t);
        if d < best.0 {
            best = (d, osier_base::math::lerp(plant.nodes.s[k], plant.nodes.s[k + 1], t));
        }
    }
    (seat.axis, best.1)
}

/// Places along all axes.
pub(super) fn wood_search(plant: &Plant) -> WoodSearch<Site> {
    let mut places = Vec::new();
    for (i, axis) in (0..).zip(&plant.axes) {
        for k in plant.nodes_of(axis).skip(1) {
            let (s0, s1) = (plant.nodes.s[k - 1], plant.nodes.s[k]);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 64")]
            let steps = ((s1 - s0) / (SAMPLES_PER_RADIUS * plant.nodes.r[k]).max(f32::MIN_POSITIVE))
                .ceil()
                .clamp(1.0, 64.0) as u16;
            places.extend((0..=steps).map(|j| {
                let s = osier_base::math::lerp(s0, s1, f32::from(j) / f32::from(steps));
                let at = plant.frame(axis, s);
                WoodSample { p: at.p, r: at.r, what: (i, s) }
            }));
        }
    }
    WoodSearch::new(places)
}

/// Where a loose part hangs: on the bark that any of its points is nearest to. That point, the way there, m, and the
/// place.
pub(super) fn nearest_wood(near: &WoodSearch<Site>, points: &[Vec3]) -> Option<(usize, f32, Site)> {
    let found = points.iter().enumerate().filter_map(|(i, p)| {
        let (gap, site) = near.nearest(*p)?;
        Some((i, gap, site))
    });
    found.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
}
