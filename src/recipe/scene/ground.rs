//! `[ground]`: the ground around the plants.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{BooleanType, ColorType, OptionalKey, PowerOfTwo, number};

keys! {
    /// The ground: a disc around the plants.
    GroundKeys at "ground" {
        /// Whether there is one.
        show: bool = "show" BooleanType(true);
        /// Its diameter.
        size: f64 = "size" number(40.0, 0.2, 2e4, "m");
        /// Height of its waves.
        relief: f64 = "relief" number(0.15, 0.0, 100.0, "m");
        /// Length of its waves.
        wavelength: f64 = "wavelength" number(9.0, 0.01, 1e5, "m");
        /// Soil.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#5c4f40"), "brown");
        /// Grass and moss.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#576a31"), "green");
        /// Share of grass and moss.
        cover: f64 = "cover" number(0.62, 0.0, 1.0, "");
        /// Size of one repeat of the maps; at `size` or more one map covers the whole ground.
        tile: f64 = "tile" number(12.0, 0.01, 1000.0, "m");
        /// Share of the sky's colour in the ground's at the rim, where one map covers it all; softens the horizon.
        haze: f64 = "haze" number(0.8, 0.0, 1.0, "");
        /// Pixels along a side of the maps.
        side: u32 = "side" PowerOfTwo(1024);
    }
}
