//! `[ground]`: the ground around the plants.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{BooleanType, ColorType, OptionalKey, PowerOfTwo, number};

/// Largest repeat of the textures, m.
pub(in crate::recipe) const MAX_GROUND_TILE: f64 = 1000.0;

keys! {
    /// Ground: a disc around the plants.
    GroundKeys at "ground" {
        /// Whether there is a ground.
        show: bool = "show" BooleanType(true), basic;
        /// Diameter of the disc.
        size: f64 = "size" number(40.0, 0.2, 2e4, "m"), basic;
        /// Height of its undulations.
        relief: f64 = "relief" number(0.15, 0.0, 100.0, "m"), basic;
        /// Wavelength of its undulations.
        wavelength: f64 = "wavelength" number(9.0, 0.01, 1e5, "m");
        /// Colour of bare soil.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#5c4f40"), "brown"), basic;
        /// Colour of grass and moss.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#576a31"), "green");
        /// Fraction of grass and moss.
        cover: f64 = "cover" number(0.62, 0.0, 1.0, "");
        /// Size of one repeat of the textures; at `size` or more one texture covers the whole ground.
        tile: f64 = "tile" number(12.0, 0.01, MAX_GROUND_TILE, "m");
        /// With one texture: fraction of the sky colour at the edge, which softens the horizon.
        haze: f64 = "haze" number(0.8, 0.0, 1.0, "");
        /// Side length of the textures in pixels.
        side: u32 = "side" PowerOfTwo(1024);
    }
}
