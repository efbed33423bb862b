//! The ground under rain: level, wavy or terrain.

use std::sync::Arc;

use glam::Vec3;

use osier_base::math::narrow;
use osier_motion::rain::GroundHeight;
use osier_plants::surface::ground::Ground;
use osier_plants::surface::terrain::Terrain;

/// Depth, m, below the lowest point of all plants and solids at which drops are removed in scenes without a ground. Own:
/// invisible to the camera; a greater depth keeps more drops in the air.
const REMOVAL_DEPTH: f64 = 0.1;

/// The surface below the plants that absorbs drops.
#[derive(Debug)]
pub enum RainGround {
    /// The plane y = 0, or a plane below everything.
    Level {
        /// Whether the scene shows a ground; without one, drops end below all plants and solids.
        shown: bool,
    },
    /// A wavy ground, and the world position of its centre.
    Waves(Ground, Vec3),
    /// A terrain in place of the ground.
    Terrain(Terrain),
}

impl RainGround {
    /// World heights at which drops end. `lowest`: height of the lowest point of all plants and solids, m.
    pub fn into_height(self, lowest: f64) -> Arc<dyn GroundHeight> {
        match self {
            Self::Level { shown: true } => Arc::new(0.0),
            Self::Level { shown: false } => Arc::new(lowest - REMOVAL_DEPTH),
            uneven => Arc::new(uneven),
        }
    }
}

impl GroundHeight for RainGround {
    fn height(&self, x: f64, z: f64) -> f64 {
        let [x, z] = [x, z].map(narrow);
        f64::from(match self {
            Self::Level { .. } => 0.0,
            Self::Waves(ground, center) => ground.height(x - center.x, z - center.z),
            Self::Terrain(terrain) => terrain.height_at(x, z),
        })
    }

    fn max_height(&self) -> f64 {
        f64::from(match self {
            Self::Level { .. } => 0.0,
            // The noise lies within ±1, and its value at the centre is subtracted.
            Self::Waves(ground, _) => 2.0 * ground.amplitude,
            Self::Terrain(terrain) => terrain.range()[1],
        })
    }
}
