//! The terrain of a scene: its heights, materials and asset.

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::scene::builder::SceneBuilder;
use crate::recipe::scene::TerrainKeys;
use osier_base::Result;
use osier_base::math::narrow;
use osier_base::rng::{mix64, word};
use osier_plants::surface::terrain::{Terrain, TerrainColors, TerrainParams, terrain_material};
use osier_scene::{Asset, AssetKind, Camera, HeightField, MeshMotion, MeshObject, Trs};

/// Name of the terrain's asset, placement and material.
pub const NAME: &str = "terrain";
/// Height of a standing person's eye above the ground, m: where a buried camera is lifted to.
const EYE_HEIGHT: f32 = 1.6;

/// Generates the terrain that the keys describe. `seed`: the scene's, used where the terrain has none.
/// # Errors
/// `Range` for a value outside its range.
pub(crate) fn generate_terrain(keys: &TerrainKeys, seed: u64) -> Result<Terrain> {
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

/// Material and images of a terrain: earth, grass, and rock where it is steep.
/// # Errors
/// `Range` for a value that the painter of the map refuses.
pub(crate) fn terrain_materials(terrain: &Terrain, keys: &TerrainKeys, seed: u64) -> Result<MaterialSet> {
    let own = TerrainColors::default();
    let colors = TerrainColors {
        earth: keys.color.unwrap_or(own.earth),
        grass: keys.color2.unwrap_or(own.grass),
        rock: keys.rock.unwrap_or(own.rock),
        cover: narrow(keys.cover),
        steep: narrow(keys.steep),
    };
    let surface = terrain_material(terrain, &colors, NAME, keys.side, mix64(&[seed, word(NAME)]))?;
    let mut set = MaterialSet::default();
    set.add(surface.material, surface.images)?;
    Ok(set)
}

/// The terrain's asset, one mesh per tile; `material`: index of its material in the scene.
pub(crate) fn terrain_asset(terrain: &Terrain, material: u32) -> Asset {
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
        meshes: terrain.tiles().into_iter().map(object).collect(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    }
}

/// Adds the terrain's asset at the origin.
/// # Errors
/// As [`terrain_materials`]; `TooMany`.
pub(crate) fn add_terrain(terrain: &Terrain, keys: &TerrainKeys, seed: u64, builder: &mut SceneBuilder) -> Result<()> {
    let materials = builder.add_materials(terrain_materials(terrain, keys, seed)?)?;
    builder.add_placed(terrain_asset(terrain, materials.first_material), Trs::IDENTITY, None);
    Ok(())
}

/// The terrain's heights, for exporters of height fields.
pub(crate) fn terrain_height_field(terrain: Terrain) -> HeightField {
    HeightField { name: NAME.into(), side: terrain.side, size: terrain.size, heights: terrain.heights }
}

/// Lifts a camera that lies below the terrain, together with its target: with another seed, hills rise where the scene's
/// camera stands.
pub(crate) fn lift_camera(camera: &mut Camera, terrain: &Terrain) {
    let (eye, half) = (camera.eye, terrain.size * 0.5);
    let ground = terrain.height_at(eye.x, eye.z);
    if eye.x.abs() <= half && eye.z.abs() <= half && eye.y < ground {
        let rise = ground + EYE_HEIGHT - eye.y;
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
            let terrain = Terrain::generate(&TerrainParams { seed, ..TerrainParams::default() }).expect("land");
            let (x, z) = (terrain.size * 0.1, terrain.size * -0.3);
            let ground = terrain.height_at(x, z);
            let mut camera = view(Vec3::new(x, ground - 7.0, z));
            lift_camera(&mut camera, &terrain);
            assert!((camera.eye.y - ground - EYE_HEIGHT).abs() < 1e-4);
            assert!((camera.target - camera.eye).abs_diff_eq(Vec3::new(3.0, -1.0, 2.0), 1e-4));
            for eye in [Vec3::new(x, ground + 0.2, z), Vec3::new(terrain.size, ground - 50.0, z)] {
                let mut camera = view(eye);
                lift_camera(&mut camera, &terrain);
                assert_eq!(camera, view(eye), "seed {seed}");
            }
        }
    }
}
