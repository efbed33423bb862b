//! Shelter: finds emitted drops that would have struck a solid or the land above the height at which rain is emitted.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::rain::fall::{EmittedDrop, sample_wind, sphere_diameter, terminal_speed};
use crate::rain::ground::GroundHeight;
use crate::rain::solids::RainSolids;
use crate::rain::tuning::{MAX_SHELTER_STEPS, SHELTER_STEP};
use osier_base::math;
use osier_base::physics::GRAVITY;
use osier_wind::Wind;

/// Solids and ground above the emission plane, which block drops on their way down to it.
#[derive(Debug, Clone)]
pub(crate) struct Shelter {
    solids: RainSolids,
    ground: Arc<dyn GroundHeight>,
    /// Greatest height of solids and ground, m.
    top: f64,
    /// Gravity along -Y, m/s^2.
    g: f64,
}

impl Shelter {
    /// Shelter by solids and by ground from drops that fall under gravity `g`, m/s^2. Costs nothing in scenes in which both lie below
    /// the positions of the drops.
    pub(crate) fn new(solids: RainSolids, ground: Arc<dyn GroundHeight>, g: f64) -> Self {
        let top = solids.height_range().map_or(f64::NEG_INFINITY, |[_, high]| high).max(ground.max_height());
        Self { solids, ground, top, g }
    }

    /// Removes the drops that cannot reach their position of emission because solids or ground block their path.
    /// `t`: time, s, of emission.
    pub(crate) fn retain_unsheltered(&self, drops: &mut Vec<EmittedDrop>, wind: Option<&dyn Wind>, t: f64) {
        let mut sheltered = self.find_blocked_drops(drops, wind, t).into_iter();
        drops.retain(|_| !sheltered.next().unwrap_or(false));
    }

    /// Whether solids or ground block the path of each drop to its position. `t`: the time at which the drops are there, s.
    pub(crate) fn find_blocked_drops(&self, drops: &[EmittedDrop], wind: Option<&dyn Wind>, t: f64) -> Vec<bool> {
        // Most scenes have no solids and ground above the emission plane.
        if drops.iter().all(|d| d.p.y >= self.top) {
            return vec![false; drops.len()];
        }
        // Follow all drops backwards in time up to the greatest height of solids and ground, at terminal speed in the wind of
        // that time. A drop whose path crosses a face or the ground never arrives.
        // Under lower gravity drops fall more slowly and the steps are longer, so that the same number of steps reaches as high.
        let h = SHELTER_STEP * math::sqrt(GRAVITY / self.g);
        let mut tracks: Vec<BackwardPath> = drops.iter().map(|drop| BackwardPath::new(drop, self.g)).collect();
        for step in 0..MAX_SHELTER_STEPS {
            let mut open: Vec<&mut BackwardPath> =
                tracks.iter_mut().filter(|k| k.may_meet_surface_below(self.top)).collect();
            if open.is_empty() {
                break;
            }
            let positions: Vec<Vec3> = open.iter().map(|k| k.p.as_vec3()).collect();
            let air = sample_wind(wind, &positions, t - f64::from(step) * h);
            for (track, air) in open.iter_mut().zip(air) {
                let v = air.as_dvec3() - DVec3::Y * track.speed;
                let from = track.p - v * h;
                let is_blocked = |d| self.solids.first_hit([from, track.p], d).is_some();
                track.is_sheltered = is_blocked(track.diameter) || from.y < self.ground.height(from.x, from.z);
                track.p = from;
            }
        }
        tracks.iter().map(|k| k.is_sheltered).collect()
    }
}

/// The path of a drop, followed backwards in time from its position.
struct BackwardPath {
    /// Position reached so far, m, going back in time.
    p: DVec3,
    /// Terminal speed, m/s.
    speed: f64,
    /// Diameter of the drop, m.
    diameter: f64,
    is_sheltered: bool,
}

impl BackwardPath {
    fn new(drop: &EmittedDrop, g: f64) -> Self {
        let diameter = sphere_diameter(drop.volume);
        Self { p: drop.p, speed: terminal_speed(diameter, g), diameter, is_sheltered: false }
    }

    /// Whether its path may still cross solids or ground, which lie below the height `top`, m.
    fn may_meet_surface_below(&self, top: f64) -> bool {
        !self.is_sheltered && self.p.y < top
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rain::fall::sphere_volume;
    use osier_scene::Mesh;
    use osier_wind::UniformWind;

    /// A roof of 4 x 4 m at a height of 6 m; drops are emitted at 2 m.
    fn under_a_roof(wind: Option<&dyn Wind>, d: f64, x: f64, g: f64) -> bool {
        let points = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]].map(|[x, z]| Vec3::new(x, 6.0, z)).to_vec();
        let roof = Mesh { points, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
        let shelter = Shelter::new(RainSolids::new([&roof]).expect("a roof"), Arc::new(0.0), g);
        let p = DVec3::new(x, 2.0, 0.3);
        let mut drops = vec![EmittedDrop { t: 0.0, p, v: DVec3::ZERO, volume: sphere_volume(d) }];
        shelter.retain_unsheltered(&mut drops, wind, 0.0);
        drops.is_empty()
    }

    #[test]
    fn a_roof_shelters_where_its_rain_would_have_come_down() {
        for (x, sheltered) in [(-2.1, false), (-1.9, true), (0.0, true), (1.9, true), (2.1, false)] {
            assert_eq!(under_a_roof(None, 1e-3, x, 9.81), sheltered, "{x}");
        }
        // In wind the dry place lies downwind, further for small drops: 4 m below the roof they drift by 4 w / v.
        let wind = UniformWind(Vec3::X * 5.0);
        for (d, g) in [(5e-4, 9.81), (1e-3, 9.81), (4e-3, 9.81), (4e-3, 1.62)] {
            let drift = 4.0 * 5.0 / terminal_speed(d, g);
            for (x, sheltered) in [(-2.1, false), (-1.9, true), (1.9, true), (2.1, false)] {
                assert_eq!(under_a_roof(Some(&wind), d, x + drift, g), sheltered, "{d} {x} {g}");
            }
        }
    }
}
