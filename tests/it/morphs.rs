//! Attractors that change with time, through the program: what is refused, what is written, what clients see.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use crate::common::clients;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

fn osier(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_osier")).args(arguments).output().expect("osier runs")
}

/// Tables beside the scenes of this file.
const TABLES: &str = "curled {\n 0 0 0 .1 0 0 .01\n 0.82 .15 -.15 .82 0 1.4 .85\n .1 -.1 .1 .1 0 1 .07\n -.1 .1 .1 .1 0 .4 .07\n}\n\
    other_weights {\n 0 0 0 .1 0 0 .1\n .6 -.4 .4 .6 0 1 .7\n .1 -.1 .1 .1 0 1 .1\n -.1 .1 .1 .1 0 .4 .1\n}\n\
    shear {\n 0 0 0 .1 0 0 .01\n 0.1 4 0 .1 0 1 .85\n .1 -.1 .1 .1 0 1 .07\n -.1 .1 .1 .1 0 .4 .07\n}\n\
    shear_back {\n 0 0 0 .1 0 0 .01\n .1 0 4 .1 0 1 .85\n .1 -.1 .1 .1 0 1 .07\n -.1 .1 .1 .1 0 .4 .07\n}\n\
    wide {\n 0 0 0 .1 0 0 .01\n .1 0 0 1.3 0 1 .85\n .1 -.1 .1 .1 0 1 .07\n -.1 .1 .1 .1 0 .4 .07\n}\n";

fn scene(folder: &Path, name: &str, morph: &str) -> PathBuf {
    std::fs::write(folder.join("mine.ifs"), TABLES).expect("tables");
    let text = format!(
        "seed = 5\n[frames]\nend = 9\nfps = 12\n[ground]\nshow = false\n[clouds.fern]\npoints = 3000\nheight = 1\n\
         [clouds.fern.morph]\n{morph}"
    );
    let path = folder.join(name);
    std::fs::write(&path, text).expect("scene");
    path
}

/// Between frames 1, 5 and 9 of 12 frames/s.
const UNFURLS: &str = "key = [\n { ifs = \"mine.ifs\", system = \"curled\", at = 0, colors = [\"#335522\"] },\n \
    { ifs = \"fern_leaf.ifs\", at = 0.5, colors = [\"#88bb44\"] },\n { ifs = \"fern_leaf.ifs\", at = 1 },\n]\n";

/// Each fault with its place, and the words that mend it.
#[test]
fn each_fault_names_its_place_and_the_mend() {
    let dir = tempfile::tempdir().expect("dir");
    let two = |a: &str, b: &str| format!("key = [\n {{ {a} }},\n {{ {b} }},\n]\n");
    let fern = "ifs = \"fern_leaf.ifs\", at = 0";
    let mine = |system: &str, at: f64| format!("ifs = \"mine.ifs\", system = \"{system}\", at = {at}");
    let cases: [(&str, String, &str, &str); 14] = [
        ("one", format!("key = [{{ {fern} }}]\n"), "S006", "two at least"),
        ("none", "ease = \"smooth\"\n".into(), "S006", "a morph of 0 tables"),
        ("list", "key = 3\n".into(), "S003", "[[clouds.fern.morph.key]]"),
        (
            "maps",
            two(fern, "ifs = \"green_tree.ifs\", at = 1"),
            "I070",
            "\"green_tree\" has 6 maps, \"fern_leaf\" has 4",
        ),
        ("space", two(fern, "ifs = \"monopodial.ifs\", at = 1"), "I070", "3 dimensions"),
        ("times", two("ifs = \"fern_leaf.ifs\", at = 2", &mine("curled", 2.0)), "S004", "must be later"),
        ("unknown", two(fern, "ifs = \"fern_leef.ifs\", at = 1"), "S005", "did you mean the preset \"fern_leaf.ifs\"?"),
        ("system", two(fern, &mine("curles", 1.0)), "I001", "curled"),
        ("nothing", two(fern, "at = 1"), "S006", "names no table"),
        ("word", format!("ease = \"smoth\"\n{}", two(fern, &mine("curled", 1.0))), "S003", "did you mean \"smooth\"?"),
        (
            "turns",
            two(fern, &format!("{}, turns = [1, 2]", mine("curled", 1.0))),
            "I070",
            "2 numbers of turns for 4 maps",
        ),
        ("half", two(fern, &format!("{}, turns = 1.5", mine("curled", 1.0))), "S004", "a whole number"),
        ("fixed", format!("shift = \"fixed-point\"\n{}", two(fern, &mine("wide", 1.0))), "I071", "det(I - A)"),
        ("between", two(&mine("shear", 0.0), &mine("shear_back", 1.0)), "I021", "on the way to this table"),
    ];
    for (name, morph, code, words) in cases {
        let path = scene(dir.path(), &format!("{name}.toml"), &morph);
        let run = osier(&["check", path.to_str().expect("path")]);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(1), "{name}: {said}");
        let place = format!("{name}.toml:");
        assert!(said.contains(code) && said.contains(words) && said.contains(&place), "{name}: {said}");
    }
}

#[test]
fn what_has_no_effect_or_jumps_is_told_and_work_is_limited() {
    let dir = tempfile::tempdir().expect("dir");
    let both = "key = [{ ifs = \"mine.ifs\", system = \"curled\", at = 0 }, { ifs = \"mine.ifs\", system = \"other_weights\", at = 1 }]\n";
    let path = scene(dir.path(), "jumps.toml", both);
    let path = path.to_str().expect("path");
    let said = |more: &[&str]| {
        let run = osier(&[&["check", path], more].concat());
        (run.status.code(), String::from_utf8_lossy(&run.stderr).into_owned())
    };
    let (code, text) = said(&[]);
    assert!(code == Some(0) && text.contains("I072") && text.contains("weights = \"hold\""), "{text}");
    let (_, text) = said(&["--set", "clouds.fern.morph.weights=hold"]);
    assert!(!text.contains("I072"), "{text}");
    let (_, text) = said(&["--set", "clouds.fern.voxel_mm=3", "--set", "clouds.fern.ifs=fern_leaf.ifs"]);
    assert!(text.matches("S007").count() == 2, "{text}");
    let (code, text) = said(&["--max-cloud-points", "20k"]);
    assert!(code == Some(1) && text.contains("--max-cloud-points") && text.contains("27,000"), "{text}");
}

fn baked(folder: &Path, name: &str, scene: &Path, more: &[&str]) -> PathBuf {
    let out = folder.join(name);
    let fixed = ["-q", "bake", scene.to_str().expect("path"), "-o", out.to_str().expect("path")];
    let run = osier(&[&fixed, more].concat());
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    out
}

/// Position, radius and colour of every point of a PLY file.
fn points(path: &Path) -> Vec<([f32; 3], f32, [u8; 3])> {
    let bytes = std::fs::read(path).expect("ply");
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("header") + 11;
    let float = |r: &[u8], i: usize| f32::from_le_bytes([r[4 * i], r[4 * i + 1], r[4 * i + 2], r[4 * i + 3]]);
    let row = |r: &[u8]| ([float(r, 0), float(r, 1), float(r, 2)], float(r, 3), [r[16], r[17], r[18]]);
    bytes[end..].chunks_exact(22).map(row).collect()
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

#[test]
fn points_move_without_jumps_and_end_where_the_tables_have_them() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "unfurls.toml", UNFURLS);
    let out = baked(dir.path(), "out", &path, &["--formats", "ply", "-j2"]);
    let frames: Vec<_> = (1..=9).map(|f| points(&out.join(format!("cloud/fern.{f:04}.ply")))).collect();
    assert!(frames.iter().all(|f| f.len() == 3000));
    let steps = |f: usize| {
        let moved = frames[f].iter().zip(&frames[f + 1]).map(|(a, b)| distance(a.0, b.0));
        moved.fold(0.0_f32, f32::max)
    };
    // The fern is 1 m high: no point goes far in a twelfth of a second, and none moves once the table is reached.
    for f in 0..6 {
        assert!(steps(f) > 0.005 && steps(f) < 0.35, "frame {f}: {} m", steps(f));
    }
    assert!(steps(6) < 1e-6 && steps(7) < 1e-6, "held: {} {}", steps(6), steps(7));
    // Colours go from the first to the second, then back to the table's own.
    let green = |f: usize| frames[f][7].2;
    assert!(green(0) == [0x33, 0x55, 0x22] && green(3)[0] > green(0)[0] && frames[8].iter().any(|p| p.2 != green(8)));
}

#[test]
fn files_are_the_same_at_any_number_of_threads() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "unfurls.toml", UNFURLS);
    let all = ["-j1", "-j2", "-j8"].map(|jobs| {
        let out = baked(dir.path(), jobs, &path, &["--formats", "usd,pov,ply", "--frames", "1-9:4", jobs]);
        let mut files = BTreeMap::new();
        for sub in ["usd", "pov", "pov/frames", "cloud"] {
            for entry in std::fs::read_dir(out.join(sub)).expect("folder") {
                let path = entry.expect("entry").path();
                if path.is_file() {
                    let name = path.strip_prefix(&out).expect("below").to_path_buf();
                    files.insert(name, std::fs::read(&path).expect("bytes"));
                }
            }
        }
        files
    });
    assert!(all[0].len() >= 9, "{:?}", all[0].keys());
    assert!(all[0] == all[1] && all[0] == all[2], "bytes depend on the number of threads");
}

#[test]
fn gltf_says_that_it_cannot_move_points() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "unfurls.toml", UNFURLS);
    let out = dir.path().join("out");
    // Three exporters find it; the bake tells it once, as the manifest does.
    let profiles = "output.gltf.profiles=[\"blender\", \"web\", \"engine\"]";
    let place = ["bake", path.to_str().expect("path"), "-o", out.to_str().expect("out")];
    let run = osier(&[&place[..], &["--formats", "glb", "--set", profiles]].concat());
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success() && said.contains("X017") && said.contains("glTF cannot move points"), "{said}");
    let manifest = std::fs::read_to_string(out.join("manifest.json")).expect("manifest");
    assert_eq!((said.matches("X017").count(), manifest.matches("X017").count()), (1, 1), "{said}");
}

/// Positions and velocities in Blender 5.0 and by usd-core, held against the frames of the PLY files.
#[test]
fn blender_sees_the_points_where_they_are() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "unfurls.toml", UNFURLS);
    let out = baked(dir.path(), "out", &path, &["--formats", "usd,ply"]);
    for mode in ["usd", "bpy"] {
        let script = clients::script("usd_morph.py");
        let arguments = [mode, out.to_str().expect("out"), "unfurls", "fern", "12"];
        let run = Command::new(&python).arg(script).args(arguments).output().expect("python runs");
        let told = String::from_utf8_lossy(&run.stdout).into_owned();
        assert!(run.status.success() && told.contains("3 frames"), "{told}{}", String::from_utf8_lossy(&run.stderr));
    }
}

#[test]
fn povray_gets_every_frames_spheres() {
    let dir = tempfile::tempdir().expect("dir");
    let path = scene(dir.path(), "unfurls.toml", UNFURLS);
    let out =
        baked(dir.path(), "out", &path, &["--formats", "pov", "--frames", "1,9", "--set", "clouds.fern.point_mm=12"]);
    let read = |f: u32| std::fs::read_to_string(out.join(format!("pov/frames/frame.{f:04}.inc"))).expect("frame");
    assert!(read(1).matches("sphere{").count() == 3000 && read(1) != read(9));
    let Some(povray) = clients::povray() else { return };
    clients::run(Command::new(&povray).current_dir(out.join("pov")).args(["render.ini", "+W96", "+H96", "-D", "-GA"]));
    let seen: Vec<_> = std::fs::read_dir(out.join("pov"))
        .expect("folder")
        .filter_map(|e| e.ok().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "png")))
        .collect();
    assert!(!seen.is_empty(), "no picture was rendered");
}
