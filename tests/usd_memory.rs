//! Writing a clip takes no more memory than writing one frame.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests panic and look at the disk themselves")]
#![cfg(target_os = "linux")]

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use osier::export::Exporter as _;
use osier::export::textures::Textures;
use osier::export::usd::{Options, Usd};
use osier::fence::Folder;
use osier::scene::{
    Asset, AssetFrame, AssetKind, Camera, Clip, Frame, Mesh, MeshFrame, MeshMotion, MeshObject, Placement, Scene, Sky,
    Sun, Trs,
};

const POINTS: u32 = 100_000;
const FRAMES: u32 = 120;

/// Most memory this process ever had, bytes.
fn high_water() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("status");
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).expect("VmHWM");
    line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("number") * 1024
}

fn point(i: u32, f: u32) -> Vec3 {
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    Vec3::new((i % 317) as f32, (i / 317) as f32, ((i * f) % 1009) as f32 * 0.01)
}

fn cloth() -> Scene {
    let mesh = Mesh {
        points: (0..POINTS).map(|i| point(i, 0)).collect(),
        normals: vec![Vec3::Z; POINTS as usize],
        triangles: (0..POINTS - 2).map(|i| [i, i + 1, i + 2]).collect(),
        ..Mesh::default()
    };
    let object = MeshObject { name: "cloth".into(), mesh, motion: MeshMotion::Deforming, skin: None };
    let asset = Asset {
        id: "cloth".into(),
        kind: AssetKind::Plant,
        skeleton: None,
        meshes: vec![object],
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    };
    Scene {
        name: "clip".into(),
        title: String::new(),
        seed: 1,
        hash: String::new(),
        clip: Clip { start: 1, end: FRAMES, fps: (24, 1) },
        camera: Camera { eye: Vec3::ONE, target: Vec3::ZERO, vfov: 0.6, roll: 0.0 },
        sun: Sun::default(),
        sky: Sky::default(),
        images: Vec::new(),
        materials: Vec::new(),
        assets: vec![asset],
        placements: vec![Placement { name: "cloth".into(), asset: 0, transform: Trs::IDENTITY }],
    }
}

#[test]
fn memory_does_not_grow_with_the_clip() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("usd_memory");
    let _ = std::fs::remove_dir_all(&dir);
    let scene = Arc::new(cloth());
    let before = high_water();
    let folder = Folder::open(&dir).expect("folder");
    let mut usd = Usd::new(folder.clone(), Arc::new(Textures::encode(&scene).expect("pictures")), Options::default());
    usd.begin(&scene).expect("begin");
    for f in 1..=FRAMES {
        let points: Vec<Vec3> = (0..POINTS).map(|i| point(i, f)).collect();
        let velocities = points.iter().map(|p| *p * 0.5).collect();
        let mesh = MeshFrame::Points { points, normals: Vec::new(), velocities };
        usd.frame(&Frame { number: f, assets: vec![AssetFrame { meshes: vec![mesh], ..AssetFrame::default() }] })
            .expect("frame");
    }
    usd.finish().expect("finish");
    let grown = high_water() - before;
    let one = u64::from(POINTS) * 24;
    let bytes = folder.files().iter().find(|f| f.kind == "usdc").expect("usdc").bytes;
    let _ = std::fs::remove_dir_all(&dir);
    assert!(bytes > u64::from(FRAMES) * one, "{bytes} bytes");
    assert!(grown <= one + (64 << 20), "{grown} bytes more than before");
}
