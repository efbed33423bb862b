//! `[[scatter]]`: plants scattered over the terrain.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{
    FileReference, NamedNumbers, NumberArray, OptionalKey, Reference, degrees, integer, number,
};

keys! {
    /// Strews plants over the land (`[terrain]`). Each `[[scatter]]` keeps clear of those before it and moves none of them.
    ScatterKeys at "scatter" {
        /// Plants with their weights, as in { oak = 2, birch = 1 }.
        plants: Vec<(String, f64)> = "plants" NamedNumbers;
        /// Least distance between two.
        spacing: f64 = "spacing" number(4.0, 0.05, 1e4, "m");
        /// Least distance to what earlier ones put up.
        clear: Option<f64> = "clear" OptionalKey(number(0.0, 0.0, 1e4, "m"), "half of both spacings");
        /// Steepest slope.
        slope_max: f64 = "slope_max_deg" degrees(35.0, 0.0, 90.0);
        /// Lowest and highest place.
        altitude: [f64; 2] = "altitude" NumberArray([-1e5, 1e5], number(0.0, -1e5, 1e5, "m"));
        /// Chance that a place is taken.
        density: f64 = "density" number(1.0, 0.0, 1.0, "");
        /// A picture over the whole land, its top at -z: white bears plants, black none.
        mask: Option<Reference> = "mask" FileReference(".png, .jpg");
        /// Length of the patches in which they gather; 0 is evenly.
        clump: f64 = "clump" number(0.0, 0.0, 1e5, "m");
        /// Smallest and largest size.
        scale: [f64; 2] = "scale" NumberArray([0.8, 1.2], number(1.0, 1e-3, 1e3, ""));
        /// Share of the slope by which they lean with it: 0 upright, 1 square to the land.
        align: f64 = "align" number(0.15, 0.0, 1.0, "");
        /// Most of them.
        max_count: u32 = "max_count" integer(100_000, 0, 10_000_000);
        /// Each plant is grown so many times; all copies show one of these.
        individuals: u32 = "individuals" integer(3, 1, 1000);
        /// Middle of a disc, x and z, in which they stand.
        at: [f64; 2] = "at" NumberArray([0.0, 0.0], number(0.0, -1e6, 1e6, "m"));
        /// Radius of that disc.
        radius: Option<f64> = "radius" OptionalKey(number(50.0, 0.0, 1e6, "m"), "all of the land");
        /// They stand no nearer to the middle.
        inner: f64 = "inner" number(0.0, 0.0, 1e6, "m");
        /// Share of the radius over which they thin out.
        fade: f64 = "fade" number(0.3, 0.0, 1.0, "");
    }
}
