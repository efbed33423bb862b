//! A recipe as it is looked at before it is run: what it would make is counted, nothing is drawn or simulated.

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::plant_materials::organ_names;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::scene::WindSolver;
use crate::recipe::{Growth, PlantRecipe, Recipe};
use osier_scene::{Clip, Image, Pixels};

/// Pixels along a side of maps that are only counted.
const SIDE: u32 = 16;
/// Individuals of a plant that are grown to be counted.
const SAMPLE: usize = 64;
/// Clusters of the wood of a mesh along its diagonal, at most.
const CLUSTERS: f32 = 300.0;

/// The recipe with small maps, and with air that needs no lattice and no time to run up.
pub fn reduced_recipe(recipe: &Recipe) -> Recipe {
    let mut draft = recipe.clone();
    if draft.lattice.solver == WindSolver::Lbm {
        draft.lattice.solver = WindSolver::Analytic;
    }
    draft.flight.iter_mut().for_each(|flight| flight.keys.spin_up = 0.0);
    draft.ground.side = draft.ground.side.min(SIDE);
    for plant in &mut draft.plants {
        plant.bark.side = plant.bark.side.min(SIDE);
        plant.shoot.side = plant.shoot.side.min(SIDE);
        // Leaves of tables are drawn once for all plants, and their shape follows from the drawing.
        for organ in plant.organs.iter_mut().filter(|o| o.ifs.is_none()) {
            organ.keys.side = organ.keys.side.min(SIDE);
        }
        if let Growth::Mesh(import, keys) = &mut plant.growth {
            let least = f64::from(import.mesh.bounds().size().length() / CLUSTERS);
            keys.spacing = keys.spacing.map(|s| s.max(least));
        }
    }
    draft
}

/// The recipe as rain needs it: one frame of it, from the first drop.
pub fn first_rain_frame(recipe: &Recipe) -> Recipe {
    let mut short = recipe.clone();
    short.clip = Clip { end: recipe.clip.end.min(recipe.clip.start + 1), ..recipe.clip };
    short.rain.iter_mut().for_each(|rain| rain.keys.spin_up = 0.0);
    short
}

/// Keeps the first of a plant's individuals, which stand for the others; how many each stands for, itself included.
pub fn sample_individuals(layout: &mut PlantLayout, plants: usize) -> Vec<u64> {
    let mut kept: Vec<Vec<usize>> = vec![Vec::new(); plants];
    let mut seen = vec![0_usize; plants];
    let mut weights = Vec::new();
    let mut individuals = Vec::new();
    let mut places = Vec::with_capacity(layout.individuals.len());
    for individual in std::mem::take(&mut layout.individuals) {
        let (Some(kept), Some(seen)) = (kept.get_mut(individual.plant), seen.get_mut(individual.plant)) else {
            continue;
        };
        if kept.len() < SAMPLE {
            kept.push(individuals.len());
            individuals.push(individual);
            weights.push(0);
        }
        let place = kept[*seen % kept.len()];
        *seen += 1;
        weights[place] += 1;
        places.push(place);
    }
    layout.individuals = individuals;
    for s in &mut layout.standings {
        s.individual = places.get(s.individual).copied().unwrap_or(0);
    }
    weights
}

/// Gives the pictures of a plant that was drawn small the sizes that are meant; they hold no pixels then.
pub fn restore_image_sizes(look: &mut MaterialSet, meant: &PlantRecipe) {
    let made = meant.organs.iter().zip(organ_names(meant)).filter(|(o, _)| o.mesh.is_none() && o.ifs.is_none());
    let organs = made.map(|(o, name)| (format!("{}_{name}", meant.id), o.keys.side));
    let barks = [("bark", meant.bark.side), ("shoot", meant.shoot.side)];
    let sides: Vec<(String, u32)> =
        organs.chain(barks.map(|(part, side)| (format!("{}_{part}", meant.id), side))).collect();
    for image in &mut look.images {
        let own = sides.iter().filter(|(name, _)| image.name.starts_with(name)).max_by_key(|(name, _)| name.len());
        if let Some((_, side)) = own {
            sized(image, *side);
        }
    }
}

/// The same for the ground, whose maps have a side of `side`.
pub fn restore_ground_sizes(look: &mut MaterialSet, side: u32) {
    look.images.iter_mut().for_each(|image| sized(image, side));
}

/// `side`: pixels that the keys ask for, of which [`SIDE`] were drawn.
fn sized(image: &mut Image, side: u32) {
    let times = side / SIDE.min(side.max(1));
    if times > 1 {
        image.width = image.width.saturating_mul(times);
        image.height = image.height.saturating_mul(times);
        image.pixels = match image.pixels {
            Pixels::U8(_) => Pixels::U8(Vec::new()),
            Pixels::U16(_) => Pixels::U16(Vec::new()),
        };
    }
}
