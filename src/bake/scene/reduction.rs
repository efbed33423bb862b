//! Reductions of a recipe: for estimates, which count everything that a bake makes, and for runs that write no textures.

use std::borrow::Cow;

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::plant_materials::organ_names;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::scene::WindSolver;
use crate::recipe::{CARD, Growth, OrganRecipe, PlantRecipe, Recipe};
use osier_export::format::TextureUse;
use osier_scene::{Clip, Image, Pixels};

/// Pixels along a side of maps that are only counted. Own: small, and within the range of the key `side`.
const REDUCED_SIDE: u32 = 16;
/// Number of individuals of each plant that an estimate grows; the others count as copies of these. Own: enough for predictions
/// within a quarter, as promised; more take longer.
const SAMPLED_INDIVIDUALS: usize = 64;
/// Largest number of skeleton nodes along the diagonal of an imported mesh. Own: bounds the time of the extraction.
const MAX_SKELETON_NODES: f32 = 300.0;

/// The recipe with small maps, coarse skeletons, an analytic wind in place of a lattice, and no spin-up.
pub fn reduced_recipe(recipe: &Recipe) -> Recipe {
    let mut draft = with_small_maps(recipe);
    if draft.lattice.solver == WindSolver::Lbm {
        draft.lattice.solver = WindSolver::Analytic;
    }
    draft.flight.iter_mut().for_each(|flight| flight.keys.spin_up = 0.0);
    for plant in &mut draft.plants {
        if let Growth::Mesh(import, keys) = &mut plant.growth {
            let least = f64::from(import.mesh.bounds().size().length() / MAX_SKELETON_NODES);
            keys.spacing = keys.spacing.map(|s| s.max(least));
        }
    }
    draft
}

/// The recipe with small maps of ground and plants, for runs that write none: shapes, skeletons and motions without rain are those of
/// the full recipe.
pub fn with_small_maps(recipe: &Recipe) -> Recipe {
    let mut draft = recipe.clone();
    reduce_ground_and_bark(&mut draft);
    for plant in &mut draft.plants {
        // Leaves of tables are drawn once for all plants, and their shape follows from the drawing.
        for organ in plant.organs.iter_mut().filter(|o| o.ifs.is_none()) {
            organ.keys.side = organ.keys.side.min(REDUCED_SIDE);
        }
    }
    draft
}

/// The recipe with small maps of ground and bark if no format of its bake has anything of textures. Leaves keep their size, since the
/// manifest lists colours of seasons that are means of their maps; in rain, maps of leaves follow from those of the scene.
pub fn without_unused_textures(recipe: &Recipe) -> Cow<'_, Recipe> {
    if recipe.output.texture_use() > TextureUse::Unused || recipe.rain.is_some() {
        return Cow::Borrowed(recipe);
    }
    let mut draft = recipe.clone();
    reduce_ground_and_bark(&mut draft);
    Cow::Owned(draft)
}

fn reduce_ground_and_bark(recipe: &mut Recipe) {
    recipe.ground.side = recipe.ground.side.min(REDUCED_SIDE);
    for plant in &mut recipe.plants {
        plant.bark.side = plant.bark.side.min(REDUCED_SIDE);
        plant.shoot.side = plant.shoot.side.min(REDUCED_SIDE);
    }
}

/// The recipe with at most its first two frames, so that rain falls for one interval, and without its spin-up.
pub fn recipe_cut_to_first_interval(recipe: &Recipe) -> Recipe {
    let mut short = recipe.clone();
    short.clip = Clip { end: recipe.clip.end.min(recipe.clip.start + 1), ..recipe.clip };
    short.rain.iter_mut().for_each(|rain| rain.keys.spin_up = 0.0);
    short
}

/// Keeps the first [`SAMPLED_INDIVIDUALS`] of each plant and assigns the copies of the others to them in turn; returns the
/// number of individuals that each represents, itself included. Trees that grow together are all kept: without some of them the others
/// would grow in more light.
pub fn sample_individuals_of_each_plant(layout: &mut PlantLayout, plants: usize) -> Vec<u64> {
    let mut kept: Vec<Vec<usize>> = vec![Vec::new(); plants];
    let mut seen = vec![0_usize; plants];
    let mut weights = Vec::new();
    let mut individuals = Vec::new();
    let mut places = Vec::with_capacity(layout.individuals.len());
    for individual in std::mem::take(&mut layout.individuals) {
        let (Some(kept), Some(seen)) = (kept.get_mut(individual.plant), seen.get_mut(individual.plant)) else {
            continue;
        };
        let stays = individual.together || kept.len() < SAMPLED_INDIVIDUALS;
        let place = if stays { individuals.len() } else { kept[*seen % kept.len()] };
        if stays {
            if !individual.together {
                kept.push(place);
            }
            individuals.push(individual);
            weights.push(0);
        } else {
            *seen += 1;
        }
        weights[place] += 1;
        places.push(place);
    }
    layout.individuals = individuals;
    for s in &mut layout.instances {
        s.individual = places.get(s.individual).copied().unwrap_or(0);
    }
    weights
}

/// Sets the sizes of the images of a reduced plant to those of the full recipe, and removes their pixels. Pictures of files, which
/// are not reduced, keep both.
pub fn restore_image_sizes(set: &mut MaterialSet, full: &PlantRecipe) {
    // An imported tree has pictures of its file alone, which may have the names of painted ones.
    if matches!(full.growth, Growth::Mesh(..)) {
        return;
    }
    // The pictures of billboards have one size, which no key sets.
    let has_side = |o: &OrganRecipe| o.mesh.is_none() && o.ifs.is_none() && o.letter != CARD;
    let painted = full.organs.iter().zip(organ_names(full)).filter(|(o, _)| has_side(o));
    let organs = painted.map(|(o, name)| (format!("{}_{name}", full.id), o.keys.side));
    let barks = [("bark", full.bark.side), ("shoot", full.shoot.side)].into_iter().zip(&full.bark_pictures);
    let painted_barks = barks.filter(|(_, pictures)| pictures.is_none()).map(|(bark, _)| bark);
    let sides: Vec<(String, u32)> =
        organs.chain(painted_barks.map(|(part, side)| (format!("{}_{part}", full.id), side))).collect();
    for image in &mut set.images {
        // Image names begin with that of their part; the longest match wins where one name begins another.
        let part = sides.iter().filter(|(name, _)| image.name.starts_with(name)).max_by_key(|(name, _)| name.len());
        if let Some((_, side)) = part {
            set_image_size(image, *side);
        }
    }
}

/// Sets the sides of the images of a reduced ground to `side` pixels, and removes their pixels.
pub fn restore_ground_sizes(set: &mut MaterialSet, side: u32) {
    set.images.iter_mut().for_each(|image| set_image_size(image, side));
}

/// Enlarges an image drawn with [`REDUCED_SIDE`] pixels to the `side` of the keys; pixels are emptied, since they are not read.
fn set_image_size(image: &mut Image, side: u32) {
    let times = side / REDUCED_SIDE.min(side.max(1));
    if times > 1 {
        image.width = image.width.saturating_mul(times);
        image.height = image.height.saturating_mul(times);
        image.pixels = match image.pixels {
            Pixels::U8(_) => Pixels::U8(Vec::new()),
            Pixels::U16(_) => Pixels::U16(Vec::new()),
        };
    }
}
