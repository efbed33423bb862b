//! Placement: the individuals of a scene and where their copies stand.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::species_growth::grows_in_place;
use crate::bake::assets::terrain;
use crate::bake::scene::plant_layout::{
    Individual, PlantInstance, PlantLayout, next_individual, rotation_about_axis, tan_of_slope,
};
use crate::bake::scene::scatter;
use crate::recipe::{Growth, PlaceRecipe, Recipe};
use osier_base::Result;
use osier_base::files::Names;
use osier_base::math;
use osier_base::rng::Rng;
use osier_plants::surface::terrain::Terrain;
use osier_scene::Trs;

/// Lays out the places of a recipe and scatters plants over its terrain, which is returned too.
/// # Errors
/// `Range` for a terrain outside its ranges, `Limit`, `Cancelled`.
pub fn lay_out_scene(recipe: &Recipe, context: &BakeContext<'_>) -> Result<(PlantLayout, Option<Terrain>)> {
    let mut layout = lay_out(recipe);
    let Some(keys) = &recipe.terrain else { return Ok((layout, None)) };
    // Places give heights above the terrain; scattered plants are placed on it directly.
    let land = terrain::generate_terrain(keys, recipe.general.seed)?;
    for s in &mut layout.instances {
        let at = &mut s.transform.t;
        at.y += land.height_at(at.x, at.z);
        s.slope = Some(tan_of_slope(land.normal_at(at.x, at.z)));
    }
    scatter::scatter_plants(recipe, &land, &mut layout, context)?;
    name_assets(recipe, &mut layout);
    Ok((layout, Some(land)))
}

/// Lays out a recipe's places. Copies of a group are spread evenly over a disc; each draw has the address
/// ("place", place, copy), so one more copy moves no other.
pub fn lay_out(recipe: &Recipe) -> PlantLayout {
    let mut layout = PlantLayout::default();
    let mut ordinals = vec![0_u32; recipe.plants.len()];
    for (index, place) in recipe.places.iter().enumerate() {
        let first = layout.individuals.len();
        // Individuals of an imported mesh do not differ, so that one serves all copies by default.
        let modelled = recipe.plants.get(place.plant).is_some_and(|p| matches!(p.growth, Growth::Mesh(..)));
        let default_count = if modelled { 1 } else { place.keys.count };
        // In the rain each copy has drops of its own, and so must be an individual.
        let individuals = if recipe.rain.is_some() {
            place.keys.count
        } else {
            place.keys.individuals.unwrap_or(default_count).min(place.keys.count)
        };
        for _ in 0..individuals {
            let individual = next_individual(recipe, place.plant, place.keys.seed, &mut ordinals);
            let together = place.keys.together;
            layout.individuals.extend(individual.map(|individual| Individual { together, ..individual }));
        }
        let in_place = recipe.plants.get(place.plant).is_some_and(|p| grows_in_place(p, place.keys.together));
        let mut clear = PlacementGrid::new(math::narrow(place.keys.clear));
        // Copies are spread around the place's centre, away from what earlier places put there.
        let center = Vec3::from_array(place.keys.at.map(math::narrow));
        layout.instances.iter().map(|s| s.transform.t - center).for_each(|p| clear.insert(Vec2::new(p.x, p.z)));
        let spots = spread_copies(recipe.general.seed, index, place, &clear);
        for (copy, spot) in spots.iter().enumerate() {
            let shared = copy % individuals.max(1) as usize;
            // Copies that share a recorded motion must face the wind alike: they get the same turn about the vertical.
            let turned_as = if recipe.moves { shared } else { copy };
            let transform = copy_transform(recipe.general.seed, index, copy, turned_as, place, *spot);
            // What grows for its place is neither turned nor scaled: it has grown in the directions of the scene.
            let transform = if in_place { Trs { t: transform.t, ..Trs::IDENTITY } } else { transform };
            let individual = first + shared;
            layout.instances.push(PlantInstance { individual, transform, slope: None });
        }
    }
    name_assets(recipe, &mut layout);
    layout
}

/// Names the assets: `oak` for the only individual of plant `oak`, else `oak_1`, `oak_2`, ...; `oak_1` too where the scene is called
/// `oak`, so that scene and plant have files of different names.
fn name_assets(recipe: &Recipe, layout: &mut PlantLayout) {
    let mut totals = vec![0_u32; recipe.plants.len()];
    for i in &layout.individuals {
        if let Some(t) = totals.get_mut(i.plant) {
            *t += 1;
        }
    }
    let mut names = Names::default();
    names.unique("ground");
    names.unique(terrain::NAME);
    let mut seen = vec![0_u32; recipe.plants.len()];
    for i in &mut layout.individuals {
        let (Some(total), Some(n)) = (totals.get(i.plant), seen.get_mut(i.plant)) else { continue };
        *n += 1;
        let id = recipe.plants.get(i.plant).map_or("plant", |p| &p.id);
        i.asset = names.unique(&if *total == 1 && id != recipe.name { id.to_owned() } else { format!("{id}_{n}") });
    }
}

/// Positions of a place's copies relative to its centre, m, by best-candidate sampling: up to 24 uniform draws in the disc, of which the
/// first that keeps both distances is taken, else the best. `clear`: plants of earlier places, relative to the same centre.
fn spread_copies(seed: u64, index: usize, place: &PlaceRecipe, clear: &PlacementGrid) -> Vec<Vec2> {
    let count = place.keys.count;
    if count == 1 {
        return vec![Vec2::ZERO];
    }
    let (radius, spacing) = (math::narrow(place.keys.radius), math::narrow(place.keys.spacing));
    let mut near = PlacementGrid::new(spacing);
    (0..u64::from(count))
        .map(|copy| {
            let mut rng = Rng::at(seed, &["place".into(), index.into(), copy.into(), "spot".into()]);
            // Radius as the square root of a uniform draw: even density over the disc.
            let mut best = (f32::NEG_INFINITY, Vec2::ZERO);
            for _ in 0..24 {
                let r = radius * math::sqrt_f32(rng.unit_f32());
                let a = std::f32::consts::TAU * rng.unit_f32();
                let spot = Vec2::new(r * math::cos_f32(a), r * math::sin_f32(a));
                let room = near.distance(spot);
                // Overlap with another place weighs a thousand times as much as crowding within this one.
                let lacking = clear.side - clear.distance(spot);
                let score = room - 1e3 * lacking;
                if score > best.0 {
                    best = (score, spot);
                }
                if room >= spacing && lacking <= 0.0 {
                    break;
                }
            }
            near.insert(best.1);
            best.1
        })
        .collect()
}

/// Points in square cells as wide as the distance that is kept, so that the nearest point within it lies in the 3 x 3 cells around.
struct PlacementGrid {
    side: f32,
    cells: BTreeMap<(i64, i64), Vec<Vec2>>,
}

impl PlacementGrid {
    fn new(side: f32) -> Self {
        Self { side, cells: BTreeMap::new() }
    }

    #[allow(clippy::cast_possible_truncation, reason = "a saturated cell is still a cell")]
    fn cell(&self, p: Vec2) -> (i64, i64) {
        ((p.x / self.side).floor() as i64, (p.y / self.side).floor() as i64)
    }

    fn insert(&mut self, p: Vec2) {
        if self.side > 0.0 {
            self.cells.entry(self.cell(p)).or_default().push(p);
        }
    }

    /// Distance to the nearest point, exact below the side of a cell; the side if there is none nearer.
    fn distance(&self, p: Vec2) -> f32 {
        if self.side <= 0.0 {
            return 0.0;
        }
        let (x, y) = self.cell(p);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy)));
        let points = around.filter_map(|c| self.cells.get(&c)).flatten();
        points.fold(self.side, |d, q| d.min(p.distance(*q)))
    }
}

/// Transform of one copy of a place. `turned_as`: the copy whose drawn turn it shares.
fn copy_transform(seed: u64, index: usize, copy: usize, turned_as: usize, place: &PlaceRecipe, spot: Vec2) -> Trs {
    let keys = &place.keys;
    let stream = |copy: usize| Rng::at(seed, &["place".into(), index.into(), copy.into(), "stand".into()]);
    let drawn_turn = stream(turned_as).range(0.0, std::f64::consts::TAU);
    // The scale is the second draw of the copy's own stream; its first is the turn.
    let mut rng = stream(copy);
    rng.next_u64();
    let drawn_scale = rng.range(-1.0, 1.0);
    let turn = keys.turn.unwrap_or(if keys.count > 1 { drawn_turn } else { 0.0 });
    let lean_to = rotation_about_axis(Vec3::Y, keys.lean_to) * Vec3::X;
    let lean = rotation_about_axis(Vec3::Y.cross(lean_to).normalize_or_zero(), keys.lean);
    let center = Vec3::from_array(keys.at.map(math::narrow));
    Trs {
        t: center + Vec3::new(spot.x, 0.0, spot.y),
        r: (lean * rotation_about_axis(Vec3::Y, turn)).normalize(),
        s: Vec3::splat(math::narrow(keys.scale * (1.0 + keys.vary * drawn_scale))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::{Request, resolve};

    fn laid(places: &str) -> PlantLayout {
        let text = format!("[plants.a]\ngrammar = \"oak.l\"\n[plants.b]\ngrammar = \"birch.l\"\n{places}");
        lay_out(&resolve(&Request { text, ..Request::default() }).expect("scene").0)
    }

    #[test]
    fn larger_counts_keep_earlier_plants() {
        let group = |n| {
            laid(&format!(
                "[[place]]\nplant = \"a\"\ncount = {n}\nradius = 10\nspacing = 2\nindividuals = 3\nvary = 0.2\nat = [5, 0, 0]"
            ))
        };
        let (few, many) = (group(10), group(30));
        assert_eq!((many.individuals.len(), many.instances.len()), (3, 30));
        assert_eq!(few.instances[..], many.instances[..10]);
        let p: Vec<Vec3> = many.instances.iter().map(|s| s.transform.t).collect();
        assert!(p.iter().all(|p| p.distance(Vec3::new(5.0, 0.0, 0.0)) <= 10.0));
        assert!((0..30).all(|i| (0..i).all(|j| p[i].distance(p[j]) >= 2.0)));
    }

    #[test]
    fn groups_keep_clear_of_what_stands() {
        let l = laid(
            "[[place]]\nplant = \"b\"\nat = [1, 0, 2]\n[[place]]\nplant = \"a\"\ncount = 400\nradius = 3\nclear = 1\nindividuals = 1\nat = [0, 0, 2]",
        );
        let p: Vec<Vec3> = l.instances.iter().map(|s| s.transform.t).collect();
        assert!(p[1..].iter().all(|q| q.distance(p[0]) >= 1.0));
        assert!(p[1..].iter().any(|q| q.distance(p[0]) < 1.3));
    }

    #[test]
    fn ids_come_from_names_and_ordinals_alone() {
        let one = laid("[[place]]\nplant = \"a\"\n[[place]]\nplant = \"b\"\nseed = 9");
        let two = laid("[[place]]\nplant = \"b\"\n[[place]]\nplant = \"a\"\n[[place]]\nplant = \"a\"");
        assert_eq!(one.individuals[1].id, two.individuals[0].id);
        assert_ne!(one.individuals[1].seed, two.individuals[0].seed);
        let names: Vec<&str> = two.individuals.iter().map(|i| i.asset.as_str()).collect();
        assert_eq!(names, ["b", "a_1", "a_2"]);
    }

    #[test]
    fn a_lean_of_90_degrees_lies_down() {
        let l = laid("[[place]]\nplant = \"a\"\nlean_deg = 90\nlean_to_deg = 90\nturn_deg = 30");
        let up = l.instances[0].transform.r * Vec3::Y;
        assert!((up - Vec3::NEG_Z).length() < 1e-6, "{up}");
    }
}
