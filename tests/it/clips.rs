//! A clip of 120 frames of a swaying tree in every form that carries motion, as both Blenders play it: every vertex at
//! frames 1, 60 and 120 against osier's own.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]

use crate::common::clients;
use crate::common::expect;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use crate::common::gltf_objects::{alone, objects};
use osier::bake::scene::AnimatedScene;
use osier::bake::scene::{SceneOptions, assemble_scene};
use osier::bake::{BakeContext, motion};
use osier::limits::Limits;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Request, resolve};
use osier::scene::{Frame, MeshFrame};
use serde_json::{Value, json};

const TREE: &str = r#"
[frames]
end = 120
fps = 30
[plants.tree]
ifs = "sympodial.ifs.toml"
[plants.tree.tree]
eps = 0.2
[plants.tree.bark]
side = 64
[[place]]
plant = "tree"
at = [1.5, 0, -2]
turn_deg = 40
scale = 0.8
[wind]
speed = 8
[ground]
show = false
[output.gltf]
profiles = ["blender", "web"]
assets = true
[output.usd]
copies = "references"
tolerance_mm = 0
turn_tolerance_deg = 0
"#;

const NUMBERS: [u32; 3] = [1, 60, 120];

/// The stage as the library has it.
fn stage(text: &str, motion: &str) -> AnimatedScene {
    let set = vec![format!("plants.tree.motion=\"{motion}\"")];
    let request = Request { name: "tree".into(), text: text.into(), set, ..Request::default() };
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    assemble_scene(&resolve(&request).expect("scene").0, SceneOptions::default(), &work).expect("stage").animated
}

fn frames(stage: &AnimatedScene) -> Vec<Frame> {
    NUMBERS.map(|n| motion::evaluate_frame(&stage.scene, &stage.motions, n, true).expect("a frame")).to_vec()
}

/// The same from the program.
fn bake(folder: &Path, text: &str, motion: &str, formats: &str) {
    std::fs::write(folder.join("tree.toml"), text).expect("scene");
    let mut osier = Command::new(env!("CARGO_BIN_EXE_osier"));
    osier.current_dir(folder).args(["-q", "bake", "tree.toml", "-o", motion, "--formats", formats]);
    clients::run(osier.args(["--set", &format!("plants.tree.motion=\"{motion}\"")]));
}

/// What `showcase.py` looks for: every vertex.
fn wanted(stage: &AnimatedScene) -> Value {
    let scene = &stage.scene;
    let all = expect::expect(scene, &frames(stage), &NUMBERS);
    let mut at = all["frames"].clone();
    for frame in at.as_object_mut().expect("frames").values_mut() {
        for points in frame["meshes"].as_object_mut().expect("meshes").values_mut() {
            *points = json!({"count": points.as_array().map(Vec::len), "points": points.take()});
        }
        frame["instancers"] = json!({});
    }
    let asset = &scene.assets[0];
    let prototypes = asset.instancers.iter().flat_map(|i| &i.prototypes).map(|p| &p.mesh);
    let worn = asset.meshes.iter().map(|m| &m.mesh).chain(prototypes).flat_map(|m| &m.subsets).map(|s| s.material);
    let materials: Vec<&str> = worn.map(|m| scene.materials[m as usize].name.as_str()).collect();
    json!({"usd": {"start": 1, "end": 120, "fps": scene.clip.fps(), "materials": materials, "frames": at}})
}

/// Of a tree that moves through 120 frames: the first frame must not pass for all.
fn moves(stage: &AnimatedScene) {
    let [a, b] = [1, 60].map(|n| expect::expect(&stage.scene, &frames(stage), &[n]));
    assert_ne!(a["frames"]["1"]["meshes"], b["frames"]["60"]["meshes"]);
}

/// Bakes a scene to USD and has Blender 5 compare every vertex; the wrapper's text.
fn judged(python: &Path, text: &str, (motion, stage): (&str, &AnimatedScene)) -> String {
    let dir = tempfile::tempdir().expect("dir");
    bake(dir.path(), text, motion, "usd");
    let file = dir.path().join("expected.json");
    std::fs::write(&file, wanted(stage).to_string()).expect("expectations");
    let usd = dir.path().join(motion).join("tree.usda");
    let arguments = [&usd, &file].map(|p| p.to_string_lossy().into_owned());
    let said = clients::python_script(python, "showcase.py", &["usd", &arguments[0], &arguments[1]]);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.contains("\"worst\""), "{motion}: {said}");
    std::fs::read_to_string(&usd).expect("wrapper")
}

#[test]
fn blender_5_plays_the_stage_cached_and_skinned() {
    let Some(python) = clients::python() else { return };
    for motion in ["cache", "skin"] {
        let stage = stage(TREE, motion);
        moves(&stage);
        judged(&python, TREE, (motion, &stage));
    }
}

/// Copies at rest are held once; copies of a cache, some of them at one phase, some not, must not be: Blender mixes them up.
#[test]
fn blender_5_plays_copies_with_phases_and_shares_those_at_rest() {
    let Some(python) = clients::python() else { return };
    let text = TREE.replace("at = [1.5, 0, -2]", "count = 8\nindividuals = 1\nradius = 4");
    for (motion, shared) in [("cache", 0), ("still", 8)] {
        let stage = stage(&text, motion);
        let phases = stage.scene.placements.iter().map(|p| p.phase).collect::<BTreeSet<_>>();
        assert!(shared > 0 || (2..8).contains(&phases.len()), "some alike, some not: {phases:?}");
        let wrapper = judged(&python, &text, (motion, &stage));
        assert_eq!(wrapper.matches("instanceable = true").count(), shared);
    }
}

/// The file of joints, and the cache that replaces them at every vertex.
fn jobs(folder: &Path) -> Value {
    let job = |motion: &str, object: Option<&str>| {
        let stage = stage(TREE, motion);
        let scene = alone(&stage.scene, 0);
        bake(folder, TREE, motion, "glb,pc2");
        let frames = frames(&stage);
        for frame in &frames {
            assert_eq!(matches!(frame.assets[0].mesh(0), MeshFrame::Points { .. }), motion == "cache");
        }
        let mut at = objects(&scene, &frames, &NUMBERS, false);
        for list in at.as_object_mut().expect("frames").values_mut() {
            list.as_object_mut().expect("objects").retain(|name, _| name == "bark");
        }
        let path = |p: &str| folder.join(motion).join(p).to_string_lossy().into_owned();
        let cache = object.map(|o| json!({"object": o, "pc2": path("cache/tree_1.pc2")}));
        json!({"file": path("gltf/tree_1.blender.glb"), "fps": scene.clip.fps(), "start": 1, "frames": at, "cache": cache})
    };
    json!([job("skin", None), job("cache", Some("bark"))])
}

fn judge(run: impl Fn(&str) -> std::process::Output) {
    let dir = tempfile::tempdir().expect("dir");
    let jobs = jobs(dir.path());
    let file = dir.path().join("jobs.json");
    std::fs::write(&file, jobs.to_string()).expect("jobs");
    let said = run(&file.to_string_lossy());
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert_eq!(said.lines().filter(|l| l.contains("\"worst\"")).count(), 2, "{said}");
}

#[test]
fn blender_5_plays_joints_and_point_caches() {
    let Some(python) = clients::python() else { return };
    judge(|jobs| clients::python_script(&python, "blender_gltf.py", &[jobs]));
}

#[test]
fn blender_3_4_plays_joints_and_point_caches() {
    let Some(blender) = clients::blender() else { return };
    judge(|jobs| clients::blender_script(&blender, "blender_gltf.py", &[jobs]));
}
