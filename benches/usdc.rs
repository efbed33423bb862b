//! Crate files: bytes per second, with hashing and writing, of a deforming mesh and of an instancer.
//!
//! `cargo bench --bench usdc`
#![allow(missing_docs, clippy::expect_used, reason = "a bench is no library")]

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{Quat, Vec3};
use osier::export::Exporter as _;
use osier::export::textures::Textures;
use osier::export::usd::{Options, Usd};
use osier::fence::Folder;
use osier::scene::{
    Asset, AssetFrame, AssetKind, Camera, Clip, Frame, InstanceState, Instancer, InstancerFrame, InstancerMotion, Mesh,
    MeshFrame, MeshMotion, MeshObject, Placement, Prototype, Scene, Sky, Sun, Trs,
};

fn scene(asset: Asset, frames: u32) -> Scene {
    Scene {
        name: "clip".into(),
        title: String::new(),
        seed: 1,
        hash: String::new(),
        clip: Clip { start: 1, end: frames, fps: (24, 1) },
        camera: Camera { eye: Vec3::ONE, target: Vec3::ZERO, vfov: 0.6, roll: 0.0 },
        sun: Sun::default(),
        sky: Sky::default(),
        images: Vec::new(),
        materials: Vec::new(),
        assets: vec![asset],
        placements: vec![Placement { name: "it".into(), asset: 0, transform: Trs::IDENTITY }],
    }
}

fn bare() -> Asset {
    Asset {
        id: "it".into(),
        kind: AssetKind::Plant,
        skeleton: None,
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    }
}

fn place(i: u32, f: u32) -> Vec3 {
    Vec3::new((i % 317) as f32, (i / 317) as f32, (i.wrapping_mul(f) % 1009) as f32 * 0.01)
}

fn cloth(points: u32, frames: u32) -> (Scene, Vec<Frame>) {
    let mesh = Mesh {
        points: (0..points).map(|i| place(i, 0)).collect(),
        normals: vec![Vec3::Z; points as usize],
        triangles: (0..points - 2).map(|i| [i, i + 1, i + 2]).collect(),
        ..Mesh::default()
    };
    let object = MeshObject { name: "cloth".into(), mesh, motion: MeshMotion::Deforming, skin: None };
    let frame = |f| {
        let points: Vec<Vec3> = (0..points).map(|i| place(i, f)).collect();
        let velocities = points.iter().map(|p| *p * 0.5).collect();
        let mesh = MeshFrame::Points { points, normals: Vec::new(), velocities };
        Frame { number: f, assets: vec![AssetFrame { meshes: vec![mesh], ..AssetFrame::default() }] }
    };
    (scene(Asset { meshes: vec![object], ..bare() }, frames), (1..=frames).map(frame).collect())
}

fn swarm(n: u32, frames: u32) -> (Scene, Vec<Frame>) {
    let state = |f| InstanceState {
        positions: (0..n).map(|i| place(i, f)).collect(),
        orientations: (0..n).map(|i| Quat::from_rotation_y((i + f) as f32 * 0.01)).collect(),
        ..InstanceState::default()
    };
    let leaf = Mesh { points: vec![Vec3::ZERO, Vec3::X, Vec3::Y], normals: vec![Vec3::Z; 3], ..Mesh::default() };
    let instancer = Instancer {
        name: "swarm".into(),
        prototypes: vec![Prototype { name: "leaf".into(), mesh: leaf }],
        ids: (0..u64::from(n)).collect(),
        protos: vec![0; n as usize],
        scales: vec![Vec3::ONE; n as usize],
        rest: state(0),
        motion: InstancerMotion::Free,
        tracked: false,
    };
    let frame = |f| {
        let instancers = vec![InstancerFrame::State(state(f))];
        Frame { number: f, assets: vec![AssetFrame { instancers, ..AssetFrame::default() }] }
    };
    (scene(Asset { instancers: vec![instancer], ..bare() }, frames), (1..=frames).map(frame).collect())
}

/// Writes a clip and returns the bytes of its payload.
fn write(dir: &Path, scene: &Arc<Scene>, frames: &[Frame]) -> u64 {
    let folder = Folder::plain(dir, osier::fence::WriteOptions::default()).expect("folder");
    let mut usd = Usd::new(folder.clone(), Arc::new(Textures::default()), Options::default());
    usd.begin(scene).expect("begin");
    for frame in frames {
        usd.frame(frame).expect("frame");
    }
    usd.finish().expect("finish");
    folder.files().iter().filter(|f| f.kind == "usdc").map(|f| f.bytes).sum()
}

/// A folder in memory where there is one: the disk's own speed is not ours.
fn temporary() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("folder")
}

fn usdc(c: &mut Criterion) {
    let mut group = c.benchmark_group("usdc");
    group.sample_size(10);
    for (name, (scene, frames)) in [("mesh 100k x 60", cloth(100_000, 60)), ("instancer 2000 x 240", swarm(2000, 240))]
    {
        let (scene, dir) = (Arc::new(scene), temporary());
        let bytes = write(dir.path(), &scene, &frames);
        group.throughput(Throughput::Bytes(bytes));
        group.bench_function(name, |b| b.iter(|| black_box(write(dir.path(), &scene, &frames))));
    }
    group.finish();
}

criterion_group!(benches, usdc);
criterion_main!(benches);
