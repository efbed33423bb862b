//! Keys of attractors: as point clouds of a scene, and as pictures.

use super::key::{keys, words};
use super::kinds::{Color, Colors, File, Flag, Maybe, OneOf, Reference, Text, Tuple, deg, mm, num, point, whole};

words! {
    /// What the colour of a point stands for.
    ColorBy {
        /// The map that made it.
        Map = "map",
        /// The last maps that made it.
        Word = "word",
        /// Its place in the palette.
        Palette = "palette",
        /// Steps since the start or the last jump.
        Depth = "depth",
        /// Branchings since the last stem, along the palette: trunk, branches, twigs.
        Order = "order",
        /// One colour; pictures show density alone.
        Density = "density",
    }
    /// Where the probabilities of maps come from.
    WeightsFrom {
        /// The file's column, running sums taken apart.
        File = "file",
        /// The file's column as it is.
        FileRaw = "file-raw",
        /// The maps' areas.
        Det = "det",
        /// The maps' shares of the similarity dimension.
        Moran = "moran",
        /// All the same.
        Equal = "equal",
        /// As Fractint draws.
        Fractint = "fractint",
    }
    /// Where the radii of a tree come from.
    Radii {
        /// The maps' own factors.
        Maps = "maps",
        /// What goes into a fork comes out of it.
        Pipe = "pipe",
    }
    /// What of an attractor stands where the scene puts it.
    Foot {
        /// The middle of the underside of its box.
        Box = "box",
        /// The origin of its table.
        Origin = "origin",
    }
    /// Which part of an attractor a picture shows.
    Fit {
        /// The view that a flame names; all of it where the file names none.
        View = "view",
        /// All of it.
        Bounds = "bounds",
        /// All but the outermost points.
        Quantile = "quantile",
    }
}

keys! {
    /// The points of an attractor; NAME is yours.
    CloudKeys at "clouds.NAME" with ["morph"] {
        /// The coefficient table that makes it.
        ifs: Option<Reference> = "ifs" File(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" Text("");
        /// Where the probabilities of maps come from.
        weights: Option<WeightsFrom> = "weights" Maybe(OneOf(WeightsFrom::File), "the file's");
        /// Number of points.
        points: u32 = "points" whole(1_000_000, 1, 1_000_000_000);
        /// What the colour of a point stands for.
        color_by: ColorBy = "color_by" OneOf(ColorBy::Map);
        /// Maps that count for the colour by word.
        prefix: u32 = "prefix" whole(2, 1, 4);
        /// Colours by map, or along the palette.
        colors: Vec<[f32; 3]> = "colors" Colors;
        /// Height of the attractor; without it a unit of the table is a metre.
        height: Option<f64> = "height" Maybe(num(1.0, 1e-4, 1e5, "m"), "1 m per unit");
        /// Diameter of a point.
        point: Option<f64> = "point_mm" Maybe(mm(2.0, 1e-4, 1e5), "the size over 800");
        /// One point per cube of this size, the first that falls in; 0 keeps all.
        voxel: f64 = "voxel_mm" mm(0.0, 0.0, 1e6);
        /// Where its foot stands.
        at: [f64; 3] = "at" point([0.0; 3]);
        /// What of it stands there.
        foot: Foot = "foot" OneOf(Foot::Box);
        /// Turn about the vertical.
        turn: f64 = "turn_deg" deg(0.0, -360.0, 360.0);
    }
    /// How a coefficient table grows a tree (`ifs` of its plant).
    TreeKeys at "plants.NAME.tree" {
        /// Which system of the table; the first without a name.
        system: String = "system" Text("");
        /// Height.
        height: f64 = "height" num(6.0, 0.01, 1000.0, "m");
        /// Branches shorter than this share of the trunk become leaf sites.
        eps: f64 = "eps" num(0.09, 1e-4, 1.0, "");
        /// Most branchings between the ground and a tip.
        max_depth: u32 = "max_depth" whole(65_535, 0, 65_535);
        /// Highest order of branches.
        max_order: u32 = "max_order" whole(65_535, 0, 65_535);
        /// How much individuals differ: 0 not at all.
        variation: f64 = "variation" num(1.0, 0.0, 2.0, "");
        /// Radius of the trunk at its foot.
        radius: Option<f64> = "radius" Maybe(num(0.05, 1e-4, 100.0, "m"), "the table's");
        /// Where radii come from.
        radii: Radii = "radii" OneOf(Radii::Maps);
        /// Share of the leaf sites that bear leaves.
        leaf_density: f64 = "leaf_density" num(1.0, 0.0, 1.0, "");
        /// Leaves at a site.
        leaves: u32 = "leaves" whole(3, 1, 100);
        /// Level of detail: branches shorter than 2^lod eps are pictures on crossed quads. 0: all of them grow.
        lod: u32 = "lod" whole(0, 0, 6);
        /// Ends of branches, below four times `eps`, are copies of a few twigs: large trees in small files.
        twigs: bool = "twigs" Flag(false);
    }
    /// How an attractor becomes a picture (`osier grow NAME.ifs -o NAME.png`, or `.exr` for its density).
    PictureKeys at "picture" {
        /// Pixels in a row.
        width: u32 = "width" whole(1024, 1, 16_384);
        /// Rows.
        height: u32 = "height" whole(1024, 1, 16_384);
        /// Number of points.
        points: Option<u32> = "points" Maybe(whole(20_000_000, 1, 1_000_000_000), "20 per pixel");
        /// Which part is shown.
        fit: Fit = "fit" OneOf(Fit::View);
        /// Middle of the picture in table units, instead of `fit`.
        center: Option<[f64; 2]> = "center" Maybe(Tuple([0.0, 0.0], num(0.0, -1e12, 1e12, "")), "fitted");
        /// Width of the picture in table units, with `center`.
        span: Option<f64> = "span" Maybe(num(1.0, 1e-12, 1e12, ""), "fitted");
        /// Brightness of thin places.
        exposure: f64 = "exposure" num(16.0, 1e-6, 1e9, "");
        /// Exponent of opacity.
        gamma: f64 = "gamma" num(0.6, 0.05, 10.0, "");
        /// Behind it; without it the picture is transparent.
        background: Option<[f32; 3]> = "background" Maybe(Color("#ffffff"), "transparent");
        /// Counted at so many times the size.
        oversample: u32 = "oversample" whole(1, 1, 4);
        /// Thin places are spread over discs of this radius; 0 is off.
        spread: f64 = "spread_px" num(0.0, 0.0, 64.0, "pixels");
        /// Smallest radius of such a disc.
        spread_min: f64 = "spread_min_px" num(0.0, 0.0, 64.0, "pixels");
        /// How fast discs shrink with hits.
        spread_curve: f64 = "spread_curve" num(0.4, 0.0, 4.0, "");
        /// Bits of a channel of a PNG: 8 or 16.
        bits: u32 = "bits" whole(8, 8, 16);
    }
}
