//! The wind as `[output.wind]` exports it: the scene's own, sampled at the points of planes and boxes.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::wind::scene_wind::{SceneWind, WindUser};
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::par::{CHUNK, par_chunks};
use osier_scene::{AirGrid, Scene};
use osier_wind::Wind;

/// Bytes of a velocity: three f32.
const BYTES_PER_VELOCITY: u64 = 12;

/// Samples the wind of a scene at the points of its grids.
#[derive(Debug)]
pub struct WindOutput {
    wind: Arc<SceneWind>,
    /// Points of each grid, m.
    points: Vec<Vec<Vec3>>,
}

impl WindOutput {
    /// `None` if the recipe exports no wind, or has no clip.
    /// # Errors
    /// `Limit`.
    pub fn from_recipe(recipe: &Recipe, wind: &Arc<SceneWind>, context: &BakeContext<'_>) -> Result<Option<Arc<Self>>> {
        let grids = &recipe.output.wind.grids;
        if grids.is_empty() || recipe.clip.len() < 2 {
            return Ok(None);
        }
        for plane in grids.iter().filter(|g| g.across.is_some()) {
            let longest = plane.cells.iter().copied().max().unwrap_or(0) as u64;
            context.limits.check("image-side", longest, "texels along a side of a plane of output.wind")?;
        }
        // Two frames are in memory: the one that is written, and the next.
        let bytes =
            grids.iter().map(AirGrid::count).fold(0, u64::saturating_add).saturating_mul(2 * BYTES_PER_VELOCITY);
        context.limits.check("wind-bytes", bytes, "the bytes of output.wind in two frames")?;
        let points = grids.iter().map(AirGrid::places).collect();
        Ok(Some(Arc::new(Self { wind: Arc::clone(wind), points })))
    }

    /// Velocities, m/s, at the points of each grid at a frame; empty for a grid that is not written in this frame.
    /// # Errors
    /// Those of a lattice.
    pub fn sample_frame(&self, scene: &Scene, number: u32) -> Result<Vec<Vec<Vec3>>> {
        let since = number.saturating_sub(scene.clip.start);
        if !scene.air.iter().any(|g| g.is_due(since)) {
            return Ok(Vec::new());
        }
        let t = scene.clip.seconds(number);
        // The wind of the interval that ends at this frame: a lattice that is stepped along with a flight is there by now.
        let wind = self.wind.wind_until_next_frame(WindUser::Output, i64::from(since) - 1)?;
        let sample = |(grid, points): (&AirGrid, &Vec<Vec3>)| {
            if grid.is_due(since) { sample_velocities(&*wind, points, t) } else { Vec::new() }
        };
        Ok(scene.air.iter().zip(&self.points).map(sample).collect())
    }
}

/// Wind velocities at points, m/s, sampled in parallel chunks.
fn sample_velocities(wind: &dyn Wind, places: &[Vec3], t: f64) -> Vec<Vec3> {
    let chunks = par_chunks(places, CHUNK, |_, places| {
        let mut out = vec![Vec3::ZERO; places.len()];
        wind.sample(places, t, &mut out);
        out
    });
    chunks.concat()
}
