//! Scenes of all presets, baked short, as Blender and the validators of glTF and USD read them.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a test may fail, reads what it likes and prints counts"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use osier::presets::PRESETS;
use serde_json::Value;

use crate::common::clients;
use crate::common::program::{arg, ends, tree};
use crate::common::short_bakes::{is_scene, shortened};

/// A wood and a meadow, many copies, wet leaves with maps, flying catkins, a tree of a species and one of a grammar in gusts.
const SIX: [&str; 6] = ["showcase", "meadow", "rain-leaves", "catkins-street", "apple", "gusty-tree"];

/// Names of the presets that are scenes.
fn scenes() -> Vec<&'static str> {
    let scenes = PRESETS.iter().filter(|preset| is_scene(preset));
    scenes.filter_map(|preset| preset.name.strip_suffix(".toml")).collect()
}

/// A preset baked short into a folder of its name. `formats`: those and further arguments.
fn baked(folder: &Path, preset: &str, formats: &[&str]) -> PathBuf {
    let out = folder.join(preset);
    let keys = shortened(&format!("{preset}.toml"));
    let sets = keys.iter().flat_map(|key| ["--set", key.as_str()]);
    let args = ["-q", "bake", preset, "-o", arg(&out)].into_iter().chain(sets).chain(formats.iter().copied());
    ends(0, &args.collect::<Vec<_>>());
    out
}

/// Whether anything of a bake has triangles or instances, by its manifest.
fn has_surfaces(folder: &Path) -> bool {
    let text = std::fs::read_to_string(folder.join("manifest.json")).expect("manifest");
    let manifest: Value = serde_json::from_str(&text).expect("JSON");
    let counts = |asset: &Value, key: &str| asset[key].as_u64().is_some_and(|n| n > 0);
    let assets = manifest["assets"].as_array().expect("assets");
    assets.iter().any(|asset| counts(asset, "vertices") || counts(asset, "instances"))
}

/// Imports presets into one Blender after the other: placements, leaves, frame rate, range and camera are those of the manifests.
fn import(presets: &[&str]) {
    let Some(python) = clients::python() else { return };
    let temp = tempfile::tempdir().expect("folder");
    let bake = |preset: &&str| baked(temp.path(), preset, &["--formats", "usd,exr"]).join("manifest.json");
    let manifests: Vec<PathBuf> = presets.iter().map(bake).collect();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("blender/tests/presets.py");
    let out = clients::run(Command::new(python).arg(script).args(manifests));
    let text = String::from_utf8_lossy(&out.stdout);
    let line = text.lines().rev().find(|line| line.starts_with('{')).expect("a report");
    let report: Value = serde_json::from_str(line).expect("JSON");
    assert_eq!(report["failed"], serde_json::json!([]), "{report:#}");
    assert_eq!(report["counts"].as_object().map(serde_json::Map::len), Some(presets.len()), "{report:#}");
}

#[test]
fn blender_has_what_the_manifests_of_six_presets_say() {
    import(&SIX);
}

#[test]
#[ignore = "takes minutes; tests/full.sh runs it"]
fn blender_has_what_the_manifests_of_all_presets_say() {
    import(&scenes());
}

/// Formats and profiles of glTF and USD, baked one after the other, since a file of profile "web" is either compressed or not.
const ALL_PROFILES: [&[&str]; 2] = [
    &["--formats", "usd,glb,unreal", "--set", "output.gltf.profiles=[\"blender\",\"web\",\"engine\"]"],
    &[
        "--formats",
        "usd,glb",
        "--set",
        "output.gltf.meshopt=true",
        "--set",
        "output.gltf.assets=true",
        "--set",
        "output.usd.copies=references",
    ],
];

#[test]
#[ignore = "takes half an hour; tests/full.sh runs it"]
fn the_validators_have_nothing_to_say_about_any_preset() {
    let (Some((node, modules)), Some(python)) = (clients::validator(), clients::python()) else { return };
    let (mut faults, mut counts) = (Vec::new(), [0; 2]);
    for (preset, formats) in scenes().into_iter().flat_map(|preset| ALL_PROFILES.map(|formats| (preset, formats))) {
        let temp = tempfile::tempdir().expect("folder");
        let out = baked(temp.path(), preset, formats);
        let names = tree(&out);
        let files = |endings: &[&str]| -> Vec<PathBuf> {
            names.keys().filter(|name| endings.iter().any(|e| name.ends_with(e))).map(|name| out.join(name)).collect()
        };
        let (models, stages) = (files(&[".glb", ".gltf"]), files(&[".usda", ".usdc"]));
        // glTF has no files of scenes of moving points alone.
        let wanted = match (has_surfaces(&out), formats == ALL_PROFILES[0]) {
            (false, _) => 0,
            (true, true) => 3,
            (true, false) => 1,
        };
        assert!(models.len() >= wanted && !stages.is_empty(), "{preset}: {:?}", names.keys());
        counts = [counts[0] + models.len(), counts[1] + stages.len()];
        if !models.is_empty() {
            let mut command = Command::new(&node);
            let told = clients::run(command.arg(clients::script("gltf_validate.mjs")).arg(&modules).args(&models));
            let reports = String::from_utf8_lossy(&told.stdout);
            let said = reports.lines().filter(|line| !line.contains("\"errors\":0,\"warnings\":0,"));
            faults.extend(said.map(|line| format!("{preset}: {line}")));
            assert_eq!(reports.lines().count(), models.len(), "{preset}: {reports}");
        }
        // It ends with 1 after the first preset about which a validator says anything.
        clients::python_script(&python, "usd_validate.py", &stages.iter().map(|p| arg(p)).collect::<Vec<_>>());
    }
    println!("{} presets: {} glTF files, {} USD files", scenes().len(), counts[0], counts[1]);
    assert!(faults.is_empty(), "{faults:#?}");
}
