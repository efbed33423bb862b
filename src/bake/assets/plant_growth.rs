//! Growth of an individual: by its grammar, by an IFS tree, by particle-shapes, year by year, or from the skeleton of an imported mesh.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;

use crate::bake::BakeContext;
use crate::bake::assets::branchlets;
use crate::bake::assets::growth_site::GrowthSite;
use crate::bake::assets::ifs_tree::ifs_tree_options;
use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::seasons::{SeasonClip, season_clip, show_season};
use crate::bake::assets::shape_growth::{fill_with_twigs, grow_shapes};
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use crate::bake::assets::species_growth::{death_warning, species_clip, species_plant};
use crate::bake::scene::plant_layout::Individual;
use crate::recipe::KeyTable as _;
use crate::recipe::scene::CatkinKeys;
use crate::recipe::scene::{ClipSteps, GrammarRandom, LineStyle, TropismKeys};
use crate::recipe::{Growth, OrganRecipe, PlantRecipe, SurfaceForm};
use osier_base::convert::saturating_byte;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::units::radians;
use osier_base::{Error, Result};
use osier_grammar::companion::{ContourFile, LineStyle as ViewLine, View, ViewTropism};
use osier_grammar::{DeriveOptions, DerivedString, Grammar};
use osier_plants::crown::crown_attributes;
use osier_plants::grow::clip::PosedGrowth;
use osier_plants::grow::ifs;
use osier_plants::grow::mesh::MeshPlant;
use osier_plants::grow::radii::Taper;
use osier_plants::grow::turtle::{
    self, Contour, DevelopmentClip, DevelopmentOptions, Drawing, OrganSpec, RadiusModel, Tropism, TurtleOptions,
};
use osier_scene::plant::Plant;

/// An individual after growth, before meshes and materials are made of it.
#[derive(Debug)]
pub struct GrownPlant {
    /// Axes, nodes and organs, in plant space, with the leaves of its season.
    pub plant: Plant,
    /// Warnings of derivation and turtle.
    pub report: Report,
    /// Modules of the final string; 0 without a grammar.
    pub modules: u64,
    /// The imported mesh that the skeleton was extracted from, and that is its bark; `None` for other plants.
    pub imported: Option<Arc<MeshPlant>>,
    /// The plant at the years or derivation steps that a clip of its growth shows; `None` without such a clip.
    pub clip: Option<Arc<dyn PosedGrowth>>,
    /// The organ that replaces each segment where the plant is shown by its segments; `None`: prisms.
    pub segment: Option<OrganSpec>,
    /// How its leaves change over the clip; `None` for leaves that stay.
    pub season: Option<SeasonClip>,
}

/// Grows one individual with the organs of its plant's materials, adds twigs if its recipe has a fill, and gives its leaves
/// their season.
/// # Errors
/// `Input` with the faults of derivation or turtle, `Limit`, `Cancelled`.
pub fn grow_plant(
    recipe: &PlantRecipe,
    individual: &Individual,
    set: &MaterialSet,
    site: GrowthSite<'_>,
    context: &BakeContext<'_>,
) -> Result<GrownPlant> {
    let mut grown = grow_individual(recipe, individual, set, site, context)?;
    // Twigs precede the season, so that their leaves turn and fall like all others.
    fill_with_twigs(&mut grown.plant, recipe, set, site)?.into_iter().for_each(|d| grown.report.push(d));
    grown.show_season(recipe, individual, set, site.frames)?;
    grown.segment = recipe.skin.segment.chars().next().and_then(|letter| set.organs.get(&letter)).cloned();
    Ok(grown)
}

impl GrownPlant {
    /// A plant without a string, an imported mesh, an organ for its segments and changes over the clip.
    fn new(plant: Plant, report: Report) -> Self {
        Self { plant, report, modules: 0, imported: None, clip: None, segment: None, season: None }
    }

    /// Shows the plant at its season, and gives its leaves the attributes of their crown.
    fn show_season(
        &mut self,
        recipe: &PlantRecipe,
        individual: &Individual,
        set: &MaterialSet,
        frames: f64,
    ) -> Result<()> {
        // `frames` counts intervals: 0 for a still picture, whose season is that of its only frame.
        let changes = frames > 0.0 && recipe.keys.season.is_some_and(|s| s.changes());
        // A fixed season is applied before the crown attributes, since a crown that has lost leaves is lighter. Leaves that
        // change over the clip keep the occlusion of summer.
        if !changes {
            show_season(&mut self.plant, recipe, individual, set)?;
        }
        add_crown_attributes(&mut self.plant, recipe);
        if changes {
            self.season = season_clip(&mut self.plant, recipe, individual, set, frames)?;
        }
        Ok(())
    }

    /// The plant for formats without frames: with the leaves of the first frame, or a growing plant at the end of the last year
    /// that the clip shows; `None` if the plant does not change over the clip.
    /// # Errors
    /// As [`PosedGrowth::plant_at_end`].
    pub(crate) fn at_one_time(&self, recipe: &PlantRecipe, limits: &Limits) -> Result<Option<Self>> {
        let mut plant = match (&self.season, &self.clip) {
            (Some(season), _) => season.first.clone(),
            // The plant of a clip also contains wood that falls before its end: take the tree at the end of its last year,
            // without that wood.
            (None, Some(clip)) => clip.plant_at_end(limits)?,
            // A plant that stays the same needs no copy.
            (None, None) => return Ok(None),
        };
        add_crown_attributes(&mut plant, recipe);
        let (imported, segment) = (self.imported.clone(), self.segment.clone());
        Ok(Some(Self { modules: self.modules, imported, segment, ..Self::new(plant, Report::default()) }))
    }
}

/// Gives the leaves of a plant the attributes of their crown that its keys want.
fn add_crown_attributes(plant: &mut Plant, recipe: &PlantRecipe) {
    let keys = &recipe.keys;
    if keys.canopy_occlusion || keys.canopy_normals > 0.0 {
        let crown = crown_attributes(plant, keys.canopy_occlusion, narrow(keys.canopy_normals));
        plant.organ_attributes.extend(crown);
    }
}

/// Grows one individual by its grammar, table, particle-shapes, species or mesh; without twigs of a fill and without season.
fn grow_individual(
    recipe: &PlantRecipe,
    individual: &Individual,
    set: &MaterialSet,
    site: GrowthSite<'_>,
    context: &BakeContext<'_>,
) -> Result<GrownPlant> {
    let grammar = match &recipe.growth {
        Growth::Grammar(grammar) => grammar,
        Growth::Ifs(stems, keys) => {
            let options = ifs_tree_options(recipe, stems, keys, set);
            let identity = (individual.id, individual.seed);
            let plant = if keys.twigs {
                let (mut tree, twigs) = ifs::branchlets::grow(stems, identity, &options, context.limits)?;
                branchlets::skin_branchlets(&mut tree, &twigs, recipe, set.bark_tiles(), context)?;
                tree
            } else {
                ifs::grow(stems, identity, &options, context.limits)?
            };
            return Ok(GrownPlant::new(plant, Report::default()));
        }
        Growth::Shapes(keys) => {
            let (plant, warnings) = grow_shapes(keys, recipe, individual, set, site)?;
            let report = Report { diagnostics: warnings, ..Report::default() };
            return Ok(GrownPlant::new(plant, report));
        }
        Growth::Species(_) => {
            // Species are grown before all other plants, since trees that stand together shade each other.
            let tree = site.tree.ok_or_else(|| Error::input("S005", "a species without its tree"))?;
            let (plant, clip, warnings) = match species_clip(tree, recipe, set, site.frames, context.limits)? {
                Some(clip) => {
                    let plant = clip.plant.clone();
                    let clip: Arc<dyn PosedGrowth> = Arc::new(clip);
                    (plant, Some(clip), death_warning(&tree.tree, recipe))
                }
                None => {
                    let (plant, warnings) = species_plant(&tree.tree, recipe, set, context.limits)?;
                    (plant, None, warnings)
                }
            };
            let report = Report { diagnostics: warnings, ..Report::default() };
            return Ok(GrownPlant { clip, ..GrownPlant::new(plant, report) });
        }
        Growth::Mesh(..) => {
            let imported = set.tree.clone();
            let tree = imported.as_deref().ok_or_else(|| Error::input("S005", "a mesh without its skeleton"))?;
            let mut plant = tree.individual(individual.id, individual.seed, &recipe.source);
            plant.materials = set.materials.iter().map(|m| m.name.clone()).collect();
            return Ok(GrownPlant { imported, ..GrownPlant::new(plant, Report::default()) });
        }
    };
    let mut report = Report { sources: grammar.sources().clone(), ..Report::default() };
    // A clip shows the plant through its derivation, if the grammar allows that.
    match develop(recipe, individual, set, site.frames, context)? {
        Development::Clip(mut clip) => {
            report.output = std::mem::take(&mut clip.output);
            std::mem::take(&mut clip.warnings).into_iter().for_each(|d| report.push(d));
            let (plant, modules) = (clip.plant.clone(), clip.modules);
            return Ok(GrownPlant { modules, clip: Some(Arc::new(*clip)), ..GrownPlant::new(plant, report) });
        }
        Development::None => {}
        Development::Refused(warning) => report.push(warning),
    }
    // Derivation of the grammar's string, then its interpretation by the turtle.
    let derived = derive_string(recipe, grammar, individual, set, context)?;
    // Neither derivation nor interpretation checks for cancellation within.
    context.cancel.check()?;
    report.output.clone_from(&derived.output);
    let Drawing { plant, warnings, output } =
        turtle::draw(grammar, &derived, &turtle_options(recipe, set)?, context.limits)?;
    report.output.push_str(&output);
    let modules = derived.module_count();
    derived.warnings.into_iter().chain(warnings).for_each(|d| report.push(d));
    Ok(GrownPlant { modules, ..GrownPlant::new(plant, report) })
}

/// The development of a grammar's plant over a clip.
enum Development {
    /// The plant at the steps that the clip shows.
    Clip(Box<DevelopmentClip>),
    /// The scene has no such clip, or shows the grown plant.
    None,
    /// The plant cannot be shown so, with the warning that says why.
    Refused(Diagnostic),
}

/// Prepares the development of one individual over the clip. `frames`: number of intervals between the frames, 0 for a still picture.
/// # Errors
/// `Input` with the faults of derivation and drawing.
fn develop(
    recipe: &PlantRecipe,
    individual: &Individual,
    set: &MaterialSet,
    frames: f64,
    context: &BakeContext<'_>,
) -> Result<Development> {
    let keys = &recipe.keys;
    let Growth::Grammar(grammar) = &recipe.growth else { return Ok(Development::None) };
    let Some(shares) = keys.growth_clip.filter(|_| frames > 0.0 && keys.clip_steps != ClipSteps::Unveil) else {
        return Ok(Development::None);
    };
    let refused = |why: &str| {
        let text = format!("plant \"{}\" appears from its base on: its steps cannot be shown in parts", recipe.name);
        Development::Refused(Diagnostic::about("S007", text).help(format!("because {why}")))
    };
    // Both change the plant after it has been drawn.
    if recipe.fill.is_some() || keys.season.is_some() {
        return Ok(refused(if recipe.fill.is_some() {
            "`twigs` are added to the grown plant"
        } else {
            "it has a season"
        }));
    }
    let derivation = derivation_options(recipe, individual);
    let turtle = TurtleOptions { step_part: None, ..turtle_options(recipe, set)? };
    let steps = keys.steps.unwrap_or(f64::INFINITY);
    let clip = DevelopmentOptions { steps, shares, whole_steps: keys.clip_steps == ClipSteps::Whole };
    match DevelopmentClip::new(grammar, &derivation, turtle, clip, context.limits) {
        Ok(clip) => Ok(Development::Clip(Box::new(clip))),
        // Only the development is refused; the plant itself may be drawn.
        Err(Error::Input(report)) if report.diagnostics.iter().any(|d| d.code == "L063") => {
            Ok(refused(report.diagnostics.first().map_or("", |d| d.message.as_str())))
        }
        Err(error) => Err(error),
    }
}

/// Derives the string of one individual. `set`: the organs of its plant, which queries about the turtle's position may need.
/// # Errors
/// `Input` with the faults of the derivation.
fn derive_string(
    recipe: &PlantRecipe,
    grammar: &Grammar,
    individual: &Individual,
    set: &MaterialSet,
    context: &BakeContext<'_>,
) -> Result<DerivedString> {
    let options = derivation_options(recipe, individual);
    turtle::derive(grammar, &options, &turtle_options(recipe, set)?, context.limits)
}

/// The string of one individual as text, and its warnings.
/// # Errors
/// `Input` with the faults of the derivation.
pub fn derived_string_text(
    recipe: &PlantRecipe,
    grammar: &Grammar,
    individual: &Individual,
    context: &BakeContext<'_>,
) -> Result<DerivedString> {
    // The materials of organs do not change a string.
    let turtle = turtle_options(recipe, &MaterialSet::default())?;
    turtle::derive_text(grammar, &derivation_options(recipe, individual), &turtle, context.limits)
}

/// Number of derivation steps, rounded up: a fraction draws a part of the last one.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the key ends at a million steps")]
fn whole_steps(steps: f64) -> u32 {
    steps.ceil() as u32
}

fn derivation_options(recipe: &PlantRecipe, individual: &Individual) -> DeriveOptions {
    DeriveOptions {
        seed: individual.seed,
        plant_id: individual.id,
        steps: recipe.keys.steps.map(whole_steps),
        stochastic: recipe.keys.stochastic,
        draw_as_cpfg: recipe.keys.rng == GrammarRandom::Cpfg,
    }
}

/// Whether the grammar itself assigns colours to colour indices.
fn has_palette(recipe: &PlantRecipe) -> bool {
    matches!(&recipe.growth, Growth::Grammar(grammar) if !grammar.palette().is_empty())
}

/// Options of the turtle from the keys of `[plants.NAME.turtle]`, which override those of the grammar.
fn turtle_options(recipe: &PlantRecipe, set: &MaterialSet) -> Result<TurtleOptions> {
    let keys = &recipe.turtle;
    let defaults = TurtleOptions::default();
    let companions = &recipe.companions;
    let own = View::default();
    let view = companions.view.as_ref().unwrap_or(&own);
    // Three layers, here and below: the scene's key, the grammar's view file, the default.
    let byte = |v: Option<u32>, of_view: Option<u8>, default: u8| v.map_or(of_view.unwrap_or(default), saturating_byte);
    let mut organs = BTreeMap::new();
    for (letter, spec) in &set.organs {
        organs.insert(*letter, spec.clone());
    }
    // Tropisms of the scene replace those of the view.
    let tropisms: Vec<Tropism> = match &keys.tropisms[..] {
        [] => view.tropisms.iter().map(view_tropism).collect(),
        own => own.iter().map(turtle_tropism).collect(),
    };
    if tropisms.len() > 8 {
        let (value, max) = (tropisms.len() as f64, 8.0);
        return Err(Error::Range { name: "number of tropisms".into(), value, min: 0.0, max, unit: "" });
    }
    Ok(TurtleOptions {
        angle: keys.angle.or(view.angle.map(radians)),
        unit_m: keys.unit,
        width: keys.width.or(view.width).unwrap_or(defaults.width),
        radii: radius_model(recipe),
        width_increment: keys.width_increment.or(view.width_increment).unwrap_or(defaults.width_increment),
        color: byte(keys.color, view.color, defaults.color),
        color_increment: byte(keys.color_increment, view.color_increment, defaults.color_increment),
        scale: keys.scale.or(view.scale).unwrap_or(defaults.scale),
        scale_multiplier: keys.scale_multiplier.or(view.scale_multiplier).unwrap_or(defaults.scale_multiplier),
        tapered: keys.tapered.or(view.tapered).unwrap_or(defaults.tapered),
        tropisms,
        painted: companions.colors.is_some() || has_palette(recipe),
        contours: companions.contours.iter().map(|(id, c)| (*id, contour(c))).collect(),
        sides: keys.sides.or(view.sides).unwrap_or(defaults.sides),
        past_cut: view.past_cut.unwrap_or(defaults.past_cut),
        twist: keys.twist.or(view.twist).unwrap_or(defaults.twist),
        textures: set.textures.clone(),
        old_tropism: DVec3::from_array(keys.old_tropism.or(view.old_direction).unwrap_or([0.0, 1.0, 0.0])),
        old_elasticity: keys.old_elasticity.or(view.old_elasticity).unwrap_or(0.0),
        old_increment: keys.old_increment.or(view.old_increment).unwrap_or(0.0),
        organ_ends: recipe.organs.iter().filter_map(organ_end).collect(),
        tropism_keep_roll: keys.tropism_keep_roll,
        organs,
        materials: set.materials.iter().map(|m| m.name.clone()).collect(),
        axis_material: BARK,
        shoot_material: Some(SHOOT),
        shoot_radius: f64::from(SHOOT_RADIUS),
        step_part: recipe.keys.steps.map(f64::fract).filter(|part| *part > 0.0),
        source: recipe.source.clone(),
        ..defaults
    })
}

/// Radii from the grammar's widths; hairs of a tuft taper to the catkins' tip radius.
fn radius_model(recipe: &PlantRecipe) -> RadiusModel {
    match &recipe.growth {
        Growth::Grammar(grammar) if grammar.is_tuft() => {
            let own = CatkinKeys::defaults();
            // A width is a diameter in units of the turtle, a hair has a radius in metres.
            let base = recipe.turtle.width.map_or(own.hair_radius, |w| 0.5 * w * recipe.turtle.unit);
            RadiusModel::Hairs(Taper { base, tip: base * own.tip, exponent: 1.0 })
        }
        Growth::Grammar(_) => {
            let view = recipe.companions.view.as_ref();
            let of_view = view.map(|v| v.line.unwrap_or(ViewLine::Pixel) == ViewLine::Pixel);
            let line = recipe.turtle.line.map(|l| l == LineStyle::Pixel);
            // The scene's line style has precedence over that of the view, which in cpfg is pixels.
            // A width given by the scene is in units of the turtle.
            match line.or(of_view).filter(|_| recipe.turtle.width.is_none()) {
                Some(true) => RadiusModel::Pixels,
                Some(false) => RadiusModel::Widths,
                None if recipe.turtle.width.is_some() => RadiusModel::Widths,
                None => RadiusModel::Auto,
            }
        }
        _ => RadiusModel::Auto,
    }
}

fn contour(file: &ContourFile) -> Contour {
    Contour { curve: file.spline(), closed: file.closed }
}

/// The point of an organ that the turtle moves to, in the units of its mesh.
fn organ_end(organ: &OrganRecipe) -> Option<(char, DVec3)> {
    let SurfaceForm::Patches(surface) = &organ.surface.as_ref()?.form else { return None };
    let end = DVec3::from_array(surface.organ_point(surface.end));
    (end.length() > 1e-9).then_some((organ.letter, end))
}

fn view_tropism(of: &ViewTropism) -> Tropism {
    Tropism {
        dir: DVec3::from_array(of.dir),
        angle: radians(of.angle),
        intensity: of.intensity,
        elasticity: of.elasticity,
        step: of.step,
        torque: of.torque,
    }
}

fn turtle_tropism(keys: &TropismKeys) -> Tropism {
    Tropism {
        dir: DVec3::from_array(keys.dir),
        angle: keys.angle,
        intensity: keys.intensity,
        elasticity: keys.elasticity,
        step: keys.step,
        torque: keys.torque,
    }
}
