//! The wind that files tell: that of a flight, else what plants sway in, else one of its own.

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

/// Bytes of a velocity.
const BYTES: u64 = 12;

/// Tells the wind of a scene at its grids.
#[derive(Debug)]
pub struct WindOutput {
    source: WindOutputSource,
    /// Places of each grid, m.
    places: Vec<Vec<Vec3>>,
}

#[derive(Debug)]
enum WindOutputSource {
    /// Known at any time of the clip.
    Known(Arc<dyn Wind>),
    /// What catkins fly in.
    Flight(Arc<FlightPlayback>),
    /// Nothing else is moved by it.
    Own(Box<Mutex<WindPlayback>>),
}

/// What else in the scene has wind.
pub struct WindUsers<'a> {
    /// The flight, which steps a wind of its own.
    pub flight: Option<Arc<FlightPlayback>>,
    /// What plants sway in.
    pub air: Option<&'a PlantWind>,
    /// What stands in a lattice wind.
    pub solids: &'a [Solid],
}

impl WindOutput {
    /// None if a recipe asks for no files of its wind, or stands still.
    /// # Errors
    /// `Limit`; those of a lattice.
    pub fn of(
        recipe: &Recipe,
        others: &WindUsers<'_>,
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
        // Two frames are held: one that is written, one that is made.
        let held = grids.iter().map(AirGrid::count).fold(0, u64::saturating_add).saturating_mul(2 * BYTES);
        context.limits.check("wind-bytes", held, "the bytes of output.wind in two frames")?;
        let source = match (others.flight.clone(), others.air) {
            (Some(course), _) => WindOutputSource::Flight(course),
            (None, Some(air)) => WindOutputSource::Known(Arc::clone(&air.wind)),
            (None, None) => {
                let mut stream = WindPlayback::new(recipe, others.solids, 0.0, context);
                stream.spin_up(context.progress, report)?;
                WindOutputSource::Own(Box::new(Mutex::new(stream)))
            }
        };
        Ok(Some(Arc::new(Self { source, places: grids.iter().map(AirGrid::places).collect() })))
    }

    /// Velocities, m/s, at the places of each grid at a frame; none of those that are not due.
    /// # Errors
    /// Those of a lattice.
    pub fn at(&self, scene: &Scene, number: u32) -> Result<Vec<Vec<Vec3>>> {
        let since = number.saturating_sub(scene.clip.start);
        if !scene.air.iter().any(|g| g.is_due(since)) {
            return Ok(Vec::new());
        }
        let (seconds, fps) = (scene.clip.seconds(number), scene.clip.fps());
        let (wind, t) = match &self.source {
            WindOutputSource::Known(wind) => (Arc::clone(wind), seconds),
            WindOutputSource::Flight(course) => course.wind(u64::from(since))?,
            WindOutputSource::Own(stream) => {
                let mut stream = stream.lock().unwrap_or_else(PoisonError::into_inner);
                (stream.during(u64::from(since.saturating_sub(1)), fps)?, seconds)
            }
        };
        let told = |(grid, places): (&AirGrid, &Vec<Vec3>)| {
            if grid.is_due(since) { velocities(&*wind, places, t) } else { Vec::new() }
        };
        Ok(scene.air.iter().zip(&self.places).map(told).collect())
    }
}

fn velocities(wind: &dyn Wind, places: &[Vec3], t: f64) -> Vec<Vec3> {
    let chunks = par_chunks(places, CHUNK, |_, places| {
        let mut out = vec![Vec3::ZERO; places.len()];
        wind.sample(places, t, &mut out);
        out
    });
    chunks.concat()
}
