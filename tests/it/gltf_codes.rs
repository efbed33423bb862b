//! glTF and PC2 at their limits (X001 to X003, X005), and byte-exact goldens of tiny files.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and writes where it likes")]
#![allow(clippy::cast_possible_truncation, reason = "small test numbers")]

use crate::common::clients;
use crate::common::synthetic;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use crate::common::gltf_player::Player;
use glam::{Quat, Vec3};
use osier::export::gltf::{GltfExporter, GltfOptions, GltfTarget, Profile, write};
use osier::export::pc2::Pc2Exporter;
use osier::export::textures::Textures;
use osier::export::{Exporter, Warning};
use osier::files::Folder;
use osier::rng::mix64;
use osier::scene::*;
use osier::{Error, Result};
use serde_json::Value;

fn export(folder: &Path, scene: &Scene, frames: &[Frame], profile: Profile) -> Result<Vec<Warning>> {
    let scene = Arc::new(scene.clone());
    let textures = Arc::new(Textures::encode(&scene).expect("pictures"));
    let options = GltfOptions { profile, target: GltfTarget::Bake, ..GltfOptions::default() };
    let mut exporter = GltfExporter::new(Folder::open(folder).expect("folder"), textures, options);
    exporter.begin(&scene)?;
    frames.iter().try_for_each(|f| exporter.frame(f))?;
    Ok(exporter.finish()?.warnings)
}

fn player(folder: &Path, name: &str) -> Player {
    Player::new(&std::fs::read(folder.join("gltf").join(name)).expect("file"))
}

fn valid(files: &[std::path::PathBuf]) {
    let Some((node, folder)) = clients::validator() else { return };
    let output = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).args(files));
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let report: Value = serde_json::from_str(line).expect("json");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{line}");
    }
}

#[test]
fn a_number_that_is_not_finite_is_refused_with_its_place() {
    let (scene, frames) = synthetic::scene();
    let temp = tempfile::tempdir().expect("temp");
    let refused = |scene: &Scene, frames: &[Frame], word: &str| {
        let e = export(temp.path(), scene, frames, Profile::Web).expect_err("refused");
        assert!(matches!(&e, Error::Export { code: "X001", .. }) && e.to_string().contains(word), "{e}");
        let stray = std::fs::read_dir(temp.path().join("gltf")).map_or(0, |d| {
            d.filter(|e| e.as_ref().expect("entry").file_name().to_string_lossy().contains("part")).count()
        });
        assert_eq!(stray, 0);
    };
    let mut s = scene.clone();
    s.assets[4].meshes[0].mesh.points[2].y = f32::NAN;
    refused(&s, &[], "asset ground, mesh plane: point 2");
    let mut s = scene.clone();
    s.placements[3].transform.t.x = f32::INFINITY;
    refused(&s, &[], "placement tracks");
    let mut s = scene.clone();
    s.camera.eye.z = f32::NAN;
    refused(&s, &[], "camera");
    let mut s = scene.clone();
    s.materials[3].roughness = f32::NAN;
    refused(&s, &[], "not finite");
    let mut f = frames.clone();
    f[3].assets[0].pose[1].t.x = f32::NAN;
    refused(&scene, &f, "frame 4");
}

/// A skinned strip over a chain of `joints` joints of which every third turns.
fn chain(joints: u32) -> (Scene, Vec<Frame>) {
    let (mut scene, _) = synthetic::scene();
    let joint = |i: u32| Joint {
        name: format!("j{i}"),
        parent: i.checked_sub(1),
        rest: Trs::translation(Vec3::new(0.0, if i == 0 { 0.0 } else { 0.01 }, 0.0)),
        radius: 0.1,
    };
    let mut mesh = Mesh::default();
    let mut skin = SkinWeights::default();
    for i in 0..joints as u16 {
        let y = f32::from(i) * 0.01;
        mesh.points.extend([Vec3::new(-0.1, y, 0.0), Vec3::new(0.1, y, 0.0)]);
        mesh.normals.extend([Vec3::Z; 2]);
        skin.joints.extend([[i, i.saturating_sub(1), 0, 0]; 2]);
        skin.weights.extend([if i == 0 { [1.0, 0.0, 0.0, 0.0] } else { [0.75, 0.25, 0.0, 0.0] }; 2]);
    }
    for i in (0..joints - 1).map(|i| 2 * i) {
        mesh.triangles.extend([[i, i + 1, i + 2], [i + 2, i + 1, i + 3]]);
    }
    let skeleton = Skeleton { joints: (0..joints).map(joint).collect() };
    let pose = |n: u32| -> Vec<Trs> {
        let turn = |(i, j): (usize, &Joint)| {
            let a = if i % 3 == 0 { 0.002 * n as f32 } else { 0.0 };
            Trs { r: Quat::from_rotation_z(a), ..j.rest }
        };
        skeleton.joints.iter().enumerate().map(turn).collect()
    };
    let frame = |n: u32| Frame {
        number: n,
        assets: vec![AssetFrame { pose: pose(n), ..AssetFrame::default() }],
        ..Frame::default()
    };
    let frames = (1..=3).map(frame).collect();
    let object =
        MeshObject { name: "strip".into(), mesh: mesh.with_material(3), motion: MeshMotion::Skinned, skin: Some(skin) };
    scene.assets.truncate(1);
    scene.assets[0].meshes = vec![object];
    scene.assets[0].instancers[0].motion = InstancerMotion::Joints(vec![0, joints as u16 / 2, joints as u16 - 1, 5]);
    scene.assets[0].skeleton = Some(skeleton);
    scene.placements.truncate(2);
    (scene, frames)
}

#[test]
fn over_300_joints_the_rest_ride_on_kept_ones_and_the_file_stays_valid() {
    let temp = tempfile::tempdir().expect("temp");
    let (scene, frames) = chain(450);
    for profile in [Profile::Web, Profile::Blender] {
        let warnings = export(temp.path(), &scene, &frames, profile).expect("written");
        assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["X002"]);
        let file = player(temp.path(), &format!("synthetic.{}.glb", profile.word()));
        for skin in file.json["skins"].as_array().expect("skins") {
            let joints = skin["joints"].as_array().expect("joints").len();
            // `web` has no more joints than leaves have draw calls to ride on.
            let most = if profile == Profile::Web { 150 } else { 300 };
            assert!(joints > 60 && joints <= most, "{joints}");
        }
    }
    valid(&["synthetic.web.glb", "synthetic.blender.glb"].map(|n| temp.path().join("gltf").join(n)));
    let (scene, frames) = chain(300);
    assert!(export(temp.path(), &scene, &frames, Profile::Web).expect("written").is_empty());
}

#[test]
fn over_500_moving_instances_those_of_the_smallest_hash_are_kept() {
    let (mut scene, _) = synthetic::scene();
    let n = 620_u64;
    scene.assets = vec![scene.assets.swap_remove(2)];
    scene.placements = vec![Placement { name: "tracks".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }];
    let flying = &mut scene.assets[0].instancers[0];
    flying.ids = (0..n).map(|i| 7000 + i).collect();
    flying.protos = (0..n).map(|i| (i % 2) as u32).collect();
    flying.scales = vec![Vec3::ONE; n as usize];
    let state = |f: u32| InstanceState {
        positions: (0..n).map(|i| Vec3::new(i as f32, f as f32, 0.0)).collect(),
        orientations: vec![Quat::IDENTITY; n as usize],
        ..InstanceState::default()
    };
    flying.rest = state(0);
    let frame = |f: u32| {
        let moved = AssetFrame { instancers: vec![InstancerFrame::State(state(f))], ..AssetFrame::default() };
        Frame { number: f, assets: vec![moved], ..Frame::default() }
    };
    let frames: Vec<Frame> = (1..=3).map(frame).collect();
    let temp = tempfile::tempdir().expect("temp");
    let warnings = export(temp.path(), &scene, &frames, Profile::Web).expect("written");
    assert!(warnings.iter().all(|w| w.code == "X003" && w.message.contains("620")) && !warnings.is_empty());
    let mut keys: Vec<(u64, u64)> = (0..n).map(|i| (mix64(&[scene.seed, 7000 + i]), i)).collect();
    keys.sort_unstable();
    let file = player(temp.path(), "tracks.web.glb");
    let kept = |i: u64| file.node(&format!("flying_{i}")).is_some();
    assert!(keys[..500].iter().all(|(_, i)| kept(*i)) && !keys[500..].iter().any(|(_, i)| kept(*i)));
}

#[test]
fn more_frames_than_targets_leave_some_out() {
    let (mut scene, frames) = synthetic::scene();
    scene.clip.end = 300;
    let long: Vec<Frame> = (1..=257).map(|n| Frame { number: n, ..frames[(n as usize - 1) % 9].clone() }).collect();
    let temp = tempfile::tempdir().expect("temp");
    let targets = |folder: &Path| {
        player(folder, "cache.blender.glb").json["meshes"][0]["primitives"][0]["targets"].as_array().map_or(0, Vec::len)
    };
    export(temp.path(), &scene, &long[..32], Profile::Blender).expect("written");
    assert_eq!(targets(temp.path()), 32 - 4, "frames 1, 10, 19 and 28 show the rest shape");
    // A frame more: a small mesh keeps all.
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &long[..33], Profile::Blender).expect("written");
    assert_eq!(targets(temp.path()), 33 - 4);
    // More frames than any mesh may keep.
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &long, Profile::Blender).expect("written");
    assert!((16..=256).contains(&targets(temp.path())), "{}", targets(temp.path()));
}

#[test]
fn a_varying_mesh_shows_its_still_shape_or_nothing() {
    let (mut scene, frames) = synthetic::scene();
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &frames, Profile::Web).expect("written");
    assert_eq!(player(temp.path(), "misc.web.glb").node("pool"), None);
    scene.assets[3].meshes[0].mesh = scene.assets[4].meshes[0].mesh.clone();
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &frames, Profile::Web).expect("written");
    let file = player(temp.path(), "misc.web.glb");
    let pool = file.node("pool").expect("pool");
    assert_eq!(file.positions(pool, 0.1), scene.assets[4].meshes[0].mesh.points);
}

#[test]
fn a_scene_named_like_its_asset_keeps_both_files() {
    let (mut scene, _) = synthetic::scene();
    scene.name = "rig".into();
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &[], Profile::Web).expect("written");
    assert!(player(temp.path(), "rig.web.glb").json.get("cameras").is_none());
    assert!(player(temp.path(), "rig_2.web.glb").json["cameras"].is_array());
}

/// One triangle that moves in frame 2; z of its points is minus their index.
fn tiny() -> (Scene, Vec<Frame>) {
    let (mut scene, _) = synthetic::scene();
    let mesh = Mesh {
        points: [(0.0, 0.5), (1.0, 0.5), (0.0, 1.5)].map(|(x, y)| Vec3::new(x, y, -x)).to_vec(),
        normals: vec![Vec3::Z; 3],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let moved: Vec<Vec3> = mesh.points.iter().map(|p| *p + Vec3::new(0.0, 0.25, 0.5)).collect();
    let object =
        MeshObject { name: "flake".into(), mesh: mesh.with_material(3), motion: MeshMotion::Deforming, skin: None };
    scene.name = "tiny".into();
    scene.assets = vec![Asset { id: "flake".into(), meshes: vec![object], ..scene.assets.swap_remove(4) }];
    scene.placements = vec![Placement { name: "flake".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }];
    scene.clip = Clip { start: 1, end: 2, fps: (25, 1) };
    let points = MeshFrame::Points { points: moved, normals: vec![Vec3::Z; 3], velocities: Vec::new() };
    let frame = |number, meshes| Frame {
        number,
        assets: vec![AssetFrame { meshes, ..AssetFrame::default() }],
        ..Frame::default()
    };
    (scene, vec![frame(1, Vec::new()), frame(2, vec![points])])
}

#[test]
fn a_tiny_file_is_golden_byte_for_byte() {
    let (scene, frames) = tiny();
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &frames, Profile::Blender).expect("written");
    let actual = std::fs::read(temp.path().join("gltf/tiny.blender.glb")).expect("file");
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/gltf/tiny.blender.glb");
    if std::env::var_os("OSIER_BLESS").is_some() {
        std::fs::create_dir_all(golden.parent().expect("folder")).expect("folder");
        std::fs::write(&golden, &actual).expect("blessed");
        panic!("{} rewritten; run again without OSIER_BLESS", golden.display());
    }
    let expected = std::fs::read(&golden).expect("golden file; OSIER_BLESS=1 makes it");
    assert!(expected == actual, "{}\n{}", String::from_utf8_lossy(&expected), String::from_utf8_lossy(&actual));
}

#[test]
fn a_still_scene_without_anything_is_still_a_valid_file() {
    let (mut scene, _) = tiny();
    scene.assets.clear();
    scene.placements.clear();
    let temp = tempfile::tempdir().expect("temp");
    let mut bytes = Vec::new();
    write(&scene, &Textures::default(), Profile::Web, &mut bytes).expect("written");
    assert!(Player::new(&bytes).json.get("nodes").is_none());
    let path = temp.path().join("empty.glb");
    std::fs::write(&path, &bytes).expect("file");
    valid(&[path]);
}

fn cache(scene: &Scene, frames: &[Frame]) -> Vec<u8> {
    let (bytes, warnings) = cache_and_warnings(scene, frames);
    assert!(warnings.is_empty(), "{warnings:?}");
    bytes
}

fn cache_and_warnings(scene: &Scene, frames: &[Frame]) -> (Vec<u8>, Vec<Warning>) {
    let temp = tempfile::tempdir().expect("temp");
    let mut exporter = Pc2Exporter::new(Folder::open(temp.path()).expect("folder"));
    exporter.begin(&Arc::new(scene.clone())).expect("begin");
    frames.iter().for_each(|f| exporter.frame(f).expect("frame"));
    let warnings = exporter.finish().expect("finish").warnings;
    (std::fs::read(temp.path().join("cache/flake.pc2")).expect("file"), warnings)
}

fn pc2(vertices: i32, (first, step): (f32, f32), samples: &[&[f32]]) -> Vec<u8> {
    let mut bytes = b"POINTCACHE2\0".to_vec();
    bytes.extend(1_i32.to_le_bytes());
    bytes.extend(vertices.to_le_bytes());
    bytes.extend(first.to_le_bytes());
    bytes.extend(step.to_le_bytes());
    bytes.extend((samples.len() as i32).to_le_bytes());
    bytes.extend(samples.iter().copied().flatten().flat_map(|v| v.to_le_bytes()));
    bytes
}

#[test]
fn a_point_cache_of_three_vertices_byte_for_byte() {
    let (scene, frames) = tiny();
    // (x, -z, y) with z = -x, then shifted by (0, -0.5, 0.25).
    let rest = [0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0, 0.0, 1.5];
    let moved = [0.0, -0.5, 0.75, 1.0, 0.5, 0.75, 0.0, -0.5, 1.75];
    let bytes = cache(&scene, &frames);
    assert_eq!(bytes, pc2(3, (1.0, 1.0), &[&rest, &moved]));
    assert_eq!(bytes.len(), 32 + 12 * 3 * 2);
    // Chosen frames: the header tells which.
    let third = Frame { number: 3, ..frames[1].clone() };
    assert_eq!(cache(&scene, &[frames[0].clone(), third]), pc2(3, (1.0, 2.0), &[&rest, &moved]));
    assert_eq!(cache(&scene, &frames[1..]), pc2(3, (2.0, 1.0), &[&moved]));
    // One interval for all samples: frame 4 comes at frame 3, which a warning tells.
    let fourth = Frame { number: 4, ..frames[1].clone() };
    let (bytes, warnings) = cache_and_warnings(&scene, &[frames[0].clone(), frames[1].clone(), fourth]);
    assert_eq!(bytes, pc2(3, (1.0, 1.0), &[&rest, &moved, &moved]));
    assert!(warnings.len() == 1 && warnings[0].message.ends_with("frame 4 at frame 3"), "{warnings:?}");
}

#[test]
fn several_deforming_meshes_get_a_cache_each() {
    let (mut scene, mut frames) = tiny();
    let mut second = scene.assets[0].meshes[0].clone();
    second.name = "other".into();
    scene.assets[0].meshes.push(second);
    frames.truncate(1);
    let temp = tempfile::tempdir().expect("temp");
    let mut exporter = Pc2Exporter::new(Folder::open(temp.path()).expect("folder"));
    exporter.begin(&Arc::new(scene)).expect("begin");
    exporter.frame(&frames[0]).expect("frame");
    exporter.finish().expect("finish");
    for name in ["flake.flake.pc2", "flake.other.pc2"] {
        assert!(temp.path().join("cache").join(name).is_file());
    }
}
