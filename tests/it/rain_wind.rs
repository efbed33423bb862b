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

use serde_json::Value;

use crate::common::program::{arg, ends};

/// Strength of the rain, mm/h; length of a clip, frames at 24 a second; side of the leaf, m.
const RATE: f64 = 60.0;
const FRAMES: u32 = 25;
const SIDE: f64 = 0.3;

/// One square leaf at the end of a stem of half a metre, turned by an angle from upright.
fn scene(dir: &Path, (name, turn): (&str, f64), more: &str) -> String {
    let grammar = format!("Lsystem: leaf\nDerivation length: 0\nAxiom: !(0.002) F(0.5) &({turn}) ~l(1)\nendlsystem\n");
    fs::write(dir.join(format!("{name}.l")), grammar).expect("grammar");
    let mesh = "v -0.5 0 0\nv 0.5 0 0\nv 0.5 1 0\nv -0.5 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
        f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    fs::write(dir.join("leaf.obj"), mesh).expect("mesh");
    format!(
        "seed = 4\n[frames]\nend = {FRAMES}\nfps = 24\n[plants.p]\ngrammar = \"{name}.l\"\n[plants.p.leaf]\n\
         mesh = \"leaf.obj\"\nsize = {SIDE}\n[[place]]\nplant = \"p\"\n[maps]\nmax_mapped_leaves = 0\n\
         [output]\nformats = [\"tracks\", \"csv\"]\n[rain]\nrate_mm_per_h = {RATE}\nspin_up_s = 1\njitter = 0\nsubsteps = 4\n{more}"
    )
}

/// Numbers of all records of a file of tracks: frame, and the fields that are asked for.
fn records(out: &Path, name: &str, wanted: &[&str]) -> Vec<(u64, Vec<f64>)> {
    let index: Value = serde_json::from_slice(&fs::read(out.join("tracks/index.json")).expect("index")).expect("json");
    let file = index["files"].as_array().expect("files").iter().find(|f| f["file"] == name).expect("the file");
    let bytes = fs::read(out.join("tracks").join(name)).expect("records");
    let count = |v: &Value| usize::try_from(v.as_u64().expect("a number")).expect("small");
    let size = count(&file["record_bytes"]);
    let fields = file["fields"].as_array().expect("fields");
    let of = |record: &[u8], name: &str| {
        let field = fields.iter().find(|f| f["name"] == name).expect("a field");
        let at = count(&field["offset"]);
        let four = || <[u8; 4]>::try_from(&record[at..at + 4]).expect("four bytes");
        match field["type"].as_str().expect("a type") {
            "u4" => f64::from(u32::from_le_bytes(four())),
            "i4" => f64::from(i32::from_le_bytes(four())),
            "f4" => f64::from(f32::from_le_bytes(four())),
            _ => f64::from_le_bytes(record[at..at + 8].try_into().expect("eight bytes")),
        }
    };
    let mut all = Vec::new();
    for frame in file["frames"].as_array().expect("frames") {
        let (first, many) = (count(&frame[1]), count(&frame[2]));
        for record in bytes[first * size..(first + many) * size].chunks(size) {
            all.push((frame[0].as_u64().expect("a frame"), wanted.iter().map(|n| of(record, n)).collect()));
        }
    }
    all
}

/// Water that struck the leaf after the first frame, over what rain of a slope (its way along x and z over its way down)
/// brings to the leaf's area; and how level the leaf is.
fn caught(dir: &Path, name: &str, turn: f64, slope: [f64; 2], more: &str) -> (f64, f64) {
    let (file, out) = (dir.join(format!("{name}.toml")), dir.join(name));
    fs::write(&file, scene(dir, (name, turn), more)).expect("scene");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
    let index: Value = serde_json::from_slice(&fs::read(out.join("tracks/index.json")).expect("index")).expect("json");
    let struck = index["events"].as_array().expect("events").iter().position(|e| e == "struck").expect("struck") as f64;
    let events = records(&out, "events.bin", &["what", "volume"]);
    let water: f64 =
        events.iter().filter(|(frame, e)| *frame > 1 && (e[0] - struck).abs() < 0.5).map(|(_, e)| e[1]).sum();
    let leaf = &records(&out, "leaves.bin", &["qx", "qy", "qz", "qw"])[0].1;
    let q = glam::DQuat::from_xyzw(leaf[0], leaf[1], leaf[2], leaf[3]).normalize();
    let normal = q * glam::DVec3::Z;
    let way = glam::DVec3::new(slope[0], -1.0, slope[1]);
    let seconds = f64::from(FRAMES - 1) / 24.0;
    let meant = RATE / 3.6e6 * seconds * SIDE * SIDE * normal.dot(way).abs();
    let ratio = water / meant;
    println!("{name}: {ratio:.3} of {:.1} mm3, normal {normal:.3}", meant * 1e9);
    (ratio, normal.y.abs())
}

const WINDS: [(&str, &str); 5] = [
    ("calm", "[wind]\nmodel = \"calm\"\n"),
    ("uniform", "[wind]\nmodel = \"uniform\"\nspeed = 4.5\n"),
    ("gust1", "[wind]\nspeed = 1\n"),
    ("gust4", "[wind]\nspeed = 4.5\n"),
    ("gust8", "[wind]\nspeed = 8\n"),
];

#[test]
fn a_level_leaf_catches_the_same_rain_in_any_wind() {
    let dir = tempfile::tempdir().expect("dir");
    for (name, wind) in WINDS {
        let keys = format!("size_distribution = \"fixed\"\nsize_mm = 1\n{wind}");
        let (ratio, level) = caught(dir.path(), name, 90.0, [0.0; 2], &keys);
        assert!(level > 0.999 && (ratio - 1.0).abs() < 0.1, "{name}: {ratio}");
    }
}

/// Slanting rain meets a steep leaf by its flux through the leaf's area.
#[test]
fn a_steep_leaf_catches_what_slanting_rain_brings() {
    let dir = tempfile::tempdir().expect("dir");
    let size = "size_distribution = \"fixed\"\nsize_mm = 1\n";
    let speed = 9.65 - 10.3 * (-0.6_f64).exp();
    for (name, wind, across) in [("calm", WINDS[0].1, 0.0), ("uniform", WINDS[1].1, 4.5)] {
        for turn in [40.0, 65.0, 130.0] {
            let name = format!("{name}_{turn}");
            let (ratio, _) = caught(dir.path(), &name, turn, [across / speed, 0.0], &format!("{size}{wind}"));
            assert!((ratio - 1.0).abs() < 0.1, "{name}: {ratio}");
        }
    }
}

#[test]
fn rain_falls_on_land_of_any_height() {
    let dir = tempfile::tempdir().expect("dir");
    for y in [-20, 0, 20] {
        let land = format!(
            "size_distribution = \"fixed\"\nsize_mm = 1\n[terrain]\nsize = 60\namplitude = 0\ncorners = [{y}, {y}, {y}, {y}]\n"
        );
        let (ratio, _) = caught(dir.path(), &format!("land{y}"), 90.0, [0.0; 2], &land);
        assert!((ratio - 1.0).abs() < 0.1, "{y} m: {ratio}");
    }
}

/// A drop of `[[rain.lying]]` is there when the clip begins, however long it has rained before; and what lies on no leaf is
/// refused by the name of its key.
#[test]
fn lying_drops_are_there_when_the_clip_begins() {
    let dir = tempfile::tempdir().expect("dir");
    let lying = "falls = false\n[[rain.lying]]\nvolume_mm3 = 60\nat = [0.5, 0.95]\n";
    let text = scene(dir.path(), ("steep", 150.0), lying).replace("spin_up_s = 1", "spin_up_s = 3");
    let (file, out) = (dir.path().join("lying.toml"), dir.path().join("lying"));
    fs::write(&file, &text).expect("scene");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out), "--frames", "1"]);
    let drops = records(&out, "drops.bin", &["volume"]);
    let water: f64 = drops.iter().map(|d| d.1[0]).sum();
    assert!((water * 1e9 - 60.0).abs() < 1e-3, "{drops:?}");
    for (from, to, key) in [
        ("volume_mm3 = 60", "leaf = 99", "rain.lying.0.leaf is 99"),
        ("mesh = \"leaf.obj\"", "mesh = \"bare.obj\"", "rain.lying.0.leaf is 0"),
        ("mesh = \"leaf.obj\"", "blade = \"elliptic\"", "rain.lying.0.at is [0.02"),
    ] {
        fs::write(dir.path().join("bare.obj"), "v -0.5 0 0\nv 0.5 0 0\nv 0.5 1 0\nf 1 2 3\n").expect("mesh");
        fs::write(&file, text.replace(from, to).replace("[0.5, 0.95]", "[0.02, 0.02]")).expect("scene");
        let (code, _, said) = program::said(&program::run(&["-q", "bake", arg(&file), "-o", arg(&out)]));
        assert_ne!(code, 0);
        assert!(said.contains(key), "{said}");
    }
}
