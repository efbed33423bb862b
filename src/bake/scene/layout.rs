//! Placement: the individuals of a scene, the transforms of their copies, and the terrain.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Vec2, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::species_growth::grows_in_place;
use crate::bake::assets::terrain;
use crate::bake::scene::builder::{CATKINS_ID, GROUND_ID, RAIN_ID};
use crate::bake::scene::plant_layout::{
    Individual, PlantInstance, PlantLayout, next_individual, rotation_about_axis, tan_of_slope,
};
use crate::bake::scene::scatter;
use crate::recipe::scene::{BarkMotion, HeightDatum};
use crate::recipe::{Growth, PlaceRecipe, PlantRecipe, Recipe};
use osier_base::Result;
use osier_base::diagnostic::{Diagnostic, Report};
use osier_base::files::Names;
use osier_base::math;
use osier_base::rng::Rng;
use osier_import::GreyImage;
use osier_plants::surface::terrain::Terrain;
use osier_scene::Trs;

/// Placements of all plants, and the terrain under them.
#[derive(Debug)]
pub struct SceneLayout {
    /// The individuals, and the transforms of their copies in world space.
    pub plants: PlantLayout,
    /// Terrain that plants are scattered over; `None` without a terrain in the scene.
    pub terrain: Option<Terrain>,
    /// Warnings about the mesh of a terrain, plants beyond its edge, and scatters without a plant.
    pub report: Report,
}

/// Lays out the places of a recipe and scatters plants over its terrain.
/// # Errors
/// `Range` for a terrain outside its ranges, X010 for a mesh that is none, `Limit`, `Cancelled`.
pub fn lay_out_scene(recipe: &Recipe, context: &BakeContext<'_>) -> Result<SceneLayout> {
    let mut layout = lay_out(recipe);
    let mut report = Report::default();
    let Some(terrain) = &recipe.terrain else { return Ok(SceneLayout { plants: layout, terrain: None, report }) };
    // Places give heights above the terrain unless they count from zero; scattered plants are placed on it directly.
    let (land, folded) = terrain::build_terrain(terrain, recipe.general.seed)?;
    folded.into_iter().for_each(|d| report.push(d));
    let mut beyond = 0_usize;
    for s in layout.instances.iter_mut().filter(|s| !s.absolute_height) {
        let at = &mut s.transform.t;
        beyond += usize::from(!land.covers(at.x, at.z));
        at.y += land.height_at(at.x, at.z);
        // The slope is kept until the plant is grown and the radius of its foot is known ([`scatter::sink_feet`]).
        s.slope = Some(tan_of_slope(land.normal_at(at.x, at.z)));
    }
    if beyond > 0 {
        let who = if beyond == 1 {
            "1 plant of [[place]] stands".into()
        } else {
            format!("{beyond} plants of [[place]] stand")
        };
        let text = format!("{who} beyond the edge of the terrain or over a hole in it");
        let help = "move them, or make the terrain larger; they stand at the height of its nearest edge";
        let d = Diagnostic::about("S037", text).help(help);
        report.extend(recipe.places_of_keys.report_at("place", d, "these plants"));
    }
    scatter::scatter_plants(recipe, &land, &mut layout, context, &mut report)?;
    name_assets(recipe, &mut layout);
    Ok(SceneLayout { plants: layout, terrain: Some(land), report })
}

/// Lays out a recipe's `[[place]]` tables, without scattered plants. Each random draw has the address ("place", place, copy),
/// so that one more copy moves no other.
pub fn lay_out(recipe: &Recipe) -> PlantLayout {
    let mut layout = PlantLayout::default();
    let mut ordinals = vec![0_u32; recipe.plants.len()];
    for (index, place) in recipe.places.iter().enumerate() {
        let first = layout.individuals.len();
        // Individuals of an imported mesh do not differ, so that one serves all copies by default.
        let modelled = recipe.plants.get(place.plant).is_some_and(|p| matches!(p.growth, Growth::Mesh(..)));
        let default_count = if modelled { 1 } else { place.keys.count };
        // In the rain each copy has different drops, and so must be an individual.
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
            // Copies that face the wind alike get the same turn about the vertical.
            let turned_as = if faces_wind(recipe, place.plant) { shared } else { copy };
            let transform = copy_transform(recipe.general.seed, index, copy, turned_as, place, *spot);
            // A plant that grows for its place has grown in the directions of the scene: it is neither turned nor scaled.
            let transform = if in_place { Trs { t: transform.t, ..Trs::IDENTITY } } else { transform };
            let individual = first + shared;
            let absolute_height = place.keys.height_from == HeightDatum::Zero;
            layout.instances.push(PlantInstance { individual, transform, absolute_height, slope: None });
        }
    }
    name_assets(recipe, &mut layout);
    layout
}

/// Ids of the assets that the scene adds to those that its tables name: the ground or the terrain, drops, catkins.
pub(crate) fn added_asset_ids(recipe: &Recipe) -> Vec<&'static str> {
    let land = if recipe.terrain.is_some() { Some(terrain::NAME) } else { recipe.ground.show.then_some(GROUND_ID) };
    let drops = recipe.rain.as_ref().map(|_| RAIN_ID);
    let catkins = (recipe.catkin.is_some() || recipe.flight.is_some()).then_some(CATKINS_ID);
    [land, drops, catkins].into_iter().flatten().collect()
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
    // Reserve the names of assets that the scene adds, and of its clouds: `oak_1` may be the name of a cloud.
    let added: BTreeSet<&str> = [GROUND_ID, terrain::NAME].into_iter().chain(added_asset_ids(recipe)).collect();
    let clouds = recipe.clouds.iter().map(|cloud| cloud.id.as_str()).filter(|id| !added.contains(id));
    added.iter().copied().chain(clouds).for_each(|id| drop(names.unique(id)));
    let mut seen = vec![0_u32; recipe.plants.len()];
    for i in &mut layout.individuals {
        let (Some(total), Some(n)) = (totals.get(i.plant), seen.get_mut(i.plant)) else { continue };
        *n += 1;
        let id = recipe.plants.get(i.plant).map_or("plant", |p| &p.id);
        i.asset = names.unique(&if *total == 1 && id != recipe.name { id.to_owned() } else { format!("{id}_{n}") });
    }
}

/// Number of tries of a copy to keep the distances to copies of its place and to other places.
const MAX_TRIES: u32 = 24;

/// Positions of a place's copies relative to its centre, m, by best-candidate sampling: of up to [`MAX_TRIES`] draws in the
/// place's region, the first that keeps both distances, else the best. `clear`: plants of earlier places, relative to the same
/// centre.
fn spread_copies(seed: u64, index: usize, place: &PlaceRecipe, clear: &PlacementGrid) -> Vec<Vec3> {
    let region = CopyRegion::of(place);
    if matches!(region, CopyRegion::Disc { .. }) && place.keys.count == 1 {
        return vec![Vec3::ZERO];
    }
    // Along a line the spacing is kept by the positions themselves.
    let on_line = matches!(region, CopyRegion::Line { .. });
    let spacing = if on_line { 0.0 } else { math::narrow(place.keys.spacing) };
    let mut near = PlacementGrid::new(spacing);
    (0..place.keys.count)
        .map(|copy| {
            let mut rng = Rng::at(seed, &["place".into(), index.into(), copy.into(), "spot".into()]);
            let mut best = (f32::NEG_INFINITY, Vec3::ZERO);
            for _ in 0..MAX_TRIES {
                let spot = region.draw(copy, &mut rng);
                let level = Vec2::new(spot.x, spot.z);
                let room = near.distance(level);
                // Overlap with another place weighs a thousand times as much as crowding within this one.
                let lacking = clear.side - clear.distance(level);
                let score = room - 1e3 * lacking;
                if score > best.0 {
                    best = (score, spot);
                }
                if room >= spacing && lacking <= 0.0 {
                    break;
                }
            }
            near.insert(Vec2::new(best.1.x, best.1.z));
            best.1
        })
        .collect()
}

/// Region in which the copies of a place may stand, m, relative to its centre.
enum CopyRegion<'a> {
    Disc {
        radius: f32,
    },
    /// Half width along x and half depth along z; `mask`: a picture of the density over it.
    Rectangle {
        half: Vec2,
        mask: Option<MaskSampler<'a>>,
    },
    /// A position for each copy, and the radius around it within which the copy is drawn.
    Line {
        positions: &'a [[f64; 3]],
        jitter: f32,
    },
}

impl<'a> CopyRegion<'a> {
    fn of(place: &'a PlaceRecipe) -> Self {
        let keys = &place.keys;
        match keys.area {
            _ if !place.line.is_empty() => Self::Line { positions: &place.line, jitter: math::narrow(keys.jitter) },
            Some(size) => {
                let half = Vec2::from_array(size.map(math::narrow)) * 0.5;
                Self::Rectangle { half, mask: place.mask.as_ref().map(MaskSampler::new) }
            }
            None => Self::Disc { radius: math::narrow(keys.radius) },
        }
    }

    fn draw(&self, copy: u32, rng: &mut Rng) -> Vec3 {
        match self {
            Self::Disc { radius } => draw_in_disc(*radius, rng),
            Self::Rectangle { half, mask } => {
                let shares = match mask {
                    Some(mask) => mask.draw(rng),
                    None => Vec2::new(rng.unit_f32(), rng.unit_f32()),
                };
                let at = (shares * 2.0 - 1.0) * *half;
                Vec3::new(at.x, 0.0, at.y)
            }
            Self::Line { positions, jitter } => {
                let at = positions.get(copy as usize).copied().unwrap_or_default();
                let off = if *jitter > 0.0 { draw_in_disc(*jitter, rng) } else { Vec3::ZERO };
                Vec3::from_array(at.map(math::narrow)) + off
            }
        }
    }
}

/// A uniform draw in a level disc. The radius is the square root of a uniform draw: even density over the disc.
fn draw_in_disc(radius: f32, rng: &mut Rng) -> Vec3 {
    let r = radius * math::sqrt_f32(rng.unit_f32());
    let a = std::f32::consts::TAU * rng.unit_f32();
    Vec3::new(r * math::cos_f32(a), 0.0, r * math::sin_f32(a))
}

/// Draws points with the density of a grey picture: a pixel in proportion to its brightness, then a uniform point in it.
struct MaskSampler<'a> {
    mask: &'a GreyImage,
    /// Sum of the brightness up to and including each pixel, row by row.
    sums: Vec<f64>,
}

impl<'a> MaskSampler<'a> {
    fn new(mask: &'a GreyImage) -> Self {
        let mut total = 0.0;
        let add = |v: &f32| {
            total += f64::from(v.max(0.0));
            total
        };
        Self { mask, sums: mask.values.iter().map(add).collect() }
    }

    /// A point as shares of the width from the left and of the height from the top, 0..1.
    fn draw(&self, rng: &mut Rng) -> Vec2 {
        let total = self.sums.last().copied().unwrap_or(0.0);
        let wanted = rng.unit_f64() * total;
        // The first pixel whose sum lies above the draw: never a black one, whose sum is that of its neighbour.
        let pixel = self.sums.partition_point(|sum| *sum <= wanted).min(self.sums.len().saturating_sub(1));
        let width = self.mask.width.max(1);
        let (x, y) = (pixel % width, pixel / width);
        let place = Vec2::new(x as f32 + rng.unit_f32(), y as f32 + rng.unit_f32());
        place / Vec2::new(width as f32, self.mask.height.max(1) as f32)
    }
}

/// Points in square cells as wide as the distance to keep, so that all points within that distance lie in the 3 x 3 cells
/// around.
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

    /// Distance to the nearest point; the side of a cell if no point is nearer than that.
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

/// Whether copies of a plant share a motion that is recorded in the directions of the scene, and so must face its wind alike. A plant
/// that keeps still or whose motion is left to shaders has none.
pub(crate) fn faces_wind(recipe: &Recipe, plant: usize) -> bool {
    let has_none =
        |p: &PlantRecipe| matches!(p.keys.motion, BarkMotion::Still | BarkMotion::Static) && p.rods.is_none();
    recipe.moves && !recipe.plants.get(plant).is_some_and(has_none)
}

/// World transform of one copy of a place. `turned_as`: the copy whose random turn it shares.
fn copy_transform(seed: u64, index: usize, copy: usize, turned_as: usize, place: &PlaceRecipe, spot: Vec3) -> Trs {
    let keys = &place.keys;
    let stream = |copy: usize| Rng::at(seed, &["place".into(), index.into(), copy.into(), "stand".into()]);
    let drawn_turn = stream(turned_as).range(0.0, std::f64::consts::TAU);
    // The scale is the second draw of the copy's stream; the first is the turn.
    let mut rng = stream(copy);
    rng.next_u64();
    let drawn_scale = rng.range(-1.0, 1.0);
    let turn = keys.turn.unwrap_or(if keys.count > 1 { drawn_turn } else { 0.0 });
    let lean_to = rotation_about_axis(Vec3::Y, keys.lean_to) * Vec3::X;
    let lean = rotation_about_axis(Vec3::Y.cross(lean_to).normalize_or_zero(), keys.lean);
    let center = Vec3::from_array(keys.at.map(math::narrow));
    Trs {
        t: center + spot,
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
    fn hedges_stand_on_their_outline() {
        let l = laid("[[place]]\nplant = \"a\"\nat = [5, 1, 2]\noutline = [6, 3]\nspacing = 0.5\nindividuals = 2");
        assert_eq!((l.individuals.len(), l.instances.len()), (2, 36));
        for s in &l.instances {
            let p = s.transform.t - Vec3::new(5.0, 1.0, 2.0);
            let on_edge = (p.x.abs() - 3.0).abs() < 1e-5 || (p.z.abs() - 1.5).abs() < 1e-5;
            assert!(on_edge && p.x.abs() < 3.001 && p.z.abs() < 1.501 && p.y.abs() < 1e-6, "{p}");
        }
        let line = |jitter: f64| {
            laid(&format!(
                "[[place]]\nplant = \"a\"\nalong = [[0, 0, 0], [9, 3, 0]]\ncount = 10\njitter = {jitter}\nindividuals = 1"
            ))
        };
        let off: Vec<f32> = (line(0.3).instances.iter().zip(&line(0.0).instances))
            .map(|(a, b)| (a.transform.t - b.transform.t).length())
            .collect();
        assert!(off.iter().all(|d| (0.0..=0.3).contains(d)) && off.iter().any(|d| *d > 0.1), "{off:?}");
        assert!((line(0.0).instances[3].transform.t - Vec3::new(3.0, 1.0, 0.0)).length() < 1e-5);
    }

    #[test]
    fn a_line_that_ends_where_it_begins_has_no_copy_twice() {
        for (keys, count) in [("spacing = 1", 16), ("count = 8", 8)] {
            let corners = "[[0, 0, 0], [4, 0, 0], [4, 0, 4], [0, 0, 4], [0, 0, 0]]";
            let l = laid(&format!("[[place]]\nplant = \"a\"\nalong = {corners}\n{keys}\nindividuals = 1"));
            let p: Vec<Vec3> = l.instances.iter().map(|s| s.transform.t).collect();
            assert_eq!(p.len(), count);
            assert!((0..count).all(|i| (0..i).all(|j| p[i].distance(p[j]) > 0.9)), "{p:?}");
        }
    }

    #[test]
    fn a_mask_gives_the_density() {
        // Three columns, black, grey and white, over 30 x 10 m.
        let mask = GreyImage { width: 3, height: 1, values: vec![0.0, 0.25, 0.75] };
        let text =
            "[plants.a]\ngrammar = \"oak.l\"\n[[place]]\nplant = \"a\"\narea = [30, 10]\ncount = 2000\nindividuals = 1";
        let mut recipe = resolve(&Request { text: text.into(), ..Request::default() }).expect("scene").0;
        let even = lay_out(&recipe);
        recipe.places[0].mask = Some(mask);
        let masked = lay_out(&recipe);
        let within = |l: &PlantLayout, from: f32, to: f32| {
            l.instances.iter().filter(|s| s.transform.t.x >= from && s.transform.t.x < to).count()
        };
        assert!((620..=710).contains(&within(&even, -15.0, -5.0)), "a third");
        assert_eq!(within(&masked, -15.0, -5.0), 0);
        assert!((450..=550).contains(&within(&masked, -5.0, 5.0)), "a quarter: {}", within(&masked, -5.0, 5.0));
        assert_eq!(within(&masked, -15.0, 15.0), 2000);
        assert!(masked.instances.iter().all(|s| s.transform.t.z.abs() <= 5.0));
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
