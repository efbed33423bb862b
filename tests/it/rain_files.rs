//! Baked rain: every file of every format is the same at any number of threads, and POV-Ray shows the drops without a word.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use crate::common::clients;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::picture::{Picture, luma};
use crate::common::program::{arg, assert_same, ends, tree};

const SCENE: &str = "seed = 4\n[frames]\nend = 8\nfps = 30\n[plants.twig]\ngrammar = \"rain-twig.l\"\nset = { LEAVES = 3 }\n\
    [plants.twig.leaf]\nblade = \"elliptic\"\nside = 32\n[plants.twig.rods]\n[[place]]\nplant = \"twig\"\n\
    [ground]\nshow = false\n[maps]\nresolution = 32\n[rain]\nrate_mm_per_h = 200\nspin_up_s = 2\nsubsteps = 8\n";

#[test]
fn all_files_are_the_same_at_any_number_of_threads() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = dir.path().join("wet.toml");
    fs::write(&scene, SCENE).expect("scene");
    let baked = |jobs: &str| {
        let out = dir.path().join(jobs);
        let formats = "usd,glb,pc2,obj,ply,pov,exr,csv,tracks";
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", formats, jobs]);
        tree(&out)
    };
    let one = baked("-j1");
    for ending in [".usda", ".usdc", ".glb", ".inc", ".exr", ".png", ".csv", ".bin"] {
        assert!(one.keys().any(|path| path.ends_with(ending)), "no {ending}: {:?}", one.keys());
    }
    for jobs in ["-j2", "-j5"] {
        assert_same(&baked(jobs), &one, jobs);
    }
}

/// Pixels of a frame of 64 x 48.
fn rendered(povray: &Path, out: &Path) -> Picture {
    let folder = out.join("pov");
    let arguments = ["render.ini", "+W64", "+H48", "-A", "-D", "+SF1", "+EF1", "+Op.png"];
    let ended = clients::run(Command::new(povray).current_dir(&folder).args(arguments));
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    // Light from behind is still called an experiment.
    assert_eq!(said.matches("Warning:").count(), said.matches("experimental feature").count(), "{said}");
    let made = fs::read_dir(&folder).expect("folder").filter_map(Result::ok).map(|e| e.path());
    let made = made.filter(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with('p'))).collect::<Vec<_>>();
    let picture = made.iter().find(|p| p.extension().is_some_and(|e| e == "png")).expect("a picture");
    Picture::open(picture)
}

#[test]
fn drops_are_seen_in_pov_ray() {
    let Some(povray) = clients::povray() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let text = osier::presets::find("wet-leaf.toml").expect("a preset").text;
    let (from, to) = (text.find("[rain]").expect("rain"), text.find("[camera]").expect("camera"));
    let dry = [&text[..from], &text[to..]].concat();
    let pictures = [("wet", text), ("dry", dry.as_str())].map(|(name, text)| {
        let (scene, out) = (dir.path().join(format!("{name}.toml")), dir.path().join(name));
        fs::write(&scene, text).expect("scene");
        ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out), "--formats", "pov", "--frames", "1"]);
        rendered(&povray, &out)
    });
    let differs = |x: usize, y: usize| (luma(pictures[0].at(x, y)) - luma(pictures[1].at(x, y))).abs() > 0.03;
    let count = (0..48).flat_map(|y| (0..64).map(move |x| (x, y))).filter(|(x, y)| differs(*x, *y)).count();
    // Six drops of 3 to 9 mm on two leaves of 90 mm: some hundredths of the picture, and not all of it.
    assert!((40..1200).contains(&count), "{count} pixels of {}", 64 * 48);
}

/// A leaf of 80 x 80 mm with a picture, level, in the rain: how many drops struck it.
fn struck(dir: &Path, name: &str, cut: bool) -> f64 {
    let folder = dir.join(name);
    fs::create_dir(&folder).expect("folder");
    let mesh = "mtllib leaf.mtl\nv -0.04 0 0\nv 0.04 0 0\nv 0.04 0.08 0\nv -0.04 0.08 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
        usemtl leaf\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    fs::write(folder.join("leaf.obj"), mesh).expect("mesh");
    fs::write(folder.join("leaf.mtl"), "newmtl leaf\nKd 1 1 1\nmap_Kd leaf.png\n").expect("material");
    let color = |x: u32, _| image::Rgba([90, 140, 60, if cut && x < 16 { 0 } else { 255 }]);
    image::RgbaImage::from_fn(32, 32, color).save(folder.join("leaf.png")).expect("picture");
    let scene = SCENE.replace("blade = \"elliptic\"\nside = 32", "mesh = \"leaf.obj\"\nsize = 0.08");
    fs::write(folder.join("wet.toml"), scene).expect("scene");
    let out = folder.join("out");
    ends(0, &["-q", "bake", arg(&folder.join("wet.toml")), "-o", arg(&out), "--formats", "csv"]);
    let table = fs::read_to_string(out.join("stats/rain.csv")).expect("table");
    let mut rows = table.lines().filter(|l| !l.starts_with('#'));
    let column = rows.next().expect("names").split(',').position(|c| c == "struck").expect("a column");
    rows.next_back().and_then(|row| row.split(',').nth(column)?.parse().ok()).expect("a number")
}

#[test]
fn drops_fall_through_the_holes_of_a_picture() {
    let dir = tempfile::tempdir().expect("dir");
    let (whole, cut) = (struck(dir.path(), "whole", false), struck(dir.path(), "cut", true));
    assert!(whole > 100.0, "{whole}");
    assert!((cut / whole - 0.5).abs() < 0.12, "{cut} of {whole}");
}

/// Leaves without maps of their own tell how wet they are as a whole.
#[test]
fn leaves_without_maps_tell_their_wetness() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let (scene, out) = (dir.path().join("wet.toml"), dir.path().join("out"));
    fs::write(&scene, SCENE).expect("scene");
    let set = ["--set", "maps.max_mapped_leaves=0", "--formats", "usd"];
    ends(0, &[&["-q", "bake", arg(&scene), "-o", arg(&out)], &set[..]].concat());
    let said = clients::python_script(&python, "instance_wetness.py", &[arg(&out.join("wet.usda"))]);
    let told: Vec<f32> = serde_json::from_slice(&said.stdout).expect("a list");
    assert_eq!(told.len(), 3);
    // Three leaves of 20 mm, hit by some hundred and fifty drops.
    assert!(told.iter().all(|w| (0.3..0.9).contains(w)), "{told:?}");
}

/// Wet leaves keep the materials of their payload; those of its other prims, which share the materials of the scene, are inactive.
#[test]
fn a_stage_composes_no_material_without_a_prim() {
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    let set = ["--set", "frames.end=2", "--set", "maps.resolution=64", "--formats", "usd"];
    ends(0, &[&["-q", "bake", "wet-leaf", "-o", arg(&out)], &set[..]].concat());
    let stage = fs::read_to_string(out.join("wet_leaf.usda")).expect("stage");
    for material in ["leaf_leaf", "leaf_shoot", "level_leaf", "level_shoot"] {
        let head = stage.split(&format!("over \"{material}\"")).nth(1).and_then(|rest| rest.split('{').next());
        assert!(head.is_some_and(|head| head.contains("active = false")), "{material}: {stage}");
    }
    assert!(!stage.contains("over \"leaf_l0000\""), "{stage}");
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
    let names: Vec<&str> =
        manifest["materials"].as_array().expect("a list").iter().map(|m| m["name"].as_str().expect("name")).collect();
    // No axis is thick enough for a bark.
    assert!(names.contains(&"leaf_shoot") && names.contains(&"water") && !names.contains(&"leaf_bark"), "{names:?}");
}

/// A wet leaf keeps its own colour, roughness and relief under a film of water, as far as Blender reads USD; drops refract.
#[test]
fn blender_sees_a_film_of_water_on_wet_leaves() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    let set = ["--set", "frames.end=2", "--set", "maps.resolution=64", "--formats", "usd,exr"];
    ends(0, &[&["-q", "bake", "wet-leaf", "-o", arg(&out)], &set[..]].concat());
    let said = clients::python_script(&python, "materials.py", &[arg(&out.join("wet_leaf.usda"))]);
    let text = String::from_utf8_lossy(&said.stdout).into_owned();
    let line = text.lines().rev().find(|l| l.starts_with('{')).expect("a report");
    let seen: serde_json::Value = serde_json::from_str(line).expect("JSON");
    let wet = &seen["leaf_l0000"];
    for (socket, file) in [
        ("Base Color", "leaf_leaf_color.png"),
        ("Roughness", "leaf_leaf_rough.png"),
        ("Normal", "leaf_leaf_normal.png"),
        ("Coat Weight", "wetness.0001.exr"),
    ] {
        assert_eq!(wet[socket], file, "{socket}: {wet}");
    }
    let number = |material: &str, socket: &str| seen[material][socket].as_f64().expect("a number");
    assert!((number("leaf_l0000", "Coat Roughness") - 0.05).abs() < 1e-6 && number("leaf_leaf", "Coat Weight") == 0.0);
    assert!((number("water", "IOR") - 1.333).abs() < 1e-3 && number("water", "Alpha") < 0.2, "{seen}");
}
