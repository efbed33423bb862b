//! `[[place]]`: copies of a plant around a point, along a line or over an area.

use crate::recipe::resolve::Resolver;
use crate::recipe::syntax::{
    BooleanType, FileReference, KeyTable as _, NumberArray, OneOf, OptionalKey, PointList, Reference, SeedType,
    StringType, TomlNode, TomlTable, TomlValue, degrees, integer, number, point, wrong,
};
use crate::recipe::syntax::{choices, keys};
use crate::recipe::{Growth, PlaceRecipe, PlantRecipe};
use osier_base::diagnostic::{Diagnostic, Span, nearest};
use osier_import::GreyImage;

/// Largest number of copies of one place.
const MAX_COUNT: u32 = 100_000;
/// Number of corners of the polygon that approximates a ring. Own: at a radius of 100 m its sides are shorter than a metre.
const RING_CORNERS: u16 = 720;

choices! {
    /// Level from which the heights of a place count.
    HeightDatum {
        /// The ground or terrain below each copy.
        Ground = "ground",
        /// Height 0 of the scene: heights are absolute, and the ground does not move the copies.
        Zero = "zero",
    }
}

keys! {
    /// Places plants in the scene.
    PlaceKeys at "place" as list {
        /// Name of the plant, as in `[plants.NAME]`.
        plant: String = "plant" StringType(""), basic;
        /// Position; with `count` the centre of the group. Y is a height, see `height_from`.
        at: [f64; 3] = "at" point([0.0; 3]), basic;
        /// What the y of `at` and `along` counts from: the ground below each copy, or height 0 of the scene.
        height_from: HeightDatum = "height_from" OneOf(HeightDatum::Ground);
        /// Rotation about the vertical axis.
        turn: Option<f64> = "turn_deg" OptionalKey(degrees(0.0, -360.0, 360.0), "0; random in groups"), basic;
        /// Factor on the size of the copies.
        scale: f64 = "scale" number(1.0, 1e-3, 1e3, ""), basic;
        /// Random variation of the scale, as a fraction.
        vary: f64 = "vary" number(0.0, 0.0, 0.9, ""), basic;
        /// Inclination from the vertical.
        lean: f64 = "lean_deg" degrees(0.0, 0.0, 90.0);
        /// Direction of the inclination: 0 is +X, 90 is -Z.
        lean_to: f64 = "lean_to_deg" degrees(0.0, -360.0, 360.0);
        /// Selects another individual.
        seed: u64 = "seed" SeedType(0);
        /// Number of copies within `radius`, `area`, or along a line.
        count: u32 = "count" integer(1, 1, MAX_COUNT), basic;
        /// Radius of the group.
        radius: f64 = "radius" number(10.0, 0.0, 1e5, "m"), basic;
        /// Smallest distance between copies, where there is room. Along a line, without `count`: distance from one copy to the next,
        /// adjusted so that every corner has one.
        spacing: f64 = "spacing" number(0.0, 0.0, 1e5, "m"), basic;
        /// Smallest distance to plants of earlier `[[place]]` tables.
        clear: f64 = "clear" number(0.0, 0.0, 1e5, "m");
        /// Corners of a line along which the copies stand, from `at`; y is a height, see `height_from`.
        along: Vec<[f64; 3]> = "along" PointList;
        /// Width (X) and depth (Z) of a rectangle around `at` on whose outline the copies stand, as hedges round a garden.
        outline: Option<[f64; 2]> = "outline" OptionalKey(NumberArray([10.0, 10.0], number(10.0, 0.01, 1e5, "m")), "none");
        /// Radius of a circle around `at` on which the copies stand.
        ring: Option<f64> = "ring" OptionalKey(number(5.0, 0.01, 1e5, "m"), "none");
        /// Width (X) and depth (Z) of a rectangle around `at` in which the copies stand, instead of a disc.
        area: Option<[f64; 2]> = "area" OptionalKey(NumberArray([10.0, 10.0], number(10.0, 0.01, 1e5, "m")), "none");
        /// Grey picture over `area`, its top at -Z: copies are as dense as it is bright, and none stand where it is black.
        mask: Option<Reference> = "mask" FileReference(".png, .jpg, .exr");
        /// Along a line: largest distance of a copy from its position on the line.
        jitter: f64 = "jitter" number(0.0, 0.0, 1e4, "m");
        /// Whether these copies of a species, and those of all other such tables, grow in one field of light.
        together: bool = "together" BooleanType(false);
        /// Number of individuals that the copies share.
        individuals: Option<u32> = "individuals" OptionalKey(integer(1, 1, 10_000), "count: one each");
    }
}

/// Keys that choose the region of a place, of which it may have one.
const REGIONS: [&str; 5] = ["radius", "area", "along", "outline", "ring"];

impl Resolver<'_> {
    pub(in crate::recipe) fn places(&mut self, root: &TomlTable, plants: &[PlantRecipe]) -> Vec<PlaceRecipe> {
        let Some(entry) = root.get("place") else {
            // Without places, each plant has one copy; with scatters, there are only scattered plants.
            return if root.get("scatter").is_none() { default_places(plants) } else { Vec::new() };
        };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("place", &entry.node, "a list: write [[place]]"));
            return Vec::new();
        };
        // A scatter may place all plants; an empty list of places then changes nothing.
        if list.is_empty() && !plants.is_empty() && root.get("scatter").is_none() {
            let text = "`place` is empty: the scene shows none of its plants";
            let d = Diagnostic::warning("S007", text, entry.node.span, "no place");
            self.report.push(d.help("leave `place` out for one copy of each plant, or add [[place]]"));
        }
        // Plants with errors count as declared: a place may name them.
        let declared = root.table("plants").map(TomlTable::names).unwrap_or_default();
        list.iter().enumerate().filter_map(|(i, node)| self.place(i, node, plants, &declared)).collect()
    }

    fn place(&mut self, i: usize, node: &TomlNode, plants: &[PlantRecipe], declared: &[&str]) -> Option<PlaceRecipe> {
        let path = format!("place.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        // Line, mask and plant are checked before an error ends the place, so that all errors are reported in one run.
        let mut keys = self.read_keys::<PlaceKeys>(table, &path);
        let line = self.line(table, node.span, &path, &mut keys);
        let mask = self.place_mask(table, &path, &keys);
        let plant = self.plant_of_place(&keys, table, node.span, plants, declared)?;
        if let Some(plant) = plants.get(plant) {
            self.check_individuals(table, &path, &keys, plant);
            self.check_turns(table, &path, &keys, plant);
        }
        Some(PlaceRecipe { plant, keys, line: line?, mask: mask? })
    }

    /// Index of the plant that a place names; without a name, that of the scene's only one. `None` after an error.
    fn plant_of_place(
        &mut self,
        keys: &PlaceKeys,
        table: &TomlTable,
        place: Span,
        plants: &[PlantRecipe],
        declared: &[&str],
    ) -> Option<usize> {
        if let Some(plant) = plants.iter().position(|p| p.name == keys.plant) {
            return Some(plant);
        }
        let span = table.get("plant").map_or(place, |e| e.node.span);
        if declared.contains(&keys.plant.as_str()) {
            return None;
        }
        if keys.plant.is_empty() {
            if declared.len() == 1 {
                // The only plant may have errors, which have been reported.
                return (!plants.is_empty()).then_some(0);
            }
            // A value that is no text has been reported.
            if !table.holds("plant") {
                let d = Diagnostic::error("S006", "this place names no plant", span, "no plant here");
                self.report.push(d.help("add plant = \"NAME\""));
            }
        } else {
            let d = Diagnostic::error("S005", format!("there is no plant \"{}\"", keys.plant), span, "unknown plant");
            self.report.push(match nearest(&keys.plant, declared.iter().copied()) {
                Some(near) => d.help(format!("did you mean \"{near}\"?")).fix(span, format!("\"{near}\"")),
                None => d.help(declared_plants(declared)),
            });
        }
        None
    }

    /// Positions of the copies along a line, m, relative to `at`; empty for a group. Sets `count` if `spacing` decides it.
    /// `None` after an error.
    fn line(&mut self, table: &TomlTable, place: Span, path: &str, keys: &mut PlaceKeys) -> Option<Vec<[f64; 3]>> {
        // Refuse a second region.
        // An empty `along` counts as absent.
        let is_set = |key: &&&str| **key != "along" || !keys.along.is_empty();
        let given: Vec<_> = REGIONS.iter().filter(is_set).filter_map(|key| table.get(key)).collect();
        if let [first, second, ..] = given[..] {
            let text = format!("{path} has both {} and {}: its copies stand in one region", first.key, second.key);
            let mut d = Diagnostic::error("S003", text, second.key_span, "the second region");
            d.labels.push((first.key_span, "the first".into()));
            self.report.push(d.help("leave one of them out, or write two [[place]] tables"));
            return None;
        }
        let region = given.first().map_or("radius", |entry| entry.key.as_str());
        let is_line = ["along", "outline", "ring"].contains(&region);
        if let Some(entry) = table.get("jitter").filter(|_| !is_line) {
            let text = format!("{path}.jitter has no effect");
            let d = Diagnostic::warning("S007", text, entry.key_span, "has no effect");
            self.report.push(d.help("copies of a group stand at random anyway; give a line: along, outline or ring"));
        }
        // Rectangles and circles are closed lines.
        let corners = match (keys.outline, keys.ring) {
            _ if !is_line => return Some(Vec::new()),
            (Some(size), _) => rectangle(size),
            (_, Some(radius)) => circle(radius),
            // The value of an outline or a ring has a fault, which has been reported.
            _ if region != "along" => return None,
            _ => keys.along.clone(),
        };
        let span = given.first().map_or(place, |entry| entry.node.span);
        if length(&corners) <= 0.0 {
            let text = format!("{path}.along is no line");
            let d = Diagnostic::error("S003", text, span, "fewer than two different points");
            self.report.push(d.help("write two corners or more: along = [[-5, 0, 0], [5, 0, 0]]"));
            return None;
        }
        // A line that ends where it begins is closed too: its last corner needs no second copy.
        let ends = corners.first().zip(corners.last());
        let closed = region != "along" || ends.is_some_and(|(a, b)| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-9));
        // The number of copies, or the distance between them.
        let positions = match (table.get("count"), table.get("spacing")) {
            (Some(count), Some(spacing)) => {
                let text = format!("{path} has both count and spacing along a line");
                let mut d = Diagnostic::error("S003", text, spacing.key_span, "the distance between copies");
                d.labels.push((count.key_span, "and their number".into()));
                self.report
                    .push(d.help("leave one of them out: each follows from the other and the length of the line"));
                return None;
            }
            (Some(_), None) => by_count(&corners, keys.count, closed),
            (None, _) if keys.spacing > 0.0 => {
                let wanted = length(&corners) / keys.spacing;
                if wanted > f64::from(MAX_COUNT) {
                    let text = format!("{path}: {} copies stand along a line, at most {MAX_COUNT} may", wanted.round());
                    self.report.push(Diagnostic::error("S004", text, span, "too many").help("give a larger spacing"));
                    return None;
                }
                // A circle has no corners that need a copy.
                if region == "ring" {
                    by_count(&corners, whole(wanted).max(1), true)
                } else {
                    by_spacing(&corners, keys.spacing, closed)
                }
            }
            _ => {
                let text = format!("{path} says neither how many copies stand along its line nor how far apart");
                let d = Diagnostic::error("S006", text, span, "no spacing");
                self.report.push(d.help("add spacing = 0.5, metres from one to the next, or count = 20"));
                return None;
            }
        };
        // Both ways above give MAX_COUNT copies or a few more, so that the conversion cannot fail.
        keys.count = u32::try_from(positions.len()).unwrap_or(MAX_COUNT);
        Some(positions)
    }

    /// Reads the density picture of an area; the outer `None` after an error, the inner one without the key.
    #[allow(clippy::option_option, reason = "a mask that fails is not the same as no mask")]
    fn place_mask(&mut self, table: &TomlTable, path: &str, keys: &PlaceKeys) -> Option<Option<GreyImage>> {
        let Some(reference) = &keys.mask else { return Some(None) };
        if keys.area.is_none() {
            let span = table.get("mask").map_or(reference.span, |e| e.key_span);
            let d = Diagnostic::error("S006", format!("{path}.mask needs an area"), span, "a picture of what");
            self.report.push(d.help("add area = [40, 30], width (X) and depth (Z) of the rectangle that it covers"));
            return None;
        }
        let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".png", ".jpg", ".jpeg", ".exr"])?;
        // Copies are drawn by brightness, so that a black picture allows none.
        let mask = self.grey(&file)?;
        if mask.values.iter().all(|v| *v <= 0.0) {
            let text = format!("{path}.mask is black everywhere");
            let d = Diagnostic::error("S003", text, reference.span, "no copy can stand anywhere");
            self.report.push(d.help("paint white where plants grow"));
            return None;
        }
        Some(Some(mask))
    }

    /// Warns with S007 of turns and scales of a plant that grows for its place.
    fn check_turns(&mut self, table: &TomlTable, path: &str, keys: &PlaceKeys, plant: &PlantRecipe) {
        let Some(why) = why_in_place(keys, plant) else { return };
        for key in ["turn_deg", "scale", "vary", "lean_deg", "lean_to_deg"] {
            if table.get(key).is_some() {
                let why = format!("plant \"{}\" {why}: it is neither turned nor scaled", plant.name);
                self.has_no_effect(table, path, &[key], &why);
            }
        }
    }

    /// Reports S003 for a plant whose growth depends on its place and which has more copies than individuals.
    fn check_individuals(&mut self, table: &TomlTable, path: &str, keys: &PlaceKeys, plant: &PlantRecipe) {
        let Some(entry) = table.get("individuals") else { return };
        let Some(count) = keys.individuals.filter(|n| *n < keys.count) else { return };
        // Particle-shapes round solids are turned and scaled, but each copy has solids of its own around it.
        let of_shapes = matches!(&plant.growth, Growth::Shapes(shapes) if shapes.reads_solids());
        let round_solids = of_shapes || plant.fill.as_ref().is_some_and(|twigs| twigs.reads_solids());
        let why = why_in_place(keys, plant).or(round_solids.then_some("grows round solids"));
        let Some(why) = why else { return };
        // Copies of one individual have the same mesh, which cannot fit two places.
        let places = keys.count;
        let text = format!(
            "{path}: plant \"{}\" {why} but stands in {places} places as {count} individual{}",
            plant.name,
            if count == 1 { "" } else { "s" }
        );
        let d = Diagnostic::error("S003", text, entry.node.span, "too few individuals");
        self.report.push(d.help(format!("write individuals = {places}, or leave it out")));
    }
}

/// Why a plant grows for the place in which it stands, worded to follow its name; `None` if it grows alike everywhere.
pub(in crate::recipe) fn why_in_place(keys: &PlaceKeys, plant: &PlantRecipe) -> Option<&'static str> {
    let Growth::Species(species) = &plant.growth else { return None };
    if keys.together {
        Some("grows together with the trees around it")
    } else if species.site.solids {
        Some("grows round solids")
    } else if !species.prunes.is_empty() {
        Some("is cut where it stands")
    } else {
        None
    }
}

/// Help for a name that is no plant of the scene.
pub(in crate::recipe) fn declared_plants(declared: &[&str]) -> String {
    if declared.is_empty() {
        return "the scene has no [plants.NAME]; attractors of [clouds.NAME] and solids stand at their own `at`".into();
    }
    format!("plants of this scene: {}", declared.join(", "))
}

/// The places of a scene without `[[place]]`: one copy of each plant, in a row along +X at 4 m.
fn default_places(plants: &[PlantRecipe]) -> Vec<PlaceRecipe> {
    let place = |(plant, number): (usize, u32)| {
        let at = [4.0 * f64::from(number), 0.0, 0.0];
        PlaceRecipe { plant, keys: PlaceKeys { at, ..PlaceKeys::defaults() }, line: Vec::new(), mask: None }
    };
    (0..plants.len()).zip(0_u32..).map(place).collect()
}

/// The closed outline of a rectangle around the origin, m, counter-clockwise from above.
fn rectangle([width, depth]: [f64; 2]) -> Vec<[f64; 3]> {
    let (x, z) = (width / 2.0, depth / 2.0);
    [[-x, z], [x, z], [x, -z], [-x, -z], [-x, z]].map(|[x, z]| [x, 0.0, z]).to_vec()
}

/// The closed polygon that approximates a circle around the origin, m, counter-clockwise from above.
fn circle(radius: f64) -> Vec<[f64; 3]> {
    let corner = |k: u16| {
        let a = std::f64::consts::TAU * f64::from(k % RING_CORNERS) / f64::from(RING_CORNERS);
        [radius * osier_base::math::cos(a), 0.0, -radius * osier_base::math::sin(a)]
    };
    (0..=RING_CORNERS).map(corner).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    // Horizontal distance: copies on a rising line have the spacing of its plan.
    ((b[0] - a[0]) * (b[0] - a[0]) + (b[2] - a[2]) * (b[2] - a[2])).sqrt()
}

fn lerp(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * share)
}

/// Horizontal length of a line, m.
fn length(corners: &[[f64; 3]]) -> f64 {
    corners.windows(2).map(|w| distance(w[0], w[1])).sum()
}

/// A count rounded to the nearest whole number, at most [`MAX_COUNT`].
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
fn whole(v: f64) -> u32 {
    v.round().clamp(0.0, f64::from(MAX_COUNT)) as u32
}

/// `count` positions at equal distances along a line. On an open line the first and last are at its ends, a single one in its
/// middle.
fn by_count(corners: &[[f64; 3]], count: u32, closed: bool) -> Vec<[f64; 3]> {
    let total = length(corners);
    // A closed line has as many intervals as copies, an open one has one fewer.
    let share = |k: u32| match (closed, count) {
        (true, n) => f64::from(k) / f64::from(n),
        (false, 1) => 0.5,
        (false, n) => f64::from(k) / f64::from(n - 1),
    };
    (0..count).map(|k| at_length(corners, share(k) * total)).collect()
}

/// Positions at about `spacing`, m, with one at every corner: each side is divided into equal intervals.
fn by_spacing(corners: &[[f64; 3]], spacing: f64, closed: bool) -> Vec<[f64; 3]> {
    let mut out = Vec::new();
    for side in corners.windows(2).filter(|w| distance(w[0], w[1]) > 0.0) {
        let steps = whole(distance(side[0], side[1]) / spacing).max(1);
        out.extend((0..steps).map(|k| lerp(side[0], side[1], f64::from(k) / f64::from(steps))));
    }
    // On a closed line the last corner is the first one.
    out.extend(corners.last().filter(|_| !closed));
    out
}

/// Point of a line at a horizontal length `rest`, m, from its beginning; the last corner beyond its end.
fn at_length(corners: &[[f64; 3]], mut rest: f64) -> [f64; 3] {
    for side in corners.windows(2) {
        let side_length = distance(side[0], side[1]);
        if rest <= side_length && side_length > 0.0 {
            return lerp(side[0], side[1], rest / side_length);
        }
        rest -= side_length;
    }
    corners.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_divided_evenly() {
        let corner = [[0.0, 0.0, 0.0], [10.0, 1.0, 0.0], [10.0, 1.0, 4.0]];
        let spots = by_spacing(&corner, 2.4, false);
        // 10 m are 4 steps of 2.5 m, 4 m are 2 of 2 m.
        assert_eq!(spots.len(), 7);
        assert!(distance(spots[4], corner[1]) < 1e-9 && distance(spots[6], corner[2]) < 1e-9);
        assert!((spots[2][1] - 0.5).abs() < 1e-9, "heights are between those of the corners");
        let spots = by_count(&corner, 8, false);
        assert!(spots.windows(2).all(|w| (distance(w[0], w[1]) - 2.0).abs() < 1e-9));
        assert!(distance(by_count(&corner, 1, false)[0], [7.0, 0.0, 0.0]) < 1e-9);
    }

    #[test]
    fn closed_lines_have_no_copy_twice() {
        let hedge = by_spacing(&rectangle([6.0, 3.0]), 0.5, true);
        assert_eq!(hedge.len(), 36);
        let ring = by_count(&circle(5.0), 7, true);
        for list in [&hedge, &ring] {
            for (i, a) in list.iter().enumerate() {
                assert!(list[..i].iter().all(|b| distance(*a, *b) > 0.49));
            }
        }
        assert!(ring.iter().all(|p| (distance(*p, [0.0; 3]) - 5.0).abs() < 1e-4));
        assert!(ring[1][2] < 0.0, "counter-clockwise from above");
    }
}
