//! Drops, what happens to them, leaves and joints as records, read by what their index says alone: they agree with the table
//! of rain, and with what Blender sees of the same bake.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::float_cmp, reason = "small whole numbers")]

use crate::common::clients;
use crate::common::program;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use serde_json::Value;

const SCENE: &str = "seed = 4\n[frames]\nend = 30\nfps = 60\n[plants.twig]\ngrammar = \"rain-twig.l\"\nset = { LEAVES = 3 }\n\
    [plants.twig.leaf]\nblade = \"elliptic\"\nside = 32\n[plants.twig.rods]\n[[place]]\nplant = \"twig\"\n\
    [ground]\nshow = false\n[maps]\nresolution = 32\n[rain]\nrate_mm_per_h = 200\nspin_up_s = 2\nsubsteps = 8\n";

/// A bake of frames 11 to 30.
fn baked() -> &'static Path {
    static DONE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let dir = DONE.get_or_init(|| {
        let dir = tempfile::tempdir().expect("dir");
        let scene = dir.path().join("wet.toml");
        fs::write(&scene, SCENE).expect("scene");
        let out = dir.path().join("out");
        let formats = ["--formats", "usd,exr,csv,tracks", "--frames", "11-30"];
        program::ends(0, &[&["-q", "bake", program::arg(&scene), "-o", program::arg(&out)], &formats[..]].concat());
        dir
    });
    dir.path()
}

/// Records of a file by frame: a number for each field.
type Records = BTreeMap<u64, Vec<BTreeMap<String, f64>>>;

fn index(out: &Path) -> Value {
    serde_json::from_slice(&fs::read(out.join("tracks/index.json")).expect("index")).expect("json")
}

fn number(bytes: &[u8], kind: &str) -> f64 {
    let four = || <[u8; 4]>::try_from(&bytes[..4]).expect("four bytes");
    match kind {
        "u4" => f64::from(u32::from_le_bytes(four())),
        "i4" => f64::from(i32::from_le_bytes(four())),
        "f4" => f64::from(f32::from_le_bytes(four())),
        "f8" => f64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")),
        _ => panic!("what is {kind}"),
    }
}

fn records(out: &Path, name: &str) -> Records {
    let index = index(out);
    let file = index["files"].as_array().expect("files").iter().find(|f| f["file"] == name).expect("the file");
    let bytes = fs::read(out.join("tracks").join(name)).expect("records");
    let size = file["record_bytes"].as_u64().expect("a size") as usize;
    assert_eq!(bytes.len() as u64, file["records"].as_u64().expect("a count") * size as u64);
    let fields = file["fields"].as_array().expect("fields");
    let one = |record: &[u8]| -> BTreeMap<String, f64> {
        let of = |f: &Value| {
            let at = f["offset"].as_u64().expect("an offset") as usize;
            let name = f["name"].as_str().expect("a name").to_owned();
            (name, number(&record[at..], f["type"].as_str().expect("a type")))
        };
        fields.iter().map(of).collect()
    };
    let frames = file["frames"].as_array().expect("frames").iter();
    frames
        .map(|f| {
            let [frame, first, count] = [0, 1, 2].map(|i| f[i].as_u64().expect("a number"));
            let (first, count) = (first as usize, count as usize);
            (frame, bytes[first * size..(first + count) * size].chunks(size).map(one).collect())
        })
        .collect()
}

/// The table of rain: columns by frame.
fn table(out: &Path) -> BTreeMap<u64, BTreeMap<String, f64>> {
    let text = fs::read_to_string(out.join("stats/rain.csv")).expect("table");
    let names: Vec<&str> =
        text.lines().next().expect("heads").split(',').map(|n| n.split(' ').next().expect("a name")).collect();
    let row = |line: &str| -> BTreeMap<String, f64> {
        names.iter().zip(line.split(',')).map(|(n, v)| ((*n).to_owned(), v.parse().expect("a number"))).collect()
    };
    text.lines().skip(1).map(row).map(|r| (r["frame"] as u64, r)).collect()
}

fn words(index: &Value, list: &str) -> Vec<String> {
    index[list].as_array().expect("words").iter().map(|w| w.as_str().expect("a word").to_owned()).collect()
}

#[test]
fn drops_hold_the_water_that_the_table_tells_of() {
    let out = &baked().join("out");
    let (states, table, drops, leaves) =
        (words(&index(out), "states"), table(out), records(out, "drops.bin"), records(out, "leaves.bin"));
    assert_eq!(drops.keys().collect::<Vec<_>>(), table.keys().collect::<Vec<_>>());
    let mut tails = 0;
    for (frame, row) in &table {
        let mut sums: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
        for d in &drops[frame] {
            let sum = sums.entry(&states[d["state"] as usize]).or_default();
            *sum = (sum.0 + 1.0, sum.1 + d["volume"] * 1e9);
            let unit = [d["ax"], d["ay"], d["az"]].iter().map(|x| x * x).sum::<f64>();
            assert!((unit - 1.0).abs() < 1e-4 || (states[d["state"] as usize] == "falls" && unit == 0.0), "{d:?}");
        }
        let of = |word: &str| sums.get(word).copied().unwrap_or_default();
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs().max(1e-9);
        let lying = of("rests").1 + of("runs").1 + of("tail").1;
        for (found, column) in [(of("falls").1, "water_air"), (lying, "water_leaves"), (of("hangs").1, "water_hanging")]
        {
            assert!(near(found, row[column]), "frame {frame}, {column}: {found}, {}", row[column]);
        }
        for (word, column) in [("falls", "in_air"), ("rests", "at_rest"), ("runs", "running"), ("hangs", "hanging")] {
            assert!((of(word).0 - row[column]).abs() < 0.5, "frame {frame}, {column}");
        }
        let on: f64 = leaves[frame].iter().map(|l| l["volume"] * 1e9).sum();
        assert!(near(on, lying + of("hangs").1) && leaves[frame].iter().all(|l| (0.0..=1.0).contains(&l["wetness"])));
        // A tail stands right behind its head.
        for (k, head) in drops[frame].iter().enumerate().filter(|(_, d)| d["tail"] > 0.0) {
            let tail = &drops[frame][k + 1..=k + head["tail"] as usize];
            assert!(tail.iter().all(|t| t["id"] == head["id"] && states[t["state"] as usize] == "tail"));
            tails += tail.len();
        }
    }
    assert!(tails > 0, "nothing ran");
    assert!(leaves.values().flatten().any(|l| l["wetness"] > 0.01));
}

#[test]
fn events_are_those_that_the_table_counts() {
    let out = &baked().join("out");
    let (kinds, table, events) = (words(&index(out), "events"), table(out), records(out, "events.bin"));
    let mut seen = BTreeSet::new();
    for (frame, row) in table.iter().skip(1) {
        let before = &table[&(frame - 1)];
        for (word, column) in
            [("struck", "struck"), ("merged", "merged"), ("bead", "beads"), ("hung", "hung"), ("fell", "fell")]
        {
            let found = events[frame].iter().filter(|e| kinds[e["what"] as usize] == word).count();
            assert_eq!(found as f64, row[column] - before[column], "frame {frame}: {word}");
            seen.extend((found > 0).then_some(word));
        }
        let times = events[frame].iter().map(|e| (e["t"] * 60.0, e["what"]));
        assert!(times.clone().all(|(t, _)| t <= *frame as f64 - 1.0 + 1e-6 && t >= *frame as f64 - 2.2), "{frame}");
        let struck = events[frame].iter().filter(|e| kinds[e["what"] as usize] == "struck");
        assert!(struck.clone().all(|e| e["blow"] > 0.0 && e["leaf"] >= 0.0));
    }
    assert!(seen.contains("struck") && seen.len() >= 3, "{seen:?}");
}

#[test]
fn joints_keep_their_distances() {
    let out = &baked().join("out");
    let index = index(out);
    let skeleton = &index["skeletons"][0];
    let parents: Vec<i64> =
        skeleton["parents"].as_array().expect("list").iter().map(|p| p.as_i64().expect("joint")).collect();
    let rods = records(out, "rods.bin");
    let (first, last) = (&rods[&11], &rods[&30]);
    assert_eq!((first.len(), rods.len()), (parents.len(), 20));
    let place = |r: &BTreeMap<String, f64>| ["x", "y", "z"].map(|k| r[k]);
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>().sqrt();
    let mut moved = 0.0_f64;
    for (j, parent) in parents.iter().enumerate() {
        assert_eq!(first[j]["joint"], j as f64);
        moved = moved.max(apart(place(&first[j]), place(&last[j])));
        if let Ok(p) = usize::try_from(*parent) {
            let [a, b] = [first, last].map(|l| apart(place(&l[j]), place(&l[p])));
            assert!((a - b).abs() < 0.02 * a.max(1e-3), "{j}: {a} {b}");
        }
    }
    assert!(moved > 1e-5, "nothing bends");
}

#[test]
fn blender_sees_the_same_drops_and_how_wet_leaves_are() {
    let out = &baked().join("out");
    let Some(python) = clients::python() else { return };
    let said =
        clients::python_script(&python, "rain_blender.py", &[program::arg(&out.join("wet.usda")), "11", "20", "30"]);
    let text = String::from_utf8(said.stdout).expect("text");
    let found: Value = serde_json::from_str(text.lines().last().expect("a line")).expect("json");
    let (states, drops) = (words(&index(out), "states"), records(out, "drops.bin"));
    for frame in [11_u64, 20, 30] {
        let seen = found["frames"][frame.to_string()].as_object().expect("a frame");
        let heads = drops[&frame].iter().filter(|d| !matches!(&*states[d["state"] as usize], "tail" | "falls"));
        let mut count = 0;
        for d in heads {
            count += 1;
            let middle = seen["drops"][(d["id"] as u64).to_string()].as_array().expect("a drop of this number");
            let apart: f64 =
                ["x", "y", "z"].iter().zip(middle).map(|(k, m)| (d[*k] - m.as_f64().expect("m")).abs()).sum();
            assert!(apart < 0.012, "frame {frame}, drop {}: {apart}", d["id"]);
        }
        assert_eq!(seen["drops"].as_object().expect("drops").len(), count);
        let wet = seen["wetness"].as_object().expect("leaves");
        assert!(wet.len() == 3 && wet.values().any(|w| w.as_f64().expect("wetness") > 0.0), "{wet:?}");
    }
    let missing = found["missing"].as_array().expect("files");
    assert!(missing.is_empty(), "{missing:?}");
}
