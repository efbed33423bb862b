//! POV-Ray reads what we write.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test fails by panicking and looks at files")]

use crate::common::clients;
use crate::common::synthetic;
use std::fs;

use crate::common::pov::{bake, render};
use osier::export::file_target::FileTarget;
use osier::export::pov::PovOptions;
use osier::scene::{Clip, MeshMotion};

const SMALL: [&str; 3] = ["+W8", "+H6", "-A"];

#[test]
fn every_file_of_the_synthetic_scene_parses() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = synthetic::scene();
    let summary = bake(dir.path(), &scene, &frames, PovOptions::default());
    assert!(summary.warnings.is_empty());
    let Some(povray) = clients::povray() else { return };
    let pov = dir.path().join("pov");
    for frame in ["1", "2", "3", "5", "9"] {
        let (from, to) = (format!("+SF{frame}"), format!("+EF{frame}"));
        render(&povray, &pov, &[&["render.ini", &from, &to, "+Oframe.png"][..], &SMALL].concat());
        assert!(pov.join(format!("frame{frame}.png")).is_file());
    }
    render(&povray, &pov, &[&["main.pov", "+L..", "+Ostill.png"][..], &SMALL].concat());
    assert!(pov.join("still.png").is_file());
}

#[test]
fn a_still_scene_and_a_moving_one_without_frames_parse() {
    let dir = tempfile::tempdir().expect("dir");
    let (mut scene, _) = synthetic::scene();
    bake(&dir.path().join("rest"), &scene, &[], PovOptions::default());
    scene.clip = Clip { start: 1, end: 1, fps: (24, 1) };
    scene.placements.retain(|p| p.asset == 4);
    scene.map_sequences.clear();
    for asset in &mut scene.assets {
        asset.meshes.iter_mut().for_each(|m| m.motion = MeshMotion::Still);
        (asset.points, asset.curves, asset.instancers) = (Vec::new(), Vec::new(), Vec::new());
    }
    let target = FileTarget::Single("my-tree.pov".into());
    bake(&dir.path().join("still"), &scene, &[], PovOptions { target, ..PovOptions::default() });
    assert!(!dir.path().join("still/my-tree_files/frames").exists());
    let Some(povray) = clients::povray() else { return };
    render(&povray, &dir.path().join("rest/pov"), &[&["render.ini", "+Or.png"][..], &SMALL].concat());
    render(&povray, &dir.path().join("still"), &[&["my-tree.pov", "+Os.png"][..], &SMALL].concat());
    assert!(dir.path().join("still/s.png").is_file());
}

/// The frame file that POV-Ray includes when it renders a frame.
fn included(povray: &std::path::Path, dir: &std::path::Path, frame: u32) -> String {
    let probe = "#include \"main.pov\"\n#fopen Out \"tag.txt\" write\n#write (Out, OsTag)\n#fclose Out\n";
    fs::write(dir.join("probe.pov"), probe).expect("probe");
    let (from, to) = (format!("+SF{frame}"), format!("+EF{frame}"));
    render(povray, dir, &[&["render.ini", "+Iprobe.pov", &from, &to, "+Oprobe.png"][..], &SMALL].concat());
    fs::read_to_string(dir.join("tag.txt")).expect("tag")
}

#[test]
fn with_a_step_pictures_are_those_of_the_written_frames_in_order() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = synthetic::scene();
    bake(dir.path(), &scene, &frames, PovOptions { step: 3, ..PovOptions::default() });
    let pov = dir.path().join("pov");
    let written: Vec<_> = osier::files::list_files(&pov.join("frames")).expect("files");
    assert_eq!(written, ["frame.0001.inc", "frame.0004.inc", "frame.0007.inc"]);
    let Some(povray) = clients::povray() else { return };
    let shown: Vec<String> = [1, 2, 3].iter().map(|f| included(&povray, &pov, *f)).collect();
    assert_eq!(shown, ["0001", "0004", "0007"]);
    let ini = fs::read_to_string(pov.join("render.ini")).expect("ini");
    assert!(ini.contains("Initial_Frame=1\nFinal_Frame=3\n"), "only frames that exist: {ini}");
}

#[test]
fn a_single_frame_is_written_and_rendered_whatever_the_step() {
    let dir = tempfile::tempdir().expect("dir");
    let (scene, frames) = synthetic::scene();
    bake(dir.path(), &scene, &frames[5..6], PovOptions { step: 4, ..PovOptions::default() });
    let pov = dir.path().join("pov");
    assert_eq!(osier::files::list_files(&pov.join("frames")).expect("files"), ["frame.0006.inc"]);
    let ini = fs::read_to_string(pov.join("render.ini")).expect("ini");
    assert!(ini.contains("Initial_Frame=6\nFinal_Frame=6\n"), "{ini}");
}

#[test]
fn a_clip_from_frame_0_renders_as_one_from_1() {
    let dir = tempfile::tempdir().expect("dir");
    let (mut scene, mut frames) = synthetic::scene();
    scene.clip = Clip { start: 0, end: 8, ..scene.clip };
    frames.iter_mut().for_each(|f| f.number -= 1);
    bake(dir.path(), &scene, &frames, PovOptions::default());
    let pov = dir.path().join("pov");
    let ini = fs::read_to_string(pov.join("render.ini")).expect("ini");
    assert!(ini.contains("Initial_Frame=1\nFinal_Frame=9\nInitial_Clock=0\nFinal_Clock=0.33333334\n"), "{ini}");
    let Some(povray) = clients::povray() else { return };
    assert_eq!([1, 9].map(|f| included(&povray, &pov, f)), ["0000", "0008"]);
}

#[test]
fn a_missing_picture_stops_before_anything_is_written() {
    use osier::export::Exporter as _;
    let dir = tempfile::tempdir().expect("dir");
    let (mut scene, _) = synthetic::scene();
    let textures = std::sync::Arc::new(osier::export::textures::Textures::encode(&scene).expect("textures"));
    scene.materials[1].maps.height = Some(99);
    let folder = osier::files::Folder::open(dir.path()).expect("folder");
    let mut pov = osier::export::pov::PovExporter::new(folder.clone(), textures, PovOptions::default());
    let error = pov.begin(&std::sync::Arc::new(scene)).expect_err("missing");
    assert!(error.to_string().starts_with("X012: material leaf"), "{error}");
    assert!(folder.files().is_empty());
}

#[test]
fn a_number_that_is_not_finite_never_reaches_a_file() {
    use osier::export::Exporter as _;
    let dir = tempfile::tempdir().expect("dir");
    let (mut scene, _) = synthetic::scene();
    let textures = std::sync::Arc::new(osier::export::textures::Textures::encode(&scene).expect("textures"));
    scene.placements[0].transform.t.x = f32::NAN;
    let folder = osier::files::Folder::open(dir.path()).expect("folder");
    let mut pov = osier::export::pov::PovExporter::new(folder.clone(), textures, PovOptions::default());
    pov.begin(&std::sync::Arc::new(scene)).expect("begin");
    let error = pov.finish().expect_err("placement");
    assert!(error.to_string().starts_with("X001"), "{error}");
    assert!(folder.files().iter().all(|f| f.path != "pov/main.pov"));
}

#[test]
fn what_is_said_of_a_frame_is_said_where_its_file_is_kept() {
    use osier::export::Exporter as _;
    let (mut scene, mut frames) = synthetic::scene();
    let (number, asset) =
        (0..).zip(&mut scene.assets).find(|(_, a)| a.points.iter().any(|p| p.moving)).expect("a cloud");
    let cloud = asset.points.iter_mut().find(|p| p.moving).expect("a cloud");
    let many: usize = 100_002;
    cloud.positions = (0..many).map(|i| glam::Vec3::splat(i as f32 * 1e-5)).collect();
    cloud.widths = vec![0.01; many];
    (cloud.colors, cloud.attributes) = (Vec::new(), Vec::new());
    frames.iter_mut().for_each(|f| f.assets[number].points.clear());
    frames.truncate(2);
    let scene = std::sync::Arc::new(scene);
    let dir = tempfile::tempdir().expect("dir");
    let run = |finish: bool| {
        let options = osier::files::WriteOptions { key: "k".into(), ..Default::default() };
        let folder = osier::files::Folder::open_with(dir.path(), options).expect("folder");
        let textures = std::sync::Arc::new(osier::export::textures::Textures::encode(&scene).expect("textures"));
        let mut pov = osier::export::pov::PovExporter::new(folder, textures, PovOptions::default());
        pov.begin(&scene).expect("begins");
        frames.iter().for_each(|f| pov.frame(f).expect("a frame"));
        if finish { pov.finish().expect("ends").warnings } else { Vec::new() }
    };
    run(false);
    let kept = run(true);
    assert_eq!(kept.iter().filter(|w| w.code == "X013").count(), 1, "{kept:?}");
}
