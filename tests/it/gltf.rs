//! glTF files: what the gltf crate and the Khronos validator read in them.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and writes where it likes")]
#![allow(clippy::cast_possible_truncation, reason = "small test numbers")]

use crate::common::clients;
use crate::common::expect;
use crate::common::gltf_objects;
use crate::common::synthetic;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use crate::common::gltf_player::Player;
use osier::export::gltf::{GltfExporter, GltfOptions, GltfTarget, Profile};
use osier::export::textures::Textures;
use osier::export::{Exporter as _, Warning};
use osier::files::Folder;
use osier::scene::{Frame, Scene};
use serde_json::Value;

const PROFILES: [Profile; 2] = [Profile::Web, Profile::Blender];

/// The web profile with quantized vertices, and with compressed streams.
fn small_files() -> [GltfOptions; 2] {
    let web = GltfOptions { profile: Profile::Web, ..GltfOptions::default() };
    [GltfOptions { quantize: true, ..web.clone() }, GltfOptions { meshopt: true, ..web }]
}

/// Writes a scene with the frames given and returns what was said.
fn export(folder: &Path, scene: &Arc<Scene>, frames: &[Frame], options: GltfOptions) -> Vec<Warning> {
    let textures = Arc::new(Textures::encode(scene).expect("pictures"));
    let mut exporter = GltfExporter::new(Folder::open(folder).expect("folder"), textures, options);
    exporter.begin(scene).expect("begin");
    frames.iter().for_each(|f| exporter.frame(f).expect("frame"));
    exporter.finish().expect("finish").warnings
}

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut list: Vec<PathBuf> = std::fs::read_dir(folder).expect("folder").map(|e| e.expect("entry").path()).collect();
    list.retain(|p| p.to_string_lossy().ends_with(ending));
    list.sort();
    list
}

/// Every layout and profile, still and moving: all .glb and .gltf files.
fn everything(folder: &Path) -> Vec<PathBuf> {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let mut list = Vec::new();
    for (word, frames) in [("still", &frames[..0]), ("moving", &frames[..])] {
        for profile in PROFILES {
            let at = folder.join(word);
            export(&at, &scene, frames, GltfOptions { profile, target: GltfTarget::Bake, ..GltfOptions::default() });
            let one = GltfTarget::Glb(format!("one_{}.glb", profile.word()));
            export(&at, &scene, frames, GltfOptions { profile, target: one, ..GltfOptions::default() });
            let text = GltfTarget::Gltf(format!("text {}.gltf", profile.word()));
            export(&at, &scene, frames, GltfOptions { profile, target: text, ..GltfOptions::default() });
            if word == "moving" {
                export(
                    &folder.join("moment"),
                    &scene,
                    frames,
                    GltfOptions { profile, frame: Some(6), ..GltfOptions::default() },
                );
                if profile == Profile::Web {
                    list.extend(files(&folder.join("moment/gltf"), ".glb"));
                }
            }
        }
        for options in small_files() {
            let at = folder.join(word).join(if options.meshopt { "compressed" } else { "quantized" });
            export(&at, &scene, frames, options.clone());
            list.extend(files(&at.join("gltf"), ".glb"));
            let text = GltfTarget::Gltf("text.gltf".into());
            export(&at, &scene, frames, GltfOptions { target: text, ..options });
            list.extend(files(&at, ".gltf"));
        }
        list.extend(files(&folder.join(word), ".glb"));
        list.extend(files(&folder.join(word), ".gltf"));
        list.extend(files(&folder.join(word).join("gltf"), ".glb"));
    }
    list
}

#[test]
fn the_khronos_validator_finds_no_error_and_no_warning() {
    let Some((node, folder)) = clients::validator() else { return };
    let temp = tempfile::tempdir().expect("temp");
    let list = everything(temp.path());
    assert!(list.len() >= 2 * (2 * 5 + 4), "{list:?}");
    let output = clients::run(Command::new(node).arg(clients::script("gltf_validate.mjs")).arg(folder).args(&list));
    let text = String::from_utf8(output.stdout).expect("utf-8");
    let mut seen = 0;
    for line in text.lines() {
        let report: serde_json::Value = serde_json::from_str(line).expect("json");
        assert_eq!((&report["errors"], &report["warnings"]), (&0.into(), &0.into()), "{line}");
        for message in report["messages"].as_array().expect("messages") {
            let code = message["code"].as_str().unwrap_or_default();
            assert!(["UNSUPPORTED_EXTENSION", "UNUSED_OBJECT"].contains(&code), "{line}");
            if code == "UNUSED_OBJECT" {
                let pointer = message["pointer"].as_str().unwrap_or_default();
                assert!(
                    line.contains("UNSUPPORTED_EXTENSION")
                        && ["/accessors/", "/buffers/"].iter().any(|p| pointer.starts_with(p)),
                    "{line}"
                );
            }
        }
        seen += 1;
    }
    assert_eq!(seen, list.len());
}

fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn points(v: &Value) -> Vec<glam::Vec3> {
    let number = |v: &Value| v.as_f64().expect("number") as f32;
    let list = v.as_array().expect("points").iter();
    list.map(|p| glam::Vec3::new(number(&p[0]), number(&p[1]), number(&p[2]))).collect()
}

/// Largest distance between a node's positions and what is wanted of it.
fn error(got: &[glam::Vec3], want: &Value, place: &str) -> f32 {
    let paired: Vec<glam::Vec3>;
    let mut got = got;
    if want["hidden"] == true {
        assert!(got.iter().all(|p| (*p - got[0]).length() < 1e-4), "{place} is dead");
        return 0.0;
    }
    if want["pairs"] == true {
        paired = got.chunks_exact(2).map(|p| (p[0] + p[1]) * 0.5).collect();
        got = &paired;
    }
    let want = points(&want["points"]);
    assert_eq!(got.len(), want.len(), "{place}");
    got.iter().zip(&want).map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max)
}

#[test]
fn a_player_of_the_format_shows_everything_where_osier_does_at_every_frame() {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let numbers: Vec<u32> = frames.iter().map(|f| f.number).collect();
    let temp = tempfile::tempdir().expect("temp");
    for profile in PROFILES {
        export(
            temp.path(),
            &scene,
            &frames,
            GltfOptions { profile, target: GltfTarget::Bake, ..GltfOptions::default() },
        );
        let player = Player::new(&read(&temp.path().join(format!("gltf/synthetic.{}.glb", profile.word()))));
        let wanted = match profile {
            Profile::Web => gltf_objects::web_objects(&scene, &frames, &numbers),
            _ => gltf_objects::objects(&scene, &frames, &numbers, true),
        };
        for (number, list) in wanted.as_object().expect("frames") {
            let number: u32 = number.parse().expect("number");
            let time = osier::math::narrow(scene.clip.seconds(number));
            let list = list.as_object().expect("objects");
            for (name, want) in list {
                let node = player.node(name).unwrap_or_else(|| panic!("{} {name}", profile.word()));
                let place = format!("{} {name}, frame {number}", profile.word());
                let e = error(&player.positions(node, time), want, &place);
                assert!(e < 1e-4, "{place}: off by {e}");
            }
            let meshes = player.json["nodes"].as_array().expect("nodes").iter().filter(|n| n["mesh"].is_u64());
            assert_eq!(meshes.count(), list.len(), "nothing but what is wanted");
        }
    }
}

/// Largest side of all that a list of objects shows over the clip, m.
fn largest_side(wanted: &Value) -> f32 {
    let all = wanted.as_object().expect("frames").values().flat_map(|list| list.as_object().expect("objects").values());
    let side = |object: &Value| {
        let list = points(&object["points"]);
        let (low, high) = list.iter().fold((glam::Vec3::MAX, glam::Vec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        (high - low).max_element()
    };
    all.map(side).fold(0.0, f32::max)
}

#[test]
fn quantized_positions_move_as_floats_do() {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let numbers: Vec<u32> = frames.iter().map(|f| f.number).collect();
    let temp = tempfile::tempdir().expect("temp");
    let [quantized, _] = small_files();
    export(temp.path(), &scene, &frames, quantized);
    let player = Player::new(&read(&temp.path().join("gltf/synthetic.web.glb")));
    let wanted = gltf_objects::web_objects(&scene, &frames, &numbers);
    // Half a step of the largest mesh; two weights by a step each between joints that move apart by up to 0.1 m; the tolerance of
    // omitted keys.
    let step = largest_side(&wanted) / 131_070.0;
    let bound = step + 2.0 * 0.1 / 255.0 + 1e-5;
    for (number, list) in wanted.as_object().expect("frames") {
        let number: u32 = number.parse().expect("number");
        let time = osier::math::narrow(scene.clip.seconds(number));
        for (name, want) in list.as_object().expect("objects") {
            let node = player.node(name).unwrap_or_else(|| panic!("{name}"));
            let e = error(&player.positions(node, time), want, &format!("{name}, frame {number}"));
            // Without a skin only the positions are rounded, and keys left out.
            let skinned = player.json["nodes"][node]["skin"].is_u64();
            let bound = if skinned { bound } else { step + 2e-5 };
            assert!(e < bound, "{name}, frame {number}: off by {e}, bound {bound}");
        }
    }
    // Small numbers are there: no vertex array of a mesh without targets holds floats.
    let json = &player.json;
    let floats =
        json["meshes"].as_array().expect("meshes").iter().flat_map(|m| m["primitives"].as_array().expect("list"));
    let still = floats.filter(|p| p["targets"].is_null() && p["mode"].is_null());
    let mut seen = 0;
    for primitive in still {
        for (name, accessor) in primitive["attributes"].as_object().expect("attributes") {
            let accessor = accessor.as_u64().expect("index") as usize;
            let component = json["accessors"][accessor]["componentType"].as_u64();
            assert!(component != Some(5126) || name == "TEXCOORD_0", "{name} holds floats");
            if name == "WEIGHTS_0" {
                let rows = player.rows(accessor);
                let sums = rows.iter().map(|r| (r.iter().sum::<f32>() * 255.0).round() as u32);
                assert!(sums.eq(rows.iter().map(|_| 255)), "weights of each vertex sum to 255");
                seen += 1;
            }
        }
    }
    assert!(seen > 0, "a skin is there");
}

/// The meshes of the synthetic scene alone, which are the same in every profile.
fn meshes_alone() -> (Arc<Scene>, Vec<Frame>) {
    let (mut scene, frames) = synthetic::scene();
    for asset in &mut scene.assets {
        (asset.instancers, asset.curves, asset.points) = Default::default();
    }
    (Arc::new(scene), frames)
}

/// Meshes at rest as readers see them: a skin in its rest pose moves nothing, so that only rounding to the cube is left.
#[test]
fn readers_see_quantized_meshes_within_half_a_step() {
    let (scene, frames) = meshes_alone();
    let temp = tempfile::tempdir().expect("temp");
    let [quantized, _] = small_files();
    export(temp.path(), &scene, &[], quantized);
    let file = temp.path().join("gltf/synthetic.web.glb");
    let number = frames[0].number;
    let assets = scene.assets.iter().map(|_| osier::scene::AssetFrame::default()).collect();
    let rest = Frame { number, assets, ..Frame::default() };
    let wanted = gltf_objects::objects(&scene, std::slice::from_ref(&rest), &[number], true);
    assert!(wanted[number.to_string()].as_object().expect("objects").len() >= 4, "{wanted}");
    // Half a step of the largest mesh, and what the world positions of 32 bits lose at 10 m.
    let bound = largest_side(&wanted) / 131_070.0 + 2e-6;
    readers_see(temp.path(), &file, &wanted, bound);
}

/// A mesh of the size of a leaf at the origin, where positions of 32 bits lose nothing: half a step and 1e-7 m.
#[test]
fn readers_see_a_small_mesh_within_half_a_step() {
    let (mut scene, frames) = synthetic::scene();
    let leaf = scene.assets[1].meshes[0].mesh.clone();
    let [mut object] = <[_; 1]>::try_from(scene.assets.pop().expect("the ground").meshes).expect("one mesh");
    let (low, high) = leaf.points.iter().fold((glam::Vec3::MAX, glam::Vec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
    object.mesh = leaf;
    for point in &mut object.mesh.points {
        *point = (*point - low) * (0.1 / (high - low).max_element());
    }
    let ground = scene.placements.pop().expect("its placement");
    scene.placements = vec![osier::scene::Placement { asset: 0, transform: osier::scene::Trs::IDENTITY, ..ground }];
    scene.assets.truncate(1);
    scene.assets[0] =
        osier::scene::Asset { skeleton: None, meshes: vec![object], instancers: Vec::new(), ..scene.assets[0].clone() };
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    let [quantized, compressed] = small_files();
    for (name, options) in [("quantized", quantized), ("compressed", compressed)] {
        let folder = temp.path().join(name);
        export(&folder, &scene, &[], options);
        let number = frames[0].number;
        let rest = Frame { number, assets: vec![osier::scene::AssetFrame::default()], ..Frame::default() };
        let wanted = gltf_objects::objects(&scene, std::slice::from_ref(&rest), &[number], true);
        assert!((largest_side(&wanted) - 0.1).abs() < 1e-6, "{wanted}");
        let bound = 0.1 / 131_070.0 + 1e-7;
        let file = folder.join("gltf/synthetic.web.glb");
        if name == "quantized" {
            readers_see(&folder, &file, &wanted, bound);
        } else {
            // Compression reorders vertices, and Blender 5.0 does not read it.
            three_sees(&job_of(&folder, &file, &wanted, bound, true));
        }
    }
}

/// A file with the job of a reader: what a file shows at its first frame, within `bound` m.
fn job_of(folder: &Path, file: &Path, wanted: &Value, bound: f32, any_order: bool) -> PathBuf {
    let number: u32 = wanted.as_object().and_then(|o| o.keys().next()?.parse().ok()).expect("a frame");
    let job = serde_json::json!([{"file": file, "fps": 24, "start": number, "frames": wanted, "bound": bound, "any_order": any_order}]);
    let jobs = folder.join("jobs.json");
    std::fs::write(&jobs, job.to_string()).expect("jobs");
    jobs
}

/// Fails unless three.js, Blender 5 and Blender 3.4 show what is wanted within `bound` m.
fn readers_see(folder: &Path, file: &Path, wanted: &Value, bound: f32) {
    let jobs = job_of(folder, file, wanted, bound, false);
    let path = jobs.to_string_lossy().into_owned();
    three_sees(&jobs);
    if let Some(python) = clients::python() {
        has_judged(&clients::python_script(&python, "blender_gltf.py", &[&path]));
    }
    if let Some(blender) = clients::blender() {
        has_judged(&clients::blender_script(&blender, "blender_gltf.py", &[&path]));
    }
}

fn three_sees(jobs: &Path) {
    let Some((node, folder)) = clients::three() else { return };
    has_judged(&clients::run(Command::new(node).arg(clients::script("gltf_three.mjs")).arg(folder).arg(jobs)));
}

fn has_judged(output: &std::process::Output) {
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("\"worst\""), "{text}");
}

/// Normals in bytes and coordinates in 16 bits, against the floats of profile `blender` of the same meshes.
#[test]
fn quantized_normals_and_coordinates_keep_their_accuracy() {
    let (scene, _) = meshes_alone();
    let temp = tempfile::tempdir().expect("temp");
    let [quantized, _] = small_files();
    let plain = GltfOptions { profile: Profile::Blender, ..GltfOptions::default() };
    let files = [plain, quantized].map(|options| {
        let word = options.profile.word();
        export(temp.path(), &scene, &[], options);
        Player::new(&read(&temp.path().join(format!("gltf/synthetic.{word}.glb"))))
    });
    let primitives = |player: &Player| -> Vec<Value> {
        let meshes = player.json["meshes"].as_array().expect("meshes");
        meshes.iter().flat_map(|m| m["primitives"].as_array().expect("list").clone()).collect()
    };
    let [plain, small] = &files;
    let (mut turned, mut shifted, mut normals) = (0.0_f32, 0.0_f32, 0);
    for (a, b) in primitives(plain).iter().zip(primitives(small)) {
        let of = |player: &Player, primitive: &Value, name: &str| {
            let accessor = primitive["attributes"][name].as_u64();
            accessor.map(|i| player.rows(i as usize)).unwrap_or_default()
        };
        for (a, b) in of(plain, a, "NORMAL").iter().zip(of(small, &b, "NORMAL")) {
            let [a, b] = [&a[..], &b[..]].map(|v| glam::Vec3::from_slice(v).normalize_or_zero());
            turned = turned.max(a.angle_between(b).to_degrees());
            normals += 1;
        }
        for (a, b) in of(plain, a, "TEXCOORD_0").iter().zip(of(small, &b, "TEXCOORD_0")) {
            shifted = a.iter().zip(b).fold(shifted, |most, (a, b)| most.max((a - b).abs()));
        }
    }
    assert!(normals > 20 && turned < 0.3, "{turned} degrees, {normals} normals");
    assert!(shifted < 7.7e-6, "{shifted}");
}

#[test]
fn leaves_transmit_diffuse_light_in_their_own_colour() {
    let (mut scene, _) = synthetic::scene();
    // A leaf with a picture and one without.
    let wet = scene.materials.iter().position(|m| m.name == "cache_l0").expect("wet leaf");
    scene.materials[wet].maps.color = None;
    scene.materials[wet].alpha_cutoff = None;
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &[], GltfOptions { profile: Profile::Web, ..GltfOptions::default() });
    let player = Player::new(&read(&temp.path().join("gltf/synthetic.web.glb")));
    const EXTENSION: &str = "KHR_materials_diffuse_transmission";
    let lists = |key: &str| player.json[key].as_array().expect("list").iter().any(|e| e == EXTENSION);
    assert!(lists("extensionsUsed") && !lists("extensionsRequired"));
    let material = |name: &str| {
        let list = player.json["materials"].as_array().expect("materials");
        list.iter().find(|m| m["name"] == name).unwrap_or_else(|| panic!("no {name}")).clone()
    };
    let (leaf, plain) = (material("leaf"), material("cache_l0"));
    let (transmission, uniform) = (&leaf["extensions"][EXTENSION], &plain["extensions"][EXTENSION]);
    assert!((transmission["diffuseTransmissionFactor"].as_f64().expect("factor") - 0.3).abs() < 1e-6);
    let base = &leaf["pbrMetallicRoughness"]["baseColorTexture"];
    assert_eq!(&transmission["diffuseTransmissionColorTexture"], base);
    assert!(base["index"].is_u64() && transmission["diffuseTransmissionColorFactor"].is_null());
    let factor = plain["pbrMetallicRoughness"]["baseColorFactor"].as_array().expect("colour");
    assert_eq!(uniform["diffuseTransmissionColorFactor"].as_array().expect("colour")[..], factor[..3]);
    for name in ["bark", "water", "ground"] {
        assert!(material(name)["extensions"][EXTENSION].is_null(), "{name} is opaque or clear");
    }
}

#[test]
fn three_shows_the_web_profile_where_osier_does() {
    let Some((node, folder)) = clients::three() else { return };
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    export(temp.path(), &scene, &frames, GltfOptions { profile: Profile::Web, ..GltfOptions::default() });
    let file = temp.path().join("gltf/synthetic.web.glb");
    let numbers: Vec<u32> = frames.iter().map(|f| f.number).collect();
    let wanted = gltf_objects::web_objects(&scene, &frames, &numbers);
    let job = serde_json::json!([{"file": file, "fps": 24, "start": scene.clip.start, "frames": wanted}]);
    let jobs = temp.path().join("jobs.json");
    std::fs::write(&jobs, job.to_string()).expect("jobs");
    let output = clients::run(Command::new(node).arg(clients::script("gltf_three.mjs")).arg(folder).arg(&jobs));
    assert!(String::from_utf8_lossy(&output.stdout).contains("\"instanced\":8"), "four groups in each of two places");
}

#[test]
fn three_shows_quantized_and_compressed_files_where_osier_does() {
    let Some((node, folder)) = clients::three() else { return };
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    let numbers: Vec<u32> = frames.iter().map(|f| f.number).collect();
    let wanted = gltf_objects::web_objects(&scene, &frames, &numbers);
    let plain = GltfOptions { profile: Profile::Web, ..GltfOptions::default() };
    let [quantized, compressed] = small_files();
    let mut jobs = Vec::new();
    for (name, options, bound) in
        [("plain", plain, 1e-4), ("quantized", quantized, 8e-4), ("compressed", compressed, 1e-3)]
    {
        let at = temp.path().join(name);
        export(&at, &scene, &frames, options);
        let file = at.join("gltf/synthetic.web.glb");
        let job = serde_json::json!({
            "file": file, "fps": 24, "start": scene.clip.start, "frames": wanted, "bound": bound,
            "any_order": name == "compressed",
        });
        jobs.push(job);
    }
    let list = temp.path().join("jobs.json");
    std::fs::write(&list, Value::Array(jobs).to_string()).expect("jobs");
    let output = clients::run(Command::new(node).arg(clients::script("gltf_three.mjs")).arg(folder).arg(&list));
    assert_eq!(String::from_utf8_lossy(&output.stdout).matches("\"instanced\":8").count(), 3);
}

/// What each node shows where one frame stands still: the living of each prototype in one.
fn standing(scene: &Scene, frames: &[Frame], number: u32) -> Value {
    let all = expect::expect(scene, frames, &[number]);
    let mut list = gltf_objects::objects(scene, frames, &[number], true);
    let list = list[number.to_string()].as_object_mut().expect("objects");
    for p in &scene.placements {
        for instancer in &scene.assets[p.asset].instancers {
            let name = format!("{}_{}", p.name, instancer.name);
            let states = &all["frames"][number.to_string()]["instancers"][format!("{}/{}", p.name, instancer.name)];
            let states: Vec<Value> = states.as_array().expect("states").clone();
            (0..states.len()).for_each(|i| _ = list.remove(&format!("{name}_{i}")));
            states.iter().for_each(|s| _ = list.remove(&format!("{name}_{}", s["proto"].as_str().expect("name"))));
            let alive: Vec<Value> = states.into_iter().filter(|s| s["alive"] != false).collect();
            gltf_objects::instanced(list, &name, &alive, true);
        }
    }
    Value::Object(list.clone())
}

/// One frame of a moving scene, without tracks: instances by extension, all that live, for viewers as for our player.
#[test]
fn one_frame_stands_still_with_all_that_live() {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    for profile in PROFILES {
        export(temp.path(), &scene, &frames, GltfOptions { profile, frame: Some(6), ..GltfOptions::default() });
        let player = Player::new(&read(&temp.path().join(format!("gltf/synthetic.{}.glb", profile.word()))));
        assert!(player.json["animations"].is_null() && player.json["skins"].is_null());
        let wanted = standing(&scene, &frames, 6);
        for (name, want) in wanted.as_object().expect("objects") {
            let node = player.node(name).unwrap_or_else(|| panic!("{} {name}", profile.word()));
            let e = error(&player.positions(node, 0.0), want, name);
            assert!(e < 1e-4, "{} {name}: off by {e}", profile.word());
        }
    }
    let required = |name: &str| Player::new(&read(&temp.path().join(name))).json["extensionsRequired"].clone();
    assert_eq!(
        required("gltf/tracks.web.glb"),
        serde_json::json!(["EXT_mesh_gpu_instancing", "KHR_mesh_quantization"])
    );
    let Some((node, folder)) = clients::three() else { return };
    let file = temp.path().join("gltf/synthetic.web.glb");
    let job =
        serde_json::json!([{ "file": file, "fps": 24, "start": 6, "frames": { "6": standing(&scene, &frames, 6) } }]);
    let jobs = temp.path().join("jobs.json");
    std::fs::write(&jobs, job.to_string()).expect("jobs");
    clients::run(Command::new(node).arg(clients::script("gltf_three.mjs")).arg(folder).arg(&jobs));
}

#[test]
fn the_web_profile_has_fewer_keys_and_no_merged_leaves() {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    let mut keys = Vec::new();
    for profile in PROFILES {
        export(
            temp.path(),
            &scene,
            &frames,
            GltfOptions { profile, target: GltfTarget::Bake, ..GltfOptions::default() },
        );
        let player = Player::new(&read(&temp.path().join(format!("gltf/tracks.{}.glb", profile.word()))));
        let samplers = player.json["animations"][0]["samplers"].as_array().expect("samplers").clone();
        let count = |s: &Value| player.rows(s["input"].as_u64().expect("input") as usize).len();
        keys.push(samplers.iter().map(count).sum::<usize>());
        let required = player.json["extensionsRequired"].as_array().map_or(0, Vec::len);
        let small = usize::from(profile == Profile::Web);
        assert_eq!(
            required, small,
            "nothing is instanced where everything moves on its own, only web has small numbers"
        );
    }
    assert!(keys[0] * 2 < keys[1], "{keys:?}");
}

/// The file without required extensions: the gltf crate refuses those that it was not built with.
fn unrequired(glb: &[u8]) -> Vec<u8> {
    let mut file = gltf::binary::Glb::from_slice(glb).expect("glb");
    let mut json: Value = serde_json::from_slice(&file.json).expect("json");
    json.as_object_mut().expect("object").remove("extensionsRequired");
    file.json = serde_json::to_vec(&json).expect("json").into();
    file.to_vec().expect("glb")
}

#[test]
fn the_gltf_crate_reads_positions_bit_for_bit() {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    for profile in PROFILES {
        export(
            temp.path(),
            &scene,
            &frames,
            GltfOptions { profile, target: GltfTarget::Bake, ..GltfOptions::default() },
        );
        let bytes = unrequired(&read(&temp.path().join(format!("gltf/synthetic.{}.glb", profile.word()))));
        let file = gltf::Gltf::from_slice(&bytes).expect("valid");
        let bin = file.blob.clone().expect("buffer");
        for (asset, object) in scene.assets.iter().flat_map(|a| a.meshes.iter().map(move |m| (a, m))) {
            if object.mesh.points.is_empty() {
                continue;
            }
            let mesh = file.meshes().find(|m| m.name() == Some(&object.name)).expect("mesh");
            let (mut positions, mut triangles) = (Vec::new(), 0);
            for primitive in mesh.primitives() {
                let reader = primitive.reader(|_| Some(&bin));
                positions.extend(reader.read_positions().expect("positions"));
                triangles += reader.read_indices().expect("indices").into_u32().count() / 3;
            }
            let bits = |p: &[f32; 3]| p.map(|c| (c + 0.0).to_bits());
            let want: Vec<[u32; 3]> = object.mesh.points.iter().map(|p| bits(&p.to_array())).collect();
            assert_eq!(positions.iter().map(bits).collect::<Vec<_>>(), want, "{}/{}", asset.id, object.name);
            assert_eq!(triangles, object.mesh.triangles.len());
        }
        assert_eq!(file.skins().count(), 2, "each placement has joints of its own");
        assert_eq!(file.animations().count(), 1);
        let names: std::collections::BTreeSet<_> = file.nodes().filter_map(|n| n.name().map(str::to_owned)).collect();
        assert_eq!(names.len(), file.nodes().count());
        assert!(file.nodes().all(|n| matches!(n.transform(), gltf::scene::Transform::Decomposed { .. })));
    }
}

#[test]
#[cfg(feature = "parallel")]
fn bytes_do_not_depend_on_threads_or_runs() {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let run = |threads: usize| -> Vec<Vec<u8>> {
        let temp = tempfile::tempdir().expect("temp");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| {
            for profile in PROFILES {
                export(
                    temp.path(),
                    &scene,
                    &frames,
                    GltfOptions { profile, target: GltfTarget::Bake, ..GltfOptions::default() },
                );
            }
        });
        files(&temp.path().join("gltf"), ".glb").iter().map(|p| read(p)).collect()
    };
    let one = run(1);
    assert_eq!(one.len(), 12);
    assert!([2, 5].into_iter().all(|n| run(n) == one));
}

#[test]
fn a_gltf_beside_its_files_holds_the_same_as_a_glb() {
    let (scene, _) = synthetic::scene();
    let scene = Arc::new(scene);
    let temp = tempfile::tempdir().expect("temp");
    let options = |target| GltfOptions { target, ..GltfOptions::default() };
    export(temp.path(), &scene, &[], options(GltfTarget::Gltf("a/my tree.gltf".into())));
    let json: Value = serde_json::from_slice(&read(&temp.path().join("a/my tree.gltf"))).expect("json");
    assert_eq!(json["buffers"][0]["uri"], "my%20tree.bin");
    let bin = read(&temp.path().join("a/my tree.bin"));
    assert_eq!(json["buffers"][0]["byteLength"], bin.len());
    let uris: Vec<&str> = json["images"].as_array().expect("images").iter().filter_map(|i| i["uri"].as_str()).collect();
    assert_eq!(uris.len(), 3);
    for uri in uris {
        assert!(read(&temp.path().join("a").join(uri.replace("%20", " "))).starts_with(b"\x89PNG"));
    }
    let mut streamed = Vec::new();
    let textures = Textures::encode(&scene).expect("pictures");
    osier::export::gltf::write(&scene, &textures, Profile::Blender, &mut streamed).expect("write");
    export(temp.path(), &scene, &[], options(GltfTarget::Glb("one.glb".into())));
    assert!(read(&temp.path().join("one.glb")) == streamed, "a pipe gets the same bytes as a file");
    let glb: Value = Player::new(&streamed).json;
    assert_eq!(json["nodes"], glb["nodes"]);
    assert_eq!(json["meshes"], glb["meshes"]);
}
