//! `.species` files and the tables of trees that grow year by year: `[plants.NAME.habit]`, `.site`, `.stand`,
//! `[[plants.NAME.prune]]`.

use crate::recipe::resolve::{Resolver, span_of};
use crate::recipe::syntax::{
    BooleanType, Digest, KeyInfo, KeyListing, KeyTable, NumberArray, OneOf, OptionalKey, PointList, RecipePart,
    StringType, TableInfo, TableReader, TomlNode, TomlTable, TomlValue, ValueForm, ValueKind, ValueType, finite_number,
    integer, join, list_table, number, outside, wrong,
};
use crate::recipe::syntax::{Fault, choices, keys};
use crate::recipe::{Growth, PlaceRecipe, PlantRecipe, ReferencedFile, SpeciesRecipe};
use osier_base::diagnostic::{Diagnostic, Span, nearest};
use osier_plants::grow::years::{Arity, HABIT_KEYS, Habit, HabitKey, ORDERS};
use serde_json::json;

/// Greatest length of `side`, the vector towards the brighter side of the sky: with 1 the dark side would be black.
const MAX_SIDE: f64 = 0.95;
/// Share of the height of a cut up to which the stem may be clear without a warning. Own: a hedge without branches over more
/// than its lower half is probably a mistake.
const MAX_CLEAR_SHARE: f64 = 0.5;
/// Keys of a habit with the mark `basic`: those that are usually changed first.
const BASIC: [&str; 6] = ["apical_control", "shoot_rate", "path_max", "angle", "elevation", "clear_stem"];

choices! {
    /// Leaves of a tree in a clip of its growth.
    LeafSeasons {
        /// As `seasons` if a year has at least 12 frames, else as `summer`, since leaves that change faster flicker.
        Auto = "auto",
        /// Leaves that live one year unfold in spring and fall in autumn; longer-lived ones stay over winter.
        Seasons = "seasons",
        /// Leaves stay all year.
        Summer = "summer",
    }
}

keys! {
    /// Place of a tree that grows year by year: its sky, and what stands in its way.
    SiteKeys at "plants.NAME.site" {
        /// The sky is brighter towards this vector (length below 1).
        side: [f64; 3] = "side" NumberArray([0.0; 3], number(0.0, -MAX_SIDE, MAX_SIDE, ""));
        /// Geographic latitude, for `direct`.
        latitude: f64 = "latitude" number(50.0, -90.0, 90.0, "deg");
        /// Fraction of direct sunlight.
        direct: f64 = "direct" number(0.0, 0.0, 0.8, "");
        /// Whether the scene's `[[solid]]`s shade it and stop its shoots.
        solids: bool = "solids" BooleanType(false);
        /// Age at the first frame: the tree grows over the clip and does not sway.
        from: Option<f64> = "from" OptionalKey(number(0.0, 0.0, 500.0, "yr"), "0 with `to`, else the plant's age");
        /// Age at the last frame.
        to: Option<f64> = "to" OptionalKey(number(60.0, 0.0, 500.0, "yr"), "the plant's age");
        /// How leaves come and go while it grows: "auto" follows the seasons where a year has at least 12 frames.
        clip_leaves: LeafSeasons = "clip_leaves" OneOf(LeafSeasons::Auto);
    }
    /// Unseen neighbours of a tree: a ring of leaves that shades it, for trees grown in a forest.
    StandKeys at "plants.NAME.stand" {
        /// Inner radius of the ring.
        radius: f64 = "radius" number(4.0, 0.5, 100.0, "m");
        /// Leaf area in a cubic metre.
        density: f64 = "density" number(0.5, 0.0, 10.0, "m2/m3");
        /// Year in which the neighbours are felled.
        until: f64 = "until" number(500.0, 0.0, 500.0, "yr");
    }
    /// A cut: what lies outside of a box or a solid is cut off at the start of a year.
    PruneKeys at "plants.NAME.prune" as list {
        /// First year.
        year: u32 = "year" integer(10, 1, 500);
        /// Years from one cut to the next; 0 cuts once.
        every: u32 = "every" integer(0, 0, 500);
        /// Last year in which it may repeat.
        until: u32 = "until" integer(500, 1, 500);
        /// Two opposite corners of the box that stays, from the base of the tree; or the name of a `[[solid]]`.
        keep: Vec<[f64; 3]> = "keep" PointList;
        /// Name of the `[[solid]]` that stays instead of a box.
        solid: String = "solid" StringType("");
    }
}

impl SiteKeys {
    /// Whether `self` and `other` have the same sky and the same solids, as trees in one field of light must.
    fn has_sky_of(&self, other: &Self) -> bool {
        // Compare only the keys that determine light and obstacles, not those of the growth clip.
        let keys = |k: &Self| (k.side, k.latitude, k.direct, k.solids);
        keys(self) == keys(other)
    }
}

/// The habit of a species as a table of keys. Names, ranges and defaults of the keys are those of [`HABIT_KEYS`], so that they
/// are declared only once.
#[derive(Debug, Clone, PartialEq)]
pub struct HabitKeys {
    /// All parameters of the species, in the units of its file.
    pub habit: Habit,
}

/// Value type of a key of a habit.
struct HabitValue<'a>(&'a HabitKey);

impl HabitValue<'_> {
    fn defaults(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.0.values(&Habit::default()).iter().map(|v| shortest(*v)).collect();
        // The last value of a list by order repeats, so that equal ones at its end are omitted.
        while self.0.arity == Arity::PerOrder
            && values.len() > 1
            && values[values.len() - 2..].windows(2).all(|w| w[0].to_bits() == w[1].to_bits())
        {
            values.pop();
        }
        values
    }

    fn range(&self) -> String {
        let unit = if self.0.unit.is_empty() { String::new() } else { format!(" {}", self.0.unit) };
        format!("{} to {}{unit}", self.0.min, self.0.max)
    }
}

/// The value of the shortest decimal notation of `v`, so that 0.1 in single precision is listed as 0.1.
fn shortest(v: f32) -> f64 {
    v.to_string().parse().unwrap_or_else(|_| v.into())
}

impl ValueType for HabitValue<'_> {
    type Value = Option<Vec<f64>>;
    fn fallback(&self) -> Self::Value {
        None
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<Self::Value, Fault> {
        let key = self.0;
        // Habits are stored in single precision, but ranges are checked as written.
        let one = |n: &TomlNode| {
            let v = finite_number(name, n)?;
            if !(key.min..=key.max).contains(&v) {
                return Err(outside(name, n, &v.to_string(), &self.range()));
            }
            if key.is_count() && v.fract().abs() > 0.0 {
                let d =
                    Diagnostic::error("S003", format!("{name} is {v}, but must be a whole number"), n.span, "a count");
                return Err(Box::new(d.help(format!("write {} or {}", v.floor(), v.ceil()))));
            }
            Ok(v)
        };
        let most = match key.arity {
            Arity::One => 1,
            Arity::Two => 2,
            Arity::PerOrder => ORDERS,
        };
        let least = if key.arity == Arity::Two { 2 } else { 1 };
        match &node.value {
            TomlValue::List(list) if key.arity != Arity::One => {
                if !(least..=most).contains(&list.len()) {
                    let (wanted, help) = if least == most {
                        ("two numbers", "write 2 numbers")
                    } else {
                        ("one to six numbers", "write one number for each order of axes; the last one repeats")
                    };
                    let text = format!("{name} has {} numbers, but must have {wanted}", list.len());
                    let d = Diagnostic::error("S003", text, node.span, wanted);
                    return Err(Box::new(d.help(help)));
                }
                list.iter().map(one).collect::<Result<_, _>>().map(Some)
            }
            TomlValue::List(_) => Err(wrong(name, node, "a number")),
            _ if key.arity == Arity::Two => Err(wrong(name, node, "a list of 2 numbers")),
            _ => Ok(Some(vec![one(node)?])),
        }
    }
    fn listing(&self) -> KeyListing {
        let (key, defaults) = (self.0, self.defaults());
        let list = defaults.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        let (accepts, default, kind, value) = match key.arity {
            Arity::One if key.is_count() => {
                // A count is listed without decimals, so that input fields step by one.
                let count = list.parse::<i64>().map_or_else(|_| json!(defaults[0]), |count| json!(count));
                ("whole number", list, ValueKind::Whole, count)
            }
            Arity::One => ("number", list, ValueKind::Number, json!(defaults[0])),
            Arity::Two => ("2 numbers", format!("[{list}]"), ValueKind::Vector, json!(defaults)),
            Arity::PerOrder => ("numbers by order of axes", format!("[{list}]"), ValueKind::List, json!(defaults)),
        };
        // Length 0 means a list of any length.
        let length = if key.arity == Arity::Two { 2 } else { 0 };
        let form = ValueForm { length, ..ValueForm::new(kind, value).within(key.min, key.max) };
        KeyListing { accepts: format!("{accepts}, {}", self.range()), default, unit: key.unit, form }
    }
    fn digest(&self, value: &Self::Value, hasher: &mut blake3::Hasher) {
        value.iter().flatten().for_each(|v| v.digest(hasher));
    }
}

impl KeyTable for HabitKeys {
    const PATH: &'static str = "plants.NAME.habit";
    const ALSO: &'static [&'static str] = &[];
    fn about() -> String {
        "Growth of a species year by year, over the values of the plant's `.species` file. Lists have one number for each order of \
         axes, from the trunk on; the last one repeats."
            .to_owned()
    }
    fn keys() -> Vec<KeyInfo> {
        let info = |key: &HabitKey| KeyInfo {
            name: key.name,
            help: key.help.to_owned(),
            basic: BASIC.contains(&key.name),
            listing: HabitValue(key).listing(),
        };
        HABIT_KEYS.iter().map(info).collect()
    }
    fn read_keys(reader: &mut TableReader<'_>) -> Self {
        let mut habit = Habit::default();
        for key in HABIT_KEYS {
            if let Some(values) = reader.key(key.name, &HabitValue(key)) {
                // Names, counts and ranges have been checked.
                _ = habit.set(key.name, &values);
            }
        }
        Self { habit }
    }
}

impl Digest for HabitKeys {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        HABIT_KEYS.iter().flat_map(|key| key.values(&self.habit)).for_each(|v| v.to_bits().digest(hasher));
    }
}

impl RecipePart for HabitKeys {
    fn list(tables: &mut Vec<TableInfo>) {
        list_table::<Self>(tables);
    }
}

impl Resolver<'_> {
    /// Resolves a species from its file, overridden by the tables of a plant. `age`: the plant's key, if it has one.
    pub(in crate::recipe) fn species_recipe(
        &mut self,
        file: &ReferencedFile,
        plant: &TomlTable,
        path: &str,
        age: Option<f64>,
    ) -> Option<SpeciesRecipe> {
        let mut own = self.parse_file(file)?;
        // The file holds the habit and, for species that grow in stands, the neighbours.
        let stand_of_file = own.entries.iter().position(|e| e.key == "stand").map(|i| own.entries.remove(i));
        let habit_path = join(path, "habit");
        let merged = self.laid_over(own, plant, path, "habit");
        let habit: super::HabitKeys = self.read_keys(&merged, &habit_path);
        if let Some(why) = habit.habit.contradiction() {
            // Keys of the scene come after those of the file: of two that contradict each other, the scene's is shown.
            let named = merged.entries.iter().rev().find(|e| why.split_whitespace().any(|word| word == e.key));
            let span = named.map_or(self.whole, |e| e.key_span);
            let d = Diagnostic::error("S003", format!("{habit_path}: {why}"), span, "contradictory keys");
            self.report.push(d.help("`osier list options plants.NAME.habit` shows every key"));
        }
        let stand = match (stand_of_file, plant.get("stand").is_some()) {
            (None, false) => None,
            // Neighbours of the file are kept if the plant changes only some of their keys.
            (file, _) => {
                let table = match file.map(|e| e.node) {
                    Some(TomlNode { value: TomlValue::Table(table), .. }) => table,
                    Some(other) => {
                        self.report.push(*wrong(&join(path, "stand"), &other, "a table"));
                        TomlTable::default()
                    }
                    None => TomlTable::default(),
                };
                let merged = self.laid_over(table, plant, path, "stand");
                Some(self.read_keys(&merged, &join(path, "stand")))
            }
        };
        let site: SiteKeys = self.section_at(plant, path, "site");
        let side = site.side.iter().map(|v| v * v).sum::<f64>();
        // Each component is within its range; only the length of the vector may be too large.
        if side > MAX_SIDE * MAX_SIDE {
            let span = self.place_of(plant, &["site", "side"]);
            let d = Diagnostic::error("S003", format!("{path}.site.side is too long"), span, "too long");
            self.report.push(d.help(format!("give it a length of at most {MAX_SIDE}")));
        }
        let prunes = self.prunes(plant, path);
        let of_file = merged.get("clear_stem").map(|e| e.key_span);
        self.check_clear_stem(plant, path, &habit.habit, &prunes, of_file);
        let age = age.unwrap_or_else(|| shortest(habit.habit.age));
        Some(SpeciesRecipe { habit, site, stand, prunes, age, clip: None })
    }

    /// Ages that a clip shows at its first and last frame, years: those of `site`, or shares of the plant's age. `None` without
    /// either, or after an error. `shares`: the plant's `growth_clip`; `blocked`: the reason why a plant cannot grow over the
    /// clip.
    pub(in crate::recipe) fn species_clip(
        &mut self,
        species: &SpeciesRecipe,
        plant: &TomlTable,
        path: &str,
        shares: Option<[f64; 2]>,
        blocked: Option<&str>,
    ) -> Option<[f64; 2]> {
        let (from, to) = (species.site.from, species.site.to);
        if from.is_none() && to.is_none() {
            return shares.map(|shares| shares.map(|share| share * species.age));
        }
        let key = if from.is_some() { ["site", "from"] } else { ["site", "to"] };
        let span = self.place_of(plant, &key);
        if let Some(why) = blocked {
            self.has_no_effect(plant, path, &key, why);
            return None;
        }
        if shares.is_some() {
            let text = format!("{path}.growth_clip and {path}.{} both set what the clip shows", key.join("."));
            self.report.push(Diagnostic::error("S003", text, span, "contradictory keys").help("leave one of them out"));
            return None;
        }
        let ages = [from.unwrap_or(0.0), to.unwrap_or(species.age)];
        if let Some(late) = ages.iter().find(|age| **age > species.age) {
            let text = format!("{path}.site shows the tree at {late} years, but it grows to {}", species.age);
            let d = Diagnostic::error("S003", text, span, "beyond its age");
            self.report.push(d.help(format!("raise its age: age = {late}")));
            return None;
        }
        Some(ages)
    }

    /// Warns with S038 if `clear_stem` removes most of what a cut leaves, or all branches of the tree. `of_file`: the key in the
    /// species' file, where the plant has neither the key nor a cut.
    fn check_clear_stem(
        &mut self,
        plant: &TomlTable,
        path: &str,
        habit: &Habit,
        prunes: &[PruneKeys],
        of_file: Option<Span>,
    ) {
        // Shrubs of several stems keep their lower branches.
        if !habit.clears_stem() {
            return;
        }
        let clear = f64::from(habit.clear_stem);
        let top = |p: &PruneKeys| p.keep.iter().map(|corner| corner[1]).fold(0.0, f64::max);
        // Height of the lowest cut by a box; without one it is infinite, so that no stem is too high.
        let hedge = prunes.iter().filter(|p| p.solid.is_empty()).map(top).fold(f64::INFINITY, f64::min);
        // A tree grows no higher than its longest axis, nor than the limit of its height.
        let highest = habit.path_max.min(habit.height_max);
        // The message prints single-precision values: conversion to f64 would show further digits.
        let below = habit.clear_stem;
        let (what, help) = if clear > MAX_CLEAR_SHARE * hedge {
            (format!("a plant that is cut at {hedge} m"), "write [plants.NAME.habit] clear_stem = 0.1 for a hedge")
        } else if below >= highest {
            let help = "lower clear_stem, or raise path_max and height_max, which limit the tree";
            (format!("a tree that grows {highest} m high at most"), help)
        } else {
            return;
        };
        let span = span_of(plant, &["habit", "clear_stem"])
            .or_else(|| plant.get("prune").map(|e| e.key_span))
            .or(of_file)
            .unwrap_or(self.whole);
        let text = format!("{path}: clear_stem takes away the branches below {below} m of {what}");
        self.report.push(Diagnostic::warning("S038", text, span, "too high a stem").help(help));
    }

    /// Reports S003 for plants that grow together in one field of light but have different skies.
    pub(in crate::recipe) fn check_sites_together(
        &mut self,
        root: &TomlTable,
        plants: &[PlantRecipe],
        places: &[PlaceRecipe],
    ) {
        let mut first: Option<(&PlantRecipe, &SiteKeys)> = None;
        let mut reported: Vec<&str> = Vec::new();
        for plant in places.iter().filter(|p| p.keys.together).filter_map(|p| plants.get(p.plant)) {
            let Growth::Species(species) = &plant.growth else { continue };
            // Every plant is compared with the first; there is one diagnostic per plant, however many places name it.
            let (other, site) = *first.get_or_insert((plant, &species.site));
            if site.has_sky_of(&species.site) || reported.contains(&plant.name.as_str()) {
                continue;
            }
            reported.push(&plant.name);
            // A plant without a table `site` has the defaults: point at its own table instead.
            let span = |name: &str| {
                let site = span_of(root, &["plants", name, "site"]);
                site.or_else(|| span_of(root, &["plants", name])).unwrap_or(self.whole)
            };
            let text = format!(
                "plants.{0}.site differs from plants.{1}.site, but {0} and {1} grow together in one field of light",
                plant.name, other.name
            );
            let mut d = Diagnostic::error("S003", text, span(&plant.name), "another site");
            d.labels.push((span(&other.name), "than this one".into()));
            let help = "give both the same [plants.NAME.site], or leave out `together` of one";
            self.report.push(d.help(help));
        }
    }

    fn prunes(&mut self, plant: &TomlTable, path: &str) -> Vec<PruneKeys> {
        let Some(entry) = plant.get("prune") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong(&join(path, "prune"), &entry.node, "a list: write [[plants.NAME.prune]]"));
            return Vec::new();
        };
        let mut prunes = Vec::new();
        for (i, node) in list.iter().enumerate() {
            let path = format!("{path}.prune.{i}");
            let TomlValue::Table(table) = &node.value else {
                self.report.push(*wrong(&path, node, "a table"));
                continue;
            };
            // keep = "NAME" is short for solid = "NAME".
            let named = table.get("keep").filter(|e| matches!(e.node.value, TomlValue::Text(_)));
            if let Some((keep, solid)) = named.zip(table.get("solid")) {
                let text = format!("[{path}] names a solid by keep and by solid");
                let mut d = Diagnostic::error("S003", text, solid.key_span, "the second name");
                d.labels.push((keep.key_span, "the first".into()));
                self.report.push(d.help("leave one of them out"));
                continue;
            }
            let renamed = named.map(|_| {
                let mut renamed = table.clone();
                // The entry keeps its span, so that errors of its value point there.
                renamed.entries.iter_mut().filter(|e| e.key == "keep").for_each(|e| e.key = "solid".into());
                renamed
            });
            let keys = self.read_keys::<PruneKeys>(renamed.as_ref().unwrap_or(table), &path);
            if !keys.solid.is_empty() && !keys.keep.is_empty() {
                let text = format!("[{path}] keeps both a box and a solid");
                let d = Diagnostic::error("S003", text, node.span, "keep and solid");
                self.report.push(d.help("leave out `keep` or `solid`, or write two cuts"));
            } else if keys.solid.is_empty() && keys.keep.len() != 2 {
                // A value that could not be read has been reported.
                let is_unread = keys.keep.is_empty() && (table.holds("keep") || table.holds("solid"));
                if !is_unread {
                    let d = Diagnostic::error("S006", format!("[{path}] names nothing to keep"), node.span, "no box");
                    let help = "add keep = [[-1, 0, -1], [1, 1.8, 1]], two corners of a box, or solid = \"NAME\"";
                    self.report.push(d.help(help));
                }
            } else if !keys.solid.is_empty() && !self.solid_names.contains(&keys.solid) {
                let text = format!("[{path}] names the solid \"{}\", which the scene does not have", keys.solid);
                let d = Diagnostic::error("S005", text, self.place_of(table, &["solid"]), "unknown solid");
                self.report.push(match nearest(&keys.solid, self.solid_names.iter().map(String::as_str)) {
                    Some(near) => d.help(format!("did you mean \"{near}\"?")),
                    None => d.help("give a [[solid]] this name"),
                });
            } else {
                prunes.push(keys);
            }
        }
        prunes
    }
}
