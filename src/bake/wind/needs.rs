//! Regions and times at which the parts of a scene read its wind; they determine the plan of the lattice's run.

use glam::Vec3;

use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::Recipe;
use crate::recipe::scene::{BarkMotion, SwayStart};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_motion::rods::PLANT_SPIN_UP_SECONDS;
use osier_motion::sway::SPIN_UP_SECONDS;

/// Margin for leaves around a plant's nodes, m. Own: longer than leaf and petiole of the presets.
const LEAF_MARGIN: f32 = 0.5;
/// Distance, as a share of its height, by which a plant may lean out of its bounds at rest. Own: crowns of the presets lean by a
/// twentieth at 10 m/s; leaves farther out read the wind at the border of the recording.
const LEAN_MARGIN: f32 = 0.2;

/// Regions and times at which the wind of a scene is read.
#[derive(Debug, Clone, Copy)]
pub struct WindNeeds {
    /// World bounds, m, of plants and rods whose wind is read ahead of the frames or at any of them; empty if there are none.
    pub region: Bounds,
    /// Whether rain, which is simulated ahead of the frames, reads the whole box.
    pub box_ahead: bool,
    /// Whether catkins or files read the whole box, frame by frame.
    pub box_by_frame: bool,
    /// Time before the clip's first frame from which the region is read, s.
    pub region_lead: f64,
    /// Time before the clip's first frame from which the box is read, s.
    pub box_lead: f64,
}

impl WindNeeds {
    /// Needs of all parts that the recipe moves, simulates or writes. In a still scene only a flight reads the wind.
    pub fn of_scene(recipe: &Recipe, layout: &PlantLayout, grown: &[GrownPlant]) -> Self {
        let is_clip = recipe.clip.len() >= 2;
        let plants = if is_clip { moving_plant_bounds(recipe, layout, grown) } else { Bounds::of([]) };
        let rods = if is_clip { rod_bounds(recipe) } else { Bounds::of([]) };
        let rain = recipe.rain.as_ref().filter(|_| is_clip);
        // Plants that do not start from rest spin up; the others read the wind from the first frame on.
        let plants_spin_up = !plants.is_empty() && recipe.sway.start != SwayStart::Rest;
        let plant_lead = if plants_spin_up { SPIN_UP_SECONDS.max(PLANT_SPIN_UP_SECONDS) } else { 0.0 };
        let flight_lead = recipe.flight.as_ref().map_or(0.0, |flight| flight.keys.spin_up);
        // Plants on rods spin up before it rains.
        let on_rods = plants_spin_up && recipe.plants.iter().any(|plant| plant.rods.is_some());
        let rod_lead = if on_rods { PLANT_SPIN_UP_SECONDS } else { 0.0 };
        let rain_lead = rain.map_or(0.0, |rain| rain.keys.spin_up + rod_lead);
        let writes_wind = !recipe.output.wind.grids.is_empty() || recipe.output.velocity_volume().is_some();
        Self {
            region: Bounds::of([plants, rods].iter().filter(|b| !b.is_empty()).flat_map(|b| b.corners())),
            box_ahead: rain.is_some(),
            box_by_frame: recipe.flight.is_some() || is_clip && writes_wind,
            region_lead: plant_lead,
            box_lead: flight_lead.max(rain_lead),
        }
    }

    /// Whether no plant, rod, rain, flight or written file reads the wind.
    pub fn is_empty(&self) -> bool {
        self.region.is_empty() && !self.box_ahead && !self.box_by_frame
    }
}

/// World bounds, m, of the first copies of all moving plants, extended by margins for leaves and for leaning. Other copies use
/// the wind at the first copy.
fn moving_plant_bounds(recipe: &Recipe, layout: &PlantLayout, grown: &[GrownPlant]) -> Bounds {
    let transforms = layout.first_transforms();
    let plants = layout.individuals.iter().zip(grown).zip(&transforms);
    let corners = plants.filter_map(|((individual, grown), transform)| {
        let plant = recipe.plants.get(individual.plant)?;
        // The wind does not move a plant that grows, or whose leaves change, over the clip.
        let changes = plant.keys.growth_clip.is_some() || grown.clip.is_some() || grown.season.is_some();
        if changes || matches!(plant.keys.motion, BarkMotion::Still | BarkMotion::Static) {
            return None;
        }
        let own = Bounds::of(grown.plant.nodes.p.iter().copied());
        if own.is_empty() {
            return None;
        }
        let world = Bounds::of(own.expanded(LEAF_MARGIN).corners().map(|c| transform.apply(c)));
        let lean = LEAN_MARGIN * narrow(recipe.sway.exaggerate.max(1.0)) * world.size().y;
        Some(world.expanded(lean.min(world.size().y)).corners())
    });
    Bounds::of(corners.flatten())
}

/// World bounds, m, that the scene's rods can reach: all points within their length.
fn rod_bounds(recipe: &Recipe) -> Bounds {
    let length = |points: &[[f64; 3]]| -> f64 {
        let points = points.windows(2).map(|p| glam::DVec3::from_array(p[0]).distance(glam::DVec3::from_array(p[1])));
        points.sum()
    };
    let corners = recipe.rods.iter().flat_map(|rod| {
        let points = rod.keys.points.iter().map(|p| Vec3::from_array(p.map(narrow)));
        Bounds::of(points).expanded(narrow(length(&rod.keys.points))).corners()
    });
    Bounds::of(corners)
}
