//! Keys of pictures that are laid together from several tables.

use super::cloud_keys::{ColorBy, WeightsFrom};
use super::key::keys;
use super::kinds::{Color, Colors, File, Maybe, OneOf, Reference, Text, Tuple, num, whole};

keys! {
    /// One layer of a picture laid over those before it: a table's points, or without `ifs` a plain box
    /// (`osier grow NAME -o NAME.png`).
    LayerKeys at "layer" {
        /// The coefficient table that draws it.
        ifs: Option<Reference> = "ifs" File(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" Text("");
        /// Where the probabilities of maps come from.
        weights: Option<WeightsFrom> = "weights" Maybe(OneOf(WeightsFrom::File), "the file's");
        /// Number of points.
        points: Option<u32> = "points" Maybe(whole(1_000_000, 1, 1_000_000_000), "20 per pixel of its box");
        /// Middle of its foot, in shares of the picture's width and height from the lower left corner.
        at: [f64; 2] = "at" Tuple([0.5, 0.0], num(0.0, -10.0, 10.0, ""));
        /// Its height, share of the picture's.
        height: Option<f64> = "height" Maybe(num(1.0, 1e-3, 10.0, ""), "from width");
        /// Its width, share of the picture's; with `height` it is stretched to both.
        width: Option<f64> = "width" Maybe(num(1.0, 1e-3, 10.0, ""), "from height");
        /// One colour for all of it.
        color: Option<[f32; 3]> = "color" Maybe(Color("#000000"), "by color_by");
        /// Colour at the upper edge of a box, a gradient from `color`.
        color2: Option<[f32; 3]> = "color2" Maybe(Color("#000000"), "color");
        /// What the colour of a point stands for.
        color_by: ColorBy = "color_by" OneOf(ColorBy::Map);
        /// Maps that count for the colour by word.
        prefix: u32 = "prefix" whole(2, 1, 4);
        /// Colours by map, or along the palette.
        colors: Vec<[f32; 3]> = "colors" Colors;
        /// How much it covers.
        opacity: f64 = "opacity" num(1.0, 0.0, 1.0, "");
        /// Brightness of thin places.
        exposure: Option<f64> = "exposure" Maybe(num(16.0, 1e-6, 1e9, ""), "the picture's");
        /// Exponent of opacity.
        gamma: Option<f64> = "gamma" Maybe(num(0.6, 0.05, 10.0, ""), "the picture's");
    }
}
