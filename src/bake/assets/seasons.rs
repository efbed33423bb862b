//! Plants at a season: materials of leaves in the colours that they have then, and the grown plants with these leaves.

use std::collections::{BTreeMap, BTreeSet};

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::plant_materials::{leaf_blade_spec, leaf_colors, organ_names};
use crate::bake::assets::season_materials::{OrganSeason, SeasonMaterials};
use crate::bake::scene::plant_layout::Individual;
use crate::recipe::scene::{BladeOutline, OrganKeys, SeasonCourse};
use crate::recipe::{CARD, Growth, OrganRecipe, PlantRecipe};
use osier_base::Result;
use osier_base::convert::to_usize;
use osier_base::math::narrow;
use osier_base::rng::{Rng, mix64, word};
use osier_plants::season::{
    AutumnColor, BudOrgan, FallOrder, LeafColor, LeafHabit, PlantSeason, SeasonSlots, SeasonalOrgan, apply_season,
    colors_between, mean_color, mixed, recolored, season_slots,
};
use osier_plants::surface::leaf::{LeafColors, leaf_color_maps};
use osier_scene::plant::Plant;
use osier_scene::{Material, MaterialClass};

/// Name of the organ that holds all winter buds of a plant.
pub(crate) const BUD: &str = "bud";
/// Most by which an individual's season is ahead of the plant's or behind it, in the middle of the year: trees of one species
/// do not turn on the same day.
const MAX_INDIVIDUAL_SHIFT: f64 = 0.03;
/// Linear colour and roughness of bud scales. Own: brown, by eye.
const BUD_COLOR: [f32; 3] = [0.095, 0.052, 0.028];
const BUD_ROUGHNESS: f32 = 0.55;
/// Linear colour of dry leaves, towards which autumn's colours age. Own: by eye.
const DRY_LEAF_COLOR: [f32; 3] = [0.165, 0.085, 0.038];
/// Linear colour with which that of the first leaves of spring is mixed, after summer's has been multiplied by
/// [`SPRING_LIGHT`].
const SPRING_COLOR: [f32; 3] = [0.30, 0.40, 0.055];
const SPRING_LIGHT: f32 = 1.7;
/// Share of the summer's colours that veins keep in turning and in turned leaves: they are green longest.
const VEIN_SUMMER_SHARES: [f32; 2] = [0.85, 0.3];
/// Share of a plant's growth that counts as its last year where growth has no years. Own: by eye.
const LAST_YEAR: f32 = 0.02;
/// Translucency of dry leaves as a share of that of fresh ones.
const DRY_TRANSLUCENCY: f32 = 0.5;

/// Colours, leaf fall and buds of the species to which a leaf outline belongs.
struct OutlineHabit {
    /// sRGB colours from sun to shade, with their weights.
    autumn: &'static [([u8; 3], f64)],
    falls: FallOrder,
    /// Length of a winter bud, m.
    bud: f64,
}

/// Own: chosen by eye from photographs of oak, birch, poplar, beech, maple and larch.
fn outline_habit(blade: BladeOutline) -> OutlineHabit {
    match blade {
        BladeOutline::Lobed => OutlineHabit {
            autumn: &[
                ([0xa8, 0x55, 0x25], 3.0),
                ([0xc0, 0x7f, 0x2e], 3.0),
                ([0xb5, 0x93, 0x3c], 2.0),
                ([0x8a, 0x5c, 0x30], 2.0),
            ],
            falls: FallOrder::Tips,
            bud: 0.006,
        },
        BladeOutline::Toothed => OutlineHabit {
            autumn: &[([0xe8, 0xbe, 0x36], 4.0), ([0xda, 0xa4, 0x28], 2.0), ([0xd0, 0xbe, 0x50], 2.0)],
            falls: FallOrder::Bases,
            bud: 0.006,
        },
        BladeOutline::Deltoid => OutlineHabit {
            autumn: &[([0xe8, 0xbf, 0x38], 4.0), ([0xd9, 0xa8, 0x2c], 2.0), ([0xb4, 0x93, 0x3a], 1.0)],
            falls: FallOrder::Bases,
            bud: 0.010,
        },
        BladeOutline::Elliptic => OutlineHabit {
            autumn: &[
                ([0xb8, 0x5a, 0x26], 3.0),
                ([0xcf, 0x86, 0x2f], 3.0),
                ([0xd2, 0xa2, 0x3c], 2.0),
                ([0x98, 0x5c, 0x30], 1.0),
            ],
            falls: FallOrder::Tips,
            bud: 0.009,
        },
        // Maples: yellow, orange and red on one tree.
        BladeOutline::Palmate => OutlineHabit {
            autumn: &[
                ([0xd8, 0x8a, 0x26], 3.0),
                ([0xe3, 0xb2, 0x34], 3.0),
                ([0xc4, 0x4e, 0x24], 2.0),
                ([0xc9, 0xb0, 0x4a], 1.0),
            ],
            falls: FallOrder::Tips,
            bud: 0.008,
        },
        // Petals wither; no bud takes their place.
        BladeOutline::Petal => OutlineHabit {
            autumn: &[([0xb8, 0xa0, 0x84], 2.0), ([0x9c, 0x82, 0x66], 1.0)],
            falls: FallOrder::Random,
            bud: 0.0,
        },
        BladeOutline::Needles => OutlineHabit {
            autumn: &[([0xd8, 0xa0, 0x36], 3.0), ([0xc6, 0x8a, 0x2e], 2.0)],
            falls: FallOrder::Random,
            bud: 0.004,
        },
    }
}

/// Adds the materials that the leaves of a plant need at its seasons, and its buds. `set` holds all other materials.
/// # Errors
/// `Range` for blades outside their ranges, `TooMany`.
pub fn add_season_materials(set: &mut MaterialSet, plant: &PlantRecipe, seed: u64) -> Result<()> {
    let Some(course) = plant.season_course() else { return Ok(()) };
    let [from, to] = course.range();
    // Individuals are ahead or behind by up to MAX_INDIVIDUAL_SHIFT: colours are needed for the whole range.
    let between = [shift_season(from, -MAX_INDIVIDUAL_SHIFT), shift_season(to, MAX_INDIVIDUAL_SHIFT)].map(narrow);
    let mut season = SeasonMaterials::default();
    let mut bud_material = None;
    for (recipe, name) in plant.organs.iter().zip(organ_names(plant)).filter(|(o, _)| o.letter != CARD) {
        let Some(organ) = set.organs.get(&recipe.letter) else { continue };
        // Only the leaf materials of an organ change; others, such as that of a flower's stalk, stay.
        let used: BTreeSet<u32> = organ.meshes.iter().flat_map(|m| &m.subsets).map(|s| s.material).collect();
        let leaves: Vec<u32> = used.into_iter().filter(|m| is_leaf(set, *m)).collect();
        let Some(first) = leaves.first().and_then(|m| set.materials.get(to_usize(*m))) else { continue };
        let painted = generated_blade_colors(recipe);
        let image = first.maps.color.and_then(|i| set.images.get(to_usize(i)));
        // The mean colour of summer, from which spring's and autumn's colours start.
        let green = match &painted {
            Some(colors) => mixed(colors.blade[0], colors.blade[1], 0.5),
            None => image.and_then(mean_color).unwrap_or(first.base_color),
        };
        let habit = LeafHabit { last_year: last_year(plant), ..leaf_habit(&recipe.keys, green) };
        let mut materials = BTreeMap::new();
        let colors = colors_between(&habit, between);
        for base in leaves {
            add_colored_materials(set, plant, recipe, &name, base, &habit, &colors, seed, &mut materials)?;
        }
        let length = recipe.keys.bud.unwrap_or(outline_habit(recipe.keys.blade).bud);
        // All organs of the plant share one material of buds, which is made for the first that has any.
        let bud = match (habit.evergreen || length <= 0.0, bud_material) {
            (true, _) => None,
            (false, Some(material)) => Some(BudOrgan { length: narrow(length), material }),
            (false, None) => {
                let scales =
                    Material::plain(format!("{}_{BUD}", plant.id), MaterialClass::Bark, BUD_COLOR, BUD_ROUGHNESS);
                let material = set.add(scales, Vec::new())?;
                bud_material = Some(material);
                Some(BudOrgan { length: narrow(length), material })
            }
        };
        season.organs.push(OrganSeason { name, habit, materials, bud });
    }
    if bud_material.is_some() {
        set.names.push(BUD.into());
    }
    set.season = Some(season);
    Ok(())
}

fn is_leaf(set: &MaterialSet, material: u32) -> bool {
    set.materials.get(to_usize(material)).is_some_and(|m| m.class == MaterialClass::Leaf)
}

/// The colours that a blade is painted with; `None` for leaves from files, tables and needles.
fn generated_blade_colors(recipe: &OrganRecipe) -> Option<LeafColors> {
    let is_file = recipe.mesh.is_some() || recipe.surface.is_some();
    let painted = !is_file && recipe.ifs.is_none() && recipe.keys.blade != BladeOutline::Needles;
    painted.then(|| leaf_colors(&recipe.keys))
}

fn leaf_habit(keys: &OrganKeys, green: [f32; 3]) -> LeafHabit {
    let own = outline_habit(keys.blade);
    let of_bytes = |c: [u8; 3]| c.map(|b| osier_base::units::linear_from_srgb(f32::from(b) / 255.0));
    let autumn = if keys.autumn.is_empty() {
        own.autumn.iter().map(|(c, weight)| AutumnColor { color: of_bytes(*c), weight: *weight }).collect()
    } else {
        let weight = |i: usize| keys.autumn_weights.get(i).copied().unwrap_or(1.0);
        keys.autumn.iter().enumerate().map(|(i, c)| AutumnColor { color: *c, weight: weight(i) }).collect()
    };
    let lighter = green.map(|c| (c * SPRING_LIGHT).min(1.0));
    LeafHabit {
        evergreen: keys.evergreen.unwrap_or(keys.blade == BladeOutline::Needles),
        last_year: LAST_YEAR,
        green,
        spring: keys.spring.unwrap_or(mixed(lighter, SPRING_COLOR, 0.45)),
        dry: DRY_LEAF_COLOR,
        autumn,
        falls: keys.falls.unwrap_or(own.falls),
        keeps: narrow(keys.keeps),
        bends: keys.blade != BladeOutline::Needles || keys.ifs.is_some() || keys.mesh.is_some(),
    }
}

/// Share of a plant's growth time taken by its last year, in which its youngest shoots grew; slightly reduced, so that ends of
/// the previous year's shoots are not included.
fn last_year(plant: &PlantRecipe) -> f32 {
    let Growth::Species(species) = &plant.growth else { return LAST_YEAR };
    // With a fraction the last year has only begun.
    let years = species.age - (species.age.ceil() - 1.0);
    narrow(0.999 * years / species.age)
}

/// Suffix of the name of a material in a leaf colour.
fn color_word(color: LeafColor) -> String {
    match color {
        LeafColor::Green => "green".into(),
        LeafColor::Fresh => "fresh".into(),
        LeafColor::Young => "young".into(),
        LeafColor::Turning(i) => format!("turning_{i}"),
        LeafColor::Turned(i) => format!("turned_{i}"),
        LeafColor::Aged(i) => format!("aged_{i}"),
    }
}

/// Colours to paint a blade with in a season: veins keep their green longest, margins lose it first.
fn season_colors(summer: &LeafColors, habit: &LeafHabit, color: LeafColor) -> LeafColors {
    // 0.76 and 1.24 span the light and dark of painted summer leaves about their mean. Own: by eye.
    let scaled = |c: [f32; 3], k: f32| c.map(|v| (v * k).min(1.0));
    let whole = |c: [f32; 3], veins: f32, edge: [f32; 3]| LeafColors {
        blade: [scaled(c, 0.76), scaled(c, 1.24)],
        vein: mixed(scaled(c, 1.5), summer.vein, veins),
        edge,
        roughness: summer.roughness,
    };
    match color {
        LeafColor::Green => *summer,
        LeafColor::Fresh | LeafColor::Young => {
            let c = habit.color(color);
            whole(c, 0.3, scaled(c, 1.2))
        }
        LeafColor::Turning(i) => {
            let hue = habit.autumn_color(i);
            LeafColors {
                // The darker patches stay green longer.
                blade: [mixed(summer.blade[0], hue, 0.22), mixed(summer.blade[1], hue, 0.78)],
                vein: mixed(hue, summer.vein, VEIN_SUMMER_SHARES[0]),
                edge: hue,
                roughness: summer.roughness,
            }
        }
        LeafColor::Turned(i) => {
            let hue = habit.autumn_color(i);
            whole(hue, VEIN_SUMMER_SHARES[1], mixed(hue, habit.dry, 0.5))
        }
        LeafColor::Aged(_) => {
            let c = habit.color(color);
            LeafColors { roughness: (summer.roughness + 0.2).min(1.0), ..whole(c, 0.0, scaled(habit.dry, 0.7)) }
        }
    }
}

/// Adds to `set` a copy of the material `base` for each of `colors`, and records its index in `materials`.
fn add_colored_materials(
    set: &mut MaterialSet,
    plant: &PlantRecipe,
    recipe: &OrganRecipe,
    organ: &str,
    base: u32,
    habit: &LeafHabit,
    colors: &BTreeSet<LeafColor>,
    seed: u64,
    materials: &mut BTreeMap<(u32, LeafColor), u32>,
) -> Result<()> {
    let Some(summer) = set.materials.get(to_usize(base)).cloned() else { return Ok(()) };
    let summer_image = summer.maps.color.and_then(|i| set.images.get(to_usize(i)));
    let name = |color: LeafColor| format!("{}_{}", summer.name, color_word(color));
    // Blades made from parameters are painted again; other pictures are recoloured and keep their variation of brightness.
    let pictures = match (generated_blade_colors(recipe), summer_image) {
        (Some(own), Some(_)) => {
            let spec = leaf_blade_spec(&recipe.keys, mix64(&[seed, word(&plant.id), word(organ)]));
            let list: Vec<_> = colors.iter().map(|c| (name(*c), season_colors(&own, habit, *c))).collect();
            leaf_color_maps(&spec, &list, recipe.keys.side)?
        }
        (None, Some(image)) => {
            let mean = mean_color(image).unwrap_or(habit.green);
            let paint = |c: &LeafColor| recolored(image, format!("{}_color", name(*c)), mean, habit.color(*c), 1.0);
            colors.iter().map(paint).collect()
        }
        (_, None) => Vec::new(),
    };
    for (k, color) in colors.iter().enumerate() {
        let mut material = Material { name: name(*color), base_color: habit.color(*color), ..summer.clone() };
        // Dry tissue scatters light back instead of passing it.
        if matches!(color, LeafColor::Aged(_)) {
            material.translucency *= DRY_TRANSLUCENCY;
        }
        if let Some(picture) = pictures.get(k) {
            set.images.push(picture.clone());
            material.maps.color = Some(osier_base::convert::index(set.images.len() - 1, "images of a plant")?);
        }
        set.materials.push(material);
        let index = osier_base::convert::index(set.materials.len() - 1, "materials of a plant")?;
        materials.insert((base, *color), index);
    }
    Ok(())
}

/// A season, 0..1, moved by a difference that vanishes at bud burst (0) and on the bare tree (1).
fn shift_season(season: f64, difference: f64) -> f64 {
    // The parabola 4 t (1 - t) is 0 at both ends of the year and 1 in its middle.
    (season + difference * 4.0 * season * (1.0 - season)).clamp(0.0, 1.0)
}

/// Seed of an individual's leaf changes, and its lead (> 0) or lag over others in the middle of the year, as a difference of
/// seasons.
fn season_seed_and_lead(individual: &Individual) -> (u64, f64) {
    let seed = mix64(&[individual.seed, u64::from(individual.id)]);
    (seed, Rng::at(seed, &["season".into()]).range(-MAX_INDIVIDUAL_SHIFT, MAX_INDIVIDUAL_SHIFT))
}

/// The organs in the form that `apply_season` and `season_slots` take.
fn seasonal_organs(materials: &SeasonMaterials) -> Vec<SeasonalOrgan<'_>> {
    let mut organs = Vec::with_capacity(materials.organs.len());
    for OrganSeason { name, habit, materials, bud } in &materials.organs {
        organs.push(SeasonalOrgan { name, habit, materials, bud: *bud });
    }
    organs
}

/// Gives a grown individual the leaves of its plant's season in the first frame; changes nothing without a season.
/// # Errors
/// `TooMany` for the prototypes of the plant.
pub(crate) fn show_season(
    grown: &mut Plant,
    recipe: &PlantRecipe,
    individual: &Individual,
    set: &MaterialSet,
) -> Result<()> {
    let (Some(course), Some(materials)) = (recipe.season_course(), &set.season) else { return Ok(()) };
    let (seed, difference) = season_seed_and_lead(individual);
    let season = narrow(shift_season(course.at(0.0), difference));
    apply_season(grown, &PlantSeason { season, seed, organs: &seasonal_organs(materials), bud_name: BUD })
}

/// Seasons of an individual over a clip, and the instances that its leaves need for them.
#[derive(Debug, Clone)]
pub struct SeasonClip {
    /// The appearances of each organ of the plant, each of which is an instance.
    pub slots: SeasonSlots,
    /// The plant with the leaves that it shows at the first frame.
    pub first: Plant,
    /// Season over the clip, before the lead is added.
    course: SeasonCourse,
    /// Lead of the individual in the middle of the year, as a difference of seasons.
    difference: f64,
}

impl SeasonClip {
    /// Season at a share of the time from the first frame (0) to the last (1), shifted by the lead of the individual.
    pub fn season_at_share(&self, share: f64) -> f32 {
        narrow(shift_season(self.course.at(share), self.difference))
    }
}

/// Gives a grown individual one organ for each appearance that its leaves have in a clip; `None` without a season. `frames`:
/// intervals between its frames.
/// # Errors
/// `TooMany` for the prototypes of the plant.
pub(crate) fn season_clip(
    grown: &mut Plant,
    recipe: &PlantRecipe,
    individual: &Individual,
    set: &MaterialSet,
    frames: f64,
) -> Result<Option<SeasonClip>> {
    let (Some(course), Some(materials)) = (recipe.season_course(), &set.season) else { return Ok(None) };
    let (seed, difference) = season_seed_and_lead(individual);
    let organs = seasonal_organs(materials);
    let mut first = grown.clone();
    show_season(&mut first, recipe, individual, set)?;
    let at = PlantSeason { season: 0.0, seed, organs: &organs, bud_name: BUD };
    let at_share = |share: f64| narrow(shift_season(course.at(share), difference));
    let intervals = frames.max(1.0);
    // Shares 0, 1/n, ..., 1 of the clip, one for each frame, with n intervals.
    let numbers = std::iter::successors(Some(0.0), |k| Some(k + 1.0)).take_while(|k| *k <= intervals);
    let shares = numbers.map(|k: f64| k / intervals);
    // Seasons are sampled at every frame: each appearance of a leaf becomes a separate instance.
    let slots = season_slots(grown, &at, &shares.map(at_share).collect::<Vec<f32>>())?;
    Ok(Some(SeasonClip { slots, first, course, difference }))
}
