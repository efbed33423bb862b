//! glTF files and point caches in both Blenders: evaluated world positions against osier's own.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test may fail and writes where it likes")]

use crate::common::clients;
use crate::common::expect;
use crate::common::gltf_objects::{alone, instanced, objects};
use crate::common::synthetic;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use osier::export::Exporter;
use osier::export::gltf::{GltfExporter, GltfOptions};
use osier::export::pc2::Pc2Exporter;
use osier::export::textures::Textures;
use osier::files::Folder;
use osier::scene::{Frame, InstancerMotion, MeshFrame, MeshMotion, Scene};
use serde_json::{Value, json};

fn bake(folder: &Path, scene: &Arc<Scene>, frames: &[Frame]) {
    let folder = Folder::open(folder).expect("folder");
    let textures = Arc::new(Textures::encode(scene).expect("pictures"));
    let exporters: [Box<dyn Exporter>; 2] = [
        Box::new(GltfExporter::new(folder.clone(), textures, GltfOptions::default())),
        Box::new(Pc2Exporter::new(folder)),
    ];
    for mut exporter in exporters {
        exporter.begin(scene).expect("begin");
        frames.iter().for_each(|f| exporter.frame(f).expect("frame"));
        exporter.finish().expect("finish");
    }
}

fn jobs(folder: &Path) -> Value {
    let (scene, frames) = synthetic::scene();
    let scene = Arc::new(scene);
    let moving = folder.join("moving");
    bake(&moving, &scene, &frames);
    let still = folder.join("still");
    bake(&still, &scene, &[]);
    assert!(!still.join("cache").exists(), "a still scene has no cache");
    let numbers: Vec<u32> = frames.iter().map(|f| f.number).collect();
    let path = |p: &str| moving.join(p).to_string_lossy().into_owned();
    let job =
        |file: String, frames: Value| json!({"file": file, "fps": 24, "start": scene.clip.start, "frames": frames});

    let mut whole = job(path("gltf/synthetic.blender.glb"), objects(&scene, &frames, &numbers, true));
    let camera = scene.camera;
    let forward = (camera.target - camera.eye).normalize();
    whole["camera"] = json!({"eye": camera.eye.to_array(), "forward": forward.to_array(), "vfov": camera.vfov});
    whole["absent"] = json!(["misc_rain", "misc_pool"]);
    let mut list = vec![whole];
    for (i, asset) in scene.assets.iter().enumerate() {
        let scene = alone(&scene, i);
        let file = path(&format!("gltf/{}.blender.glb", asset.id));
        list.push(job(file, objects(&scene, &frames, &numbers, false)));
    }
    list.push(cached(&scene, &frames, job(path("gltf/cache.blender.glb"), Value::Null), &path("cache/cache.pc2")));
    list.push(hero(folder));
    list.push(resting(&scene, &frames, &still, numbers[0]));
    list.into()
}

/// The point cache at every frame and halfway between frames.
fn cached(scene: &Scene, frames: &[Frame], mut job: Value, pc2: &str) -> Value {
    let scene = alone(scene, 1);
    let every: Vec<u32> = frames.iter().map(|f| f.number).collect();
    let at = objects(&scene, frames, &every, false);
    let mut wanted = at.as_object().expect("frames").clone();
    for pair in every.windows(2) {
        let points = |n: u32| at[n.to_string()]["body"]["points"].as_array().expect("points").clone();
        let half = |(a, b): (Value, Value)| {
            let middle = |i: usize| (a[i].as_f64().expect("x") + b[i].as_f64().expect("x")) / 2.0;
            json!([middle(0), middle(1), middle(2)])
        };
        let points: Vec<Value> = points(pair[0]).into_iter().zip(points(pair[1])).map(half).collect();
        wanted.insert(format!("{}.5", pair[0]), json!({"body": {"points": points}}));
    }
    job["frames"] = wanted.into();
    job["cache"] = json!({"object": "body", "pc2": pc2});
    job
}

/// A skinned mesh whose frames carry finer points: the file holds the skin, the cache beside it the points.
fn hero(folder: &Path) -> Value {
    let (mut scene, mut frames) = synthetic::scene();
    scene.assets[0].meshes[0].motion = MeshMotion::Deforming;
    for frame in &mut frames {
        let k = frame.number as f32;
        let mesh = &scene.assets[0].meshes[0].mesh;
        let bent = |p: &Vec3| *p + Vec3::new(0.01 * k * p.y, 0.0, 0.03 * k * p.y * p.y);
        let points = mesh.points.iter().map(bent).collect();
        let fine = MeshFrame::Points { points, normals: mesh.normals.clone(), velocities: Vec::new() };
        frame.assets[0].meshes = vec![fine];
    }
    let folder = folder.join("hero");
    let start = scene.clip.start;
    let numbers = expect::three(&scene);
    let mut at = objects(&alone(&scene, 0), &frames, &numbers, false);
    for list in at.as_object_mut().expect("frames").values_mut() {
        // The leaves ride on the skeleton, which the cache's frame numbers run one ahead of.
        list.as_object_mut().expect("objects").retain(|name, _| name == "stem");
    }
    bake(&folder, &Arc::new(scene), &frames);
    let path = |p: &str| folder.join(p).to_string_lossy().into_owned();
    let cache = json!({"object": "stem", "pc2": path("cache/rig.pc2")});
    json!({"file": path("gltf/rig.blender.glb"), "fps": 24, "start": start, "frames": at, "cache": cache})
}

/// The still bake: everything at rest, the cloud included.
fn resting(scene: &Scene, frames: &[Frame], folder: &Path, number: u32) -> Value {
    let rest = Frame { number, assets: Vec::new(), ..Frame::default() };
    let rest = Frame { assets: scene.assets.iter().map(|_| osier::scene::AssetFrame::default()).collect(), ..rest };
    let mut at = objects(scene, std::slice::from_ref(&rest), &[number], true);
    let expected = expect::expect(scene, std::slice::from_ref(&rest), &[number]);
    let list = at[number.to_string()].as_object_mut().expect("objects");
    list.retain(|name, _| !name.starts_with("tracks_flying_"));
    let states = &expected["frames"][number.to_string()]["instancers"];
    instanced(list, "tracks_flying", states["tracks/flying"].as_array().expect("flying"), true);
    // Without joints that move, leaves are one mesh for each prototype.
    for p in &scene.placements {
        for instancer in &scene.assets[p.asset].instancers {
            let InstancerMotion::Joints(joints) = &instancer.motion else { continue };
            let name = format!("{}_{}", p.name, instancer.name);
            joints.iter().for_each(|joint| _ = list.remove(&format!("{name}_{joint}")));
            let states = states[format!("{}/{}", p.name, instancer.name)].as_array().expect("states");
            instanced(list, &name, states, true);
        }
    }
    let cloud = &expected["frames"][number.to_string()]["points"]["misc/rain"]["positions"];
    list.insert("misc_rain".into(), json!({"points": cloud}));
    let file = folder.join("gltf/synthetic.blender.glb").to_string_lossy().into_owned();
    assert!(!frames.is_empty());
    json!({"file": file, "fps": 24, "start": number, "frames": at})
}

fn judge(run: impl Fn(&str) -> std::process::Output) {
    let temp = tempfile::tempdir().expect("temp");
    let jobs = jobs(temp.path());
    let count = jobs.as_array().expect("list").len();
    let file = temp.path().join("jobs.json");
    std::fs::write(&file, jobs.to_string()).expect("jobs");
    let output = run(&file.to_string_lossy());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let done = text.lines().filter(|l| l.contains("\"worst\"")).count();
    assert_eq!(done, count, "{text}");
}

#[test]
fn blender_5_shows_everything_where_osier_does() {
    let Some(python) = clients::python() else { return };
    judge(|jobs| clients::python_script(&python, "blender_gltf.py", &[jobs]));
}

#[test]
fn blender_3_4_shows_everything_where_osier_does() {
    let Some(blender) = clients::blender() else { return };
    judge(|jobs| clients::blender_script(&blender, "blender_gltf.py", &[jobs]));
}
