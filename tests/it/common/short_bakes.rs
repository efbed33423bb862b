//! Presets that are baked short: what tests of every preset have in common.
#![allow(dead_code, reason = "each test file uses its own share")]

use osier::presets::{PRESETS, Preset};

/// Last frame of a bake: the first that differs from rest, and two that follow it.
const FRAMES: u32 = 4;

/// Scenes whose trees keep their ages: a broadleaf, a conifer and the scene that holds most.
const KEEP_AGES: [&str; 3] = ["apple.toml", "spruce.toml", "showcase.toml"];
/// Years that the trees of the other scenes grow at most.
const YEARS: u32 = 12;

/// Whether a preset is a picture of layers without plants.
pub fn is_picture(preset: &Preset) -> bool {
    preset.text.contains("[[layer]]") && !preset.text.contains("[plants.")
}

/// Whether a preset is a scene that is baked.
pub fn is_scene(preset: &Preset) -> bool {
    preset.name.ends_with(".toml") && !preset.name.ends_with(".ifs.toml") && !is_picture(preset)
}

/// Whether a preset has a clip whose length can be set.
fn is_moving(preset: &str) -> bool {
    PRESETS.iter().any(|p| p.name == preset && p.text.contains("[frames]"))
}

/// Whether a preset is a scene of a tree that grows year by year.
pub fn is_grown(preset: &str) -> bool {
    PRESETS.iter().any(|p| p.name == preset && p.text.contains("\nspecies = "))
}

/// Overrides that shorten what takes most of the time and says no more when it is longer: the clip, the years of trees, which are grown
/// and written in the same way at any age, and spin-ups.
pub fn shortened(preset: &str) -> Vec<String> {
    let Some(text) = PRESETS.iter().find(|p| p.name == preset).map(|p| p.text) else { return Vec::new() };
    let mut keys = Vec::new();
    keys.extend(is_moving(preset).then(|| format!("frames.end={FRAMES}")));
    let tables = text.split("\n[").filter_map(|table| table.strip_prefix("plants.")?.split_once(']'));
    for (name, table) in tables.filter(|_| !KEEP_AGES.contains(&preset)) {
        let age = table.lines().find_map(|l| l.strip_prefix("age = ")?.parse::<u32>().ok());
        if table.contains("\nspecies = ") && age.is_none_or(|age| age > YEARS) {
            keys.push(format!("plants.{name}.age={YEARS}"));
        }
    }
    for (table, key) in [("\n[rain]", "rain.spin_up_s=0.5"), ("\n[flight]", "flight.spin_up_s=2")] {
        keys.extend(text.contains(table).then(|| key.to_owned()));
    }
    keys
}
