//! What rain falls on beside plants: level or waving ground, or a land's hills.

use glam::Vec3;

use osier_base::math::narrow;
use osier_motion::rain::GroundHeight;
use osier_plants::surface::ground::Ground;
use osier_plants::surface::terrain::Terrain;

/// How far below everything drops end where no ground is shown, m.
const BELOW: f64 = 0.1;

/// The ground of a scene in which it rains.
#[derive(Debug)]
pub enum RainGround {
    /// None, or level at y = 0.
    Level(bool),
    /// Waves around a middle.
    Waves(Ground, Vec3),
    /// Hills.
    Hills(Terrain),
}

impl RainGround {
    /// Where drops end. `lowest`: height of the lowest point of all plants, m.
    pub fn floor(self, lowest: f32) -> Box<dyn GroundHeight> {
        let below = f64::from(lowest) - BELOW;
        match self {
            Self::Level(shown) => Box::new(if shown { below.max(0.0) } else { below }),
            shaped => Box::new(shaped),
        }
    }
}

impl GroundHeight for RainGround {
    fn height(&self, x: f64, z: f64) -> f64 {
        let [x, z] = [x, z].map(narrow);
        f64::from(match self {
            Self::Level(_) => 0.0,
            Self::Waves(ground, middle) => ground.height(x - middle.x, z - middle.z),
            Self::Hills(land) => land.height_at(x, z),
        })
    }
}
