//! `[plants.NAME.bark]`, `.shoot` and `.skin`: bark and its mesh.

use crate::recipe::syntax::{
    ColorType, FileReference, OneOf, OptionalKey, PowerOfTwo, Reference, StringType, degrees, millimetres, number,
};
use crate::recipe::syntax::{choices, keys};

/// Where a bark's number comes from without its key.
const KIND: &str = "the kind's own";

choices! {
    /// Character of bark.
    BarkKind {
        /// Long ridges between deep cracks: oak, willow.
        Furrowed = "furrowed",
        /// Thick scales: pine.
        Plated = "plated",
        /// Nearly even: beech.
        Smooth = "smooth",
        /// Pale, with dark dashes round the girth: birch, cherry.
        Lenticel = "lenticel",
        /// Grey-green, with rows of dark diamonds: poplar, aspen.
        Diamond = "diamond",
        /// Fibrous strips: vine, cedar.
        Stringy = "stringy",
        /// Young green wood.
        Shoot = "shoot",
        /// Green and waxy with fine fibres: bamboo.
        Culm = "culm",
    }
    /// How bark maps follow a taper.
    BarkUv {
        /// Keeps proportions along the taper.
        Conformal = "conformal",
        /// The same number of metres per repeat everywhere.
        Metric = "metric",
    }
}

keys! {
    /// Bark of the thick axes; `[plants.NAME.shoot]` has the same keys for axes below 8 mm radius, and is of kind "shoot".
    BarkKeys at "plants.NAME.bark" also "plants.NAME.shoot" {
        /// Character.
        kind: BarkKind = "kind" OneOf(BarkKind::Furrowed);
        /// A coefficient table of the plane whose density tiles the bark, in relief and tint.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" StringType("");
        /// Ridges, or the ground colour.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#8a7a66"), KIND);
        /// Cracks, or the marks.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#3a2f26"), KIND);
        /// Size of one repeat of the maps.
        tile: Option<f64> = "tile" OptionalKey(number(0.5, 0.001, 100.0, "m"), KIND);
        /// From crack to ridge.
        depth: Option<f64> = "depth_mm" OptionalKey(millimetres(12.0, 0.0, 100.0), KIND);
        /// Weathered patches, lichen: none to much.
        patches: Option<f64> = "patches" OptionalKey(number(0.3, 0.0, 1.0, ""), KIND);
        /// Pixels along a side of the maps.
        side: u32 = "side" PowerOfTwo(1024);
    }
    /// How bark becomes a mesh.
    SkinKeys at "plants.NAME.skin" {
        /// Length of edges around an axis.
        edge: f64 = "edge" number(0.04, 1e-5, 10.0, "m");
        /// A new ring after so much bend.
        turn: f64 = "turn_deg" degrees(12.0, 0.6, 85.0);
        /// How the maps follow the taper.
        uv: BarkUv = "uv" OneOf(BarkUv::Conformal);
        /// Widening at the foot.
        flare: f64 = "flare" number(0.6, 0.0, 2.0, "of the radius");
        /// How far the foot goes on below the ground.
        bury: f64 = "bury" number(0.15, 0.0, 10.0, "m");
    }
}
