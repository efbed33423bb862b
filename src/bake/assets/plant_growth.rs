//! From a grammar or a coefficient table to a plant.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::branchlets;
use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use crate::bake::scene::plant_layout::Individual;
use crate::recipe::KeyTable as _;
use crate::recipe::scene::CatkinKeys;
use crate::recipe::scene::set_letters;
use crate::recipe::scene::{BranchRadii, IfsTreeKeys};
use crate::recipe::scene::{LineStyle, TropismKeys};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::diagnostic::Report;
use osier_base::{Error, Result};
use osier_grammar::{DeriveOptions, derive};
use osier_ifs::stems::TreeSystem;
use osier_plants::grow::ifs;
use osier_plants::grow::mesh::MeshPlant;
use osier_plants::grow::radii::Taper;
use osier_plants::grow::turtle::{self, RadiusModel, Tropism, TurtleOptions};
use osier_scene::plant::Plant;

/// A grown plant.
#[derive(Debug)]
pub struct GrownPlant {
    /// It.
    pub plant: Plant,
    /// What was odd on the way.
    pub report: Report,
    /// Modules of its final string.
    pub modules: u64,
    /// The mesh that it was found in, and wears.
    pub own: Option<Arc<MeshPlant>>,
}

/// Derives and draws one individual.
/// # Errors
/// `Input` with what the derivation or the turtle refuses.
pub fn grow_plant(
    recipe: &PlantRecipe,
    individual: &Individual,
    look: &MaterialSet,
    context: &BakeContext<'_>,
) -> Result<GrownPlant> {
    let grammar = match &recipe.growth {
        Growth::Grammar(grammar) => grammar,
        Growth::Ifs(stems, keys) => {
            let options = tree_options(recipe, stems, keys, look);
            let of = (individual.id, individual.seed);
            let plant = if keys.twigs {
                let (mut tree, twigs) = ifs::branchlets::grow(stems, of, &options, context.limits)?;
                let tile = look.materials.first().map_or(0.5, |bark| bark.tile);
                branchlets::add_branchlet_meshes(&mut tree, &twigs, recipe, tile, context)?;
                tree
            } else {
                ifs::grow(stems, of, &options, context.limits)?
            };
            return Ok(GrownPlant { plant, report: Report::default(), modules: 0, own: None });
        }
        Growth::Mesh(..) => {
            let own = look.tree.clone();
            let tree = own.as_deref().ok_or_else(|| Error::input("S005", "a mesh without its skeleton"))?;
            let mut plant = tree.individual(individual.id, individual.seed, &recipe.source);
            plant.materials = look.materials.iter().map(|m| m.name.clone()).collect();
            return Ok(GrownPlant { plant, report: Report::default(), modules: 0, own });
        }
    };
    let options = DeriveOptions {
        seed: individual.seed,
        plant_id: individual.id,
        steps: recipe.keys.steps,
        stochastic: recipe.keys.stochastic,
    };
    let derived = derive(grammar, &options, context.limits)?;
    context.cancel.check()?;
    let mut report = Report { sources: grammar.sources().clone(), diagnostics: Vec::new() };
    let (plant, drawn) = turtle::grow(grammar, &derived, &turtle_options(recipe, look)?, context.limits)?;
    let modules = derived.modules.len() as u64;
    derived.warnings.into_iter().chain(drawn).for_each(|d| report.push(d));
    Ok(GrownPlant { plant, report, modules, own: None })
}

pub(crate) fn tree_options(
    recipe: &PlantRecipe,
    stems: &TreeSystem,
    keys: &IfsTreeKeys,
    look: &MaterialSet,
) -> ifs::TreeOptions {
    let short = |v: u32| u16::try_from(v).unwrap_or(u16::MAX);
    ifs::TreeOptions {
        height: keys.height,
        eps: keys.eps,
        max_depth: short(keys.max_depth),
        max_order: short(keys.max_order),
        variation: keys.variation,
        radius: keys.radius,
        pipe: keys.radii == BranchRadii::Pipe,
        leaf_density: keys.leaf_density,
        leaves_per_site: keys.leaves,
        leaf: look.organs.get(&'l').cloned(),
        sets: set_letters(&stems.system).filter_map(|letter| look.organs.get(&letter)).cloned().collect(),
        cards: look.cards.clone(),
        materials: look.materials.iter().map(|m| m.name.clone()).collect(),
        bark: (BARK, SHOOT, f64::from(SHOOT_RADIUS)),
        source: recipe.source.clone(),
        up: Vec3::Y,
    }
}

fn turtle_options(recipe: &PlantRecipe, look: &MaterialSet) -> Result<TurtleOptions> {
    let keys = &recipe.turtle;
    let own = TurtleOptions::default();
    let byte = |v: Option<u32>, own: u8| v.and_then(|v| u8::try_from(v).ok()).unwrap_or(own);
    let mut organs = BTreeMap::new();
    for (letter, spec) in &look.organs {
        organs.insert(*letter, spec.clone());
    }
    if keys.tropisms.len() > 8 {
        let (value, max) = (f64::from(u32::try_from(keys.tropisms.len()).unwrap_or(u32::MAX)), 8.0);
        return Err(Error::Range { name: "number of tropisms".into(), value, min: 0.0, max, unit: "" });
    }
    Ok(TurtleOptions {
        angle: keys.angle,
        unit_m: keys.unit,
        width: keys.width.unwrap_or(if keys.line == Some(LineStyle::Pixel) { 0.02 } else { own.width }),
        radii: radii(recipe),
        width_increment: keys.width_increment.unwrap_or(own.width_increment),
        color: byte(keys.color, own.color),
        color_increment: byte(keys.color_increment, own.color_increment),
        scale: keys.scale.unwrap_or(own.scale),
        scale_multiplier: keys.scale_multiplier.unwrap_or(own.scale_multiplier),
        tapered: keys.tapered.unwrap_or(own.tapered),
        tropisms: keys.tropisms.iter().map(tropism).collect(),
        tropism_keep_roll: keys.tropism_keep_roll,
        organs,
        materials: look.materials.iter().map(|m| m.name.clone()).collect(),
        axis_material: BARK,
        shoot_material: Some(SHOOT),
        shoot_radius: f64::from(SHOOT_RADIUS),
        source: recipe.source.clone(),
        ..own
    })
}

/// A tuft's hairs are hairs where nothing sets their widths.
fn radii(recipe: &PlantRecipe) -> RadiusModel {
    match &recipe.growth {
        Growth::Grammar(grammar) if grammar.is_tuft() => {
            let own = CatkinKeys::defaults();
            let base = recipe.turtle.width.map_or(own.hair_radius, |w| 0.5 * w * recipe.turtle.unit);
            RadiusModel::Hairs(Taper { base, tip: base * own.tip, exponent: 1.0 })
        }
        _ => RadiusModel::Auto,
    }
}

fn tropism(keys: &TropismKeys) -> Tropism {
    Tropism {
        dir: DVec3::from_array(keys.dir),
        angle: keys.angle,
        intensity: keys.intensity,
        elasticity: keys.elasticity,
        step: keys.step,
        torque: false,
    }
}
