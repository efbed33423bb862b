//! `[picture]`: how an attractor becomes a picture.

use crate::recipe::syntax::{ColorType, NumberArray, OneOf, OptionalKey, PngBits, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Part of an attractor that fills the picture.
    PictureFit {
        /// The view in a flame file; the whole attractor if the file has none.
        View = "view",
        /// The bounding box of the attractor.
        Bounds = "bounds",
        /// The box of its quantiles, without the outermost points.
        Quantile = "quantile",
    }
}

keys! {
    /// Picture of an attractor (`osier grow NAME.ifs -o NAME.png`; `.exr` for its density).
    PictureKeys at "picture" {
        /// Width of the picture in pixels.
        width: u32 = "width" integer(1024, 1, 16_384);
        /// Height of the picture in pixels.
        height: u32 = "height" integer(1024, 1, 16_384);
        /// Number of points that the chaos game draws.
        points: Option<u32> = "points" OptionalKey(integer(20_000_000, 1, 1_000_000_000), "20 per pixel");
        /// Part of the attractor that is shown.
        fit: PictureFit = "fit" OneOf(PictureFit::View);
        /// Centre of the picture in table units, instead of that of `fit`.
        center: Option<[f64; 2]> = "center" OptionalKey(NumberArray([0.0, 0.0], number(0.0, -1e12, 1e12, "")), "fitted");
        /// Width of the picture in table units, instead of that of `fit`.
        span: Option<f64> = "span" OptionalKey(number(1.0, 1e-12, 1e12, ""), "fitted");
        /// Exposure: brightness of low densities.
        exposure: f64 = "exposure" number(16.0, 1e-6, 1e9, "");
        /// Exponent of opacity.
        gamma: f64 = "gamma" number(0.6, 0.05, 10.0, "");
        /// Colour behind the attractor.
        background: Option<[f32; 3]> = "background" OptionalKey(ColorType("#ffffff"), "transparent");
        /// Supersampling factor.
        oversample: u32 = "oversample" integer(1, 1, 4);
        /// Largest radius of the density estimation at low densities; 0 disables it.
        spread: f64 = "spread_px" number(0.0, 0.0, 64.0, "pixels");
        /// Smallest radius of the density estimation.
        spread_min: f64 = "spread_min_px" number(0.0, 0.0, 64.0, "pixels");
        /// How fast the radius decreases with the density.
        spread_curve: f64 = "spread_curve" number(0.4, 0.0, 4.0, "");
        /// Bits per channel of a PNG.
        bits: u32 = "bits" PngBits;
    }
}
