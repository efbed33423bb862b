//! Winds given by formulas, which can be sampled at any time without simulation.

use std::sync::Arc;

use glam::Vec3;

use crate::recipe::scene::{WindKeys, WindModel};
use osier_base::math::{cos, narrow, sin};
use osier_base::rng;
use osier_scene::solid::LandForm;
use osier_wind::{GustWind, GustWindOptions, SineWind, SineWindOptions, UniformWind, Wind, WindOverLand};

/// Horizontal unit vector towards which a wind blows; directions of the keys count from +X towards -Z.
pub(super) fn blowing_direction(keys: &WindKeys) -> Vec3 {
    Vec3::new(narrow(cos(keys.direction)), 0.0, narrow(-sin(keys.direction)))
}

/// Builds the wind of one table. `period`: duration of the loop, s; `number`: position among the scene's winds from 0, which
/// gives the noise of each a different seed; `land`: heights are measured above it.
pub fn formula_wind(
    keys: &WindKeys,
    period: Option<f64>,
    seed: u64,
    number: u64,
    land: Option<&Arc<LandForm>>,
) -> Arc<dyn Wind> {
    let seed = if number == 0 { seed } else { rng::child(seed, number) };
    let direction = blowing_direction(keys);
    let wind: Arc<dyn Wind> = match keys.model {
        // These models have the same wind at all heights.
        WindModel::Calm | WindModel::Uniform | WindModel::Lattice => {
            return Arc::new(UniformWind(direction * narrow(keys.speed)));
        }
        WindModel::Gust => Arc::new(GustWind::new(GustWindOptions {
            direction,
            speed: keys.speed,
            gust: narrow(keys.gust),
            turbulence: narrow(keys.turbulence),
            gust_length: keys.gust_length,
            eddy_size: keys.eddy_size,
            wander: narrow(keys.wander),
            power: narrow(keys.power),
            period,
            seed,
        })),
        WindModel::Perlin => Arc::new(SineWind::new(SineWindOptions {
            direction,
            speed: keys.speed,
            gust: narrow(keys.gust),
            power: narrow(keys.power),
            literal: keys.literal,
            period,
            seed,
        })),
    };
    match land {
        Some(land) => Arc::new(WindOverLand { wind, land: Arc::clone(land) }),
        None => wind,
    }
}
