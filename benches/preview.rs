//! What a picture costs: seconds to sort triangles into boxes and to draw, against triangles and pixels.
#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "a bench tells times")]
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "small numbers"
)]

use std::time::Instant;

use glam::{Quat, Vec3};
use osier::preview::{
    Backdrop, CameraView, Light, PreviewMaterials, Quality, RenderRequest, RenderScene, Subject, render,
};
use osier::progress::{Cancel, Silent};
use osier::scene::{
    Asset, AssetKind, Camera, Clip, InstanceState, Instancer, InstancerMotion, Maps, Material, MaterialClass, Mesh,
    MeshMotion, MeshObject, Placement, Prototype, Scene, Sky, Sun, Trs,
};

fn material() -> Material {
    Material {
        name: "leaf".into(),
        class: MaterialClass::Leaf,
        base_color: [0.1, 0.25, 0.05],
        roughness: 0.5,
        ior: 1.5,
        translucency: 0.3,
        double_sided: true,
        alpha_cutoff: None,
        height_range: 0.0,
        tile: 1.0,
        maps: Maps::default(),
        coat: None,
    }
}

/// A rough ball of about `triangles` triangles.
fn ball(triangles: usize) -> Mesh {
    let n = ((triangles as f32 / 2.0).sqrt() as u32).max(4);
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=n {
            let (a, b) = (i as f32 / n as f32 * std::f32::consts::TAU, j as f32 / n as f32 * std::f32::consts::PI);
            let d = Vec3::new(b.sin() * a.cos(), b.cos(), b.sin() * a.sin());
            mesh.points.push(d * (1.0 + 0.1 * (a * 23.0).sin() * (b * 31.0).sin()));
            mesh.normals.push(d);
        }
    }
    for i in 0..n {
        for j in 0..n {
            let at = |i: u32, j: u32| i * (n + 1) + j;
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh.with_material(0)
}

/// Leaves of 40 triangles in a ball, `triangles` in all.
fn crown(triangles: usize) -> Instancer {
    let count = triangles / 40;
    let mut state = InstanceState::default();
    for k in 0..count {
        let (a, b) = (k as f32 * 2.399_963, (k as f32 * 0.618_034).fract());
        let d = Quat::from_rotation_y(a) * Quat::from_rotation_z(k as f32 * 1.7);
        state.positions.push(d * Vec3::X * b.cbrt());
        state.orientations.push(d);
    }
    Instancer {
        name: "leaves".into(),
        prototypes: vec![Prototype::new("leaf", ball(40))],
        ids: (0..count as u64).collect(),
        protos: vec![0; count],
        scales: vec![Vec3::new(0.02, 0.03, 0.002) * (1e5 / triangles as f32).cbrt(); count],
        rest: state,
        motion: InstancerMotion::Still,
        tracked: false,
    }
}

fn scene(mesh: Option<Mesh>, leaves: Option<Instancer>) -> Scene {
    let object = |mesh| MeshObject { name: "ball".into(), mesh, motion: MeshMotion::Still, skin: None };
    let asset = Asset {
        id: "a".into(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: None,
        meshes: mesh.map(object).into_iter().collect(),
        instancers: leaves.into_iter().collect(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    };
    Scene {
        name: "s".into(),
        title: String::new(),
        seed: 0,
        hash: String::new(),
        clip: Clip::default(),
        camera: Camera { eye: Vec3::Z, target: Vec3::ZERO, vfov: 0.6, roll: 0.0 },
        sun: Sun::default(),
        sky: Sky::default(),
        images: Vec::new(),
        materials: vec![material()],
        assets: vec![asset],
        placements: vec![Placement { name: "a".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }],
        land: None,
        tables: Vec::new(),
        enum_labels: Vec::new(),
        fields: Vec::new(),
        air: Vec::new(),
        volumes: Vec::new(),
        map_sequences: Vec::new(),
    }
}

fn row(what: &str, scene: &Scene, side: u32, quality: Quality) {
    let materials = PreviewMaterials::new(scene, quality);
    let start = Instant::now();
    let world = RenderScene::new(scene, None, &materials);
    let built = start.elapsed().as_secs_f64();
    let subject = Subject::of(scene, None);
    let shot = RenderRequest {
        camera: subject.camera(CameraView::Portrait, 1.0, 0.6),
        size: [side, side],
        light: Light::new(&scene.sun, &scene.sky),
        backdrop: Backdrop::Studio { floor: Some(-1.1) },
        seed: 0,
    };
    let start = Instant::now();
    let picture = render(&world, &shot, &Cancel::default(), &Silent);
    let drawn = start.elapsed().as_secs_f64();
    assert!(picture.is_ok_and(|p| p.is_opaque()));
    println!("| {what} | {} | {side} x {side} | {quality:?} | {built:.2} | {drawn:.2} |", world.primitives());
}

fn main() {
    // `cargo test --benches` only asks whether it runs.
    let all = std::env::args().any(|a| a == "--bench");
    println!("| shape | triangles | pixels | quality | boxes, s | drawing, s |\n|---|---|---|---|---|---|");
    for triangles in if all { &[100_000, 1_000_000, 10_000_000][..] } else { &[10_000][..] } {
        row("one mesh", &scene(Some(ball(*triangles)), None), 400, Quality::Normal);
        row("leaves", &scene(None, Some(crown(*triangles))), 400, Quality::Normal);
    }
    if all {
        let leaves = scene(None, Some(crown(1_000_000)));
        for side in [200, 800, 1600] {
            row("leaves", &leaves, side, Quality::Normal);
        }
        for quality in [Quality::Draft, Quality::Fine] {
            row("leaves", &leaves, 400, quality);
        }
    }
}
