//! Text of POV-Ray meshes: bytes per second.
#![allow(missing_docs, reason = "criterion's macros make public items")]
#![allow(clippy::expect_used, reason = "a bench fails by panicking")]

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{Vec2, Vec3};
use osier::export::Exporter as _;
use osier::export::pov::{PovExporter, PovOptions};
use osier::files::Folder;
use osier::scene::{Mesh, MeshMotion};

#[path = "../tests/it/common/bare.rs"]
mod bare;

/// A bumpy sheet of `n` by `n` vertices with normals and texture coordinates.
fn sheet(n: u16) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..n {
        for x in 0..n {
            let (u, v) = (f32::from(x) / f32::from(n), f32::from(y) / f32::from(n));
            let h = osier::math::sin_f32(u * 37.1) * osier::math::cos_f32(v * 23.7);
            mesh.points.push(Vec3::new(u * 3.3, h * 0.11, v * 2.9));
            mesh.normals.push(Vec3::new(-h, 1.0 + u, v * h).normalize());
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    let n = u32::from(n);
    for y in 0..n - 1 {
        for x in 0..n - 1 {
            let a = y * n + x;
            mesh.triangles.extend([[a, a + n, a + 1], [a + 1, a + n, a + n + 1]]);
        }
    }
    mesh.with_material(0)
}

/// Everything `begin` does for one mesh of half a million triangles, into memory, on one thread.
fn mesh2(c: &mut Criterion) {
    let scene = Arc::new(bare::scene(bare::mesh(sheet(500), MeshMotion::Still), 1));
    let write = || {
        let folder = Folder::memory();
        let mut pov = PovExporter::new(folder.clone(), std::sync::Arc::default(), PovOptions::default());
        pov.begin(&scene).expect("begin");
        folder.files().iter().map(|f| f.bytes).sum::<u64>()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("pool");
    let mut group = c.benchmark_group("pov");
    group.throughput(Throughput::Bytes(write())).sample_size(10);
    group.bench_function("mesh2 of 500k triangles, one thread", |b| b.iter(|| pool.install(|| black_box(write()))));
    group.finish();
}

criterion_group!(benches, mesh2);
criterion_main!(benches);
