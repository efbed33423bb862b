//! Species tables as the examples read them, checksums of what grows, and the time of a processor.
#![allow(
    dead_code,
    clippy::disallowed_methods,
    clippy::expect_used,
    reason = "tools for people, each of which uses a part"
)]

use std::fmt::{Debug, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::Vec3;
use osier_plants::grow::years::{Habit, Neighbours, TreeSpec};

/// FNV-1a of the texts that are written to it.
pub struct Checksum(pub u64);

impl Checksum {
    pub fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    /// Adds a value with all its numbers, printed so that equal texts mean equal bits.
    pub fn add(&mut self, value: &impl Debug) {
        write!(self, "{value:?}").expect("a checksum takes any text");
    }
}

impl std::fmt::Write for Checksum {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        for byte in text.bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
        Ok(())
    }
}

/// Time that a run kept this thread on a processor, so that others on the machine do not count; where the system does not
/// say, time on the clock.
pub fn on_processor(run: impl FnOnce()) -> Duration {
    let spent = || {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    let clock = Instant::now();
    let before = spent();
    run();
    before.and_then(|before| spent()?.checked_sub(before)).unwrap_or_else(|| clock.elapsed())
}

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
