//! Plants for Unreal Engine: what usd-core finds in their files, the wind of stiff and of thin trees, and the keys of the format.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run the program and read its files")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::common::clients;
use crate::common::program::{arg, assert_same, ends, tree};

/// A swaying birch with leaves, cheap to draw.
const BIRCH: &str = "seed = 2\n[frames]\nend = 3\n[plants.b]\ngrammar = \"birch.l\"\n\
    [plants.b.leaf]\nblade = \"toothed\"\nside = 32\n[plants.b.skin]\nedge = 0.1\nturn_deg = 30\n[plants.b.bark]\nside = 32\n\
    [[place]]\nplant = \"b\"\n[wind]\nbeaufort = 5\n[ground]\nshow = false\n";

/// Bakes a scene, a shipped one or a file, in the given formats and returns the files for Unreal Engine.
fn bake_formats(formats: &str, scene: &str, out: &Path, more: &[&str]) -> BTreeMap<String, Vec<u8>> {
    ends(0, &[&["-q", "bake", scene, "-o", arg(out), "--formats", formats], more].concat());
    tree(&out.join("unreal"))
}

fn bake(scene: &str, out: &Path, more: &[&str]) -> BTreeMap<String, Vec<u8>> {
    bake_formats("unreal", scene, out, more)
}

fn birch(folder: &Path) -> PathBuf {
    let scene = folder.join("birch.toml");
    fs::write(&scene, BIRCH).expect("scene");
    scene
}

fn wind(files: &BTreeMap<String, Vec<u8>>, plant: &str) -> Value {
    serde_json::from_slice(&files[&format!("{plant}.wind.json")]).expect("JSON")
}

/// A number of a simulation group.
fn of_group(wind: &Value, group: usize, name: &str) -> f64 {
    wind["SimulationGroups"][group][name].as_f64().expect("a number")
}

/// usd-core finds no fault in the plants of a bake, and notices each fault that it is shown. `joints`: most of a plant.
fn contract(out: &Path, joints: &str) -> Option<Vec<Value>> {
    let python = clients::python()?;
    let told = clients::python_script(&python, "unreal_assembly.py", &[arg(out), joints]);
    let text = String::from_utf8(told.stdout).expect("utf-8");
    Some(text.lines().map(|line| serde_json::from_str(line).expect("a plant")).collect())
}

#[test]
fn three_swaying_birches_keep_what_the_importer_expects() {
    let dir = tempfile::tempdir().expect("dir");
    let out = dir.path().join("out");
    let files = bake_formats("usd,unreal", "birch-wood", &out, &["--set", "frames.end=2"]);
    let names: Vec<&String> = files.keys().collect();
    let wanted = ["birch_1", "birch_2", "birch_3"].map(|n| [format!("{n}.usdc"), format!("{n}.wind.json")]);
    assert_eq!(names, wanted.iter().flatten().collect::<Vec<_>>());
    let manifest: Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
    let entry = &manifest["assets"].as_array().expect("assets")[0];
    let listed: Vec<&str> = entry["files"].as_array().expect("files").iter().filter_map(Value::as_str).collect();
    assert!(["unreal/birch_1.usdc", "unreal/birch_1.wind.json"].iter().all(|f| listed.contains(f)), "{listed:?}");
    for plant in ["birch_1", "birch_2", "birch_3"] {
        let wind = wind(&files, plant);
        let groups = wind["SimulationGroups"].as_array().expect("groups").len();
        assert!(groups > 2 && !wind["bIsGroundCover"].as_bool().expect("a flag"), "{wind}");
        for n in 1..groups {
            let (least, most) = (of_group(&wind, n, "MinInfluence"), of_group(&wind, n, "MaxInfluence"));
            // A group whose chains are single joints has one value for both; that of the limbs has two.
            let in_order = least < most || (n > 1 && least <= most);
            assert!(0.0 < least && in_order && most <= 1.0, "{plant}, group {n}: {least} {most}");
        }
    }
    // A reader that does not know the engine's schemas finds nothing to object to either.
    if let Some(python) = clients::python() {
        clients::python_script(&python, "usd_validate.py", &[arg(&out.join("unreal/birch_1.usdc"))]);
    }
    // The skeletons have the format's own limit, not the 64 joints that the scene gives its animation.
    if let Some(plants) = contract(&out, "1800") {
        assert_eq!(plants.len(), 3);
        for plant in &plants {
            assert!(plant["joints"].as_u64().expect("joints") > 300, "{plant}");
            assert_eq!(plant["parts"], entry_of(&manifest, plant)["instances"], "{plant}");
            assert_eq!(plant["points"], entry_of(&manifest, plant)["vertices"], "{plant}");
        }
    }
}

/// What the manifest says of a plant.
fn entry_of<'a>(manifest: &'a Value, plant: &Value) -> &'a Value {
    let assets = manifest["assets"].as_array().expect("assets");
    assets.iter().find(|a| a["id"] == plant["plant"]).expect("the plant")
}

#[test]
fn a_limit_of_joints_keeps_the_geometry_and_threads_change_nothing() {
    let dir = tempfile::tempdir().expect("dir");
    let scene = birch(dir.path());
    let [whole, same, few] = ["whole", "same", "few"].map(|name| dir.path().join(name));
    assert_same(&bake(arg(&scene), &whole, &["-j", "1"]), &bake(arg(&scene), &same, &["-j", "3"]), "threads");
    let files = bake(arg(&scene), &few, &["--set", "output.unreal.joints=40"]);
    let joints = wind(&files, "b")["Joints"].as_array().expect("joints").len();
    assert!((5..=40).contains(&joints), "{joints}");
    if let Some((whole, few)) = contract(&whole, "1800").zip(contract(&few, "40")) {
        assert!(whole[0]["joints"].as_u64() > few[0]["joints"].as_u64());
        for name in ["points", "parts"] {
            assert_eq!(whole[0][name], few[0][name]);
        }
    }
}

#[test]
fn the_trunk_of_an_oak_bends_less_than_that_of_a_birch_and_limber_wood_moves_no_share() {
    let dir = tempfile::tempdir().expect("dir");
    let trunk = |scene: &str, more: &[&str]| {
        let files = bake(scene, &dir.path().join(format!("{}{}", scene, more.len())), more);
        of_group(&wind(&files, &format!("{scene}_1")), 0, "Influence")
    };
    let (oak, birch) = (trunk("oak", &[]), trunk("birch", &[]));
    assert!(0.0 < oak && oak < birch && birch < 0.5, "oak {oak}, birch {birch}");
    // Influences are shares of a typical tip's bend: a factor on all wood changes none of them.
    let limber = trunk("birch", &["--set", "plants.birch.wood.stiffness=0.5"]);
    assert!((limber / birch - 1.0).abs() < 1e-4, "{limber} {birch}");
}

#[test]
fn still_plants_and_plants_on_rods_have_joints_and_single_rods_are_no_plants() {
    let dir = tempfile::tempdir().expect("dir");
    for scene in ["young-tree", "wind-twig", "grass"] {
        let out = dir.path().join(scene);
        let end = ["--set", "frames.end=2"];
        let files = bake(scene, &out, if scene == "wind-twig" { &end[..] } else { &[] });
        assert!(files.len() >= 2, "{scene}: {:?}", files.keys());
        if let Some(plants) = contract(&out, "1800") {
            assert!(plants.iter().all(|p| p["joints"].as_u64() > Some(1)), "{plants:?}");
        }
    }
    let out = dir.path().join("pole");
    let pole = bake("pole", &out, &["--set", "frames.end=2"]);
    assert!(pole.is_empty(), "{:?}", pole.keys());
    let manifest: Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
    assert_eq!(manifest["warnings"][0]["code"], "X025");
}

#[test]
fn a_plant_that_grows_or_turns_over_the_clip_is_shown_at_one_time_and_told() {
    let dir = tempfile::tempdir().expect("dir");
    let baked = |name: &str, keys: &str| {
        let scene = dir.path().join(format!("{name}.toml"));
        // Trees of this age have shed branches.
        let rest = "[plants.a.leaf]\nside = 32\n[plants.a.bark]\nside = 32\n[[place]]\nplant = \"a\"\n[ground]\nshow = false\n\
            [frames]\nend = 3\n";
        fs::write(&scene, format!("[plants.a]\nspecies = \"oak\"\nage = 16\n{keys}{rest}")).expect("scene");
        let out = dir.path().join(name);
        let files = bake(arg(&scene), &out, &[]);
        let manifest: Value =
            serde_json::from_slice(&fs::read(out.join("manifest.json")).expect("manifest")).expect("JSON");
        (files, manifest["warnings"].to_string())
    };
    let (still, silent) = baked("still", "");
    let (grown, told) = baked("grown", "[plants.a.site]\nfrom = 4\n");
    assert!(
        !silent.contains("X017") && told.contains("X017") && told.contains("plants a grow over the clip"),
        "{told}"
    );
    // What falls before the end of the clip is not there; the order of branches may be another one.
    let (one, other) = (wind(&grown, "a"), wind(&still, "a"));
    assert_eq!(one["SimulationGroups"].as_array().map(Vec::len), other["SimulationGroups"].as_array().map(Vec::len));
    if let (Some(one), Some(other)) =
        (contract(&dir.path().join("grown"), "1800"), contract(&dir.path().join("still"), "1800"))
    {
        for count in ["joints", "points", "parts"] {
            assert_eq!(one[0][count], other[0][count], "{count}");
        }
    }
    let (_, told) = baked("autumn", "season = [\"09-20\", \"11-20\"]\n");
    assert!(told.contains("X017") && told.contains("change their leaves"), "{told}");
}
