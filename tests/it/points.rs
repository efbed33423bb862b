//! Points as CSV: every field as Blender's node Import CSV reads it, the numbers of tracks and tables, and what the node makes of it.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]
#![allow(clippy::float_cmp, reason = "small whole numbers")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::Value;

use crate::common::clients;
use crate::common::program::{arg, assert_same, ends, tree};
use crate::common::track_records::records;

/// A twig on rods in the rain, with catkins in the air.
const SCENE: &str = "seed = 4\n[frames]\nend = 18\nfps = 60\n[plants.twig]\ngrammar = \"rain-twig.l\"\nset = { LEAVES = 3 }\n\
    [plants.twig.leaf]\nblade = \"elliptic\"\nside = 32\n[plants.twig.rods]\n[[place]]\nplant = \"twig\"\n\
    [ground]\nshow = false\n[maps]\nresolution = 32\n[rain]\nrate_mm_per_h = 200\nspin_up_s = 2\nsubsteps = 8\n\
    [wind]\nspeed = 2\n[catkin]\nlod = 3\nhairs = 12\n[flight]\ncount = 60\nspin_up_s = 5\nsize = [8, 3, 8]\n";
const FRAMES: std::ops::RangeInclusive<u32> = 7..=18;

/// Columns of each table: those of whole numbers, then those of floats.
const TABLES: [(&str, &str, &str); 3] = [
    ("drops", "id,state,leaf", "x,y,z,vx,vy,vz,radius,volume_mm3,wetness"),
    ("catkins", "id,state,proto", "x,y,z,vx,vy,vz,qw,qx,qy,qz,scale"),
    ("joints", "id,plant,joint,parent", "x,y,z,qw,qx,qy,qz,radius"),
];

fn bake(folder: &Path, more: &[&str]) -> PathBuf {
    let (scene, out) = (folder.join("wet.toml"), folder.join("out"));
    fs::write(&scene, SCENE).expect("scene");
    let formats = ["--formats", "csv,tracks,points", "--frames", "7-18"];
    ends(0, &[&["-q", "bake", arg(&scene), "-o", arg(&out)], &formats[..], more].concat());
    out
}

/// A bake of frames 7 to 18 in Blender's axes.
fn baked() -> &'static Path {
    static DONE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &DONE
        .get_or_init(|| {
            let dir = tempfile::tempdir().expect("dir");
            let out = bake(dir.path(), &[]);
            (dir, out)
        })
        .1
}

/// Rows of a table at a frame, by the names of the columns.
fn rows(out: &Path, table: &str, frame: u32) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(out.join(format!("points/{table}_{frame:04}.csv"))).expect("a file of every frame");
    let names: Vec<String> = text.lines().next().expect("a header").split(',').map(str::to_owned).collect();
    text.lines().skip(1).map(|line| names.iter().cloned().zip(line.split(',').map(str::to_owned)).collect()).collect()
}

fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().expect("a number")
}

/// `-?[0-9]+\.[0-9]+`, with at most 12 digits behind the point.
fn is_float(field: &str) -> bool {
    let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    let parts = field.strip_prefix('-').unwrap_or(field).split_once('.');
    parts.is_some_and(|(whole, rest)| digits(whole) && digits(rest) && rest.len() <= 12)
}

#[test]
fn every_field_of_every_frame_is_one_that_readers_take() {
    let out = baked();
    for (table, whole, floats) in TABLES {
        let mut count = 0;
        for frame in FRAMES {
            let text = fs::read_to_string(out.join(format!("points/{table}_{frame:04}.csv"))).expect("a file");
            assert!(text.ends_with('\n') && !text.contains(['\r', ' ', '"']));
            assert_eq!(text.lines().next(), Some(&*format!("{whole},{floats}")));
            for line in text.lines().skip(1) {
                let fields: Vec<&str> = line.split(',').collect();
                let (ids, numbers) = fields.split_at(whole.split(',').count());
                assert!(ids.iter().all(|f| f.parse::<i32>().is_ok()), "{table}: {line}");
                assert!(numbers.iter().all(|f| is_float(f)), "{table}: {line}");
                assert_eq!(numbers.len(), floats.split(',').count());
                count += 1;
            }
        }
        assert!(count > 100, "{table}: {count} rows");
    }
    assert_eq!(fs::read_dir(out.join("points")).expect("folder").count(), 3 * FRAMES.count());
}

#[test]
fn drops_and_joints_are_those_of_tracks() {
    let out = baked();
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-5 * b.abs().max(1e-6);
    let drops = records(out, "drops.bin", &["id", "state", "leaf", "x", "y", "z", "a", "volume"]);
    let joints = records(out, "rods.bin", &["placement", "joint", "x", "y", "z", "qx", "qy", "qz", "qw"]);
    for frame in FRAMES {
        let wanted: Vec<_> = drops.iter().filter(|d| d.0 == u64::from(frame)).map(|d| &d.1).collect();
        let found = rows(out, "drops", frame);
        assert_eq!(found.len(), wanted.len());
        for (row, d) in found.iter().zip(wanted) {
            let of = |name| number(row, name);
            assert_eq!([of("id"), of("state"), of("leaf")], [d[0], d[1], d[2]]);
            // (x, y, z) with Y up is (x, -z, y) in Blender.
            let all = [(of("x"), d[3]), (of("z"), d[4]), (-of("y"), d[5]), (of("radius"), d[6])];
            assert!(all.iter().all(|(a, b)| near(*a, *b)), "{row:?} {d:?}");
            assert!((of("volume_mm3") - d[7] * 1e9).abs() <= 1e-5 * d[7] * 1e9 + 1e-12);
            assert!((0.0..=1.0).contains(&of("wetness")) && (of("leaf") >= 0.0 || of("wetness") == 0.0));
        }
        let wanted: Vec<_> = joints.iter().filter(|d| d.0 == u64::from(frame)).map(|d| &d.1).collect();
        let found = rows(out, "joints", frame);
        assert_eq!(found.len(), wanted.len());
        for (k, (row, j)) in found.iter().zip(wanted).enumerate() {
            let of = |name| number(row, name);
            assert_eq!([row["id"].clone(), row["plant"].clone()], [k.to_string(), j[0].to_string()]);
            assert!(of("joint") == j[1] && of("parent") < of("joint"));
            let all = [(of("x"), j[2]), (of("z"), j[3]), (-of("y"), j[4]), (of("qx"), j[5]), (of("qz"), j[6])];
            let turned = all.into_iter().chain([(-of("qy"), j[7]), (of("qw"), j[8])]);
            assert!(turned.clone().all(|(a, b)| (a - b).abs() < 1e-5), "{row:?} {j:?}");
            assert!((of("radius") > 0.0) == (k > 0) && of("radius") < 0.01, "{row:?}");
        }
    }
}

#[test]
fn catkins_are_those_that_the_table_counts() {
    let out = baked();
    let text = fs::read_to_string(out.join("stats/flight.csv")).expect("table");
    let names: Vec<&str> =
        text.lines().next().expect("names").split(',').map(|n| n.split(' ').next().expect("a name")).collect();
    let mut states = [0; 3];
    for (line, frame) in text.lines().skip(1).zip(FRAMES) {
        let values: BTreeMap<&str, f64> =
            names.iter().copied().zip(line.split(',').map(|v| v.parse().expect("a number"))).collect();
        let found = rows(out, "catkins", frame);
        let resting = values["grounded"] + values["on_wall"] + values["corner"];
        for (state, wanted) in [values["pending"], values["airborne"], resting].into_iter().enumerate() {
            let count = found.iter().filter(|r| r["state"] == state.to_string()).count();
            assert_eq!(f64::from(u32::try_from(count).expect("few")), wanted, "frame {frame}, state {state}");
            states[state] += count;
        }
        assert!(found.windows(2).all(|w| number(&w[0], "id") < number(&w[1], "id")));
        let turns = found.iter().map(|r| ["qw", "qx", "qy", "qz"].map(|q| number(r, q).powi(2)).iter().sum::<f64>());
        assert!(turns.clone().all(|q| (q - 1.0).abs() < 1e-4));
    }
    assert!(states[1] > 0 && states[2] > 0, "{states:?}");
}

#[test]
fn keys_choose_tables_and_axes_and_threads_change_nothing() {
    let dir = tempfile::tempdir().expect("dir");
    let set = |text| ["--set", text];
    let few = bake(
        dir.path(),
        &[&set("output.points.tables=[\"drops\"]")[..], &set("output.points.up=\"y\""), &["-j", "1"]].concat(),
    );
    let files = tree(&few.join("points"));
    assert!(files.len() == FRAMES.count() && files.keys().all(|f| f.starts_with("drops_")));
    for (y, z) in rows(&few, "drops", 12).iter().zip(rows(baked(), "drops", 12)) {
        assert_eq!((number(y, "x"), number(y, "y")), (number(&z, "x"), number(&z, "z")));
        assert_eq!(number(y, "z"), -number(&z, "y"));
    }
    let dir = tempfile::tempdir().expect("dir");
    let five = bake(dir.path(), &["-j", "5"]);
    assert_same(&tree(&five.join("points")), &tree(&baked().join("points")), "five threads");
}

#[test]
fn blender_reads_every_column_at_every_frame() {
    let Some(python) = clients::python() else { return };
    for (table, whole, floats) in TABLES {
        let frames = [*FRAMES.start(), 12, *FRAMES.end()].map(|n| n.to_string());
        let arguments = [&[arg(baked()), table], &frames.each_ref().map(String::as_str)[..]].concat();
        let said = clients::python_script(&python, "points_blender.py", &arguments);
        let text = String::from_utf8(said.stdout).expect("text");
        let found: Value = serde_json::from_str(text.lines().last().expect("a line")).expect("json");
        for frame in frames {
            let (seen, wanted) = (&found[&frame], rows(baked(), table, frame.parse().expect("a frame")));
            assert_eq!(seen["count"], wanted.len(), "{table}, frame {frame}");
            for (names, kind) in [(whole, "INT"), (floats, "FLOAT")] {
                assert!(
                    names.split(',').all(|n| seen["types"][n] == kind),
                    "{table}, frame {frame}: {}",
                    seen["types"]
                );
            }
            let ids: Vec<f64> = seen["ids"].as_array().expect("ids").iter().filter_map(Value::as_f64).collect();
            assert_eq!(ids, wanted.iter().map(|r| number(r, "id")).collect::<Vec<_>>());
            let places = seen["positions"].as_array().expect("positions").iter().filter_map(Value::as_f64);
            let rows = wanted.iter().flat_map(|r| ["x", "y", "z"].map(|k| number(r, k)));
            assert!(places.zip(rows).all(|(a, b)| (a - b).abs() < 1e-5), "{table}, frame {frame}");
        }
    }
}
