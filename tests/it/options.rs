//! The schema of scene files: kinds, ranges and defaults of `osier list options --json`, held against what scenes accept.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests fail by panicking and write their input")]

use crate::common::program::{arg, ends};
use osier::Error;
use osier::recipe::{Request, TableInfo, options, resolve};
use serde_json::Value;

/// Tables of which a scene has a list.
const LISTS: [&str; 13] = [
    "clouds.NAME.morph.key",
    "flight.zone",
    "layer",
    "output.wind.slice",
    "place",
    "plants.NAME.prune",
    "rain.lying",
    "rod",
    "rod.clamp",
    "rod.load",
    "scatter",
    "solid",
    "wind.add",
];

/// An index stands behind the names of such tables in the path of an override, which scripts build from the listing.
#[test]
fn the_schema_tells_which_tables_are_lists() {
    let (out, _) = ends(0, &["list", "options", "--json"]);
    let rows: Vec<Value> = serde_json::from_str(&out).expect("JSON");
    for row in &rows {
        let path = row["path"].as_str().expect("path");
        let is_of_path = |list: &&str| path.strip_prefix(*list).is_some_and(|rest| rest.starts_with('.'));
        let lists = LISTS.iter().copied().chain(INLINE.iter().map(|(list, _)| *list));
        let mut wanted: Vec<&str> = lists.filter(is_of_path).collect();
        wanted.sort_unstable();
        assert_eq!(row["lists"], Value::from(wanted), "{path}");
    }
    assert!(rows.iter().any(|row| row["lists"] == serde_json::json!(["rod", "rod.clamp"])));
}

/// Tables that are values of a key: the key's path with what stands around such a table.
const INLINE: [(&str, &str); 4] = [
    ("plants.NAME.turtle.tropisms", "plants.oak.turtle"),
    ("plants.NAME.turtle.contours", "plants.oak.turtle"),
    ("plants.NAME.turtle.functions", "plants.oak.turtle"),
    ("plants.NAME.growth.obstacles", "plants.oak.growth"),
];

/// A scene in which `line` stands in a table. Tables around it have the keys that they cannot be read without.
fn scene(table: &TableInfo, line: &str) -> String {
    let source = match table.path {
        "plants.NAME.tree" => "ifs = \"monopodial.ifs.toml\"",
        "plants.NAME.import" => "mesh = \"young-tree.obj\"",
        path if path.starts_with("plants.NAME.growth") => "shapes = \"bush.shapes\"",
        "plants.NAME.habit" | "plants.NAME.site" | "plants.NAME.stand" | "plants.NAME.prune" => "species = \"hazel\"",
        _ => "grammar = \"oak.l\"",
    };
    if let Some((path, around)) = INLINE.iter().find(|(path, _)| *path == table.path) {
        let key = path.rsplit_once('.').map_or(*path, |p| p.1);
        return format!("[plants.oak]\n{source}\n[{around}]\n{key} = [{{ {line} }}]\n");
    }
    let path = table.path.replace("LETTER", "l");
    let path = if path.starts_with("clouds") { path.replace("NAME", "fern") } else { path.replace("NAME", "oak") };
    let header = match (path.as_str(), LISTS.contains(&table.path)) {
        ("", _) => String::new(),
        (path, true) => format!("[[{path}]]\n"),
        (path, false) => format!("[{path}]\n"),
    };
    let own = format!("{header}{line}\n");
    // A table's own source, unless the line is that key.
    let with = |key: &str, value: &str| {
        let is_given = line.split(' ').next() == Some(key);
        format!("{header}{}{line}\n", if is_given { String::new() } else { format!("{key} = {value}\n") })
    };
    match table.path {
        "" => format!("{line}\n[plants.oak]\n{source}\n"),
        "plants.NAME" => with("grammar", "\"oak.l\""),
        "clouds.NAME" => with("ifs", "\"fern_leaf.ifs\""),
        "clouds.NAME.morph" => format!("[clouds.fern]\n{own}"),
        // A morph has two tables at least.
        "clouds.NAME.morph.key" => {
            let (first, at) = (with("ifs", "\"fern_leaf.ifs\""), if line.starts_with("at ") { "" } else { "at = 0\n" });
            format!("[clouds.fern]\n{first}{at}{header}ifs = \"fern_leaf.ifs\"\nat = 1\n")
        }
        "rod" => with("points", "[[0, 0, 0], [0, 1, 0]]"),
        "rod.clamp" | "rod.load" => format!("[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\n{own}"),
        "scatter" => format!("[plants.oak]\n{source}\n[terrain]\n{own}"),
        "flight.zone" => format!("[plants.oak]\n{source}\n[catkin]\n[flight]\n{own}"),
        _ => format!("[plants.oak]\n{source}\n{own}"),
    }
}

/// Codes and messages of what is wrong in the notation, types and ranges of a scene.
fn faults(text: &str) -> Vec<String> {
    let request = Request { name: "s".into(), shown: "s.toml".into(), text: text.into(), ..Request::default() };
    let report = match resolve(&request) {
        Ok((_, report)) => report,
        Err(Error::Input(report)) => *report,
        Err(e) => panic!("{text}: {e}"),
    };
    let wrong = report.diagnostics.iter().filter(|d| ["S001", "S002", "S003", "S004"].contains(&d.code));
    wrong.map(|d| format!("{}: {}", d.code, d.message)).collect()
}

/// The numbers of a value.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().filter_map(Value::as_f64).collect(),
        other => other.as_f64().into_iter().collect(),
    }
}

#[test]
fn every_default_lies_in_its_range() {
    for table in options() {
        for key in &table.keys {
            let (form, name) = (&key.listing.form, format!("{}.{}", table.path, key.name));
            let [min, max] = form.range;
            for v in numbers(&form.default).into_iter().chain(numbers(&form.initial)) {
                assert!(
                    min.is_none_or(|min| v >= min) && max.is_none_or(|max| v <= max),
                    "{name}: {v} {min:?} {max:?}"
                );
            }
            for value in [&form.default, &form.initial] {
                let words = if let Value::Array(list) = value { list.iter().collect() } else { vec![value] };
                let given = words.into_iter().filter(|word| !word.is_null() && !form.choices.is_empty());
                given.for_each(|word| assert!(form.choices.contains(word), "{name}: {word}"));
            }
            if form.length > 0 && !form.initial.is_null() {
                assert_eq!(numbers(&form.initial).len(), form.length, "{name}");
            }
            let (step, number) = (form.step(), matches!(form.kind.word(), "number" | "whole" | "vector"));
            assert_eq!(step.is_some(), number, "{name}");
            assert!(step.is_none_or(|step| step > 0.0), "{name}: {step:?}");
        }
    }
}

#[test]
fn every_default_is_accepted_when_a_scene_gives_it() {
    let mut refused = Vec::new();
    for table in options() {
        for key in &table.keys {
            // A date is no value of any key: its refusal shows that the key was read where the test put it.
            let name = key.name;
            let wrong = faults(&scene(&table, &format!("{name} = 2020-02-02")));
            if !wrong.iter().any(|w| w.contains(name)) {
                refused.push(format!("[{}] {name} is not read: {wrong:?}", table.path));
            }
            let default = &key.listing.form.default;
            let text = scene(&table, &format!("{name} = {default}"));
            let wrong = if default.is_null() { Vec::new() } else { faults(&text) };
            refused.extend(wrong.iter().filter(|w| w.contains(name)).map(|w| format!("{text}{w}")));
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
}

#[test]
fn text_and_json_list_the_same_keys() {
    let count: usize = options().iter().map(|table| table.keys.len()).sum();
    let (json, _) = ends(0, &["list", "options", "--json"]);
    let rows: Vec<Value> = serde_json::from_str(&json).expect("JSON");
    let (text, _) = ends(0, &["list", "options"]);
    // A key has a line of help and below it one of accepted values, which is indented deeper.
    let lines = text.lines().filter(|l| l.starts_with("  ") && !l.starts_with("   ")).count();
    assert_eq!((rows.len(), lines), (count, count));
    let basic = rows.iter().filter(|row| row["basic"] == true).count();
    assert!((40..=90).contains(&basic), "{basic} basic keys");
    let speed = rows.iter().find(|row| row["path"] == "wind.speed").expect("wind.speed");
    assert_eq!((&speed["kind"], &speed["default"], &speed["unit"]), (&"number".into(), &4.5.into(), &"m/s".into()));
    // A count of a species is refused with decimals, so its input field has none.
    let stems = rows.iter().find(|row| row["path"] == "plants.NAME.habit.stems").expect("stems");
    assert_eq!((&stems["kind"], &stems["default"], &stems["step"]), (&"whole".into(), &1.into(), &1.0.into()));
    let model = rows.iter().find(|row| row["path"] == "wind.model").expect("wind.model");
    assert!(model["choices"].as_array().is_some_and(|c| c.contains(&model["default"])), "{model}");
}

#[test]
fn a_check_gives_keys_and_parameters_with_their_bytes() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, grammar) = (dir.path().join("s.toml"), dir.path().join("g.l"));
    let rules = "/* A stick. */\n#define CROOK 9 /* 0..40 deg: how crooked it is */\n#define HEIGHT 2.5\n#define HALF (HEIGHT/2)\n\
        Lsystem: g\nDerivation length: 1\nAxiom: @!(0.1) F(HALF) +(CROOK) F(HALF)\nendlsystem\n";
    let text = "[plants.a]\ngrammar = \"g.l\"\nset = { HEIGHT = 4 }\n[plants.a.leaf]\nside = 64\n[plants.a.bark]\nside = 64\n[wind]\nspeed = 6\n";
    std::fs::write(&grammar, rules).expect("grammar");
    std::fs::write(&scene, text).expect("scene");
    let (json, _) = ends(0, &["check", arg(&scene), "--json"]);
    let found: Value = serde_json::from_str(&json).expect("JSON");
    let bytes = |row: &Value, of: &str| -> String {
        let [from, to] = [0, 1].map(|i| usize::try_from(row["span"][i].as_u64().expect("a byte")).expect("a byte"));
        of[from..to].to_owned()
    };
    let row = |list: &str, key: &str| {
        let rows = found[0][list].as_array().expect("rows");
        rows.iter().find(|row| row["key"] == key).cloned().unwrap_or_else(|| panic!("{key} is missing: {rows:?}"))
    };
    let speed = row("keys", "wind.speed");
    assert_eq!((&speed["value"], bytes(&speed, text).as_str()), (&6.into(), "6"));
    let height = row("keys", "plants.a.set.HEIGHT");
    assert_eq!((&height["value"], bytes(&height, text).as_str()), (&4.into(), "4"));
    let crook = row("knobs", "plants.a.set.CROOK");
    let shown = (&crook["min"], &crook["max"], &crook["unit"], &crook["about"]);
    assert_eq!(shown, (&0.0.into(), &40.0.into(), &"deg".into(), &"how crooked it is".into()));
    assert_eq!((&crook["number"], bytes(&crook, rules).as_str()), (&9.0.into(), "9"));
    assert!(crook["file"].as_str().is_some_and(|file| file.ends_with("g.l")), "{crook}");
    // The range follows the grammar, the value the scene.
    let height = row("knobs", "plants.a.set.HEIGHT");
    assert_eq!((&height["number"], &height["max"], bytes(&height, rules).as_str()), (&4.0.into(), &5.0.into(), "2.5"));
    let half = row("knobs", "plants.a.set.HALF");
    assert!(half["number"].is_null() && half["max"].is_null() && bytes(&half, rules) == "(HEIGHT/2)", "{half}");
}

#[test]
fn presets_say_what_they_are_and_show() {
    let (json, _) = ends(0, &["list", "presets", "--json"]);
    let rows: Vec<Value> = serde_json::from_str(&json).expect("JSON");
    assert_eq!(rows.len(), osier::presets::PRESETS.len());
    let row = |name: &str| rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("{name}"));
    for (name, kind) in [
        ("oak.toml", "species"),
        ("oak.l", "grammar"),
        ("showcase.toml", "scene"),
        ("sun.ifs", "ifs_table"),
        ("young-tree.obj", "mesh"),
    ] {
        assert_eq!(row(name)["kind"], kind, "{name}");
    }
    assert!(rows.iter().all(|row| row["frames"].is_u64() && row["thumbnail"].is_null()), "{rows:?}");
    let meadow = row("meadow.toml");
    assert_eq!((&meadow["frames"], &meadow["plants"]), (&120.into(), &serde_json::json!(["grass"])));
    // Rods move in calm air, too.
    assert_eq!((&row("pole.toml")["frames"], &row("oak.toml")["frames"]), (&72.into(), &1.into()));
    assert!(["wind", "copies"].iter().all(|w| meadow["shows"].as_array().is_some_and(|s| s.contains(&(*w).into()))));
    ends(2, &["list", "codes", "--thumbnails", "x"]);
    // Codes by name or by their letter, in either case.
    let (one, _) = ends(0, &["list", "codes", "X003"]);
    assert!(one.starts_with("X003  ") && one.lines().count() == 1, "{one}");
    let (letter, _) = ends(0, &["list", "codes", "x"]);
    assert!(letter.lines().count() > 10 && letter.lines().all(|line| line.starts_with('X')), "{letter}");
    assert!(ends(2, &["list", "codes", "X999"]).1.contains("no code begins with \"X999\""));
    assert!(ends(2, &["list", "limits", "x"]).1.contains("take no words"));
}

#[test]
fn words_choose_presets_and_species() {
    let rows = |words: &[&str]| {
        let (json, _) = ends(0, &[&["list", "--json"][..], words].concat());
        let rows: Vec<Value> = serde_json::from_str(&json).expect("JSON");
        rows.iter().map(|row| row["name"].as_str().expect("a name").to_owned()).collect::<Vec<_>>()
    };
    let ferns = rows(&["presets", "FERN", "frond"]);
    assert!(["fern.l", "fern.toml", "fern_frond.ifs.toml"].iter().all(|n| ferns.iter().any(|f| f == n)), "{ferns:?}");
    assert!(!ferns.iter().any(|name| name == "maidenhair.l"), "{ferns:?}");
    assert_eq!(rows(&["species", "umbrella", "BOLE"]), ["pine"]);
    let (text, _) = ends(0, &["list", "presets", "gosper"]);
    assert_eq!(text.lines().filter(|line| line.starts_with("  gosper.")).count(), 2, "{text}");
    for what in ["presets", "species"] {
        assert!(ends(2, &["list", what, "xyzzy"]).1.contains("in its name or description"));
    }
}

#[test]
fn keys_are_found_by_the_path_that_set_takes() {
    let (text, _) = ends(0, &["list", "options", "wind.speed"]);
    assert!(text.contains("\n[wind]  ") && text.contains("\n  speed              Mean speed"), "{text}");
    // With names and numbers of a scene, as messages spell it.
    for (path, table, key) in [
        ("plants.oak.leaf.size", "plants.NAME.organs.LETTER", "size"),
        ("plants.oak.organs.l.size", "plants.NAME.organs.LETTER", "size"),
        ("plants.oak.turtle.angle_deg", "plants.NAME.turtle", "angle_deg"),
        ("solid.0.size.1", "solid", "size"),
    ] {
        let (json, _) = ends(0, &["list", "options", path, "--json"]);
        let rows: Vec<Value> = serde_json::from_str(&json).expect("JSON");
        assert!(rows.len() == 1 && rows[0]["table"] == table && rows[0]["key"] == key, "{path}: {json}");
    }
    ends(2, &["list", "options", "plants.oak.leaf.sizes"]);
}

#[test]
fn a_source_without_parameters_is_told() {
    for source in ["beech.species", "fern_leaf.ifs", "tree.shapes"] {
        let (out, err) = ends(0, &["list", "knobs", source]);
        assert!(out.is_empty() && err.contains(&format!("\"{source}\" has no grammar with a #define")), "{out}{err}");
    }
    assert!(ends(0, &["list", "knobs", "oak"]).1.is_empty());
}

#[test]
fn species_are_shown_by_scenes_of_their_own() {
    let (json, _) = ends(0, &["list", "species", "--json"]);
    let rows: Vec<Value> = serde_json::from_str(&json).expect("JSON");
    let of =
        |name: &str| rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("{name}"))["scene"].clone();
    // Presets oak and birch are of grammars; the preset landscape has an oak among five other plants.
    assert_eq!([of("oak"), of("birch"), of("beech")], ["oak-grown", "birch-grown", "beech"]);
    assert!(rows.iter().all(|row| row["scene"].is_string()), "{rows:?}");
}
