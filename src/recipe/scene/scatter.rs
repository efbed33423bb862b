//! `[[scatter]]`: plants scattered over the terrain.

use crate::recipe::syntax::keys;
use crate::recipe::syntax::{
    FileReference, NamedNumbers, NumberArray, OptionalKey, Reference, degrees, integer, number,
};

keys! {
    /// Scatters plants over the terrain. Each `[[scatter]]` keeps clear of earlier ones and does not move them.
    ScatterKeys at "scatter" as list {
        /// Plants with weights: { oak = 2, birch = 1 }.
        plants: Vec<(String, f64)> = "plants" NamedNumbers;
        /// Smallest distance between two plants.
        spacing: f64 = "spacing" number(4.0, 0.05, 1e4, "m"), basic;
        /// Smallest distance to earlier plants.
        clear: Option<f64> = "clear" OptionalKey(number(0.0, 0.0, 1e4, "m"), "the mean of both spacings");
        /// Steepest slope on which plants stand.
        slope_max: f64 = "slope_max_deg" degrees(35.0, 0.0, 90.0);
        /// Lowest and highest position.
        altitude: [f64; 2] = "altitude" NumberArray([-1e5, 1e5], number(0.0, -1e5, 1e5, "m"));
        /// Probability that a position is used.
        density: f64 = "density" number(1.0, 0.0, 1.0, ""), basic;
        /// Image over the whole terrain, top at -z: plants grow where it is white.
        mask: Option<Reference> = "mask" FileReference(".png, .jpg, .exr");
        /// Size of patches in which plants gather; 0 for a uniform distribution.
        clump: f64 = "clump" number(0.0, 0.0, 1e5, "m");
        /// Smallest and largest scale.
        scale: [f64; 2] = "scale" NumberArray([0.8, 1.2], number(1.0, 1e-3, 1e3, ""));
        /// Fraction of the slope by which plants tilt: 0 upright, 1 normal to the terrain.
        align: f64 = "align" number(0.15, 0.0, 1.0, "");
        /// Largest number of plants.
        max_count: u32 = "max_count" integer(100_000, 0, 10_000_000);
        /// Number of individuals grown of each plant.
        individuals: u32 = "individuals" integer(3, 1, 1000);
        /// Centre x, z of a disc that contains the plants.
        at: [f64; 2] = "at" NumberArray([0.0, 0.0], number(0.0, -1e6, 1e6, "m"));
        /// Radius of the disc.
        radius: Option<f64> = "radius" OptionalKey(number(50.0, 0.0, 1e6, "m"), "the whole terrain");
        /// Smallest distance to the centre.
        inner: f64 = "inner" number(0.0, 0.0, 1e6, "m");
        /// Fraction of the radius over which the density decreases to the edge.
        fade: f64 = "fade" number(0.3, 0.0, 1.0, "");
    }
}
