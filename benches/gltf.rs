//! A .glb of a million triangles, and one of many instances merged.
#![allow(missing_docs, clippy::expect_used, reason = "a bench")]
#![allow(clippy::cast_possible_truncation, reason = "small bench numbers")]

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{Quat, Vec2, Vec3};
use osier::export::gltf::{Profile, write};
use osier::export::textures::Textures;
use osier::scene::{Asset, InstanceState, Instancer, InstancerMotion, Mesh, MeshMotion, Prototype};

#[path = "../tests/it/common/bare.rs"]
mod bare;

fn grid(side: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..=side {
        for x in 0..=side {
            let (u, v) = (x as f32 / side as f32, y as f32 / side as f32);
            mesh.points.push(Vec3::new(u, 0.01 * (u * 40.0).fract(), -v));
            mesh.normals.push(Vec3::Y);
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    for y in 0..side {
        for a in (0..side).map(|x| y * (side + 1) + x) {
            mesh.triangles.extend([[a, a + 1, a + side + 1], [a + side + 1, a + 1, a + side + 2]]);
        }
    }
    mesh.with_material(0)
}

fn leaves(n: u32) -> Instancer {
    let turn = |i: u32| Quat::from_euler(glam::EulerRot::YXZ, i as f32 * 0.7, 0.3, 0.1);
    Instancer {
        name: "leaves".into(),
        prototypes: vec![Prototype::new("leaf", grid(4))],
        ids: (0..u64::from(n)).collect(),
        protos: vec![0; n as usize],
        scales: vec![Vec3::splat(0.1); n as usize],
        rest: InstanceState {
            positions: (0..n).map(|i| Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0)).collect(),
            orientations: (0..n).map(turn).collect(),
            ..InstanceState::default()
        },
        motion: InstancerMotion::Still,
        tracked: false,
    }
}

fn glb(c: &mut Criterion) {
    let terrain = bare::scene(bare::mesh(grid(708), MeshMotion::Still), 1);
    let tree = bare::scene(Asset { instancers: vec![leaves(31_250)], ..bare::asset() }, 1);
    let mut group = c.benchmark_group("glb");
    group.sample_size(10);
    for (name, scene) in [("mesh_1e6_triangles", &terrain), ("merged_1e6_triangles", &tree)] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut bytes = Vec::new();
                write(scene, &Textures::default(), Profile::Blender, &mut bytes).expect("written");
                bytes.len()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, glb);
criterion_main!(benches);
