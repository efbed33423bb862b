//! Options of the bark's mesh, and the indices of its two materials.

use crate::bake::BakeContext;
use crate::recipe::scene::{BarkUv, SkinKeys};
use osier_plants::surface::{SkinOptions, UvMode};
use osier_scene::Material;

/// Index of the bark material in the list of a plant.
pub const BARK: u16 = 0;
/// Index of the material of thin axes (shoots) in the list of a plant.
pub const SHOOT: u16 = 1;
/// Axes whose radius at the base is below this have the shoot material, m.
pub const SHOOT_RADIUS: f32 = 0.008;

/// Radius below which axes of a species that grows over the clip are cones, m, without its key. Own: nine tenths of an oak's axes, whose
/// points would be nine tenths of every frame; from twenty metres on they are thinner than a pixel.
pub const GROWTH_CONES: f32 = 0.012;

/// Width and height of one repeat of the maps of bark and shoots, m, among the materials of a plant.
pub fn bark_tiles(materials: &[Material]) -> [f32; 2] {
    [BARK, SHOOT].map(|i| materials.get(usize::from(i)).map_or(0.5, |m| m.tile))
}

/// Options of the bark's mesh from `[plants.NAME.skin]`; `tiles`: those of [`bark_tiles`].
pub fn skin_options(keys: &SkinKeys, tiles: [f32; 2], context: &BakeContext<'_>) -> SkinOptions {
    let defaults = SkinOptions::default();
    SkinOptions {
        sides: (keys.sides, defaults.sides.1),
        turn: osier_base::math::narrow(keys.turn),
        edge: osier_base::math::narrow(keys.edge),
        tile: [tiles[0]; 2],
        shoot_tile: [tiles[1]; 2],
        uv: if keys.uv == BarkUv::Metric { UvMode::Metric } else { UvMode::Conformal },
        flare: osier_base::math::narrow(keys.flare),
        flare_height: osier_base::math::narrow(keys.flare_height),
        buttresses: keys.buttresses,
        bury: osier_base::math::narrow(keys.bury),
        shoot: Some((SHOOT_RADIUS, SHOOT)),
        thin: osier_base::math::narrow(keys.cones.unwrap_or(0.0)),
        max_points: context.limits.get("vertices"),
        ..defaults
    }
}
