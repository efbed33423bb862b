//! `[picture]`: how an attractor becomes a picture.

use crate::recipe::syntax::{ColorType, NumberArray, OneOf, OptionalKey, integer, number};
use crate::recipe::syntax::{choices, keys};

choices! {
    /// Which part of an attractor a picture shows.
    PictureFit {
        /// The view that a flame names; all of it where the file names none.
        View = "view",
        /// All of it.
        Bounds = "bounds",
        /// All but the outermost points.
        Quantile = "quantile",
    }
}

keys! {
    /// How an attractor becomes a picture (`osier grow NAME.ifs -o NAME.png`, or `.exr` for its density).
    PictureKeys at "picture" {
        /// Pixels in a row.
        width: u32 = "width" integer(1024, 1, 16_384);
        /// Rows.
        height: u32 = "height" integer(1024, 1, 16_384);
        /// Number of points.
        points: Option<u32> = "points" OptionalKey(integer(20_000_000, 1, 1_000_000_000), "20 per pixel");
        /// Which part is shown.
        fit: PictureFit = "fit" OneOf(PictureFit::View);
        /// Middle of the picture in table units, instead of `fit`.
        center: Option<[f64; 2]> = "center" OptionalKey(NumberArray([0.0, 0.0], number(0.0, -1e12, 1e12, "")), "fitted");
        /// Width of the picture in table units, with `center`.
        span: Option<f64> = "span" OptionalKey(number(1.0, 1e-12, 1e12, ""), "fitted");
        /// Brightness of thin places.
        exposure: f64 = "exposure" number(16.0, 1e-6, 1e9, "");
        /// Exponent of opacity.
        gamma: f64 = "gamma" number(0.6, 0.05, 10.0, "");
        /// Behind it; without it the picture is transparent.
        background: Option<[f32; 3]> = "background" OptionalKey(ColorType("#ffffff"), "transparent");
        /// Counted at so many times the size.
        oversample: u32 = "oversample" integer(1, 1, 4);
        /// Thin places are spread over discs of this radius; 0 is off.
        spread: f64 = "spread_px" number(0.0, 0.0, 64.0, "pixels");
        /// Smallest radius of such a disc.
        spread_min: f64 = "spread_min_px" number(0.0, 0.0, 64.0, "pixels");
        /// How fast discs shrink with hits.
        spread_curve: f64 = "spread_curve" number(0.4, 0.0, 4.0, "");
        /// Bits of a channel of a PNG: 8 or 16.
        bits: u32 = "bits" integer(8, 8, 16);
    }
}
