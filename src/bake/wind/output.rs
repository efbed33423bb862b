//! The wind that `[output.wind]` exports: that of a flight, else that of the plants, else one that is stepped for the output alone.

use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::motion::flight::FlightPlayback;
use crate::bake::wind::plant_wind::PlantWind;
use crate::bake::wind::playback::WindPlayback;
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::diagnostic::Report;
use osier_base::par::{CHUNK, par_chunks};
use osier_scene::solid::Solid;
use osier_scene::{AirGrid, Scene};
use osier_wind::Wind;

/// Bytes of a velocity: three f32.
const BYTES_PER_VELOCITY: u64 = 12;

/// Samples the wind of a scene at the points of its grids.
#[derive(Debug)]
pub struct WindOutput {
    source: WindOutputSource,
    /// Points of each grid, m.
    points: Vec<Vec<Vec3>>,
}

#[derive(Debug)]
enum WindOutputSource {
    /// Analytic or recorded: can be sampled at any time of the clip.
    Recorded(Arc<dyn Wind>),
    /// Stepped along with the flight.
    Flight(Arc<FlightPlayback>),
    /// Stepped for the output alone.
    Stepped(Box<Mutex<WindPlayback>>),
}

/// The motions of a scene that already have a wind which can be exported.
pub struct AvailableWinds<'a> {
    /// The flight, which steps its own wind.
    pub flight: Option<Arc<FlightPlayback>>,
    /// Wind of the plants.
    pub plants: Option<&'a PlantWind>,
    /// Solids of a lattice wind.
    pub solids: &'a [Solid],
}

impl WindOutput {
    /// `None` if the recipe exports no wind, or has no clip.
    /// # Errors
    /// `Limit`; those of a lattice.
    pub fn from_recipe(
        recipe: &Recipe,
        users: &AvailableWinds<'_>,
        context: &BakeContext<'_>,
        report: &mut Report,
    ) -> Result<Option<Arc<Self>>> {
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
        let source = match (users.flight.clone(), users.plants) {
            (Some(flight), _) => WindOutputSource::Flight(flight),
            (None, Some(plants)) => WindOutputSource::Recorded(Arc::clone(&plants.wind)),
            (None, None) => {
                let mut playback = WindPlayback::new(recipe, users.solids, 0.0, context);
                playback.spin_up(context.progress, report)?;
                WindOutputSource::Stepped(Box::new(Mutex::new(playback)))
            }
        };
        Ok(Some(Arc::new(Self { source, points: grids.iter().map(AirGrid::places).collect() })))
    }

    /// Velocities, m/s, at the points of each grid at a frame; empty for a grid that is not written in this frame.
    /// # Errors
    /// Those of a lattice.
    pub fn sample_frame(&self, scene: &Scene, number: u32) -> Result<Vec<Vec<Vec3>>> {
        let since = number.saturating_sub(scene.clip.start);
        if !scene.air.iter().any(|g| g.is_due(since)) {
            return Ok(Vec::new());
        }
        let (seconds, fps) = (scene.clip.seconds(number), scene.clip.fps());
        let (wind, t) = match &self.source {
            WindOutputSource::Recorded(wind) => (Arc::clone(wind), seconds),
            WindOutputSource::Flight(flight) => flight.wind_at(u64::from(since))?,
            WindOutputSource::Stepped(playback) => {
                let mut playback = playback.lock().unwrap_or_else(PoisonError::into_inner);
                (playback.wind_between(u64::from(since.saturating_sub(1)), fps)?, seconds)
            }
        };
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
