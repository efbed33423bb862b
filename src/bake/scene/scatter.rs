//! Scattering of plants over a terrain, and their seating on its slopes.

use glam::Vec3;

use crate::bake::BakeContext;
use crate::bake::assets::species_growth::grows_in_place;
use crate::bake::scene::layout::faces_wind;
use crate::bake::scene::plant_layout::{
    PlantInstance, PlantLayout, next_individual, rotation_about_axis, tan_of_slope,
};
use crate::recipe::scene::SkinKeys;
use crate::recipe::{Recipe, ScatterRecipe};
use osier_base::Result;
use osier_base::convert::{index, to_usize};
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::math::{cos_f32, narrow, rotation_between, sin_f32};
use osier_base::rng::Rng;
use osier_plants::surface::terrain::Terrain;
use osier_plants::surface::terrain::scatter::{
    DensityMask, ScatterDisc, ScatterObstacle, ScatterParams, clump_key, scatter, scatter_key,
};
use osier_scene::Trs;
use osier_scene::plant::{NONE, Plant};

/// Depth to which every foot is sunk below the lowest terrain around it, m. Own: small beside a stem, enough to
/// hide gaps between samples of the terrain.
const FOOT_DEPTH: f32 = 0.02;
/// Widening of a trunk where a root leaves it over the mean of its root flare: at most twice, for ridges of usual strength.
const RIDGE_REACH: f32 = 2.0;
/// Share of a plant's height above which an axis without parent is no foot: a piece of an imported mesh that joins no other (X019).
const FOOT_HEIGHT: f32 = 0.1;

/// Scatters the plants of every `[[scatter]]` over the terrain. The key `individuals` is the number grown of each plant; every
/// copy displays one of them, and those that none displays are removed. Warns with S007 of a scatter that finds no place for a plant.
/// # Errors
/// `Limit` beyond the candidates or instances allowed, `Cancelled`.
pub(crate) fn scatter_plants(
    recipe: &Recipe,
    land: &Terrain,
    layout: &mut PlantLayout,
    context: &BakeContext<'_>,
    report: &mut Report,
) -> Result<()> {
    // The numbering of individuals continues that of the places.
    let mut ordinals = vec![0_u32; recipe.plants.len()];
    for i in &layout.individuals {
        if let Some(n) = ordinals.get_mut(i.plant) {
            *n += 1;
        }
    }
    // Scattered plants keep the distance `clear` to plants of places.
    let position = |s: &PlantInstance| [s.transform.t.x, s.transform.t.z];
    let mut obstacles: Vec<ScatterObstacle> =
        layout.instances.iter().map(|s| ScatterObstacle { at: position(s), spacing: 0.0 }).collect();
    for (entry, recipe_entry) in recipe.scatters.iter().enumerate() {
        context.cancel.check()?;
        let params = scatter_params(recipe_entry, recipe.general.seed);
        let spots = scatter(land, &params, &obstacles, scatter_key(recipe.general.seed, entry), context.limits)?;
        // A density or a largest number of 0 asks for none.
        if spots.is_empty() && recipe_entry.keys.max_count > 0 && recipe_entry.keys.density > 0.0 {
            let help = "its altitude, slope, disc and mask allow none, or earlier plants are too near everywhere";
            let d = Diagnostic::about("S007", format!("scatter.{entry} places no plant")).help(help);
            report.extend(recipe.places_of_keys.report_at(&format!("scatter.{entry}"), d, "no plant"));
        }
        let count = layout.instances.len().saturating_add(spots.len());
        let placed = context.limits.check("instances", count as u64, "the number of placements");
        placed.map_err(|e| recipe.places_of_keys.limit_at(&format!("scatter.{entry}.density"), e))?;
        // Individuals of each plant, as indices into the layout's.
        let mut grown: Vec<Vec<usize>> = Vec::new();
        for (plant, _) in &recipe_entry.plants {
            let first = layout.individuals.len();
            let new =
                (0..recipe_entry.keys.individuals).filter_map(|_| next_individual(recipe, *plant, 0, &mut ordinals));
            layout.individuals.extend(new);
            grown.push((first..layout.individuals.len()).collect());
        }
        let weights: Vec<f64> = recipe_entry.plants.iter().map(|p| p.1).collect();
        for spot in spots {
            // Draws of a spot, in this order: plant, individual, turn, scale.
            let mut rng = spot.rng;
            let Some(candidates) = grown.get(rng.pick(&weights)) else { continue };
            let pick = to_usize(rng.below(index(candidates.len(), "individuals of a scatter")?));
            let Some(&individual) = candidates.get(pick) else { continue };
            // Copies that face the wind alike have a turn that is drawn from the individual's id.
            let (plant, id) = layout.individuals.get(individual).map_or((0, 0), |i| (i.plant, i.id));
            let shared_turn = faces_wind(recipe, plant).then(|| {
                let seed = u64::from(id);
                Rng::at(recipe.general.seed, &["facing".into(), seed.into()]).range(0.0, std::f64::consts::TAU)
            });
            let (transform, slope) = scattered_transform(land, recipe_entry, spot.at, shared_turn, &mut rng);
            // As in [[place]], a plant that grows for its place is neither turned nor scaled.
            let plant = layout.individuals.get(individual).and_then(|i| recipe.plants.get(i.plant));
            let in_place = plant.is_some_and(|plant| grows_in_place(plant, false));
            let transform = if in_place { Trs { t: transform.t, ..Trs::IDENTITY } } else { transform };
            layout.instances.push(PlantInstance { individual, transform, absolute_height: false, slope: Some(slope) });
        }
        // Plants of later entries keep their distance to those of this one.
        obstacles.extend(
            layout.instances[obstacles.len()..]
                .iter()
                .map(|s| ScatterObstacle { at: position(s), spacing: params.spacing }),
        );
    }
    drop_unseen(layout);
    Ok(())
}

/// Removes the individuals that no copy shows, as those of a scatter of fewer copies than individuals: they are neither grown nor
/// written.
fn drop_unseen(layout: &mut PlantLayout) {
    let mut seen = vec![false; layout.individuals.len()];
    for s in &layout.instances {
        if let Some(seen) = seen.get_mut(s.individual) {
            *seen = true;
        }
    }
    // New index of each individual: the number of those before it that stay.
    let mut kept = 0;
    let new_index: Vec<usize> = seen
        .iter()
        .map(|seen| {
            kept += usize::from(*seen);
            kept - usize::from(*seen)
        })
        .collect();
    for s in &mut layout.instances {
        s.individual = new_index.get(s.individual).copied().unwrap_or(s.individual);
    }
    let mut of_old = seen.into_iter();
    layout.individuals.retain(|_| of_old.next().unwrap_or(true));
}

/// Parameters of a scatter. `seed`: the scene's.
fn scatter_params(recipe: &ScatterRecipe, seed: u64) -> ScatterParams {
    let keys = &recipe.keys;
    ScatterParams {
        spacing: narrow(keys.spacing),
        clear: keys.clear.map(narrow),
        slope_max: narrow(keys.slope_max),
        altitude: keys.altitude.map(narrow),
        density: narrow(keys.density),
        mask: recipe.mask.clone().map(|m| DensityMask { width: m.width, height: m.height, values: m.values }),
        clump: narrow(keys.clump),
        clump_key: clump_key(seed),
        disc: keys.radius.map(|radius| ScatterDisc {
            at: keys.at.map(narrow),
            radius: narrow(radius),
            inner: narrow(keys.inner),
            fade: narrow(keys.fade),
        }),
        max_count: keys.max_count as usize,
    }
}

/// World transform of a copy at a point of the terrain, and the tangent of the slope there. `shared_turn`: replaces the drawn
/// turn, rad.
fn scattered_transform(
    land: &Terrain,
    recipe: &ScatterRecipe,
    [x, z]: [f32; 2],
    shared_turn: Option<f64>,
    rng: &mut Rng,
) -> (Trs, f32) {
    let keys = &recipe.keys;
    let normal = land.normal_at(x, z);
    let drawn = rng.range(0.0, std::f64::consts::TAU);
    let turn = shared_turn.unwrap_or(drawn);
    let scale = narrow(rng.range(keys.scale[0], keys.scale[1]));
    // `align` 0: upright; 1: along the terrain's normal.
    let up = Vec3::Y.lerp(normal, narrow(keys.align)).normalize();
    let r = (rotation_between(Vec3::Y, up) * rotation_about_axis(Vec3::Y, turn)).normalize();
    (Trs { t: Vec3::new(x, land.height_at(x, z), z), r, s: Vec3::splat(scale) }, tan_of_slope(normal))
}

/// Radius of a plant's foot at scale 1, m: largest horizontal distance from its pivot to the outside of a root collar, flare
/// included.
pub(crate) fn footprint_radius(plant: &Plant, skin: &SkinKeys) -> f32 {
    // Ridges of the flare reach farther out than its mean.
    let ridged = if skin.buttresses > 1 { RIDGE_REACH } else { 1.0 };
    let flare = 1.0 + ridged * narrow(skin.flare);
    let height = plant.nodes.p.iter().fold(0.0_f32, |most, p| most.max(p.y));
    // Wood that falls during a clip of growth has no parent either, but an order above 0.
    let roots = plant.axes.iter().filter(|a| a.parent == NONE && a.order == 0).map(|a| a.first as usize);
    roots.fold(0.0_f32, |most, i| {
        let (Some(p), Some(r)) = (plant.nodes.p.get(i), plant.nodes.r.get(i)) else { return most };
        if p.y > FOOT_HEIGHT * height { most } else { most.max(Vec3::new(p.x, 0.0, p.z).length() + r * flare) }
    })
}

/// Sinks plants into the terrain until no side of their foot is above it: by the foot's radius times the slope's tangent, or by the
/// largest drop of the terrain on a circle of that radius, whichever is more. `stem_foot_radii`: by individual, m.
pub(crate) fn sink_feet(layout: &mut PlantLayout, stem_foot_radii: &[f32], land: &Terrain) {
    for s in &mut layout.instances {
        if let (Some(slope), Some(foot)) = (s.slope, stem_foot_radii.get(s.individual)) {
            // Lowest terrain at 16 points of the foot's circle: the slope at its centre does not cover bumps and edges.
            let (at, r) = (&mut s.transform.t, foot * s.transform.s.x);
            let around = (0..16_u8).map(|k| f32::from(k) * (std::f32::consts::TAU / 16.0));
            let lowest =
                around.fold(f32::MAX, |low, a| low.min(land.height_at(at.x + r * cos_f32(a), at.z + r * sin_f32(a))));
            at.y -= (r * slope).max(land.height_at(at.x, at.z) - lowest) + FOOT_DEPTH;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::scene::assembly::{SceneOptions, assemble_scene};
    use crate::recipe::{KeyTable as _, Request, resolve};
    use osier_base::limits::Limits;
    use osier_base::progress::{Cancel, Silent};
    use osier_scene::AssetKind;
    use osier_scene::plant::{Axis, AxisEnd, AxisKind, Nodes};

    const SCENE: &str = "seed = 4
[terrain]
subdivisions = 7
size = 120
amplitude = 22
side = 64
[plants.tree]
ifs = \"pseudodichotomous.ifs.toml\"
[plants.tree.tree]
height = 5
eps = 0.4
leaf_density = 0
[plants.tree.skin]
bury = 0.3
[plants.tree.bark]
side = 16
[plants.tree.shoot]
side = 16
[[place]]
plant = \"tree\"
at = [20, 0, 5]
[[scatter]]
plants = { tree = 1 }
spacing = 7
slope_max_deg = 40
individuals = 2
";

    fn built(text: &str) -> crate::bake::scene::AnimatedScene {
        let request = Request { text: text.into(), ..Request::default() };
        let recipe = resolve(&request).expect("scene").0;
        let context =
            BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
        assemble_scene(&recipe, SceneOptions::default(), &context).expect("stage").animated
    }

    #[test]
    fn no_plant_floats_or_sinks() {
        let stage = built(SCENE);
        let scene = &stage.scene;
        let field = scene.land.as_ref().expect("land");
        let land = Terrain {
            counts: field.counts,
            size: field.size,
            center: field.center,
            stride: 1,
            tileable: false,
            heights: field.heights.clone(),
            surface: None,
        };
        let plants: Vec<_> =
            scene.placements.iter().filter(|p| scene.assets[p.asset].kind == AssetKind::Plant).collect();
        assert!(plants.len() > 80, "{}", plants.len());
        assert_eq!(scene.assets.iter().filter(|a| a.kind == AssetKind::Plant).count(), 3, "individuals are shared");
        let (mut highest, mut deepest) = (f32::MIN, 0.0_f32);
        for p in plants {
            let points = &scene.assets[p.asset].meshes[0].mesh.points;
            let low = points.iter().fold(f32::MAX, |m, q| m.min(q.y));
            // The lowest ring lies `bury`, 0.3 m, below the base; raised by that it must not lie above the land.
            for q in points.iter().filter(|q| q.y < low + 0.02) {
                let w = p.transform.apply(Vec3::new(q.x, 0.0, q.z));
                highest = highest.max(w.y - land.height_at(w.x, w.z));
            }
            let foot = p.transform.t;
            deepest = deepest.max(land.height_at(foot.x, foot.z) - foot.y);
        }
        assert!(highest < 0.01, "a foot stands {highest} m above the land");
        assert!((0.02..0.35).contains(&deepest), "a foot is {deepest} m deep");
    }

    #[test]
    fn patches_are_those_of_the_scenes_seed() {
        let key = |seed: &str| {
            let text = format!("{SCENE}clump = 20\n").replace("seed = 4", seed);
            let recipe = resolve(&Request { text, ..Request::default() }).expect("scene").0;
            scatter_params(&recipe.scatters[0], recipe.general.seed).clump_key
        };
        assert_ne!(key("seed = 4"), key("seed = 5"));
    }

    #[test]
    fn only_what_begins_at_the_ground_is_a_foot() {
        let axis = |first: u32, order: u8| Axis {
            id: first.into(),
            parent: NONE,
            parent_s: 0.0,
            order,
            kind: AxisKind::Stem,
            first,
            count: 2,
            length: 1.0,
            s_exposed: 0.0,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: 0.0,
        };
        // Two stems, a branch that falls near the ground, and a piece that floats, each 1 m long.
        let bases = [[0.0_f32, 0.0], [0.5, 0.1], [3.0, 0.1], [2.0, 4.0]];
        let plant = Plant {
            axes: vec![axis(0, 0), axis(2, 0), axis(4, 1), axis(6, 0)],
            nodes: Nodes {
                p: bases.iter().flat_map(|[x, y]| [Vec3::new(*x, *y, 0.0), Vec3::new(*x, y + 1.0, 0.0)]).collect(),
                q: vec![glam::Quat::IDENTITY; 8],
                r: vec![0.1; 8],
                s: [0.0, 1.0].repeat(4),
                birth: vec![0.0; 8],
                color: vec![0; 8],
            },
            ..Plant::default()
        };
        let skin = SkinKeys { flare: 0.0, ..SkinKeys::defaults() };
        assert!((footprint_radius(&plant, &skin) - 0.6).abs() < 1e-6, "{}", footprint_radius(&plant, &skin));
    }

    #[test]
    fn copies_that_share_a_motion_face_one_way() {
        let facing = |text: &str| {
            let stage = built(text);
            let mut seen: std::collections::BTreeMap<usize, Vec<glam::Quat>> = std::collections::BTreeMap::new();
            let plants = stage.scene.placements.iter().filter(|p| stage.scene.assets[p.asset].kind == AssetKind::Plant);
            plants.for_each(|p| seen.entry(p.asset).or_default().push(p.transform.r));
            seen.into_values().all(|list| list.iter().all(|r| list[0].angle_between(*r) < 1e-3))
        };
        let upright = format!("{SCENE}align = 0\n");
        assert!(!facing(&upright), "still copies are turned at random");
        let windy = format!("{upright}[frames]\nend = 2\n[wind]\nspeed = 4\n");
        assert!(facing(&windy));
        for motion in ["static", "still"] {
            let unmoved = windy.replacen("[plants.tree]\n", &format!("[plants.tree]\nmotion = \"{motion}\"\n"), 1);
            assert!(!facing(&unmoved), "{unmoved}");
        }
    }

    #[test]
    fn a_tree_that_is_cut_where_it_stands_is_not_turned() {
        let cut = "[[plants.tree.prune]]\nyear = 2\nkeep = [[-1, 0, -1], [1, 0.3, 1]]\n";
        let scattered = |cut: &str| {
            let stage = built(&format!(
                "[terrain]\nsubdivisions = 3\nsize = 50\nside = 64\n[plants.tree]\nspecies = \"hazel\"\nage = 3\n{cut}\
                 [[scatter]]\nplants = {{ tree = 1 }}\nindividuals = 1\nmax_count = 1\nscale = [2, 3]\nalign = 1\n"
            ));
            let mut plants =
                stage.scene.placements.iter().filter(|p| stage.scene.assets[p.asset].kind == AssetKind::Plant);
            plants.next().expect("a tree").transform
        };
        assert!(scattered("").s.x >= 2.0, "a tree that grows alike everywhere is scaled");
        let stands = scattered(cut);
        assert!((stands.s.x - 1.0).abs() < 1e-6 && stands.r.angle_between(glam::Quat::IDENTITY) < 1e-3, "{stands:?}");
    }

    #[test]
    fn individuals_without_a_copy_are_not_grown() {
        let few = SCENE.replace("individuals = 2", "individuals = 5\nmax_count = 1");
        let stage = built(&few);
        let plants: Vec<usize> =
            (0..stage.scene.assets.len()).filter(|i| stage.scene.assets[*i].kind == AssetKind::Plant).collect();
        // That of the place, and one of five.
        assert_eq!(plants.len(), 2);
        for plant in plants {
            assert_eq!(stage.scene.placements.iter().filter(|p| p.asset == plant).count(), 1, "{plant}");
        }
    }

    #[test]
    fn a_later_scatter_moves_nothing_and_heeds_what_stands() {
        let one = built(SCENE);
        let more = "[[scatter]]\nplants = { tree = 2 }\nspacing = 3\nclear = 2\nmax_count = 30\nindividuals = 1\n";
        let two = built(&format!("{SCENE}{more}"));
        let of = |s: &crate::bake::scene::AnimatedScene| -> Vec<[u32; 3]> {
            let plants = s.scene.placements.iter().filter(|p| s.scene.assets[p.asset].kind == AssetKind::Plant);
            plants.map(|p| p.transform.t.to_array().map(f32::to_bits)).collect()
        };
        let (a, b) = (of(&one), of(&two));
        assert_eq!(b.len(), a.len() + 30);
        assert_eq!(a[..], b[..a.len()]);
    }
}
