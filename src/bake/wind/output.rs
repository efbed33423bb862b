//! The wind that `[output.wind]` and `[output.vdb]` export: that of the scene, sampled at the points of planes and boxes.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::obstacles::{Obstacles, flight_domain};
use crate::bake::wind::scene_wind::{SceneWind, WindUser};
use crate::recipe::scene::{VdbGrid, WindModel};
use crate::recipe::{Recipe, word_of};
use osier_base::Result;
use osier_base::math::narrow;
use osier_base::par::{CHUNK, par_chunks};
use osier_export::vdb::check_dense_grid;
use osier_scene::{AirGrid, Scene, VolumeCells, VolumeFrame, VolumeGrid, VolumeValues};
use osier_wind::Wind;

/// Bytes of a velocity: three f32.
const BYTES_PER_VELOCITY: u64 = 12;

/// Samples the wind of a scene at the points of its grids.
#[derive(Debug)]
pub struct WindGridSampler {
    wind: Arc<SceneWind>,
    /// World points of each grid, m.
    points: Vec<Vec<Vec3>>,
    volume: Option<WindVolumePoints>,
}

/// Sample points of the voxel grid of the wind's velocity.
#[derive(Debug)]
struct WindVolumePoints {
    cells: [usize; 3],
    /// World positions of the centres of cells that are not inside a solid, m.
    points: Vec<Vec3>,
    /// Index of each of `points` among all cells.
    indices: Vec<usize>,
}

/// Samples of the wind at one frame for the grids and the volume that the scene writes.
#[derive(Debug, Default)]
pub struct SampledWind {
    /// Velocities, m/s, at the points of each grid of the scene; empty for a grid that is not written in this frame. The list is
    /// empty if no grid is written in this frame.
    pub air: Vec<Vec<Vec3>>,
    /// The volume of the velocity, if the scene has one; without values in a frame in which it is not written.
    pub volume: Option<VolumeFrame>,
}

impl WindGridSampler {
    /// The sampler of a recipe, which computes all points once; `None` if the recipe exports no wind or has no clip.
    /// # Errors
    /// `Limit`, and X010 for more voxels than a file may have.
    pub fn from_recipe(
        recipe: &Recipe,
        wind: &Arc<SceneWind>,
        obstacles: &Obstacles<'_>,
        context: &BakeContext<'_>,
    ) -> Result<Option<Arc<Self>>> {
        let grids = placed_grids(recipe, obstacles);
        let volume = velocity_domain(recipe, obstacles);
        if (grids.is_empty() && volume.is_none()) || recipe.clip.len() < 2 {
            return Ok(None);
        }
        for plane in grids.iter().filter(|g| g.across.is_some()) {
            let longest = plane.cells.iter().copied().max().unwrap_or(0) as u64;
            context.limits.check("image-side", longest, "texels along a side of a plane of output.wind")?;
        }
        velocity_grid(recipe, obstacles).map_or(Ok(()), |grid| check_dense_grid(&grid, recipe.clip.start))?;
        // Two frames are in memory at once: the one that is written, and the next.
        let cells = grids.iter().chain(&volume).map(AirGrid::count).fold(0, u64::saturating_add);
        let bytes = cells.saturating_mul(2 * BYTES_PER_VELOCITY);
        context.limits.check("wind-bytes", bytes, "the bytes of output.wind and output.vdb in two frames")?;
        let points = grids.iter().map(AirGrid::places).collect();
        let volume = volume.map(|domain| {
            // Cells inside of solids contain no air. Sample the land over a square around the origin that contains the domain.
            let size = DVec3::from_array(domain.cells.map(|n| n as f64)) * domain.side;
            let reach = domain.corner.abs().max((domain.corner + size).abs());
            let solids = obstacles.solids_and_land(narrow(2.0 * reach.x.max(reach.z)));
            let open = domain.places().into_iter().enumerate().filter(|(_, p)| !solids.contains(*p));
            let (indices, points) = open.unzip();
            WindVolumePoints { cells: domain.cells, points, indices }
        });
        Ok(Some(Arc::new(Self { wind: Arc::clone(wind), points, volume })))
    }

    /// Samples the wind at the points of the grids and of the volume that are due at frame `number`.
    /// # Errors
    /// Errors of a lattice.
    pub fn sample_frame(&self, scene: &Scene, number: u32) -> Result<SampledWind> {
        let since = number.saturating_sub(scene.clip.start);
        let volume = self.volume.as_ref().zip(scene.volumes.first());
        let volume_is_due = volume.is_some_and(|(_, grid)| grid.is_due(since));
        let nothing = volume
            .map(|_| VolumeFrame { cells: VolumeCells::List(Vec::new()), values: VolumeValues::Vector(Vec::new()) });
        if !volume_is_due && !scene.air.iter().any(|g| g.is_due(since)) {
            return Ok(SampledWind { air: Vec::new(), volume: nothing });
        }
        let t = scene.clip.seconds(number);
        // Use the interval that ends at this frame, which a lattice stepped by a flight has already computed.
        let wind = self.wind.wind_until_next_frame(WindUser::Output, i64::from(since) - 1)?;
        let sample = |(grid, points): (&AirGrid, &Vec<Vec3>)| {
            if grid.is_due(since) { sample_velocities(&*wind, points, t) } else { Vec::new() }
        };
        let air = scene.air.iter().zip(&self.points).map(sample).collect();
        let volume = volume.map(|(volume, _)| volume.sample(&*wind, t)).filter(|_| volume_is_due).or(nothing);
        Ok(SampledWind { air, volume })
    }
}

impl WindVolumePoints {
    /// Velocities in all cells at a time, s; 0 inside of solids.
    fn sample(&self, wind: &dyn Wind, t: f64) -> VolumeFrame {
        let mut all = vec![Vec3::ZERO; self.cells.iter().product()];
        for (i, velocity) in self.indices.iter().zip(sample_velocities(wind, &self.points, t)) {
            all[*i] = velocity;
        }
        VolumeFrame { cells: VolumeCells::Box(self.cells), values: VolumeValues::Vector(all) }
    }
}

/// Height, m, of the base of a flight's box, which is also the base of the grids of its wind; 0 without a flight, and for a
/// lattice, whose grids have the base of the lattice.
fn flight_base(recipe: &Recipe, obstacles: &Obstacles<'_>) -> f64 {
    let flight = recipe.flight.as_ref().filter(|_| recipe.wind.model != WindModel::Lattice);
    flight.map_or(0.0, |flight| f64::from(flight_domain(recipe, flight.keys.size, obstacles).min.y))
}

/// The grids of `[output.wind]` at their positions in the scene: in the box of a flight, whose base is the land.
pub fn placed_grids(recipe: &Recipe, obstacles: &Obstacles<'_>) -> Vec<AirGrid> {
    let base = flight_base(recipe, obstacles);
    let mut grids = recipe.output.wind.grids.clone();
    // A plane across y stays at the height that its key names.
    grids.iter_mut().filter(|grid| grid.across != Some(1)).for_each(|grid| grid.corner.y += base);
    grids
}

/// Cells of the voxel grid of the wind; `None` if it is not written, or if there is no wind.
fn velocity_domain(recipe: &Recipe, obstacles: &Obstacles<'_>) -> Option<AirGrid> {
    let mut domain = recipe.output.velocity_volume().filter(|_| recipe.blows())?.clone();
    domain.corner.y += flight_base(recipe, obstacles);
    Some(domain)
}

/// Declaration of the voxel grid of the wind's velocity; `None` if it is not written.
pub fn velocity_grid(recipe: &Recipe, obstacles: &Obstacles<'_>) -> Option<VolumeGrid> {
    let domain = velocity_domain(recipe, obstacles)?;
    Some(VolumeGrid {
        file: "air",
        name: word_of(VdbGrid::Velocity),
        unit: "m/s",
        is_vector: true,
        origin: domain.corner + domain.side / 2.0,
        cell: domain.side,
        every: domain.every,
        max_cells: domain.count(),
    })
}

/// Wind velocities, m/s, at world points at time `t`, s, sampled in parallel chunks.
fn sample_velocities(wind: &dyn Wind, places: &[Vec3], t: f64) -> Vec<Vec3> {
    let chunks = par_chunks(places, CHUNK, |_, places| {
        let mut out = vec![Vec3::ZERO; places.len()];
        wind.sample(places, t, &mut out);
        out
    });
    chunks.concat()
}
