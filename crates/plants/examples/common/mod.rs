//! Species tables as the examples read them.
#![allow(
    dead_code,
    clippy::disallowed_methods,
    clippy::expect_used,
    reason = "tools for people, each of which uses a part"
)]

use std::path::{Path, PathBuf};

use glam::Vec3;
use osier_plants::grow::years::{Habit, Neighbours, TreeSpec};

/// The folder of the tables.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../species")
}

/// Names of all tables, sorted.
pub fn names() -> Vec<String> {
    let entries = std::fs::read_dir(folder()).expect("the folder species");
    let name = |e: std::io::Result<std::fs::DirEntry>| {
        let path = e.expect("an entry").path();
        path.file_stem().expect("a name").to_string_lossy().into_owned()
    };
    let mut names: Vec<String> = entries.map(name).collect();
    names.sort();
    names
}

fn number(value: &toml::Value) -> f64 {
    value.as_float().or_else(|| value.as_integer().map(|i| i as f64)).expect("a number")
}

/// A tree of a table at its age.
#[allow(clippy::cast_possible_truncation, reason = "radii and years fit")]
pub fn spec(name: &str, seed: u64) -> TreeSpec {
    let text = std::fs::read_to_string(folder().join(format!("{name}.species"))).expect("a table");
    let table: toml::Table = text.parse().expect("TOML");
    let mut habit = Habit::default();
    let mut neighbours = None;
    for (key, value) in &table {
        match value {
            toml::Value::Table(ring) => {
                let of = |key: &str| ring.get(key).map_or(0.0, number) as f32;
                neighbours = Some(Neighbours { radius: of("radius"), density: of("density"), until: of("until") });
            }
            toml::Value::Array(list) => {
                let values: Vec<f64> = list.iter().map(number).collect();
                habit.set(key, &values).expect("a key of the habit");
            }
            one => habit.set(key, &[number(one)]).expect("a key of the habit"),
        }
    }
    let age = f64::from(habit.age);
    TreeSpec { name: name.to_owned(), habit, seed, id: 0, base: Vec3::ZERO, age, neighbours, prunes: Vec::new() }
}
