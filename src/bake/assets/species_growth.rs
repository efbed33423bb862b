//! Growth of species year by year: trees that stand together share one field of light.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use crate::bake::scene::plant_layout::{Individual, PlantLayout};
use crate::recipe::scene::{BladeOutline, PruneKeys, SiteKeys};
use crate::recipe::{Growth, PlantRecipe, Recipe, SpeciesRecipe};
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::par::par_map;
use osier_plants::grow::years::{Foliage, GrownTree, Keep, Neighbours, PlantOptions, Prune, Site, TreeSpec, grow};
use osier_scene::Trs;
use osier_scene::plant::Plant;
use osier_scene::solid::{Form, Solid, Solids};

/// Whether a plant grows for the one place in which it stands: its copies are neither turned nor scaled, and no two share an
/// individual. `together`: with the trees around it.
pub(crate) fn grows_in_place(plant: &PlantRecipe, together: bool) -> bool {
    let Growth::Species(species) = &plant.growth else { return false };
    together || species.site.solids || !species.prunes.is_empty()
}

/// Whether some species of a recipe needs the scene's solids.
pub(crate) fn needs_solids(species: &SpeciesRecipe) -> bool {
    species.site.solids || species.prunes.iter().any(|p| !p.solid.is_empty())
}

/// Grows all individuals of species of a layout, in its order; `None` for other plants. `solids`: of the scene, in world space.
/// # Errors
/// As [`grow`].
pub fn grow_species(
    recipe: &Recipe,
    layout: &PlantLayout,
    solids: &[Solid],
    limits: &Limits,
) -> Result<Vec<Option<GrownTree>>> {
    let transforms = layout.first_transforms();
    let mut out: Vec<Option<GrownTree>> = layout.individuals.iter().map(|_| None).collect();
    // Trees that stand together are one job, every other tree is one of its own.
    let mut jobs: Vec<Vec<usize>> = Vec::new();
    let mut together = Vec::new();
    for (i, individual) in layout.individuals.iter().enumerate() {
        if species_of(recipe, individual).is_none() {
            continue;
        }
        if individual.together { together.push(i) } else { jobs.push(vec![i]) }
    }
    if !together.is_empty() {
        jobs.push(together);
    }
    let grown = par_map(&jobs, |job| {
        let specs: Vec<TreeSpec> =
            job.iter().filter_map(|i| tree_spec(recipe, &layout.individuals[*i], transforms[*i], solids)).collect();
        // All trees of a job share the sky of the first.
        let first = job.first().and_then(|i| species_of(recipe, &layout.individuals[*i]));
        let site = first.map_or_else(Site::default, |species| site(&species.site, solids));
        grow(&specs, &site, limits)
    });
    for (job, trees) in jobs.iter().zip(grown) {
        for (i, tree) in job.iter().zip(trees?) {
            out[*i] = Some(tree);
        }
    }
    Ok(out)
}

fn species_of<'a>(recipe: &'a Recipe, individual: &Individual) -> Option<&'a SpeciesRecipe> {
    match &recipe.plants.get(individual.plant)?.growth {
        Growth::Species(species) => Some(species),
        _ => None,
    }
}

fn tree_spec(recipe: &Recipe, individual: &Individual, transform: Trs, solids: &[Solid]) -> Option<TreeSpec> {
    let plant = recipe.plants.get(individual.plant)?;
    let species = species_of(recipe, individual)?;
    let ring = |k: &crate::recipe::scene::StandKeys| Neighbours {
        radius: narrow(k.radius),
        density: narrow(k.density),
        until: narrow(k.until),
    };
    // Where it stands matters only to a tree that grows in its place; others stand at the origin.
    let in_place = grows_in_place(plant, individual.together);
    Some(TreeSpec {
        name: plant.name.clone(),
        habit: species.habit.habit.clone(),
        seed: individual.seed,
        id: individual.id,
        base: if in_place { transform.t } else { Vec3::ZERO },
        age: species.age,
        neighbours: species.stand.as_ref().map(ring),
        prunes: species.prunes.iter().filter_map(|p| prune(p, solids)).collect(),
    })
}

fn site(keys: &SiteKeys, solids: &[Solid]) -> Site {
    Site {
        side: Vec3::from_array(keys.side.map(narrow)),
        latitude: keys.latitude,
        direct: keys.direct,
        solids: keys.solids.then(|| Arc::new(ground_and_solids(solids))),
    }
}

/// Solids with the ground under them: the land among them, else the level y = 0.
pub(crate) fn ground_and_solids(solids: &[Solid]) -> Solids {
    let level = !solids.iter().any(|s| matches!(s.form, Form::Land(_)));
    Solids::new(solids.to_vec(), level)
}

/// A cut of the keys; `None` for one that keeps nothing, which resolving has reported.
fn prune(keys: &PruneKeys, solids: &[Solid]) -> Option<Prune> {
    let keep = match keys.keep[..] {
        _ if !keys.solid.is_empty() => Keep::Solid(Arc::new(solids.iter().find(|s| s.name == keys.solid)?.clone())),
        [a, b] => {
            let [a, b] = [a, b].map(|p| Vec3::from_array(p.map(narrow)));
            Keep::Box { min: a.min(b), max: a.max(b) }
        }
        _ => return None,
    };
    Some(Prune { year: keys.year, every: keys.every, until: keys.until, keep })
}

/// A grown tree as a plant with the leaves of its materials, and what is to be told of it.
/// # Errors
/// As [`GrownTree::plant`].
pub(crate) fn species_plant(
    tree: &GrownTree,
    recipe: &PlantRecipe,
    set: &MaterialSet,
    limits: &Limits,
) -> Result<(Plant, Vec<Diagnostic>)> {
    let needles = recipe.organs.iter().any(|o| o.letter == 'l' && o.keys.blade == BladeOutline::Needles);
    let foliage = set.organs.get(&'l').map(|organ| match needles {
        true => Foliage::Needles(organ.clone()),
        false => Foliage::Blades(organ.clone()),
    });
    let options = PlantOptions {
        foliage,
        materials: set.materials.iter().map(|m| m.name.clone()).collect(),
        bark: BARK,
        shoot: SHOOT,
        shoot_radius: SHOOT_RADIUS,
        dead: set.dead.unwrap_or(BARK),
        source: recipe.source.clone(),
    };
    let plant = tree.plant(&options, limits)?;
    let died = tree.died().map(|year| {
        let text = format!("plant \"{}\" is dead: no light since year {year}", recipe.name);
        let help = "give it more room, fewer neighbours or a lower `shade_point`";
        Diagnostic { help: Some(help.into()), ..Diagnostic::about("S036", text) }
    });
    Ok((plant, died.into_iter().collect()))
}

/// S003 for plants that grow for one place and stand in several as the same individual.
pub(crate) fn shared_individuals(recipe: &Recipe, layout: &PlantLayout) -> Vec<Diagnostic> {
    let mut copies = vec![0_usize; layout.individuals.len()];
    layout.instances.iter().for_each(|s| copies[s.individual] += 1);
    let mut told = vec![false; recipe.plants.len()];
    let mut out = Vec::new();
    for (individual, copies) in layout.individuals.iter().zip(copies) {
        let Some(plant) = recipe.plants.get(individual.plant) else { continue };
        let bound = grows_in_place(plant, individual.together);
        if bound && copies > 1 && !std::mem::replace(&mut told[individual.plant], true) {
            let text = format!(
                "plant \"{}\" grows for its own place but stands in {copies} places as one individual",
                plant.name
            );
            let help = "leave out `individuals` of its [[place]], or place it by [[place]] instead of [[scatter]]";
            out.push(Diagnostic::about("S003", text).help(help));
        }
    }
    out
}
