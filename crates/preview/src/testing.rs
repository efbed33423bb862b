//! Small scenes for the unit tests of this crate.

use glam::Vec3;

use osier_base::geometry::Bounds;
use osier_scene::{
    Asset, AssetKind, Camera, Clip, Material, MaterialClass, Mesh, MeshMotion, MeshObject, Placement, Points, Scene,
    Sky, Sun, Trs,
};

/// Leaf material of a grey albedo.
pub(super) fn material(color: f32, translucency: f32, ior: f32) -> Material {
    let plain = Material::plain("m".into(), MaterialClass::Leaf, [color; 3], 0.4);
    Material { ior, translucency, double_sided: true, ..plain }
}

pub(super) fn object(name: &str, mesh: Mesh) -> MeshObject {
    MeshObject { name: name.into(), mesh, motion: MeshMotion::Still, skin: None }
}

/// Balls of one diameter.
pub(super) fn balls(positions: Vec<Vec3>, width: f32) -> Points {
    Points {
        name: "d".into(),
        material: 0,
        widths: vec![width; positions.len()],
        positions,
        colors: Vec::new(),
        attributes: Vec::new(),
        moving: false,
        reach: Bounds::default(),
    }
}

/// One asset without anything in it, shown once.
pub(super) fn scene_of(materials: Vec<Material>) -> Scene {
    let asset = Asset {
        id: "a".into(),
        kind: AssetKind::Plant,
        group: String::new(),
        skeleton: None,
        meshes: Vec::new(),
        instancers: Vec::new(),
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
        materials,
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
