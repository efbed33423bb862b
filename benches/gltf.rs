//! A .glb of a million triangles, and one of many instances merged.
#![allow(missing_docs, clippy::expect_used, reason = "a bench")]
#![allow(clippy::cast_possible_truncation, reason = "small bench numbers")]

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{Quat, Vec2, Vec3};
use osier::export::gltf::{Profile, write};
use osier::export::textures::Textures;
use osier::scene::{
    Asset, AssetKind, Camera, Clip, InstanceState, Instancer, InstancerMotion, Maps, Material, MaterialClass, Mesh,
    MeshMotion, MeshObject, Placement, Prototype, Scene, Sky, Sun, Trs,
};

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

fn scene(asset: Asset) -> Scene {
    let material = Material {
        name: "plain".into(),
        class: MaterialClass::Ground,
        base_color: [0.5; 3],
        roughness: 0.8,
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: 0.01,
        tile: 1.0,
        maps: Maps::default(),
    };
    Scene {
        name: "bench".into(),
        title: "bench".into(),
        seed: 1,
        hash: "0".repeat(64),
        clip: Clip::default(),
        camera: Camera { eye: Vec3::ONE, target: Vec3::ZERO, vfov: 0.6, roll: 0.0 },
        sun: Sun::default(),
        sky: Sky::default(),
        images: Vec::new(),
        materials: vec![material],
        assets: vec![asset],
        placements: vec![Placement { name: "one".into(), asset: 0, transform: Trs::IDENTITY }],
    }
}

fn asset() -> Asset {
    Asset {
        id: "one".into(),
        kind: AssetKind::Terrain,
        skeleton: None,
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    }
}

fn leaves(n: u32) -> Instancer {
    let turn = |i: u32| Quat::from_euler(glam::EulerRot::YXZ, i as f32 * 0.7, 0.3, 0.1);
    Instancer {
        name: "leaves".into(),
        prototypes: vec![Prototype { name: "leaf".into(), mesh: grid(4) }],
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
    let object = MeshObject { name: "grid".into(), mesh: grid(708), motion: MeshMotion::Still, skin: None };
    let terrain = scene(Asset { meshes: vec![object], ..asset() });
    let tree = scene(Asset { instancers: vec![leaves(31_250)], ..asset() });
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
