//! Winds over hills: heights are measured from the ground below.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::Wind;
use osier_scene::solid::LandForm;

/// Number of positions that are converted at a time: their copies stay in the L1 cache.
const BLOCK: usize = 256;

/// A wind over level ground, applied to terrain: its velocity at a point is that of the original wind at the point's height above
/// the terrain.
/// Source: own; terrain-following heights, as weather models use. The flow over a hill is not faster than in a valley.
#[derive(Debug, Clone)]
pub struct WindOverLand {
    /// The wind over the plane y = 0.
    pub wind: Arc<dyn Wind>,
    /// Terrain whose height is subtracted from that of each position.
    pub land: Arc<LandForm>,
}

impl WindOverLand {
    fn above_ground(&self, position: Vec3) -> Vec3 {
        Vec3::new(position.x, position.y - self.land.height(Vec2::new(position.x, position.z)), position.z)
    }
}

impl Wind for WindOverLand {
    fn sample(&self, positions: &[Vec3], t: f64, out: &mut [Vec3]) {
        let mut moved = [Vec3::ZERO; BLOCK];
        for (positions, out) in positions.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
            let moved = &mut moved[..positions.len()];
            moved.iter_mut().zip(positions).for_each(|(m, p)| *m = self.above_ground(*p));
            self.wind.sample(moved, t, out);
        }
    }

    fn mean(&self) -> Vec3 {
        self.wind.mean()
    }

    fn mean_at(&self, position: Vec3) -> Vec3 {
        self.wind.mean_at(self.above_ground(position))
    }

    fn mean_at_time(&self, position: Vec3, t: f64) -> Vec3 {
        self.wind.mean_at_time(self.above_ground(position), t)
    }

    fn has_varying_mean(&self) -> bool {
        self.wind.has_varying_mean()
    }

    fn prescribed_mean_at_time(&self, t: f64) -> Vec3 {
        self.wind.prescribed_mean_at_time(t)
    }

    fn period(&self) -> Option<f64> {
        self.wind.period()
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, reason = "tests")]
mod tests {
    use super::super::{GustWind, GustWindOptions};
    use super::*;

    #[test]
    fn a_valley_and_a_hill_have_the_wind_of_the_plain() {
        // A plain at -20 m for x < 0 that rises to +20 m at x = 200.
        let heights: Vec<f32> = (0..3).flat_map(|_| [-20.0, -20.0, 20.0]).collect();
        let land = Arc::new(LandForm::new(3, 400.0, heights).expect("land"));
        let plain = Arc::new(GustWind::new(GustWindOptions::default()));
        let wind = WindOverLand { wind: plain.clone(), land };
        let ask = |w: &dyn Wind, p: Vec3| {
            let mut out = [Vec3::ZERO];
            w.sample(&[p], 3.1, &mut out);
            out[0]
        };
        for (x, ground) in [(-150.0, -20.0), (0.0, -20.0), (100.0, 0.0), (200.0, 20.0)] {
            for above in [0.5, 3.0, 30.0] {
                let (place, level) = (Vec3::new(x, ground + above, 7.0), Vec3::new(x, above, 7.0));
                assert!((ask(&wind, place) - ask(&*plain, level)).length() < 1e-4, "{place}");
                assert!((wind.mean_at(place) - plain.mean_at(level)).length() < 1e-4, "{place}");
            }
        }
        assert!(wind.mean_at(Vec3::new(-150.0, -17.0, 0.0)).x > wind.mean_at(Vec3::new(-150.0, -19.0, 0.0)).x);
    }
}
