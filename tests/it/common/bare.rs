//! Scenes of one thing, for benches and for tests of memory.
#![allow(dead_code, reason = "each file uses its own share")]

use glam::Vec3;
use osier::scene::{
    Asset, AssetFrame, AssetKind, Camera, Clip, Frame, Maps, Material, MaterialClass, Mesh, MeshFrame, MeshMotion,
    MeshObject, Placement, Scene, Sky, Sun, Trs,
};

/// An asset that holds nothing yet.
pub fn asset() -> Asset {
    Asset {
        id: "it".into(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: None,
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}

/// An asset of one mesh.
pub fn mesh(mesh: Mesh, motion: MeshMotion) -> Asset {
    Asset { meshes: vec![MeshObject { name: "mesh".into(), mesh, motion, skin: None }], ..asset() }
}

/// Grey.
pub fn material() -> Material {
    Material {
        name: "plain".into(),
        class: MaterialClass::Bark,
        base_color: [0.5; 3],
        roughness: 0.8,
        ior: 1.5,
        translucency: 0.0,
        double_sided: false,
        alpha_cutoff: None,
        height_range: 0.01,
        tile: 1.0,
        maps: Maps::default(),
        coat: None,
    }
}

/// A scene of one asset, placed once, with one material.
pub fn scene(asset: Asset, frames: u32) -> Scene {
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
        materials: vec![material()],
        assets: vec![asset],
        placements: vec![Placement { name: "it".into(), asset: 0, transform: Trs::IDENTITY, phase: 0 }],
        land: None,
        tables: Vec::new(),
        enum_labels: Vec::new(),
        fields: Vec::new(),
        air: Vec::new(),
        volumes: Vec::new(),
        map_sequences: Vec::new(),
    }
}

fn at(i: u32, f: u32) -> Vec3 {
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    Vec3::new((i % 317) as f32, (i / 317) as f32, (i.wrapping_mul(f) % 1009) as f32 * 0.01)
}

/// Places of `n` things at a frame, other ones at every frame.
pub fn places(n: u32, frame: u32) -> Vec<Vec3> {
    (0..n).map(|i| at(i, frame)).collect()
}

/// A deforming strip of `n` points, without material.
pub fn cloth(n: u32) -> Asset {
    let strip = Mesh {
        points: places(n, 0),
        normals: vec![Vec3::Z; n as usize],
        triangles: (0..n - 2).map(|i| [i, i + 1, i + 2]).collect(),
        ..Mesh::default()
    };
    mesh(strip, MeshMotion::Deforming)
}

/// A frame of [`cloth`].
pub fn cloth_frame(n: u32, number: u32) -> Frame {
    let points = places(n, number);
    let velocities = points.iter().map(|p| *p * 0.5).collect();
    let mesh = MeshFrame::Points { points, normals: Vec::new(), velocities };
    Frame { number, assets: vec![AssetFrame { meshes: vec![mesh], ..AssetFrame::default() }], ..Frame::default() }
}
