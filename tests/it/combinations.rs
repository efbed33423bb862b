//! Grammars of every kind through a whole bake with wind and rain: colours of the turtle, drawings of other programs, queries and
//! sub-L-systems.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]

use crate::common::clients;
use crate::common::gltf_player::Player;
use crate::common::program::{arg, ends};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Two colours of wood, and leaves of a third.
const COLORED: &str = "Lsystem: 1\nderivation length: 4\nAxiom: ;(2)!(0.05)F(0.5)A(1)\n\
    A(s) --> !(0.04*s)F(0.3*s)[+(35);(5)A(s*0.8)][-(35)&(30)A(s*0.8)]/(90)L\nhomomorphism\nL --> ;(7)~l(0.5)\nendlsystem\n";
const FRACTINT: &str = "Tree1 {\n  Angle 16\n  Axiom +++++FX\n  X=[++++FX]FX[----FX]\n  F=FF\n}\n";
const LPARSER: &str = "5\n20\n30\nA\nA=!FF[+A][&A]^A\n@\n";
/// A shoot that a query stops at a height of 1 m, with flowers of an L-system of their own.
const QUERY: &str = "Lsystem: 1\nderivation length: 9\nAxiom: !(0.05)F(0.4)A?P(0,0,0)\n\
    A > ?P(x,y,z) : y < 1 --> !(0.03)F(0.25)[+(40)F(0.15)?(2,1)B$]/(137)A\n?P(x,y,z) : y < 0 --> *\nendlsystem\n\
    Lsystem: 2\nderivation length: 4\nAxiom: B\nB --> [&(60)~l(0.5)]/(90)B\nendlsystem\n";

/// A scene of one plant of a grammar, in all profiles of glTF.
fn bake(folder: &Path, name: &str, grammar: &str, keys: &str, tables: &str) -> PathBuf {
    std::fs::write(folder.join(format!("{name}.l")), grammar).expect("grammar");
    let text = format!(
        "[frames]\nend = 4\n[plants.p]\ngrammar = \"{name}.l\"\n{keys}[plants.p.bark]\nside = 64\n[plants.p.leaf]\nsize = 0.1\nside = 64\n\
         [ground]\nshow = false\n[wind]\nspeed = 6\n{tables}[output.gltf]\nprofiles = [\"blender\", \"web\", \"engine\"]\n"
    );
    let scene = folder.join(format!("{name}.toml"));
    std::fs::write(&scene, text).expect("scene");
    let out = folder.join(name);
    let (_, said) = ends(0, &["bake", arg(&scene), "-o", arg(&out), "--formats", "usd,glb"]);
    assert!(!said.contains("warning[L"), "{name}: {said}");
    out
}

fn files(folder: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        if path.is_dir() {
            found.extend(files(&path, endings));
        } else if endings.iter().any(|e| path.to_string_lossy().ends_with(e)) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn web(out: &Path) -> Value {
    let file = files(out, &[".web.glb"]).remove(0);
    Player::new(&std::fs::read(file).expect("file")).json
}

#[test]
fn grammars_of_every_kind_sway_in_valid_files() {
    let temp = tempfile::tempdir().expect("temp");
    let mut map = vec![0; 768];
    map[6..9].copy_from_slice(&[0, 0, 255]);
    map[15..18].copy_from_slice(&[255, 0, 0]);
    map[21..24].copy_from_slice(&[0, 255, 0]);
    std::fs::write(temp.path().join("colored.map"), map).expect("map");
    let rain = "[rain]\nrate_mm_per_h = 40\n";
    let outs = [
        bake(temp.path(), "colored", COLORED, "", rain),
        bake(temp.path(), "fractint", FRACTINT, "dialect = \"fractint\"\nsteps = 3\n", ""),
        bake(temp.path(), "lparser", LPARSER, "dialect = \"lparser\"\n", ""),
        bake(temp.path(), "query", QUERY, "", ""),
    ];
    for out in &outs {
        let json = web(out);
        assert!(json["animations"][0]["channels"].as_array().is_some_and(|c| !c.is_empty()), "{}", out.display());
    }
    // The colours of the turtle are materials of the swaying plant.
    let materials = web(&outs[0])["materials"].as_array().expect("materials").clone();
    let colors: BTreeSet<String> =
        materials.iter().map(|m| m["pbrMetallicRoughness"]["baseColorFactor"].to_string()).collect();
    assert!(["[0,0,1,1]", "[1,0,0,1]"].iter().all(|c| colors.contains(*c)), "{colors:?}");
    // The query ends the shoot: three internodes of 0.25 m above 0.4 m.
    let manifest: Value =
        serde_json::from_slice(&std::fs::read(outs[3].join("manifest.json")).expect("manifest")).expect("JSON");
    let plant = &manifest["assets"]
        .as_array()
        .expect("assets")
        .iter()
        .find(|a| a["kind"] == "plant")
        .expect("the plant")
        .clone();
    let top = plant["bounds"][1][1].as_f64().expect("a height");
    assert!((1.0..1.6).contains(&top) && plant["instances"].as_u64().expect("leaves") >= 12, "{plant}");

    let all = |endings: &[&str]| outs.iter().flat_map(|o| files(o, endings)).collect::<Vec<_>>();
    if let Some((node, folder)) = clients::validator() {
        let glbs = all(&[".glb"]);
        let mut command = Command::new(node);
        let out = clients::run(command.arg(clients::script("gltf_validate.mjs")).arg(folder).args(&glbs));
        let reports: Vec<Value> =
            String::from_utf8_lossy(&out.stdout).lines().map(|l| serde_json::from_str(l).expect("report")).collect();
        assert_eq!(reports.len(), glbs.len());
        for r in reports {
            assert_eq!((&r["errors"], &r["warnings"]), (&0.into(), &0.into()), "{r:#}");
        }
    }
    if let Some(python) = clients::python() {
        let stages = all(&[".usda", ".usdc"]);
        let stages: Vec<&str> = stages.iter().map(|p| arg(p)).collect();
        clients::python_script(&python, "usd_validate.py", &stages);
    }
}

/// Birches on hills in wind and rain, and seeds that leave them.
const STORM: &str = "\
    seed = 4\n[frames]\nend = 4\n[terrain]\nsize = 12\nsubdivisions = 4\namplitude = 2\n[plants.b]\n\
    grammar = \"birch.l\"\nsteps = 9\n[plants.b.bark]\nside = 64\n[plants.b.leaf]\nsize = 0.08\nside = 64\n\
    [[place]]\nplant = \"b\"\ncount = 2\nradius = 2\nindividuals = 2\n[wind]\nspeed = 7\n[rain]\n\
    rate_mm_per_h = 40\nspin_up_s = 0.3\nmax_drop_meshes = 60\n[rain.wet]\nfilm = 0.5\n[catkin]\nhairs = 60\n\
    lod = 3\n[flight]\ncount = 80\nrelease = \"canopy\"\nrelease_rate = 20\n[output]\n\
    formats = [\"usd\", \"glb\", \"unreal\"]\n[output.gltf]\nprofiles = [\"blender\", \"web\", \"engine\"]\n";

#[test]
fn rain_and_seeds_on_hills_are_in_files_for_engines() {
    let temp = tempfile::tempdir().expect("temp");
    let scene = temp.path().join("storm.toml");
    std::fs::write(&scene, STORM).expect("scene");
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&scene), "-o", arg(&out)]);
    // The ground, drops and seeds are in the scene's file, and what falls moves.
    let json = web(&out);
    let names: BTreeSet<&str> =
        json["nodes"].as_array().expect("nodes").iter().filter_map(|n| n["name"].as_str()).collect();
    for part in ["terrain", "rain_drops", "catkins"] {
        assert!(names.iter().any(|n| n.starts_with(part)), "{part}: {names:?}");
    }
    let glbs = files(&out, &[".glb"]);
    if let Some((node, folder)) = clients::validator() {
        let mut command = Command::new(node);
        let out = clients::run(command.arg(clients::script("gltf_validate.mjs")).arg(folder).args(&glbs));
        for line in String::from_utf8_lossy(&out.stdout).lines() {
            let report: Value = serde_json::from_str(line).expect("report");
            assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{report:#}");
        }
    }
    // Both viewers draw what is in the files for them, and the same.
    if let Some((node, folder)) = clients::babylon() {
        let shown: Vec<&PathBuf> = glbs.iter().filter(|f| !f.to_string_lossy().ends_with(".blender.glb")).collect();
        let mut command = Command::new(node);
        let out = clients::run(command.arg(clients::script("gltf_counts.mjs")).arg(folder).args(&shown));
        let lines: Vec<Value> =
            String::from_utf8_lossy(&out.stdout).lines().map(|l| serde_json::from_str(l).expect("counts")).collect();
        assert_eq!(lines.len(), shown.len());
        for (line, file) in lines.iter().zip(shown) {
            let drawn = triangles(&Player::new(&std::fs::read(file).expect("file")).json);
            for reader in ["three", "babylon"] {
                assert_eq!(line[reader]["triangles"].as_f64(), Some(drawn), "{reader}: {line}");
            }
        }
    }
    // Plants for Unreal Engine stand in their own files.
    if let Some(python) = clients::python() {
        let stages = files(&out.join("unreal"), &[".usdc"]);
        assert_eq!(stages.len(), 2);
        clients::python_script(&python, "usd_validate.py", &stages.iter().map(|p| arg(p)).collect::<Vec<_>>());
        clients::python_script(&python, "unreal_assembly.py", &[arg(&out), "1800"]);
    }
}

/// Triangles that a file draws, each as often as it is instanced.
fn triangles(json: &Value) -> f64 {
    let count = |accessor: &Value| {
        let index = accessor.as_u64().and_then(|i| usize::try_from(i).ok()).expect("an index");
        json["accessors"][index]["count"].as_f64().expect("a count")
    };
    let of_node = |node: &Value| {
        let Some(mesh) = node["mesh"].as_u64().and_then(|i| usize::try_from(i).ok()) else { return 0.0 };
        let primitives = json["meshes"][mesh]["primitives"].as_array().expect("primitives");
        let own: f64 = primitives.iter().filter(|p| !p["indices"].is_null()).map(|p| count(&p["indices"]) / 3.0).sum();
        let instances = &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"];
        if instances.is_null() { own } else { own * count(instances) }
    };
    json["nodes"].as_array().expect("nodes").iter().map(of_node).sum()
}
