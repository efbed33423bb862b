//! Where rain falls: a leaf catches the same share of it whatever the wind, and wherever the land lies.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "tests run the program and read its files"
)]
#![allow(clippy::cast_possible_truncation, reason = "small whole numbers")]

use crate::common::program;
use std::fs;
use std::path::Path;

use crate::common::program::{arg, ends};
use crate::common::track_records::{records, word_number};

/// Frames per second, seconds of rain that count, and drops that level leaves are meant to catch in that time: enough for a
/// statistical error of 2 %.
const FPS: u32 = 8;
const SECONDS: u32 = 3;
const DROPS: f64 = 2500.0;
/// Side of each of the leaves, their number, their distance and their height, m.
const SIDE: f64 = 0.15;
const LEAVES: u32 = 40;
const SPACING: f64 = 0.2;
const HEIGHT: f64 = 0.5;
/// Area of all leaves, m^2.
const AREA: f64 = SIDE * SIDE * LEAVES as f64;

/// A row of square leaves across the wind, in rain of one size.
#[derive(Clone, Copy)]
struct LeavesInRain<'a> {
    /// Angle of the leaves from upright, degrees.
    turn: f64,
    /// Diameter of the drops, mm.
    size: f64,
    /// Height of the ground, m.
    ground: f64,
    /// `motion` of the plant: whether the wind moves it.
    motion: &'a str,
    /// Tables of the scene beside those of plant and rain.
    more: &'a str,
}

impl LeavesInRain<'_> {
    /// Rainfall of which level leaves catch [`DROPS`] drops, m/s.
    fn rate(&self) -> f64 {
        DROPS * std::f64::consts::PI / 6.0 * (self.size * 1e-3).powi(3) / (AREA * f64::from(SECONDS))
    }

    /// The text of the scene; its grammar and mesh are written beside it.
    fn scene(&self, dir: &Path, name: &str) -> String {
        let place = |k: u32| {
            let z = SPACING * (f64::from(k) - 0.5 * f64::from(LEAVES - 1));
            format!("[/(90) +(90) f({z:.3}) -(90) /(-90) &({}) ~l(1)]", self.turn)
        };
        let row: String = (0..LEAVES).map(place).collect();
        let grammar = format!("Lsystem: leaf\nDerivation length: 0\nAxiom: !(0.04) F({HEIGHT}) {row}\nendlsystem\n");
        fs::write(dir.join(format!("{name}.l")), grammar).expect("grammar");
        let mesh = "v -0.5 0 0\nv 0.5 0 0\nv 0.5 1 0\nv -0.5 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
            f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
        fs::write(dir.join("leaf.obj"), mesh).expect("mesh");
        let (end, rate) = (FPS * SECONDS + 1, self.rate() * 3.6e6);
        let Self { size, motion, more, .. } = self;
        format!(
            "seed = 4\n[frames]\nend = {end}\nfps = {FPS}\n[plants.p]\ngrammar = \"{name}.l\"\nmotion = \"{motion}\"\n[plants.p.leaf]\n\
             mesh = \"leaf.obj\"\nsize = {SIDE}\n[[place]]\nplant = \"p\"\n[maps]\nmax_mapped_leaves = 0\n\
             [output]\nformats = [\"tracks\", \"csv\"]\n[rain]\nrate_mm_per_h = {rate}\nspin_up_s = 2\njitter = 0\n\
             substeps = 24\nsize_distribution = \"fixed\"\nsize_mm = {size}\n{more}"
        )
    }

    /// Bakes the scene and measures what its leaves catch.
    fn bake(&self, dir: &Path, name: &str) -> Caught {
        let (file, out) = (dir.join(format!("{name}.toml")), dir.join(name));
        fs::write(&file, self.scene(dir, name)).expect("scene");
        ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
        // Normals of the leaves in every frame.
        let leaves = records(&out, "leaves.bin", &["qx", "qy", "qz", "qw"]);
        let normals: Vec<glam::DVec3> = leaves
            .iter()
            .map(|(_, q)| glam::DQuat::from_xyzw(q[0], q[1], q[2], q[3]).normalize() * glam::DVec3::Z)
            .collect();
        // The mean path: drops in the air just above the leaves, over all frames.
        let airborne = word_number(&out, "states", "falls");
        let drops = records(&out, "drops.bin", &["state", "y", "vx", "vy", "vz"]);
        let near = |d: &&(u64, Vec<f64>)| {
            (d.1[0] - airborne).abs() < 0.5 && (d.1[1] - self.ground - HEIGHT - SIDE - 0.15).abs() < 0.15
        };
        let velocity =
            drops.iter().filter(near).fold(glam::DVec3::ZERO, |sum, d| sum + glam::DVec3::new(d.1[2], d.1[3], d.1[4]));
        let path = velocity / -velocity.y;
        let struck = word_number(&out, "events", "struck");
        let events = records(&out, "events.bin", &["what", "volume"]);
        let hits: Vec<f64> =
            events.iter().filter(|(frame, e)| *frame > 1 && (e[0] - struck).abs() < 0.5).map(|(_, e)| e[1]).collect();
        let area = normals.iter().map(|n| n.dot(path).abs()).sum::<f64>() / normals.len() as f64 * AREA;
        let meant = self.rate() * f64::from(SECONDS) * area;
        let caught = Caught { ratio: hits.iter().sum::<f64>() / meant, drops: hits.len(), normal: normals[0], path };
        println!("{name}: {caught:.3?}");
        caught
    }
}

/// What the leaves caught.
#[derive(Debug)]
struct Caught {
    /// Water that struck them after the first frame over rainfall times their area projected along the mean path.
    ratio: f64,
    /// Number of these drops.
    drops: usize,
    /// Normal of the first leaf.
    normal: glam::DVec3,
    /// Mean velocity of the drops above the leaves, over that of their fall.
    path: glam::DVec3,
}

const WINDS: [(&str, &str); 8] = [
    ("calm", "[wind]\nmodel = \"calm\"\n"),
    ("uniform", "[wind]\nmodel = \"uniform\"\nspeed = 4.5\n"),
    ("gust1", "[wind]\nspeed = 1\n"),
    ("gust2", "[wind]\nspeed = 2\n"),
    ("gust4", "[wind]\nspeed = 4.5\n"),
    ("gust8", "[wind]\nspeed = 8\n"),
    ("gust12", "[wind]\nspeed = 12\n"),
    ("lattice", "[wind]\nmodel = \"lattice\"\nspeed = 6\n[wind.lattice]\ncells = [32, 16, 24]\ndx = 0.5\n"),
];
const SIZES: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// Catches of leaves in all winds, of drops of all sizes: each the rainfall times its area along the mean path.
fn catches_what_falls(turn: f64) {
    let dir = tempfile::tempdir().expect("dir");
    let mut wrong = Vec::new();
    for (wind, more) in WINDS {
        for size in SIZES {
            let name = format!("{wind}_{size}");
            let caught = LeavesInRain { turn, size, ground: 0.0, motion: "still", more }.bake(dir.path(), &name);
            assert!(caught.drops > 1100, "{name}: too few drops for an error below 3 %");
            if (caught.ratio - 1.0).abs() > 0.1 {
                wrong.push(format!("{name}: {caught:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[ignore = "minutes of simulation; tests/full.sh runs it"]
fn level_leaves_catch_the_same_rain_in_any_wind() {
    catches_what_falls(90.0);
}

/// Slanting rain meets steep leaves by its flux through their area.
#[test]
#[ignore = "minutes of simulation; tests/full.sh runs it"]
fn steep_leaves_catch_what_slanting_rain_brings() {
    catches_what_falls(130.0);
}

/// In uniform wind the mean path is known: that of a drop at terminal speed.
#[test]
#[ignore = "minutes of simulation; tests/full.sh runs it"]
fn rain_slants_by_wind_over_terminal_speed() {
    let dir = tempfile::tempdir().expect("dir");
    let speed = 9.65 - 10.3 * (-0.6_f64).exp();
    for turn in [40.0, 65.0] {
        let leaf = LeavesInRain { turn, size: 1.0, ground: 0.0, motion: "still", more: WINDS[1].1 };
        let caught = leaf.bake(dir.path(), &format!("slant{turn}"));
        assert!((caught.path.x - 4.5 / speed).abs() < 0.01 && caught.path.z.abs() < 0.01, "{caught:?}");
        assert!((caught.ratio - 1.0).abs() < 0.1, "{caught:?}");
    }
}

/// Leaves that sway catch by the area that they turn to the rain at each moment.
#[test]
fn leaves_that_sway_catch_what_their_area_meets() {
    let dir = tempfile::tempdir().expect("dir");
    for (name, more) in [WINDS[0], WINDS[4]] {
        let still = LeavesInRain { turn: 90.0, size: 2.0, ground: 0.0, motion: "still", more };
        let swaying = LeavesInRain { motion: "skin", ..still }.bake(dir.path(), &format!("{name}_sway"));
        assert!((swaying.ratio - 1.0).abs() < 0.1, "{name}: {swaying:?}");
    }
}

/// Plants on flat land of any height, and on wavy ground, catch the same; other drops end on the surface of the land.
#[test]
#[ignore = "minutes of simulation; tests/full.sh runs it"]
fn rain_falls_on_land_of_any_height() {
    let dir = tempfile::tempdir().expect("dir");
    let flat = |y: i32| format!("[terrain]\nsize = 60\namplitude = 0\ncorners = [{y}, {y}, {y}, {y}]\n");
    let wavy = "[ground]\nrelief = 0.2\nwavelength = 5\n".to_owned();
    let lands = [("low", -20.0, flat(-20)), ("level", 0.0, flat(0)), ("high", 20.0, flat(20)), ("wavy", 0.0, wavy)];
    for (name, ground, land) in lands {
        let caught =
            LeavesInRain { turn: 90.0, size: 1.0, ground, motion: "still", more: &land }.bake(dir.path(), name);
        assert!(caught.normal.y.abs() > 0.999 && (caught.ratio - 1.0).abs() < 0.1, "{name}: {caught:?}");
        let out = dir.path().join(name);
        let end = word_number(&out, "events", "ground");
        let events = records(&out, "events.bin", &["what", "y"]);
        let ends: Vec<f64> = events.iter().filter(|e| (e.1[0] - end).abs() < 0.5).map(|e| e.1[1]).collect();
        // The waves of the ground are at most 0.4 m high, below the leaves.
        let most = if name == "wavy" { 0.4 } else { 1e-3 };
        assert!(ends.len() > 200 && ends.iter().all(|y| (y - ground).abs() < most), "{name}");
    }
}

/// Walls and roofs: what stands in the rain's way, from above or from the side, and what it stands before.
#[test]
fn solids_shelter_what_is_below_and_behind() {
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("sheet.obj"), "v -1.5 0 -6\nv 1.5 0 -6\nv 1.5 0 6\nv -1.5 0 6\nf 1 2 3\nf 1 3 4\n")
        .expect("mesh");
    let calm = WINDS[0].1;
    let roofs = [
        ("roof", "[[solid]]\nat = [0, 3, 0]\nsize = [4, 0.05, 12]\n"),
        ("low_roof", "[[solid]]\nat = [0, 0.7, 0]\nsize = [4, 0.05, 12]\n"),
        ("house", "[[solid]]\nshape = \"house\"\nat = [0, 0, 0]\nsize = [5, 3, 12]\n"),
        ("sheet", "[[solid]]\nshape = \"mesh\"\nmesh = \"sheet.obj\"\nat = [0, 2.2, 0]\n"),
    ];
    for (name, roof) in roofs {
        let caught =
            LeavesInRain { turn: 90.0, size: 1.0, ground: 0.0, motion: "still", more: &format!("{calm}{roof}") }
                .bake(dir.path(), name);
        assert_eq!(caught.drops, 0, "{name}");
        let out = dir.path().join(name);
        // Nothing ends on the ground below it either.
        let ground = word_number(&out, "events", "ground");
        let events = records(&out, "events.bin", &["what", "x", "z"]);
        let below = |e: &&(u64, Vec<f64>)| (e.1[0] - ground).abs() < 0.5 && e.1[1].abs() < 1.4 && e.1[2].abs() < 5.9;
        assert_eq!(events.iter().filter(below).count(), 0, "{name}");
    }
    // A wall upwind of the leaf, and the same one downwind.
    for (x, most) in [(-0.9, 0.0), (1.9, 1.1)] {
        let wall = format!("{}[[solid]]\nat = [{x}, 0, 0]\nsize = [0.1, 4, 12]\n", WINDS[1].1);
        let caught = LeavesInRain { turn: 90.0, size: 1.0, ground: 0.0, motion: "still", more: &wall }
            .bake(dir.path(), &format!("wall{x}"));
        assert!(caught.ratio <= most && caught.ratio > most - 0.2, "{x}: {caught:?}");
    }
}

/// Water on solids has an account of its own: a table below the leaf takes what the leaf does not.
#[test]
fn water_that_ends_on_solids_is_booked() {
    let dir = tempfile::tempdir().expect("dir");
    let table = "[wind]\nmodel = \"calm\"\n[[solid]]\nat = [0, 0, 0]\nsize = [12, 0.3, 16]\n";
    LeavesInRain { turn: 140.0, size: 2.0, ground: 0.0, motion: "still", more: table }.bake(dir.path(), "table");
    let out = dir.path().join("table");
    let text = fs::read_to_string(out.join("stats/rain.csv")).expect("table");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("names").split(',').collect();
    let last: Vec<f64> = lines.last().expect("rows").split(',').map(|v| v.parse().expect("a number")).collect();
    let of = |name: &str| last[names.iter().position(|n| n.starts_with(name)).expect("a column")];
    let parts = ["water_air", "water_leaves", "water_hanging", "water_ground", "water_wood", "water_solids"];
    let sum: f64 = parts.iter().map(|name| of(name)).sum();
    assert!((sum / of("rained") - 1.0).abs() < 1e-6, "{sum} of {}", of("rained"));
    assert!(of("water_ground").abs() < 1e-12 && of("water_solids") > 100.0, "{text}");
    let solid = word_number(&out, "events", "solid");
    let events = records(&out, "events.bin", &["what", "y"]);
    let on_top = events.iter().filter(|(_, e)| (e[0] - solid).abs() < 0.5 && (e[1] - 0.3).abs() < 2e-3).count();
    assert!(on_top > 100, "{on_top}");
}

/// A drop of `[[rain.lying]]` is there when the clip begins, however long it has rained before; and what lies on no leaf is
/// refused by the name of its key.
#[test]
fn lying_drops_are_there_when_the_clip_begins() {
    let dir = tempfile::tempdir().expect("dir");
    let lying = "falls = false\n[[rain.lying]]\nvolume_mm3 = 60\nat = [0.5, 0.95]\n";
    let text =
        LeavesInRain { turn: 150.0, size: 1.0, ground: 0.0, motion: "still", more: lying }.scene(dir.path(), "steep");
    let (file, out) = (dir.path().join("lying.toml"), dir.path().join("lying"));
    fs::write(&file, &text).expect("scene");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "--frames", "1"]);
    let drops = records(&out, "drops.bin", &["volume"]);
    let water: f64 = drops.iter().map(|d| d.1[0]).sum();
    assert!((water * 1e9 - 60.0).abs() < 1e-3, "{drops:?}");
    for (from, to, key) in [
        ("volume_mm3 = 60", "leaf = 99", "rain.lying.0.leaf is 99"),
        ("mesh = \"leaf.obj\"", "blade = \"elliptic\"", "rain.lying.0.at is [0.02"),
    ] {
        fs::write(&file, text.replace(from, to).replace("[0.5, 0.95]", "[0.02, 0.02]")).expect("scene");
        let (code, _, said) = program::said(&program::run(&["-q", "bake", arg(&file), "-o", arg(&out)]));
        assert_ne!(code, 0);
        assert!(said.contains(key), "{said}");
    }
}
