//! Keys of landscapes: the land, what is strewn over it, the air above.

use super::key::keys;
use super::kinds::{Color, File, Flag, Maybe, Numbers, PowerOfTwo, Reference, Seed, Tuple, deg, num, whole};

keys! {
    /// Land with hills, raised by midpoint displacement around the origin; it takes the place of the ground, and what
    /// `[[place]]` puts up stands on it.
    TerrainKeys at "terrain" {
        /// Another land of the same kind.
        seed: u64 = "seed" Seed(0);
        /// Doublings: 2^n + 1 heights along a side.
        n: u32 = "n" whole(9, 1, 13);
        /// Length of a side.
        size: f64 = "size" num(200.0, 1.0, 1e5, "m");
        /// Height of the largest hills.
        amplitude: f64 = "amplitude" num(25.0, 0.0, 1e4, "m");
        /// How fast smaller hills are lower: 0 jagged, 1 gentle.
        exponent: f64 = "exponent" num(0.8, 0.0, 1.0, "");
        /// Heights of the corners: -x -z, +x -z, -x +z, +x +z.
        corners: Option<[f64; 4]> = "corners" Maybe(Tuple([0.0; 4], num(0.0, -1e5, 1e5, "m")), "drawn");
        /// Opposite edges are equal, so that copies join; of `corners` the first counts.
        tileable: bool = "tileable" Flag(false);
        /// Both half steps displace alike, as in the paper: a little rougher.
        paper: bool = "paper" Flag(false);
        /// Nothing is lower: a plain, a lake's bed.
        floor: Option<f64> = "floor" Maybe(num(0.0, -1e5, 1e5, "m"), "none");
        /// Smoothing passes over the finished heights.
        smooth: u32 = "smooth" whole(0, 0, 8);
        /// The mesh takes every so many heights: 1, 2, 4 ...
        stride: u32 = "stride" whole(1, 1, 8192);
        /// Bare earth.
        color: Option<[f32; 3]> = "color" Maybe(Color("#5c4d3d"), "brown");
        /// Grass.
        color2: Option<[f32; 3]> = "color2" Maybe(Color("#4d5d2c"), "green");
        /// Rock.
        rock: Option<[f32; 3]> = "rock" Maybe(Color("#77726c"), "grey");
        /// Share of grass on gentle land.
        cover: f64 = "cover" num(0.9, 0.0, 1.0, "");
        /// Slope at which grass gives way to rock.
        steep: f64 = "steep_deg" deg(37.0, 1.0, 90.0);
        /// Pixels along a side of the map that covers all of it.
        side: u32 = "side" PowerOfTwo(2048);
    }
    /// Strews plants over the land (`[terrain]`). Each `[[scatter]]` keeps clear of those before it and moves none of them.
    ScatterKeys at "scatter" {
        /// Plants with their weights, as in { oak = 2, birch = 1 }.
        plants: Vec<(String, f64)> = "plants" Numbers;
        /// Least distance between two.
        spacing: f64 = "spacing" num(4.0, 0.05, 1e4, "m");
        /// Least distance to what earlier ones put up.
        clear: Option<f64> = "clear" Maybe(num(0.0, 0.0, 1e4, "m"), "half of both spacings");
        /// Steepest slope.
        slope_max: f64 = "slope_max_deg" deg(35.0, 0.0, 90.0);
        /// Lowest and highest place.
        altitude: [f64; 2] = "altitude" Tuple([-1e5, 1e5], num(0.0, -1e5, 1e5, "m"));
        /// Chance that a place is taken.
        density: f64 = "density" num(1.0, 0.0, 1.0, "");
        /// A picture over the whole land, its top at -z: white bears plants, black none.
        mask: Option<Reference> = "mask" File(".png, .jpg");
        /// Length of the patches in which they gather; 0 is evenly.
        clump: f64 = "clump" num(0.0, 0.0, 1e5, "m");
        /// Smallest and largest size.
        scale: [f64; 2] = "scale" Tuple([0.8, 1.2], num(1.0, 1e-3, 1e3, ""));
        /// Share of the slope by which they lean with it: 0 upright, 1 square to the land.
        align: f64 = "align" num(0.15, 0.0, 1.0, "");
        /// Most of them.
        max_count: u32 = "max_count" whole(100_000, 0, 10_000_000);
        /// Each plant is grown so many times; all copies show one of these.
        individuals: u32 = "individuals" whole(3, 1, 1000);
        /// Middle of a disc, x and z, in which they stand.
        at: [f64; 2] = "at" Tuple([0.0, 0.0], num(0.0, -1e6, 1e6, "m"));
        /// Radius of that disc.
        radius: Option<f64> = "radius" Maybe(num(50.0, 0.0, 1e6, "m"), "all of the land");
        /// They stand no nearer to the middle.
        inner: f64 = "inner" num(0.0, 0.0, 1e6, "m");
        /// Share of the radius over which they thin out.
        fade: f64 = "fade" num(0.3, 0.0, 1.0, "");
    }
    /// Haze between the eye and far things. Previews and POV-Ray show it; USD and glTF carry its numbers.
    FogKeys at "fog" {
        /// Distance at which 2 % of a contrast is left; without it there is no haze.
        visibility: Option<f64> = "visibility" Maybe(num(400.0, 0.1, 1e7, "m"), "none");
        /// Colour.
        color: Option<[f32; 3]> = "color" Maybe(Color("#edf3f9"), "the sky's at the horizon");
        /// Height at which a quarter of it is left; 0: it is the same at all heights.
        height: f64 = "height" num(0.0, 0.0, 1e5, "m");
    }
}
