//! The land of a scene: shape, look, and how it enters the stage.

use super::looks::Look;
use crate::Result;
use crate::math::narrow;
use crate::recipe::land_keys::TerrainKeys;
use crate::rng::{mix64, word};
use crate::scene::{Asset, AssetKind, HeightField, MeshMotion, MeshObject};
use crate::surface::terrain::{Land, LandColors, Relief, land_material};

/// Name of the land's asset, placement and material.
pub const NAME: &str = "terrain";

/// Raises the land that the keys describe. `seed`: the scene's.
/// # Errors
/// `Range` for a value outside its range.
pub fn shape(keys: &TerrainKeys, seed: u64) -> Result<Land> {
    Land::raise(&Relief {
        n: keys.n,
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
pub fn look(land: &Land, keys: &TerrainKeys, seed: u64) -> Result<Look> {
    let own = LandColors::default();
    let colors = LandColors {
        earth: keys.color.unwrap_or(own.earth),
        grass: keys.color2.unwrap_or(own.grass),
        rock: keys.rock.unwrap_or(own.rock),
        cover: narrow(keys.cover),
        steep: narrow(keys.steep),
    };
    let surface = land_material(land, &colors, NAME, keys.side, mix64(&[seed, word(NAME)]))?;
    let mut look = Look::default();
    look.add(surface.material, surface.images);
    Ok(look)
}

/// The land's asset; `material`: index of its material in the scene.
pub fn asset(land: &Land, material: u32) -> Asset {
    let object = |(name, mesh): (String, crate::scene::Mesh)| MeshObject {
        name,
        mesh: mesh.with_material(material),
        motion: MeshMotion::Still,
        skin: None,
    };
    Asset {
        id: NAME.into(),
        kind: AssetKind::Terrain,
        skeleton: None,
        meshes: land.tiles().into_iter().map(object).collect(),
        instancers: Vec::new(),
        points: Vec::new(),
        curves: Vec::new(),
    }
}

/// The land's heights for the exporters of fields.
pub fn field(land: Land) -> HeightField {
    HeightField { name: NAME.into(), side: land.side, size: land.size, heights: land.heights }
}
