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
use osier::export::usd::{UsdExporter, UsdOptions};
use osier::files::Folder;
use osier::scene::{
    Asset, AssetFrame, Frame, InstanceState, Instancer, InstancerFrame, InstancerMotion, Mesh, Prototype, Scene,
};

#[path = "../tests/it/common/bare.rs"]
mod bare;

fn swarm(n: u32, frames: u32) -> (Scene, Vec<Frame>) {
    let state = |f| InstanceState {
        positions: bare::places(n, f),
        orientations: (0..n).map(|i| Quat::from_rotation_y((i + f) as f32 * 0.01)).collect(),
        ..InstanceState::default()
    };
    let leaf = Mesh { points: vec![Vec3::ZERO, Vec3::X, Vec3::Y], normals: vec![Vec3::Z; 3], ..Mesh::default() };
    let instancer = Instancer {
        name: "swarm".into(),
        prototypes: vec![Prototype::new("leaf", leaf)],
        ids: (0..u64::from(n)).collect(),
        protos: vec![0; n as usize],
        scales: vec![Vec3::ONE; n as usize],
        rest: state(0),
        motion: InstancerMotion::Free,
        tracked: false,
    };
    let frame = |f| {
        let instancers = vec![InstancerFrame::State(state(f))];
        Frame { number: f, assets: vec![AssetFrame { instancers, ..AssetFrame::default() }], ..Frame::default() }
    };
    (bare::scene(Asset { instancers: vec![instancer], ..bare::asset() }, frames), (1..=frames).map(frame).collect())
}

fn cloth(points: u32, frames: u32) -> (Scene, Vec<Frame>) {
    let frame = |f| bare::cloth_frame(points, f);
    (bare::scene(bare::cloth(points), frames), (1..=frames).map(frame).collect())
}

/// Writes a clip and returns the bytes of its payload.
fn write(dir: &Path, scene: &Arc<Scene>, frames: &[Frame]) -> u64 {
    let folder = Folder::plain(dir, osier::files::WriteOptions::default()).expect("folder");
    let mut usd = UsdExporter::new(folder.clone(), Arc::new(Textures::default()), UsdOptions::default());
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
