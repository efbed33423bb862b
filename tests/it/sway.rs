//! Swaying scenes as a user bakes them.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "helpers of tests")]
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "indices of short lists")]
#![allow(clippy::print_stdout, reason = "figures that documents quote")]

use std::fs;
use std::path::Path;

use crate::common::clients;
use assert_cmd::Command;
use osier::bake::scene::{SceneOptions, assemble_scene};
use osier::bake::{BakeContext, motion};
use osier::limits::Limits;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Request, resolve};

const TREE: &str = r#"
[frames]
end = 60
[plants.t]
ifs = "sympodial.ifs.toml"
motion = "cache"
[plants.t.tree]
eps = 0.2
[plants.t.bark]
side = 64
[[place]]
plant = "t"
count = 5
individuals = 1
radius = 20
[wind]
speed = 6
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

fn bake(dir: &Path, out: &str, threads: &str) -> String {
    fs::write(dir.join("t.toml"), TREE).expect("scene");
    let mut osier = Command::cargo_bin("osier").expect("osier");
    let args = ["-q", "--jobs", threads, "bake", "t.toml", "-o", out, "--formats", "usd,glb,pc2"];
    osier.current_dir(dir).args(args).assert().success();
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.join(out).join("manifest.json")).expect("manifest")).expect("json");
    manifest["bake_hash"].as_str().expect("hash").to_owned()
}

#[test]
fn same_bytes_at_any_number_of_threads() {
    let dir = tempfile::tempdir().expect("dir");
    let one = bake(dir.path(), "one", "1");
    assert_eq!(one, bake(dir.path(), "two", "2"));
    assert_eq!(one, bake(dir.path(), "five", "5"));
}

fn stage(set: &[&str]) -> osier::bake::scene::AnimatedScene {
    let set = set.iter().map(|s| (*s).to_owned()).collect();
    let request = Request { name: "t".into(), text: TREE.into(), set, ..Request::default() };
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    assemble_scene(&resolve(&request).expect("scene").0, SceneOptions::default(), &work).expect("stage").animated
}

#[test]
fn copies_downwind_show_what_copies_upwind_showed_before() {
    let stage = stage(&[]);
    let shown: Vec<(f32, u32)> = stage.scene.placements.iter().map(|p| (p.transform.t.x, p.phase)).collect();
    assert!(shown.iter().map(|s| s.1).collect::<std::collections::BTreeSet<_>>().len() > 2, "{shown:?}");
    assert_eq!(shown[0].1, 0, "the first copy is the one that was simulated");
    for (x, phase) in &shown {
        // 6 m/s, 24 frames a second, 60 frames; one of twelve phases.
        let wanted = ((shown[0].0 - x) / 6.0 * 24.0).rem_euclid(60.0);
        let apart = (wanted - *phase as f32).abs();
        assert!(apart.min(60.0 - apart) <= 2.51, "{x} m: {phase}, wanted {wanted}");
    }
    let frame = motion::evaluate_frame(&stage.scene, &stage.motions, 5, true).expect("a frame");
    let late = stage.scene.placements.iter().find(|p| p.phase > 0).expect("a later copy");
    let later = motion::evaluate_frame(&stage.scene, &stage.motions, 5 + late.phase, false).expect("a frame");
    let points = |f: &osier::scene::AssetFrame| match f.mesh(0) {
        osier::scene::MeshFrame::Points { points, .. } => points.clone(),
        _ => panic!("a cache"),
    };
    assert_eq!(points(frame.shown(late).expect("state")), points(&later.assets[late.asset]));
}

#[test]
fn offsets_of_copies_follow_the_gusts_and_not_the_air() {
    let phases = |text: &str, set: &[&str]| -> Vec<u32> {
        let set = set.iter().map(|s| (*s).to_owned()).collect();
        let request = Request { name: "t".into(), text: text.into(), set, ..Request::default() };
        let work =
            BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
        let stage =
            assemble_scene(&resolve(&request).expect("scene").0, SceneOptions::default(), &work).expect("stage");
        stage.animated.scene.placements.iter().map(|p| p.phase).collect()
    };
    // Gusts travel at 6 m/s, whatever the factor on their velocities and a steady wind beneath them.
    let own = phases(TREE, &["sway.phases=60"]);
    assert_eq!(phases(TREE, &["sway.phases=60", "wind.scale=2"]), own);
    let steady = format!("{TREE}[[wind.add]]\nmodel = \"uniform\"\nspeed = 3\n");
    assert_eq!(phases(&steady, &["sway.phases=60"]), own);
    assert_ne!(phases(TREE, &["sway.phases=60", "wind.speed=12"]), own);
}

#[test]
fn one_phase_is_for_all_and_clips_that_run_on_have_none() {
    for set in [&["sway.phases=1"][..], &["sway.repeat=false"]] {
        assert!(stage(set).scene.placements.iter().all(|p| p.phase == 0), "{set:?}");
    }
}

#[test]
fn a_clip_from_rest_begins_at_rest_and_then_moves() {
    let stage = stage(&["sway.repeat=false", "sway.start=\"rest\""]);
    let points = |n: u32| match motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame").assets
        [0]
    .mesh(0)
    {
        osier::scene::MeshFrame::Points { points, .. } => points.clone(),
        _ => panic!("a cache"),
    };
    let rest = &stage.scene.assets[0].meshes[0].mesh.points;
    let far = |n: u32| points(n).iter().zip(rest).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(far(1) < 1e-5 && far(30) > 1e-3, "{} {}", far(1), far(30));
}

#[test]
fn velocities_at_the_ends_of_a_clip_are_those_of_the_motion() {
    let stage = stage(&["sway.repeat=false"]);
    let state = |n: u32| match motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame").assets
        [0]
    .mesh(0)
    {
        osier::scene::MeshFrame::Points { points, velocities, .. } => (points.clone(), velocities.clone()),
        _ => panic!("a cache"),
    };
    // A difference over the first or the last frame of the 60, at 24 frames a second.
    for (at, from, to) in [(1, 1, 2), (60, 59, 60)] {
        let ((before, _), (after, _), (_, velocities)) = (state(from), state(to), state(at));
        let wanted: Vec<glam::Vec3> = before.iter().zip(&after).map(|(a, b)| (*b - *a) * 24.0).collect();
        let fastest = wanted.iter().map(|v| v.length()).fold(0.0, f32::max);
        assert!(fastest > 1e-4 && apart(&wanted, &velocities) < 0.05 * fastest, "{at}: {fastest}");
    }
}

#[test]
fn the_papers_equations_move_once_they_are_mended() {
    let far = |set: &[&str]| {
        let stage = stage(set);
        let rest = &stage.scene.assets[0].meshes[0].mesh.points;
        let of = |n: u32| match motion::evaluate_frame(&stage.scene, &stage.motions, n, false).expect("a frame").assets
            [0]
        .mesh(0)
        {
            osier::scene::MeshFrame::Points { points, .. } => points.clone(),
            _ => panic!("a cache"),
        };
        let (a, b) = (of(10), of(40));
        let most =
            |x: &[glam::Vec3], y: &[glam::Vec3]| x.iter().zip(y).map(|(p, q)| p.distance(*q)).fold(0.0, f32::max);
        (most(&a, rest), most(&a, &b))
    };
    let mended = far(&["sway.model=paper", "wind.model=perlin"]);
    assert!(mended.0 > 5e-5 && mended.1 > 1e-5, "{mended:?}");
    let printed = far(&["sway.model=paper", "wind.model=perlin", "wind.literal=true", "sway.paper_fixes=[]"]);
    assert!(printed.0 < 2e-6, "as printed, nothing is seen to move: {printed:?}");
}

#[test]
fn plants_on_rods_start_at_rest_also_in_a_wind_that_repeats() {
    let text = r#"
[frames]
end = 60
[plants.t]
grammar = "rain-twig.l"
[plants.t.bark]
side = 16
[plants.t.shoot]
side = 16
[plants.t.rods]
[[place]]
plant = "t"
[wind]
model = "uniform"
speed = 6
[ground]
show = false
"#;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let far = |start: &str, fps: &str| {
        let set = vec![format!("sway.start={start}"), format!("frames.fps={fps}")];
        let request = Request { name: "t".into(), text: text.into(), set, ..Request::default() };
        let recipe = resolve(&request).expect("scene").0;
        let stage = assemble_scene(&recipe, SceneOptions::default(), &work).expect("stage").animated;
        let frame = motion::evaluate_frame(&stage.scene, &stage.motions, 1, false).expect("a frame");
        let rest = &stage.scene.assets[0].skeleton.as_ref().expect("joints").joints;
        let moved = frame.assets[0].pose.iter().zip(rest).map(|(now, joint)| now.t.distance(joint.rest.t));
        moved.fold(0.0, f32::max)
    };
    let [rest, moving] = ["rest", "moving"].map(|start| far(start, "24"));
    assert!(rest < 1e-6 && moving > 2e-3, "{rest} {moving}");
    // Also where a frame lasts longer than twice the spin-up of two seconds.
    let slow = far("moving", "0.24");
    assert!(slow > 2e-3, "{slow}");
}

#[test]
fn a_still_plant_on_rods_is_told_of_leaves_without_petioles() {
    let text = r#"
[plants.t]
grammar = "rain-twig.l"
motion = "still"
[plants.t.bark]
side = 16
[plants.t.shoot]
side = 16
[plants.t.rods]
max_leaves = 1
[ground]
show = false
"#;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let codes = |set: &str| {
        let request = Request { name: "t".into(), text: text.into(), set: vec![set.into()], ..Request::default() };
        let recipe = resolve(&request).expect("scene").0;
        let report = assemble_scene(&recipe, SceneOptions::default(), &work).expect("stage").report;
        report.diagnostics.iter().map(|d| d.code).collect::<Vec<_>>()
    };
    assert_eq!(codes("plants.t.rods.max_leaves=1"), ["S043"]);
    assert!(codes("plants.t.rods.max_leaves=50").is_empty());
}

fn said(text: &str, set: &[&str]) -> String {
    let set = set.iter().map(|s| (*s).to_owned()).collect();
    let request = Request { name: "t".into(), text: text.into(), set, ..Request::default() };
    match resolve(&request) {
        Ok((_, report)) => report.diagnostics.iter().map(|d| format!("{} {}", d.code, d.message)).collect(),
        Err(osier::Error::Input(report)) => {
            report.diagnostics.iter().map(|d| format!("{} {}", d.code, d.message)).collect()
        }
        Err(e) => panic!("{e}"),
    }
}

#[test]
fn what_has_no_effect_or_cannot_be_is_said() {
    assert_eq!(said(TREE, &[]), "");
    assert!(said(TREE, &["wind.beaufort=5"]).starts_with("S007 wind.beaufort is 5, but wind.speed is given"));
    // An override cannot leave out the speed of the scene.
    let set = vec!["wind.beaufort=5".to_owned()];
    let request = Request { name: "t".into(), text: TREE.into(), set, ..Request::default() };
    let (_, report) = resolve(&request).expect("a warning");
    assert!(report.to_string().contains("write wind.speed = 9.3 for this wind"), "{report}");
    assert!(said(TREE, &["wind.literal=true"]).starts_with("S007 `wind.literal` needs `model = \"perlin\"`"));
    assert!(said(TREE, &["frames.end=20", "sway.repeat=true"]).starts_with("S004 a clip of 0.83 s is too short"));
    assert!(said(TREE, &["wind.speed=61"]).starts_with("S004"));
    assert!(said(TREE, &["sway.loop=2.03"]).starts_with("S008 sway.loop is 2.03 s, which is 48.72 frames"));
    assert!(said(TREE, &["sway.loop=1.5"]).starts_with("S004"), "two seconds at least");
    assert!(
        said(TREE, &["frames.fps=0.5", "sway.loop=2"])
            .starts_with("S004 sway.loop is 2 s, less than two frames at 0.5 frames per second")
    );
    assert!(said(TREE, &["sway.loop=4", "sway.repeat=false"]).starts_with("S007 sway.loop"));
    assert!(said(TREE, &["wind.gust_length=40"]).starts_with("S008 wind.gust_length is 40 m"));
    assert_eq!(said(TREE, &["wind.gust_length=3.75"]), "", "four of them pass in 2.5 s");
    assert_eq!(said(TREE, &["wind.gust_length=40", "sway.repeat=false"]), "");
    let added = format!("{TREE}[[wind.add]]\nspeed = 3\nbeaufort = 2\n[[wind.add]]\nsped = 3\n");
    assert!(said(&added, &[]).starts_with("S007 wind.add.0.beaufort is 2"), "{}", said(&added, &[]));
    assert!(said(&added, &[]).contains("S002 [wind.add.1] has no key \"sped\""));
    for set in [
        &["sway.paper_damping=0.2"][..],
        &["sway.model=paper", "sway.lean=2"],
        &["wind.model=uniform", "wind.gust=0.3"],
        &["wind.model=perlin", "wind.turbulence=0.3"],
        &["wind.model=perlin", "wind.literal=true", "wind.gust=0.3"],
        &["sway.start=rest"],
    ] {
        assert!(said(TREE, set).starts_with("S007"), "{set:?}: {}", said(TREE, set));
    }
    assert_eq!(said(TREE, &["sway.start=rest", "sway.repeat=false", "sway.lean=2"]), "");
    let rods = "[plants.r]\ngrammar = \"rain-twig.l\"\n[plants.r.rods]\n[plants.r.wood]\nhz_scale = 2\n";
    assert_eq!(said(rods, &[]), "S007 plants.r.wood.hz_scale has no effect");
    let gusts = format!("{TREE}[[wind.add]]\nspeed = 2\n[[wind.add]]\nspeed = 2\ngust_length = 30\n");
    assert!(said(&gusts, &[]).starts_with("S008 wind.add.1.gust_length is 30 m"), "{}", said(&gusts, &[]));
    assert!(said(TREE, &["sway.paper_recoil=1"]).starts_with("S004"), "the recursion would never end");
}

#[test]
fn a_bake_says_what_blender_does_not_read() {
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("t.toml"), TREE).expect("scene");
    let said = |fps: &str| {
        let mut osier = Command::cargo_bin("osier").expect("osier");
        let args =
            ["bake", "t.toml", "-o", fps, "--formats", "usd", "--frames", "1-2", "--set", "sway.phases=1", "--set"];
        let out = osier.current_dir(dir.path()).args(args).arg(format!("frames.fps={fps}")).assert().success();
        String::from_utf8_lossy(&out.get_output().stdout).into_owned()
    };
    assert!(said("30").contains("first set Output > Frame Rate to 30"));
    assert!(!said("24").contains("Frame Rate"));
    // 24000 frames in 1001 s.
    assert!(said("23.976").contains("Frame Rate to 23.976)"));
}

fn points(stage: &osier::bake::scene::AnimatedScene, number: u32) -> Vec<glam::Vec3> {
    match motion::evaluate_frame(&stage.scene, &stage.motions, number, false).expect("a frame").assets[0].mesh(0) {
        osier::scene::MeshFrame::Points { points, .. } => points.clone(),
        _ => panic!("a cache"),
    }
}

fn apart(a: &[glam::Vec3], b: &[glam::Vec3]) -> f32 {
    a.iter().zip(b).map(|(p, q)| p.distance(*q)).fold(0.0, f32::max)
}

#[test]
fn a_loop_comes_round_within_the_clip() {
    let stage = stage(&["sway.loop=2", "frames.end=120"]);
    assert_eq!(points(&stage, 3), points(&stage, 51));
    assert!(apart(&points(&stage, 3), &points(&stage, 27)) > 1e-4);
    assert!(stage.scene.placements.iter().all(|p| p.phase == 0));
}

#[test]
fn leaves_come_round_with_the_loop_in_every_wind() {
    let text = r#"
[frames]
end = 60
[plants.t]
grammar = "poplar-twig.l"
steps = 10
[plants.t.bark]
side = 16
[plants.t.shoot]
side = 16
[[place]]
plant = "t"
[sway]
loop = 2
[ground]
show = false
"#;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    for model in ["gust", "uniform"] {
        let set = vec![format!("wind.model={model}"), "wind.speed=6".to_owned()];
        let request = Request { name: "t".into(), text: text.into(), set, ..Request::default() };
        let recipe = resolve(&request).expect("scene").0;
        let stage = assemble_scene(&recipe, SceneOptions::default(), &work).expect("stage").animated;
        let turns = |number: u32| {
            let frame = motion::evaluate_frame(&stage.scene, &stage.motions, number, false).expect("a frame");
            match frame.assets[0].instancer(0) {
                osier::scene::InstancerFrame::State(state) => state.orientations.clone(),
                osier::scene::InstancerFrame::Same => panic!("leaves flutter"),
            }
        };
        // Largest 1 - cos of half the angle between the rotations of a leaf; 1e-3 is an angle of 5 degrees.
        let apart = |a: &[glam::Quat], b: &[glam::Quat]| {
            a.iter().zip(b).map(|(p, q)| 1.0 - p.dot(*q).abs()).fold(0.0, f32::max)
        };
        let (now, a_loop_later, half_a_loop_later) = (turns(3), turns(51), turns(27));
        assert!(apart(&now, &a_loop_later) < 1e-5, "{model}: {}", apart(&now, &a_loop_later));
        assert!(apart(&now, &half_a_loop_later) > 1e-3, "{model}: {}", apart(&now, &half_a_loop_later));
    }
}

#[test]
fn winds_of_a_scene_add_up() {
    let still = TREE.replace("speed = 6", "model = \"uniform\"\nspeed = 6");
    let of = |text: &str, set: &[&str]| {
        let set = set.iter().map(|s| (*s).to_owned()).collect();
        let request = Request { name: "t".into(), text: text.into(), set, ..Request::default() };
        let work =
            BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
        assemble_scene(&resolve(&request).expect("scene").0, SceneOptions::default(), &work).expect("stage").animated
    };
    let one = of(&still, &["wind.speed=12"]);
    let two = of(&format!("{still}[[wind.add]]\nmodel = \"uniform\"\nspeed = 6\n"), &[]);
    let twice = of(&still, &["wind.scale=2"]);
    assert!(apart(&points(&one, 9), &points(&two, 9)) < 1e-6 && apart(&points(&one, 9), &points(&twice, 9)) < 1e-6);
    let against = of(&format!("{still}[[wind.add]]\nmodel = \"uniform\"\nspeed = 6\ndirection_deg = 180\n"), &[]);
    let rest = &against.scene.assets[0].meshes[0].mesh.points;
    assert!(apart(&points(&against, 9), rest) < 1e-5, "two winds against each other");
    assert!(apart(&points(&one, 9), rest) > 1e-3);
}

#[test]
fn each_way_to_bend_moves_the_tree_differently() {
    let plain = points(&stage(&[]), 20);
    for set in ["sway.modes=2", "sway.profile=measured", "sway.gravity_change=true"] {
        let changed = apart(&points(&stage(&[set]), 20), &plain);
        assert!(changed > 1e-6 && changed < 0.1, "{set}: {changed}");
    }
}

#[test]
fn a_part_of_a_clip_that_copies_need_whole_is_refused() {
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("t.toml"), TREE).expect("scene");
    let mut osier = Command::cargo_bin("osier").expect("osier");
    let run = osier.current_dir(dir.path()).args(["bake", "t.toml", "-n", "--frames", "1-30"]).assert().code(2);
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(said.contains("copies are animated with a phase offset") && said.contains("sway.phases=1"), "{said}");
    // Tables of joints have the frame of each copy, whether or not it is written.
    let mut osier = Command::cargo_bin("osier").expect("osier");
    let points = ["bake", "t.toml", "-n", "--frames", "1-30", "--formats", "points"];
    osier.current_dir(dir.path()).args(points).assert().success();
}

#[test]
fn internodes_that_the_paper_bends_too_far_are_counted() {
    let set = [
        "sway.model=paper",
        "wind.model=perlin",
        "wind.speed=60",
        "plants.t.wood.elasticity_gpa=0.1",
        "plants.t.wood.stiffness=0.05",
    ];
    let set = set.iter().map(|s| (*s).to_owned()).collect();
    let request = Request { name: "t".into(), text: TREE.into(), set, ..Request::default() };
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let built = assemble_scene(&resolve(&request).expect("scene").0, SceneOptions::default(), &work).expect("stage");
    let said: Vec<&str> = built.report.diagnostics.iter().map(|d| d.code).collect();
    assert_eq!(said, ["X020"]);
}

#[test]
fn what_a_bake_will_take_is_told_beforehand() {
    let dir = tempfile::tempdir().expect("dir");
    for (motion, formats) in [("cache", "usd,pc2,pov"), ("skin", "usd,glb,pov")] {
        fs::write(dir.path().join("t.toml"), TREE.replace("\"cache\"", &format!("\"{motion}\""))).expect("scene");
        let osier = |args: &[&str]| {
            let mut osier = Command::cargo_bin("osier").expect("osier");
            let common = ["--json", "bake", "t.toml", "-o", motion, "--formats", formats];
            let run = osier.current_dir(dir.path()).args(common).args(args).assert().success();
            serde_json::from_slice::<serde_json::Value>(&run.get_output().stdout).expect("json")
        };
        let told = osier(&["-n"])["would_make"].clone();
        osier(&[]);
        let text = fs::read(dir.path().join(motion).join("manifest.json")).expect("manifest");
        let manifest: serde_json::Value = serde_json::from_slice(&text).expect("json");
        for (format, folder) in [("usd", "usd/"), ("glb", "gltf/"), ("pov", "pov/"), ("pc2", "cache/")] {
            let of = |f: &serde_json::Value| {
                let inside = f["path"].as_str().is_some_and(|p| p.starts_with(folder));
                if inside { f["bytes"].as_u64().unwrap_or(0) } else { 0 }
            };
            let written: u64 = manifest["files"].as_array().expect("files").iter().map(of).sum();
            let Some(told) = told["sizes"][format].as_u64() else { continue };
            let ratio = told as f64 / written as f64;
            assert!((0.6..1.7).contains(&ratio), "{motion} as {format}: {told} told, {written} written");
        }
    }
}

#[test]
fn a_very_large_bake_wants_to_be_asked_for() {
    let dir = tempfile::tempdir().expect("dir");
    let text = TREE.replace("end = 60", "end = 30000").replace("eps = 0.2", "eps = 0.1");
    fs::write(dir.path().join("t.toml"), text).expect("scene");
    let mut osier = Command::cargo_bin("osier").expect("osier");
    let run =
        osier.current_dir(dir.path()).args(["bake", "t.toml", "--formats", "usd", "--max-motion-keys", "1000000000"]);
    let run = run.args(["--set", "plants.t.max_branches=2", "--set", "sway.loop=2"]).assert().code(2);
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(said.contains("more than 2.0 GB") && said.contains("--force"), "{said}");
    assert!(!dir.path().join("out/t/manifest.json").exists());
}

#[test]
fn engines_get_few_joints_merged_leaves_and_attributes() {
    let dir = tempfile::tempdir().expect("dir");
    for (motion, moves) in [("game", true), ("static", false)] {
        fs::write(dir.path().join("t.toml"), TREE.replace("\"cache\"", &format!("\"{motion}\""))).expect("scene");
        let mut osier = Command::cargo_bin("osier").expect("osier");
        osier
            .current_dir(dir.path())
            .args(["-q", "bake", "t.toml", "-o", motion, "--formats", "glb,usd"])
            .assert()
            .success();
        let bytes = fs::read(dir.path().join(motion).join("gltf/t.blender.glb")).expect("glb");
        let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four")) as usize;
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("json");
        let primitives: Vec<&serde_json::Value> = json["meshes"]
            .as_array()
            .expect("meshes")
            .iter()
            .flat_map(|m| m["primitives"].as_array().expect("list"))
            .collect();
        assert!(primitives.len() >= 2, "bark and leaves");
        for p in &primitives {
            let place = |name: &str| p["attributes"][name].as_u64().and_then(|i| usize::try_from(i).ok());
            let accessor = |name: &str| &json["accessors"][place(name).expect("attribute")];
            assert_eq!(
                (accessor("_WIND")["type"].as_str(), accessor("_WIND2")["type"].as_str()),
                (Some("VEC4"), Some("VEC4"))
            );
            assert_eq!(accessor("_WIND")["count"], accessor("POSITION")["count"]);
            assert_eq!(p["attributes"]["JOINTS_0"].is_u64(), moves, "{motion}");
        }
        assert_eq!(json["animations"].is_array(), moves, "{motion}");
        if moves {
            let joints = json["skins"][0]["joints"].as_array().expect("joints").len();
            assert!((2..=64).contains(&joints), "{joints}");
        }
    }
}

/// The showcase's trees alone, in its wind.
fn trees_of_the_showcase() -> String {
    let text = osier::presets::find("showcase.toml").expect("preset").text;
    let mut kept = String::new();
    // Tables begin at a line with a bracket.
    for table in text.split("\n[").enumerate().map(|(k, t)| if k == 0 { t.to_owned() } else { format!("\n[{t}") }) {
        let other = |name: &str| table.contains(&format!("plants.{name}")) || table.contains(&format!("\"{name}\""));
        if !["far_oak", "far_birch", "poplar_twig", "grass", "tall_grass"].into_iter().any(other)
            && !table.starts_with("\n[ground]")
        {
            kept.push_str(&table);
        }
    }
    kept + "\n[ground]\nshow = false\n"
}

#[test]
fn boughs_of_one_size_sway_alike_in_amount_and_unlike_in_phase() {
    let Some(python) = clients::python() else { return };
    let dir = tempfile::tempdir().expect("dir");
    fs::write(dir.path().join("trees.toml"), trees_of_the_showcase()).expect("scene");
    let mut osier = Command::cargo_bin("osier").expect("osier");
    osier
        .current_dir(dir.path())
        .args(["-q", "bake", "trees.toml", "-o", "out", "--formats", "usd"])
        .assert()
        .success();
    let file = dir.path().join("out/trees.usda");
    let said = clients::python_script(&python, "sway_amplitudes.py", &[&file.to_string_lossy(), "3"]);
    let text = String::from_utf8_lossy(&said.stdout).into_owned();
    let line = text.lines().rev().find(|l| l.starts_with('{')).expect("a report");
    let report: serde_json::Value = serde_json::from_str(line).expect("JSON");
    let meshes = report["meshes"].as_object().expect("trees");
    assert_eq!(meshes.len(), 3, "an oak and two birches");
    let mut compared = 0;
    for (name, tree) in meshes {
        for class in tree["classes"].as_array().expect("classes") {
            let pairs = class["correlation"].as_array().expect("by distance");
            let many = pairs.iter().filter(|p| p[1].as_u64().is_some_and(|n| n >= 300));
            let by_distance: Vec<f64> = many.filter_map(|p| p[0].as_f64()).collect();
            if let (Some(near), Some(far)) = (by_distance.first(), by_distance.last()) {
                assert!(by_distance.len() < 2 || near > far, "{name}: {class}");
                compared += usize::from(by_distance.len() > 1);
            }
            // Shorter wood is twigs, whose place on the limb decides how far they are carried.
            if class["length"][0].as_f64().is_none_or(|m| m < BOUGH) {
                continue;
            }
            assert!(class["ratio"].as_f64().is_some_and(|r| r <= 3.0), "{name}: {class}");
            assert!(class["amplitude"]["p100"].as_f64().is_some_and(|m| m < 0.2), "{name}: {class}");
        }
    }
    assert!(compared >= 10, "{report}");
    // Leaves sway wherever they grow, those of twigs without joints, too.
    for (name, leaves) in report["leaves"].as_object().expect("leaves") {
        assert!(leaves["amplitude"]["p10"].as_f64().is_some_and(|m| m > 5e-4), "{name}: {leaves}");
    }
}

/// Least length of a bough, m.
const BOUGH: f64 = 0.5;

/// Thin rods in gusts: the tip's path with the default of eight steps a frame beside that with 64.
#[test]
fn thin_rods_hardly_depend_on_their_steps() {
    let dir = tempfile::tempdir().expect("dir");
    let path = |radius: f64, substeps: u32| -> Vec<glam::DVec3> {
        let text = format!(
            "seed = 3\n[frames]\nend = 49\n[ground]\nshow = false\n[[rod]]\npoints = [[0, 1, 0], [0, 1.5, 0]]\n\
             radius_mm = [{radius}, {radius}]\nsubsteps = {substeps}\n[wind]\nmodel = \"gust\"\nspeed = 6\n"
        );
        fs::write(dir.path().join("rod.toml"), text).expect("scene");
        let name = format!("rod_{radius}_{substeps}");
        let mut osier = Command::cargo_bin("osier").expect("osier");
        let bake = ["-q", "bake", "rod.toml", "-o", &name, "--formats", "points"];
        osier.current_dir(dir.path()).args(bake).assert().success();
        let tip = |frame: u32| {
            let table = fs::read_to_string(dir.path().join(&name).join(format!("points/joints_{frame:04}.csv")));
            let table = table.expect("joints");
            let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
            let heads = lines.next().expect("heads");
            let last = lines.next_back().expect("a tip");
            let column = |name: &str| heads.iter().position(|head| *head == name).expect("column");
            glam::DVec3::from_array(["x", "y", "z"].map(|c| last[column(c)].parse().expect("number")))
        };
        (1..=49).map(tip).collect()
    };
    // Radius, mm, and share of the length of 0.5 m.
    for (radius, share) in [(1.0, 1e-3), (0.6, 1e-2)] {
        let (coarse, fine) = (path(radius, 8), path(radius, 64));
        let squares: f64 = coarse.iter().zip(&fine).map(|(a, b)| a.distance_squared(*b)).sum();
        let rms = (squares / 49.0).sqrt();
        println!("radius {radius} mm: rms {:.3} mm", rms * 1e3);
        assert!(rms < share * 0.5, "radius {radius} mm: {rms} m");
        assert!(coarse.iter().any(|p| p.distance(coarse[0]) > 5e-3), "the wind moves it");
    }
}

/// A bough of a tree: its order, length, m, and where its tip is at each frame, m.
struct SwayingBough {
    order: u8,
    length: f32,
    tip: Vec<glam::Vec3>,
}

impl SwayingBough {
    /// Displacement of the tip from its mean place, by frame, m.
    fn swing(&self) -> Vec<glam::Vec3> {
        let mean = self.tip.iter().sum::<glam::Vec3>() / self.tip.len() as f32;
        self.tip.iter().map(|p| *p - mean).collect()
    }

    /// Root mean square of that displacement, m.
    fn amplitude(&self) -> f32 {
        let swing = self.swing();
        (swing.iter().map(|d| d.length_squared()).sum::<f32>() / swing.len() as f32).sqrt()
    }

    /// Correlation of the swings of two boughs, -1 to 1.
    fn correlation(&self, other: &Self) -> f32 {
        let sum: f32 = self.swing().iter().zip(other.swing()).map(|(a, b)| a.dot(b)).sum();
        sum / (self.tip.len() as f32 * self.amplitude() * other.amplitude())
    }
}

/// `gusty-tree`: boughs of one order and length within 30 % move alike in amount, and the less alike in time the farther apart they are.
#[test]
fn boughs_of_the_gusty_tree_sway_alike_in_amount_and_unlike_in_phase() {
    let text = osier::presets::find("gusty-tree.toml").expect("preset").text;
    let set = ["plants.tree.leaf.side=64", "plants.tree.bark.side=64", "ground.show=false"].map(str::to_owned).to_vec();
    let recipe =
        resolve(&Request { name: "tree".into(), text: text.into(), set, ..Request::default() }).expect("scene").0;
    let plant = crate::common::grown::individuals(&recipe).remove(0).plant;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let stage = assemble_scene(&recipe, SceneOptions::WITHOUT_GROUND, &work).expect("stage").animated;
    let asset = &stage.scene.assets[0];
    let rest = &asset.meshes[0].mesh.points;
    let frames: Vec<Vec<glam::Vec3>> = (1..=recipe.clip.end).step_by(3).map(|number| points(&stage, number)).collect();
    // The vertex nearest to the last node of each axis follows its tip.
    let mut boughs = Vec::new();
    for axis in plant.axes.iter().filter(|axis| axis.order > 0 && f64::from(axis.length - axis.s_exposed) > BOUGH) {
        let tip = plant.nodes.p[plant.nodes_of(axis).end - 1];
        let nearest = (0..rest.len()).min_by(|a, b| rest[*a].distance(tip).total_cmp(&rest[*b].distance(tip)));
        let nearest = nearest.expect("bark");
        assert!(rest[nearest].distance(tip) < 0.1, "{tip} is {} m from bark", rest[nearest].distance(tip));
        let tip = frames.iter().map(|frame| frame[nearest]).collect();
        boughs.push(SwayingBough { order: axis.order, length: axis.length - axis.s_exposed, tip });
    }
    let mut compared = 0;
    for first in &boughs {
        // Boughs from this one's length to 1.3 times it.
        let alike = boughs.iter().filter(|b| b.order == first.order && (1.0..1.3).contains(&(b.length / first.length)));
        let mut amplitudes: Vec<f32> = alike.map(SwayingBough::amplitude).collect();
        if amplitudes.len() < 8 {
            continue;
        }
        compared += 1;
        amplitudes.sort_by(f32::total_cmp);
        let at = |share: f32| amplitudes[((amplitudes.len() - 1) as f32 * share).round() as usize];
        assert!(at(0.9) <= 3.0 * at(0.5), "order {}, {} m: {amplitudes:?}", first.order, first.length);
    }
    // Pairs of boughs that end on different limbs, nearer to each other and farther from each other than the median.
    let mut pairs: Vec<[f32; 2]> = Vec::new();
    for (i, a) in boughs.iter().enumerate() {
        pairs.extend(boughs[i + 1..].iter().map(|b| [a.tip[0].distance(b.tip[0]), a.correlation(b)]));
    }
    pairs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mean = |part: &[[f32; 2]]| part.iter().map(|p| p[1]).sum::<f32>() / part.len() as f32;
    let third = pairs.len() / 3;
    let (near, far) = (mean(&pairs[..third]), mean(&pairs[2 * third..]));
    println!("{} boughs, {compared} classes; correlation of near pairs {near:.2}, of far ones {far:.2}", boughs.len());
    assert!(compared >= 5 && near > far, "{compared} {near} {far}");
}
