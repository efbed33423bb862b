//! Crown guide: points in the envelope that pull the nearest tips and vanish when they are reached.
//! Source: Runions, Lane, Prusinkiewicz, Modeling trees with a space colonization algorithm (2007).

use glam::DVec3;

use super::region::Region;
use osier_base::math::narrow;
use osier_base::neighbours::NeighbourGrid;
use osier_base::rng::Rng;

/// Points that are drawn in an envelope; fewer result if it fills little of its box.
const POINTS: u64 = 2000;
/// Draws per point before an envelope counts as too thin to hold points.
const MAX_TRIES: u32 = 64;
/// Distance within which a point pulls tips, m.
const PULL_REACH: f64 = 1.5;
/// Distance from a new node within which a point vanishes, m.
const KILL_REACH: f64 = 0.3;

/// Points of the envelope that no axis has reached yet; they pull the tips of axes.
#[derive(Debug, Clone, Default)]
pub struct CrownGuide {
    points: Vec<DVec3>,
}

impl CrownGuide {
    /// Points drawn uniformly in an envelope; an envelope without bounds gets none. `plant`: id of the plant; `seed`:
    /// seed of the draws.
    pub fn new(envelope: &Region, plant: u32, seed: u64) -> Self {
        let Some((low, high)) = envelope.bounds() else { return Self::default() };
        let draw = |i: u64| {
            let mut draws = Rng::at(seed, &[plant.into(), "guide".into(), i.into()]);
            (0..MAX_TRIES).find_map(|_| {
                let u = DVec3::new(draws.unit_f64(), draws.unit_f64(), draws.unit_f64());
                let p = low + (high - low) * u;
                (envelope.distance(p) <= 0.0).then_some(p)
            })
        };
        Self { points: (0..POINTS).filter_map(draw).collect() }
    }

    /// For each tip, the normalised sum of unit vectors to the points whose nearest tip it is; zero without such points.
    pub fn pulls(&self, tips: &[DVec3]) -> Vec<DVec3> {
        let single = |p: &DVec3| glam::Vec3::from_array(p.to_array().map(narrow));
        let grid = NeighbourGrid::new(narrow(PULL_REACH), (0_u32..).zip(tips).map(|(i, p)| (i, single(p))));
        let mut pulls = vec![DVec3::ZERO; tips.len()];
        for point in &self.points {
            // The grid works in single precision; the distance is tested again in double precision.
            let near = grid.nearest(single(point), narrow(PULL_REACH), |i| single(&tips[i as usize]));
            let within = near.map(|i| (i as usize, *point - tips[i as usize])).filter(|n| n.1.length() <= PULL_REACH);
            if let Some((i, to)) = within {
                pulls[i] += to.try_normalize().unwrap_or_default();
            }
        }
        pulls.into_iter().map(|p| p.try_normalize().unwrap_or_default()).collect()
    }

    /// Removes the points within `KILL_REACH` of new nodes.
    pub fn reach(&mut self, nodes: &[DVec3]) {
        let single = |p: &DVec3| glam::Vec3::from_array(p.to_array().map(narrow));
        let grid = NeighbourGrid::new(narrow(KILL_REACH), (0_u32..).zip(nodes).map(|(i, p)| (i, single(p))));
        self.points.retain(|p| {
            let near = grid.nearest(single(p), narrow(KILL_REACH), |i| single(&nodes[i as usize]));
            near.is_none_or(|i| p.distance(nodes[i as usize]) > KILL_REACH)
        });
    }
}
