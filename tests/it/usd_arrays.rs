//! USD crate files give back the arrays that went in, bit for bit.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]

use crate::common::clients;
use crate::common::synthetic;
use std::path::Path;
use std::sync::Arc;

use glam::{Quat, Vec3};
use half::f16;
use osier::export::Exporter as _;
use osier::export::textures::Textures;
use osier::export::usd::{UsdExporter, UsdOptions};
use osier::files::Folder;
use osier::scene::{AssetFrame, CurvesFrame, Frame, InstancerFrame, MeshFrame, PointsFrame, Scene, instance_states};
use serde_json::{Map, Value, json};

fn bits(v: &[Vec3]) -> Value {
    v.iter().flat_map(|p| p.to_array()).map(|x| (x + 0.0).to_bits()).collect::<Vec<u32>>().into()
}

fn half_bits(v: &[Quat]) -> Value {
    v.iter().flat_map(|q| q.to_array()).map(|x| f16::from_f32(x + 0.0).to_bits()).collect::<Vec<u16>>().into()
}

/// What is expected of one attribute.
struct Attr {
    file: &'static str,
    prim: &'static str,
    name: &'static str,
    kind: &'static str,
}

impl Attr {
    fn constant(&self, value: Value) -> Value {
        json!({"file": self.file, "prim": self.prim, "attr": self.name, "type": self.kind, "times": [],
            "at": {"default": value}})
    }

    /// Every frame has a sample; first, middle and last are compared.
    fn sampled(&self, frames: &[Frame], asset: usize, f: impl Fn(&AssetFrame) -> Value) -> Value {
        let times: Vec<f64> = frames.iter().map(|f| f64::from(f.number)).collect();
        let mut at = Map::new();
        for frame in [&frames[0], &frames[frames.len() / 2], &frames[frames.len() - 1]] {
            at.insert(frame.number.to_string(), f(&frame.assets[asset]));
        }
        json!({"file": self.file, "prim": self.prim, "attr": self.name, "type": self.kind, "times": times, "at": at})
    }
}

/// Quaternions of the flying things at each frame: the first with w >= 0, none turned against the one before.
fn flights(scene: &Scene, frames: &[Frame]) -> Vec<Vec<Quat>> {
    let asset = &scene.assets[2];
    let side = |q: Quat, last: Quat| {
        let q = q.normalize();
        if q.dot(last) < 0.0 { -q } else { q }
    };
    let mut last: Vec<Quat> = asset.instancers[0].rest.orientations.clone();
    let mut out = Vec::new();
    for frame in frames {
        let state = instance_states(asset, &asset.instancers[0], 0, &frame.assets[2]);
        last = state.orientations.iter().zip(&last).map(|(q, l)| side(*q, *l)).collect();
        out.push(last.clone());
    }
    out
}

fn meshes(scene: &Scene, frames: &[Frame]) -> Vec<Value> {
    let body = |name, kind| Attr { file: "cache.usdc", prim: "/cache/body", name, kind };
    let pool = |name, kind| Attr { file: "misc.usdc", prim: "/misc/pool", name, kind };
    let mesh = &scene.assets[1].meshes[0].mesh;
    let corners = |m: &osier::scene::Mesh| Value::from(m.triangles.as_flattened().to_vec());
    let points = |s: &AssetFrame| match s.mesh(0) {
        MeshFrame::Points { points, .. } => bits(points),
        MeshFrame::Whole { mesh, .. } => bits(&mesh.points),
        MeshFrame::Same => Value::Null,
    };
    let speeds = |s: &AssetFrame| match s.mesh(0) {
        MeshFrame::Points { velocities, .. } | MeshFrame::Whole { velocities, .. } => bits(velocities),
        MeshFrame::Same => Value::Null,
    };
    let whole = |f: &dyn Fn(&osier::scene::Mesh) -> Value, s: &AssetFrame| match s.mesh(0) {
        MeshFrame::Whole { mesh, .. } => f(mesh),
        _ => Value::Null,
    };
    let uvs: Vec<u32> = mesh.uvs.iter().flat_map(|v| v.to_array()).map(|x| (x + 0.0).to_bits()).collect();
    vec![
        body("points", "point3f[]").sampled(frames, 1, points),
        body("velocities", "vector3f[]").sampled(frames, 1, speeds),
        body("normals", "normal3f[]").constant(bits(&mesh.normals)),
        body("faceVertexIndices", "int[]").constant(corners(mesh)),
        body("faceVertexCounts", "int[]").constant(vec![3; mesh.triangles.len()].into()),
        body("primvars:st", "texCoord2f[]").constant(uvs.into()),
        body("primvars:st:indices", "int[]").constant(corners(mesh)),
        pool("points", "point3f[]").sampled(frames, 3, points),
        pool("velocities", "vector3f[]").sampled(frames, 3, speeds),
        pool("normals", "normal3f[]").sampled(frames, 3, |s| whole(&|m| bits(&m.normals), s)),
        pool("faceVertexIndices", "int[]").sampled(frames, 3, |s| whole(&corners, s)),
    ]
}

fn tracks(scene: &Scene, frames: &[Frame]) -> Vec<Value> {
    let flying = |name, kind| Attr { file: "tracks.usdc", prim: "/tracks/flying", name, kind };
    let twin = |name, kind| Attr { file: "tracks.points.usdc", prim: "/tracks/flying", name, kind };
    let instancer = &scene.assets[2].instancers[0];
    let n = instancer.len();
    let turns = flights(scene, frames);
    let at = |s: &AssetFrame| frames.iter().position(|f| std::ptr::eq(&f.assets[2], s)).expect("frame");
    let state = |s: &AssetFrame| match s.instancer(0) {
        InstancerFrame::State(state) => state.clone(),
        InstancerFrame::Same => panic!("no state"),
    };
    let dead = |s: &AssetFrame| Value::from((0..n).filter(|&i| !state(s).is_alive(i)).collect::<Vec<_>>());
    let scales = |s: &AssetFrame| -> Vec<Vec3> {
        instancer.scales.iter().enumerate().map(|(i, scale)| *scale * state(s).size(i)).collect()
    };
    let ids: Value = (0..n).collect::<Vec<_>>().into();
    let floats =
        |q: &[Quat]| Value::from(q.iter().flat_map(|q| q.to_array()).map(|x| (x + 0.0).to_bits()).collect::<Vec<_>>());
    let degrees = |v: &[Vec3]| {
        let turned: Vec<Vec3> = v.iter().map(|w| *w * (180.0 / std::f32::consts::PI)).collect();
        bits(&turned)
    };
    vec![
        flying("ids", "int64[]").constant(ids.clone()),
        flying("protoIndices", "int[]").constant(instancer.protos.clone().into()),
        flying("scales", "float3[]").sampled(frames, 2, |s| bits(&scales(s))),
        flying("positions", "point3f[]").sampled(frames, 2, |s| bits(&state(s).positions)),
        flying("velocities", "vector3f[]").sampled(frames, 2, |s| bits(&state(s).velocities)),
        flying("angularVelocities", "vector3f[]").sampled(frames, 2, |s| degrees(&state(s).angular_velocities)),
        flying("orientations", "quath[]").sampled(frames, 2, |s| half_bits(&turns[at(s)])),
        flying("invisibleIds", "int64[]").sampled(frames, 2, dead),
        twin("ids", "int64[]").constant(ids),
        twin("points", "point3f[]").sampled(frames, 2, |s| bits(&state(s).positions)),
        twin("primvars:orient", "quatf[]").sampled(frames, 2, |s| floats(&turns[at(s)])),
        twin("primvars:scale", "float3[]").sampled(frames, 2, |s| bits(&scales(s))),
        twin("primvars:proto", "int[]").constant(instancer.protos.clone().into()),
    ]
}

fn others(scene: &Scene, frames: &[Frame]) -> Vec<Value> {
    let rain = |name, kind| Attr { file: "misc.usdc", prim: "/misc/rain", name, kind };
    let hairs = |name, kind| Attr { file: "misc.usdc", prim: "/misc/hairs", name, kind };
    let joints = Attr { file: "rig.usdc", prim: "/rig/skel/skeleton", name: "joints", kind: "token[]" };
    let PointsFrame::State { .. } = frames[0].assets[3].points(0) else { panic!("rain stands still") };
    let drops = |s: &AssetFrame| match s.points(0) {
        PointsFrame::State { positions, .. } => bits(positions),
        PointsFrame::Same => Value::Null,
    };
    let widths = |s: &AssetFrame| match s.points(0) {
        PointsFrame::State { widths, .. } => widths.iter().map(|w| w.to_bits()).collect::<Vec<_>>().into(),
        PointsFrame::Same => Value::Null,
    };
    let strands = |s: &AssetFrame| match s.curves(0) {
        CurvesFrame::Points(points) => bits(points),
        CurvesFrame::Same => Value::Null,
    };
    vec![
        rain("points", "point3f[]").sampled(frames, 3, drops),
        rain("widths", "float[]").sampled(frames, 3, widths),
        hairs("points", "point3f[]").sampled(frames, 3, strands),
        hairs("curveVertexCounts", "int[]").constant(scene.assets[3].curves[0].counts.clone().into()),
        joints.constant(json!(["root", "root/mid", "root/mid/top"])),
    ]
}

fn bake(dir: &Path, scene: &Scene, frames: &[Frame]) -> Folder {
    let _ = std::fs::remove_dir_all(dir);
    let folder = Folder::open(dir).expect("folder");
    let textures = Arc::new(Textures::encode(scene).expect("pictures"));
    let mut usd = UsdExporter::new(folder.clone(), textures, UsdOptions::default());
    usd.begin(&Arc::new(scene.clone())).expect("begin");
    for frame in frames {
        usd.frame(frame).expect("frame");
    }
    usd.finish().expect("finish");
    folder
}

#[test]
fn arrays_come_back_bit_for_bit() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("usd_arrays");
    let (scene, frames) = synthetic::scene();
    bake(&dir, &scene, &frames);
    let mut wanted = meshes(&scene, &frames);
    wanted.extend(tracks(&scene, &frames));
    wanted.extend(others(&scene, &frames));
    let file = dir.join("expected.json");
    std::fs::write(&file, Value::from(wanted).to_string()).expect("expectations");
    let Some(python) = clients::python() else { return };
    let folder = dir.join("usd");
    clients::python_script(&python, "usd_arrays.py", &[&folder.to_string_lossy(), &file.to_string_lossy()]);
}

#[test]
fn the_same_bytes_at_any_number_of_threads() {
    let (scene, frames) = synthetic::scene();
    let hashes = |threads: usize| {
        let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("usd_threads_{threads}"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        let folder = pool.install(|| bake(&dir, &scene, &frames));
        folder.files().into_iter().map(|f| (f.path, f.blake3)).collect::<Vec<_>>()
    };
    let one = hashes(1);
    assert_eq!(one.len(), 3 + 1 + 7 + 1, "{one:?}");
    assert!(one == hashes(2) && one == hashes(5));
}

#[test]
fn what_is_not_finite_is_named_and_leaves_no_file() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("usd_nan");
    let _ = std::fs::remove_dir_all(&dir);
    let (scene, mut frames) = synthetic::scene();
    let MeshFrame::Points { points, .. } = &mut frames[3].assets[1].meshes[0] else { panic!("no cache") };
    points[5].y = f32::NAN;
    let folder = Folder::open(&dir).expect("folder");
    let mut usd =
        UsdExporter::new(folder, Arc::new(Textures::encode(&scene).expect("pictures")), UsdOptions::default());
    usd.begin(&Arc::new(scene)).expect("begin");
    let e = frames.iter().try_for_each(|f| usd.frame(f)).expect_err("not a number");
    assert_eq!(e.to_string(), "X001: /cache/body.points, frame 4: number 16 is not finite");
    drop(usd);
    assert_eq!(std::fs::read_dir(dir.join("usd")).expect("folder").count(), 0);
}

#[test]
fn text_that_grows_too_large_is_refused() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("usd_large");
    let _ = std::fs::remove_dir_all(&dir);
    let (mut scene, _) = synthetic::scene();
    let mesh = scene.assets[4].meshes[0].mesh.clone();
    while scene.assets[4].meshes[0].mesh.points.len() < 400_000 {
        let whole = scene.assets[4].meshes[0].mesh.clone();
        scene.assets[4].meshes[0].mesh.append(&whole);
    }
    assert!(mesh.points.len() < 10);
    let textures = Arc::new(Textures::encode(&scene).expect("pictures"));
    let scene = Arc::new(scene);
    let options = |file: &str| UsdOptions { file: Some(file.into()), ..UsdOptions::default() };
    let folder = Folder::open(&dir).expect("folder");
    let e = UsdExporter::new(folder.clone(), Arc::clone(&textures), options("a.usda"))
        .begin(&scene)
        .expect_err("too large");
    assert!(e.to_string().starts_with("X004: "), "{e}");
    let mut usdc = UsdExporter::new(folder, textures, options("a.usdc"));
    usdc.begin(&scene).expect("begin");
    usdc.finish().expect("finish");
}
