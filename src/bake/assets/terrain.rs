//! The land of a scene: shape, look, and how it enters the stage.

use crate::bake::assets::material_set::MaterialSet;
use crate::recipe::scene::TerrainKeys;
use osier_base::Result;
use osier_base::math::narrow;
use osier_base::rng::{mix64, word};
use osier_plants::surface::terrain::{Terrain, TerrainColors, TerrainParams, terrain_material};
use osier_scene::{Asset, AssetKind, Camera, HeightField, MeshMotion, MeshObject};

/// Name of the land's asset, placement and material.
pub const NAME: &str = "terrain";
/// Height of an eye above the ground that it stands on, m.
const EYE: f32 = 1.6;

/// Raises the land that the keys describe. `seed`: the scene's.
/// # Errors
/// `Range` for a value outside its range.
pub fn shape(keys: &TerrainKeys, seed: u64) -> Result<Terrain> {
    Terrain::generate(&TerrainParams {
        n: keys.subdivisions,
        size: keys.size,
        amplitude: keys.amplitude,
        exponent: keys.exponent,
        corners: keys.corners,
        tileable: keys.tileable,
        paper: keys.paper,
        floor: keys.floor,
        smooth: keys.smooth,
        stride: keys.stride,
        seed: if keys.seed == 0 { seed } else { mix64(&[seed, keys.seed]) },
    })
}

/// What the land looks like.
/// # Errors
/// What the painter refuses.
pub fn look(land: &Terrain, keys: &TerrainKeys, seed: u64) -> Result<MaterialSet> {
    let own = TerrainColors::default();
    let colors = TerrainColors {
        earth: keys.color.unwrap_or(own.earth),
        grass: keys.color2.unwrap_or(own.grass),
        rock: keys.rock.unwrap_or(own.rock),
        cover: narrow(keys.cover),
        steep: narrow(keys.steep),
    };
    let surface = terrain_material(land, &colors, NAME, keys.side, mix64(&[seed, word(NAME)]))?;
    let mut look = MaterialSet::default();
    look.add(surface.material, surface.images);
    Ok(look)
}

/// The land's asset; `material`: index of its material in the scene.
pub fn asset(land: &Terrain, material: u32) -> Asset {
    let object = |(name, mesh): (String, osier_scene::Mesh)| MeshObject {
        name,
        mesh: mesh.with_material(material),
        motion: MeshMotion::Still,
        skin: None,
    };
    Asset {
        id: NAME.into(),
        kind: AssetKind::Terrain,
        group: String::new(),
        skeleton: None,
        meshes: land.tiles().into_iter().map(object).collect(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    }
}

/// The land's heights for the exporters of fields.
pub fn field(land: Terrain) -> HeightField {
    HeightField { name: NAME.into(), side: land.side, size: land.size, heights: land.heights }
}

/// Lifts a camera that the land of another seed would bury, and what it looks at with it.
pub fn lift_camera(camera: &mut Camera, land: &Terrain) {
    let (eye, half) = (camera.eye, land.size * 0.5);
    let ground = land.height_at(eye.x, eye.z);
    if eye.x.abs() <= half && eye.z.abs() <= half && eye.y < ground {
        let rise = ground + EYE - eye.y;
        camera.eye.y += rise;
        camera.target.y += rise;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn no_seed_buries_the_camera_and_others_stay() {
        let view = |eye| Camera { eye, target: eye + Vec3::new(3.0, -1.0, 2.0), vfov: 0.7, roll: 0.0 };
        for seed in 0..16 {
            let land = Terrain::generate(&TerrainParams { seed, ..TerrainParams::default() }).expect("land");
            let (x, z) = (land.size * 0.1, land.size * -0.3);
            let ground = land.height_at(x, z);
            let mut camera = view(Vec3::new(x, ground - 7.0, z));
            lift_camera(&mut camera, &land);
            assert!((camera.eye.y - ground - EYE).abs() < 1e-4);
            assert!((camera.target - camera.eye).abs_diff_eq(Vec3::new(3.0, -1.0, 2.0), 1e-4));
            for eye in [Vec3::new(x, ground + 0.2, z), Vec3::new(land.size, ground - 50.0, z)] {
                let mut camera = view(eye);
                lift_camera(&mut camera, &land);
                assert_eq!(camera, view(eye), "seed {seed}");
            }
        }
    }
}
