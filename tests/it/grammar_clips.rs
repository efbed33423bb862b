//! Plants of grammars over a clip: through the steps of their derivation, with one topology in every frame and file.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests run programs and read their files")]

use std::fs;

use osier::scene::{InstancerFrame, InstancerMotion, MeshFrame, MeshMotion};
use serde_json::Value;

use crate::common::clients;
use crate::common::program::{arg, ends};
use crate::common::scene_text::{assembled, complaint, evaluated};

/// A scene of a grammar of the library that grows over nine frames.
fn scene(grammar: &str, keys: &str) -> String {
    format!(
        "[frames]\nend = 9\n[plants.a]\ngrammar = \"{grammar}\"\nsteps = 6\ngrowth_clip = [0, 1]\n{keys}\
         [[place]]\nplant = \"a\"\n[ground]\nshow = false\n"
    )
}

#[test]
fn a_frame_shows_the_plant_of_its_steps() {
    let clip = assembled(&scene("compound-leaf.l", ""));
    let asset = &clip.animated.scene.assets[0];
    assert!(asset.meshes[0].motion == MeshMotion::Deforming && asset.instancers[0].motion == InstancerMotion::Free);
    let frames = evaluated(&clip, &[1, 3, 5, 7, 9]);
    let mut heights = Vec::new();
    for frame in &frames {
        let MeshFrame::Points { points, .. } = &frame.assets[0].meshes[0] else { panic!("points of the bark") };
        assert_eq!(points.len(), asset.meshes[0].mesh.points.len());
        let InstancerFrame::State(leaves) = &frame.assets[0].instancers[0] else { panic!("leaves") };
        assert_eq!(leaves.positions.len(), asset.instancers[0].len());
        heights.push(points.iter().map(|p| p.y).fold(0.0, f32::max));
    }
    // Of six steps the frame in the middle shows three, the last one all of them.
    let still = |steps: u32| {
        let text =
            scene("compound-leaf.l", "").replace("steps = 6\ngrowth_clip = [0, 1]\n", &format!("steps = {steps}\n"));
        let still = assembled(&text);
        let points = &still.animated.scene.assets[0].meshes[0].mesh.points;
        points.iter().map(|p| p.y).fold(0.0, f32::max)
    };
    assert!((heights[2] - still(3)).abs() < 0.02 * still(3), "{heights:?} {}", still(3));
    assert!((heights[4] - still(6)).abs() < 1e-3 * still(6), "{heights:?} {}", still(6));
}

#[test]
fn bakes_of_a_developing_plant_have_one_topology() {
    let temp = tempfile::tempdir().expect("temp");
    let file = temp.path().join("g.toml");
    fs::write(&file, scene("birch.l", "") + "[output]\nformats = [\"glb\", \"usd\"]\n").expect("scene");
    let out = temp.path().join("out");
    ends(0, &["-q", "bake", arg(&file), "-o", arg(&out)]);
    // glTF: the bark is one primitive with one list of indices, and its shapes have as many points as it has.
    let path = crate::common::program::tree(&out);
    let (_, glb) = path.iter().find(|(name, _)| name.ends_with(".glb")).expect("a glb");
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let meshes = json["meshes"].as_array().expect("meshes");
    let bark: Vec<&Value> = meshes.iter().filter(|m| m["name"].as_str().is_some_and(|n| n.contains("bark"))).collect();
    assert_eq!(bark.len(), 1, "{}", json["meshes"]);
    let primitives = bark[0]["primitives"].as_array().expect("primitives");
    let number = |accessor: &Value| usize::try_from(accessor.as_u64().expect("a number")).expect("small");
    let count = |accessor: &Value| json["accessors"][number(accessor)]["count"].clone();
    for primitive in primitives {
        let points = count(&primitive["attributes"]["POSITION"]);
        let targets = primitive["targets"].as_array().expect("shapes of the clip");
        assert!(targets.len() > 1 && targets.iter().all(|t| count(&t["POSITION"]) == points));
    }
    // USD in Blender: one object, the same faces in all frames, and more of it from frame to frame.
    let Some(python) = clients::python() else { return };
    let stage = out.join("g.usda");
    let numbers: Vec<String> = (2..=9).map(|n: u32| n.to_string()).collect();
    let arguments: Vec<&str> = [arg(&stage)].into_iter().chain(numbers.iter().map(String::as_str)).collect();
    let output = clients::python_script(&python, "growth_clip.py", &arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    let frames: Vec<Value> = serde_json::from_str(text.trim_end().lines().last().expect("a line")).expect("JSON");
    for pair in frames.windows(2) {
        assert!(pair[1]["barks"] == 1 && pair[0]["topology"] == pair[1]["topology"]);
        assert!(pair[1]["height"].as_f64().expect("m") > pair[0]["height"].as_f64().expect("m"));
    }
}

#[test]
fn plants_whose_steps_have_no_parts_are_unveiled() {
    let temp = tempfile::tempdir().expect("temp");
    let said = |grammar: &str, keys: &str| {
        fs::write(temp.path().join("g.l"), grammar).expect("grammar");
        let text = scene("g.l", keys);
        fs::write(temp.path().join("g.toml"), text).expect("scene");
        let (out, err) = ends(0, &["check", arg(&temp.path().join("g.toml"))]);
        format!("{out}{err}")
    };
    let asks = "Lsystem: 1\nderivation length: 6\nAxiom: F(1)?P(0,0,0)A\nA --> F(1)?P(0,0,0)A\nendlsystem\n";
    let text = said(asks, "");
    assert!(text.contains("S007") && text.contains("queried"), "{text}");
    assert!(!said(asks, "clip_steps = \"unveil\"\n").contains("S007"));
    // Keys without effect are told.
    let still = scene("birch.l", "clip_steps = \"whole\"\n").replace("growth_clip = [0, 1]\n", "");
    assert!(complaint(&still).contains("clip_steps"), "{}", complaint(&still));
}
