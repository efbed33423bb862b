//! Options of the bark's mesh, and the indices of its two materials.

use crate::bake::BakeContext;
pub use crate::recipe::scene::SHOOT_RADIUS;
use crate::recipe::scene::{BarkUv, SkinKeys};
use osier_plants::surface::{SkinOptions, UvMode};

/// Index of the bark material in the list of a plant.
pub const BARK: u16 = 0;
/// Index of the material of thin axes (shoots) in the list of a plant.
pub const SHOOT: u16 = 1;

/// Radius below which axes of a species that grows over the clip are cones, m, without its key. Own: nine tenths of an oak's axes, whose
/// points would be nine tenths of every frame; from twenty metres on they are thinner than a pixel.
pub const GROWTH_CONES: f32 = 0.012;

/// Size of one repeat of the maps of a plant's bark and shoots.
#[derive(Debug, Clone, Copy, Default)]
pub struct BarkTiles {
    /// Width and height of one repeat of the bark maps, m.
    pub bark: [f32; 2],
    /// Width and height of one repeat of the shoot maps, m.
    pub shoot: [f32; 2],
}

/// Options of the bark's mesh from `[plants.NAME.skin]`.
pub fn skin_options(keys: &SkinKeys, tiles: BarkTiles, context: &BakeContext<'_>) -> SkinOptions {
    let defaults = SkinOptions::default();
    SkinOptions {
        sides: (keys.sides, defaults.sides.1),
        turn: osier_base::math::narrow(keys.turn),
        edge: osier_base::math::narrow(keys.edge),
        tile: tiles.bark,
        shoot_tile: tiles.shoot,
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
