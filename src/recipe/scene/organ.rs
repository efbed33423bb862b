//! `[plants.NAME.leaf]` and `[plants.NAME.organs.LETTER]`: leaves and other organs.

use super::UpAxis;
use crate::recipe::syntax::{
    BooleanType, ColorType, FileReference, NumberArray, OneOf, OptionalKey, Reference, StringType, degrees, integer,
    millimetres, number,
};
use crate::recipe::syntax::{choices, keys};

/// Where an organ's number comes from without its key.
const OWN: &str = "the blade's own";

choices! {
    /// Outline of a leaf blade.
    BladeOutline {
        /// Widest beyond the middle, with rounded lobes, as an oak's.
        Lobed = "lobed",
        /// Widest below the middle, doubly toothed, as a birch's.
        Toothed = "toothed",
        /// Triangular with a drawn-out tip and fine teeth, as a poplar's.
        Deltoid = "deltoid",
        /// Widest in the middle, without teeth, as a beech's.
        Elliptic = "elliptic",
    }
    /// How finely blades are cut.
    BladeDetail {
        /// For plants seen whole: 40 to 90 points.
        Light = "light",
        /// For crowns of many thousand leaves: 20 to 50 points.
        Crown = "crown",
        /// For close-ups: every tooth, 100 to 250 points.
        Hero = "hero",
        /// For pictures of a few leaves: a smooth margin, thousands of points, a map of its relief.
        Close = "close",
    }
}

keys! {
    /// What an organ looks like: NAME is the letter that follows '~' in the grammar. `[plants.NAME.leaf]` is short for the
    /// organ "l".
    OrganKeys at "plants.NAME.organs.LETTER" also "plants.NAME.leaf" {
        /// Outline of a made blade.
        blade: BladeOutline = "blade" OneOf(BladeOutline::Elliptic);
        /// A mesh of your own instead of a made blade: petiole base at the origin, +Y along the midrib, +Z the upper side.
        mesh: Option<Reference> = "mesh" FileReference(".obj, .glb");
        /// A coefficient table that draws the leaf, instead of a made blade.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" StringType("");
        /// Where the stalk meets the leaf of a table, in its units.
        anchor: Option<[f64; 2]> = "anchor" OptionalKey(NumberArray([0.0, 0.0], number(0.0, -1e12, 1e12, "")), "found");
        /// Gaps in the leaf of a table that are closed, in pixels of a map of 1024.
        close: f64 = "close_px" number(2.0, 0.0, 8.0, "pixels");
        /// Largest hole in the leaf of a table that is filled, share of the map.
        fill: f64 = "fill" number(0.005, 0.0, 1.0, "");
        /// Whether holes in the leaf of a table are cut into its mesh.
        holes: bool = "holes" BooleanType(false);
        /// Length of the blade; the turtle's size factor multiplies it.
        size: Option<f64> = "size" OptionalKey(number(0.08, 1e-3, 2.0, "m"), OWN);
        /// Width over length.
        width: Option<f64> = "width" OptionalKey(number(0.6, 0.02, 3.0, ""), OWN);
        /// Lobes or teeth along one side.
        lobes: Option<u32> = "lobes" OptionalKey(integer(5, 0, 60), OWN);
        /// Depth of lobes or teeth.
        depth: Option<f64> = "depth" OptionalKey(number(0.35, 0.0, 0.9, "of the half width"), OWN);
        /// Smaller teeth after each large one.
        minor_teeth: Option<u32> = "minor_teeth" OptionalKey(integer(0, 0, 4), OWN);
        /// Side veins on each side; lobed blades have one for each lobe.
        veins: Option<u32> = "veins" OptionalKey(integer(6, 1, 16), OWN);
        /// Angle between midrib and side veins.
        vein_angle: Option<f64> = "vein_angle_deg" OptionalKey(degrees(48.0, 18.0, 80.0), OWN);
        /// Fold along the midrib.
        fold: Option<f64> = "fold_deg" OptionalKey(degrees(10.0, -68.0, 68.0), OWN);
        /// Droop from base to tip.
        curl: Option<f64> = "curl_deg" OptionalKey(degrees(20.0, -170.0, 170.0), OWN);
        /// Height of the waves of the margin.
        waviness: Option<f64> = "waviness" OptionalKey(number(0.04, 0.0, 0.3, "of the width"), OWN);
        /// Length of the stalk.
        petiole: Option<f64> = "petiole" OptionalKey(number(0.02, 0.0, 1.0, "m"), OWN);
        /// Radius of the stalk.
        petiole_radius: Option<f64> = "petiole_radius_mm" OptionalKey(millimetres(0.8, 0.1, 10.0), OWN);
        /// Thickness of the stalk over its width: 1 round, 2 flattened as a poplar's.
        petiole_flatness: Option<f64> = "petiole_flatness" OptionalKey(number(1.0, 0.3, 3.0, ""), OWN);
        /// Blade.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#4f7a33"), OWN);
        /// Veins and margin.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#86a05a"), OWN);
        /// So many blades are made, different in fold, curl and proportions.
        variants: u32 = "variants" integer(4, 1, 32);
        /// How finely a blade is cut.
        detail: BladeDetail = "detail" OneOf(BladeDetail::Light);
        /// Pixels along a side of the maps.
        side: u32 = "side" integer(512, 16, 4096);
        /// Metres per unit of a mesh of your own.
        mesh_scale: f64 = "mesh_scale" number(1.0, 1e-6, 1e6, "m");
        /// Upward axis of a mesh of your own.
        mesh_up: UpAxis = "mesh_up" OneOf(UpAxis::Y);
        /// Light let through.
        translucency: f64 = "translucency" number(0.35, 0.0, 1.0, "");
        /// 0 mirror to 1 matt.
        roughness: Option<f64> = "roughness" OptionalKey(number(0.45, 0.0, 1.0, ""), OWN);
        /// Flutter in the wind: 1 for round stalks, 2 to 3 for the flat ones of poplars.
        flutter: f64 = "flutter" number(1.0, 0.0, 10.0, "");
    }
}
