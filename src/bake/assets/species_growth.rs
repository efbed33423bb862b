//! Growth of species year by year: trees that stand together share one field of light.

use std::sync::Arc;

use glam::Vec3;

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use crate::bake::scene::plant_layout::{Individual, PlantLayout};
use crate::recipe::scene::{BladeOutline, LeafSeasons, PruneKeys, SiteKeys};
use crate::recipe::{Growth, PlantRecipe, Recipe, SpeciesRecipe};
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::par::par_map;
use osier_plants::grow::years::{
    ClipLeaves, ClipOptions, ClipSpan, Foliage, GrownTree, GrowthClip, Keep, Neighbours, PlantOptions, Prune,
    RecordedTree, Site, TreeSpec, grow_recorded,
};
use osier_plants::surface::masonry::roof_solids;
use osier_scene::Trs;
use osier_scene::plant::Plant;
use osier_scene::solid::{Form, Solid, Solids};

/// Whether a plant's growth depends on its place: then its copies are neither turned nor scaled, and no two share an
/// individual.
/// `together`: whether it grows with the trees around it.
pub(crate) fn grows_in_place(plant: &PlantRecipe, together: bool) -> bool {
    let Growth::Species(species) = &plant.growth else { return false };
    together || species.site.solids || !species.prunes.is_empty()
}

/// Whether the growth of a species or one of its prunings needs the scene's solids.
pub(crate) fn needs_solids(species: &SpeciesRecipe) -> bool {
    species.site.solids || species.prunes.iter().any(|p| !p.solid.is_empty())
}

/// Grows the individuals of species; the result is parallel to the layout's individuals, `None` for other plants. `solids`:
/// those of the scene, in world space.
/// # Errors
/// As [`grow_recorded`].
pub fn grow_species(
    recipe: &Recipe,
    layout: &PlantLayout,
    solids: &[Solid],
    limits: &Limits,
) -> Result<Vec<Option<RecordedTree>>> {
    let transforms = layout.first_transforms();
    let mut out: Vec<Option<RecordedTree>> = layout.individuals.iter().map(|_| None).collect();
    // Trees that stand together are one job; every other tree is a separate job.
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
        let spans: Vec<Option<ClipSpan>> =
            job.iter().map(|i| clip_span(recipe, &layout.individuals[*i], oldest_age(recipe, layout, job))).collect();
        grow_recorded(&specs, &spans, &site, limits)
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

/// Greatest age of the trees of a job, years.
fn oldest_age(recipe: &Recipe, layout: &PlantLayout, job: &[usize]) -> f64 {
    let ages = job.iter().filter_map(|i| species_of(recipe, &layout.individuals[*i])).map(|species| species.age);
    ages.fold(0.0, f64::max)
}

/// The ages of a tree that the clip shows; `None` without a growth clip. `oldest`: greatest age of the trees that grow with it,
/// years.
/// Each of them is shown as it was when the oldest had the ages of the keys, so that younger ones appear later.
fn clip_span(recipe: &Recipe, individual: &Individual, oldest: f64) -> Option<ClipSpan> {
    let species = species_of(recipe, individual).filter(|_| recipe.clip.len() > 1)?;
    let [from, to] = species.clip?;
    if individual.together && species.site.from.is_none() && species.site.to.is_none() {
        // Shares of the age are those of the oldest tree; the tree itself is younger by the difference of their ages.
        let at = |age: f64| species.age - (1.0 - age / species.age) * oldest;
        return Some(ClipSpan { from: at(from), to: at(to) });
    }
    // Ages of the clip are those of the oldest tree: the others are younger by the difference of their ages.
    let later = if individual.together && species.site.from.is_none() { oldest - species.age } else { 0.0 };
    Some(ClipSpan { from: from - later, to })
}

fn tree_spec(recipe: &Recipe, individual: &Individual, transform: Trs, solids: &[Solid]) -> Option<TreeSpec> {
    let plant = recipe.plants.get(individual.plant)?;
    let species = species_of(recipe, individual)?;
    let ring = |k: &crate::recipe::scene::StandKeys| Neighbours {
        radius: narrow(k.radius),
        density: narrow(k.density),
        until: narrow(k.until),
    };
    // The position affects only a tree that grows in its place; others grow at the origin.
    let in_place = grows_in_place(plant, individual.together);
    Some(TreeSpec {
        name: plant.name.clone(),
        habit: species.habit.habit.clone(),
        seed: individual.seed,
        id: individual.id,
        base: if in_place { transform.t } else { Vec3::ZERO },
        age: species.age,
        neighbours: species.stand.as_ref().map(ring),
        prunes: species.prunes.iter().filter_map(|p| prune_of_keys(p, solids)).collect(),
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

/// Solids, with the roofs of houses, and the ground under them: the land if it is among them, else the plane y = 0.
pub(crate) fn ground_and_solids(solids: &[Solid]) -> Solids {
    let level = !solids.iter().any(|s| matches!(s.form, Form::Land(_)));
    let roofs = solids.iter().flat_map(roof_solids);
    Solids::new(solids.iter().cloned().chain(roofs).collect(), level)
}

/// A cut from the keys; `None` for one that keeps nothing, which resolving has reported.
fn prune_of_keys(keys: &PruneKeys, solids: &[Solid]) -> Option<Prune> {
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

/// Frames per year from which `clip_leaves = "auto"` shows the seasons: with fewer, leaves would flicker. Own: one frame per
/// month.
const SEASON_FRAMES: f64 = 12.0;

/// The recorded ages of a tree as a growth clip; `None` if it was not recorded. `frames`: intervals between the frames of the
/// clip.
/// # Errors
/// As [`GrownTree::plant`].
pub(crate) fn species_clip(
    tree: &RecordedTree,
    recipe: &PlantRecipe,
    set: &MaterialSet,
    frames: f64,
    limits: &Limits,
) -> Result<Option<GrowthClip>> {
    let (Some(record), Growth::Species(species)) = (&tree.record, &recipe.growth) else { return Ok(None) };
    let ClipSpan { from, to } = record.span();
    let frame_years = (to - from).abs() / frames.max(1.0);
    let leaves = match species.site.clip_leaves {
        // Too few frames in a year to show its seasons.
        LeafSeasons::Auto if frame_years * SEASON_FRAMES > 1.0 => ClipLeaves::Summer,
        LeafSeasons::Summer => ClipLeaves::Summer,
        LeafSeasons::Auto | LeafSeasons::Seasons => ClipLeaves::Seasons,
    };
    let options = plant_options(recipe, set);
    record.clip(&options, ClipOptions { leaves, frame_years }, limits).map(Some)
}

/// Turns a grown tree into a plant with the leaves of its materials; the diagnostics warn of a dead tree.
/// # Errors
/// As [`GrownTree::plant`].
pub(crate) fn species_plant(
    tree: &GrownTree,
    recipe: &PlantRecipe,
    set: &MaterialSet,
    limits: &Limits,
) -> Result<(Plant, Vec<Diagnostic>)> {
    let plant = tree.plant(&plant_options(recipe, set), limits)?;
    Ok((plant, death_warning(tree, recipe)))
}

/// Diagnostic S036 for a tree that died for lack of light, or of a cut; empty for one alive.
pub(crate) fn death_warning(tree: &GrownTree, recipe: &PlantRecipe) -> Vec<Diagnostic> {
    let died = tree.died().map(|year| {
        let (why, help) = if tree.died_of_cut() {
            let help =
                "let `keep` hold its foot and some of its twigs; a higher `epicormic` keeps buds that a cut wakes";
            (format!("the cut of year {year} left it neither tips nor buds"), help)
        } else {
            (format!("no light since year {year}"), "give it more room, fewer neighbours or a lower `shade_point`")
        };
        let text = format!("plant \"{}\" is dead: {why}", recipe.name);
        Diagnostic { help: Some(help.into()), ..Diagnostic::about("S036", text) }
    });
    died.into_iter().collect()
}

fn plant_options(recipe: &PlantRecipe, set: &MaterialSet) -> PlantOptions {
    let needles = recipe.organs.iter().any(|o| o.letter == 'l' && o.keys.blade == BladeOutline::Needles);
    let foliage = set.organs.get(&'l').map(|organ| match needles {
        true => Foliage::Needles(organ.clone()),
        false => Foliage::Blades(organ.clone()),
    });
    PlantOptions {
        foliage,
        materials: set.materials.iter().map(|m| m.name.clone()).collect(),
        bark: BARK,
        shoot: SHOOT,
        shoot_radius: SHOOT_RADIUS,
        dead: set.dead.unwrap_or(BARK),
        source: recipe.source.clone(),
    }
}

/// Diagnostics S003, one per plant, for plants that grow for one place but stand in several as the same individual.
pub(crate) fn shared_individuals(recipe: &Recipe, layout: &PlantLayout) -> Vec<Diagnostic> {
    let mut copies = vec![0_usize; layout.individuals.len()];
    layout.instances.iter().for_each(|s| copies[s.individual] += 1);
    let mut reported = vec![false; recipe.plants.len()];
    let mut out = Vec::new();
    for (individual, copies) in layout.individuals.iter().zip(copies) {
        let Some(plant) = recipe.plants.get(individual.plant) else { continue };
        // Two copies of one individual would show the obstacles and cuts of the first place at the second.
        let bound = grows_in_place(plant, individual.together);
        if bound && copies > 1 && !std::mem::replace(&mut reported[individual.plant], true) {
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
